"""Is the GPU back end right, and how fast? Builds, checks and times all in one go, in under 8 minutes on an H200.

    python benchmarks/gpu_check.py --prepare                  once, on any machine: beds, and answers that are missing
    python benchmarks/gpu_check.py                            on the machine with the GPU
    python benchmarks/gpu_check.py --deme ENV/bin/python      DEM-Engine on the same bed, too: deme_rate.py
    python benchmarks/gpu_check.py --rehearse                 tiny, in numba's simulator, without a GPU

Checks: restitution of one ball; short trajectories of 500 spheres against the processor in double precision; loss
factor and effective mass of 24 operating points and of the baseline damper against the processor within combined
standard errors; the energy ledger; a repeat, bit for bit. Times: particle-steps per second for variants of the kernel
and for numbers of worlds and particles, as a table and a plot; DEM-Engine on the same bed. Worlds are taken at eight
phases of their cycle, since speed depends on the phase. Every part has a limit of time, and what it cannot do within
that is named. Results are written after every part and every row of the table, so that a run that is cut short is not
lost."""

import argparse
import math
import os
import platform
import sys
from collections.abc import Callable
from datetime import date
from importlib.metadata import version
from pathlib import Path
from typing import Any, NamedTuple

if "--rehearse" in sys.argv:
    os.environ["NUMBA_ENABLE_CUDASIM"] = "1"
    sys.setswitchinterval(2e-5)

import numpy as np

import particle_steps_per_second as rates
from deme_rate import DemEngine, Shaken
from gpu_batch import Batch, Scene, rate, scene_of, threads
from gpu_points import ball, check_points, drop, prepare
from gpu_report import Clock, Report
from graindamp.dem.energy import energies
from graindamp.dem.engine import run, start
from graindamp.dem.excitation import motion_of
from graindamp.dem.simulate import simulate
from graindamp.dem.world import world_of
from graindamp.units import STANDARD_GRAVITY

HERE = Path(__file__).parent
CLOSURE = 5e-3
"""Largest error of the energy ledger over what was lost, in mixed precision [-]."""
DRIFT = {"double": 1e-8, "mixed": 2e-3}
"""Largest difference of the trajectories from the processor's after the short run, over the bed's mean speed or its
travel [-]; collisions magnify rounding."""


class Limits(NamedTuple):
    """Sizes of one run of this script."""

    worlds: tuple[int, ...]
    particles: tuple[int, ...]
    seconds: float
    """Of one timing [s]."""
    steps: int
    """Of the short trajectories [-]."""
    total: float
    """After which no further part begins [s]."""


REAL_LIMITS = Limits((1, 16, 132, 264, 420), (150, 500, 4500), 2.0, 300, 440.0)
REHEARSAL = Limits((1, 2), (2, 4), 0.05, 40, 200.0)
BUDGET = {
    "restitution": 160.0,
    "trajectories": 60.0,
    "rates": 120.0,
    "field": 60.0,
    "baseline": 60.0,
    "dem_engine": 45.0,
    "variants": 120.0,
}
"""Most time of each part [s], in the order in which they run; the first two hold the compilation of both precisions,
a minute each. What takes less leaves more to the variants, which are the least needed."""


def check_restitution(report: Report, found: dict[str, Any]) -> None:
    """One ball on a plane, every precision, against the processor."""
    from graindamp.dem.gpu.batch import Task, simulate_batch

    for precision in ("double", "mixed"):
        tasks = [Task(spec, ball()) for spec in (drop(e) for e in (0.3, 0.6, 0.9))]
        worst = 0.0
        for number, run_ in simulate_batch(tasks, precision=precision):
            cpu = simulate(tasks[number].spec, packing=ball())
            assert cpu.end is not None
            assert run_.end is not None
            worst = max(worst, abs(float(run_.end.velocity[0, 0] / cpu.end.velocity[0, 0]) - 1.0))
        found[precision] = worst
        report.demand(
            worst < (1e-9 if precision == "double" else 1e-5), f"restitution, {precision}: off by {worst:.1e}"
        )


def check_trajectories(scene: Scene, limits: Limits, report: Report, found: dict[str, Any]) -> None:
    """A short run of one bed: positions and velocities against the processor, ledger, and a repeat."""
    from graindamp.dem.gpu.columns import BED_MASS, N_TOTAL
    from graindamp.dem.gpu.outcome import energies_of

    state, n_step = scene.states[2], limits.steps
    motion = motion_of(rates.spec_of(len(state.bed.radius)).motion, start=-state.time)
    worlds = world_of(
        state.bed, scene.enclosure, scene.interactions, scene.damper.gravity, rates.TIME_STEP, motion,
        skin=0.05 * rates.RADIUS,
    )  # fmt: skip
    worlds = run(start(worlds), n_step)
    expected, place = energies(worlds), np.argsort(worlds.particles.identity[0])
    position = worlds.particles.position[0, place, :3]
    speed = math.sqrt(2.0 * expected.kinetic / float(np.sum(1.0 / worlds.particles.inverse_mass[0, :, 0])))
    for precision in ("double", "mixed"):
        answers = []
        for _ in range(2):
            batch = Batch(scene, 3, precision, threads(), n_step)
            batch.go(n_step)
            rows = batch.memory.read("slots", "rows", 2)
            answers.append(np.concatenate([batch.memory.read("bed", "position", 2).ravel(), rows[:, :N_TOTAL].ravel()]))
        own = batch.memory.read("bed", "position", 2)[:, : batch.n].T[np.argsort(batch.order)]
        off = float(np.abs(own - position).max()) / (speed * n_step * rates.TIME_STEP)
        first, last = energies_of(rows[0]), energies_of(rows[1])
        gap = last.stored - first.stored + last.lost - last.work
        closure = abs(gap) / max(last.lost, 1e-3 * last.stored)
        found[precision] = {
            "position_off": off,
            "kinetic_off": last.kinetic / expected.kinetic - 1.0,
            "ledger_error": closure,
            "repeats": bool(np.array_equal(answers[0], answers[1])),
            "mass": float(rows[1, BED_MASS]),
        }
        report.demand(off < DRIFT[precision], f"trajectories, {precision}: off by {off:.1e} of the way")
        report.demand(closure < CLOSURE, f"ledger, {precision}: open by {closure:.1e}")
        report.demand(found[precision]["repeats"], f"{precision}: a repeat differs")


def time_variants(
    scene: Scene, limits: Limits, every: bool, clock: Clock, report: Report, found: dict[str, Any]
) -> None:
    """Threads, registers, blocks per world and arithmetic of the kernel; `every`: also those that are unlikely to win,
    each of which costs a minute of compilation."""
    many, tiny = limits.worlds[-1], len(scene.states[0].bed.radius) < 10

    def measured(name: str, worlds: int, precision: str, threads: int, **options: Any) -> None:
        if clock.left < 4.0 * limits.seconds:
            found.setdefault("left_out", []).append(name)
            return
        if tiny:  # the simulator's threads are slow, and its blocks run one after the other
            threads, options["limit"], options["team"] = 4, 4, 1
        batch = Batch(scene, worlds, precision, threads, 10**7, **options)
        found[name] = rate(batch, limits.seconds)
        print(f"  {name}: {found[name]:.3e}", flush=True)
        report.save()

    measured(f"{many} worlds, 512 threads", many, "mixed", 512)
    measured(f"{many} worlds, 256 threads", many, "mixed", 256, limit=512)
    measured("1 world, 512 threads", 1, "mixed", 512)
    measured(f"{many} worlds, double", many, "double", 512)
    for team in (4, 16, 64):
        measured(f"1 world, {team} blocks of 512 threads", 1, "mixed", 512, team=team)
    measured("16 worlds, 8 blocks of 512 threads", 16 if not tiny else 2, "mixed", 512, team=8)
    if every:
        measured(f"{many} worlds, 1024 threads", many, "mixed", 1024)
        measured(f"{many} worlds, 256 threads, registers of 256", many, "mixed", 256)
        measured(f"{many} worlds, 512 threads, fast", many, "mixed", 512, fast=True)


def time_table(data: Path, limits: Limits, rehearse: bool, clock: Clock, report: Report, found: dict[str, Any]) -> None:
    """Particle-steps per second for numbers of worlds and particles, and memory per particle [bytes]. What matters most
    comes first: many worlds of many particles."""
    table = found.setdefault("table", [])
    for n in reversed(limits.particles):
        scene = scene_of(n, data, rehearse)
        for worlds in reversed(limits.worlds):
            if clock.left < 4.0 * limits.seconds:
                found.setdefault("left_out", []).append(f"{worlds} worlds of {n}")
                continue
            batch = Batch(scene, worlds, "mixed", threads(), 10**7)
            value = rate(batch, limits.seconds)
            row = {"particles": n, "worlds": worlds, "rate": value, "step_seconds": worlds * n / value}
            table.append(row | {"bytes_per_particle": batch.memory.bytes / (worlds * n)})
            print(f"  {worlds} worlds of {n}: {value:.3e}", flush=True)
            report.save()
    found["plot"] = str(report.plot())


def compare_deme(engine: DemEngine, scene: Scene, limits: Limits, clock: Clock, report: Report, found: Any) -> None:
    """DEM-Engine's particle-steps per second on one bed, and how often that goes into those of the largest batch."""
    found |= engine.rate(5.0 * limits.seconds, clock.left)
    if "rate" not in found:
        return
    table = report.told.get("rates", {}).get("table", [])
    same = [row for row in table if row["particles"] == limits.particles[-1]]
    if same:
        found["times as fast, most worlds"] = max(same, key=lambda row: int(row["worlds"]))["rate"] / found["rate"]
        found["times as fast, one world"] = min(same, key=lambda row: int(row["worlds"]))["rate"] / found["rate"]
    if found["squared_speed"] is not None:
        reference = float(np.mean(np.sum(scene.states[1].bed.velocity ** 2, axis=1)))
        found["kinetic energy over the processor's after 1/8 cycle"] = found["squared_speed"] / reference
    report.plot()


def deme_of(arguments: argparse.Namespace, limits: Limits) -> DemEngine:
    """DEM-Engine on the first phase of the largest bed, started now: its kernels compile while others are timed."""
    n = limits.particles[-1]
    path = arguments.data / f"bed-{n}-6.npz"
    if arguments.rehearse:
        path = arguments.out / "bed-rehearsal.npz"
        bed = scene_of(n, arguments.data, True).states[0].bed
        np.savez(path, position=[bed.position], velocity=[bed.velocity], time=[0.0], length=8e-3)
    container: Any = rates.spec_of(n).damper.container
    shaken = Shaken(
        states=str(path.resolve()),
        radius=rates.RADIUS,
        density=rates.DENSITY,
        cylinder=container.radius,
        frequency=rates.FREQUENCY,
        acceleration=rates.INTENSITY * STANDARD_GRAVITY,
        gravity=STANDARD_GRAVITY,
        time_step=rates.TIME_STEP,
    )
    python = Path(sys.executable) if arguments.rehearse else arguments.deme
    return DemEngine(python, shaken, arguments.out / "deme.log", stand_in=arguments.rehearse)


def about() -> dict[str, Any]:
    """Date, card, driver and versions."""
    told: dict[str, Any] = {"date": date.today().isoformat(), "python": platform.python_version()}
    for name in ("numba", "numba-cuda", "numpy", "graindamp"):
        told[name] = version(name)
    if os.environ.get("NUMBA_ENABLE_CUDASIM") == "1":
        return {**told, "card": "none: numba's simulator, a rehearsal"}
    import numba.cuda

    cuda: Any = numba.cuda
    device = cuda.get_current_device()
    told["card"] = device.name.decode() if isinstance(device.name, bytes) else str(device.name)
    told["multiprocessors"] = device.MULTIPROCESSOR_COUNT
    told["CUDA of the driver"] = str(cuda.cudadrv.driver.driver.get_version())
    return told


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--data", type=Path, default=HERE / "gpu_check_data", help="folder of beds and answers")
    parser.add_argument("--out", type=Path, default=HERE / "results", help="folder of the results")
    parser.add_argument("--prepare", action="store_true", help="make beds and answers on the processor")
    parser.add_argument(
        "--baseline", action="store_true", help="with --prepare: answers of the baseline damper too, half an hour"
    )
    parser.add_argument(
        "--every", action="store_true", help="also time variants of the kernel that are unlikely to win"
    )
    parser.add_argument("--deme", type=Path, help="Python of an environment with deme, see deme_rate.py")
    parser.add_argument("--rehearse", action="store_true", help="tiny sizes in numba's simulator")
    arguments = parser.parse_args()
    if arguments.prepare:
        arguments.data.mkdir(parents=True, exist_ok=True)
        for n in REAL_LIMITS.particles:
            rates.prepared(n, 6, arguments.data)
            print(f"bed of {n} is ready", flush=True)
        prepare("field", arguments.data)
        prepare("baseline", arguments.data, only_bed=not arguments.baseline)
        return
    limits = REHEARSAL if arguments.rehearse else REAL_LIMITS
    clock = Clock(limits.total)
    report = Report(arguments.out, "gpu_rehearsal" if arguments.rehearse else "gpu_check", about())
    engine = deme_of(arguments, limits)
    try:
        check(arguments, limits, clock, report, engine)
    finally:
        engine.end()
    print(report.page())
    sys.exit(1 if report.failed else 0)


def check(arguments: argparse.Namespace, limits: Limits, clock: Clock, report: Report, engine: DemEngine) -> None:
    """All parts, one after the other."""
    data, rehearse = arguments.data, arguments.rehearse
    middle, largest = limits.particles[len(limits.particles) // 2], limits.particles[-1]
    rest = (clock, report)

    def scene(n: int) -> Scene:
        return scene_of(n, data, rehearse)

    parts: dict[str, Callable[[dict[str, Any]], None]] = {
        "restitution": lambda found: check_restitution(report, found),
        "trajectories": lambda found: check_trajectories(scene(middle), limits, report, found),
        "rates": lambda found: time_table(data, limits, rehearse, *rest, found),
        "field": lambda found: check_points("field", data, rehearse, *rest, found),
        "baseline": lambda found: check_points("baseline", data, rehearse, *rest, found),
        "dem_engine": lambda found: compare_deme(engine, scene(largest), limits, *rest, found),
        "variants": lambda found: time_variants(scene(largest), limits, arguments.every, *rest, found),
    }
    for name, seconds in BUDGET.items():
        clock.part(seconds)
        if clock.left <= 0.0:
            report.demand(False, f"{name}: no time left")
            continue
        print(f"{name} ({clock.spent:.0f} s)", flush=True)
        found: dict[str, Any] = {}
        report.told[name] = found
        try:
            parts[name](found)
        except Exception as error:  # one part's failure must not cost the others their machine time
            report.demand(False, f"{name}: {type(error).__name__}: {error}")
        report.told["seconds"] = clock.spent
        report.save()


if __name__ == "__main__":
    main()
