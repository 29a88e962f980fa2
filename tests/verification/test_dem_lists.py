"""Neighbour lists only save time: trajectories do not depend on how far they reach, nor on how long they are."""

import numpy as np
import pytest

from dem_made import GRAVITY, STEEL, damper_of, harmonic, loose, made
from graindamp.dem import world
from graindamp.dem.engine import run, start

RADIUS = 2.5e-3
CONTACT = {
    "tanh": {"tangential": "tanh"},
    "mindlin": {"tangential": "mindlin", "tangential_dashpot": 0.2},
}


def shaken(tangential, n_step, skin=None, sort=True, count=150, inserts=()):
    """Bed of spheres of three sizes in a shaken box, after `n_step` steps; started from above the floor."""
    rng = np.random.default_rng(5)
    size = 5.5 * 2 * RADIUS
    place = loose(count, 2.6 * RADIUS, np.zeros(3), np.array([size, size, 0.2]), seed=4, shuffle=0.1)
    contact = {
        "restitution": 0.7,
        "friction": 0.3,
        "rolling_friction": 0.02,
        "softening": 1000.0,
        **CONTACT[tangential],
    }
    container = {"kind": "box", "size": [size, size, 0.2]}
    damper = damper_of(STEEL, {**STEEL, "name": "wall"}, container, inserts, **contact)
    worlds = made(
        damper,
        8e-6,
        place,
        rng.choice([0.8, 0.9, 1.0], count) * RADIUS,
        rng.normal(0, 0.2, (count, 3)),
        gravity=(0, 0, -GRAVITY),
        motion=harmonic(60.0, 1e-3, (0.6, 0.0, 0.8)),
        skin=None if skin is None else skin * RADIUS,
        sort=sort,
        begin=False,
    )
    return run(start(worlds), n_step)


def facts(worlds):
    """All that must agree to the last bit."""
    particles, record = worlds.particles, worlds.record
    order = np.argsort(particles.identity[0])
    return [
        particles.position[0, order],
        particles.velocity[0, order],
        particles.spin[0, order],
        record.ledger,
        record.impact,
        worlds.clock.counts[:, 2:],
    ]


def assert_same(one, other):
    for a, b in zip(facts(one), facts(other), strict=True):
        np.testing.assert_array_equal(a, b)


@pytest.mark.parametrize("tangential", CONTACT)
@pytest.mark.parametrize("sort", [True, False])
def test_trajectories_do_not_depend_on_the_skin(tangential, sort):
    """Bit for bit: lists are exact, and forces are summed in the order of the particles whatever the lists hold."""
    worlds = [shaken(tangential, 5000, skin, sort) for skin in (0.02, 0.08, 0.3)]
    refreshes = [one.clock.counts[0, 0] for one in worlds]
    assert refreshes[0] > refreshes[1] > refreshes[2] > 1
    assert worlds[0].record.impact.sum() > 300
    assert_same(worlds[0], worlds[1])
    assert_same(worlds[0], worlds[2])


@pytest.mark.slow
@pytest.mark.parametrize("tangential", CONTACT)
def test_trajectories_do_not_depend_on_the_skin_for_long(tangential):
    """A second of a shaken bed, around a bar and a block."""
    middle = 5.5 * RADIUS
    inserts = (
        {
            "kind": "box",
            "material": "steel",
            "center": [middle, middle, 0.02],
            "size": [8e-3, 8e-3, 6e-3],
            "angle": 0.4,
        },
        {
            "kind": "cylinder",
            "material": "steel",
            "start": [0.0, middle, 0.012],
            "end": [0.03, middle, 0.012],
            "radius": 2e-3,
        },
    )
    worlds = [shaken(tangential, 120_000, skin, inserts=inserts) for skin in (0.04, 0.15)]
    assert_same(*worlds)


@pytest.mark.parametrize("tangential", CONTACT)
def test_lists_that_had_to_grow(tangential, monkeypatch):
    """Lists too short for the bed grow in the middle of a step, at the start and later, and nobody can tell."""
    roomy = shaken(tangential, 3000, 0.3)
    capacity = roomy.pairs.first.shape[1]
    monkeypatch.setattr(world, "PAIRS_PER_PARTICLE", 0)
    tight = shaken(tangential, 3000, 0.3)
    assert tight.pairs.first.shape[1] != capacity
    assert tight.pairs.first.shape[1] > 6 * 16  # several times longer than it began
    assert_same(roomy, tight)


def test_order_of_particles_matters_to_rounding_only():
    """Sorted by place or not: sums in another order, so equal to rounding until collisions have magnified it."""
    one, other = (shaken("tanh", 600, sort=sort) for sort in (True, False))
    assert not np.array_equal(one.particles.identity, other.particles.identity)
    for a, b, scale in zip(facts(one)[:3], facts(other)[:3], (RADIUS, 1.0, 1.0 / RADIUS), strict=True):
        np.testing.assert_allclose(a, b, atol=1e-9 * scale)
