"""Is the GPU back end right, and how fast? Builds, checks and times all in one go, in under 8 minutes on an H200.

    python benchmarks/gpu_check.py --prepare                  once, on any machine: beds, and answers that are missing
    python benchmarks/gpu_check.py                            on the machine with the GPU
    python benchmarks/gpu_check.py --field                    a whole field, in under 10 minutes
    python benchmarks/gpu_check.py --deme ENV/bin/python      DEM-Engine on the same bed, too: deme_rate.py
    python benchmarks/gpu_check.py --rehearse                 tiny, in numba's simulator, without a GPU

Checks: single contacts, with friction and spin; short trajectories of 500 spheres against the processor in double
precision, and a repeat, bit for bit; the energy ledger over two cycles; loss factor and effective mass of 24 operating
points and of the baseline damper against the processor within combined standard errors. A check that was left out
counts as one that failed. Times: particle-steps per second for numbers of worlds and particles, as a table and a plot,
and for variants of the kernel; one world against one core of the processor; DEM-Engine on the same bed. Worlds are
taken at eight phases of their cycle, since speed depends on the phase. Every part has a limit of time, and what it
cannot do within that is named. Results are written after every part and every row of the table, so that a run that is
cut short is not lost. Beds are never made while the clock runs: if one is missing the script says so and ends.

The field of 28 x 15 points of the baseline damper takes as long as all of this and has a run of its own."""

import argparse
import math
import os
import platform
import sys
import time
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
from gpu_batch import Batch, Scene, rate, rate_alone, rate_on_a_core, scene_of, threads
from gpu_ceilings import card_of
from gpu_contacts import TOLERANCE, worst_of
from gpu_field import run_field
from gpu_points import check_points, missing, prepare
from gpu_report import Clock, Report
from graindamp.dem.energy import energies
from graindamp.dem.engine import run, start
from graindamp.dem.excitation import motion_of
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
    ledger: int
    """Of the ledger [-]; a cycle has 50 000."""
    core_work: float
    """Of one timing of a processor core [particle-steps]."""
    total: float
    """After which no further part begins [s]."""


REAL_LIMITS = Limits((1, 16, 132, 264, 420), (150, 500, 4500), 2.0, 300, 100_000, 2e6, 440.0)
REHEARSAL = Limits((1, 2), (2, 4), 0.05, 40, 100, 2e3, 200.0)
BUDGET = {
    "contacts": 160.0,
    "trajectories": 40.0,
    "ledger": 30.0,
    "rates": 75.0,
    "field": 60.0,
    "baseline": 110.0,
    "one_world": 45.0,
    "dem_engine": 45.0,
    "variants": 120.0,
}
"""Most time of each part [s], in the order in which they run; the first and the baseline hold the compilation of three
variants, a minute each. What takes less leaves more to the last, which are the least needed."""
TIMINGS = ("rates", "one_world", "dem_engine", "variants")
"""Parts that may be left out, and are then named; all others are checks, which fail if they are."""


def check_contacts(report: Report, every: bool, found: dict[str, Any]) -> None:
    """Single contacts, every precision, against the processor; `every`: also with springs."""
    cases = [(precision, False) for precision in ("double", "mixed")] + [("mixed", True)] * every
    for precision, springs in cases:
        for name, worst in worst_of(precision, springs).items():
            words = f"{name}, {precision}{', springs' if springs else ''}"
            found[words] = worst["off"]
            report.demand(worst["change"] > 0.1, f"{words}: there was no impact")
            report.demand(worst["off"] < TOLERANCE[precision], f"{words}: off by {worst['off']:.1e}")


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


def check_ledger(scene: Scene, limits: Limits, clock: Clock, report: Report, found: dict[str, Any]) -> None:
    """The energy ledger in mixed precision over whole cycles, worlds at all phases. In the simulator: over a few
    steps."""
    from graindamp.dem.gpu.columns import N_ROW, ROW
    from graindamp.dem.gpu.outcome import energies_of

    n_step, piece = limits.ledger, max(limits.ledger // 20, 1)
    batch = Batch(scene, min(rates.PHASES, 8 if n_step > 1000 else 2), "mixed", threads(), n_step)
    done = 0
    while done < n_step and clock.left > 0.0:
        batch.go(piece)
        done += piece
    rows = batch.memory.read("slots", "rows").reshape(batch.worlds, -1, N_ROW)
    complete = bool(np.all(batch.memory.read("slots", "counts")[:, ROW] == 2))
    found["cycles"] = n_step * rates.TIME_STEP * rates.FREQUENCY
    report.demand(complete, f"ledger: only {done} of {n_step} steps were done in time")
    if complete:
        pairs = [(energies_of(row[0]), energies_of(row[1])) for row in rows]
        found["errors"] = [
            abs(last.stored - first.stored + last.lost - last.work) / max(last.lost, 1e-3 * last.stored)
            for first, last in pairs
        ]
        worst = max(found["errors"])
        report.demand(worst < CLOSURE, f"ledger, mixed, {found['cycles']:.3g} cycles: open by {worst:.1e}")


def time_one_world(scene: Scene, limits: Limits, clock: Clock, report: Report, found: dict[str, Any]) -> None:
    """One world alone, a block or a team of blocks, against one core of the processor on the same bed, both as the mean
    over the phases of a cycle."""
    found["one core"] = rate_on_a_core(scene, limits.core_work)
    print(f"  one core: {found['one core']:.3e}", flush=True)
    tiny, best = len(scene.states[0].bed.radius) < 10, 0.0
    for team in (1,) if tiny else (1, 16, 64):
        name = f"{team} blocks" if team > 1 else "one block"
        if clock.left < 6.0 * limits.seconds:
            report.leave_out(f"one world, {name}")
            continue
        found[name] = rate_alone(scene, limits.seconds / rates.PHASES, team=team)
        print(f"  {name}: {found[name]:.3e}", flush=True)
        if found[name] > best:
            best, found["best"], found["ratio"] = found[name], name, found[name] / found["one core"]
        report.save()


def time_variants(
    scene: Scene, limits: Limits, every: bool, clock: Clock, report: Report, found: dict[str, Any]
) -> None:
    """Threads, registers, blocks per world and arithmetic of the kernel; `every`: also those that are unlikely to win,
    each of which costs a minute of compilation."""
    many, tiny = limits.worlds[-1], len(scene.states[0].bed.radius) < 10

    def measured(name: str, worlds: int, precision: str, threads: int, **options: Any) -> None:
        if clock.left < 4.0 * limits.seconds:
            report.leave_out(name)
            return
        if tiny:  # the simulator's threads are slow, and its blocks run one after the other
            threads, options["limit"], options["team"] = 4, 4, 1
        batch = Batch(scene, worlds, precision, threads, 10**7, **options)
        found[name] = rate(batch, limits.seconds)
        print(f"  {name}: {found[name]:.3e}", flush=True)
        report.save()

    measured(f"{many} worlds, 512 threads", many, "mixed", 512)
    measured(f"{many} worlds, 256 threads", many, "mixed", 256, limit=512)
    measured(f"{many} worlds, double", many, "double", 512)
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
                report.leave_out(f"{worlds} worlds of {n}")
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
        report.leave_out(f"DEM-Engine: {found['not measured']}")
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
    parser.add_argument("--field", action="store_true", help="the field of 28 x 15 points alone, under 10 minutes")
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
    if not arguments.rehearse:
        stop_if_missing(arguments.data, limits)
    if arguments.field:
        report = Report(arguments.out, "gpu_field_rehearsal" if arguments.rehearse else "gpu_field", about())
        check_whole_field(arguments, report)
        print(report.page())
        sys.exit(1 if report.failed or not report.held else 0)
    clock = Clock(limits.total)
    report = Report(arguments.out, "gpu_rehearsal" if arguments.rehearse else "gpu_check", about())
    report.told["card"] = card(report.told["about"]["card"]) or {}
    report.leave_out("the field of 28 x 15 points, which is measured alone with --field")
    engine = deme_of(arguments, limits)
    try:
        check(arguments, limits, clock, report, engine)
    finally:
        engine.end()
    print(report.page())
    sys.exit(1 if report.failed or not report.held else 0)


def stop_if_missing(data: Path, limits: Limits) -> None:
    """End with one message if a bed, or answers of the processor, would have to be made first."""
    absent = [f"bed of {n}" for n in limits.particles if not rates.bed_path(n, 6, data).exists()] + missing(data)
    if absent:
        sys.exit(
            f"{data} lacks: {'; '.join(absent)}. Make what is missing with --prepare (answers of the baseline damper: "
            "--prepare --baseline), here or on another machine, whose folder may be copied"
        )


def card(name: str) -> dict[str, Any] | None:
    """What the card can do at most, as a table; in a rehearsal, what an H200 can."""
    if os.environ.get("NUMBA_ENABLE_CUDASIM") == "1":
        found = card_of(None, "H200")
    else:
        import numba.cuda

        device: Any = numba.cuda
        found = card_of(device.get_current_device(), name)
    return None if found is None else found._asdict()


def check(arguments: argparse.Namespace, limits: Limits, clock: Clock, report: Report, engine: DemEngine) -> None:
    """All parts, one after the other."""
    data, rehearse = arguments.data, arguments.rehearse
    middle, largest = limits.particles[len(limits.particles) // 2], limits.particles[-1]
    rest = (clock, report)

    def scene(n: int) -> Scene:
        return scene_of(n, data, rehearse)

    parts: dict[str, Callable[[dict[str, Any]], None]] = {
        "contacts": lambda found: check_contacts(report, arguments.every, found),
        "trajectories": lambda found: check_trajectories(scene(middle), limits, report, found),
        "ledger": lambda found: check_ledger(scene(middle), limits, *rest, found),
        "rates": lambda found: time_table(data, limits, rehearse, *rest, found),
        "field": lambda found: check_points("field", data, rehearse, *rest, found),
        "baseline": lambda found: check_points("baseline", data, rehearse, *rest, found),
        "one_world": lambda found: time_one_world(scene(largest), limits, *rest, found),
        "dem_engine": lambda found: compare_deme(engine, scene(largest), limits, *rest, found),
        "variants": lambda found: time_variants(scene(largest), limits, arguments.every, *rest, found),
    }
    for name, seconds in BUDGET.items():
        clock.part(seconds)
        if clock.left <= 0.0:
            if name in TIMINGS:
                report.leave_out(f"{name}: no time left")
            else:
                report.demand(False, f"{name}: no time left")
            continue
        part(name, clock.spent, report, parts[name])
        report.told["seconds"] = clock.spent
        report.save()


def part(name: str, spent: float, report: Report, does: Callable[[dict[str, Any]], None]) -> None:
    """One part, whose failure must not cost the others their machine time."""
    print(f"{name} ({spent:.0f} s)", flush=True)
    found: dict[str, Any] = {}
    report.told[name] = found
    try:
        does(found)
    except Exception as error:
        report.demand(False, f"{name}: {type(error).__name__}: {error}")


def check_whole_field(arguments: argparse.Namespace, report: Report) -> None:
    """The field alone, which takes as long as all other parts together."""
    begin = time.perf_counter()
    part(
        "whole_field", 0.0, report,
        lambda found: run_field(arguments.data, arguments.out, arguments.rehearse, report, found),
    )  # fmt: skip
    report.told["seconds"] = time.perf_counter() - begin
    report.save()


if __name__ == "__main__":
    main()
