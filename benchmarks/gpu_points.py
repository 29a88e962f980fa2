"""Operating points on a GPU against the processor's answers, and how those are made."""

import csv
import math
import time
from pathlib import Path
from typing import Any

import numpy as np

from gpu_report import Clock, OutOfTime, Report
from graindamp.dem.packing import pack
from graindamp.dem.simulate import simulate
from graindamp.signals.simulated import ratios_of
from graindamp.signals.stopping import Stopping, estimate
from graindamp.spec.field import FieldSpec
from graindamp.spec.model import load_spec, parse_spec
from graindamp.spec.simulation import SimulationSpec
from graindamp.status import Status

EXAMPLES = Path(__file__).parent.parent / "examples"
FIELD = [(f, gamma) for f in (40.0, 80.0, 150.0, 300.0, 600.0, 1000.0) for gamma in (1.0, 3.0, 10.0, 30.0)]
BASELINE = [(100.0, 40.0), (60.0, 10.0), (250.0, 20.0), (500.0, 5.0)]


def drop(restitution: float) -> SimulationSpec:
    """A ball that meets the end of a box once."""
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


def ball() -> Any:
    """Its bed."""
    from graindamp.dem.packing_store import Packing

    place = np.array([[1.02e-3, 5e-3, 5e-3]])
    nan = math.nan
    return Packing(place, np.array([1e-3]), np.zeros(1, np.int32), nan, nan, nan, nan, None, None, 0, 0.0)


def points_of(which: str, rehearse: bool) -> list[SimulationSpec]:
    """Operating points that are compared with the processor."""
    if rehearse:
        return [drop(0.5), drop(0.8)]
    if which == "field":
        field = load_spec(EXAMPLES / "small-damper-field.toml", FieldSpec)
        return [field.at(f, gamma) for f, gamma in FIELD]
    spec = load_spec(EXAMPLES / "baseline-damper.toml", SimulationSpec)
    return [
        spec.model_copy(update={"motion": spec.motion.model_copy(update={"frequency": f, "intensity": gamma})})
        for f, gamma in BASELINE
    ]


SPREAD = 0.05
"""Over the larger of eta and 0.05: by how much runs of the same bed differ beyond the standard errors that they see in
themselves [-]; eta wanders by 5 to 10 % over 50 to 100 cycles (results/stopping_rule.md)."""


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
    return ball() if rehearse else pack(spec.damper, folder=EXAMPLES, cache=data)


def check_points(which: str, data: Path, rehearse: bool, clock: Clock, report: Report, found: dict[str, Any]) -> None:
    """Loss factor and effective mass of operating points within combined standard errors of the processor's."""
    from graindamp.dem.gpu.batch import Task, simulate_batch

    specs = points_of(which, rehearse)
    path = data / f"{which}.csv"
    if not rehearse and not path.exists():
        found["skipped"] = f"{path.name} is missing; make it with --prepare, that of the baseline with --baseline"
        return
    tasks = [Task(spec, packing_for(spec, data, rehearse)) for spec in specs]
    if rehearse:
        known = [value_of(simulate(task.spec, packing=task.packing)) for task in tasks]
    else:
        known = _read(path)
        tasks, found["unknown"] = tasks[: len(known)], len(tasks) - len(known)
    masses = [mass_of(task.spec, task.packing) for task in tasks]
    begin, steps, rows = time.perf_counter(), 0, []
    runs = simulate_batch(
        tasks, enough=lambda k: Rule(specs[k], masses[k]), progress=lambda finished, work: clock.check()
    )
    try:
        for number, run_ in runs:
            rows.append(_compared(number, value_of(run_), known[number]))
            steps += run_.n_step * len(run_.mass)
    except OutOfTime:
        left_out = sorted(set(range(len(tasks))) - {int(row[0]) for row in rows})
        found["left_out"] = f"points {left_out}: no time left"
    rows.sort()
    found |= {"seconds": time.perf_counter() - begin, "particle_steps": steps, "rows": rows}
    found["chi_square"] = [sum(row[-2] ** 2 for row in rows), sum(row[-1] ** 2 for row in rows)]
    worst = max((abs(z) for row in rows for z in row[-2:]), default=0.0)
    report.demand(worst < 4.0, f"{which}: a value is {worst:.1f} standard errors off")
    for name, column in (("eta", -2), ("m'", -1)):
        mean = sum(row[column] for row in rows) / max(len(rows), 1)
        limit = 4.0 / math.sqrt(max(len(rows), 1))
        report.demand(
            abs(mean) < limit, f"{which}: {name} is {mean:+.2f} standard errors off in the mean of all points"
        )


def _compared(number: int, value: list[float], reference: list[float]) -> list[float]:
    """A row: number, value, reference, and how many standard errors eta and m' are apart."""
    spread = SPREAD * max(abs(reference[0]), 0.05)
    z = [
        (value[k] - reference[k]) / math.sqrt(value[k + 1] ** 2 + reference[k + 1] ** 2 + 2.0 * spread**2)
        for k in (0, 2)
    ]
    return [float(number), *value, *reference, *z]


def mass_of(spec: SimulationSpec, packing: Any) -> float:
    """Mass of a bed of one material [kg]."""
    density = spec.damper.particles[0].density
    return float(np.sum(density * 4.0 / 3.0 * np.pi * packing.radius**3))


def _read(path: Path) -> list[list[float]]:
    with path.open(encoding="utf-8") as file:
        return [[float(x) for x in row[2:]] for row in list(csv.reader(file))[1:]]


def prepare(which: str, data: Path, only_bed: bool = False) -> None:
    """The bed, and the processor's answers with their standard errors, those that are not there yet; a line each as it
    is known."""
    path = data / f"{which}.csv"
    specs = points_of(which, False)
    packing_for(specs[0], data, False)
    print(f"bed of {which} is ready", flush=True)
    if only_bed:
        return
    known = len(_read(path)) if path.exists() else 0
    with path.open("a", encoding="utf-8", newline="") as file:
        table = csv.writer(file)
        if not known:
            file.truncate(0)
            table.writerow(["frequency", "intensity", "eta", "eta_se", "mass_ratio", "mass_ratio_se", "cycles"])
        for spec in specs[known:]:
            packing = packing_for(spec, data, False)
            run_ = simulate(spec, packing=packing, enough=Rule(spec, mass_of(spec, packing)))
            if run_.status & int(Status.INTERRUPTED):
                raise KeyboardInterrupt
            motion: Any = spec.motion
            row = [motion.frequency, motion.intensity, *value_of(run_)]
            table.writerow(row)
            file.flush()
            print(*row, flush=True)
    print(f"{path} is complete", flush=True)
