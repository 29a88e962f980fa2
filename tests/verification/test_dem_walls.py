"""Walls: meshes against the planes they are made of, coatings, foam, and solid bodies inside the container."""

from math import cos, pi, sin, sqrt

import numpy as np
import pytest

from dem_made import (
    FLOOR,
    GRAVITY,
    RIGID,
    STEEL,
    channel,
    damper_of,
    harmonic,
    hertz,
    hertz_time,
    made,
    mass_of,
    state_of,
)
from graindamp.dem.columns import LOSS_LID
from graindamp.dem.energy import energies, velocity_now
from graindamp.dem.engine import run, start
from graindamp.dem.walls import N_SHAPE, WallKind, nearest

RADIUS = 2.5e-3
MASS = mass_of(RADIUS, STEEL["density"])
SIDE = 0.02
"""Inner length of the box [m]."""

BOX = {"kind": "box", "size": [SIDE, SIDE, SIDE]}


@pytest.fixture
def mesh_box(tmp_path):
    """The same box as a surface of twelve triangles, in millimetres."""
    trimesh = pytest.importorskip("trimesh")
    box = trimesh.creation.box(bounds=[[0, 0, 0], [1e3 * SIDE] * 3])
    box.export(tmp_path / "box.stl")
    return {"kind": "mesh", "file": "box.stl", "length_unit": "mm"}, tmp_path


CONTACT = {"restitution": 0.8, "friction": 0.3, "softening": 1000.0}


def in_both(mesh_box, n_step, position, velocity, spin, contact, gravity=(0.0, 0.0, -GRAVITY)):
    """States of the same spheres after `n_step` steps in the boxes of planes and of triangles, and both worlds."""
    mesh, folder = mesh_box
    both = []
    for container in (BOX, mesh):
        damper = damper_of(STEEL, RIGID, container, **contact)
        worlds = made(damper, 4e-6, position, RADIUS, velocity, spin, gravity=gravity, folder=folder)
        both.append(run(worlds, n_step))
    return [np.concatenate(state_of(worlds), axis=1) for worlds in both], both


@pytest.mark.parametrize("tangential", ["tanh", "mindlin"])
def test_bouncing_sphere_in_a_mesh_box(mesh_box, tangential):
    """One sphere on its way through a box, off all walls, against its edges and into its corners."""
    start = ([[0.004, 0.011, 0.013]], [[1.5, -0.9, 0.7]], [[100.0, -250.0, 60.0]])
    (planes, mesh), worlds = in_both(mesh_box, 40_000, *start, {**CONTACT, "tangential": tangential})
    n_hit = [one.record.impact[0, 1].sum() for one in worlds]
    assert n_hit[0] == n_hit[1] > 10
    # Rounding of a length, 1e-18 m, over an overlap of 1e-5 m, magnified by a factor of about two by every hit.
    np.testing.assert_allclose(mesh[:, :3], planes[:, :3], atol=1e-9)
    np.testing.assert_allclose(mesh[:, 3:], planes[:, 3:], rtol=1e-6, atol=1e-8)


@pytest.mark.parametrize("tangential", ["tanh", "mindlin"])
def test_sphere_rolls_over_the_diagonal_of_a_face(mesh_box, tangential):
    """A sphere that rolls and slips from one triangle of the floor to the next keeps its contact and its spring."""
    start = ([[0.004, 0.005, RADIUS]], [[0.25, 0.2, 0.0]], [[0.0, 0.0, 0.0]])
    (planes, mesh), worlds = in_both(mesh_box, 9000, *start, {**CONTACT, "tangential": tangential})
    path = planes[0, :2] - (0.004, 0.005)
    assert path[0] > 5e-3  # well across the middle, on either diagonal
    assert worlds[0].record.impact[0, 1].sum() == worlds[1].record.impact[0, 1].sum() == 1
    np.testing.assert_allclose(mesh, planes, rtol=1e-9, atol=1e-12)  # rounding


@pytest.mark.parametrize("tangential", ["tanh", "mindlin"])
def test_bed_in_a_mesh_box(mesh_box, tangential):
    """Eight spheres that fall together: equal until rounding has been magnified by many collisions."""
    corner = np.array([0.0055, 0.0145])
    place = np.stack(np.meshgrid(corner, corner, corner), -1).reshape(-1, 3)
    velocity = np.random.default_rng(2).normal(0, 0.3, (8, 3))
    (planes, mesh), worlds = in_both(
        mesh_box, 12_000, place, velocity, 0.0 * velocity, {**CONTACT, "tangential": tangential}
    )
    assert worlds[0].record.impact[0].sum() > 12
    np.testing.assert_allclose(mesh[:, :3], planes[:, :3], atol=1e-9)


def bounce(container, position, velocity, inserts=(), radius=RADIUS, lid=None, n_step=400, spin=(0, 0, 0), **contact):
    """Velocity of a sphere after one elastic impact, and its world; stiff, so that it turns on the spot."""
    speed = sqrt(sum(v * v for v in velocity))
    time = hertz_time(hertz(radius, STEEL, RIGID), mass_of(radius, STEEL["density"]), speed)
    worlds = made(
        damper_of(STEEL, RIGID, container, inserts, lid, **contact),
        time / n_step,
        [position],
        radius,
        [velocity],
        [spin],
    )
    for _ in range(10_000):
        worlds = run(worlds, n_step // 4)
        if worlds.clock.counts[0, 3] and not worlds.particles.force[0].any():
            return state_of(worlds)[1][0], worlds
    raise AssertionError("the sphere hit nothing, or never left")


WIDE = {"kind": "walls", "planes": [{"name": "floor", "point": [0, 0, -1.0], "normal": "z"}]}
BLOCK = {
    "kind": "box",
    "material": RIGID,
    "center": [0.1, 0.2, 0.3],
    "size": [0.04, 0.03, 0.02],
    "axis": "z",
    "angle": 0.5,
}
BAR = {"kind": "cylinder", "material": RIGID, "start": [0.1, 0.2, 0.3], "end": [0.13, 0.24, 0.3], "radius": 0.01}


def on_block(local):
    """Place and direction in space of one given in the frame of the block."""
    c, s = cos(BLOCK["angle"]), sin(BLOCK["angle"])
    return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ np.asarray(local, dtype=float)


def normal(*components):
    return np.array(components) / np.linalg.norm(components)


ALONG = normal(0.03, 0.04, 0.0)
"""Axis of the bar."""
ACROSS = np.array([-ALONG[1], ALONG[0], 0.0])

PLACES = {
    "face": (BLOCK, on_block([0.005, -0.004, 0.01]), on_block([0, 0, 1])),
    "other face": (BLOCK, on_block([-0.02, 0.004, 0.003]), on_block([-1, 0, 0])),
    "edge": (BLOCK, on_block([0.02, 0.015, 0.002]), on_block(normal(1.0, 0.6, 0.0))),
    "lower edge": (BLOCK, on_block([0.003, 0.015, -0.01]), on_block(normal(0.0, 0.5, -1.0))),
    "corner": (BLOCK, on_block([0.02, -0.015, 0.01]), on_block(normal(0.7, -0.4, 1.0))),
    "barrel": (BAR, 0.02 * ALONG + 0.01 * normal(*(0.6 * ACROSS + [0, 0, 0.8])), normal(*(0.6 * ACROSS + [0, 0, 0.8]))),
    "end of bar": (BAR, 0.05 * ALONG + 0.004 * ACROSS, ALONG),
    "start of bar": (BAR, -0.003 * ACROSS, -ALONG),
    "rim of bar": (BAR, 0.05 * ALONG + 0.01 * ACROSS, normal(*(ALONG + 0.7 * ACROSS))),
}
"""Insert, point of its surface relative to its centre or start, and direction from there to the sphere."""


@pytest.mark.parametrize("place", PLACES)
def test_force_of_a_solid_body(place):
    """A sphere set against a body at a known overlap feels Hertz' force along the normal of the nearest point."""
    body, point, outward = PLACES[place]
    origin = np.array(body.get("center", body.get("start")))
    overlap = 1e-6
    position = origin + point + (RADIUS - overlap) * outward
    worlds = made(damper_of(STEEL, RIGID, WIDE, [body]), 1e-9, [position], RADIUS)
    expected = hertz(RADIUS, STEEL, RIGID) * overlap**1.5 * outward
    # Rounding of coordinates, 1e-16 of 0.4 m, is 1e-10 of the overlap.
    np.testing.assert_allclose(worlds.particles.force[0, 0, :3], expected, rtol=1e-9, atol=1e-9 * abs(expected).max())
    np.testing.assert_allclose(worlds.record.wall_force[0, 1], -expected, rtol=1e-9, atol=1e-9 * abs(expected).max())


@pytest.mark.parametrize("place", PLACES)
def test_sphere_bounces_off_a_solid_body(place):
    """Elastic and without friction: the velocity is mirrored in the plane of contact."""
    body, point, outward = PLACES[place]
    origin = np.array(body.get("center", body.get("start")))
    speed = 0.1
    side = np.cross(outward, [0.3, 0.5, 0.8])
    velocity = speed * (-outward + 0.3 * side)
    contact = origin + point + RADIUS * outward
    after, _ = bounce(WIDE, contact - 2e-6 / speed * velocity, velocity, [body])
    mirrored = velocity - 2 * (velocity @ outward) * outward
    # Round bodies and edges turn the normal while the sphere moves along, by overlap over radius, 3e-4, and not at
    # faces.
    np.testing.assert_allclose(after, mirrored, atol=2e-3 * speed)
    assert after @ after == pytest.approx(velocity @ velocity, rel=1e-4)  # second order of 400 steps


def test_coating_bottoms_out_on_the_wall_behind_it():
    """Beyond its thickness the layer and the wall push together: two Hertz laws in parallel."""
    layer = {"youngs_modulus": 1e6, "poisson_ratio": 0.45}
    thickness = 2e-4
    container = {**FLOOR, "walls": {"floor": {"coating": {**layer, "thickness": thickness}}}}
    steps = []
    for stiff in (1e8, 1e9):
        wall = {"name": "wall", "youngs_modulus": stiff, "poisson_ratio": 0.3}
        soft, hard = hertz(RADIUS, STEEL, layer), hertz(RADIUS, STEEL, wall)
        force_of = lambda x: soft * x**1.5 + hard * max(x - thickness, 0.0) ** 1.5  # noqa: B023, E731
        for overlap in (0.5 * thickness, 0.999 * thickness, 1.02 * thickness, 1.3 * thickness):
            worlds = made(damper_of(STEEL, wall, container), 1e-9, [[0, 0, RADIUS - overlap]], RADIUS)
            assert worlds.particles.force[0, 0, 2] == pytest.approx(force_of(overlap), rel=1e-10)  # rounding
            stored = 0.4 * soft * overlap**2.5 + 0.4 * hard * max(overlap - thickness, 0.0) ** 2.5
            assert energies(worlds).elastic == pytest.approx(stored, rel=1e-10)
        # An impact that presses the layer through turns round where both have taken up its energy.
        speed, time_step = 1.0, 1e-7
        worlds = made(damper_of(STEEL, wall, container), time_step, [[0, 0, RADIUS]], RADIUS, [[0, 0, -speed]])
        deepest = 0.0
        while not worlds.clock.counts[0, 3] or worlds.particles.force[0].any():
            worlds = run(worlds, 10)
            deepest = max(deepest, RADIUS - worlds.particles.position[0, 0, 2])
        assert deepest > thickness
        low, high = 0.0, 4 * thickness
        for _ in range(60):
            x = (low + high) / 2
            energy = 0.4 * soft * x**2.5 + 0.4 * hard * max(x - thickness, 0.0) ** 2.5
            low, high = (x, high) if energy < 0.5 * MASS * speed**2 else (low, x)
        # Looked at every tenth step: five of some hundred steps off a peak, squared.
        assert deepest == pytest.approx(low, rel=2e-3)
        assert state_of(worlds)[1][0, 2] == pytest.approx(speed, rel=1e-5)
        steps.append(deepest)
    assert steps[1] < steps[0]


def foam(coefficients, loss_factor=0.0, travel=4e-3, preload=0.0):
    height = 2 * RADIUS + 2e-3
    lid = {
        "kind": "foam",
        "wall": "second",
        "height": height,
        "coefficients": list(coefficients),
        "travel": travel,
        "preload": preload,
        "loss_factor": loss_factor,
    }
    return damper_of(STEEL, RIGID, channel(0.05), lid=lid), height - preload


def test_foam_pushes_by_its_polynomial():
    coefficients = (2e3, -3e5, 4e8)
    damper, surface = foam(coefficients, preload=5e-4)
    for compression in (-1e-4, 1e-4, 1e-3, 2.5e-3):
        worlds = made(damper, 1e-7, [[0, 0, surface - RADIUS + compression]], RADIUS)
        x = max(compression, 0.0)
        force = coefficients[0] * x + coefficients[1] * x**2 + coefficients[2] * x**3
        energy = coefficients[0] * x**2 / 2 + coefficients[1] * x**3 / 3 + coefficients[2] * x**4 / 4
        assert -worlds.particles.force[0, 0, 2] == pytest.approx(force, rel=1e-10)  # rounding
        assert energies(worlds).elastic == pytest.approx(energy, rel=1e-10)


def test_elastic_foam_returns_all_energy():
    damper, surface = foam((2e3, 0.0, 4e8))
    worlds = made(damper, 1e-6, [[0, 0, surface - RADIUS - 1e-4]], RADIUS, [[0, 0, 1.0]])
    worlds = run(worlds, 2500)  # in and out again takes 1.6 ms
    assert state_of(worlds)[1][0, 2] == pytest.approx(-1.0, rel=1e-5)  # second order of some 1000 steps in contact
    assert energies(worlds).loss_lid == 0.0


@pytest.mark.parametrize("loss_factor", [0.1, 0.5])
def test_foam_loses_its_loss_factor_per_cycle(loss_factor):
    """Compressed between 0 and 2a by a sphere of endless mass, linear foam loses pi eta k a^2 per cycle."""
    stiffness, amplitude, frequency, n_cycle, n_step = 2e3, 1e-3, 50.0, 3, 20_000
    damper, surface = foam((stiffness, 0.0, 0.0), loss_factor)
    worlds = made(
        damper,
        1.0 / frequency / n_step,
        [[0, 0, surface - RADIUS + amplitude]],
        RADIUS,
        [[0, 0, -2 * pi * frequency * amplitude]],
        motion=harmonic(frequency, amplitude, (0.0, 0.0, 1.0)),
        begin=False,
    )
    worlds.particles.inverse_mass[:] = 0.0
    worlds = run(start(worlds), n_cycle * n_step)
    loss = worlds.record.ledger[0, LOSS_LID] / n_cycle
    # Hysteresis turns round over 1 mm/s of 314 mm/s: where the foam is at 0 it costs nothing, at 2a a share of
    # (1/314)^2 of the way, far less than the steps.
    assert loss == pytest.approx(pi * loss_factor * stiffness * amplitude**2, rel=1e-3)


def test_foam_bottoms_out_on_the_lid():
    """Beyond its travel the stiff lid behind it is felt as well."""
    travel, stiffness = 1e-3, 2e3
    damper, surface = foam((stiffness, 0.0, 0.0), travel=travel)
    for compression in (0.9 * travel, travel + 1e-6):
        position = [[0, 0, surface - RADIUS + compression]]
        worlds = made(damper, 1e-9, position, RADIUS, lid_height=damper.lid.lid_height)
        lid = hertz(RADIUS, STEEL, RIGID) * max(compression - travel, 0.0) ** 1.5
        # Rounding of a coordinate, 1e-18 m, over the overlap of 1e-6 m.
        assert -worlds.particles.force[0, 0, 2] == pytest.approx(stiffness * compression + lid, rel=1e-10)
        assert worlds.record.wall_force[0, :, 2] == pytest.approx([0, lid, stiffness * compression], rel=1e-10)


@pytest.mark.parametrize(
    ("centre", "distance", "normal"),
    [
        ((0.3, 0.0, 0.2), 0.2, (0.0, 0.0, 1.0)),  # above the disc
        ((0.3, 0.0, -0.2), 0.2, (0.0, 0.0, -1.0)),  # below it
        ((1.3, 0.0, 0.4), 0.5, (0.6, 0.0, 0.8)),  # beyond its rim, a 3-4-5 triangle away
        ((0.0, -1.2, 0.0), 0.2, (0.0, -1.0, 0.0)),  # beside it, in its plane
    ],
)
def test_nearest_point_of_a_disc(centre, distance, normal):
    """Exact distances to a disc of radius 1 m in the plane z = 0; the tolerance is rounding."""
    shapes = np.zeros((1, N_SHAPE))
    shapes[0, 3:7] = 0.0, 0.0, 1.0, 1.0
    found = nearest(np.int32(WallKind.DISC), shapes, 0, np.zeros((1, 4)), *centre, 0.1)
    assert found == pytest.approx((distance, *normal), abs=1e-12)


@pytest.mark.parametrize(("x", "met"), [(4.5e-3, True), (7e-3, False)])
def test_a_ball_bounces_on_a_disc_and_falls_past_it(x, met):
    """A described disc of radius 5 mm: a ball that falls on it bounces without loss, one 2 mm beyond its rim does not
    touch it. The tolerance is that of the energy over an elastic contact in some 60 steps."""
    disc = {"kind": "walls", "planes": [{"name": "plate", "point": [0, 0, 0], "normal": "z", "radius": 5e-3}]}
    speed, step = 0.1, 1e-6
    worlds = made(damper_of(container=disc, softening=1e4), step, [[x, 0.0, 1.2e-3]], 1e-3, velocity=(0.0, 0.0, -speed))
    worlds = run(worlds, 20_000)
    velocity = velocity_now(worlds)[0][0]
    assert velocity == pytest.approx([0.0, 0.0, speed if met else -speed], abs=1e-3 * speed)
