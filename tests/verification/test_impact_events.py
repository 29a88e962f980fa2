"""The event-driven solver against closed forms, independent integration, and conservation laws."""

from math import pi, sqrt

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from graindamp.impact.collision import first_impact, impact_phase
from graindamp.impact.simulate import Start, at_rest, cavity_motion, released, simulate
from graindamp.impact.state import IMPACT, RELEASE, STICK
from graindamp.impact.system import Ball, PointForce, PrescribedMotion, in_driven_container, on_structure, oscillator
from graindamp.structure.modal import ModalModel

UNIT = 0.5 / pi
"""Frequency of angular frequency 1 [Hz]."""
CLOSURE = 1e-12
"""Energies close to rounding, 2e-16 per panel, over some 1e4 panels."""


def modes(omega, damping, shape):
    shape = np.array(shape, dtype=float)
    points = tuple("abcdef"[: len(shape)])
    return ModalModel(np.array(omega, float), np.array(damping, float), shape, np.full_like(shape, np.nan), points)


THREE = modes([1.0, 6.3, 17.5], [0.01, 0.1, 0.3], [[1.0, -0.8, 0.6], [0.4, 0.7, -0.9]])


@pytest.mark.parametrize("damping", [0.0, 0.3, 2.0, 5.0], ids=["none", "light", "critical", "over"])
def test_free_motion_is_the_closed_form(damping):
    """Eight periods, about 60 panels, of a mode from displacement 1: every sample to rounding."""
    system = on_structure(modes([1.0], [damping], [[1.0]]), [Ball(1.0, 1e3, 0.5)])
    start = at_rest(system)._replace(q=np.ones(1))
    run = simulate(system, 50.0, start, sample_rate=7.0)
    root = np.sqrt(complex(damping**2 / 4 - 1.0))
    t = run.time
    even = np.cosh(root * t)
    odd = np.sinh(root * t) / root if root else t
    exact = np.real(np.exp(-damping / 2 * t) * (even + damping / 2 * odd))
    assert run.q[:, 0] == pytest.approx(exact, abs=1e-13)  # rounding, 2e-16 per panel
    assert abs(run.ledger.residual) < CLOSURE


@pytest.mark.parametrize("alpha", [0.05, 0.1591, 0.15915, 0.2, 1 / pi, 0.6, 3.0])
def test_release_and_first_impact_in_a_driven_container(alpha):
    """The ball rides on the wall, leaves it at pi / 2 and meets the far one at the root of Witt's equation."""
    system = in_driven_container([Ball(0.3, 1.0 / alpha, 0.4)], [PrescribedMotion(1.0, UNIT)])
    start = at_rest(system)._replace(offset=system.clearance.copy())
    run = simulate(system, impact_phase(alpha) + 1e-6, start)
    assert run.events[:2, 2].tolist() == [STICK, RELEASE]
    assert run.events[1, 0] == pytest.approx(pi / 2, abs=1e-12)
    assert run.events[2, 2] == IMPACT
    # a root error of rounding over the approach speed; the gentlest here approaches at 2e-7
    speed = run.events[2, 4]
    assert run.events[2, 0] == pytest.approx(impact_phase(alpha), abs=1e-12 + 1e-15 / alpha / speed)


def test_a_gentle_catch_is_contact_without_impact():
    """At alpha = 1 / (2 pi) the ball arrives with the speed and acceleration of the wall, which then pushes it."""
    system = in_driven_container([Ball(1.0, 2 * pi, 0.5)], [PrescribedMotion(1.0, UNIT)])
    start = at_rest(system)._replace(offset=system.clearance.copy())
    run = simulate(system, 20 * pi, start)
    assert run.ledger.impacts < 1e-12  # the arrival is a triple root: its time is known to rounding^(1/3), 1e-5
    assert abs(run.ledger.residual) < CLOSURE


def test_brief_dips_of_a_higher_mode_are_not_missed():
    """The ball nearly follows a slow wall; a fast ripple of it makes shallow contacts shorter than 1e-3 of a cycle."""
    system = in_driven_container(
        [Ball(1.0, 50.0, 1.0)], [PrescribedMotion(1.0, UNIT, -pi / 2), PrescribedMotion(1e-3, 40 * UNIT)]
    )
    time = np.linspace(0.0, 1.4, 400001)
    wall = np.sin(time) + 1e-3 * np.cos(40 * time)
    for depth in (1e-4, 1e-8, 1e-10):
        # a ball of constant speed 0.5 whose path cuts the wall's crest by `depth`
        line = 0.5 * time
        offset = (wall - line).max() - depth
        late = np.flatnonzero(wall - line - offset >= 0)
        start = at_rest(system)._replace(offset=np.array([offset - wall[0]]), u=np.array([0.5]))
        if offset - wall[0] <= 0:
            continue
        run = simulate(system, 1.4, start)
        assert len(run.events) > 0
        if len(late):
            assert run.events[0, 0] == pytest.approx(time[late[0]], abs=2 * 1.4 / 400000)


def test_states_between_impacts_equal_an_independent_integration():
    """Forced three-mode structure, two balls: Runge-Kutta of order 8 with its own event location, over 6 impacts."""
    balls = [Ball(0.05, 1.5, 0.6, "a"), Ball(0.08, 2.0, 0.3, "b")]
    forces = [PointForce(1.3, 0.9 * UNIT, 0.4, "a"), PointForce(0.5, 3.1 * UNIT, 0.0, "b")]
    system = on_structure(THREE, balls, forces)
    run = simulate(system, 12.0, sample_rate=50.0)
    impacts = run.events[run.events[:, 2] == IMPACT]
    assert len(impacts) >= 4

    def rate(t, y):
        q, v = y[:3], y[3:6]
        force = system.force @ np.cos(system.drive_omega * t + system.drive_phase)
        return np.concatenate([v, -system.damping * v - system.omega_squared * q + force, y[8:], [0.0, 0.0]])

    state, t, seen = np.concatenate([np.zeros(6), system.clearance / 2, np.zeros(2)]), 0.0, []

    def gap(b, side):
        def event(t, y):
            below = y[6 + b] - system.shape[b] @ y[:3]
            return below if side > 0 else system.clearance[b] - below

        event.terminal, event.direction = True, -1
        return event

    walls = [(b, side) for b in (0, 1) for side in (1, -1)]
    while len(seen) < 4:
        found = solve_ivp(rate, (t, 12.0), state, "DOP853", rtol=1e-12, atol=1e-13, events=[gap(*w) for w in walls])
        b, side = next(w for w, times in zip(walls, found.t_events, strict=True) if len(times))
        t, state = found.t[-1], found.y[:, -1].copy()
        phi, m = system.shape[b], system.mass[b]
        impulse = -(1 + system.restitution[b]) * (state[8 + b] - phi @ state[3:6]) / (1 / m + phi @ phi)
        state[8 + b] += impulse / m
        state[3:6] -= phi * impulse
        seen.append((t, b, side, abs(impulse)))
    # 1e-9: tolerance of the integrator, some 1e-12 a cycle, enlarged at impacts
    assert impacts[:4][:, [0, 1, 3, 5]] == pytest.approx(np.array(seen), rel=1e-9)


@pytest.mark.parametrize("restitution", [0.0, 0.5, 0.9])
def test_chatter_ends_at_the_sum_of_the_geometric_series(restitution):
    """A free container under a constant force catches its ball after infinitely many bounces in a finite time.

    Between bounces the gap closes with a = F / M: t = sqrt(2 h / a) (1 + 2 R / (1 - R)). Then both move as one.
    """
    mass, ball, force, height = 2.0, 0.7, 3.0, 0.4
    system = on_structure(oscillator(mass, 0.0), [Ball(ball, 5.0, restitution)], [PointForce(force, 0.0)])
    start = at_rest(system)._replace(offset=np.array([height]))
    fall = sqrt(2 * height * mass / force)
    end = fall * (1 + 2 * restitution / (1 - restitution))
    run = simulate(system, 1.5 * end, start)
    stick = run.events[run.events[:, 2] == STICK]
    assert len(stick) == 1
    assert run.resting.tolist() == [1]
    # bounces below 1e-16 of the clearance are left out: they last 2 sqrt(2e-16 d / (a (1 - R))), 1e-7 at most
    assert stick[0, 0] == pytest.approx(end, abs=2e-7)
    position = (ball * height + force * (1.5 * end) ** 2 / 2) / (mass + ball)
    assert run.end.q[0] / sqrt(mass) == pytest.approx(position, rel=1e-12)  # momentum and centre of mass: rounding
    assert run.end.u[0] == pytest.approx(force * 1.5 * end / (mass + ball), rel=1e-12)
    reduced = mass * ball / (mass + ball)
    assert run.ledger.impacts == pytest.approx(reduced * (force / mass * fall) ** 2 / 2, rel=1e-12)
    bounces = run.events[run.events[:, 2] == IMPACT][:6]
    assert bounces[:, 4] == pytest.approx(force / mass * fall * restitution ** np.arange(len(bounces)), rel=1e-12)


@pytest.mark.parametrize("restitution", [0.3, 0.8])
def test_chatter_on_an_oscillating_wall_ends_where_its_bounces_add_up_to(restitution):
    """A free container under a constant and an oscillating force, which never pulls it off the ball.

    While the ball flies the container moves by the forces alone, so that the gap has a closed form from bounce to
    bounce; an impact turns its rate round, times R. The bounces are followed one by one until 1e-7 of the first rate is
    left, and then last 2 v / (a (1 - R)) more.
    """
    mass, ball, steady, swing, omega, height = 2.0, 0.7, 3.0, 2.0, 9.0, 0.4
    forces = [PointForce(steady, 0.0), PointForce(swing, omega / (2 * pi), 0.6)]
    system = on_structure(oscillator(mass, 0.0), [Ball(ball, 5.0, restitution)], forces)

    def after(start, rate, gap, time):
        """Gap and its rate `time` after `start`."""
        phase, turned = omega * start + 0.6, omega * time
        # cos(p + x) - cos(p) + x sin(p) without the difference of near numbers
        small = -2 * np.sin(turned / 2) ** 2 * np.cos(phase) + (turned - np.sin(turned)) * np.sin(phase)
        pushed = steady * time**2 / 2 - swing / omega**2 * small
        speed = steady * time + swing / omega * (np.sin(phase + turned) - np.sin(phase))
        return gap + rate * time - pushed / mass, rate - speed / mass

    end, rate, gap, first, hits = 0.0, 0.0, height, 0.0, []
    while not hits or rate > 1e-7 * first:
        # The push is between 1 and 5 N, so that the gap closes between these times.
        times = [(rate + sqrt(rate**2 + 2 * push / mass * gap)) / (push / mass) for push in (5.0, 1.0)]
        low, high = times[0] * 0.999, times[1] * 1.001
        time = brentq(lambda t, *at: after(*at, t)[0], low, high, (end, rate, gap), xtol=1e-16, rtol=1e-14)
        speed = -after(end, rate, gap, time)[1]
        end, rate, gap, first = end + time, restitution * speed, 0.0, first or restitution * speed
        hits.append((end, speed))
    push = steady + swing * np.cos(omega * end + 0.6)
    end += 2 * rate * mass / push / (1 - restitution)
    run = simulate(system, 1.5 * end, at_rest(system)._replace(offset=np.array([height])))
    stick = run.events[run.events[:, 2] == STICK]
    assert len(stick) == 1
    assert run.resting.tolist() == [1]
    # As under a constant force: bounces below 1e-16 of the clearance are left out, 2e-7 at most.
    assert stick[0, 0] == pytest.approx(end, abs=2e-7)
    bounces = run.events[run.events[:, 2] == IMPACT][:6]
    # rounding, 1e-15 of the time at each impact, over the rate that is left, 0.002 of the first after six at R = 0.3
    assert bounces[:, [0, 4]] == pytest.approx(np.array(hits[: len(bounces)]), rel=1e-12)
    impulse = steady * 1.5 * end + swing / omega * (np.sin(omega * 1.5 * end + 0.6) - np.sin(0.6))
    assert run.end.u[0] == pytest.approx(impulse / (mass + ball), rel=1e-12)  # momentum: rounding
    assert abs(run.ledger.residual) < CLOSURE


def test_a_resting_ball_is_added_mass():
    """Let go with the ball on the wall: both move as U cos(w t), w^2 = k / (M + m), until they pass equilibrium."""
    mass, ball = 0.13, 0.02
    system = on_structure(oscillator(mass, 20.0), [Ball(ball, 0.05, 0.0)])
    run = simulate(system, 0.02, released(system, 8e-3), sample_rate=1e4)
    omega = 2 * pi * 20 / sqrt(1 + ball / mass)
    riding = run.time <= pi / 2 / omega
    displacement, _ = cavity_motion(system, run)
    assert displacement[riding, 0] == pytest.approx(8e-3 * np.cos(omega * run.time[riding]), abs=1e-16)
    assert run.events[1, [0, 2]] == pytest.approx([pi / 2 / omega, RELEASE], rel=1e-13)


@pytest.mark.parametrize("alpha", [0.2, 0.3, 0.5])
@pytest.mark.parametrize(("mass_ratio", "restitution"), [(0.027, 0.0), (0.027, 0.6), (0.3, 0.2)])
def test_first_impact_of_a_free_decay(alpha, mass_ratio, restitution):
    """Phase, speed and damping of the first impact are the closed forms at any mass ratio."""
    clearance = 0.01
    system = on_structure(oscillator(1.0, UNIT), [Ball(mass_ratio, clearance, restitution)])
    expected = first_impact(alpha, mass_ratio, restitution)
    amplitude = alpha * clearance  # after release; before it, the ball on the wall lowers the frequency
    run = simulate(system, 30.0, released(system, amplitude * sqrt(1 + mass_ratio)))
    leaves, hits = run.events[1], run.events[2]
    assert hits[0] - leaves[0] == pytest.approx(expected.phase - pi / 2, rel=1e-12)
    assert hits[4] == pytest.approx(expected.approach * amplitude, rel=1e-11)
    unit = (1 + mass_ratio) ** 2 / mass_ratio / (amplitude**2 / 2)
    assert hits[6] * unit == pytest.approx(expected.dissipated, rel=1e-11)


def test_energy_closes_with_many_balls_modes_forces_and_damping():
    balls = [Ball(0.05, 0.7, 0.6, "a"), Ball(0.08, 0.9, 0.0, "b"), Ball(0.02, 0.3, 0.95, "a"), Ball(0.1, 2.0, 0.3, "b")]
    forced = on_structure(THREE, balls, [PointForce(1.3, 0.97 * UNIT, 0.4, "a"), PointForce(0.5, 6.0 * UNIT, 0, "b")])
    driven = in_driven_container(balls, [PrescribedMotion(0.4, UNIT), PrescribedMotion(0.1, 3.7 * UNIT, 1.0)])
    free = on_structure(THREE, balls)
    for system, start in ((forced, None), (driven, None), (free, released(free, 1.5))):
        run = simulate(system, 100.0, start)
        assert len(run.events) > 50
        assert run.ledger.impacts > 0
        assert abs(run.ledger.residual) < CLOSURE


def test_momentum_of_a_free_container_is_conserved():
    system = on_structure(oscillator(1.0, 0.0), [Ball(0.3, 1.0, 0.8), Ball(0.5, 0.6, 0.4)])
    start = Start(0.0, np.zeros(1), np.array([0.3]), np.array([0.2, 0.3]), np.array([1.0, -0.4]))
    run = simulate(system, 200.0, start)
    momentum = 1.0 * 0.3 + 0.3 * 1.0 - 0.5 * 0.4
    assert run.end.v[0] + system.mass @ run.end.u == pytest.approx(momentum, rel=1e-13)
    assert run.ledger.end == pytest.approx(momentum**2 / 1.8 / 2, rel=1e-3)  # relative motion dies out as 1 / time


def test_two_equal_balls_side_by_side_are_one_of_twice_the_mass():
    """Their impacts coincide and are solved together; one after the other they would differ by the mass ratio."""
    model = oscillator(1.0, UNIT, 0.002)
    pair = on_structure(model, [Ball(0.02, 0.5, 0.4), Ball(0.02, 0.5, 0.4)])
    single = on_structure(model, [Ball(0.04, 0.5, 0.4)])
    both = simulate(pair, 20.0, released(pair, 0.4), sample_rate=10)
    one = simulate(single, 20.0, released(single, 0.4), sample_rate=10)
    assert both.q == pytest.approx(one.q, abs=1e-10)  # rounding, enlarged at each impact
    assert both.ledger.impacts == pytest.approx(one.ledger.impacts, rel=1e-10)


def test_a_heavy_structure_moves_as_prescribed():
    """A ball of 1e-9 of the mass on an undamped structure, and in a driven container: the same to its mass ratio."""
    structure = on_structure(oscillator(1.0, UNIT), [Ball(1e-9, 2.3, 0.3)])
    driven = in_driven_container([Ball(1e-9, 2.3, 0.3)], [PrescribedMotion(1.0, UNIT)])
    one = simulate(structure, 15.0, released(structure, 1.0))
    other = simulate(driven, 15.0, at_rest(driven)._replace(offset=driven.clearance.copy()))
    count = min(len(one.events), len(other.events), 6)
    assert one.events[:count, 0] == pytest.approx(other.events[:count, 0], abs=1e-6)


def test_a_run_continues_where_another_ended():
    system = on_structure(THREE, [Ball(0.05, 0.7, 0.3, "a")], [PointForce(1.0, UNIT, 0.0, "a")])
    whole = simulate(system, 14.0)
    part = simulate(system, 6.0)
    rest = simulate(system, 8.0, part.end)
    assert rest.end.q == pytest.approx(whole.end.q, abs=1e-10)
    assert rest.end.time == pytest.approx(14.0, rel=1e-15)


def test_turning_points_and_greatest_speeds_of_free_vibration():
    ratio = 0.02
    system = on_structure(oscillator(1.0, UNIT, ratio), [Ball(1.0, 1e3, 0.5)])
    run = simulate(system, 30.0, at_rest(system)._replace(q=np.ones(1)))
    damped = sqrt(1 - ratio**2)
    turn = np.arange(1, len(run.peaks) + 1) * pi / damped
    assert run.peaks[:, 0] == pytest.approx(turn, abs=1e-12)
    assert run.peaks[:, 1] == pytest.approx(np.cos(damped * turn) * np.exp(-ratio * turn), rel=1e-12)
    assert run.peaks[1:, 2] / run.peaks[:-1, 2] == pytest.approx(np.exp(-ratio * pi / damped), rel=1e-7)
