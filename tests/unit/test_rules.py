"""Design rules: the published table, inverses, and messages."""

from math import exp, log, pi, sqrt

import pytest

from graindamp.design.rules import (
    clearance_for,
    coating_frequency,
    coating_modulus,
    efficiency_damping_ratio,
    frequency_for,
    loss_factor_from_decay,
    optimal_stroke,
)
from graindamp.errors import InputError

RADIUS = 1.25e-3
STEEL = {
    "n_line": 20,
    "particle_mass": 7900 * 4 / 3 * pi * RADIUS**3,
    "particle_radius": RADIUS,
    "particle_youngs_modulus": 208e9,
    "particle_poisson": 0.3,
}
GRAVITY_SHIFT = 4e-4
"""The published table uses g = 9.81, the library 9.80665: 3.4e-4 in proportion, 1.7e-4 under a root."""


@pytest.mark.parametrize(("frequency", "clearance"), [(50, 4.684e-3), (60, 3.253e-3), (80, 1.830e-3)])
def test_clearance_matches_published_design(frequency, clearance):
    rule = clearance_for(frequency)
    assert rule.clearance == pytest.approx(clearance, rel=GRAVITY_SHIFT + 3e-4)  # 3e-4: four digits of 1.830
    assert rule.intensity == 15.0
    assert optimal_stroke(rule.clearance).stroke == pytest.approx(rule.stroke, rel=1e-14)  # rounding


def test_frequency_for_inverts_clearance_for():
    rule = clearance_for(73.0, 22.0)
    assert frequency_for(rule.clearance, 22.0) == pytest.approx(rule, rel=1e-14)  # rounding


def test_optimal_stroke_of_a_plastic_and_a_bouncing_bed():
    plastic, bouncing = optimal_stroke(pi * 1e-3), optimal_stroke(pi * 1e-3, restitution=0.5)
    assert plastic == pytest.approx((1e-3, 0.8436e-3, 4 / pi), rel=1e-4)  # four digits of the existence limit
    assert bouncing == pytest.approx((1e-3 / 3, 0.3261e-3, 12 / pi), rel=2e-4)  # four digits of the existence limit


@pytest.mark.parametrize(("frequency", "modulus"), [(50, 0.2545e6), (60, 0.4398e6), (80, 1.0424e6)])
def test_coating_modulus_matches_published_design(frequency, modulus):
    rule = coating_modulus(frequency, **STEEL)
    assert rule.wall_modulus == pytest.approx(modulus, rel=GRAVITY_SHIFT / 2 + 2e-4)  # 2e-4: four digits of 0.2545
    assert not rule.extrapolated


@pytest.mark.parametrize(("modulus", "frequency"), [(0.27e6, 51.0), (0.72e6, 70.7), (1.4e6, 88.3)])
def test_coating_frequency_of_the_published_materials(modulus, frequency):
    assert coating_frequency(modulus, **STEEL).frequency == pytest.approx(frequency, abs=0.06)  # one decimal


def test_coating_frequency_inverts_coating_modulus():
    adjusted = {"wall_poisson": 0.33, "intensity": 2.0, "speed_ratio": 1.3, "compression_ratio": 0.8}
    rule = coating_modulus(70.0, **STEEL, **adjusted)
    assert coating_frequency(rule.wall_modulus, **STEEL, **adjusted) == pytest.approx(rule, rel=1e-12)  # rounding


def test_coating_is_compressed_by_the_stroke():
    """Hertz: a sphere of n particles at speed a V compresses the wall by (5 M v^2 / 4 k)^(2/5); X / b in the rule."""
    ratio, compression, intensity, frequency = 1.3, 0.8, 2.0, 60.0
    rule = coating_modulus(frequency, **STEEL, intensity=intensity, speed_ratio=ratio, compression_ratio=compression)
    stroke = clearance_for(frequency, intensity).stroke
    speed = ratio * 2 * pi * frequency * stroke
    stiffness = 4 / 3 * rule.effective_modulus * sqrt(RADIUS)
    depth = (5 * STEEL["n_line"] * STEEL["particle_mass"] * speed**2 / (4 * stiffness)) ** 0.4
    assert depth == pytest.approx(stroke / compression, rel=1e-12)  # rounding


def test_stiff_coatings_are_flagged():
    assert coating_frequency(55e6, **STEEL).extrapolated
    assert coating_frequency(55e6, **STEEL).frequency == pytest.approx(300, rel=2e-3)  # three digits
    assert coating_modulus(100.5, **STEEL).extrapolated


@pytest.mark.parametrize(
    ("modulus", "text"),
    [
        (0.27e6, ""),
        (0.72e6, ""),
        (1.4e6, "1.4 MPa, by rule for 88 Hz"),
        (55e6, "500 Hz"),
        (0.1e6, "from 50 to 80 Hz only"),
    ],
)
def test_coating_rule_names_its_limits(modulus, text):
    limits = coating_frequency(modulus, **STEEL).limits
    assert text in limits
    assert bool(text) == bool(limits)


@pytest.mark.parametrize("length", [47.5e-3, 52.5e-3])
def test_particles_in_line_must_be_twenty_for_the_published_moduli(length):
    """With 19 or 21 in line the published 0.44 MPa would be 0.42 or 0.46."""
    n_line = length / (2 * RADIUS)
    rule = coating_modulus(60.0, **(STEEL | {"n_line": n_line}))
    assert rule.wall_modulus / 0.4398e6 == pytest.approx(n_line / 20, rel=1e-3)  # g, and 1e-5 of the ball's elasticity


def test_efficient_damper_on_a_mode():
    """Modal values read from the first mode of a measured beam: phi^2 m_bed = 0.116 gives 5.2 %."""
    rule = efficiency_damping_ratio(0.332, 0.35)
    assert rule.damping_ratio == pytest.approx(0.052, abs=5e-4)  # two digits
    assert rule.mass_ratio == pytest.approx(0.116, abs=5e-4)  # three digits


def test_damping_ratio_is_that_of_the_complex_effective_mass():
    """Mode of unit mass loaded by M = m' - i eta: -W^2 (1 + mu M) + k = 0 has its pole at damping ratio zeta."""
    mass_ratio, loss_factor, effective = 0.02, 0.7, -0.3
    rule = efficiency_damping_ratio(mass_ratio / 0.35, 0.35, loss_factor, effective)
    pole = 1 / (1 + mass_ratio * (effective - 1j * loss_factor)) ** 0.5
    assert rule.damping_ratio == pytest.approx(pole.imag / abs(pole), rel=1e-3)  # zeta^2 and mu^2, both below 1e-3
    assert rule.specific_damping == pytest.approx(2 * pi * loss_factor * mass_ratio / (1 + mass_ratio * effective))


def test_decay_gives_back_the_loss_factor():
    rule = efficiency_damping_ratio(0.1, 0.35, 0.8, 0.5)
    decrement = 2 * pi * rule.damping_ratio / sqrt(1 - rule.damping_ratio**2)
    back = loss_factor_from_decay(1 - exp(-2 * decrement), rule.mass_ratio, 0.5)
    assert back == pytest.approx((0.8, rule.damping_ratio), rel=1e-12)  # rounding
    small = loss_factor_from_decay(1e-4, 0.03)
    assert small.loss_factor == pytest.approx(1e-4 * 1.03 / (2 * pi * 0.03), rel=1e-4)  # next order of log(1 - decay)
    assert loss_factor_from_decay(0.5, 0.03).damping_ratio == pytest.approx(log(2) / (4 * pi), rel=2e-3)  # zeta^2 / 2


def test_mode_without_motion_at_the_damper_is_not_damped():
    assert efficiency_damping_ratio(0.0, 0.35, effective_mass_ratio=-5.0) == (0.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("call", "text"),
    [
        (lambda: optimal_stroke(-1e-3), "clearance is -0.001, but must be a finite number > 0"),
        (lambda: optimal_stroke(1e-3, 1.0), "restitution is 1.0, but must be a finite number >= 0 and < 1"),
        (lambda: clearance_for(float("nan")), "frequency is nan"),
        (lambda: frequency_for(1e-3, 0.0), "intensity is 0.0"),
        (lambda: coating_modulus(0.0, **STEEL), "design_frequency is 0.0"),
        (lambda: coating_modulus(60.0, **(STEEL | {"n_line": 0.5})), "n_line is 0.5, but must be a finite number >= 1"),
        (lambda: coating_modulus(60.0, **(STEEL | {"particle_poisson": 0.6})), "particle_poisson is 0.6"),
        (lambda: coating_modulus(60.0, **STEEL, wall_poisson=-1.0), "wall_poisson is -1.0"),
        (lambda: coating_modulus(60.0, **STEEL, speed_ratio=0.0), "speed_ratio is 0.0"),
        (lambda: coating_modulus(6000.0, **STEEL), "even a rigid wall gives only 2.29e"),
        (lambda: coating_frequency(-1.0, **STEEL), "wall_modulus is -1.0"),
        (lambda: efficiency_damping_ratio(0.3, 0.0), "bed_mass is 0.0"),
        (lambda: efficiency_damping_ratio(-0.3, 0.35), "shape_squared is -0.3"),
        (lambda: efficiency_damping_ratio(0.3, 0.35, -0.1), "loss_factor is -0.1"),
        (lambda: efficiency_damping_ratio(1.0, 1.0, 1.0, -1.5), "effective_mass_ratio is -1.5, but .* above -1,"),
        (lambda: loss_factor_from_decay(1.0, 0.03), "decay is 1.0"),
    ],
)
def test_message_names_argument_value_and_range(call, text):
    with pytest.raises(InputError, match=text):
        call()
