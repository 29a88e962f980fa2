"""From a described container to the numeric elements of its walls."""

from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from graindamp.dem.interactions import Interactions
from graindamp.dem.laws import NormalLaw
from graindamp.dem.walls import FOAM_FIRST, N_SHAPE, WallKind
from graindamp.spec.container import (
    BoxContainer,
    BoxInsert,
    CylinderContainer,
    CylinderInsert,
    FoamLid,
    MeshContainer,
    SphereContainer,
    StarInsert,
    WallsContainer,
    with_number,
)
from graindamp.spec.simulation import DamperSpec

if TYPE_CHECKING:
    from graindamp.dem.mesh_features import MeshFeatures

Real = NDArray[np.float64]

FOAM_TURN_SPEED = 1e-3
"""Speed over which the hysteresis of foam turns round [m/s]: small beside any motion that matters, large beside
rounding."""


class Element(NamedTuple):
    """One piece of wall."""

    kind: WallKind
    numbers: tuple[float, ...]
    """Its numbers, see :class:`graindamp.dem.walls.WallKind`."""
    material: int
    """Number of its material in the interaction table."""
    group: int
    """Number of the wall its force is counted to."""
    law: int = -1
    """Normal law; -1: that of the damper."""
    patch: int = -1
    """Elements of one patch share the memory of a contact; -1: a patch of its own."""


class Enclosure(NamedTuple):
    """All walls of a damper."""

    names: tuple[str, ...]
    """Names of the walls that forces are counted to."""
    elements: tuple[Element, ...]
    """Plain elements first, then those of meshes."""
    n_plain: int
    """Number of plain elements."""
    edges: Real
    """Planes of the edges at vertices of meshes; (edge, 4)."""
    mesh: "MeshFeatures | None"
    """Features of the mesh, for its grid; None without one."""


def enclosure_of(
    damper: DamperSpec,
    interactions: Interactions,
    lid_height: float | None = None,
    closed: bool = True,
    folder: Path | None = None,
) -> Enclosure:
    """Walls of a damper.

    Args:
        damper: the description.
        interactions: numbering of the materials.
        lid_height: distance of the lid's wall from the wall opposite to it [m]; None: as the container is described.
        closed: False leaves out lid and lid wall, for pouring.
        folder: what the file of a mesh is relative to.
    """
    container = damper.container
    names = [*container.wall_names]
    if isinstance(damper.lid, FoamLid):
        names.append("foam")
    names += list(with_number(damper.inserts))
    group = {name: number for number, name in enumerate(names)}
    elements: list[Element] = []
    edges = np.zeros((1, 4))
    mesh: MeshFeatures | None = None
    lid_wall = damper.lid_wall if damper.lid is not None else damper._wall_above()

    def plane(name: str, point: Real, normal: Real, radius: float | None = None) -> None:
        if name == lid_wall:
            if not closed:
                return
            if lid_height is not None:
                floor, up = _floor(damper)
                point = floor + lid_height * up
        kind, rim = (WallKind.PLANE, ()) if radius is None else (WallKind.DISC, (radius,))
        elements.append(Element(kind, (*point, *normal, *rim), interactions.wall[name], group[name]))
        if name in interactions.backing:
            behind = point - normal * _thickness(damper, name)
            elements.append(Element(kind, (*behind, *normal, *rim), interactions.backing[name], group[name]))

    if isinstance(container, CylinderContainer):
        axis = _unit(container.axis)
        plane("start", np.zeros(3), axis)
        plane("end", container.length * axis, -axis)
        for material, extra in _layers(damper, interactions, "side"):
            numbers = (0.0, 0.0, 0.0, *axis, container.radius + extra)
            elements.append(Element(WallKind.CYLINDER_INSIDE, numbers, material, group["side"]))
    elif isinstance(container, BoxContainer):
        for c, letter in enumerate("xyz"):
            plane(letter + "-", np.zeros(3), _unit(letter))
            plane(letter + "+", container.size[c] * _unit(letter), -_unit(letter))
    elif isinstance(container, SphereContainer):
        for material, extra in _layers(damper, interactions, "wall"):
            numbers = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, container.radius + extra)
            elements.append(Element(WallKind.SPHERE_INSIDE, numbers, material, group["wall"]))
    elif isinstance(container, WallsContainer):
        for wall in container.planes:
            plane(wall.name, np.asarray(wall.point), np.asarray(wall.normal), wall.radius)

    if isinstance(damper.lid, FoamLid) and closed:
        floor, up = _floor(damper)
        point = floor + up * damper.lid.relaxed_height
        foam = np.zeros(N_SHAPE)
        foam[:3], foam[3:6] = point, -up
        foam[FOAM_FIRST : FOAM_FIRST + 3] = np.asarray(damper.lid.polynomial) * _foam_scale(damper)
        foam[FOAM_FIRST + 3], foam[FOAM_FIRST + 4] = damper.lid.loss_factor, FOAM_TURN_SPEED
        assert lid_wall is not None
        elements.append(
            Element(WallKind.PLANE, tuple(foam), interactions.wall[lid_wall], group["foam"], law=NormalLaw.FOAM)
        )

    for number, (name, insert) in enumerate(with_number(damper.inserts).items()):
        material = interactions.insert[number]
        if isinstance(insert, StarInsert):
            assert isinstance(container, CylinderContainer)
            for beam in insert.beams(container.axis, container.radius):
                elements.append(Element(WallKind.BOX_SOLID, _box(beam), material, group[name]))
        elif isinstance(insert, BoxInsert):
            elements.append(Element(WallKind.BOX_SOLID, _box(insert), material, group[name]))
        else:
            elements.append(Element(WallKind.CYLINDER_SOLID, _bar(insert), material, group[name]))
    n_plain = len(elements)
    if isinstance(container, MeshContainer):
        from graindamp.dem.mesh import read_mesh

        path = Path(container.file) if folder is None else folder / container.file
        mesh = read_mesh(path, container.length_unit)
        more, edges = _mesh_elements(mesh, interactions.wall["mesh"], group["mesh"], n_plain)
        elements += more
    return Enclosure(tuple(names), tuple(elements), n_plain, edges, mesh)


def _unit(axis: str) -> Real:
    unit = np.zeros(3)
    unit["xyz".index(axis)] = 1.0
    return unit


def _thickness(damper: DamperSpec, wall: str) -> float:
    coating = damper.container.walls[wall].coating
    assert coating is not None
    return coating.thickness


def _layers(damper: DamperSpec, interactions: Interactions, wall: str) -> list[tuple[int, float]]:
    """Material of the surface of a curved wall, and of what lies behind its coating, with the way to it [m]."""
    layers = [(interactions.wall[wall], 0.0)]
    if wall in interactions.backing:
        layers.append((interactions.backing[wall], _thickness(damper, wall)))
    return layers


def _floor(damper: DamperSpec) -> tuple[Real, Real]:
    """A point of the wall opposite to the lid, and the unit vector from it to the lid."""
    up = -np.asarray(damper.pour_direction)
    container = damper.container
    if isinstance(container, BoxContainer) and up.min() < 0.0:
        return np.asarray(container.size), up
    if isinstance(container, CylinderContainer) and up.min() < 0.0:
        return container.length * np.abs(up), up
    if isinstance(container, WallsContainer):
        for wall in container.planes:
            if np.dot(wall.normal, up) > 1.0 - 1e-9:
                return np.asarray(wall.point), up
    return np.zeros(3), up


def _foam_scale(damper: DamperSpec) -> float:
    """1 for a force per particle; the square of the mean diameter for a pressure [m^2]."""
    assert isinstance(damper.lid, FoamLid)
    if damper.lid.coefficients is not None:
        return 1.0
    from graindamp.dem.sizes import mean_particle

    volume, _ = mean_particle(damper.particles)
    return float((6.0 * volume / np.pi) ** (2.0 / 3.0))


def _mesh_elements(mesh: "MeshFeatures", material: int, group: int, n_before: int) -> tuple[list[Element], Real]:
    """Faces, edges and vertices of a mesh in the order of its grid, and the planes of its vertices."""
    elements = []
    n_patch = int(mesh.face_patch.max()) + 1
    for f in range(len(mesh.face_patch)):
        numbers = (*mesh.face_plane[f], *mesh.face_border[f].ravel())
        elements.append(Element(WallKind.FACE, numbers, material, group, patch=n_before + int(mesh.face_patch[f])))
    for e in range(len(mesh.edge_end)):
        numbers = (*mesh.edge_border[e].ravel(), *mesh.edge_end[e, 0])
        elements.append(Element(WallKind.EDGE, numbers, material, group, patch=n_before + n_patch + e))
    for v in range(len(mesh.vertex_position)):
        numbers = (*mesh.vertex_position[v], float(mesh.vertex_start[v]), float(mesh.vertex_start[v + 1]))
        patch = n_before + n_patch + len(mesh.edge_end) + v
        elements.append(Element(WallKind.VERTEX, numbers, material, group, patch=patch))
    return elements, mesh.vertex_border if len(mesh.vertex_border) else np.zeros((1, 4))


def _box(insert: BoxInsert) -> tuple[float, ...]:
    c, s = np.cos(insert.angle), np.sin(insert.angle)
    k = "xyz".index(insert.axis)
    turn = np.eye(3)
    a, b = (k + 1) % 3, (k + 2) % 3
    turn[a, a], turn[a, b], turn[b, a], turn[b, b] = c, -s, s, c
    return (*insert.center, *(0.5 * np.asarray(insert.size)), *turn[:, 0], *turn[:, 1])


def _bar(insert: CylinderInsert) -> tuple[float, ...]:
    start, end = np.asarray(insert.start), np.asarray(insert.end)
    length = float(np.linalg.norm(end - start))
    return (*start, *((end - start) / length), insert.radius, length)
