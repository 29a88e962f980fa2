"""Exact periodic motions with a ball, and their stability, against the event-driven solver and known values."""

from math import pi, sqrt

import numpy as np
import pytest

from graindamp.field.theory import collect_and_collide, stroke_ratio_max, stroke_ratio_min, stroke_ratio_stable_max
from graindamp.impact.decay import free_decay
from graindamp.impact.driven import driven_motions, driven_start
from graindamp.impact.periodic import half_cycle_jacobian, symmetric_two_impact
from graindamp.impact.simulate import Start, released, simulate
from graindamp.impact.state import IMPACT
from graindamp.impact.system import Ball, PointForce, on_structure, oscillator
from graindamp.structure.modal import ModalModel

UNIT = 0.5 / pi
"""Frequency of angular frequency 1 [Hz]."""
AFTER = 1e-9
"""Time past an impact at which states are read [s]; finite differences err by as much."""


def three_modes():
    shape = np.array([[1.0, -0.8, 0.6]])
    omega, damping = np.array([1.0, 6.3, 17.5]), np.array([0.02, 0.1, 0.3])
    return ModalModel(omega, damping, shape, np.full_like(shape, np.nan), ("a",))


CASES = {
    "one mode": (oscillator(1.0, UNIT, 0.01), Ball(0.05, 30.0, 0.6), PointForce(1.0, UNIT)),
    "below resonance": (oscillator(1.0, UNIT, 0.03), Ball(0.1, 20.0, 0.4), PointForce(1.0, 0.93 * UNIT)),
    "undamped, at resonance": (oscillator(1.0, UNIT), Ball(0.05, 30.0, 0.6), PointForce(1.0, UNIT)),
    "three modes": (three_modes(), Ball(0.05, 30.0, 0.6), PointForce(1.0, UNIT)),
    "free mass": (oscillator(1.0, 0.0), Ball(0.2, 2.0, 0.5), PointForce(1.0, UNIT)),
}


def best(case):
    return next(motion for motion in symmetric_two_impact(*CASES[case]) if motion.possible)


@pytest.mark.parametrize(
    ("mass", "speed", "peak", "stable"), [(0.05, 14.3347, 8.6368, True), (0.1, 7.5148, 3.5520, False)]
)
def test_known_solutions_of_the_forced_oscillator(mass, speed, peak, stable):
    """R = 0.6, h = 30 F0 / k, 1 % damping, at resonance; amplitude 50 without damper."""
    motions = symmetric_two_impact(oscillator(1.0, UNIT, 0.01), Ball(mass, 30.0, 0.6), PointForce(1.0, UNIT))
    motion = motions[0]
    assert (motion.ball_speed, motion.peak) == pytest.approx((speed, peak), abs=5e-5)  # printed digits
    assert motion.possible
    assert motion.stable == stable
    run = simulate(motion.system, 1600 * pi)
    late = np.abs(run.peaks[-400:, 1])
    if stable:
        assert late.max() == pytest.approx(motion.peak, rel=1e-9)  # 0.95^1600 of the start is left
    else:
        assert late.max() > 1.5 * motion.peak


@pytest.mark.parametrize("case", CASES)
def test_periodic_motion_is_a_fixed_point_of_the_solver(case):
    motion = best(case)
    half = pi / motion.system.drive_omega[0]
    run = simulate(motion.system, 2 * half * (1 + AFTER), motion.start)
    assert run.events[:, 2].tolist() == [IMPACT, IMPACT]
    assert run.events[:, 3].tolist() == [1, -1]
    assert run.events[:, 0] == pytest.approx([half, 2 * half], rel=1e-10)
    assert run.events[:, 4] == pytest.approx(motion.approach_speed, rel=1e-10)
    assert run.events[:, 6].sum() == pytest.approx(motion.energy_per_cycle, rel=1e-10)
    scale = np.abs(motion.start.q).max() + np.abs(motion.start.v).max()
    assert run.end.q == pytest.approx(motion.start.q, abs=1e-8 * scale)  # read AFTER of a half-cycle late
    assert run.end.u == pytest.approx(motion.start.u, rel=1e-10)


def mapped(system, variables):
    """Mirrored state just after the next impact, from modal coordinates, velocities, ball velocity and phase."""
    n = system.omega_squared.size
    turned = system._replace(drive_phase=variables[-1:])
    start = simulate_start(variables, n, system)
    half = pi / system.drive_omega[0]
    first = simulate(turned, 1.3 * half, start).events[0, 0]
    end = simulate(turned, first + AFTER, start).end
    phase = variables[-1] + system.drive_omega[0] * (first + AFTER)
    return np.concatenate([-end.q, -end.v, -end.u, [phase]])


def simulate_start(variables, n, system):
    return Start(0.0, variables[:n], variables[n : 2 * n], system.clearance.copy(), variables[2 * n : 2 * n + 1])


@pytest.mark.parametrize("case", CASES)
def test_jacobian_is_the_derivative_of_the_solver(case):
    motion = best(case)
    system, n = motion.system, motion.system.omega_squared.size
    after = np.concatenate([motion.start.q, motion.start.v])
    before = after - np.concatenate([np.zeros(n), 2 * system.mass[0] * motion.ball_speed * system.shape[0]])
    exact = half_cycle_jacobian(system, motion.ball_speed, before, after)
    centre = np.concatenate([after, [-motion.ball_speed, motion.force_phase]])
    step = 1e-5
    columns = []
    for k in range(centre.size):
        shift = np.zeros(centre.size)
        shift[k] = step
        columns.append((mapped(system, centre + shift) - mapped(system, centre - shift)) / (2 * step))
    numeric = np.array(columns).T
    assert numeric == pytest.approx(exact, abs=3e-7 * np.abs(exact).max())  # AFTER, step^2 and rounding / step


@pytest.mark.parametrize(("mass", "first", "last", "size"), [(0.05, 60, 160, 1e-3), (0.1, 14, 34, 1e-9)])
def test_perturbations_grow_and_decay_at_the_predicted_rates(mass, first, last, size):
    """Deviations of the approach speed obey d[n + 2] = 2 Re(l) d[n + 1] - |l|^2 d[n] once the leading pair is alone."""
    ball, force = Ball(mass, 30.0, 0.6), PointForce(1.0, UNIT)
    motion = symmetric_two_impact(oscillator(1.0, UNIT, 0.01), ball, force)[0]
    start = motion.start._replace(v=motion.start.v * (1 + size))
    events = simulate(motion.system, (last + 0.5) * pi, start).events
    deviation = (events[:last, 4] / motion.approach_speed - 1)[first:]
    weight = abs(motion.multipliers[0]) ** -np.arange(deviation.size - 2)
    rows = np.stack([deviation[1:-1], deviation[:-2]], axis=1) * weight[:, None]
    fit = np.linalg.lstsq(rows, deviation[2:] * weight, rcond=None)[0]
    measured = np.roots([1.0, -fit[0], -fit[1]])
    # 1e-3: the next multipliers, 0.61 / 0.95 and 0.75 / 1.43 per impact, and terms of second order
    assert sorted(measured.imag) == pytest.approx(sorted(motion.multipliers[:2].imag), abs=1e-3)
    assert measured.real == pytest.approx(motion.multipliers[:2].real, abs=1e-3)


def test_roots_with_further_contacts_are_marked():
    """Large clearance ratios below resonance: some roots pass through a wall; the solver leaves those at once."""
    seen = set()
    for frequency in (0.35, 0.5, 0.9, 1.1, 2.0, 3.5):
        for clearance in (0.05, 0.5, 2.0, 6.0):
            model, ball = oscillator(1.0, UNIT, 0.02), Ball(0.2, clearance, 0.3)
            for motion in symmetric_two_impact(model, ball, PointForce(1.0, frequency * UNIT)):
                half = pi / motion.system.drive_omega[0]
                run = simulate(motion.system, half, motion.start, sample_rate=4000 / half)
                offset = run.ball_position[:, 0] - run.q @ motion.system.shape[0]
                # free flight of the same motion, walls taken away: does it leave the cavity on the way?
                open_ = motion.system._replace(clearance=np.array([1e6]))
                far = motion.start._replace(offset=np.array([5e5]))
                flight = simulate(open_, half, far, sample_rate=4000 / half)
                gap = flight.ball_position[:, 0] - flight.q @ open_.shape[0] - 5e5 + clearance
                inside = (gap[2:-2] > 0).all() and (gap[2:-2] < clearance).all()
                assert motion.possible == inside
                assert (offset > -1e-9).all()
                assert (offset < clearance + 1e-9).all()
                seen.add(motion.possible)
    assert seen == {True, False}


@pytest.mark.parametrize("restitution", [0.0, 0.2, 0.5, 0.8])
def test_driven_motions_agree_with_the_field_theory(restitution):
    fold, stable = stroke_ratio_min(restitution), stroke_ratio_stable_max(restitution)
    last = stroke_ratio_max(restitution)
    assert driven_motions(0.999 * fold, restitution) == ()
    for ratio in np.geomspace(1.001 * fold, 8.0, 12):
        motions = {motion.branch: motion for motion in driven_motions(float(ratio), restitution)}
        theory = collect_and_collide(float(ratio), restitution)
        if "plastic" in motions:
            assert motions["plastic"].field == theory
            assert not motions["upper"].possible  # the wall keeps the ball
            continue
        upper = motions["upper"]
        assert upper.possible == (ratio < last)
        assert upper.stable == (ratio < stable)
        if theory.exists:
            assert upper.field.loss_factor == pytest.approx(theory.loss_factor, rel=1e-12)
            assert upper.field.effective_mass_ratio == pytest.approx(theory.effective_mass_ratio, abs=1e-12)
        assert "lower" not in motions or not motions["lower"].stable


@pytest.mark.parametrize(("ratio", "restitution"), [(0.95, 0.03), (0.5, 0.5), (1.3, 0.5), (0.8, 0.2)])
def test_multipliers_in_a_driven_container_are_those_of_the_solver(ratio, restitution):
    """Perturbed speed and phase at impact, mapped to the next impact and mirrored, by central differences."""
    for motion in driven_motions(ratio, restitution):
        if not motion.possible:
            continue
        system, start = driven_start(ratio, restitution, motion.impact_angle)

        def image(shift, system=system, start=start):
            turned = system._replace(drive_phase=system.drive_phase + shift[1])
            begun = start._replace(u=start.u + shift[0])
            first = simulate(turned, 1.3 * pi, begun).events[0, 0]
            end = simulate(turned, first + AFTER, begun).end
            return np.array([-end.u[0], turned.drive_phase[0] + first])

        step = 1e-5
        columns = [(image(d) - image(-d)) / (2 * step) for d in step * np.eye(2)]
        numeric = np.linalg.eigvals(np.array(columns).T)
        assert sorted(abs(numeric)) == pytest.approx(sorted(abs(motion.multipliers)), rel=1e-5, abs=2e-3)


@pytest.mark.parametrize(("alpha", "expected"), [(1.02 / pi, None), (0.5 / pi, 0.0), (2.0 / pi, None)])
def test_plastic_free_decay_has_the_damping_of_collect_and_collide(alpha, expected):
    """A plastic ball of 1e-6 of the mass: Psi_m per cycle is 2 pi eta, 8 near alpha = 1 / pi, 0 at half of it."""
    mass = 1e-6
    system = on_structure(oscillator(1.0, UNIT), [Ball(mass, 1.0 / alpha, 0.0)])
    run = free_decay(system, 1.0, cycles_max=6.25)
    lost = run.ledger.impacts / (6 * mass / 2)
    if expected is None:
        expected = 2 * pi * collect_and_collide(pi * alpha).loss_factor
        assert lost == pytest.approx(expected, rel=1e-4)  # the amplitude falls by 2e-5 a cycle
        assert alpha * pi > 1.5 or lost == pytest.approx(8.0, rel=0.01)
    else:
        assert lost < 0.01


def test_a_clearance_of_pi_amplitudes_makes_the_first_impact_head_on():
    ball = Ball(0.027, pi, 0.3)
    system = on_structure(oscillator(1.0, UNIT), [ball])
    run = simulate(system, 5.0, released(system, sqrt(1.027)))
    hit = run.events[run.events[:, 2] == IMPACT][0]
    assert hit[4] == pytest.approx(2.0, rel=1e-10)
