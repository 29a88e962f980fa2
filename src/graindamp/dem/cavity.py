"""The free space of a container: where particles find room, how far walls are, how high a bed stands.

A level is a height over the lowest point of the container, against the direction of pouring.
"""

from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from graindamp.dem.compile import compiled
from graindamp.dem.container import Enclosure
from graindamp.dem.laws import NormalLaw
from graindamp.dem.walls import FAR, N_SHAPE, WallKind, nearest
from graindamp.errors import InputError
from graindamp.spec.container import (
    BoxContainer,
    BoxInsert,
    CylinderContainer,
    CylinderInsert,
    SphereContainer,
    WallsContainer,
    unit_vector,
    with_number,
)
from graindamp.spec.simulation import DamperSpec

Real = NDArray[np.float64]

N_POINT = 1_000_000
"""Points that measure free volume; evenly spread, they give the level of a bed to a few parts in 1e4."""

N_POINT_MESH = 40_000
"""Points in a mesh, where each is tried against every triangle."""

RSA_ROUNDS = 400
"""Rounds in which particles without a place look for one; at a solid fraction of 0.25 about 60 are needed."""


class Cavity:
    """Free space of one damper's container while it is filled."""

    def __init__(self, damper: DamperSpec, enclosure: Enclosure, solid_volume: float) -> None:
        """Space within the walls of `enclosure`; endless planes are cut to a place for `solid_volume` [m^3]."""
        self.damper = damper
        self.enclosure = enclosure
        self.up = -np.asarray(damper.pour_direction, np.float64)
        first = np.eye(3)[int(np.argmin(np.abs(self.up)))]
        first = first - (first @ self.up) * self.up
        first /= np.linalg.norm(first)
        self.frame = np.stack([first, np.cross(self.up, first), self.up])
        """Two unit vectors across and one up."""
        self.bounded = True
        """Whether walls stand all round."""
        self.depth: float | None = None
        """Height of the wall or lid that closes the container above what is poured [m]; None without."""
        hard = [element for element in enclosure.elements[: enclosure.n_plain] if element.law != NormalLaw.FOAM]
        self.kind = np.array([element.kind for element in hard], np.int32)
        self.shape = np.zeros((len(hard), N_SHAPE))
        for row, element in zip(self.shape, hard, strict=True):
            row[: len(element.numbers)] = element.numbers
        self._find_bounds(solid_volume)

    def _find_bounds(self, solid_volume: float) -> None:
        """Lowest point, and extent across [m]."""
        container = self.damper.container
        if isinstance(container, WallsContainer):
            self._find_bounds_of_planes(container, solid_volume)
            return
        if isinstance(container, SphereContainer):
            extent = np.full(3, container.radius)
            self.low, self.high = -extent, extent
        elif isinstance(container, CylinderContainer):
            axis = np.asarray(unit_vector(container.axis))
            along = self.frame @ axis * container.length
            across = container.radius * np.sqrt(np.maximum(1.0 - (self.frame @ axis) ** 2, 0.0))
            self.low, self.high = np.minimum(along, 0.0) - across, np.maximum(along, 0.0) + across
        else:
            if isinstance(container, BoxContainer):
                corners = np.array(np.meshgrid(*([0.0, size] for size in container.size))).reshape(3, -1).T
            else:
                assert self.enclosure.mesh is not None
                corners = self.enclosure.mesh.face_vertex.reshape(-1, 3)
            seen = corners @ self.frame.T
            self.low, self.high = seen.min(axis=0), seen.max(axis=0)
        self.floor = float(self.low[2])
        self.depth = float(self.high[2] - self.low[2])

    def _find_bounds_of_planes(self, container: WallsContainer, solid_volume: float) -> None:
        """As :meth:`_find_bounds`; where planes leave a side open, the place is as wide as high."""
        from scipy.optimize import linprog  # takes half a second

        lid = self.damper.lid_wall
        planes = [plane for plane in container.planes if plane.name != lid]
        normal = np.array([plane.normal for plane in planes]) @ self.frame.T
        offset = np.array([np.dot(plane.point, plane.normal) for plane in planes])
        lowest = linprog([0.0, 0.0, 1.0], A_ub=-normal, b_ub=-offset, bounds=[(None, None)] * 3)
        if lowest.status == 2:
            raise InputError("the planes of the container leave no room between them; check their normals")
        if lowest.status != 0:
            raise InputError(
                f"no plane holds the particles that are poured along {self.damper.pour_direction}: "
                "the container needs a floor, a plane whose normal points against packing.direction"
            )
        width = (solid_volume / 0.25) ** (1.0 / 3.0)
        self.reach(8.0 * width)
        self.floor = float(lowest.fun)
        self.low, self.high = np.array([0.0, 0.0, self.floor]), np.array([0.0, 0.0, np.inf])
        middle = np.asarray(lowest.x)
        for c in range(2):
            ends: list[float | None] = []
            for sense in (1.0, -1.0):
                goal = sense * np.eye(3)[c]
                limits = [(None, None), (None, None), (self.floor, self.floor + 4.0 * width)]
                found = linprog(goal, A_ub=-normal, b_ub=-offset, bounds=limits)
                ends.append(float(found.x[c]) if found.status == 0 else None)
            low, high = ends
            self.bounded = self.bounded and low is not None and high is not None
            if low is None:
                low = middle[c] - 0.5 * width if high is None else high - width
            if high is None:
                high = low + width
            self.low[c], self.high[c] = low, high
        for plane in container.planes:
            if plane.name == lid:
                self.depth = float(np.dot(plane.point, self.up) - self.floor)

    @property
    def straight(self) -> bool:
        """Whether every cross-section is the same, so that the level is twice the height of the centre."""
        container = self.damper.container
        if self.damper.inserts or not self.bounded:
            return not self.bounded
        aligned = np.count_nonzero(np.abs(self.up) > 1e-12) == 1
        if isinstance(container, CylinderContainer):
            return aligned and abs(float(self.up @ np.asarray(unit_vector(container.axis)))) > 0.5
        return aligned and isinstance(container, BoxContainer)

    def gaps(self, position: Real, radius: Real) -> Real:
        """Distance of spheres from the nearest wall or insert [m]; negative where they overlap or lie behind it."""
        out = np.full(len(position), FAR)
        place = np.ascontiguousarray(position, np.float64)
        smallest_gap(self.kind, self.shape, self.enclosure.edges, place, radius, out)
        if self.enclosure.mesh is not None:
            from graindamp.dem.mesh import inside, wall_distance

            inner = inside(self.enclosure.mesh, position)
            far = -2.0 * radius
            far[inner] = wall_distance(self.enclosure.mesh, position[inner]) - radius[inner]
            out = np.minimum(out, far)
        return out

    def free(self, position: Real) -> NDArray[np.bool_]:
        """Whether points lie within all walls and in no insert."""
        gap = np.full(len(position), FAR)
        place = np.ascontiguousarray(position, np.float64)
        smallest_gap(self.kind, self.shape, self.enclosure.edges, place, np.zeros(len(position)), gap)
        out: NDArray[np.bool_] = gap > 0.0
        if self.enclosure.mesh is not None:
            from graindamp.dem.mesh import inside

            out[out] = inside(self.enclosure.mesh, position[out])
        return out

    def level_of(self, position: Real) -> Real:
        """Height of points over the lowest point of the container [m]."""
        return np.asarray(position @ self.up - self.floor)

    def random_points(self, n: int, height: float, rng: np.random.Generator) -> Real:
        """`n` points up to `height`, evenly drawn from the box around the container [m]."""
        low, high = self.low.copy(), self.high.copy()
        high[2] = self.floor + height
        return np.asarray((low + (high - low) * rng.random((n, 3))) @ self.frame)

    @cached_property
    def _levels(self) -> tuple[Real, float, float]:
        """Levels of points spread evenly over the free space, sorted, the volume of each, and how high they reach."""
        height = self.high[2] - self.low[2]
        if self._open:
            height = max(self._reach, 0.0 if np.isinf(height) else height)
        n = N_POINT if self.enclosure.mesh is None else N_POINT_MESH
        # Additive recurrence of the plastic number (Roberts 2018), more even than random points.
        ratio = 1.2207440846057596 ** -np.arange(1.0, 4.0)
        place = np.mod(0.5 + np.outer(np.arange(1, n + 1), ratio), 1.0)
        extent = self.high - self.low
        extent[2] = height
        point = (self.low + extent * place) @ self.frame
        level = np.sort(self.level_of(point[self.free(point)]))
        return level, float(np.prod(extent)) / n, float(height)

    _open = False
    _reach = 0.0

    def reach(self, height: float) -> None:
        """Take the space as open above, and measure it up to `height` [m]."""
        self._open, self._reach = True, height
        self.__dict__.pop("_levels", None)

    def area(self) -> float:
        """Cross-section of a straight container [m^2]."""
        container = self.damper.container
        if isinstance(container, CylinderContainer):
            return float(np.pi * container.radius**2)
        return float(np.prod(self.high[:2] - self.low[:2]))

    def volume_below(self, level: float) -> float:
        """Free volume below a level [m^3]."""
        if self.straight and self.bounded:
            return self.area() * level
        levels, each, _ = self._levels
        return float(np.searchsorted(levels, level)) * each

    def free_volume(self) -> float:
        """Free volume of the whole container [m^3]: of the description, less its inserts."""
        container = self.damper.container
        if container.volume is not None and not self.damper.inserts:
            return container.volume
        assert self.depth is not None
        return self.volume_below(self.depth)

    def level_with(self, volume: float) -> float:
        """Level below which the free volume is `volume` [m]; beyond the points measured, as if straight."""
        if self.straight and self.bounded:
            return volume / self.area()
        levels, each, height = self._levels
        place = volume / each
        if place < len(levels):
            return float(np.interp(place, np.arange(len(levels)), levels))
        return height * place / max(len(levels), 1)

    def bed_level(self, position: Real, radius: Real) -> float:
        """Level up to which the free space, filled evenly, has its centre where the bed has the centre of its volume
        [m]."""
        centre = float(np.average(self.level_of(position), weights=radius**3))
        if self.straight:
            return 2.0 * centre
        levels, _, height = self._levels
        running = np.cumsum(levels) / np.arange(1, len(levels) + 1)
        if centre >= running[-1]:
            return height
        return float(np.interp(centre, running, levels))

    def insert_levels(self) -> list[tuple[str, float, float]]:
        """Name, lowest and highest level of every insert [m]."""
        found = []
        container = self.damper.container
        for name, insert in with_number(self.damper.inserts).items():
            if isinstance(insert, CylinderInsert):
                ends = self.level_of(np.array([insert.start, insert.end]))
                slant = (ends[1] - ends[0]) / np.linalg.norm(np.subtract(insert.end, insert.start))
                side = insert.radius * np.sqrt(max(1.0 - slant**2, 0.0))
                found.append((name, float(ends.min() - side), float(ends.max() + side)))
                continue
            if isinstance(insert, BoxInsert):
                boxes: tuple[BoxInsert, ...] = (insert,)
            else:
                assert isinstance(container, CylinderContainer)
                boxes = insert.beams(container.axis, container.radius)
            for box in boxes:
                k = "xyz".index(box.axis)
                turn = np.eye(3)
                a, b = (k + 1) % 3, (k + 2) % 3
                turn[a, a] = turn[b, b] = np.cos(box.angle)
                turn[b, a] = np.sin(box.angle)
                turn[a, b] = -turn[b, a]
                half = 0.5 * float(np.abs(self.up @ turn) @ np.asarray(box.size))
                middle = float(self.level_of(np.asarray(box.center)))
                found.append((name, middle - half, middle + half))
        return found

    def with_lid(self, closed: Enclosure, level: float) -> "Cavity":
        """The same space closed at `level` by the lid's wall of `closed`, which has it where the container ends."""
        wall = self.damper.lid_wall or self.damper._wall_above()
        if wall is None:
            return self
        number = closed.names.index(wall)
        assert self.depth is not None
        move = np.zeros(N_SHAPE)
        move[:3] = (level - self.depth) * self.up
        elements = tuple(
            element._replace(numbers=tuple(np.asarray(element.numbers) + move[: len(element.numbers)]))
            if element.group == number and element.kind == WallKind.PLANE
            else element
            for element in closed.elements
        )
        return Cavity(self.damper, closed._replace(elements=elements), 0.0)


@compiled
def smallest_gap(kind: NDArray[np.int32], shape: Real, edges: Real, position: Real, radius: Real, out: Real) -> None:
    """Write the distance from the surface of each sphere to the nearest element, where smaller, to `out` [m]."""
    for i in range(len(position)):
        for e in range(len(kind)):
            x, y, z = position[i, 0], position[i, 1], position[i, 2]
            found = nearest(kind[e], shape, e, edges, x, y, z, radius[i])
            out[i] = min(out[i], found[0] - radius[i])


def overlapping(position: Real, radius: Real) -> tuple[NDArray[np.int64], Real]:
    """Pairs of spheres that overlap, (pair, 2), and by how much [m]."""
    from scipy.spatial import cKDTree  # takes a third of a second, and stored beds need none

    pairs = cKDTree(position).query_pairs(2.0 * float(radius.max()), output_type="ndarray")
    i, j = pairs[:, 0], pairs[:, 1]
    overlap = radius[i] + radius[j] - np.linalg.norm(position[i] - position[j], axis=1)
    touching = overlap > 0.0
    return pairs[touching], overlap[touching]


def random_places(cavity: Cavity, radius: Real, height: float, rng: np.random.Generator) -> Real | None:
    """Places without overlap for spheres up to a level, in the order of `radius` [m]; None where they find no room.

    Random sequential addition, the largest spheres first: in every round all that have no place yet try one each. It
    ends near a solid fraction of 0.38 for equal spheres; beds are begun well below.

    Source: Widom (1966), J. Chem. Phys. 44, 3888-3894.
    """
    n = len(radius)
    place = np.full((n, 3), np.nan)
    left = np.argsort(-radius, kind="stable")
    for _ in range(RSA_ROUNDS):
        offered = np.tile(left, max(1, n // (4 * len(left))))
        point = cavity.random_points(len(offered), height, rng)
        fits = (cavity.gaps(point, radius[offered]) >= 0.0) & (cavity.level_of(point) + radius[offered] <= height)
        offered, point = offered[fits], point[fits]
        done = np.nonzero(~np.isnan(place[:, 0]))[0]
        pairs, _ = (
            overlapping(np.concatenate([place[done], point]), np.concatenate([radius[done], radius[offered]]))
            if len(done) + len(offered) > 1
            else (np.zeros((0, 2), np.int64), None)
        )
        later = pairs.max(axis=1) - len(done)
        good = np.ones(len(offered), bool)
        good[later[later >= 0]] = False
        chosen, first = np.unique(offered[good], return_index=True)
        place[chosen] = point[good][first]
        left = left[np.isnan(place[left, 0])]
        if len(left) == 0:
            return place
    return None
