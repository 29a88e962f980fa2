"""One run of a damper, cycle by cycle, kept in a small file, so that what has been run is not run again."""

import hashlib
import json
import math
from functools import cache
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from graindamp.campaign.point import PHYSICS
from graindamp.dem.packing import pack
from graindamp.dem.packing_store import Packing
from graindamp.dem.run import Run
from graindamp.dem.simulate import simulate
from graindamp.field.theory import collect_and_collide, stroke_ratio_min
from graindamp.signals.simulated import bed_mass_of, cycle_values
from graindamp.signals.stopping import estimate
from graindamp.spec.field import FieldSpec
from graindamp.spec.simulation import SimulationSpec
from graindamp.units import STANDARD_GRAVITY

WINDOW = 5
"""Cycles that are averaged over where a bounce is said to be held or lost [-]."""


class Course(NamedTuple):
    """What a run was, and what came out of it."""

    label: str
    frequency: float
    """[Hz]"""
    intensity: float
    """Gamma [-]."""
    seed: int
    softening: float
    """Divisor of the stiffness [-]."""
    n_particle: int
    bed_mass: float
    """[kg]"""
    solid_fraction: float
    """Of the bed before the run [-]."""
    clearance: float
    """Nominal clearance h [m]."""
    bed_height: float
    """Length of the bed along the axis before the run [m]."""
    loss_factor: float
    """eta over the steady cycles [-]."""
    loss_factor_se: float
    """Its standard error [-]."""
    effective_mass_ratio: float
    """m' likewise [-]."""
    effective_mass_ratio_se: float
    is_steady: bool
    """False where eta or m' still drifts."""
    n_skipped: int
    """Cycles dropped before the steady ones [-]."""
    status: int
    """Status bits of the engine."""
    cycle_loss_factor: list[float]
    """eta of every cycle [-]."""
    cycle_mass_ratio: list[float]
    """m' of every cycle [-]."""
    cycle_travel: list[float]
    """Way of the bed's centre relative to the container in every cycle, from its lowest to its highest place [m]."""
    cycle_middle: list[float]
    """Mean place of the bed's centre in every cycle [m]."""
    largest_overlap: float
    """Over the radius [-]."""
    n_step: int
    seconds: float

    @property
    def stroke(self) -> float:
        """Displacement amplitude X of the container [m]."""
        return self.intensity * STANDARD_GRAVITY / (2.0 * math.pi * self.frequency) ** 2

    @property
    def stroke_ratio(self) -> float:
        """X over its nominal optimum h / pi [-]."""
        return math.pi * self.stroke / self.clearance

    @property
    def travel(self) -> float:
        """Way of the bed's centre from wall to wall, over the last ten cycles [m]."""
        return float(np.mean(self.cycle_travel[-10:]))

    @property
    def block(self) -> "Block | None":
        """The single body that answers like the bed in the last ten cycles."""
        return block_of(float(np.mean(self.cycle_loss_factor[-10:])), float(np.mean(self.cycle_mass_ratio[-10:])))

    @property
    def held(self) -> int:
        """Cycles until eta, averaged over WINDOW cycles, falls below half of its best; all where it does not [-]."""
        eta = np.convolve(self.cycle_loss_factor, np.full(WINDOW, 1.0 / WINDOW), "valid")
        below = np.flatnonzero(eta[int(np.argmax(eta)) :] < 0.5 * eta.max())
        return len(self.cycle_loss_factor) if not len(below) else int(np.argmax(eta)) + int(below[0]) + WINDOW // 2


def course(
    spec: FieldSpec,
    frequency: float,
    intensity: float,
    folder: Path,
    label: str,
    *,
    cycles: int,
    seed: int = 0,
    packing: Packing | None = None,
    soft_start: float = 0.0,
    before: tuple[float, int] | None = None,
) -> Course:
    """One run from rest, or what the file of an earlier one tells of it.

    Args:
        spec: the damper.
        frequency: [Hz].
        intensity: Gamma [-].
        folder: where courses are kept.
        label: begins the name of the file.
        cycles: number of cycles [-].
        seed: number of the bed [-].
        packing: the bed; None: that of the description.
        soft_start: cycles over which the motion grows [-].
        before: intensity and cycles of a run at the same frequency whose end this one starts from; None: rest.
    """
    whole = simulation_of(spec, frequency, intensity, cycles, seed, soft_start)
    told = {
        "simulation": whole.model_dump(mode="json", exclude={"title": True, "damper": {"name"}}),
        "lid": None if packing is None else [packing.lid_height, packing.height, float(packing.position.sum())],
        "before": before,
        "physics": PHYSICS,
    }
    key = hashlib.sha256(json.dumps(told, sort_keys=True).encode()).hexdigest()[:12]
    path = folder / f"{label}-{key}.json"
    if path.is_file():
        return Course(**json.loads(path.read_text(encoding="utf-8")))
    bed = pack(whole.damper) if packing is None else packing
    start = None
    if before is not None:
        earlier = simulation_of(spec, frequency, before[0], before[1], seed, soft_start)
        start = simulate(earlier, packing=bed).end
    found = _course_of(simulate(whole, packing=bed, start=start), label, frequency, intensity, seed)
    folder.mkdir(parents=True, exist_ok=True)
    draft = path.with_suffix(".part")
    draft.write_text(json.dumps(found._asdict()), encoding="utf-8")
    draft.replace(path)
    return found


def simulation_of(
    spec: FieldSpec, frequency: float, intensity: float, cycles: int, seed: int, soft_start: float = 0.0
) -> SimulationSpec:
    """Description of a run from rest; see :func:`course`."""
    part = spec.at(frequency, intensity, seed)
    motion = part.motion.model_copy(update={"soft_start": soft_start})
    return part.model_copy(update={"motion": motion, "run": part.run.model_copy(update={"cycles": float(cycles)})})


def _course_of(run: Run, label: str, frequency: float, intensity: float, seed: int) -> Course:
    each = cycle_values(run)
    found = estimate(each.loss_factor, each.effective_mass_ratio)
    cycle = np.clip((run.energy_time * frequency - 1e-6).astype(int), 0, len(each.loss_factor) - 1)
    centre = [run.centre[cycle == k, 0] for k in range(len(each.loss_factor))]
    assert run.packing.clearance is not None
    return Course(
        label=label,
        frequency=frequency,
        intensity=intensity,
        seed=seed,
        softening=run.spec.damper.contact.softening,
        n_particle=len(run.mass),
        bed_mass=bed_mass_of(run),
        solid_fraction=run.packing.solid_fraction,
        clearance=run.packing.clearance,
        bed_height=run.packing.height,
        loss_factor=found.loss_factor,
        loss_factor_se=found.loss_factor_se,
        effective_mass_ratio=found.effective_mass_ratio,
        effective_mass_ratio_se=found.effective_mass_ratio_se,
        is_steady=found.is_steady,
        n_skipped=found.n_skipped,
        status=run.status,
        cycle_loss_factor=[round(float(value), 6) for value in each.loss_factor],
        cycle_mass_ratio=[round(float(value), 6) for value in each.effective_mass_ratio],
        cycle_travel=[round(float(np.ptp(place)), 9) for place in centre],
        cycle_middle=[round(float(place.mean()), 9) for place in centre],
        largest_overlap=float(run.largest_overlap.max()),
        n_step=run.n_step,
        seconds=round(run.seconds, 2),
    )


class Block(NamedTuple):
    """A single body that is thrown from wall to wall, and answers like the bed."""

    stroke_ratio: float
    """X over h / pi, with h its free travel [-]."""
    restitution: float
    """Coefficient of restitution of body and wall [-]."""


@cache
def _blocks() -> tuple[list[Block], NDArray[np.float64]]:
    """Bodies, and loss factor and effective mass ratio of each; (body, 2)."""
    found, answers = [], []
    for restitution in np.arange(0.0, 0.5, 0.02):
        for ratio in np.arange(stroke_ratio_min(float(restitution)) + 0.002, 2.6, 0.01):
            point = collect_and_collide(float(ratio), float(restitution))
            if point.exists:
                found.append(Block(float(ratio), float(restitution)))
                answers.append((point.loss_factor, point.effective_mass_ratio))
    return found, np.array(answers)


def block_of(loss_factor: float, effective_mass_ratio: float) -> Block | None:
    """The body that answers with this eta and m'; None where none comes within 0.1, as of a bed that floats.

    m' tells the phase of the impacts: 0 where a body without restitution hits the wall at the container's greatest
    speed, negative where it comes later. With eta it tells what free travel and what restitution the bed seems to have;
    the table's spacing is 0.01 and 0.02.
    """
    blocks, answers = _blocks()
    far = np.hypot(*(answers - (loss_factor, effective_mass_ratio)).T)
    return blocks[int(np.argmin(far))] if far.min() < 0.1 else None
