"""A container of any shape, from the file of a closed triangle mesh: its contacts, its inside and the search for both.

What a particle can touch is in `mesh_features`, how a file becomes a closed surface in `triangles`.
"""

from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from graindamp.dem.mesh_features import MeshFeatures, features_of
from graindamp.dem.triangles import closed_surface, in_mm, read_triangles, signed_volume, winding_number
from graindamp.errors import InputError

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

_NUMBERS_AT_ONCE = 2_000_000  # distances in memory at a time: about 6 arrays of 16 MB
_CELLS_ALLOWED = 20_000_000


class WallContact(NamedTuple):
    """One contact of a sphere with a mesh."""

    overlap: float  # [m]
    normal: Floats  # [-] (3,), from the wall to the centre
    kind: str  # "face", "edge" or "vertex"
    number: int  # number of the patch, edge or vertex


class FeatureGrid(NamedTuple):
    """Features that a centre in each cell may touch; they count faces first, then edges, then vertices.

    Cell (i, j, k) has row (i * shape[1] + j) * shape[2] + k, and the features feature[start[row] : start[row + 1]].
    """

    origin: Floats  # [m] (3,), lowest corner of the mesh
    cell: float  # [m] edge of a cell
    shape: tuple[int, int, int]
    start: Ints  # [-] (cell + 1,)
    feature: Ints  # [-] (entry,)


def read_mesh(path: Path | str, length_unit: str) -> MeshFeatures:
    """Features of the closed surface in an STL, OBJ or PLY file; particles move in the volume that it encloses.

    Several bodies are read as one cavity, the largest, and solid obstacles within it.

    Args:
        path: the file.
        length_unit: unit of its numbers, such as "mm".

    Raises:
        InputError: trimesh is not installed; the file cannot be read; the surface is not closed, has no volume, or its
            bodies are not one cavity with separate obstacles.
    """
    return features_of(closed_surface(read_triangles(path, length_unit), Path(path).name))


def side(plane: Floats, centre: Floats) -> Floats:
    """Distances of a centre (3,) from planes (..., 4) [m], positive on the side of their normals.

    Written out in this order wherever it is used: two features that share a plane then agree to the last bit.
    """
    return np.asarray(plane[..., 0] * centre[0] + plane[..., 1] * centre[1] + plane[..., 2] * centre[2] - plane[..., 3])


def closest_contacts(features: MeshFeatures, centre: Floats, radius: float) -> list[WallContact]:
    """Contacts of one sphere, at most one for each patch, by the rules of `MeshFeatures` over all features.

    This is the reference for compiled searches; it takes a time in proportion to the number of features.

    Args:
        features: the mesh.
        centre: centre of the sphere, in the cavity [m], shape (3,).
        radius: its radius [m].
    """
    contacts = []
    height = side(features.face_plane, centre)
    hit = (height > 0) & (height < radius) & (side(features.face_border, centre) >= 0).all(axis=1)
    for f in np.nonzero(hit)[0][np.unique(features.face_patch[hit], return_index=True)[1]]:
        normal = features.face_plane[f, :3]
        contacts.append(WallContact(radius - float(height[f]), normal, "face", int(features.face_patch[f])))

    border = side(features.edge_border, centre)
    hit = (border[:, 0] < 0) & (border[:, 1] < 0) & (border[:, 2] >= 0) & (border[:, 3] <= 0)
    for e in np.nonzero(hit)[0]:
        direction = features.edge_border[e, 2, :3]
        from_start = centre - features.edge_end[e, 0]
        branch = from_start - (from_start @ direction) * direction
        distance = float(np.linalg.norm(branch))
        if distance < radius:
            contacts.append(WallContact(radius - distance, branch / distance, "edge", int(e)))

    for v, position in enumerate(features.vertex_position):
        rows = features.vertex_border[features.vertex_start[v] : features.vertex_start[v + 1]]
        distance = float(np.linalg.norm(centre - position))
        if distance < radius and (side(rows, centre) < 0).all():
            contacts.append(WallContact(radius - distance, (centre - position) / distance, "vertex", v))
    return contacts


def volume(features: MeshFeatures) -> float:
    """Volume of the cavity, without its obstacles [m^3]."""
    return -signed_volume(features.face_vertex)


def bounds(features: MeshFeatures) -> tuple[Floats, Floats]:
    """Lowest and highest coordinates of the cavity [m], each of shape (3,)."""
    return features.face_vertex.min(axis=(0, 1)), features.face_vertex.max(axis=(0, 1))


def inside(features: MeshFeatures, point: Floats) -> NDArray[np.bool_]:
    """Whether points (n, 3) [m] lie in the cavity and in no obstacle, by the winding number."""
    low, high = bounds(features)
    result: NDArray[np.bool_] = np.asarray(((point >= low) & (point <= high)).all(axis=1))
    if result.any():
        result[result] = winding_number(features.face_vertex, point[result]) < -0.5
    return result


def wall_distance(features: MeshFeatures, point: Floats) -> Floats:
    """Distance of points in the cavity from the nearest wall [m]; points of shape (n, 3)."""
    low, high = bounds(features)
    slack = 1e-12 * float(np.linalg.norm(high - low))
    n_face, n_edge, n_vertex = len(features.face_plane), len(features.edge_end), len(features.vertex_position)
    distance = np.empty(len(point))
    step = max(1, _NUMBERS_AT_ONCE // (4 * n_face + 6 * n_edge + 3 * n_vertex + len(features.vertex_border)))
    for first in range(0, len(point), step):
        p = point[first : first + step]
        nearest = np.full(len(p), np.inf)
        height = _sides(features.face_plane, p)
        over = (height >= -slack) & (_sides(features.face_border, p) >= -slack).all(axis=2)
        nearest = np.minimum(nearest, np.where(over, np.maximum(height, 0), np.inf).min(axis=1))
        if n_edge:
            sides = _sides(features.edge_border, p)
            over = (sides[:, :, :3] * np.array([-1, -1, 1]) >= -slack).all(axis=2) & (sides[:, :, 3] <= slack)
            i, e = np.nonzero(over)
            branch = np.cross(p[i] - features.edge_end[e, 0], features.edge_border[e, 2, :3])
            np.minimum.at(nearest, i, np.linalg.norm(branch, axis=1))
        if n_vertex:
            over = np.logical_and.reduceat(
                _sides(features.vertex_border, p) <= slack, features.vertex_start[:-1], axis=1
            )
            i, v = np.nonzero(over)
            np.minimum.at(nearest, i, np.linalg.norm(p[i] - features.vertex_position[v], axis=1))
        distance[first : first + step] = nearest
    return distance


def _sides(plane: Floats, point: Floats) -> Floats:
    """Distances of points (n, 3) from planes (..., 4) [m], shape (n, ...)."""
    return np.asarray(point @ plane[..., :3].reshape(-1, 3).T - plane[..., 3].ravel()).reshape(
        len(point), *plane.shape[:-1]
    )


def refuse_outside(
    features: MeshFeatures, position: Floats, radius: Floats, where: str = "particles", allowed_overlap: float = 0.0
) -> None:
    """Ends unless all particles start within the cavity and clear of its walls.

    Args:
        features: the mesh.
        position: centres [m], shape (particle, 3).
        radius: radii [m], shape (particle,).
        where: what the positions are called, for the message.
        allowed_overlap: overlap with a wall that is accepted [m]; rounding of 1e-9 of a radius always is.

    Raises:
        InputError: a particle lies outside, or overlaps a wall by more than is allowed.
    """
    out = ~inside(features, position)
    low, high = bounds(features)
    if out.any():
        i = int(np.argmax(out))
        raise InputError(
            f"{where}: {np.count_nonzero(out)} of {len(position)} centres lie outside the cavity, the first, number "
            f"{i}, at {in_mm(position[i])}; the cavity reaches from {in_mm(low)} to {in_mm(high)}: move or remove "
            "them, or check the length unit of the mesh"
        )
    overlap = radius - wall_distance(features, position)
    deep = overlap > allowed_overlap + 1e-9 * radius
    if deep.any():
        i = int(np.argmax(deep))
        raise InputError(
            f"{where}: {np.count_nonzero(deep)} of {len(position)} overlap the wall, the first, number {i}, at "
            f"{in_mm(position[i])} by {1e3 * float(overlap[i]):.4g} mm; allowed are {1e3 * allowed_overlap:.4g} mm: "
            "move or remove them"
        )


def face_grid(features: MeshFeatures, cell: float, reach: float) -> FeatureGrid:
    """For each cell the faces, edges and vertices that a sphere with its centre in it may touch.

    A feature is listed where its bounding box, widened by `reach`, meets the cell, unless one of its own conditions
    fails in the whole cell. Nothing that can be touched is left out; centres outside the mesh belong to no cell.

    Args:
        features: the mesh.
        cell: edge of a cell [m].
        reach: largest radius of a particle, with any margin [m].

    Raises:
        ValueError: more than 20 million cells.
    """
    low, high = bounds(features)
    n = [max(1, int(np.ceil(length / cell))) for length in (high - low).tolist()]
    if n[0] * n[1] * n[2] > _CELLS_ALLOWED:
        raise ValueError(
            f"a grid of {n[0]} x {n[1]} x {n[2]} cells of {cell:g} m is too fine; {_CELLS_ALLOWED} are allowed"
        )
    slack = 1e-9 * float(np.linalg.norm(high - low))
    row = np.arange(n[0] * n[1] * n[2], dtype=np.int64).reshape(n)
    rows, numbers = [], []
    for number, (points, planes, reaching) in enumerate(_conditions(features, reach)):
        first = np.clip(np.floor((points.min(axis=0) - reach - slack - low) / cell), 0, np.array(n) - 1).astype(int)
        last = np.clip(np.floor((points.max(axis=0) + reach + slack - low) / cell), 0, np.array(n) - 1).astype(int)
        i, j, k = (np.arange(first[a], last[a] + 1) for a in range(3))
        middle = [low[a] + cell * (index + 0.5) for a, index in enumerate((i, j, k))]
        # The largest side of a plane within a cell is that of its middle plus half the cell's width along the normal.
        half = 0.5 * cell * np.abs(planes[:, :3]).sum(axis=1) + slack + reaching
        x, y, z = (np.multiply.outer(planes[:, a], middle[a]) for a in range(3))
        largest = (
            x[:, :, None, None] + y[:, None, :, None] + z[:, None, None, :] + (half - planes[:, 3])[:, None, None, None]
        )
        found = row[first[0] : last[0] + 1, first[1] : last[1] + 1, first[2] : last[2] + 1][(largest >= 0).all(axis=0)]
        rows.append(found)
        numbers.append(np.full(len(found), number, dtype=np.int64))
    cells = np.concatenate(rows)
    order = np.argsort(cells, kind="stable")
    start = np.concatenate([[0], np.cumsum(np.bincount(cells, minlength=row.size))]).astype(np.int64)
    return FeatureGrid(low, float(cell), (n[0], n[1], n[2]), start, np.concatenate(numbers)[order])


def _conditions(features: MeshFeatures, reach: float) -> list[tuple[Floats, Floats, Floats]]:
    """Points and planes of each feature, and what is added to their sides [m] to be >= 0 where it can be touched."""
    face_reach = np.array([0.0, reach, 0.0, 0.0, 0.0])
    sign = np.array([-1.0, -1.0, 1.0, -1.0])[:, None]
    plane, start = features.face_plane, features.vertex_start
    result = [
        (points, np.vstack([plane[f], -plane[f], features.face_border[f]]), face_reach)
        for f, points in enumerate(features.face_vertex)
    ]
    result += [(points, sign * features.edge_border[e], np.zeros(4)) for e, points in enumerate(features.edge_end)]
    for v, position in enumerate(features.vertex_position):
        rows = features.vertex_border[start[v] : start[v + 1]]
        result.append((position[None], -rows, np.zeros(len(rows))))
    return result
