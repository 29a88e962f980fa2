"""Many spheres together: cooling of a granular gas and stress in a silo."""

from math import pi, sqrt

import numpy as np
import pytest
from scipy.optimize import brentq

from dem_made import GRAVITY, RIGID, STEEL, damper_of, loose, made, mass_of, state_of
from graindamp.dem.engine import run
from graindamp.dem.restitution import contact_time_linear


def cooling(count, duration, seed):
    """Cooling rate of a gas of inelastic spheres in a box over Haff's [-], and the share of its pairs in the box [-].

    Haff (1983), J. Fluid Mech. 134, 401-430: T = T0 / (1 + t/t_H)^2 with t_H = 6 / [(1 - e^2) omega0], omega0 = 4
    sqrt(pi) n d^2 g0 sqrt(T0), g0 = (1 - phi/2)/(1 - phi)^3 (Carnahan & Starling). Walls without friction and loss
    neither heat nor cool. They keep the centres in a cube of side L, less than the box by a diameter, from which
    density and solid fraction are taken; and they leave a sphere near them fewer partners: of all pairs at distance d
    in an endless gas, the share mean of (1 - |x|/L)(1 - |y|/L)(1 - |z|/L) over the sphere of radius d, 1 - 3 d/(2 L) +
    2/pi (d/L)^2 - ..., is in the cube.
    """
    radius, restitution, fraction, warmth, density = 0.5e-3, 0.9, 0.05, 0.01, 2500.0
    diameter, mass = 2 * radius, mass_of(radius, density)
    free = (count * pi / 6 * diameter**3 / fraction) ** (1 / 3)
    size = free + diameter
    time = 4e-5  # of a contact; spheres meet every 13 ms at first and cross their diameter in 10 ms
    stiffness = mass / 2 * (pi / time) ** 2
    assert contact_time_linear(stiffness, mass / 2) == pytest.approx(time)
    gas = {"name": "gas", "youngs_modulus": 1e9, "poisson_ratio": 0.3, "density": density}
    contact = {"law": "linear", "stiffness": stiffness, "restitution": restitution}
    container = {
        "kind": "box",
        "size": [size] * 3,
        "walls": {n: {"restitution": 1.0} for n in ("x-", "x+", "y-", "y+", "z-", "z+")},
    }
    per_side = int(np.ceil(count ** (1 / 3)))
    cell = free / per_side
    place = radius + loose(count, cell, np.zeros(3), np.full(3, free * 1.0001), seed, 0.2)
    rng = np.random.default_rng(seed)
    velocity = rng.normal(0, 1, (count, 3))
    velocity -= velocity.mean(0)
    velocity *= sqrt(warmth / np.mean(velocity**2))
    worlds = made(damper_of(gas, RIGID, container, **contact), time / 12, place, radius, velocity, skin=0.4 * radius)
    collisions = 4 * sqrt(pi) * count / free**3 * diameter**2 * (1 - fraction / 2) / (1 - fraction) ** 3 * sqrt(warmth)
    assert collisions == pytest.approx(76.99, rel=1e-3)  # printed digits
    haff = 6 / ((1 - restitution**2) * collisions)
    n_sample = 20
    times, temperature = [0.0], [warmth]
    for _ in range(n_sample):
        worlds = run(worlds, int(duration * haff / n_sample / (time / 12)))
        times.append(worlds.clock.time[0])
        temperature.append(np.mean(state_of(worlds)[1] ** 2))
    # sqrt(T0/T) - 1 = t/t_H: a line through the origin.
    rise = np.sqrt(warmth / np.array(temperature)) - 1
    times = np.array(times)
    share = 1 - 1.5 * diameter / free + 2 / pi * (diameter / free) ** 2
    return haff * (rise @ times) / (times @ times), share


def test_cooling_of_a_small_granular_gas():
    rate, share = cooling(150, 0.5, seed=1)
    # 500 collisions, each of which takes another share of energy between 0 and (1 - e^2)/2: 5 %, three times that.
    assert rate == pytest.approx(share, rel=0.15)


@pytest.mark.slow
def test_granular_gas_cools_as_haff_says():
    found = [cooling(500, 1.5, seed) for seed in range(4)]
    rate, share = np.mean(found, axis=0)
    assert share == pytest.approx(0.916, abs=1e-3)
    # 4000 collisions leave 2 % of scatter; the walls draw spheres near (2 phi of the density over a diameter), and the
    # flat velocities of inelastic spheres (a2 = -0.02) change less than 1 %.
    assert rate == pytest.approx(share, rel=0.04)


RADIUS = 2.5e-3
SILO = 6 * 2 * RADIUS
"""Inner diameter [m]."""


def poured(count, friction, tangential="mindlin", seed=1):
    """Weight of spheres at rest in an upright cylinder [N], and forces on floor and side [N].

    The floor is so soft that the bed sinks by some tenths of a millimetre while its weight grows from a tenth to the
    whole, as on a piston that is let down: wall friction then acts upwards everywhere (Vanel & Clement 1999, Eur. Phys.
    J. B 11).
    """
    material, soft = {**STEEL, "youngs_modulus": 2e8}, {"name": "soft", "youngs_modulus": 6e4, "poisson_ratio": 0.3}
    contact = {
        "law": "hertz-viscoelastic",  # damps a resting contact as well, whatever the impact it began with
        "restitution": 0.3,
        "friction": friction,
        "tangential": tangential,
        "tangential_dashpot": 1.0,
    }
    cell = 2.15 * RADIUS
    n_layer = -(-count // 21)  # of five times five places, those at the corners lie outside
    low = np.array([-2.5 * cell, -2.5 * cell, 0.0])
    place = loose(25 * n_layer, cell, low, [2.51 * cell, 2.51 * cell, (n_layer + 0.01) * cell], seed, 0.06)
    place = place[np.hypot(place[:, 0], place[:, 1]) < SILO / 2 - 1.05 * RADIUS][:count]
    assert len(place) == count
    container = {
        "kind": "cylinder",
        "axis": "z",
        "radius": SILO / 2,
        "length": (n_layer + 2) * cell,
        "walls": {"start": {"material": soft, "friction": 0.0}},
    }
    damper = damper_of(material, {**material, "name": "wall"}, container, **contact)
    time_step, stride = 1.2e-5, 2000
    down = (0, 0, -GRAVITY)
    worlds = made(damper, time_step, place, RADIUS, gravity=down, stride=stride, n_sample=1000)
    worlds = run(worlds, int(0.25 / time_step))
    for share in np.linspace(0.1, 1.0, 31):
        worlds.rules.gravity[0, 2] = -share * GRAVITY
        worlds = run(worlds, int(0.015 / time_step))
    worlds = run(worlds, int(0.1 / time_step))
    last = int(worlds.record.n_sample[0])
    force = worlds.record.series[0, last - 2 : last, :3, 2].mean(axis=0)
    return count * mass_of(RADIUS, STEEL["density"]) * GRAVITY, -force[1], -force[0]


def test_silo_without_friction_carries_its_weight_on_the_floor():
    weight, floor, side = poured(60, 0.0, "none")
    assert side == 0.0
    assert floor == pytest.approx(weight, rel=0.02)  # still swinging a little


@pytest.mark.slow
def test_silo_carries_weight_on_its_walls():
    """Stress under a bed of height H saturates (Janssen 1895, VDI-Z. 39): the floor of a silo carries the share
    (1 - exp(-H/lambda)) lambda/H of the weight, lambda = D / (4 mu K).

    K is known within 0.4 to 1.1 for beds of spheres on their way down: from Rankine's active state, (1 - s)/(1 + s)
    with s the sine of their angle of friction, to equal stresses, and D may be the room of the centres or that of the
    surfaces. Friction on the walls is not mobilised everywhere, by up to an eighth of the weight it carries. Beds of
    the same height differ: K of twelve of them scattered by 0.08 about 0.48, so that a mean of two has a standard
    error of 0.057, and twice that is allowed for.
    """
    friction, n_bed, error, ratio = 0.4, 2, 0.057, []
    for count in (160, 480):
        height = count * 4 / 3 * pi * RADIUS**3 / (0.58 * pi / 4 * SILO**2)
        found = []
        for seed in range(1, n_bed + 1):
            weight, floor, side = poured(count, friction, seed=seed)
            assert floor + side == pytest.approx(weight, rel=0.02)  # at rest, but for a last swing
            depth = brentq(lambda x, share=floor / weight: (1 - np.exp(-x)) / x - share, 1e-6, 100.0)
            found.append(depth / height * SILO / (4 * friction))
        ratio.append(np.mean(found))
    assert min(ratio) > 0.35 - 2 * error
    assert max(ratio) < 1.1 + 2 * error
    assert max(ratio) < 1.5 * min(ratio)  # one K for all depths, as the law has it; three errors of a ratio
