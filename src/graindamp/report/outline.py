"""The walls of a container as surfaces to draw: triangles of every wall, and the lines in which a plane cuts them."""

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from graindamp.spec.container import BoxContainer, CylinderContainer, MeshContainer, SphereContainer
from graindamp.spec.simulation import DamperSpec

if TYPE_CHECKING:
    from graindamp.dem.container import Element, Enclosure

Real = NDArray[np.float64]

_BAR_SIDES = 64
_MARGIN = 0.15
"""Endless planes are drawn this share of the bed's size beyond it [-]."""


def wall_triangles(damper: DamperSpec, enclosure: "Enclosure", reach: tuple[Real, Real]) -> dict[str, Real]:
    """Triangles of every wall and insert in the container's frame [m], by name; each (triangle, 3, 3).

    The lid stands where the enclosure has it. Of a coated wall its surface is drawn.

    Args:
        damper: the description.
        enclosure: the walls as the engine has them.
        reach: lowest and highest coordinates of the particles [m], each (3,), for planes that have no end.
    """
    from graindamp.dem.vtk import tessellate_box, tessellate_cylinder, tessellate_sphere
    from graindamp.dem.walls import WallKind

    container = damper.container
    planes = _planes(enclosure)
    walls: dict[str, Real] = {}
    low, high = reach
    if isinstance(container, CylinderContainer):
        axis = np.eye(3)["xyz".index(container.axis)]
        start, end = (
            float(planes[name].numbers[:3] @ axis) if name in planes else default
            for name, default in (("start", 0.0), ("end", container.length))
        )
        length = (end - start) * axis
        walls["container"] = tessellate_cylinder((start * axis).tolist(), length.tolist(), container.radius, _BAR_SIDES)
        across = container.radius * (1.0 - axis)
        low, high = start * axis - across, end * axis + across
    elif isinstance(container, BoxContainer):
        low, high = np.zeros(3), np.asarray(container.size, dtype=np.float64)
        for c, letter in enumerate("xyz"):
            for name, corner in ((letter + "-", low), (letter + "+", high)):
                if name in planes:
                    corner[c] = planes[name].numbers[c]
        walls["container"] = tessellate_box(low.tolist(), high.tolist())
    elif isinstance(container, SphereContainer):
        walls["container"] = tessellate_sphere((0.0, 0.0, 0.0), container.radius, _BAR_SIDES)
    elif isinstance(container, MeshContainer) and enclosure.mesh is not None:
        walls["container"] = np.asarray(enclosure.mesh.face_vertex)
    else:
        margin = _MARGIN * float(np.max(high - low))
        low, high = low - margin, high + margin
        for name, plane in planes.items():
            walls[name] = plane_in_box(plane.numbers[:3], plane.numbers[3:6], low, high)
    if "foam" in planes:
        walls["foam"] = plane_in_box(planes["foam"].numbers[:3], planes["foam"].numbers[3:6], low, high)
    pieces = {WallKind.BOX_SOLID: _block, WallKind.CYLINDER_SOLID: _bar, WallKind.DISC: _disc}
    for element in enclosure.elements:
        if element.kind not in pieces:
            continue
        piece = pieces[element.kind](element)
        name = enclosure.names[element.group]
        walls[name] = np.concatenate([walls[name], piece]) if name in walls else piece
    return walls


class _Plane:
    """A flat wall: its numbers as an array."""

    def __init__(self, element: "Element") -> None:
        self.numbers: Real = np.asarray(element.numbers, dtype=np.float64)


def _planes(enclosure: "Enclosure") -> dict[str, _Plane]:
    """The first plane of each wall; behind a coating there is a second."""
    from graindamp.dem.walls import WallKind

    found: dict[str, _Plane] = {}
    for element in enclosure.elements:
        if element.kind == WallKind.PLANE:
            found.setdefault(enclosure.names[element.group], _Plane(element))
    return found


def _block(element: "Element") -> Real:
    from graindamp.dem.vtk import tessellate_box

    numbers = np.asarray(element.numbers, dtype=np.float64)
    first, second = numbers[6:9], numbers[9:12]
    turn = np.stack([first, second, np.cross(first, second)])
    half = numbers[3:6]
    return np.asarray(tessellate_box((-half).tolist(), half.tolist()) @ turn + numbers[:3])


def _bar(element: "Element") -> Real:
    from graindamp.dem.vtk import tessellate_cylinder

    numbers = np.asarray(element.numbers, dtype=np.float64)
    along = (numbers[7] * numbers[3:6]).tolist()
    return np.asarray(tessellate_cylinder(numbers[:3].tolist(), along, numbers[6], _BAR_SIDES))


def _disc(element: "Element") -> Real:
    numbers = np.asarray(element.numbers, dtype=np.float64)
    across = np.cross(numbers[3:6], np.eye(3)[np.argmin(np.abs(numbers[3:6]))])
    across /= np.linalg.norm(across)
    turn = np.linspace(0.0, 2.0 * np.pi, _BAR_SIDES + 1)[:, None]
    rim = numbers[:3] + numbers[6] * (np.cos(turn) * across + np.sin(turn) * np.cross(numbers[3:6], across))
    return np.stack([np.broadcast_to(numbers[:3], (_BAR_SIDES, 3)), rim[:-1], rim[1:]], axis=1)


def plane_in_box(point: Real, normal: Real, low: Real, high: Real) -> Real:
    """Triangles of the part of a plane inside a box [m], (triangle, 3, 3); none where they do not meet.

    Args:
        point: a point of the plane [m].
        normal: its unit normal [-].
        low: lowest corner of the box [m].
        high: highest corner of the box [m].
    """
    corner = np.array([[(low, high)[(n >> a) & 1][a] for a in range(3)] for n in range(8)])
    pairs = np.array([(n, n | 1 << a) for n in range(8) for a in range(3) if not n >> a & 1])
    begin, end = corner[pairs[:, 0]], corner[pairs[:, 1]]
    height, rise = (begin - point) @ normal, (end - begin) @ normal
    with np.errstate(divide="ignore", invalid="ignore"):
        share = -height / rise
    meets = (np.abs(rise) > 1e-12) & (share >= -1e-9) & (share <= 1.0 + 1e-9)
    hit = begin[meets] + share[meets, None] * (end - begin)[meets]
    if len(hit) < 3:
        return np.zeros((0, 3, 3))
    across = np.cross(normal, np.eye(3)[np.argmin(np.abs(normal))])
    other = np.cross(normal, across)
    branch = hit - hit.mean(axis=0)
    hit = hit[np.argsort(np.arctan2(branch @ other, branch @ across))]
    return np.stack([np.broadcast_to(hit[0], (len(hit) - 2, 3)), hit[1:-1], hit[2:]], axis=1)


def cut(triangles: Any, point: Real, normal: Real) -> Real:
    """Lines in which a plane cuts triangles [m], (line, 2, 3).

    Corners are taken to lie a hair beside the plane, so that a plane through corners still gives whole lines.

    Args:
        triangles: (triangle, 3, 3) [m].
        point: a point of the plane [m].
        normal: its unit normal [-].
    """
    corner = np.asarray(triangles, dtype=np.float64).reshape(-1, 3, 3)
    height = (corner - point) @ normal
    hair = 1e-9 * (float(np.ptp(corner)) if corner.size else 1.0)
    above = height > hair * 0.618
    crossed = above.any(axis=1) & ~above.all(axis=1)
    corner, height, above = corner[crossed], height[crossed], above[crossed]
    alone = np.where(above.sum(axis=1) == 1, above.argmax(axis=1), (~above).argmax(axis=1))
    row = np.arange(len(corner))
    apex, apex_height = corner[row, alone], height[row, alone]
    ends = []
    for k in (1, 2):
        other = (alone + k) % 3
        share = apex_height / np.where(apex_height == height[row, other], 1.0, apex_height - height[row, other])
        ends.append(apex + np.clip(share, 0.0, 1.0)[:, None] * (corner[row, other] - apex))
    return np.stack(ends, axis=1) if len(corner) else np.zeros((0, 2, 3))
