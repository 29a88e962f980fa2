"""A single sphere on a floor at rest: inclines, rolling resistance, creep."""

from math import atan, cos, pi, radians, sin, sqrt, tan

import pytest

from dem_made import GRAVITY, RIGID, STEEL, damper_of, hertz, made, mass_of, state_of
from graindamp.dem.engine import run

RADIUS = 2e-3
MASS = mass_of(RADIUS, STEEL["density"])
SOFT = 1000.0
"""Divisor of the stiffness; a resting sphere is then pressed in by 5e-5 of its radius."""


def resting(friction, tangential, angle=0.0, speed=0.0, spin=0.0, restitution=0.5, **contact):
    """A sphere at its depth of rest on an incline that falls along x; 80 steps per swing on its contact."""
    k = hertz(RADIUS, STEEL, RIGID) / SOFT
    depth = (MASS * GRAVITY * cos(angle) / k) ** (2 / 3)
    time_step = 2 * pi / sqrt(1.5 * k * sqrt(depth) / MASS) / 80
    contact = {"friction": friction, "tangential": tangential, "restitution": restitution, "softening": SOFT, **contact}
    gravity = (GRAVITY * sin(angle), 0.0, -GRAVITY * cos(angle))
    position, velocity, turn = [[0, 0, RADIUS - depth]], [[speed, 0, 0]], [[0, spin, 0]]
    return made(damper_of(STEEL, RIGID, **contact), time_step, position, RADIUS, velocity, turn, gravity=gravity)


def motion_after(worlds, duration):
    """Speed along x [m/s], spin about y [rad/s] and time [s]."""
    worlds = run(worlds, int(duration / worlds.rules.time_step[0]))
    _, velocity, spin = state_of(worlds)
    return velocity[0, 0], spin[0, 1], worlds.clock.time[0]


@pytest.mark.parametrize("friction", [0.1, 0.3])
@pytest.mark.parametrize("share", [0.3, 0.9])
def test_sphere_rolls_down_a_gentle_incline(friction, share):
    """a = (5/7) g sin(angle) while tan(angle) <= 3.5 mu."""
    angle = atan(share * 3.5 * friction)
    speed, spin, time = motion_after(resting(friction, "mindlin", angle, tangential_dashpot=1.0), 0.2)
    expected = 5 / 7 * GRAVITY * sin(angle) * time
    # The arm is 5e-5 shorter than the radius, and the spring takes 1e-8 m of travel to build up its force; without a
    # dashpot it would swing on.
    assert speed == pytest.approx(expected, rel=3e-4)
    assert spin * RADIUS == pytest.approx(expected, rel=3e-4)


@pytest.mark.parametrize("tangential", ["mindlin", "tanh"])
def test_sphere_slides_down_a_steep_incline(tangential):
    """a = g (sin - mu cos), and spin grows by (5/2) mu g cos / R."""
    friction, angle = 0.1, radians(40)
    assert tan(angle) > 3.5 * friction
    speed, spin, time = motion_after(resting(friction, tangential, angle), 0.2)
    # tanh friction is not full before the slip is some 1/tau = 1 mm/s: 1e-3 of the speed reached.
    assert speed == pytest.approx(GRAVITY * (sin(angle) - friction * cos(angle)) * time, rel=1e-3)
    assert spin * RADIUS == pytest.approx(2.5 * friction * GRAVITY * cos(angle) * time, rel=1e-3)


def test_smoothed_friction_creeps_as_it_says():
    """A locked sphere under a tangential load T < mu F_n creeps at artanh(T / mu F_n) / tau; one on a spring stays."""
    friction, angle = 0.3, atan(0.15)
    creep = []
    for tangential in ("tanh", "mindlin"):
        worlds = resting(friction, tangential, angle, smoothing=2000.0, tangential_dashpot=1.0)
        worlds.particles.inverse_mass[..., 1] = 0.0
        creep.append(motion_after(worlds, 0.1)[0])
    assert creep[0] == pytest.approx(
        0.5493061443 / 2000.0, rel=1e-5
    )  # artanh(1/2); the quotient for tanh is right to 3e-9
    assert abs(creep[1]) < 1e-6  # swings on its spring until the dashpot has calmed it


def test_rolling_resistance_stops_a_spin():
    """A sphere that spins on a floor without friction loses 5 mu_r g / (2 R) of its spin per second, and then rests."""
    rolling, spin = 0.05, 400.0
    worlds = resting(0.0, "none", spin=spin, rolling_friction=rolling)
    rate = 2.5 * rolling * GRAVITY / RADIUS
    speed, now, time = motion_after(worlds, 0.8 * spin / rate)
    assert now == pytest.approx(spin - rate * time, rel=1e-6)  # constant torque; the weight rests to rounding
    assert speed == 0.0
    assert abs(motion_after(worlds, 0.4 * spin / rate)[1]) < 1e-3 * spin  # smoothed within a few steps of rest


def test_rolling_resistance_slows_a_rolling_sphere():
    """Torque mu_r R m g and friction that keeps the sphere rolling: deceleration (5/7) mu_r g."""
    rolling, speed = 0.02, 0.5
    worlds = resting(0.3, "mindlin", speed=speed, spin=speed / RADIUS, rolling_friction=rolling)
    now, spin, time = motion_after(worlds, 0.3)
    assert now == pytest.approx(speed - 5 / 7 * rolling * GRAVITY * time, rel=3e-4)  # arm, as above
    assert spin * RADIUS == pytest.approx(now, rel=3e-4)
