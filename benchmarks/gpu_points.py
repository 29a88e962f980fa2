"""Operating points on a GPU against the processor's answers, and how those are made."""

import csv
import math
import time
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from gpu_contacts import balls, box
from gpu_report import Clock, OutOfTime, Report
from graindamp.dem.packing import PHYSICS, pack
from graindamp.dem.simulate import simulate
from graindamp.dem.turned import turned
from graindamp.signals.simulated import ratios_of
from graindamp.signals.stopping import Stopping, estimate
from graindamp.spec.field import FieldSpec
from graindamp.spec.model import load_spec
from graindamp.spec.simulation import SimulationSpec
from graindamp.status import FATAL, Status

EXAMPLES = Path(__file__).parent.parent / "examples"
FIELD = [(f, gamma) for f in (40.0, 80.0, 150.0, 300.0, 600.0, 1000.0) for gamma in (1.0, 3.0, 10.0, 30.0)]
BASELINE = [(100.0, 40.0), (60.0, 10.0), (250.0, 20.0), (500.0, 5.0)]


def points_of(which: str, rehearse: bool) -> list[SimulationSpec]:
    """Operating points that are compared with the processor."""
    if rehearse:
        return [box(1, 500.0, 50.0, restitution=e) for e in (0.5, 0.8)]
    if which == "field":
        field = load_spec(EXAMPLES / "small-damper-field.toml", FieldSpec)
        return [field.at(f, gamma) for f, gamma in FIELD]
    spec = load_spec(EXAMPLES / "baseline-damper.toml", SimulationSpec)
    return [
        spec.model_copy(update={"motion": spec.motion.model_copy(update={"frequency": f, "intensity": gamma})})
        for f, gamma in BASELINE
    ]


TEAM = 32
"""Blocks that share each of the few worlds of the baseline damper [-]."""
HURRY = 25.0
"""Time before the end of the part at which points end with the cycles that they have [s]."""
SPREAD = 0.05
"""Over the larger of eta and 0.05: by how much runs of the same bed differ beyond the standard errors that they see in
themselves [-]; eta wanders by 5 to 10 % over 50 to 100 cycles (results/stopping_rule.md)."""


def stopping() -> Stopping:
    """The stopping rule of fields, one that has not looked yet."""
    return Stopping(0.02, 0.05, 12)


class Rule:
    """The stopping rule of fields for one operating point, as the processor's engine asks it."""

    def __init__(self, spec: SimulationSpec, mass: float) -> None:
        """`mass` is that of the bed [kg]."""
        assert spec.base_frequency is not None
        self.stopping, self.omega, self.mass = stopping(), 2.0 * math.pi * spec.base_frequency, mass

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


class Missing(Exception):
    """A bed is not stored."""


def packing_for(spec: SimulationSpec, data: Path, rehearse: bool, make: bool = False) -> Any:
    """The bed of an operating point, at rest in its turned container, from the folder `data`; made now only if `make`.

    Raises:
        Missing: it is not there.
    """
    if rehearse:
        return balls([[1.02e-3, 5e-3, 5e-3]])

    def refuse(*_: Any) -> None:
        raise Missing

    progress = None if make else refuse
    packing = pack(spec.damper, folder=EXAMPLES, cache=data, progress=progress)
    turned(spec.damper, packing, physics=PHYSICS, folder=EXAMPLES, cache=data, progress=progress)
    return packing


def missing(data: Path) -> list[str]:
    """What is needed and not in the folder `data`: nothing of it is made while the clock runs."""
    found = []
    for which in ("field", "baseline"):
        if not (data / f"{which}.csv").exists():
            found.append(f"answers of the processor, {which}.csv")
        try:
            packing_for(points_of(which, False)[0], data, False)
        except Missing:
            found.append(f"bed of {which}")
    return found


def check_points(which: str, data: Path, rehearse: bool, clock: Clock, report: Report, found: dict[str, Any]) -> None:
    """Loss factor and effective mass of operating points within combined standard errors of the processor's. A point
    without a value, or without the processor's, is a check that does not hold."""
    from graindamp.dem.gpu.batch import Task, simulate_batch

    specs = points_of(which, rehearse)
    tasks = [Task(spec, packing_for(spec, data, rehearse)) for spec in specs]
    if rehearse:
        known = [value_of(simulate(task.spec, packing=task.packing)) for task in tasks]
    else:
        known = _read(data / f"{which}.csv")
    begin, steps, rows = time.perf_counter(), 0, []
    few = which == "baseline" and not rehearse
    runs = simulate_batch(
        tasks[: len(known)],
        stopping=lambda k: stopping(),
        hurry=lambda: clock.left < HURRY,
        progress=lambda finished, work: clock.check(),
        cache=data,
        slots=len(specs) if few else None,
        team=TEAM if few else 1,
    )
    with suppress(OutOfTime):
        for number, run_ in runs:
            report.demand(not run_.status & FATAL, f"{which}: point {number} ended with status {run_.status}")
            rows.append(_compared(number, value_of(run_), known[number]))
            steps += run_.n_step * len(run_.mass)
    rows.sort()
    seconds = time.perf_counter() - begin
    found |= {"seconds": seconds, "particle_steps": steps, "rate": steps / seconds, "rows": rows}
    left_out = sorted(set(range(len(specs))) - {int(row[0]) for row in rows})
    report.demand(not left_out, f"{which}: points {left_out} have no value, or none of the processor")
    found["chi_square"] = [sum(row[-2] ** 2 for row in rows), sum(row[-1] ** 2 for row in rows)]
    worst = max((abs(z) for row in rows for z in row[-2:]), default=math.inf)
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
    packing_for(specs[0], data, False, make=True)
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
            run_ = simulate(spec, packing=packing, cache=data, enough=Rule(spec, mass_of(spec, packing)))
            if run_.status & int(Status.INTERRUPTED):
                raise KeyboardInterrupt
            motion: Any = spec.motion
            row = [motion.frequency, motion.intensity, *value_of(run_)]
            table.writerow(row)
            file.flush()
            print(*row, flush=True)
    print(f"{path} is complete", flush=True)
