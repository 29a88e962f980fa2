"""The arrays of a batch on the device. Axis 0 is the slot that a world occupies; one thread block per slot.

Along the last axis neighbouring threads read neighbouring numbers. `real` stands for the working type, single or double
precision; positions and what is summed over many steps are double in both."""

from typing import Any, NamedTuple

import numpy as np

from graindamp.dem.columns import N_COLUMN, N_GRIP, N_NODE, N_SPEED_BIN
from graindamp.dem.gpu.columns import N_CODE, N_COUNT, N_NUMBER, N_RECORD, N_ROW, N_SERIES, N_SUM
from graindamp.dem.state import Motion, Walls
from graindamp.dem.walls import N_SHAPE

Array = Any
"""An array of numpy, or one of the device."""


class Bed(NamedTuple):
    """Particles. Velocities are those of the middle of the last step, in the container's frame."""

    position: Array
    """[m], double; (slot, 3, particle)."""
    radius: Array
    """[m], double; (slot, particle)."""
    velocity: Array
    """[m/s], double; (slot, 3, particle)."""
    spin: Array
    """[rad/s], real; (slot, 3, particle)."""
    velocity_next: Array
    """Extrapolated to the time of the positions, which the contacts see [m/s], real; (slot, 3, particle)."""
    spin_next: Array
    """[rad/s], real; (slot, 3, particle)."""
    inverse: Array
    """1/mass [1/kg] and 1/moment of inertia [1/(kg m^2)], real; (slot, 2, particle)."""
    material: Array
    """Number of the material, int32; (slot, particle)."""
    velocity_shown: Array
    """Before the motion: what to start with, if given. At a pause: velocity at the time of the positions [m/s], double;
    (slot, 3, particle)."""
    spin_shown: Array
    """Likewise [rad/s]; (slot, 3, particle)."""
    load: Array
    """Force [N] and torque [N m] at a pause, real; (slot, 6, particle)."""


class Pairs(NamedTuple):
    """Pairs of particles that may touch, and what touching pairs remember.

    The outer list stands in two copies, so that a new one can take over the memory of the old one. Its pairs are sorted
    by first and second member; `start` says where those of each first member begin."""

    start: Array
    """int32; (slot, 2, particle + 1)."""
    first: Array
    """uint32; (slot, 2, pair)."""
    second: Array
    """uint32; (slot, 2, pair)."""
    touched: Array
    """Step at which the pair last touched, int32; (slot, 2, pair)."""
    grip: Array
    """What :mod:`graindamp.dem.grip` found at onset, real; (slot, 2, pair, N_GRIP)."""
    stretch: Array
    """Force [N] and stiffness [N/m] of a tangential spring, real; (slot, 2, pair, 4), or (slot, 2, 1, 4) without
    springs."""
    back_start: Array
    """Where the pairs with each second member begin in `back`, int32; (slot, particle + 1)."""
    back: Array
    """Places of those pairs in the outer list, ascending, uint32; (slot, pair)."""
    place: Array
    """Place of each outer pair in the inner list, or -1, int32; (slot, pair)."""
    inner_start: Array
    """Where the inner pairs of each first member begin, int32; (slot, particle + 1)."""
    inner: Array
    """Places of inner pairs in the outer list, uint32; (slot, pair)."""
    inner_first: Array
    """Members of inner pairs, uint32; (slot, pair)."""
    inner_second: Array
    inner_back_start: Array
    """int32; (slot, particle + 1)."""
    inner_back: Array
    """Places in the inner list of the pairs with each second member, uint32; (slot, pair)."""
    stamp: Array
    """Step of the record, int32; (slot, pair)."""
    record: Array
    """Force of each inner pair, columns of :mod:`graindamp.dem.gpu.columns`, real; (slot, pair, N_RECORD)."""
    roll: Array
    """Torque of its rolling resistance on the first body [N m], real; (slot, pair, 3), or (slot, 1, 3) without."""


class Touches(NamedTuple):
    """Particles that may touch a wall element; sorted by particle, patch and element, in two copies as the pairs."""

    start: Array
    """int32; (slot, 2, particle + 1)."""
    first: Array
    """Particle, uint32; (slot, 2, touch)."""
    element: Array
    """uint32; (slot, 2, touch)."""
    home: Array
    """First entry of the same particle and patch, which holds the memory of all of them, int32; (slot, 2, touch)."""
    touched: Array
    grip: Array
    stretch: Array
    stamp: Array
    """Step of the record, int32; (slot, touch)."""
    record: Array
    """real; (slot, touch, N_RECORD)."""


class Slots(NamedTuple):
    """Where each world stands."""

    counts: Array
    """int64; (slot, N_COUNT)."""
    codes: Array
    """What holds all along, int64; (slot, N_CODE)."""
    numbers: Array
    """double; (slot, N_NUMBER)."""
    sums: Array
    """Sums of every thread, double; (slot, N_SUM, thread)."""
    rows: Array
    """What is written down at the end of every cycle, double; (slot, row, N_ROW)."""
    series: Array
    """What the stopping rule looks at, and its room to work in, double; (slot, N_SERIES, row)."""
    impact: Array
    """Impacts by speed, between particles and with walls, int64; (slot, 2, N_SPEED_BIN)."""


class Tables(NamedTuple):
    """Contact constants, as in :class:`graindamp.dem.state.Rules`."""

    pair: Array
    """double; (slot, material, material, column)."""
    loss: Array
    """double; (slot, material, material, node, 2)."""


class Scratch(NamedTuple):
    """Room to work in while lists are renewed."""

    cell_start: Array
    """int32; (slot, cell + 1)."""
    cell: Array
    """Cell of each particle, int32; (slot, particle)."""
    member: Array
    """Particles cell by cell, uint32; (slot, particle)."""


class Batch(NamedTuple):
    """All of it; what a kernel is given."""

    bed: Bed
    pairs: Pairs
    touches: Touches
    walls: Walls
    tables: Tables
    motion: Motion
    slots: Slots
    scratch: Scratch


class Room(NamedTuple):
    """Sizes of the arrays."""

    slots: int
    particles: int
    pairs: int
    touches: int
    rows: int
    waves: int
    samples: int
    materials: int
    elements: int
    edges: int
    cells: int
    entries: int
    threads: int
    """Threads of a world, of all its blocks."""
    springs: bool
    rolling: bool


def layout(room: Room, real: type) -> dict[str, dict[str, tuple[tuple[int, ...], type]]]:
    """Shape and type of every array, by part and name."""
    s, n, p, q = room.slots, room.particles, room.pairs, room.touches
    f8, i4, u4, i8 = np.float64, np.int32, np.uint32, np.int64
    spring_pairs, spring_touches = (p, q) if room.springs else (1, 1)
    return {
        "bed": {
            "position": ((s, 3, n), f8),
            "radius": ((s, n), f8),
            "velocity": ((s, 3, n), f8),
            "spin": ((s, 3, n), real),
            "velocity_next": ((s, 3, n), real),
            "spin_next": ((s, 3, n), real),
            "inverse": ((s, 2, n), real),
            "material": ((s, n), i4),
            "velocity_shown": ((s, 3, n), f8),
            "spin_shown": ((s, 3, n), f8),
            "load": ((s, 6, n), real),
        },
        "pairs": {
            "start": ((s, 2, n + 1), i4),
            "first": ((s, 2, p), u4),
            "second": ((s, 2, p), u4),
            "touched": ((s, 2, p), i4),
            "grip": ((s, 2, p, N_GRIP), real),
            "stretch": ((s, 2, spring_pairs, 4), real),
            "back_start": ((s, n + 1), i4),
            "back": ((s, p), u4),
            "place": ((s, p), i4),
            "inner_start": ((s, n + 1), i4),
            "inner": ((s, p), u4),
            "inner_first": ((s, p), u4),
            "inner_second": ((s, p), u4),
            "inner_back_start": ((s, n + 1), i4),
            "inner_back": ((s, p), u4),
            "stamp": ((s, p), i4),
            "record": ((s, p, N_RECORD), real),
            "roll": ((s, p if room.rolling else 1, 3), real),
        },
        "touches": {
            "start": ((s, 2, n + 1), i4),
            "first": ((s, 2, q), u4),
            "element": ((s, 2, q), u4),
            "home": ((s, 2, q), i4),
            "touched": ((s, 2, q), i4),
            "grip": ((s, 2, q, N_GRIP), real),
            "stretch": ((s, 2, spring_touches, 4), real),
            "stamp": ((s, q), i4),
            "record": ((s, q, N_RECORD), real),
        },
        "walls": {
            "kind": ((s, room.elements), i4),
            "shape": ((s, room.elements, N_SHAPE), f8),
            "material": ((s, room.elements), i4),
            "law": ((s, room.elements), i4),
            "group": ((s, room.elements), i4),
            "patch": ((s, room.elements), i4),
            "edges": ((s, room.edges, 4), f8),
            "cell_start": ((s, room.cells), i4),
            "cell_element": ((s, room.entries), i4),
            "grid": ((s, 7), f8),
            "n_plain": ((s,), i4),
            "n_group": ((s,), i4),
        },
        "tables": {
            "pair": ((s, room.materials, room.materials, N_COLUMN), f8),
            "loss": ((s, room.materials, room.materials, N_NODE, 2), f8),
        },
        "motion": {
            "kind": ((s,), i4),
            "wave": ((s, room.waves, 5), f8),
            "series": ((s, room.samples, 3), f8),
            "timing": ((s, 8), f8),
            "displacement": ((s, 3), f8),
            "velocity": ((s, 3), f8),
            "acceleration": ((s, 3), f8),
        },
        "slots": {
            "counts": ((s, N_COUNT), i8),
            "codes": ((s, N_CODE), i8),
            "numbers": ((s, N_NUMBER), f8),
            "sums": ((s, N_SUM, room.threads), f8),
            "rows": ((s, room.rows, N_ROW), f8),
            "series": ((s, N_SERIES, room.rows), f8),
            "impact": ((s, 2, N_SPEED_BIN), i8),
        },
        "scratch": {
            "cell_start": ((s, 8 * n + 65), i4),
            "cell": ((s, n), i4),
            "member": ((s, n), u4),
        },
    }


PARTS: dict[str, Any] = {
    "bed": Bed,
    "pairs": Pairs,
    "touches": Touches,
    "walls": Walls,
    "tables": Tables,
    "motion": Motion,
    "slots": Slots,
    "scratch": Scratch,
}
"""Kinds of the parts of a batch, in their order."""


def bytes_of(room: Room, real: type) -> int:
    """Memory that a batch of this size takes on the device [bytes]."""
    return sum(
        int(np.prod(shape)) * np.dtype(kind).itemsize
        for part in layout(room, real).values()
        for shape, kind in part.values()
    )
