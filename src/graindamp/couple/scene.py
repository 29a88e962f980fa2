"""Cases made ready to run: beds, worlds and the oscillators that carry them."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from graindamp.couple.cases import (
    Carried,
    Case,
    Force,
    HarmonicForce,
    SampledForce,
    bare_speed,
    sag_of,
    weight_of,
)
from graindamp.dem.container import enclosure_of
from graindamp.dem.interactions import Interactions, interactions_of
from graindamp.dem.oscillators import (
    FORCE_AMPLITUDE,
    FORCE_COUNT,
    FORCE_DURATION,
    FORCE_HARMONIC,
    FORCE_LOGARITHMIC,
    FORCE_OMEGA,
    FORCE_OMEGA_LAST,
    FORCE_PHASE,
    FORCE_RAMP,
    FORCE_SERIES,
    FORCE_SWEEP,
    Oscillators,
    empty_oscillators,
)
from graindamp.dem.packing import PHYSICS, pack
from graindamp.dem.packing_store import Packing, Progress
from graindamp.dem.simulate import SKIN_STEPS
from graindamp.dem.state import Worlds
from graindamp.dem.timestep import shortest_contact
from graindamp.dem.turned import turned
from graindamp.dem.world import Bed, world_of
from graindamp.structure.modal import point_index

STEPS_PER_RADIAN = 50.0
"""Time steps per radian of the highest mode [-]: its frequency is then right to 2e-5."""


class Scene(NamedTuple):
    """A case made ready."""

    case: Case
    packings: tuple[Packing, ...]
    bed_mass: tuple[float, ...]
    contact_at_one: float
    """Shortest contact at a speed of 1 m/s [s]."""
    is_hertzian: bool
    """Whether contacts shorten with speed."""
    time_step: float
    stride: int
    n_step: int
    n_sample: int
    worlds: tuple[Worlds, ...]


class _Filled(NamedTuple):
    """A damper with its bed."""

    carried: Carried
    packing: Packing
    interactions: Interactions
    bed: Bed
    speed: float
    """Impact speed that the run is prepared for [m/s]."""

    @property
    def mass(self) -> float:
        """Of the bed [kg]."""
        density = self.interactions.density[self.bed.material]
        return float((density * 4.0 / 3.0 * math.pi * self.bed.radius**3).sum())

    def shortest(self, speed: float) -> float:
        """Duration of the shortest contact at an impact speed [m/s], in [s]."""
        return shortest_contact(self.interactions, self.bed.radius, self.bed.material, speed)


def scene_of(
    case: Case, folder: Path | None = None, cache: Path | None = None, progress: Progress | None = None
) -> Scene:
    """Pack the beds of a case, or take them from the cache, and make their worlds.

    Args:
        case: a case that was checked.
        folder: what files in the descriptions of dampers are relative to; None: the working folder.
        cache: folder of stored packings; None: that of the user.
        progress: told how far packing is.

    Raises:
        InputError: a bed does not fit, or a file cannot be used.
    """
    filled = [_filled(case, carried, folder, cache, progress) for carried in case.dampers]
    time_step, stride, n_sample = _steps(case, min(one.shortest(one.speed) for one in filled))
    return Scene(
        case,
        tuple(one.packing for one in filled),
        tuple(one.mass for one in filled),
        min(one.shortest(1.0) for one in filled),
        any(carried.damper.contact.law != "linear" for carried in case.dampers),
        time_step,
        stride,
        n_sample * stride,
        n_sample,
        tuple(_world(one, time_step, stride, n_sample, folder) for one in filled),
    )


def _filled(
    case: Case, carried: Carried, folder: Path | None, cache: Path | None, progress: Progress | None
) -> _Filled:
    damper, packing = carried.damper, carried.packing
    if packing is None:
        packing = pack(damper, folder=folder, cache=cache, progress=progress)
        packing = turned(damper, packing, physics=PHYSICS, folder=folder, cache=cache, progress=progress)
    interactions = interactions_of(damper)
    material = np.asarray(interactions.component, np.int32)[packing.component]
    fall = math.sqrt(8.0 * float(np.linalg.norm(damper.gravity)) * float(packing.radius.max()))
    speed = 2.0 * bare_speed(case, point_index(case.model, carried.point)) + fall + 0.02
    bed = Bed.at_rest(np.ascontiguousarray(packing.position), packing.radius, material)
    return _Filled(carried, packing, interactions, bed, speed)


def _steps(case: Case, contact: float) -> tuple[float, int, int]:
    """Time step [s], steps per sample and samples of a run whose shortest contact is given [s]."""
    highest = float(case.model.omega.max())
    longest = case.time_step or contact / case.steps_per_contact
    if highest > 0.0:
        longest = min(longest, 1.0 / (STEPS_PER_RADIAN * highest))
    rate = case.sample_rate or max(40.0 * highest / (2.0 * math.pi), 1e3)
    stride = max(math.ceil(1.0 / rate / longest - 1e-9), 1)
    return 1.0 / rate / stride, stride, max(round(case.duration * rate), 1)


def _world(one: _Filled, time_step: float, stride: int, n_sample: int, folder: Path | None) -> Worlds:
    damper, smallest = one.carried.damper, float(one.bed.radius.min())
    return world_of(
        one.bed,
        enclosure_of(damper, one.interactions, lid_height=one.packing.lid_height, folder=folder),
        one.interactions,
        damper.gravity,
        time_step,
        n_sample=n_sample,
        stride=stride,
        skin=min(max(SKIN_STEPS * one.speed * time_step, 0.04 * smallest), 0.25 * smallest),
    )


def oscillators_of(scenes: Sequence[Scene]) -> Oscillators:
    """The structures of all scenes, their worlds numbered one after the other."""
    n_force = max(len(scene.case.forces) for scene in scenes) + 1
    n_mode = max(len(scene.case.model.omega) for scene in scenes)
    series = [force.samples for scene in scenes for force in scene.case.forces if isinstance(force, SampledForce)]
    made = empty_oscillators(
        len(scenes),
        sum(len(scene.worlds) for scene in scenes),
        n_mode,
        n_force,
        max((len(samples) for samples in series), default=0) + 1,
        max(scene.n_sample for scene in scenes) + 1,
    )
    first = 0
    for s, scene in enumerate(scenes):
        case, model = scene.case, scene.case.model
        n = len(model.omega)
        made.first[s], made.n_world[s], made.n_mode[s] = first, len(scene.worlds), n
        made.stiffness[s, :n], made.damping[s, :n] = model.omega**2, model.damping
        made.coordinate[s, :n] = sag_of(case, scene.bed_mass) + (0.0 if case.q is None else case.q)
        made.speed[s, :n] = 0.0 if case.v is None else case.v
        for number, carried in enumerate(case.dampers):
            _hang(made, first + number, carried, case)
        for number, force in enumerate(case.forces):
            _push(made, s, number, force)
            made.participation[s, number, :n] = model.shape[point_index(model, force.point)]
        # What holds a free structure up holds the weight of its beds: a constant force on its rigid-body modes.
        made.force[s, n_force - 1, [FORCE_AMPLITUDE, FORCE_PHASE]] = 1.0, 0.5 * math.pi
        rigid = model.omega == 0.0
        made.participation[s, n_force - 1, :n] = np.where(rigid, -weight_of(case, scene.bed_mass), 0.0)
        first += len(scene.worlds)
    return made


def _hang(made: Oscillators, w: int, carried: Carried, case: Case) -> None:
    """Fix the container of world w to the structure."""
    row, n = point_index(case.model, carried.point), len(case.model.omega)
    made.shape[w, :n] = np.outer(case.model.shape[row], carried.direction)
    made.pivot[w] = carried.pivot
    if carried.along is not None:
        made.turns[w] = 1
        made.slope[w, :n] = case.model.slope[row]
        made.axis[w] = np.cross(carried.along, carried.direction)


def _push(made: Oscillators, s: int, number: int, force: Force) -> None:
    """Write an external force into the table of structure s."""
    row = made.force[s, number]
    if isinstance(force, SampledForce):
        made.force_kind[s, number] = FORCE_SERIES
        row[FORCE_DURATION], row[FORCE_COUNT] = 1.0 / force.rate, len(force.samples)
        made.force_series[s, number, : len(force.samples)] = force.samples
        return
    row[FORCE_AMPLITUDE], row[FORCE_RAMP] = force.amplitude, force.soft_start
    if isinstance(force, HarmonicForce):
        made.force_kind[s, number] = FORCE_HARMONIC
        row[FORCE_OMEGA], row[FORCE_PHASE] = 2.0 * math.pi * force.frequency, force.phase
        return
    made.force_kind[s, number] = FORCE_SWEEP
    row[FORCE_DURATION] = force.duration
    row[FORCE_OMEGA], row[FORCE_OMEGA_LAST] = 2.0 * math.pi * force.start, 2.0 * math.pi * force.stop
    row[FORCE_LOGARITHMIC] = float(force.law == "log" and force.start != force.stop)
