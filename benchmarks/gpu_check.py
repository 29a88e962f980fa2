"""Is the GPU back end right, and how fast? Builds, checks and times all in one go, in under 8 minutes on an H200.

    python benchmarks/gpu_check.py --prepare --data FOLDER    once, on any machine: beds and the processor's answers
    python benchmarks/gpu_check.py --data FOLDER              on the machine with the GPU
    python benchmarks/gpu_check.py --rehearse                 tiny, in numba's simulator, without a GPU

Checks: restitution of one ball; short trajectories of 500 spheres against the processor in double precision; loss
factor and effective mass of 24 operating points and of the baseline damper against the processor within combined
standard errors; the energy ledger; a repeat, bit for bit. Times: particle-steps per second for variants of the kernel
and for numbers of worlds and particles. Worlds are taken at eight phases of their cycle, since speed depends on the
phase. After every part the results so far are written, so that a run that is cut short is not lost."""

import argparse
import csv
import json
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
from graindamp.dem.container import Enclosure, enclosure_of
from graindamp.dem.energy import energies
from graindamp.dem.engine import run, start
from graindamp.dem.excitation import motion_of
from graindamp.dem.interactions import Interactions, interactions_of
from graindamp.dem.packing import pack
from graindamp.dem.simulate import simulate
from graindamp.dem.world import Bed, world_of
from graindamp.signals.simulated import ratios_of
from graindamp.signals.stopping import Stopping, estimate
from graindamp.spec.field import FieldSpec
from graindamp.spec.model import load_spec, parse_spec
from graindamp.spec.simulation import DamperSpec, SimulationSpec

HERE = Path(__file__).parent
EXAMPLES = HERE.parent / "examples"
FIELD = [(f, gamma) for f in (40.0, 80.0, 150.0, 300.0, 600.0, 1000.0) for gamma in (1.0, 3.0, 10.0, 30.0)]
BASELINE = [(100.0, 40.0), (60.0, 10.0), (250.0, 20.0), (500.0, 5.0)]
CLOSURE = 5e-3
"""Largest error of the energy ledger over what was lost, in mixed precision [-]."""
DRIFT = {"double": 1e-8, "mixed": 2e-3}
"""Largest difference of the trajectories from the processor's after the short run, over the bed's mean speed or its
travel [-]; collisions magnify rounding."""


class Scene(NamedTuple):
    """A bed at eight phases of a cycle, and its surroundings."""

    damper: DamperSpec
    interactions: Interactions
    enclosure: Enclosure
    states: list[rates.State]


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
REHEARSAL = Limits((1, 2), (4,), 0.05, 40, 200.0)


def scene_of(n: int, data: Path, rehearse: bool) -> Scene:
    """The benchmark's bed of `n` spheres."""
    if rehearse:
        return _tiny(n)
    states, length, _ = rates.prepared(n, 6, data)
    damper = rates.spec_of(n).damper
    interactions = interactions_of(damper)
    return Scene(damper, interactions, enclosure_of(damper, interactions, lid_height=length), states)


def _tiny(n: int) -> Scene:
    told = rates.spec_of(n).model_dump()
    told["damper"]["container"] |= {"radius": 2.9e-3, "length": 8e-3, "axis": "x"}
    told["damper"]["lid"] = None
    damper = parse_spec(told, SimulationSpec, "rehearsal").damper
    interactions = interactions_of(damper)
    k = np.arange(n)
    place = np.column_stack([1.5e-3 + (k // 2) * 2.6e-3, np.where(k % 2, -1.3e-3, 1.3e-3), np.zeros(n)])
    rng = np.random.default_rng(1)
    bed = Bed(place, np.full(n, rates.RADIUS), np.zeros(n, np.int32), rng.normal(0, 0.3, (n, 3)), np.zeros((n, 3)))
    return Scene(damper, interactions, enclosure_of(damper, interactions), [rates.State(bed, 0.0)] * 8)


class Batch:
    """Worlds of one scene on the device, without a queue: what is timed."""

    def __init__(self, scene: Scene, worlds: int, precision: str, threads: int, n_step: int, **options: Any) -> None:
        """`worlds` worlds at the scene's phases in turn, to run for at most `n_step` steps."""
        from graindamp.dem.gpu.batch import PRECISION
        from graindamp.dem.gpu.columns import NEW, STAGE, TARGET
        from graindamp.dem.gpu.device import Variant
        from graindamp.dem.gpu.kernels import kernels_of
        from graindamp.dem.gpu.load import loaded
        from graindamp.dem.gpu.memory import Memory

        self.threads, self.worlds, self.n = threads, worlds, len(scene.states[0].bed.radius)
        loads = []
        for state in scene.states:
            motion = motion_of(rates.spec_of(self.n).motion, start=-state.time)
            given = (state.bed.velocity, state.bed.spin)
            loads.append(
                loaded(
                    state.bed,
                    scene.enclosure,
                    scene.interactions,
                    scene.damper.gravity,
                    rates.TIME_STEP,
                    motion,
                    0.05 * rates.RADIUS,
                    n_step,
                    n_step,
                    given=given,
                )
            )
        self.team = options.get("team", 1)
        room = loads[0].room(threads * self.team)._replace(slots=worlds)
        real = PRECISION[precision]
        limit = options.get("limit", threads)
        variant = Variant(real, limit, room.springs, room.rolling, self.team > 1, options.get("fast", False))
        self.kernels = kernels_of(variant)
        self.memory = Memory(room, real)
        for slot in range(worlds):
            world = loads[slot % len(loads)]
            self.memory.load(slot, world)
            self.kernels.clear[1, threads](self.memory.batch, slot)
            codes = world.arrays["slots"]["codes"].copy()
            codes[TARGET] = n_step
            self.memory.write("slots", "codes", slot, codes)
            counts = self.memory.read("slots", "counts", slot)
            counts[:] = 0
            counts[STAGE] = NEW
            self.memory.write("slots", "counts", slot, counts)
        self.order = loads[0].order

    def go(self, n_step: int) -> tuple[float, int]:
        """Advance all worlds; seconds, and particle-steps done."""
        from graindamp.dem.gpu.columns import STATUS, STEP

        before = self.memory.read("slots", "counts")[:, STEP].sum()
        begin = time.perf_counter()
        self.kernels.advance[self.worlds * self.team, self.threads](self.memory.batch, n_step)
        counts = self.memory.read("slots", "counts")
        seconds = time.perf_counter() - begin
        if counts[:, STATUS].any():
            raise RuntimeError(f"worlds stopped with status {set(counts[:, STATUS].tolist())}")
        return seconds, int(counts[:, STEP].sum() - before) * self.n


def rate(batch: Batch, seconds: float) -> float:
    """Particle-steps per second over about `seconds`, after a first launch that compiles and makes the lists."""
    spent, _ = batch.go(20)
    spent, _ = batch.go(20)
    chunk = max(int(20 * 0.2 * seconds / spent), 5)
    spent, _ = batch.go(chunk)
    n_step = max(int(chunk * seconds / spent), 5)
    spent, work = batch.go(n_step)
    return work / spent


def check_restitution(found: dict[str, Any]) -> None:
    """One ball on a plane, every precision, against the processor."""
    from graindamp.dem.gpu.batch import Task, simulate_batch

    for precision in ("double", "mixed"):
        tasks = [Task(spec, _ball()) for spec in (_drop(e) for e in (0.3, 0.6, 0.9))]
        worst = 0.0
        for number, run_ in simulate_batch(tasks, precision=precision):
            cpu = simulate(tasks[number].spec, packing=_ball())
            assert cpu.end is not None
            assert run_.end is not None
            worst = max(worst, abs(float(run_.end.velocity[0, 0] / cpu.end.velocity[0, 0]) - 1.0))
        found[precision] = worst
        _demand(worst < (1e-9 if precision == "double" else 1e-5), f"restitution, {precision}: off by {worst:.1e}")


def _drop(restitution: float) -> SimulationSpec:
    told = {
        "damper": {
            "gravity": [0.0, 0.0, 0.0],
            "particles": [{"material": "steel", "radius": 1e-3}],
            "fill": {"count": 1},
            "container": {"kind": "box", "size": [0.01, 0.01, 0.01], "material": "steel"},
            "contact": {"restitution": restitution, "friction": 0.0, "softening": 1e4},
        },
        "motion": {"kind": "harmonic", "frequency": 500.0, "intensity": 50.0, "direction": "x"},
        "run": {"cycles": 1, "settle": 1e-5},
    }
    return parse_spec(told, SimulationSpec, "drop")


def _ball() -> Any:
    from graindamp.dem.packing_store import Packing

    place = np.array([[1.02e-3, 5e-3, 5e-3]])
    nan = math.nan
    return Packing(place, np.array([1e-3]), np.zeros(1, np.int32), nan, nan, nan, nan, None, None, 0, 0.0)


def check_trajectories(scene: Scene, limits: Limits, found: dict[str, Any]) -> None:
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
            batch = Batch(scene, 3, precision, _threads(), n_step)
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
        _demand(off < DRIFT[precision], f"trajectories, {precision}: off by {off:.1e} of the way")
        _demand(closure < CLOSURE, f"ledger, {precision}: open by {closure:.1e}")
        _demand(found[precision]["repeats"], f"{precision}: a repeat differs")


def points_of(which: str, rehearse: bool) -> list[SimulationSpec]:
    """Operating points that are compared with the processor."""
    if rehearse:
        return [_drop(0.5), _drop(0.8)]
    if which == "field":
        field = load_spec(EXAMPLES / "small-damper-field.toml", FieldSpec)
        return [field.at(f, gamma) for f, gamma in FIELD]
    spec = load_spec(EXAMPLES / "baseline-damper.toml", SimulationSpec)
    return [
        spec.model_copy(update={"motion": spec.motion.model_copy(update={"frequency": f, "intensity": gamma})})
        for f, gamma in BASELINE
    ]


class Rule:
    """The stopping rule of fields for one operating point, as the batch asks it."""

    def __init__(self, spec: SimulationSpec, mass: float) -> None:
        """`mass` is that of the bed [kg]."""
        assert spec.base_frequency is not None
        self.stopping, self.omega, self.mass = Stopping(0.02, 0.05, 12), 2.0 * math.pi * spec.base_frequency, mass

    @property
    def next_look(self) -> int:
        """Cycles before which it need not be asked."""
        return self.stopping.next_look

    def __call__(self, cycles: Any) -> bool:
        """Whether the run may end."""
        values = ratios_of(cycles.force, cycles.velocity, self.omega, self.mass)
        return self.stopping.enough(values.loss_factor, values.effective_mass_ratio)


def value_of(run_: Any) -> list[float]:
    """eta, its standard error, m', its standard error, cycles."""
    cycles = ratios_of(run_.cycle_force, run_.cycle_velocity, 2.0 * math.pi * run_.frequency, run_.bed_mass)
    if len(cycles.loss_factor) < 2:
        return [float(cycles.loss_factor[0]), 0.0, float(cycles.effective_mass_ratio[0]), 0.0, 1.0]
    e = estimate(cycles.loss_factor, cycles.effective_mass_ratio)
    return [e.loss_factor, e.loss_factor_se, e.effective_mass_ratio, e.effective_mass_ratio_se, float(e.n_cycle)]


def packing_for(spec: SimulationSpec, data: Path, rehearse: bool) -> Any:
    """The bed of an operating point; stored in `data`."""
    return _ball() if rehearse else pack(spec.damper, folder=EXAMPLES, cache=data)


def check_points(which: str, data: Path, rehearse: bool, found: dict[str, Any]) -> None:
    """Loss factor and effective mass of operating points within combined standard errors of the processor's."""
    from graindamp.dem.gpu.batch import Task, simulate_batch

    specs = points_of(which, rehearse)
    path = data / f"{which}.csv"
    if not rehearse and not path.exists():
        found["skipped"] = f"{path.name} is missing; make it with --prepare"
        return
    tasks = [Task(spec, packing_for(spec, data, rehearse)) for spec in specs]
    known = [value_of(simulate(task.spec, packing=task.packing)) for task in tasks] if rehearse else _read(path)
    masses = [_mass(task.spec, task.packing) for task in tasks]
    begin, steps, rows = time.perf_counter(), 0, []
    for number, run_ in simulate_batch(tasks, enough=lambda k: Rule(specs[k], masses[k])):
        value = value_of(run_)
        reference = known[number]
        z = [
            (value[k] - reference[k]) / math.sqrt(value[k + 1] ** 2 + reference[k + 1] ** 2 + 1e-4 * reference[k] ** 2)
            for k in (0, 2)
        ]
        rows.append([number, *value, *reference, *z])
        steps += run_.n_step * len(run_.mass)
    rows.sort()
    found["seconds"] = time.perf_counter() - begin
    found["particle_steps"] = steps
    found["rows"] = rows
    found["chi_square"] = [sum(row[-2] ** 2 for row in rows), sum(row[-1] ** 2 for row in rows)]
    worst = max(abs(z) for row in rows for z in row[-2:])
    _demand(worst < 5.0, f"{which}: a value is {worst:.1f} standard errors off")


def _mass(spec: SimulationSpec, packing: Any) -> float:
    density = spec.damper.particles[0].density
    return float(np.sum(density * 4.0 / 3.0 * np.pi * packing.radius**3))


def _read(path: Path) -> list[list[float]]:
    with path.open(encoding="utf-8") as file:
        return [[float(x) for x in row[2:]] for row in list(csv.reader(file))[1:]]


def time_variants(scene: Scene, limits: Limits, every: bool, found: dict[str, Any]) -> None:
    """Threads, registers, blocks per world and arithmetic of the kernel; `every`: also those that are unlikely to win,
    each of which costs a minute of compilation."""
    many, tiny = limits.worlds[-1], len(scene.states[0].bed.radius) < 10

    def measured(name: str, worlds: int, precision: str, threads: int, **options: Any) -> None:
        if tiny:  # the simulator's threads are slow, and its blocks run one after the other
            threads, options["limit"], options["team"] = 4, 4, 1
        batch = Batch(scene, worlds, precision, threads, 10**7, **options)
        found[name] = rate(batch, limits.seconds)
        print(f"  {name}: {found[name]:.3e}", flush=True)

    measured(f"{many} worlds, 512 threads", many, "mixed", 512)
    measured(f"{many} worlds, 256 threads", many, "mixed", 256, limit=512)
    measured("1 world, 512 threads", 1, "mixed", 512)
    for team in (4, 16, 64):
        measured(f"1 world, {team} blocks of 512 threads", 1, "mixed", 512, team=team)
    measured("16 worlds, 8 blocks of 512 threads", 16 if not tiny else 2, "mixed", 512, team=8)
    measured(f"{many} worlds, double", many, "double", 512)
    if every:
        measured(f"{many} worlds, 1024 threads", many, "mixed", 1024)
        measured(f"{many} worlds, 256 threads, registers of 256", many, "mixed", 256)
        measured(f"{many} worlds, 512 threads, fast", many, "mixed", 512, fast=True)


def time_table(data: Path, limits: Limits, rehearse: bool, left: Callable[[], float], found: dict[str, Any]) -> None:
    """Particle-steps per second for numbers of worlds and particles, and memory per particle [bytes]."""
    for n in limits.particles:
        scene = scene_of(n, data, rehearse)
        for worlds in limits.worlds:
            if left() < 4.0 * limits.seconds:
                found.setdefault("left_out", []).append(f"{worlds} x {n}")
                continue
            batch = Batch(scene, worlds, "mixed", _threads(), 10**7)
            value = rate(batch, limits.seconds)
            found[f"{worlds} x {n}"] = {"rate": value, "bytes_per_particle": batch.memory.bytes / (worlds * n)}
            print(f"  {worlds} worlds of {n}: {value:.3e}", flush=True)


def _threads() -> int:
    return 4 if os.environ.get("NUMBA_ENABLE_CUDASIM") == "1" else 512


def _demand(holds: bool, message: str) -> None:
    if not holds:
        FAILED.append(message)
        print(f"WRONG: {message}", flush=True)


FAILED: list[str] = []


def prepare(data: Path, baseline: bool) -> None:
    """Beds, and the processor's answers with their standard errors."""
    data.mkdir(parents=True, exist_ok=True)
    for n in REAL_LIMITS.particles:
        rates.prepared(n, 6, data)
        print(f"bed of {n} is ready", flush=True)
    for which in ("field", "baseline"):
        specs = points_of(which, False)
        packings = [packing_for(spec, data, False) for spec in specs]
        if which == "baseline" and not baseline:
            continue
        with (data / f"{which}.csv").open("w", encoding="utf-8", newline="") as file:
            table = csv.writer(file)
            table.writerow(["frequency", "intensity", "eta", "eta_se", "mass_ratio", "mass_ratio_se", "cycles"])
            for spec, packing in zip(specs, packings, strict=True):
                rule = Rule(spec, _mass(spec, packing))
                run_ = simulate(spec, packing=packing, enough=rule)
                motion: Any = spec.motion
                row = [motion.frequency, motion.intensity, *value_of(run_)]
                table.writerow(row)
                file.flush()
                print(*row, flush=True)


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


def page(told: dict[str, Any]) -> str:
    """The results as Markdown."""
    lines = [f"# GPU check, {told['about']['date']}", ""]
    lines += [", ".join(f"{k} {v}" for k, v in told["about"].items() if k != "date"), ""]
    lines += [f"Failed: {'; '.join(told['failed']) or 'nothing'}. Took {told['seconds']:.0f} s.", ""]
    for name, part in told.items():
        if name in ("about", "failed", "seconds"):
            continue
        lines += [f"## {name.replace('_', ' ')}", ""]
        for key, value in part.items():
            if key == "rows":
                lines += ["", "| point | eta | se | m' | se | cycles | eta CPU | se | m' CPU | se | cycles | z | z |"]
                lines += ["| --: " * 13 + "|"]
                lines += ["| " + " | ".join(f"{x:.4g}" for x in row) + " |" for row in value] + [""]
            else:
                lines.append(f"- {key}: {value if not isinstance(value, float) else f'{value:.4g}'}")
        lines.append("")
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--data", type=Path, default=HERE / "gpu_check_data", help="folder of beds and answers")
    parser.add_argument("--out", type=Path, default=HERE / "results", help="folder of the results")
    parser.add_argument("--prepare", action="store_true", help="make beds and answers on the processor")
    parser.add_argument("--baseline", action="store_true", help="with --prepare: the baseline damper too, half an hour")
    parser.add_argument(
        "--every", action="store_true", help="also time variants of the kernel that are unlikely to win"
    )
    parser.add_argument("--rehearse", action="store_true", help="tiny sizes in numba's simulator")
    arguments = parser.parse_args()
    if arguments.prepare:
        prepare(arguments.data, arguments.baseline)
        return
    limits = REHEARSAL if arguments.rehearse else REAL_LIMITS
    begin = time.perf_counter()
    told: dict[str, Any] = {"about": about(), "failed": FAILED, "seconds": 0.0}
    arguments.out.mkdir(parents=True, exist_ok=True)
    stem = "gpu_rehearsal" if arguments.rehearse else "gpu_check"

    def left() -> float:
        return limits.total - (time.perf_counter() - begin)

    middle = limits.particles[min(1, len(limits.particles) - 1)]
    largest = limits.particles[-1]
    data, rehearse = arguments.data, arguments.rehearse
    parts: list[tuple[str, Callable[[dict[str, Any]], None]]] = [
        ("restitution", check_restitution),
        ("trajectories", lambda found: check_trajectories(scene_of(middle, data, rehearse), limits, found)),
        ("variants", lambda found: time_variants(scene_of(largest, data, rehearse), limits, arguments.every, found)),
        ("field", lambda found: check_points("field", data, rehearse, found)),
        ("rates", lambda found: time_table(data, limits, rehearse, left, found)),
        ("baseline", lambda found: check_points("baseline", data, rehearse, found)),
    ]
    for name, part in parts:
        if left() < 0.0:
            _demand(False, f"{name}: no time left")
            continue
        print(f"{name} ({time.perf_counter() - begin:.0f} s)", flush=True)
        found: dict[str, Any] = {}
        told[name] = found
        try:
            part(found)
        except Exception as error:  # one part's failure must not cost the others their machine time
            _demand(False, f"{name}: {type(error).__name__}: {error}")
        told["seconds"] = time.perf_counter() - begin
        (arguments.out / f"{stem}.json").write_text(json.dumps(told, indent=1), encoding="utf-8")
        (arguments.out / f"{stem}.md").write_text(page(told), encoding="utf-8")
    print(page(told))
    sys.exit(1 if FAILED else 0)


if __name__ == "__main__":
    main()
