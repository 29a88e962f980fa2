"""Triangles from a file, made into a closed surface whose normals point into the space of the particles.

The space of the particles is the volume that the surface encloses. Draw the cavity, not the part around it: in a file
with several bodies the largest is the cavity, and closed bodies within it are solid obstacles.
"""

from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from graindamp.errors import InputError
from graindamp.units import to_si

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

ROUNDING = 3e-7
"""Lengths below this fraction of the size of the surface [-] are rounding: STL files hold numbers of 24 bits, 6e-8."""

_SUFFIXES = (".stl", ".obj", ".ply")
_PAIRS_AT_ONCE = 500_000  # solid angles in memory at a time: about 12 arrays of 4 MB each


class Surface(NamedTuple):
    """A closed surface: two triangles at every edge, normals into the space of the particles."""

    vertex: Floats  # [m] (vertex, 3)
    face: Ints  # [-] (face, 3), vertices, counter-clockwise as seen by a particle
    rounding: float  # [m] lengths below this are rounding


def read_triangles(path: Path | str, length_unit: str) -> Floats:
    """Corners of the triangles in an STL, OBJ or PLY file [m], shape (face, 3, 3).

    Args:
        path: the file.
        length_unit: unit of its numbers, such as "mm"; these formats do not hold it.

    Raises:
        InputError: no trimesh, or the file is absent, of another format, unreadable, or without triangles.
    """
    path = Path(path)
    try:
        scale = to_si(f"1 {length_unit}", "m")
    except ValueError as error:
        raise InputError(
            f"{path.name}: length unit {length_unit!r}: {error}; allowed are mm, m, inch and so on"
        ) from None
    if path.suffix.lower() not in _SUFFIXES:
        raise InputError(f"{path.name}: format {path.suffix or 'without suffix'!r}; allowed are {', '.join(_SUFFIXES)}")
    if not path.is_file():
        raise InputError(f"{path}: no such file; give the path of a closed surface in {', '.join(_SUFFIXES)}")
    try:
        import trimesh
    except ImportError:
        raise InputError(
            f"{path.name}: reading a mesh needs trimesh; install it with: pip install graindamp[geom]"
        ) from None
    try:
        mesh = trimesh.load_mesh(path, process=False)
        corners = np.asarray(mesh.triangles, dtype=np.float64)
    except Exception as error:  # each format's reader in trimesh has its own kinds, from ValueError to struct.error
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise InputError(
            f"{path.name}: not readable as {path.suffix[1:].upper()} ({reason}); export it again"
        ) from None
    if len(corners) == 0:
        raise InputError(f"{path.name}: no triangles; export a surface, not points, lines or an empty selection")
    if not np.isfinite(corners).all():
        raise InputError(f"{path.name}: a coordinate is not a finite number; export it again")
    return corners * scale


def closed_surface(corners: Floats, where: str) -> Surface:
    """The closed surface of triangles: vertices merged, triangles without area removed, normals into the cavity.

    Whether triangles cut through each other within one body is not checked.

    Args:
        corners: corners of the triangles [m], shape (face, 3, 3), in any order and winding.
        where: name of their origin, for messages.

    Raises:
        InputError: not closed, one-sided, without volume, or with bodies that are not obstacles within one cavity.
    """
    size = float(np.linalg.norm(np.ptp(corners.reshape(-1, 3), axis=0)))
    rounding = ROUNDING * max(size, float(np.abs(corners).max()))
    vertex, face = _merged(corners, rounding)
    face = _without_needles(vertex, face, rounding, where)
    if len(face) == 0:
        raise InputError(
            f"{where}: the surface has no area; a closed surface around the space of the particles is needed"
        )
    _refuse_open(vertex, face, where)
    face, body = _wound_alike(vertex, face, where)
    return Surface(vertex, _into_the_cavity(vertex, face, body, rounding, where), rounding)


def _merged(corners: Floats, rounding: float) -> tuple[Floats, Ints]:
    """Distinct vertices, and the triangles between them; those that lost a corner or fold onto another are left out."""
    vertex, index = np.unique(corners.reshape(-1, 3) + 0.0, axis=0, return_inverse=True)  # + 0.0 makes -0.0 zero
    pair = cKDTree(vertex).query_pairs(rounding, output_type="ndarray")
    link = coo_array((np.ones(len(pair), bool), (pair[:, 0], pair[:, 1])), shape=(len(vertex), len(vertex)))
    _, label = connected_components(link, directed=False)
    _, first, number = np.unique(label, return_index=True, return_inverse=True)
    return vertex[first], _without_folds(number[index].reshape(-1, 3))


def _without_folds(face: Ints) -> Ints:
    """The triangles with three different corners: one of any repeated, none of two that are back to back."""
    face = face[(face[:, 0] != face[:, 1]) & (face[:, 1] != face[:, 2]) & (face[:, 2] != face[:, 0])]
    lowest = np.argmin(face, axis=1)
    turned = face[np.arange(len(face))[:, None], (lowest[:, None] + np.arange(3)) % 3]
    sign = np.where(turned[:, 1] < turned[:, 2], 1, -1)
    _, first, number = np.unique(np.sort(face, axis=1), axis=0, return_index=True, return_inverse=True)
    net = np.bincount(number.ravel(), weights=sign, minlength=len(first))
    return np.asarray(face[np.sort(first[net != 0])])


def _without_needles(vertex: Floats, face: Ints, rounding: float, where: str) -> Ints:
    """Triangles without those that have length but no area.

    The middle corner b of a needle a b c lies on the edge a c of its neighbour a c d. Leaving the needle out would open
    the surface, so the pair is divided along b d instead.
    """
    for _ in range(100):
        a, b, c = (vertex[face[:, k]] for k in range(3))
        side = np.stack(
            [np.linalg.norm(b - a, axis=1), np.linalg.norm(c - b, axis=1), np.linalg.norm(a - c, axis=1)], 1
        )
        area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
        needle = np.nonzero(area <= rounding * side.max(axis=1))[0]
        if len(needle) == 0:
            return face
        face = face.copy()
        owners: dict[tuple[int, int], list[int]] = {}
        for f, corner in enumerate(face.tolist()):
            for k in range(3):
                u, v = corner[k], corner[(k + 1) % 3]
                owners.setdefault((min(u, v), max(u, v)), []).append(f)
        changed: set[int] = set()
        for f in needle.tolist():
            k = int(np.argmax(side[f]))
            start, end, middle = (int(face[f, (k + n) % 3]) for n in range(3))
            both = owners[min(start, end), max(start, end)]
            if len(both) != 2 or changed & set(both):
                continue
            other = both[0] if both[1] == f else both[1]
            far = next(int(v) for v in face[other] if v not in (start, end))
            face[f], face[other] = (end, middle, far), (middle, start, far)
            changed |= {f, other}
        face = _without_folds(face)
        if not changed:
            break
    middle_point = vertex[face[needle[0] if needle[0] < len(face) else 0]].mean(axis=0)
    raise InputError(
        f"{where}: {len(needle)} triangles have no area and cannot be removed without opening the surface, the first "
        f"near {in_mm(middle_point)}; repair the mesh in the CAD program and export it again"
    )


def half_edges(face: Ints) -> tuple[Ints, Ints]:
    """The 3 face + k half-edges from corner k to the next, sorted so that those of one edge follow each other.

    Returns:
        Number of each half-edge, and its two vertices, lower first; shapes (n,) and (n, 2).
    """
    ends = np.stack([face, np.roll(face, -1, axis=1)], axis=2).reshape(-1, 2)
    ordered = np.sort(ends, axis=1)
    order = np.lexsort((ordered[:, 1], ordered[:, 0]))
    return order.astype(np.int64), ordered[order]


def _refuse_open(vertex: Floats, face: Ints, where: str) -> None:
    order, ends = half_edges(face)
    edge, first, count = np.unique(ends, axis=0, return_index=True, return_counts=True)
    for wrong, what, remedy in (
        (count == 1, "open edges, which belong to one triangle only", "close the surface"),
        (count > 2, "edges shared by more than two triangles", "unite bodies that touch, or part them"),
    ):
        if wrong.any():
            i = np.nonzero(wrong)[0][np.argmin(order[first[wrong]])]
            u, v = vertex[edge[i]]
            raise InputError(
                f"{where}: the surface is not closed: {np.count_nonzero(wrong)} {what}, the first from {in_mm(u)} to "
                f"{in_mm(v)}; {remedy} in the CAD program and export it again"
            )


def _wound_alike(vertex: Floats, face: Ints, where: str) -> tuple[Ints, Ints]:
    """Triangles turned so that neighbours agree, and the number of the body of each.

    Two neighbours agree if they run through their common edge in opposite directions. In the graph of triangles as
    given and as turned, each body falls into two parts that are each other's mirror image; a one-sided body stays in
    one.
    """
    n = len(face)
    order, _ = half_edges(face)
    start = face.reshape(-1)[order]
    one, two = order[0::2] // 3, order[1::2] // 3
    agree = start[0::2] != start[1::2]
    rows = np.concatenate([one, one + n])
    columns = np.concatenate([np.where(agree, two, two + n), np.where(agree, two + n, two)])
    _, part = connected_components(
        coo_array((np.ones(len(rows), bool), (rows, columns)), shape=(2 * n, 2 * n)), directed=False
    )
    _, body = connected_components(coo_array((np.ones(len(one), bool), (one, two)), shape=(n, n)), directed=False)
    if (part[:n] == part[n:]).any():
        f = int(np.argmax(part[:n] == part[n:]))
        raise InputError(
            f"{where}: the surface near {in_mm(vertex[face[f]].mean(axis=0))} is one-sided, it has no inside; repair "
            "the mesh"
        )
    _, root = np.unique(body, return_index=True)
    turn = part[:n] != part[root][body]
    return np.where(turn[:, None], face[:, ::-1], face), body.astype(np.int64)


def _into_the_cavity(vertex: Floats, face: Ints, body: Ints, rounding: float, where: str) -> Ints:
    """Triangles turned so that normals of the largest body point inward, those of the obstacles within it outward."""
    corners = vertex[face]
    n_body = int(body.max()) + 1
    volume = np.array([signed_volume(corners[body == b]) for b in range(n_body)])
    for b in range(n_body):
        part = corners[body == b]
        area = 0.5 * np.linalg.norm(np.cross(part[:, 1] - part[:, 0], part[:, 2] - part[:, 0]), axis=1).sum()
        if abs(volume[b]) <= rounding * area:
            raise InputError(
                f"{where}: the body near {in_mm(part.mean(axis=(0, 1)))} encloses no volume; leave out flat bodies, "
                "or give the surface its thickness"
            )
    size = [float(np.linalg.norm(np.ptp(corners[body == b].reshape(-1, 3), axis=0))) for b in range(n_body)]
    outer = int(np.argmax(size))
    wanted = np.where(np.arange(n_body) == outer, -1.0, 1.0)
    turn = (np.sign(volume) != wanted)[body]
    face = np.where(turn[:, None], face[:, ::-1], face)
    _refuse_crossing(vertex, face, body, outer, where)
    return face


def _refuse_crossing(vertex: Floats, face: Ints, body: Ints, outer: int, where: str) -> None:
    """Bodies must be obstacles inside the cavity; one may stand on a wall, where the winding number is one half."""
    corners = vertex[face]
    for b in range(int(body.max()) + 1):
        own = vertex[np.unique(face[body == b])]
        for other in range(int(body.max()) + 1):
            if b in (other, outer):
                continue
            winding = np.abs(winding_number(corners[body == other], own))
            wrong = winding < 0.25 if other == outer else winding > 0.75
            if wrong.any():
                what = (
                    "outside the largest body or crosses it"
                    if other == outer
                    else "inside another obstacle or crosses it"
                )
                raise InputError(
                    f"{where}: several bodies, of which one lies {what}, first at {in_mm(own[np.argmax(wrong)])}; "
                    "allowed are one cavity and separate solid obstacles within it: unite bodies that cross, in the "
                    "CAD program"
                )


def signed_volume(corners: Floats) -> float:
    """Volume enclosed by triangles [m^3], positive where normals point out of it; corners of shape (face, 3, 3)."""
    if len(corners) == 0:
        return 0.0
    a, b, c = np.moveaxis(corners - corners.mean(axis=(0, 1)), 1, 0)
    return float(np.einsum("ij,ij->", a, np.cross(b, c)) / 6)


def winding_number(corners: Floats, point: Floats) -> Floats:
    """How often triangles wind around points [-]: 1 within a closed surface with normals out of it, 0 outside.

    It is the sum of the solid angles of the triangles over 4 pi, so it does not depend on a direction in which a ray
    might meet an edge. Points nearer to the surface than about 1e-7 of its size give values between.

    Args:
        corners: corners of the triangles [m], shape (face, 3, 3).
        point: points [m], shape (point, 3).

    Source: Van Oosterom & Strackee (1983), IEEE Transactions on Biomedical Engineering 30, 125-126, equation 8.
    """
    origin = 0.5 * (corners.min(axis=(0, 1)) + corners.max(axis=(0, 1)))
    a, b, c = np.moveaxis(corners - origin, 1, 0)
    normal = np.cross(a, b) + np.cross(b, c) + np.cross(c, a)
    triple = np.einsum("ij,ij->i", a, np.cross(b, c))
    total = np.empty(len(point))
    step = max(1, _PAIRS_AT_ONCE // len(corners))
    for first in range(0, len(point), step):
        p = point[first : first + step] - origin
        squared = np.einsum("ij,ij->i", p, p)[:, None]

        def product(u: Floats, v: Floats, p: Floats = p, squared: Floats = squared) -> Floats:
            return np.asarray(np.einsum("ij,ij->i", u, v) - p @ (u + v).T + squared)  # (u - p) . (v - p)

        la, lb, lc = (np.sqrt(np.maximum(product(u, u), 0)) for u in (a, b, c))
        below = la * lb * lc + product(a, b) * lc + product(b, c) * la + product(c, a) * lb
        total[first : first + step] = np.arctan2(triple - p @ normal.T, below).sum(axis=1)
    return np.asarray(total / (2 * np.pi))


def in_mm(point: Floats) -> str:
    """A point [m] as people read it: "(1.5, 0, -3) mm"."""
    return "(" + ", ".join(f"{1e3 * float(x) + 0.0:.6g}" for x in point) + ") mm"
