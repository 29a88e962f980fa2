"""One operating point: pack, settle, shake, write down."""

import math
import time as clock_of_the_wall
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from graindamp.dem import backend, engine
from graindamp.dem.columns import FORCE_COS, FORCE_SIN, LOWEST_SPEED, N_SPEED_BIN, N_STEP, SPEED_COS, SPEED_SIN
from graindamp.dem.container import Enclosure, enclosure_of
from graindamp.dem.energy import Energies, energies, velocity_now
from graindamp.dem.excitation import motion_of
from graindamp.dem.interactions import interactions_of
from graindamp.dem.motion import DIRECTION, FUNDAMENTAL, INTERVAL, move
from graindamp.dem.packing import pack
from graindamp.dem.packing_store import Packing
from graindamp.dem.state import Motion, Worlds, empty_record
from graindamp.dem.timestep import expected_speed, shortest_contact
from graindamp.dem.world import Bed, world_of
from graindamp.spec.motion import SeriesMotion
from graindamp.spec.simulation import SimulationSpec
from graindamp.status import Status

Real = NDArray[np.float64]
Progress = Callable[[str, float, float | None], None]

ENERGIES_PER_CYCLE = 20
"""Samples of the energies per cycle [-]."""

CHUNKS = 500
"""Pieces of a run without cycles, between which it can be interrupted [-]."""

LARGE_OVERLAP = 0.05
"""Overlap over radius above which contacts are no longer small [-]; Hertz's law is then wrong by several per cent."""

FEW_STEPS = 20
"""Steps in the fastest impact below which its restitution is wrong by more than 0.1 % [-]."""


SKIN_STEPS = 250.0
"""Steps of the fastest particle that the outer neighbour lists shall last [-]."""


class Snapshot(NamedTuple):
    """All particles at one time, in the order of the description."""

    time: float
    """Time since the motion began [s]."""
    phase: float
    """Phase of the motion, 0 to 2 pi [rad]; NaN where it has none."""
    position: Real
    """Centres in the container's frame [m]; (particle, 3)."""
    velocity: Real
    """Velocities in the container's frame [m/s]; (particle, 3)."""
    spin: Real
    """Angular velocities [rad/s]; (particle, 3)."""
    displacement: Real
    """Of the container [m]; (3,)."""
    container_velocity: Real
    """Of the container [m/s]; (3,)."""


class VelocityField(NamedTuple):
    """Mean velocity of the particles in cubic cells at one phase, over the cycles of a run."""

    origin: Real
    """Lowest corner [m]; (3,)."""
    cell: float
    """Side of a cell [m]."""
    met: NDArray[np.int64]
    """Particles met in each cell, all cycles together; (x, y, z)."""
    velocity: Real
    """Mean velocity in the container's frame [m/s], NaN where no particle was; (x, y, z, 3)."""
    phase: float
    """Phase of the motion [rad]."""
    n_cycle: int
    """Cycles averaged over [-]."""


class Run(NamedTuple):
    """What a simulation gives. Time 0 is the start of the motion."""

    spec: SimulationSpec
    packing: Packing
    enclosure: Enclosure
    names: tuple[str, ...]
    """Names of the walls."""
    radius: Real
    """Radius of each particle [m]; (particle,)."""
    mass: Real
    """Mass of each particle [kg]; (particle,)."""
    component: NDArray[np.int32]
    """Number of the bed's component that each particle belongs to; (particle,)."""
    time: Real
    """Middle of each block mean [s]; (sample,)."""
    force: Real
    """Force of the particles ON each wall, block means [N]; (sample, wall, 3)."""
    velocity: Real
    """Velocity of the container, block means [m/s]; (sample, 3)."""
    cycle_force: NDArray[np.complex128]
    """Amplitude of the force of the particles ON the container along the motion, whole cycles, exp(+i Omega t) [N];
    (cycle,)."""
    cycle_velocity: NDArray[np.complex128]
    """Amplitude of the container's velocity likewise [m/s]; (cycle,)."""
    direction: Real
    """Direction of the motion; (3,)."""
    frequency: float | None
    """Frequency that cycles are counted by [Hz]."""
    energy_time: Real
    """Times of the energies [s]; (sample,)."""
    energy: tuple[Energies, ...]
    centre: Real
    """Centre of mass of the bed in the container's frame at those times [m]; (sample, 3)."""
    snapshots: tuple[Snapshot, ...]
    velocity_field: VelocityField | None
    impact_edges: Real
    """Edges of the bins of impact speed [m/s]; (bin + 1,)."""
    impact_counts: NDArray[np.int64]
    """Impacts between particles and with walls; (2, bin)."""
    contacts_per_particle: float
    """Mean number of touching pairs per particle [-]."""
    wall_contacts: float
    """Mean number of touching particles and walls [-]."""
    largest_overlap: Real
    """Over the smallest radius, between particles and with walls [-]; (2,)."""
    largest_speed: float
    """Speed of the fastest impact [m/s]."""
    time_step: float
    """[s]"""
    n_step: int
    """Steps of the motion, settling excluded [-]."""
    seconds: float
    """Time that the motion took to compute [s]."""
    steps_per_contact: float
    """Steps in a contact at the speed of the fastest impact [-]."""
    status: int
    """Status bits, see :class:`graindamp.status.Status`."""

    @property
    def bed_mass(self) -> float:
        """Mass of all particles [kg]."""
        return float(self.mass.sum())

    @property
    def particle_steps_per_second(self) -> float:
        """Particles times steps over seconds [1/s]."""
        return len(self.mass) * self.n_step / self.seconds if self.seconds > 0.0 else math.nan


class _Plan(NamedTuple):
    """Steps at which something is written down."""

    time_step: float
    n_settle: int
    n_step: int
    stride: int
    n_cycle: int
    energy: frozenset[int]
    snapshot: frozenset[int]
    field: frozenset[int]

    @property
    def stops(self) -> list[int]:
        """All of them in order, counted from the start of the motion."""
        return sorted(self.energy | self.snapshot | self.field | {self.n_step})


def simulate(
    spec: SimulationSpec,
    *,
    folder: Path | None = None,
    cache: Path | None = None,
    packing: Packing | None = None,
    progress: Progress | None = None,
) -> Run:
    """Simulate one operating point.

    Ctrl-C ends the run early: what there is so far comes back with `Status.INTERRUPTED`.

    Args:
        spec: what to simulate.
        folder: what files in the description are relative to; None: the working folder.
        cache: folder of stored packings; None: that of the user.
        packing: the bed to start from; None: pack, or take the stored one.
        progress: called with stage, fraction done and seconds left, or None where these are not known yet.

    Raises:
        InputError: the bed does not fit, a file cannot be used, a particle starts outside.
    """
    damper = spec.damper
    if packing is None:
        packing = pack(damper, folder=folder, cache=cache, progress=progress)
    interactions = interactions_of(damper)
    enclosure = enclosure_of(damper, interactions, lid_height=packing.lid_height, folder=folder)
    material = np.asarray(interactions.component, np.int32)[packing.component]
    motion = motion_of(spec.motion, folder=folder)
    speed = expected_speed(motion, float(np.linalg.norm(damper.gravity)), float(packing.radius.max()))
    contact = shortest_contact(interactions, packing.radius, material, speed)
    plan = _plan_of(spec, motion, spec.run.time_step or contact / spec.run.steps_per_contact)
    smallest = float(packing.radius.min())
    worlds = world_of(
        Bed.at_rest(packing.position, packing.radius, material),
        enclosure,
        interactions,
        damper.gravity,
        plan.time_step,
        skin=min(max(SKIN_STEPS * speed * plan.time_step, 0.04 * smallest), 0.25 * smallest),
    )
    status, stopped = 0, False
    worlds = engine.start(worlds)
    try:
        worlds = _settle(worlds, plan, progress)
    except KeyboardInterrupt:
        stopped = True
    worlds = _set_off(worlds, motion, plan, len(enclosure.names))
    notes = _Notes(spec, worlds, packing)
    start_clock = clock_of_the_wall.perf_counter()
    first = int(worlds.clock.step[0])
    counts = worlds.clock.counts[0].copy()
    integrate = engine.run if spec.run.integrator == "verlet" else _gear(spec, packing)
    notes.energy(worlds)
    done = 0
    try:
        for stop in [] if stopped else plan.stops:
            worlds, done = integrate(worlds, stop - done), stop
            status |= int(worlds.clock.status[0])
            if status or notes.lost(worlds, enclosure):
                status |= 0 if status else int(Status.PARTICLE_LOST)
                break
            if stop in plan.energy or stop == plan.n_step:
                notes.energy(worlds)
            if stop in plan.snapshot:
                notes.snapshot(worlds)
            if stop in plan.field:
                notes.field(worlds)
            if progress is not None:
                spent = clock_of_the_wall.perf_counter() - start_clock
                progress("shaking", done / plan.n_step, spent * (plan.n_step / done - 1.0))
    except KeyboardInterrupt:
        stopped = True
    seconds = clock_of_the_wall.perf_counter() - start_clock
    if stopped:
        status |= int(Status.INTERRUPTED)
    mass = interactions.density[material] * 4.0 / 3.0 * np.pi * packing.radius**3
    return notes.run(
        worlds,
        enclosure,
        mass,
        motion,
        plan,
        done,
        int(worlds.clock.step[0]) - first,
        counts,
        contact,
        speed,
        seconds,
        status,
    )


def _plan_of(spec: SimulationSpec, motion: Motion, time_step: float) -> _Plan:
    duration = spec.duration
    if duration is None:
        assert isinstance(spec.motion, SeriesMotion)
        duration = float(motion.timing[0, INTERVAL] * (motion.series.shape[1] - 1))
    frequency = spec.base_frequency
    if frequency is not None:
        # Whole samples in a cycle and whole steps in a sample keep every cycle alike.
        samples = max(round(spec.sample_rate / frequency), 1)
        stride = max(math.ceil(1.0 / frequency / samples / time_step - 1e-9), 1)
        per_cycle = samples * stride
        time_step = 1.0 / frequency / per_cycle
        n_step = max(round(duration / time_step), 1)
        n_cycle = math.ceil(n_step / per_cycle - 1e-9)
        energy = _at(np.arange(1, n_cycle * ENERGIES_PER_CYCLE + 1) / ENERGIES_PER_CYCLE, per_cycle, n_step)
        snapshots = spec.run.snapshots_per_cycle
        snapshot = _at(np.arange(n_cycle * snapshots) / max(snapshots, 1), per_cycle, n_step)
        field: frozenset[int] = frozenset()
        if spec.run.velocity_field is not None:
            turn = spec.run.velocity_field.phase / (2.0 * math.pi) % 1.0
            field = _at(np.arange(n_cycle) + turn, per_cycle, n_step)
    else:
        stride = max(math.ceil(1.0 / spec.sample_rate / time_step - 1e-9), 1)
        time_step = 1.0 / spec.sample_rate / stride
        n_step = max(round(duration / time_step), 1)
        n_cycle = 1
        energy = _at(np.arange(1, CHUNKS + 1) / CHUNKS, n_step, n_step)
        snapshot = field = frozenset()
    n_settle = math.ceil(spec.run.settle / time_step)
    return _Plan(time_step, n_settle, n_step, stride, n_cycle, energy, snapshot, field)


def _at(place: NDArray[np.floating[Any]], per_unit: int, n_step: int) -> frozenset[int]:
    """Steps of places given in units of `per_unit` steps, those within the run."""
    return frozenset(int(step) for step in np.rint(place * per_unit) if 0 < step <= n_step)


def _settle(worlds: Worlds, plan: _Plan, progress: Progress | None) -> Worlds:
    pieces = 20
    for piece in range(pieces):
        worlds = engine.run(worlds, plan.n_settle * (piece + 1) // pieces - plan.n_settle * piece // pieces)
        if worlds.clock.status[0]:
            break
        if progress is not None:
            progress("settling", (piece + 1) / pieces, None)
    return worlds


def _set_off(worlds: Worlds, motion: Motion, plan: _Plan, n_wall: int) -> Worlds:
    """The settled world with its container about to move.

    A container that starts with a speed leaves the particles behind: in its frame they start with the opposite one.
    """
    velocity, spin = velocity_now(worlds)
    motion.timing[0, 0] = worlds.clock.time[0]
    move(0, worlds.clock.time[0], motion)
    n_sample = plan.n_step // plan.stride + 1
    record = empty_record(1, n_wall, n_sample, plan.stride, plan.n_cycle)
    worlds = worlds._replace(motion=motion, record=record)
    worlds.particles.velocity[0, :, :3] = velocity - motion.velocity[0]
    worlds.particles.spin[0, :, :3] = spin
    backend.shift(0, -0.5 * plan.time_step, worlds.particles, worlds.rules, worlds.motion)
    worlds.clock.drift[0, 3:7] = backend.BEYOND
    return worlds


def _gear(spec: SimulationSpec, packing: Packing) -> Callable[[Worlds, int], Worlds]:
    from graindamp.dem.gear import Gear

    return Gear(tolerance=(spec.run.tolerance or 1e-6) * float(packing.radius.min())).run


class _Notes:
    """What is written down while a run goes on."""

    def __init__(self, spec: SimulationSpec, worlds: Worlds, packing: Packing) -> None:
        self.spec, self.packing = spec, packing
        self.begin = float(worlds.clock.time[0])
        self.times: list[float] = []
        self.energies: list[Energies] = []
        self.centres: list[Real] = []
        self.snapshots: list[Snapshot] = []
        self.place = np.argsort(worlds.particles.identity[0])
        self.mass = 1.0 / worlds.particles.inverse_mass[0, :, 0]
        self.cells: dict[tuple[int, int, int], list[Real]] = {}
        self.n_field = 0

    def since(self, worlds: Worlds) -> float:
        """Time since the motion began [s]."""
        return float(worlds.clock.time[0]) - self.begin

    def energy(self, worlds: Worlds) -> None:
        """Write down energies and centre of mass."""
        self.times.append(self.since(worlds))
        self.energies.append(energies(worlds))
        self.centres.append(self.mass @ worlds.particles.position[0, :, :3] / self.mass.sum())

    def snapshot(self, worlds: Worlds) -> None:
        """Write down all particles."""
        velocity, spin = velocity_now(worlds)
        time, omega = self.since(worlds), float(worlds.motion.timing[0, FUNDAMENTAL])
        self.snapshots.append(
            Snapshot(
                time=time,
                phase=omega * time % (2.0 * math.pi) if omega > 0.0 else math.nan,
                position=worlds.particles.position[0, self.place, :3].copy(),
                velocity=velocity[self.place],
                spin=spin[self.place],
                displacement=worlds.motion.displacement[0].copy(),
                container_velocity=worlds.motion.velocity[0].copy(),
            )
        )

    def field(self, worlds: Worlds) -> None:
        """Add the particles' velocities to the cells they are in."""
        assert self.spec.run.velocity_field is not None
        velocity, _ = velocity_now(worlds)
        cell = np.floor(worlds.particles.position[0, :, :3] / self.spec.run.velocity_field.cell).astype(int)
        for key, v in zip(map(tuple, cell.tolist()), velocity, strict=True):
            self.cells.setdefault(key, []).append(v)
        self.n_field += 1

    def lost(self, worlds: Worlds, enclosure: Enclosure) -> bool:
        """Whether a particle is no number, has left the bounds of a mesh, or is a kilometre away.

        Other walls are endless or closed behind, and push a particle back from any depth.
        """
        n = int(worlds.particles.n_particle[0])
        position = worlds.particles.position[0, :n]
        if not np.all(np.isfinite(position)):
            return True
        if enclosure.mesh is None:
            return bool(np.abs(position[:, :3]).max() > 1e3)
        from graindamp.dem.mesh import bounds

        low, high = bounds(enclosure.mesh)
        return bool(np.any(position[:, :3] < low) or np.any(position[:, :3] > high))

    def velocity_field(self) -> VelocityField | None:
        """The cells as an array."""
        wanted = self.spec.run.velocity_field
        if wanted is None or not self.cells:
            return None
        keys = np.array(list(self.cells))
        low = keys.min(axis=0)
        shape = tuple(keys.max(axis=0) - low + 1)
        count = np.zeros(shape, np.int64)
        velocity = np.full((*shape, 3), np.nan)
        for key, values in self.cells.items():
            place = tuple(np.array(key) - low)
            count[place] = len(values)
            velocity[place] = np.mean(values, axis=0)
        return VelocityField(low * wanted.cell, wanted.cell, count, velocity, wanted.phase, self.n_field)

    def run(
        self,
        worlds: Worlds,
        enclosure: Enclosure,
        mass: Real,
        motion: Motion,
        plan: _Plan,
        n_step: int,
        n_inner_step: int,
        counts: NDArray[np.int64],
        contact: float,
        speed: float,
        seconds: float,
        status: int,
    ) -> Run:
        """All of it together."""
        record, n = worlds.record, len(mass)
        n_sample = int(record.n_sample[0])
        series = record.series[0, :n_sample]
        whole = record.fourier[0]
        per_cycle = plan.n_step if self.spec.base_frequency is None else self._steps_per_cycle(plan)
        whole = whole[np.abs(whole[:, N_STEP] - per_cycle) < 0.5] if self.spec.base_frequency is not None else whole[:0]
        scale = 2.0 / max(per_cycle, 1)
        edges = LOWEST_SPEED * 2.0 ** (np.arange(N_SPEED_BIN + 1) / 4.0)
        impacts = record.impact[0].copy()
        struck = np.flatnonzero(impacts.sum(axis=0))
        fastest = float(edges[struck[-1] + 1]) if len(struck) else 0.0
        steps = contact / plan.time_step
        if fastest > 0.0 and self.spec.damper.contact.law != "linear":
            steps *= (speed / fastest) ** 0.2
        overlap = record.extreme[0, :2] / float(self.packing.radius.min())
        if overlap.max() > LARGE_OVERLAP:
            status |= int(Status.LARGE_OVERLAP)
        if fastest > 0.0 and steps < FEW_STEPS and self.spec.run.integrator == "verlet":
            status |= int(Status.FEW_STEPS)
        done = worlds.clock.counts[0] - counts
        return Run(
            spec=self.spec,
            packing=self.packing,
            enclosure=enclosure,
            names=enclosure.names,
            radius=self.packing.radius,
            mass=mass,
            component=self.packing.component,
            time=np.asarray(
                (np.arange(n_sample) + 0.5) * plan.stride * plan.time_step + 0.5 * plan.time_step, np.float64
            ),
            force=series[:, :-1].copy(),
            velocity=series[:, -1].copy(),
            cycle_force=scale * (whole[:, FORCE_COS] - 1j * whole[:, FORCE_SIN]),
            cycle_velocity=scale * (whole[:, SPEED_COS] - 1j * whole[:, SPEED_SIN]),
            direction=motion.timing[0, DIRECTION : DIRECTION + 3].copy(),
            frequency=self.spec.base_frequency,
            energy_time=np.array(self.times),
            energy=tuple(self.energies),
            centre=np.array(self.centres),
            snapshots=tuple(self.snapshots),
            velocity_field=self.velocity_field(),
            impact_edges=edges,
            impact_counts=impacts,
            contacts_per_particle=float(done[2]) / max(n_inner_step, 1) / n,
            wall_contacts=float(done[3]) / max(n_inner_step, 1),
            largest_overlap=overlap,
            largest_speed=fastest,
            time_step=plan.time_step,
            n_step=n_step,
            seconds=seconds,
            steps_per_contact=steps,
            status=status,
        )

    def _steps_per_cycle(self, plan: _Plan) -> int:
        assert self.spec.base_frequency is not None
        return round(1.0 / self.spec.base_frequency / plan.time_step)
