"""A container of any shape: the faces, edges and vertices of a closed triangle mesh that a particle can touch.

Why these, and when. A sphere with centre c touches the surface wherever a point p of it is a local minimum of the
distance |c - p|: there the sphere, grown from c, meets the surface first, and the wall pushes along c - p. At every
other point the surface comes nearer to c in some direction, so that point is under the sphere only because a nearer one
is. Moving p by ds along a direction e in the surface changes the distance by -(c - p) . e / |c - p| ds, hence p is a
local minimum if (c - p) . e <= 0 for every e that leaves p within the surface:

- inside a face e takes every direction of its plane: c lies above p on the normal;
- on an edge e takes its two directions, so c - p is normal to it, and those into its two faces, m_A and m_B: both
  (c - p) . m_A <= 0 and (c - p) . m_B <= 0. On a flat edge m_B = -m_A leaves only equality, where p is the foot of c on
  both faces and already counted; on a concave edge (a corner of the cavity) such a c is inside the wall. So flat and
  concave edges need nothing, and a sphere that rolls over a plane made of triangles feels a plane;
- at a vertex every e is a sum, with positive weights, of two neighbouring edges, so the edges e_k decide. If the e_k do
  not fit in a half-space there is no such c, and the vertex cannot be touched.

Each condition compares c with a plane through the feature. Two features that meet share that plane as the same four
numbers, and the boundary belongs to the face before the edge before the vertex, so that rounding leaves no centre
between them without contact, or with two. Triangles of one plane form a patch, and use one normal: the rounding of
their corners opens no gap either.

A limit: a finely divided hollow cylinder of radius R meets a sphere of radius r on R / (R - r) of its facets on
average, each with its own force. Where r is not small against R, use the cylinder itself.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from graindamp.dem.triangles import Surface, half_edges

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


class MeshFeatures(NamedTuple):
    """What particles can touch. A plane is four numbers (n, o); `side` of a centre c is n . c - o [m].

    A sphere of centre c and radius r touches
    - face f at distance s = side of its plane if 0 < s < r and the sides of its three borders are all >= 0; the faces
      of one patch share plane and foot, so several of one patch are one contact;
    - edge e, at the foot of c on the line, if that is nearer than r, the sides of borders 0 and 1 (into its two faces)
      are < 0, that of border 2 (its start) is >= 0 and that of border 3 (its end) is <= 0;
    - vertex v if it is nearer than r and the sides of all its borders, rows start[v] to start[v + 1], are < 0.
    """

    face_vertex: Floats  # [m] (face, 3, 3), counter-clockwise as seen by a particle
    face_patch: Ints  # [-] (face,)
    face_plane: Floats  # [-], [m] (face, 4), unit normal into the cavity and offset, the same within a patch
    face_border: Floats  # [-], [m] (face, 3, 4), unit normals into the triangle, from corner k to the next
    edge_end: Floats  # [m] (edge, 2, 3), start and end
    edge_border: Floats  # [-], [m] (edge, 4, 4), m_A, m_B, direction at the start, direction at the end
    edge_patch: Ints  # [-] (edge, 2)
    vertex_position: Floats  # [m] (vertex, 3)
    vertex_start: Ints  # [-] (vertex + 1,)
    vertex_border: Floats  # [-], [m] (border, 4), directions of the edges that leave the vertex


def features_of(surface: Surface) -> MeshFeatures:
    """Features of a closed surface. Edges in one line between two patches become one edge."""
    corner = surface.vertex[surface.face]
    order, ends = half_edges(surface.face)
    forward = surface.face.reshape(-1)[order[0::2]] == ends[0::2, 0]
    pair = order.reshape(-1, 2)
    half = np.where(forward[:, None], pair, pair[:, ::-1])  # of faces A and B; that of A runs along `end`
    patch, plane = _patches(corner, half // 3, surface.rounding)

    swap = patch[half[:, 0] // 3] > patch[half[:, 1] // 3]  # A is the patch of lower number: a ridge has one direction
    half = np.where(swap[:, None], half[:, ::-1], half)
    end = np.where(swap[:, None], ends[0::2, ::-1], ends[0::2])
    sides = patch[half // 3]
    direction = _unit(surface.vertex[end[:, 1]] - surface.vertex[end[:, 0]])
    normal = plane[patch][half // 3][:, :, :3]
    rise = np.einsum("ij,ij->i", np.cross(normal[:, 1], -direction), normal[:, 0])  # m_B . n_A, below 0 where convex
    convex = (sides[:, 0] != sides[:, 1]) & (rise < 0)

    end, ridge = _ridges(surface, end, sides, convex)
    base = surface.vertex[end[:, 0]]
    direction = _unit(surface.vertex[end[:, 1]] - base)
    inward = _unit(np.stack([np.cross(normal[:, 0], direction), np.cross(normal[:, 1], -direction)], axis=1))
    into = np.stack([_through(inward[:, k], base) for k in (0, 1)], axis=1)
    border = np.empty((len(corner) * 3, 4))
    border[half] = into
    starting = _through(direction, base)
    ending = _through(direction, surface.vertex[end[:, 1]])
    concave = np.nonzero((sides[:, 0] != sides[:, 1]) & ~convex)[0]
    position, start, leaving = _vertices(surface, plane[patch][:, :3], end, starting, ending, ridge, concave)
    return MeshFeatures(
        face_vertex=corner,
        face_patch=patch,
        face_plane=plane[patch],
        face_border=border.reshape(-1, 3, 4),
        edge_end=surface.vertex[end[ridge]],
        edge_border=np.stack([into[ridge, 0], into[ridge, 1], starting[ridge], ending[ridge]], axis=1),
        edge_patch=sides[ridge],
        vertex_position=position,
        vertex_start=start,
        vertex_border=leaving,
    )


def _unit(vector: Floats) -> Floats:
    return np.asarray(vector / np.linalg.norm(vector, axis=-1, keepdims=True))


def _through(normal: Floats, point: Floats) -> Floats:
    """Planes through points: unit normals and offsets, shape (n, 4)."""
    return np.concatenate([normal, np.einsum("ij,ij->i", normal, point)[:, None]], axis=1)


def _patches(corner: Floats, pair: Ints, rounding: float) -> tuple[Ints, Floats]:
    """Patch of each face and plane of each patch, grown from its largest triangle over all that lie in its plane."""
    cross = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    twice_area = np.linalg.norm(cross, axis=1)
    normal = cross / twice_area[:, None]
    neighbour = np.concatenate([pair, pair[:, ::-1]])
    neighbour = neighbour[np.argsort(neighbour[:, 0], kind="stable"), 1].reshape(-1, 3).tolist()
    flat: list[list[float]] = corner.reshape(-1, 9).tolist()
    facing: list[list[float]] = normal.tolist()
    patch = [-1] * len(corner)
    n_patch = 0
    for seed in np.argsort(-twice_area, kind="stable").tolist():
        if patch[seed] >= 0:
            continue
        patch[seed] = n_patch
        members, n_before = [seed], 0
        while len(members) > n_before:  # the plane of many triangles reaches farther than that of the first
            n_before = len(members)
            one = _unit(cross[members].sum(axis=0))
            nx, ny, nz = one.tolist()
            offset = float(np.average(corner[members].mean(axis=1) @ one, weights=twice_area[members]))
            waiting = list(members)
            while waiting:
                for f in neighbour[waiting.pop()]:
                    if patch[f] >= 0 or facing[f][0] * nx + facing[f][1] * ny + facing[f][2] * nz <= 0:
                        continue
                    v = flat[f]
                    if all(abs(v[k] * nx + v[k + 1] * ny + v[k + 2] * nz - offset) <= rounding for k in (0, 3, 6)):
                        patch[f] = n_patch
                        members.append(f)
                        waiting.append(f)
        n_patch += 1
    number = np.array(patch, dtype=np.int64)
    total, centre, weight = np.zeros((n_patch, 3)), np.zeros((n_patch, 3)), np.zeros(n_patch)
    np.add.at(total, number, cross)
    np.add.at(centre, number, corner.mean(axis=1) * twice_area[:, None])
    np.add.at(weight, number, twice_area)
    return number, _through(_unit(total), centre / weight[:, None])


def _ridges(surface: Surface, end: Ints, sides: Ints, convex: NDArray[np.bool_]) -> tuple[Ints, Ints]:
    """Joins convex edges that continue each other: their ends become those of the whole ridge.

    Returns:
        Ends of each edge (edge, 2), and the number of one edge for every ridge.
    """
    number = np.nonzero(convex)[0]
    if len(number) == 0:
        return end, number
    touching = np.repeat(number, 2), end[number].ravel()
    key = np.column_stack([sides[touching[0]], touching[1]])
    order = np.lexsort(key.T)
    same = (key[order][1:] == key[order][:-1]).all(axis=1)
    one, two = touching[0][order][:-1][same], touching[0][order][1:][same]
    n = len(end)
    _, label = connected_components(coo_array((np.ones(len(one), bool), (one, two)), shape=(n, n)), directed=False)
    by_label = number[np.argsort(label[number], kind="stable")]
    runs = np.split(by_label, np.nonzero(np.diff(label[by_label]))[0] + 1)
    end = end.copy()
    ridge = []
    for run in runs:
        if len(run) > 1:
            vertex = np.unique(end[run])
            point = surface.vertex[vertex]
            length = np.linalg.norm(surface.vertex[end[run, 1]] - surface.vertex[end[run, 0]], axis=1)
            longest = run[np.argmax(length)]
            along = point @ (surface.vertex[end[longest, 1]] - surface.vertex[end[longest, 0]])
            low, high = vertex[np.argmin(along)], vertex[np.argmax(along)]
            line = _unit(surface.vertex[high] - surface.vertex[low])
            away = np.linalg.norm(np.cross(point - surface.vertex[low], line), axis=1)
            if away.max() <= surface.rounding and len(vertex) == len(run) + 1:
                end[run] = low, high
                ridge.append(run[0])
                continue
        ridge.extend(run)
    return end, np.array(ridge, dtype=np.int64)


def _vertices(
    surface: Surface, normal: Floats, end: Ints, starting: Floats, ending: Floats, ridge: Ints, concave: Ints
) -> tuple[Floats, Ints, Floats]:
    """Vertices that can be touched: position, first row of each, and the borders across the edges that leave it.

    A vertex can be touched if some direction d into the cavity has d . e_k < 0 for all its edges. The best is opposite
    to the point nearest to the origin among the weighted means of the e_k (Wolfe 1976, Mathematical Programming 11,
    128-149); it points into the cavity if it does so against the normals there weighted by their angles (Baerentzen &
    Aanaes 2005, IEEE Transactions on Visualization and Computer Graphics 11, 243-253).
    """
    leaving: dict[int, list[Floats]] = {}
    for e in ridge.tolist():
        leaving.setdefault(int(end[e, 0]), []).append(starting[e])
        leaving.setdefault(int(end[e, 1]), []).append(-ending[e])
    from scipy.optimize import nnls  # takes half a second, and few dampers are meshes

    tips = {v for v, rows in leaving.items() if len(rows) >= 3}  # a tip has three convex edges or more
    for e in concave.tolist():
        for v, row in ((int(end[e, 0]), starting[e]), (int(end[e, 1]), -ending[e])):
            if v in tips:
                leaving[v].append(row)
    facing = _vertex_normals(surface, normal)
    kept, borders = [], []
    for v in sorted(tips):
        rows = np.array(leaving[v])
        away = facing[v]
        if (rows[:, :3] @ away).max() > -1e-9:
            weight, _ = nnls(np.vstack([rows[:, :3].T, np.ones(len(rows))]), np.array([0.0, 0.0, 0.0, 1.0]))
            away = -rows[:, :3].T @ weight
            length = float(np.linalg.norm(away))
            if length < 1e-9 or (rows[:, :3] @ away).max() > -1e-9 * length or away @ facing[v] <= 0:
                continue
        kept.append(v)
        borders.append(rows)
    start = np.cumsum([0, *(len(rows) for rows in borders)]).astype(np.int64)
    return surface.vertex[kept], start, np.concatenate(borders) if borders else np.empty((0, 4))


def _vertex_normals(surface: Surface, normal: Floats) -> Floats:
    """Unit normals at the vertices, those of the faces weighted by their angles."""
    corner = surface.vertex[surface.face]
    total = np.zeros_like(surface.vertex)
    for k in range(3):
        one, two = (_unit(corner[:, (k + n) % 3] - corner[:, k]) for n in (1, 2))
        angle = np.arctan2(np.linalg.norm(np.cross(one, two), axis=1), np.einsum("ij,ij->i", one, two))
        np.add.at(total, surface.face[:, k], normal * angle[:, None])
    return np.asarray(total / np.maximum(np.linalg.norm(total, axis=1, keepdims=True), 1e-300))
