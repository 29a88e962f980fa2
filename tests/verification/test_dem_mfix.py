"""Particle cases of Garg, Galvin, Li & Pannala (2012), Powder Technol. 220, 122-137, against their closed forms."""

from itertools import pairwise
from math import log, pi, sqrt

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from dem_made import FLOOR, GRAVITY, RIGID, channel, damper_of, made, mass_of, state_of
from graindamp.dem.engine import run

DOWN = (0.0, 0.0, -GRAVITY)


def ball(density):
    return {"name": "ball", "youngs_modulus": 1e9, "poisson_ratio": 0.3, "density": density}


def drop(radius, height, stiffness, restitution, time_step, density=2600.0):
    damper = damper_of(ball(density), RIGID, law="linear", stiffness=stiffness, restitution=restitution, tension=True)
    return made(damper, time_step, [[0, 0, height]], radius, gravity=DOWN)


@pytest.mark.parametrize(("stiffness", "restitution"), [(1e4, 0.9), (1e4, 0.6), (1e5, 0.9)])
def test_dem01_free_fall_contact_and_rebound(stiffness, restitution):
    """Flight, damped oscillation under weight, flight: height of the centre at any time."""
    radius, height = 0.1, 0.5
    mass = mass_of(radius, 2600.0)
    omega = sqrt(stiffness / mass)
    zeta = -log(restitution) / sqrt(log(restitution) ** 2 + pi**2)
    if (stiffness, restitution) == (1e4, 0.9):
        assert (mass, omega, zeta) == pytest.approx((10.891, 30.302, 0.033518), rel=2e-5)  # printed digits
    begin, speed = sqrt(2 * (height - radius) / GRAVITY), sqrt(2 * GRAVITY * (height - radius))
    assert (begin, speed) == pytest.approx((0.28557, 2.80143), rel=1e-5)
    damped = omega * sqrt(1 - zeta**2)
    rest = GRAVITY / omega**2

    def in_contact(t):
        """Overlap and its rate."""
        # Oscillation about the overlap at rest, from -rest at speed.
        a, b = -rest, (speed - zeta * omega * rest) / damped
        decay, c, s = np.exp(-zeta * omega * t), np.cos(damped * t), np.sin(damped * t)
        overlap = rest + decay * (a * c + b * s)
        rate = decay * ((b * damped - zeta * omega * a) * c - (a * damped + zeta * omega * b) * s)
        return overlap, rate

    low, high = pi / damped * 0.7, pi / damped * 1.5
    for _ in range(60):
        low, high = ((low + high) / 2, high) if in_contact((low + high) / 2)[0] > 0 else (low, (low + high) / 2)
    leave, away = begin + low, -in_contact(low)[1]

    def exact(t):
        if t < begin:
            return height - 0.5 * GRAVITY * t**2
        if t < leave:
            return radius - in_contact(t - begin)[0]
        return radius + away * (t - leave) - 0.5 * GRAVITY * (t - leave) ** 2

    errors = []
    for n_step in (200, 400, 800, 1600):
        time_step = pi / omega / n_step
        worlds = drop(radius, height, stiffness, restitution, time_step)
        worst = 0.0
        while worlds.clock.time[0] < leave + 0.25:
            worlds = run(worlds, n_step // 10)
            worst = max(worst, abs(worlds.particles.position[0, 0, 2] - exact(worlds.clock.time[0])))
        errors.append(worst)
    # The dashpot's force 2 zeta omega m v begins and ends with a jump somewhere within a step: a first-order bound on
    # the speed, which a flight of 0.25 s turns into height.
    bound = 2 * zeta * omega * speed * 0.25 * pi / omega
    assert (np.array(errors) * (200, 400, 800, 1600) < bound).all()


@pytest.mark.parametrize("restitution", [0.6, 0.8, 0.95, 1.0])
def test_dem02_heights_of_bounces_converge_as_the_spring_hardens(restitution):
    """h_k = (h0 - r) e^2k + r belongs to impacts without duration: the rest falls with the time in contact, k^-1/2."""
    radius, height, n_bounce = 0.1, 0.5, 4
    expected = radius + (height - radius) * restitution ** (2 * np.arange(1, n_bounce + 1))
    mass, speed = mass_of(radius, 2600.0), sqrt(2 * GRAVITY * (height - radius))
    zeta = -log(restitution) / sqrt(log(restitution) ** 2 + pi**2)
    errors = []
    for stiffness in (5e4, 5e5, 5e6):
        omega = sqrt(stiffness / mass)
        time_step, n_sample = pi / omega / 200, 20
        worlds = drop(radius, height, stiffness, restitution, time_step)
        path = []
        while worlds.clock.time[0] < (2.0 if restitution < 0.9 else 4.0):
            worlds = run(worlds, n_sample)
            path.append(worlds.particles.position[0, 0, 2])
        path = np.array(path)
        tops = path[1:-1][(path[1:-1] > path[:-2]) & (path[1:-1] >= path[2:])][:n_bounce]
        errors.append(np.max(abs(tops - expected)))
        # The weight's part in the speed, g/omega, changes the loss of the dashpot, 2 zeta omega m times the integral of
        # the speed squared, by about 4 zeta m g v/omega: so much weight times height per bounce, of which later ones
        # keep e^2. A quarter more for the dashpot's jump within a step; the top lies between two samples.
        shift = 4 * zeta * speed / omega * np.sum(restitution ** (2 * np.arange(n_bounce)))
        assert errors[-1] < 1.25 * shift + 0.5 * GRAVITY * (0.5 * n_sample * time_step) ** 2 + 1e-5
    for a, b in pairwise(errors if restitution < 1.0 else []):
        assert a / b == pytest.approx(sqrt(10), rel=0.5)  # the first-order jump of the dashpot, at some part of a step


@pytest.mark.parametrize("restitution", [1.0, 0.7])
def test_dem03_two_balls_squeezed_between_plates(restitution):
    """Two oscillators in series between fixed ends: second order, since no contact begins or ends."""
    radius, stiffness, gap = 0.5e-3, 1e3, 1.8e-3
    density = np.array([20000.0, 10000.0])
    mass = mass_of(radius, density)
    heavy, light = {**ball(density[0]), "name": "heavy"}, {**ball(density[1]), "name": "light"}
    damper = damper_of(
        [heavy, light],
        RIGID,
        channel(gap),
        law="linear",
        stiffness=stiffness,
        restitution=restitution,
        tension=True,
    )
    start = np.array([0.475e-3, 1.35e-3])
    zeta = -log(restitution) / sqrt(log(restitution) ** 2 + pi**2)

    def slope(_, y):
        (a, b), (u, v) = y[:2], y[2:]
        reduced = mass.prod() / mass.sum()
        low, middle, high = (2 * zeta * sqrt(m * stiffness) for m in (mass[0], reduced, mass[1]))
        floor = stiffness * (radius - a) - low * u
        between = stiffness * (2 * radius - (b - a)) + middle * (u - v)
        top = stiffness * (radius - (gap - b)) + high * v
        return [u, v, (floor - between) / mass[0] - GRAVITY, (between - top) / mass[1] - GRAVITY]

    period = pi * sqrt(mass[1] / stiffness)
    duration = 4 * period
    exact = solve_ivp(slope, (0, duration), [*start, 0, 0], rtol=1e-11, atol=1e-15, method="DOP853").y[:2, -1]
    assert exact[0] < radius  # still touching
    errors = []
    for n_step in (50, 100, 200):
        position = [[0, 0, start[0]], [0, 0, start[1]]]
        worlds = made(damper, period / n_step, position, radius, material=[0, 1], gravity=DOWN)
        worlds = run(worlds, 4 * n_step)
        errors.append(np.max(abs(state_of(worlds)[0][:, 2] - exact)))
    # Second order: (omega dt)^2/24 = 2e-4 of a phase of 4 pi, of swings of some tenths of the radius; measured 3e-4.
    assert errors[0] < 1e-3 * radius
    for a, b in pairwise(errors):
        assert a / b == pytest.approx(4, rel=0.1)  # next-order term


@pytest.mark.parametrize("tangential", ["linear", "tanh"])
@pytest.mark.parametrize("friction", [0.2, 0.6])
def test_dem04_slipping_ball_begins_to_roll(tangential, friction):
    """Slip ends at t = 2 u0 / (7 mu g), with 5/7 of the speed, whatever the friction."""
    radius, stiffness, speed = 0.5e-3, 1e4, 1.0
    mass = mass_of(radius, 1e4)
    # The dashpot of the spring calms its swing after slip has ended, 1e-4 of the speed otherwise.
    contact = {"friction": friction, "tangential": tangential, "tangential_dashpot": 1.0}
    damper = damper_of(ball(1e4), RIGID, law="linear", stiffness=stiffness, restitution=0.9, **contact)
    height = radius - mass * GRAVITY / stiffness  # at rest under its weight
    time_step = pi * sqrt(mass / stiffness) / 30
    worlds = made(damper, time_step, [[0, 0, height]], radius, [[speed, 0, 0]], gravity=DOWN)
    end = 2 * speed / (7 * friction * GRAVITY)
    worlds = run(worlds, int(0.5 * end / time_step))
    _, velocity, spin = state_of(worlds)
    now = worlds.clock.time[0]
    # The arm is 1e-5 shorter than the radius; the spring slips after mu m g / k_t, 1e-9 m.
    assert velocity[0, 0] == pytest.approx(speed - friction * GRAVITY * now, rel=1e-4)
    assert spin[0, 1] * radius == pytest.approx(2.5 * friction * GRAVITY * now, rel=1e-4)
    worlds = run(worlds, int(0.7 * end / time_step))
    _, velocity, spin = state_of(worlds)
    # Smoothed friction ends the slip as exp(-3.5 mu g tau t), tau = 1000 s/m: over long before 0.2 of the time.
    assert velocity[0, 0] == pytest.approx(5 / 7 * speed, rel=1e-4)
    assert spin[0, 1] * radius == pytest.approx(5 / 7 * speed, rel=1e-4)


def test_dem05_oblique_impact_on_glass():
    """Aluminium oxide on soda-lime glass, against the experiments of Kharaz, Gorham & Salman (2001)."""
    oxide = {"name": "oxide", "youngs_modulus": 380e9, "poisson_ratio": 0.23, "density": 4000.0}
    glass = {"name": "glass", "youngs_modulus": 70e9, "poisson_ratio": 0.25}
    radius, speed, n_step = 2.5e-3, 3.9, 800
    angle = np.radians([10, 20, 30, 40, 50, 71, 79, 85])
    measured = [0.675, 0.599, 0.690, 0.774, 0.848, 0.937, 0.970, 0.979]
    velocity = speed * np.column_stack([np.sin(angle), 0 * angle, -np.cos(angle)])
    # Each sphere stands off as far as it comes in the same time.
    position = np.column_stack([0.02 * np.arange(len(angle)), 0 * angle, radius * (1 + 1e-3 * np.cos(angle))])
    damper = damper_of(oxide, glass, FLOOR, restitution=0.98, friction=0.092, tangential="mindlin")
    time_step = 12e-6 / n_step
    worlds = made(damper, time_step, position, radius, velocity)
    worlds = run(worlds, int(40e-6 / time_step))
    _, after, _ = state_of(worlds)
    assert (after[:, 2] > 0).all()
    # 0.01: scatter of the experiment in sliding. 0.03: micro-slip, which the law leaves out, at 10 to 20 degrees;
    # measured 0.025 at 10.
    tolerance = np.where(np.degrees(angle) > 25, 0.01, 0.03)
    assert (abs(after[:, 0] / velocity[:, 0] - measured) < tolerance).all()
