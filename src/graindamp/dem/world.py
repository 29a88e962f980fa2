"""Worlds made ready to run: arrays from particles, walls, interactions and motion."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from graindamp.dem.container import Enclosure
from graindamp.dem.interactions import Interactions
from graindamp.dem.laws import FRICTION_SHARE, TangentialLaw
from graindamp.dem.state import (
    Clock,
    Motion,
    Particles,
    Rules,
    Walls,
    Worlds,
    aligned,
    empty_contacts,
    empty_record,
    empty_scratch,
)
from graindamp.dem.walls import N_SHAPE

Real = NDArray[np.float64]

SKIN = 0.08
"""Reach of the outer neighbour lists over the smallest radius [-]: the least time per step for beds of equal spheres,
flat from 0.05 to 0.12."""

PAIRS_PER_PARTICLE = 4.5
"""Room for pairs at the start [-]; equal spheres have three to four in the skin, and a full list grows by itself."""

TOUCHES_PER_PARTICLE = 0.75
"""Room for contacts with walls at the start [-], likewise."""


class Bed(NamedTuple):
    """Particles before they are put into a world."""

    position: Real
    """Centres [m]; (particle, 3)."""
    radius: Real
    """Radii [m]; (particle,)."""
    material: NDArray[np.int32]
    """Number of the material; (particle,)."""
    velocity: Real
    """Velocities in the container's frame [m/s]; (particle, 3)."""
    spin: Real
    """Angular velocities [rad/s]; (particle, 3)."""

    @classmethod
    def at_rest(cls, position: Real, radius: Real, material: NDArray[np.int32]) -> "Bed":
        """Particles that do not move."""
        return cls(position, radius, material, np.zeros_like(position), np.zeros_like(position))


def world_of(
    bed: Bed,
    enclosure: Enclosure,
    interactions: Interactions,
    gravity: tuple[float, float, float],
    time_step: float,
    motion: Motion | None = None,
    *,
    n_sample: int = 1,
    stride: int = 1,
    n_cycle: int = 1,
    skin: float | None = None,
    sort: bool = True,
) -> Worlds:
    """One world, its clock at zero and its lists still to be made.

    Args:
        bed: the particles.
        enclosure: the walls.
        interactions: constants of their contacts.
        gravity: in the container's frame [m/s^2].
        time_step: [s].
        motion: of the container; None: at rest.
        n_sample: room for samples of the recorded forces [-].
        stride: steps per sample [-].
        n_cycle: room for cycles of the Fourier sums [-].
        skin: reach of the neighbour lists [m]; None: SKIN times the smallest radius.
        sort: arrange the particles by place, so that neighbours share cache lines.
    """
    n = len(bed.radius)
    smallest = float(bed.radius.min())
    reach = SKIN * smallest if skin is None else skin
    order = _by_place(bed.position, float(bed.radius.max())) if sort else np.arange(n)
    mass = interactions.density[bed.material] * 4.0 / 3.0 * np.pi * bed.radius**3
    inertia = 0.4 * mass * bed.radius**2
    zeros = np.zeros(n)
    position = np.column_stack([bed.position, bed.radius])[order][None]
    velocity = np.column_stack([bed.velocity, zeros])[order][None]
    spin = np.column_stack([bed.spin, zeros])[order][None]
    particles = Particles(
        position=np.ascontiguousarray(position, np.float64),
        velocity=np.ascontiguousarray(velocity, np.float64),
        spin=np.ascontiguousarray(spin, np.float64),
        seen=np.ascontiguousarray(np.concatenate([velocity, spin], axis=2), np.float64),
        load=np.zeros((1, n, 8)),
        inverse_mass=np.ascontiguousarray(np.column_stack([1.0 / mass, 1.0 / inertia])[order][None]),
        material=np.ascontiguousarray(bed.material[order][None], np.int32),
        identity=np.ascontiguousarray(order[None], np.int32),
        n_particle=np.array([n], np.int32),
    )
    with_stretch = interactions.tangential >= TangentialLaw.MINDLIN
    largest = float(bed.radius.max())
    walls = walls_of(enclosure, interactions, largest + reach, 2.0 * largest)
    clock = Clock(
        step=np.zeros(1, np.int64),
        time=np.zeros(1),
        drift=np.zeros((1, 11)),
        counts=np.zeros((1, 5), np.int64),
        stage=np.zeros(1, np.int64),
        status=np.zeros(1, np.int64),
    )
    worlds = Worlds(
        particles=particles,
        pairs=empty_contacts(1, int(PAIRS_PER_PARTICLE * n) + 16, with_stretch),
        touches=empty_contacts(1, int(TOUCHES_PER_PARTICLE * n) + 16, with_stretch),
        walls=walls,
        rules=Rules(
            pair=np.ascontiguousarray(interactions.pair[None]),
            loss=np.ascontiguousarray(interactions.loss[None]),
            normal=np.array([interactions.normal], np.int32),
            tangential=np.array([interactions.tangential], np.int32),
            tension=np.array([interactions.tension], np.int32),
            rolling=np.array([interactions.rolling], np.int32),
            gravity=np.array([gravity], np.float64),
            time_step=np.array([time_step]),
            skin=np.array([reach]),
            friction_share=np.array([FRICTION_SHARE]),
        ),
        motion=motion if motion is not None else motion_at_rest(),
        clock=clock,
        record=empty_record(1, len(enclosure.names), n_sample, stride, n_cycle),
        scratch=empty_scratch(1, n, walls.kind.shape[1]),
    )
    return aligned(worlds)


def walls_of(enclosure: Enclosure, interactions: Interactions, reach: float, cell: float) -> Walls:
    """Arrays of the wall elements of one world; `reach` [m] and `cell` [m] are those of the grid of a mesh."""
    elements = enclosure.elements
    shape = np.zeros((1, len(elements), N_SHAPE))
    for number, element in enumerate(elements):
        shape[0, number, : len(element.numbers)] = element.numbers
    grid = np.zeros((1, 7))
    start, entries = np.zeros((1, 2), np.int32), np.zeros((1, 1), np.int32)
    if enclosure.mesh is not None:
        from graindamp.dem.mesh import face_grid

        cells = face_grid(enclosure.mesh, cell, reach)
        grid[0] = [*cells.origin, cells.cell, *cells.shape]
        start = np.ascontiguousarray(cells.start[None], np.int32)
        entries = np.ascontiguousarray(cells.feature[None] + enclosure.n_plain, np.int32)

    def column(values: list[int]) -> NDArray[np.int32]:
        return np.array([values], np.int32)

    return Walls(
        kind=column([element.kind for element in elements]),
        shape=shape,
        material=column([element.material for element in elements]),
        law=column([interactions.normal if element.law < 0 else element.law for element in elements]),
        group=column([element.group for element in elements]),
        patch=column([number if element.patch < 0 else element.patch for number, element in enumerate(elements)]),
        edges=np.ascontiguousarray(enclosure.edges[None], np.float64),
        cell_start=start,
        cell_element=entries,
        grid=grid,
        n_plain=np.array([enclosure.n_plain], np.int32),
        n_group=np.array([len(enclosure.names)], np.int32),
    )


def motion_at_rest() -> Motion:
    """A container that stands still."""
    return Motion(
        kind=np.zeros(1, np.int32),
        wave=np.zeros((1, 1, 5)),
        series=np.zeros((1, 1, 3)),
        timing=np.zeros((1, 8)),
        displacement=np.zeros((1, 3)),
        velocity=np.zeros((1, 3)),
        acceleration=np.zeros((1, 3)),
    )


def _by_place(position: Real, radius: float) -> NDArray[np.int64]:
    """Order of the particles along a curve that fills space (Morton 1966), so that neighbours have near places."""
    cell = np.floor((position - position.min(axis=0)) / (2.2 * radius)).astype(np.int64)
    key = np.zeros(len(position), np.int64)
    for bit in range(16):
        for c in range(3):
            key |= (cell[:, c] >> bit & 1) << (3 * bit + c)
    return np.argsort(key, kind="stable")
