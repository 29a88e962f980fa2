"""Mesh containers: what is read, what is refused, and the contacts against exact distances."""

import sys

import numpy as np
import pytest

from graindamp.dem.mesh import (
    bounds,
    closest_contacts,
    face_grid,
    inside,
    read_mesh,
    refuse_outside,
    side,
    volume,
    wall_distance,
)
from graindamp.dem.mesh_features import features_of
from graindamp.dem.triangles import closed_surface, winding_number
from graindamp.errors import InputError

trimesh = pytest.importorskip("trimesh")
creation = trimesh.creation


def features(*meshes):
    """Features of bodies given in metres."""
    return features_of(closed_surface(np.concatenate([np.asarray(mesh.triangles) for mesh in meshes]), "made"))


def saved(mesh, folder, name="part.stl"):
    path = folder / name
    mesh.export(path)
    return path


def l_shape():
    """A prism over an L of unit arms: legs x to 2 and y to 2, height 1; the edge at (1, 1) sticks into the cavity."""
    outline = np.array([[0, 0], [2, 0], [2, 1], [1, 1], [1, 2], [0, 2]], float)
    flat = [(0, 1, 2), (0, 2, 3), (0, 3, 4), (0, 4, 5)]
    low, high = np.c_[outline, np.zeros(6)], np.c_[outline, np.ones(6)]
    faces = [low[[a, c, b]] for a, b, c in flat] + [high[[a, b, c]] for a, b, c in flat]
    for k in range(6):
        j = (k + 1) % 6
        faces += [np.array([low[k], low[j], high[j]]), np.array([low[k], high[j], high[k]])]
    return np.array(faces)


def nearest_points(corners, point):
    """Point of each triangle nearest to a point, the best of plane, edges and corners: it shares no formula"""
    a, b, c = np.moveaxis(corners, 1, 0)
    normal = np.cross(b - a, c - a)
    weight = np.linalg.solve(np.stack([b - a, c - a, normal], axis=2), (point - a)[:, :, None])[:, :, 0]
    within = (weight[:, 0] >= 0) & (weight[:, 1] >= 0) & (weight[:, 0] + weight[:, 1] <= 1)
    tried = [np.where(within[:, None], point - weight[:, 2:] * normal, np.inf)]
    for u, v in ((a, b), (b, c), (c, a)):
        t = np.clip(((point - u) * (v - u)).sum(axis=1) / ((v - u) ** 2).sum(axis=1), 0, 1)
        tried.append(u + t[:, None] * (v - u))
    best = np.argmin([np.linalg.norm(point - q, axis=1) for q in tried], axis=0)
    return np.array(tried)[best, np.arange(len(a))]


def local_minima(corners, point):
    """Local minima of the distance from the point: nearest to it in every triangle that they belong to."""
    nearest = nearest_points(corners, point)
    found = []
    for q in np.unique(nearest.round(10), axis=0):
        holding = np.linalg.norm(nearest_points(corners, q) - q, axis=1) < 1e-9
        if (np.linalg.norm(nearest[holding] - q, axis=1) < 1e-9).all():
            found.append(q)
    return np.unique(np.round(found, 8), axis=0)


def distance_to_box(point, half):
    """Distance of an outer point from a box of half widths around the origin, and its direction."""
    branch = point - np.clip(point, -half, half)
    length = np.linalg.norm(branch)
    return length, branch / length


def test_box_in_millimetres(tmp_path):
    box = read_mesh(saved(creation.box((20, 30, 40)), tmp_path), "mm")
    assert volume(box) == pytest.approx(24e-6, rel=1e-12)  # rounding
    low, high = bounds(box)
    assert np.allclose(high - low, [0.02, 0.03, 0.04], rtol=1e-12)
    assert len(box.face_vertex) == 12
    assert len(np.unique(box.face_patch)) == 6
    assert len(box.edge_end) == len(box.vertex_position) == 0  # all its edges are corners of the cavity
    assert (side(box.face_plane, np.zeros(3)) > 0).all()  # the centre lies on the inner side of all faces


@pytest.mark.parametrize("suffix", ["stl", "obj", "ply"])
def test_formats_agree(tmp_path, suffix):
    mesh = creation.cylinder(radius=10, height=30, sections=64)
    cylinder = read_mesh(saved(mesh, tmp_path, f"part.{suffix}"), "mm")
    polygon = 32 * np.sin(2 * np.pi / 64) * 0.01**2
    assert volume(cylinder) == pytest.approx(polygon * 0.03, rel=1e-6)  # numbers of 24 bits in the file
    assert len(np.unique(cylinder.face_patch)) == 66
    assert len(cylinder.edge_end) == 0


def test_normals_either_way_and_mixed():
    mesh = creation.icosphere(subdivisions=2, radius=0.01)
    corners = np.array(mesh.triangles)
    corners[::3] = corners[::3, ::-1]
    mixed = features_of(closed_surface(corners, "made"))
    assert (side(mixed.face_plane, np.zeros(3)) > 0).all()
    assert volume(mixed) == pytest.approx(mesh.volume, rel=1e-12)


@pytest.mark.parametrize(("name", "unit", "message"), [
    ("absent.stl", "mm", "no such file"),
    ("part.step", "mm", "allowed are .stl, .obj, .ply"),
    ("part.stl", "kg", "length unit 'kg'"),
])  # fmt: skip
def test_wrong_files(tmp_path, name, unit, message):
    saved(creation.box((1, 1, 1)), tmp_path)
    with pytest.raises(InputError, match=message):
        read_mesh(tmp_path / name, unit)


@pytest.mark.parametrize("content", [b"", b"nonsense", b"solid a\nendsolid a\n", bytes(90)])
@pytest.mark.parametrize("suffix", ["stl", "obj", "ply"])
def test_unreadable_files_are_named(tmp_path, content, suffix):
    path = tmp_path / f"broken.{suffix}"
    path.write_bytes(content)
    with pytest.raises(InputError, match=rf"^broken\.{suffix}: "):
        read_mesh(path, "mm")


def test_missing_trimesh_says_what_to_install(tmp_path, monkeypatch):
    path = saved(creation.box((1, 1, 1)), tmp_path)
    monkeypatch.setitem(sys.modules, "trimesh", None)
    with pytest.raises(InputError, match=r"pip install graindamp\[geom\]"):
        read_mesh(path, "mm")


def test_open_surface_says_where(tmp_path):
    mesh = creation.box((20, 20, 20))
    gone = np.arange(12) == 5
    at = mesh.triangles[5][0]
    mesh.update_faces(~gone)
    with pytest.raises(InputError, match="3 open edges") as error:
        read_mesh(saved(mesh, tmp_path), "mm")
    assert "mm" in str(error.value)
    assert f"{at[0]:g}" in str(error.value)


def test_edge_of_four_triangles_is_refused():
    one, two = creation.box((1, 1, 1)), creation.box((1, 1, 1))
    two.apply_translation((1, 1, 0))
    with pytest.raises(InputError, match="more than two triangles"):
        features(one, two)


def test_flat_body_is_refused():
    with pytest.raises(InputError, match=r"no area|no volume"):
        features(creation.box((1, 1, 1e-9)))
    with pytest.raises(InputError, match="no volume"):
        closed_surface(creation.box((1, 1, 1)).triangles * [1, 1, 4e-7], "made")  # 1.2 of the rounding, 5e-7


def test_one_sided_surface_is_refused():
    """The projective plane: six vertices, every pair joined, every edge in two of its ten triangles."""
    face = np.array([[0, 1, 2], [0, 2, 3], [0, 3, 4], [0, 4, 5], [0, 5, 1],
                     [1, 2, 4], [2, 3, 5], [3, 4, 1], [4, 5, 2], [5, 1, 3]])  # fmt: skip
    vertex = np.random.default_rng(1).normal(size=(6, 3))
    with pytest.raises(InputError, match="one-sided"):
        closed_surface(vertex[face], "made")


def test_nested_bodies():
    cavity, post = creation.box((4, 4, 4)), creation.box((1, 1, 1))
    both = features(cavity, post)
    assert volume(both) == pytest.approx(63, rel=1e-12)
    assert inside(both, np.array([[0.0, 0, 0], [1, 1, 1], [3, 0, 0]])).tolist() == [False, True, False]
    assert len(both.edge_end) == 12
    assert len(both.vertex_position) == 8
    assert (np.diff(both.vertex_start) == 3).all()
    apart, deep, across = (creation.box((1, 1, 1)), creation.box((0.5, 0.5, 0.5)), creation.box((1, 1, 1)))
    apart.apply_translation((5, 0, 0))
    across.apply_translation((2, 0.1, 0))
    with pytest.raises(InputError, match="outside the largest body"):
        features(cavity, apart)
    with pytest.raises(InputError, match="outside the largest body"):
        features(cavity, across)
    with pytest.raises(InputError, match="inside another obstacle"):
        features(cavity, post, deep)


def test_needles_and_repeats_are_removed():
    """A needle with length but no area lies in the box; one triangle is there twice, one has two equal corners."""
    corners = creation.box((2, 2, 2)).triangles.tolist()
    (a, b, c), rest = np.array(corners[0]), corners[1:]
    lengths = [np.linalg.norm(b - a), np.linalg.norm(c - b), np.linalg.norm(a - c)]
    for _ in range(int(np.argmax(lengths))):
        a, b, c = b, c, a
    middle = 0.3 * a + 0.7 * b  # on the diagonal, which the neighbour has undivided
    made = np.array([*rest, rest[0], [a, middle, c], [middle, b, c], [a, b, middle], [a, a, b]])
    box = features_of(closed_surface(made, "made"))
    assert volume(box) == pytest.approx(8, rel=1e-12)
    assert len(np.unique(box.face_patch)) == 6
    assert len(box.face_vertex) == 14


def test_triangulated_plane_is_a_plane():
    """A tilted floor of irregular triangles: each centre has one contact, at its height over the plane."""
    rng = np.random.default_rng(2)
    box = creation.box((1, 1, 1)).subdivide().subdivide().subdivide()
    floor = box.vertices[:, 2] < -0.49
    inner = floor & (np.abs(box.vertices[:, :2]) < 0.49).all(axis=1)
    box.vertices[inner, :2] += rng.uniform(-0.04, 0.04, (inner.sum(), 2))
    turn = trimesh.transformations.random_rotation_matrix(rng.random(3))
    flat = box.copy()
    box.apply_transform(turn)
    mesh = features(box)
    assert len(np.unique(mesh.face_patch)) == 6
    assert len(mesh.edge_end) == 0
    centre = np.c_[rng.uniform(-0.45, 0.45, (1000, 2)), rng.uniform(-0.499, -0.46, 1000)]
    centre[:50, :2] = flat.vertices[rng.choice(np.nonzero(inner)[0], 50), :2]  # right over the vertices
    for x in centre:
        contacts = closest_contacts(mesh, turn[:3, :3] @ x, 0.045)
        assert [contact.kind for contact in contacts] == ["face"]
        assert contacts[0].overlap == pytest.approx(0.045 - (x[2] + 0.5), abs=1e-15)  # rounding of coordinates near 1
        assert np.allclose(contacts[0].normal, turn[:3, 2], atol=1e-15)


def test_rounding_of_files_keeps_planes_and_edges(tmp_path):
    """Tilted boxes of many triangles, one in the other, through a file of 24 bits: still 12 planes and 12 edges."""
    turn = trimesh.transformations.random_rotation_matrix(np.array([0.3, 0.6, 0.2]))
    cavity, post = creation.box((40, 40, 40)), creation.box((10, 10, 10))
    for _ in range(3):
        cavity, post = cavity.subdivide(), post.subdivide()
    both = trimesh.util.concatenate([cavity, post])
    both.apply_transform(turn)
    mesh = read_mesh(saved(both, tmp_path), "mm")
    assert len(np.unique(mesh.face_patch)) == 12
    assert len(mesh.edge_end) == 12
    assert len(mesh.vertex_position) == 8
    rng = np.random.default_rng(3)
    half = np.full(3, 0.005)
    for _ in range(2000):
        x = rng.uniform(-0.007, 0.007, 3)
        if (np.abs(x) <= half).all():
            continue
        contacts = closest_contacts(mesh, turn[:3, :3] @ x, 0.004)
        exact, normal = distance_to_box(x, half)
        assert len(contacts) == 1  # no gap and no double between triangles of one plane, whatever their rounding
        assert contacts[0].overlap == pytest.approx(
            0.004 - exact, abs=1e-8
        )  # 6e-8 of 40 mm, the file's rounding, thrice
        assert np.allclose(turn[:3, :3].T @ contacts[0].normal, normal, atol=1e-5)


@pytest.mark.parametrize(("made", "n_patch", "n_edge", "n_vertex"), [
    (creation.annulus(0.3, 0.8, 1.0, sections=40), 82, 200, 80),  # the hole's lengthwise edges are concave
    (creation.cylinder(0.8, 1.0, sections=360), 362, 1080, 720),
    (creation.cone(0.7, 1.2, sections=50), 51, 100, 51),
    (creation.icosahedron().subdivide().subdivide(), 20, 30, 12),
])  # fmt: skip
def test_features_survive_a_part_drawn_far_from_the_origin(made, n_patch, n_edge, n_vertex):
    """At 20 times its size from the origin a file rounds to 1e-6 of the part: planes and edges stay what they are."""
    rng = np.random.default_rng(9)
    post, cavity = made.copy(), creation.box((4, 4, 4))
    post.apply_transform(trimesh.transformations.random_rotation_matrix(rng.random(3)))
    place = rng.uniform(-20, 20, 3)
    corners = (np.concatenate([cavity.triangles, post.triangles]) + place).astype(np.float32).astype(float)
    mesh = features_of(closed_surface(corners, "made"))
    found = len(np.unique(mesh.face_patch)) - 6, len(mesh.edge_end), len(mesh.vertex_position)
    assert found == (n_patch, n_edge, n_vertex)
    point = place + rng.uniform(-1.2, 1.2, (200, 3))
    for x in point[inside(mesh, point)][:40]:
        exact = np.linalg.norm(nearest_points(mesh.face_vertex, x) - x, axis=1).min()
        nearest = 9 - max(contact.overlap for contact in closest_contacts(mesh, x, 9.0))
        assert nearest == pytest.approx(exact, abs=3e-6)  # 1e-6 per coordinate, spacing of 24-bit numbers from 16 to 32


def test_obstacle_against_exact_distance_to_box():
    """Around a convex box there is one contact, the nearest point: face, edge and vertex in turn."""
    mesh = features(creation.box((8, 8, 8)), creation.box((2, 2, 2)).subdivide())
    rng = np.random.default_rng(4)
    kinds = set()
    for x in rng.uniform(-2.2, 2.2, (1500, 3)):
        if (np.abs(x) <= 1).all():
            continue
        exact, normal = distance_to_box(x, np.ones(3))
        (contact,) = closest_contacts(mesh, x, 1.75) if exact < 1.7 else (None,)
        if contact is not None:
            kinds.add(contact.kind)
            assert contact.overlap == pytest.approx(1.75 - exact, abs=1e-14)  # rounding
            assert np.allclose(contact.normal, normal, atol=1e-14)
    assert kinds == {"face", "edge", "vertex"}


def test_exactly_over_edges_and_vertices_one_contact():
    """The boundary between two features belongs to one of them."""
    mesh = features(creation.box((8, 8, 8)), creation.box((2, 2, 2)).subdivide())
    steps = (-1.5, -1.0, -0.5, 0.0, 0.5, 1.0, 1.5)
    for x in np.stack(np.meshgrid(steps, steps, steps), axis=-1).reshape(-1, 3):
        if (np.abs(x) > 1).any():
            assert len(closest_contacts(mesh, x, 1.0)) == 1


def test_concave_corner_is_three_planes():
    mesh = features(creation.box((2, 2, 2)).subdivide())
    contacts = closest_contacts(mesh, np.array([-0.95, -0.93, -0.91]), 0.1)
    assert [contact.kind for contact in contacts] == ["face"] * 3
    assert sorted(contact.overlap for contact in contacts) == pytest.approx([0.01, 0.03, 0.05], abs=1e-15)
    assert np.allclose(sorted(contact.normal.tolist() for contact in contacts), [[0, 0, 1], [0, 1, 0], [1, 0, 0]])


def test_l_shape_has_one_edge_and_no_vertex():
    mesh = features_of(closed_surface(l_shape(), "made"))
    assert volume(mesh) == pytest.approx(3, rel=1e-12)
    assert len(mesh.edge_end) == 1
    assert len(mesh.vertex_position) == 0  # its ends lie in the floor and in the lid
    (contact,) = closest_contacts(mesh, np.array([0.9, 0.8, 0.5]), 0.3)
    assert contact.kind == "edge"
    assert contact.overlap == pytest.approx(0.3 - np.hypot(0.1, 0.2), abs=1e-15)
    assert np.allclose(contact.normal, np.array([-0.1, -0.2, 0]) / np.hypot(0.1, 0.2), atol=1e-14)


def spiky(rng):
    """A ball with random dents and spikes: convex, concave and saddle vertices."""
    ball = creation.icosphere(subdivisions=2, radius=1.0)
    ball.vertices *= rng.uniform(0.6, 1.4, (len(ball.vertices), 1))
    return ball


def test_contacts_are_the_local_minima_of_distance():
    """Between a spiky cavity and a spiky obstacle each local minimum is one contact, the nearest is the distance."""
    rng = np.random.default_rng(5)
    cavity, post = spiky(rng), spiky(rng)
    post.apply_scale(0.3)
    mesh = features(cavity, post)
    point = rng.uniform(-1, 1, (30, 3))
    point = point[inside(mesh, point)]
    distance = wall_distance(mesh, point)
    kinds = []
    for x, d in zip(point[:2], distance, strict=False):
        contacts = closest_contacts(mesh, x, 10.0)
        kinds += [contact.kind for contact in contacts]
        found = [x - (10 - contact.overlap) * contact.normal for contact in contacts]
        exact = local_minima(mesh.face_vertex, x)
        seen = exact[inside(mesh, exact + 1e-6 * (x - exact))]  # the others are minima as seen from behind the wall
        assert np.allclose(np.unique(np.round(found, 8), axis=0), seen, atol=2e-8)
        assert d == pytest.approx(np.linalg.norm(exact - x, axis=1).min(), abs=2e-8)
        assert d == pytest.approx(10 - max(contact.overlap for contact in contacts), rel=1e-12)
    assert min(kinds.count(kind) for kind in ("face", "edge", "vertex")) >= 2


def test_inside_by_winding_number():
    rng = np.random.default_rng(7)
    mesh = features_of(closed_surface(l_shape(), "made"))
    point = rng.uniform(-0.5, 2.5, (3000, 3))
    x, y, z = point.T
    exact = (x > 0) & (y > 0) & (z > 0) & (z < 1) & (((x < 2) & (y < 1)) | ((x < 1) & (y < 2)))
    assert (inside(mesh, point) == exact).all()
    assert np.allclose(np.abs(winding_number(mesh.face_vertex, point)), exact, atol=1e-9)


def test_particles_outside_or_in_the_wall_are_named():
    mesh = features(creation.box((0.02, 0.02, 0.02)))
    radius = np.full(3, 0.001)
    position = np.array([[0, 0, 0], [0.009, 0, 0], [0, 0, 0.005]])
    refuse_outside(mesh, position, radius)  # one touches exactly
    with pytest.raises(InputError, match=r"1 of 3 centres.*number 2, at \(0, 0, 15\) mm"):
        refuse_outside(mesh, position + np.array([[0, 0, 0], [0, 0, 0], [0, 0, 0.01]]), radius)
    shifted = position + np.array([0.0002, 0, 0])
    with pytest.raises(InputError, match=r"1 of 3 overlap the wall, .*number 1, at \(9.2, 0, 0\) mm by 0.2 mm"):
        refuse_outside(mesh, shifted, radius)
    refuse_outside(mesh, shifted, radius, allowed_overlap=0.00021)


@pytest.mark.parametrize("cell", [0.15, 0.4, 5.0])
def test_grid_leaves_out_nothing(cell):
    rng = np.random.default_rng(8)
    cavity, post = spiky(rng), spiky(rng)
    post.apply_scale(0.3)
    mesh = features(cavity, post)
    grid = face_grid(mesh, cell, reach=0.2)
    n_face, n_edge = len(mesh.face_plane), len(mesh.edge_end)
    point = rng.uniform(-1.4, 1.4, (400, 3))
    n_contact = 0
    for x in point[inside(mesh, point)]:
        i, j, k = np.minimum((x - grid.origin) // grid.cell, np.array(grid.shape) - 1).astype(int)
        row = (i * grid.shape[1] + j) * grid.shape[2] + k
        listed = set(grid.feature[grid.start[row] : grid.start[row + 1]].tolist())
        for contact in closest_contacts(mesh, x, 0.2):
            n_contact += 1
            faces = np.nonzero(mesh.face_patch == contact.number)[0].tolist()
            wanted = {"face": faces, "edge": [n_face + contact.number], "vertex": [n_face + n_edge + contact.number]}
            assert listed & set(wanted[contact.kind])
    assert n_contact > 100
    assert grid.start[-1] == len(grid.feature)
    with pytest.raises(ValueError, match="too fine"):
        face_grid(mesh, 1e-4, 0.2)
