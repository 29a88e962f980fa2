"""Particles and structure simulated together: they exchange force and motion at every time step.

No effective field stands between them, so that transients, free decays and dampers that have not settled come out
right; the price is a simulation of the particles for every run.
"""

import math
import time as clock_of_the_wall
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from graindamp.couple.cases import (
    LOOKS,
    Carried,
    Case,
    Force,
    HarmonicForce,
    SampledForce,
    SweptForce,
    check,
    force_values,
    released,
    sag_of,
)
from graindamp.couple.scene import Scene, oscillators_of, scene_of
from graindamp.dem.carried import run_carried
from graindamp.dem.columns import LOWEST_SPEED
from graindamp.dem.energy import Energies, energies, velocity_now
from graindamp.dem.engine import together
from graindamp.dem.notes import FEW_STEPS, LARGE_OVERLAP
from graindamp.dem.oscillators import (
    ANGLE,
    DAMPED,
    FORCED,
    TURN_RATE,
    Oscillators,
)
from graindamp.dem.packing_store import Packing, Progress
from graindamp.dem.run import Snapshot
from graindamp.dem.state import Worlds
from graindamp.interrupt import deferred
from graindamp.status import Status
from graindamp.structure.modal import point_index

__all__ = [
    "Carried",
    "Case",
    "CoRun",
    "Force",
    "HarmonicForce",
    "SampledForce",
    "SweptForce",
    "cosimulate",
    "cosimulate_batch",
    "force_values",
    "released",
]

Real = NDArray[np.float64]

STEPS_PER_LOOK = 1000
"""Steps between two looks of a run that is not long enough for all of them [-]."""


class CoRun(NamedTuple):
    """A structure and its dampers over a time. Time 0 is the start."""

    case: Case
    packings: tuple[Packing, ...]
    """The bed of each damper."""
    bed_mass: tuple[float, ...]
    """Mass of each bed [kg]."""
    time: Real
    """Times of the samples [s]; (sample,)."""
    q: Real
    """Modal coordinates, measured from the equilibrium under the weight of the beds [m kg^1/2]; (sample, mode)."""
    v: Real
    """Modal velocities [m kg^1/2/s]; (sample, mode)."""
    force: Real
    """Force of the particles ON each container, means over the time up to the sample, in the damper's axes [N];
    (sample, damper, 3); the first, at the start, is NaN."""
    energy_time: Real
    """Times of the energies [s]; (look,)."""
    structure_energy: Real
    """Kinetic and elastic energy of the structure, from its equilibrium without beds [J]; (look,)."""
    damped: Real
    """Lost in the damping of the modes since the start [J]; (look,)."""
    forced: Real
    """Work of the external forces since the start [J]; (look,)."""
    energy: tuple[tuple[Energies, ...], ...]
    """Energies of each bed, in the frame at rest; (look, damper)."""
    snapshots: tuple[tuple[Snapshot, ...], ...]
    """All particles at some times, the last at the end; (time, damper)."""
    largest_overlap: Real
    """Over the smallest radius, between particles and with walls [-]; (damper, 2)."""
    largest_speed: float
    """Speed of the fastest impact [m/s]."""
    time_step: float
    """[s]"""
    n_step: int
    """Steps done [-]."""
    seconds: float
    """Time that the run took to compute, alone or with the others of its batch [s]."""
    status: int
    """Status bits, see :class:`graindamp.status.Status`."""

    def displacement(self, point: str) -> Real:
        """Of a point of the structure from its equilibrium [m]; (sample,)."""
        return np.asarray(self.q @ self.case.model.shape[point_index(self.case.model, point)])

    def velocity(self, point: str) -> Real:
        """Of a point of the structure [m/s]; (sample,)."""
        return np.asarray(self.v @ self.case.model.shape[point_index(self.case.model, point)])

    @property
    def throughput(self) -> float:
        """Energy that passed between structure and particles, or was in the structure at most [J]."""
        exchanged = sum(abs(bed.work) + bed.lost for bed in self.energy[-1])
        return max(exchanged, float(self.structure_energy.max()), float(np.abs(self.forced).max()))

    @property
    def residual(self) -> Real:
        """What does not close of the energy of structure, particles and all that was lost, over the throughput [-];
        (look,)."""
        held = np.array([sum(bed.stored + bed.lost for bed in beds) for beds in self.energy])
        whole = self.structure_energy + self.damped - self.forced + held
        return np.asarray((whole - whole[0]) / self.throughput)


def cosimulate(
    case: Case, *, folder: Path | None = None, cache: Path | None = None, progress: Progress | None = None
) -> CoRun:
    """Simulate a structure and the particles in its dampers together.

    Ctrl-C ends the run early: what there is so far comes back with `Status.INTERRUPTED`.

    Args:
        case: structure, dampers, start and forces.
        folder: what files in the descriptions of dampers are relative to; None: the working folder.
        cache: folder of stored packings; None: that of the user.
        progress: called with stage, fraction done and seconds left, or None where these are not known yet.

    Raises:
        InputError: numbers out of range, no such point, a bed that does not fit, a free structure whose beds hang along
            a rigid-body mode.
    """
    return cosimulate_batch([case], folder=folder, cache=cache, progress=progress)[0]


def cosimulate_batch(
    cases: Sequence[Case],
    *,
    n_thread: int = 1,
    folder: Path | None = None,
    cache: Path | None = None,
    progress: Progress | None = None,
) -> list[CoRun]:
    """Simulate several cases side by side, as one batch; arguments and errors as :func:`cosimulate`.

    Each case has its own time step, duration, structure and dampers; the same case gives the same numbers alone and in
    any batch.

    Args:
        cases: one or more.
        n_thread: processor cores to use; a structure stays on one core.
        folder: see :func:`cosimulate`.
        cache: see :func:`cosimulate`.
        progress: see :func:`cosimulate`.
    """
    for case in cases:
        check(case)
    scenes = [scene_of(case, folder, cache, progress) for case in cases]
    worlds = together([world for scene in scenes for world in scene.worlds])
    oscillators = oscillators_of(scenes)
    targets = np.array([scene.n_step for scene in scenes], np.int64)
    n_look = min(max(int(targets.min()) // STEPS_PER_LOOK, 40, *(case.snapshots for case in cases)), LOOKS)
    worlds = run_carried(oscillators, worlds, np.zeros_like(targets), n_thread)
    begin = clock_of_the_wall.perf_counter()
    looks = [[_look(scene, s, oscillators, worlds)] for s, scene in enumerate(scenes)]
    look = 0
    with deferred() as interruption:
        try:
            while look < n_look and not interruption.asked:
                look += 1
                worlds = run_carried(oscillators, worlds, targets * look // n_look, n_thread)
                for s, scene in enumerate(scenes):
                    looks[s].append(_look(scene, s, oscillators, worlds, is_due(scene.case.snapshots, look, n_look)))
                if progress is not None:
                    spent = clock_of_the_wall.perf_counter() - begin
                    progress("swinging", look / n_look, spent * (n_look / look - 1.0))
                if not np.isfinite(oscillators.coordinate).all():
                    break
        except KeyboardInterrupt:
            interruption.asked = True
    stopped = interruption.asked and look < n_look
    seconds = clock_of_the_wall.perf_counter() - begin
    return [_result(scene, s, oscillators, worlds, looks[s], seconds, stopped) for s, scene in enumerate(scenes)]


def is_due(count: int, look: int, n_look: int) -> bool:
    """Whether one of `count` snapshots, spread evenly over `n_look` looks, falls on this one; the last always does."""
    return look * count // n_look > (look - 1) * count // n_look


class _Look(NamedTuple):
    """Energies at one time."""

    time: float
    structure: float
    damped: float
    forced: float
    beds: tuple[Energies, ...]
    particles: tuple[Snapshot, ...]
    """Empty at most times."""


def _look(scene: Scene, s: int, oscillators: Oscillators, worlds: Worlds, with_particles: bool = False) -> _Look:
    first, dt = int(oscillators.first[s]), scene.time_step
    speed = oscillators.speed[s] + 0.5 * dt * oscillators.change[s]
    structure = 0.5 * float(speed @ speed + oscillators.stiffness[s] @ oscillators.coordinate[s] ** 2)
    rows = range(first, first + int(oscillators.n_world[s]))
    beds = tuple(bed_energies(oscillators, worlds, w) for w in rows)
    particles = tuple(_snapshot(worlds, w) for w in rows) if with_particles else ()
    damped, forced = (float(oscillators.ledger[s, place]) for place in (DAMPED, FORCED))
    return _Look(float(oscillators.step[s]) * dt, structure, damped, forced, beds, particles)


def _snapshot(worlds: Worlds, w: int) -> Snapshot:
    velocity, spin = velocity_now(worlds, w)
    place = np.argsort(worlds.particles.identity[w, : len(velocity)])
    return Snapshot(
        time=float(worlds.clock.time[w]),
        phase=math.nan,
        position=worlds.particles.position[w, place, :3].copy(),
        velocity=velocity[place],
        spin=spin[place],
        displacement=worlds.motion.displacement[w].copy(),
        container_velocity=worlds.motion.velocity[w].copy(),
    )


def bed_energies(oscillators: Oscillators, worlds: Worlds, w: int) -> Energies:
    """Energies of the bed of world w, in the frame at rest, also where its container turns."""
    plain = energies(worlds, w)
    if not oscillators.turns[w]:
        return plain
    n = int(worlds.particles.n_particle[w])
    velocity, spin = velocity_now(worlds, w)
    mass, inertia = 1.0 / worlds.particles.inverse_mass[w, :n, 0], 1.0 / worlds.particles.inverse_mass[w, :n, 1]
    arm = worlds.particles.position[w, :n, :3] - oscillators.pivot[w]
    axis, rate = oscillators.axis[w], oscillators.turn[w, TURN_RATE]
    velocity = velocity + worlds.motion.velocity[w] + rate * np.cross(axis, arm)
    spin = spin + rate * axis
    angle = oscillators.turn[w, ANGLE]
    across = np.cross(axis, arm)
    along = np.outer(arm @ axis, axis)
    place = worlds.motion.displacement[w] + oscillators.pivot[w] + along
    place = place + math.cos(angle) * (arm - along) + math.sin(angle) * across
    return plain._replace(
        kinetic=float(0.5 * np.sum(mass * np.sum(velocity**2, axis=1))),
        rotational=float(0.5 * np.sum(inertia * np.sum(spin**2, axis=1))),
        potential=float(-np.sum(mass * (place @ worlds.rules.gravity[w]))),
    )


def _result(
    scene: Scene, s: int, oscillators: Oscillators, worlds: Worlds, looks: list[_Look], seconds: float, stopped: bool
) -> CoRun:
    first, n = int(oscillators.first[s]), int(oscillators.n_sample[s])
    n_mode = len(scene.case.model.omega)
    rows = range(first, first + len(scene.worlds))
    force = np.full((n, len(scene.worlds), 3), np.nan)
    for number, w in enumerate(rows):
        count = min(int(worlds.record.n_sample[w]), n - 1)
        n_group = int(worlds.walls.n_group[w])
        force[1 : count + 1, number] = worlds.record.series[w, :count, :n_group].sum(axis=1)
    edges = LOWEST_SPEED * 2.0 ** (np.arange(worlds.record.impact.shape[2] + 1) / 4.0)
    struck = np.flatnonzero(worlds.record.impact[list(rows)].sum(axis=(0, 1)))
    fastest = float(edges[struck[-1] + 1]) if len(struck) else 0.0
    smallest = np.array([packing.radius.min() for packing in scene.packings])
    overlap = worlds.record.extreme[list(rows)] / smallest[:, None]
    status = int(np.bitwise_or.reduce(worlds.clock.status[list(rows)]))
    steps = scene.contact_at_one / scene.time_step * (fastest**-0.2 if fastest > 0.0 and scene.is_hertzian else 1.0)
    status |= int(Status.FEW_STEPS) if fastest > 0.0 and steps < FEW_STEPS else 0
    status |= int(Status.LARGE_OVERLAP) if overlap.max() > LARGE_OVERLAP else 0
    status |= int(Status.INTERRUPTED) if stopped else 0
    if not np.isfinite(oscillators.coordinate[s]).all():
        status |= int(Status.PARTICLE_LOST)
    q = oscillators.series[s, :n, 0, :n_mode] - sag_of(scene.case, scene.bed_mass)
    return CoRun(
        case=scene.case,
        packings=scene.packings,
        bed_mass=scene.bed_mass,
        time=np.asarray(scene.time_step * scene.stride * np.arange(n), np.float64),
        q=q,
        v=oscillators.series[s, :n, 1, :n_mode].copy(),
        force=force,
        energy_time=np.array([look.time for look in looks]),
        structure_energy=np.array([look.structure for look in looks]),
        damped=np.array([look.damped for look in looks]),
        forced=np.array([look.forced for look in looks]),
        energy=tuple(look.beds for look in looks),
        snapshots=tuple(look.particles for look in looks if look.particles),
        largest_overlap=overlap,
        largest_speed=fastest,
        time_step=scene.time_step,
        n_step=int(oscillators.step[s]),
        seconds=seconds,
        status=status,
    )
