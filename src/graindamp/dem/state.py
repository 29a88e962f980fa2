"""The arrays of a batch of worlds. Axis 0 is the world; worlds never meet.

Positions are in the frame of the container. Velocities and spins are those of the middle of the last step (leapfrog);
the velocities at the time of the positions are found by :func:`graindamp.dem.energy.velocity_now`."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from graindamp.dem.columns import N_BUFFER, N_FOURIER, N_GRIP, N_LEDGER, N_SPEED_BIN, TOUCHED

Real = NDArray[np.float64]
Count = NDArray[np.int32]
Place = NDArray[np.uint32]
"""Unsigned, so that compiled code need not look for negative places."""


class Particles(NamedTuple):
    """What moves. Rows of four or eight, so that the numbers of a particle share half a cache line or one."""

    position: Real
    """Centre [m] and, fourth, radius [m]; (world, particle, 4)."""
    velocity: Real
    """Velocity in the container's frame at mid-step [m/s] and, fourth, 0; (world, particle, 4)."""
    spin: Real
    """Angular velocity at mid-step [rad/s] and, fourth, 0; (world, particle, 4)."""
    seen: Real
    """Velocity (0-2) [m/s] and angular velocity (4-6) [rad/s] extrapolated to the time of the positions, which the
    contacts see; 0 (3, 7); (world, particle, 8)."""
    load: Real
    """Contact force (0-2) [N] and torque (4-6) [N m]; 0 (3, 7); (world, particle, 8)."""
    inverse_mass: Real
    """1/mass [1/kg] and 1/moment of inertia [1/(kg m^2)]; (world, particle, 2)."""
    material: Count
    """Number of the material; (world, particle)."""
    identity: Count
    """Number of the particle as described, whatever its place in the arrays; (world, particle)."""
    n_particle: Count
    """Particles of each world; the rest of a row is padding; (world,)."""

    @property
    def force(self) -> Real:
        """Contact force [N]; (world, particle, 3)."""
        return self.load[:, :, 0:3]

    @property
    def torque(self) -> Real:
        """Contact torque [N m]; (world, particle, 3)."""
        return self.load[:, :, 4:7]


class Contacts(NamedTuple):
    """Pairs that may touch, and what touching pairs remember. Lists of one kind: between particles, or with walls.

    The outer list holds every pair nearer than the skin, sorted by first and second member; the inner list those of
    it that may touch within the next dozen steps; the active list those that touch now."""

    first: Place
    """Particle of the pair; (world, pair)."""
    second: Place
    """Second particle, or wall element; (world, pair)."""
    grip: Real
    """Constants found at onset and the step of the last touch, see :mod:`graindamp.dem.grip`; (world, pair,
    N_GRIP)."""
    stretch: Real
    """Tangential force of a spring [N] and its stiffness [N/m]; (world, pair, 4), or (world, 1, 4) if the law has
    none."""
    inner: Place
    """Places in the outer list; of contacts with walls, the place of the memory; (world, pair)."""
    inner_first: Place
    """Members of the inner pairs, beside each other for the pass that reads them most; (world, pair)."""
    inner_second: Place
    active: Place
    """As `inner`, of those that touch, foam excepted; (world, pair)."""
    active_first: Place
    """Their members; (world, pair)."""
    active_second: Place
    n_outer: Count
    """Length of the outer list; (world,)."""
    n_inner: Count
    """Length of the inner list; (world,)."""
    n_active: Count
    """Length of the active list; (world,)."""
    n_soft: Count
    """Particles that touch foam; (world,)."""


class Walls(NamedTuple):
    """Elements of the container's walls, in the container's frame."""

    kind: Count
    """Shape of the element, a WallKind; (world, element)."""
    shape: Real
    """Its numbers, see :mod:`graindamp.dem.walls`; (world, element, N_SHAPE)."""
    material: Count
    """Number of the material; (world, element)."""
    law: Count
    """Normal law of its contacts, a NormalLaw; (world, element)."""
    group: Count
    """Wall that the element's force is counted to; (world, element)."""
    patch: Count
    """Elements of one patch share the memory of a contact; (world, element)."""
    edges: Real
    """Planes of the edges that leave the vertices of meshes; (world, edge, 4)."""
    cell_start: Count
    """Where the elements of each cell of the grid begin in `cell_element`; (world, cell + 1)."""
    cell_element: Count
    """Elements of meshes, cell by cell; (world, entry)."""
    grid: Real
    """Origin [m], cell size [m] and cells per axis of the grid; (world, 7); no grid: zeros."""
    n_plain: Count
    """Elements that are tried for every particle; those of meshes follow and are found through the grid; (world,)."""
    n_group: Count
    """Number of walls; (world,)."""


class Rules(NamedTuple):
    """What holds for a world all along."""

    pair: Real
    """Interaction of materials a and b, columns as in :mod:`graindamp.dem.columns`; (world, material, material,
    column)."""
    loss: Real
    """Damping constants over onset speed; (world, material, material, node, 2)."""
    normal: Count
    """Normal law between particles, a NormalLaw; (world,)."""
    tangential: Count
    """Tangential law, a TangentialLaw; (world,)."""
    tension: Count
    """1: viscous laws may attract; (world,)."""
    rolling: Count
    """1: some pair has rolling resistance; (world,)."""
    gravity: Real
    """Gravity in the container's frame [m/s^2]; (world, 3)."""
    time_step: Real
    """Time step [s]; (world,)."""
    skin: Real
    """Reach of the outer lists beyond touching [m]; (world,)."""
    friction_share: Real
    """Largest smoothed friction, see :data:`graindamp.dem.laws.FRICTION_SHARE`; (world,)."""


class Clock(NamedTuple):
    """Where a world stands, and the bounds that say how long its lists hold."""

    step: NDArray[np.int64]
    """Steps done; (world,)."""
    time: Real
    """Time [s]; (world,)."""
    drift: Real
    """Carried velocity (0-2) [m/s]; bounds [m] of motion relative to it since the last inner (3) and outer (4)
    refresh, and absolute ones for walls (5, 6); reaches of the inner lists (7, 8) [m]; way of the last step (9, 10)
    [m]; (world, 11)."""
    counts: NDArray[np.int64]
    """Outer and inner refreshes, sum of pair contacts, of wall contacts over all steps, new impacts; (world, 5)."""
    stage: NDArray[np.int64]
    """Not started, running or halted, see :mod:`graindamp.dem.backend`; (world,)."""
    status: NDArray[np.int64]
    """Status bits; (world,)."""


class Motion(NamedTuple):
    """Motion of the container: its description and its state."""

    kind: Count
    """A MotionKind; (world,)."""
    wave: Real
    """Harmonics: omega, phase, and displacement amplitude in x, y, z; see :mod:`graindamp.dem.motion`; (world, wave,
    5)."""
    series: Real
    """Samples of displacement, velocity, acceleration along the direction; (world, sample, 3)."""
    timing: Real
    """Start time, ramp or sampling interval and more, by kind; (world, 8)."""
    displacement: Real
    """Of the container [m]; (world, 3)."""
    velocity: Real
    """Of the container [m/s]; (world, 3)."""
    acceleration: Real
    """Of the container [m/s^2]; (world, 3)."""


class Record(NamedTuple):
    """What is written down while a world runs."""

    wall_force: Real
    """Force of the particles on each wall in this step [N]; (world, group, 3)."""
    pending: Real
    """Sums of wall forces (group, 3) and container velocity, of the samples under way; (world, group + 1, 3)."""
    series: Real
    """Block means of force on each wall [N] and, last, of the container's velocity [m/s]; (world, sample, group + 1,
    3)."""
    stride: NDArray[np.int64]
    """Steps per sample; (world,)."""
    n_sample: NDArray[np.int64]
    """Samples written; (world,)."""
    n_pending: NDArray[np.int64]
    """Steps in the sample under way; (world,)."""
    fourier: Real
    """Sums over each cycle, columns as in :mod:`graindamp.dem.columns`; (world, cycle, N_FOURIER)."""
    ledger: Real
    """Energies since the start [J], columns as in :mod:`graindamp.dem.columns`; (world, N_LEDGER)."""
    impact: NDArray[np.int64]
    """Impacts by speed, between particles and with walls, in bins of a quarter octave; (world, 2, N_SPEED_BIN)."""
    extreme: Real
    """Largest overlap between particles and at walls [m]; (world, 2)."""


class Scratch(NamedTuple):
    """Room to work in; nothing in it outlives a refresh of the lists."""

    start: Count
    """First member of each cell; (world, cell + 1)."""
    place: Count
    """Cell of each particle; (world, particle)."""
    member: Count
    """Particles cell by cell; (world, particle)."""
    near: Count
    """Neighbours of one particle; (world, largest of particle and element)."""
    buffer: Real
    """Rows of a block of contacts, see :mod:`graindamp.dem.block`; (world, N_BUFFER)."""


class Worlds(NamedTuple):
    """A whole batch."""

    particles: Particles
    pairs: Contacts
    touches: Contacts
    walls: Walls
    rules: Rules
    motion: Motion
    clock: Clock
    record: Record
    scratch: Scratch


CACHE_LINE = 64
"""Bytes that memory and processor exchange at a time."""

CELLS_PER_PARTICLE = 3
"""Room for linked cells; in a bed that fills fewer, cells are made larger."""

LARGE_PAGE = 2 << 20
"""Bytes of a large page of the processor's address tables; numpy asks the system for them from 4 MiB on."""


def aligned(worlds: Worlds) -> Worlds:
    """The same worlds with particles, contacts and scratch in one piece of memory, every array from the start of a
    cache line, so that a row of eight numbers is one line and not parts of two. From half a large page on, the piece
    begins with one and is long enough to get them."""
    parts: dict[str, Any] = {name: getattr(worlds, name) for name in ("particles", "pairs", "touches", "scratch")}
    size = sum(_room(array) for part in parts.values() for array in part)
    large = size > LARGE_PAGE // 2
    unit = LARGE_PAGE if large else CACHE_LINE
    memory = np.zeros(max(size + unit, 2 * LARGE_PAGE if large else 0), np.uint8)
    place = -memory.ctypes.data % unit
    for name, part in parts.items():
        moved = []
        for array in part:
            moved.append(memory[place : place + array.nbytes].view(array.dtype).reshape(array.shape))
            moved[-1][...] = array
            place += _room(array)
        parts[name] = type(part)(*moved)
    return worlds._replace(**parts)


def _room(array: NDArray[Any]) -> int:
    return -(-array.nbytes // CACHE_LINE) * CACHE_LINE


def empty_contacts(n_world: int, capacity: int, with_stretch: bool) -> Contacts:
    """Lists with room for `capacity` pairs per world."""
    integer: dict[str, Any] = {"dtype": np.int32}
    place: dict[str, Any] = {"dtype": np.uint32}
    grip = np.zeros((n_world, capacity, N_GRIP))
    grip[:, :, TOUCHED] = -9.0
    return Contacts(
        first=np.zeros((n_world, capacity), **place),
        second=np.zeros((n_world, capacity), **place),
        grip=grip,
        stretch=np.zeros((n_world, capacity if with_stretch else 1, 4)),
        inner=np.zeros((n_world, capacity), **place),
        inner_first=np.zeros((n_world, capacity), **place),
        inner_second=np.zeros((n_world, capacity), **place),
        active=np.zeros((n_world, capacity), **place),
        active_first=np.zeros((n_world, capacity), **place),
        active_second=np.zeros((n_world, capacity), **place),
        n_outer=np.zeros(n_world, **integer),
        n_inner=np.zeros(n_world, **integer),
        n_active=np.zeros(n_world, **integer),
        n_soft=np.zeros(n_world, **integer),
    )


def empty_record(n_world: int, n_group: int, n_sample: int, stride: int, n_cycle: int) -> Record:
    """A record with room for `n_sample` block means and `n_cycle` cycles."""
    return Record(
        wall_force=np.zeros((n_world, n_group, 3)),
        pending=np.zeros((n_world, n_group + 1, 3)),
        series=np.zeros((n_world, n_sample, n_group + 1, 3)),
        stride=np.full(n_world, stride, np.int64),
        n_sample=np.zeros(n_world, np.int64),
        n_pending=np.zeros(n_world, np.int64),
        fourier=np.zeros((n_world, n_cycle, N_FOURIER)),
        ledger=np.zeros((n_world, N_LEDGER)),
        impact=np.zeros((n_world, 2, N_SPEED_BIN), np.int64),
        extreme=np.zeros((n_world, 2)),
    )


def empty_scratch(n_world: int, n_particle: int, n_element: int) -> Scratch:
    """Room for the refreshes of the lists of worlds of so many particles and wall elements."""
    integer: dict[str, Any] = {"dtype": np.int32}
    return Scratch(
        start=np.zeros((n_world, CELLS_PER_PARTICLE * n_particle + 64), **integer),
        place=np.zeros((n_world, n_particle), **integer),
        member=np.zeros((n_world, n_particle), **integer),
        near=np.zeros((n_world, max(n_particle, n_element)), **integer),
        buffer=np.ones((n_world, N_BUFFER)),
    )
