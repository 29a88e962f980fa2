"""Walls as surfaces to draw, the lines in which a plane cuts them, and the side that a container is seen from."""

import numpy as np
import pytest

from graindamp.dem.container import enclosure_of
from graindamp.dem.interactions import interactions_of
from graindamp.report.motion_picture import view_of
from graindamp.report.outline import cut, plane_in_box, wall_triangles
from runs_made import BORE, LENGTH, description

STEEL, ALUMINIUM = "steel-s235", "aluminium-6060"
X, Y, Z = np.eye(3)


def surfaces(container, lid_height=None, **more):
    damper = {
        "particles": [{"material": STEEL, "radius": 1e-3}],
        "fill": {"count": 20},
        "container": {"material": ALUMINIUM} | container,
        "contact": {"restitution": 0.6, "friction": 0.2},
    } | more
    damper = description(damper=damper).damper
    enclosure = enclosure_of(damper, interactions_of(damper), lid_height)
    reach = np.array([-5e-3, -5e-3, 0.0]), np.array([5e-3, 5e-3, 4e-3])
    return wall_triangles(damper, enclosure, reach)


def span(triangles):
    corners = triangles.reshape(-1, 3)
    return np.concatenate([corners.min(axis=0), corners.max(axis=0)])


def length(lines):
    return float(np.linalg.norm(lines[:, 1] - lines[:, 0], axis=1).sum())


def test_a_lying_cylinder_is_cut_to_a_rectangle():
    walls = surfaces({"kind": "cylinder", "axis": "x", "radius": BORE, "length": LENGTH})
    lines = cut(walls["container"], np.zeros(3), Y)
    assert length(lines) == pytest.approx(2 * LENGTH + 4 * BORE)
    assert np.allclose(span(lines), [0, 0, -BORE, LENGTH, 0, BORE], atol=1e-9)
    circle = cut(walls["container"], 0.5 * LENGTH * X, X)
    assert length(circle) == pytest.approx(2 * np.pi * BORE, rel=1e-3)  # 64 sides: 1 - (pi/64)^2/6


def test_the_lid_shortens_the_container():
    walls = surfaces(
        {"kind": "cylinder", "axis": "x", "radius": BORE, "length": LENGTH},
        0.03,
        lid={"kind": "rigid", "clearance": 1e-3},
    )
    assert span(walls["container"])[3] == pytest.approx(0.03)


def test_a_box_with_inserts_and_foam():
    walls = surfaces(
        {"kind": "box", "size": [0.02, 0.02, 0.03]},
        0.025,
        lid={"kind": "foam", "height": 0.02, "travel": 5e-3, "coefficients": [100.0, 0.0, 0.0]},
        inserts=[
            {"kind": "box", "name": "block", "material": STEEL, "center": [0.01, 0.01, 0.01],
             "size": [4e-3, 2e-3, 2e-3], "axis": "z", "angle": np.pi / 2},
            {"kind": "cylinder", "name": "bar", "material": STEEL, "start": [0.0, 0.01, 0.005],
             "end": [0.02, 0.01, 0.005], "radius": 1e-3},
        ],
    )  # fmt: skip
    assert np.allclose(span(walls["container"]), [0, 0, 0, 0.02, 0.02, 0.025])
    assert np.allclose(span(walls["block"]), [9e-3, 8e-3, 9e-3, 11e-3, 12e-3, 11e-3])  # a quarter turn
    assert np.allclose(span(walls["bar"]), [0, 9e-3, 4e-3, 0.02, 11e-3, 6e-3], atol=1e-5)
    assert np.allclose(span(walls["foam"]), [0, 0, 0.02, 0.02, 0.02, 0.02])


def test_a_star_is_one_wall():
    star = {"kind": "star", "name": "star", "material": STEEL, "position": 0.02, "arms": 4, "width": 2e-3}
    walls = surfaces({"kind": "cylinder", "axis": "x", "radius": BORE, "length": LENGTH}, inserts=[star])
    assert len(walls["star"]) == 24


def test_a_sphere():
    walls = surfaces({"kind": "sphere", "radius": BORE})
    assert length(cut(walls["container"], np.zeros(3), Y)) == pytest.approx(2 * np.pi * BORE, rel=1e-3)


def test_planes_without_end_are_drawn_beyond_the_bed():
    planes = [
        {"name": "floor", "point": [0, 0, 0], "normal": "z"},
        {"name": "slope", "point": [0, 0, 0], "normal": [1, 0, 1]},
    ]
    walls = surfaces({"kind": "walls", "planes": planes})
    assert np.allclose(span(walls["floor"]), [-6.5e-3, -6.5e-3, 0, 6.5e-3, 6.5e-3, 0])
    assert np.allclose(walls["slope"].reshape(-1, 3) @ (X + Z), 0.0, atol=1e-12)


def test_a_plane_beside_a_box_is_not_seen():
    assert not len(plane_in_box(5 * Z, Z, np.zeros(3), np.ones(3)))
    assert not len(cut(np.zeros((0, 3, 3)), np.zeros(3), Z))


def test_gravity_points_down_and_motion_to_the_right():
    view = view_of(description(), X)
    assert np.allclose([view.right, view.up, view.toward], [X, Z, -Y])
    assert view.names == ("x", "z")


@pytest.mark.parametrize(
    ("gravity", "direction", "right", "up"),
    [("-z", Z, X, Z), ("-x", X, Y, X), ("none", X, X, Z), ("none", Z, Z, Y), ("-y", -X, -X, Y)],
)
def test_views(gravity, direction, right, up):
    spec = description()
    gravity = description(damper=spec.damper.model_dump() | {"gravity": gravity}).damper.gravity
    spec = spec.model_copy(update={"damper": spec.damper.model_copy(update={"gravity": gravity})})
    view = view_of(spec, direction)
    assert np.allclose([view.right, view.up], [right, up])
    assert np.allclose(np.cross(view.right, view.up), view.toward)
