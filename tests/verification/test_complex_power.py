"""Complex power against closed forms: linear beds, a sliding block, a bed thrown from wall to wall."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from graindamp.field.theory import collect_and_collide, sliding_bed
from graindamp.signals.equivalent import equivalent
from graindamp.signals.power import analyze, calibration_from
from graindamp.status import Status
from graindamp.units import STANDARD_GRAVITY
from signals_made import linear_bed, record_of

BED, CONTAINER = 0.132, 0.085


def result_of(bed_force, **options):
    return analyze(record_of(bed_force, container_mass=CONTAINER, **options), BED, CONTAINER, phase_uncertainty=0.0)


@given(
    eta=st.floats(0.0, 2.0),
    mass=st.floats(-0.5, 2.0),
    frequency=st.floats(20.0, 2000.0),
    rate=st.floats(9.3e3, 51.2e3),
)
@settings(max_examples=40, deadline=None)
def test_linear_bed_any_number_of_samples_per_cycle(eta, mass, frequency, rate):
    """Least squares is exact for a pure sine, whatever the samples per cycle: only rounding is left."""
    point = result_of(linear_bed(eta, mass, BED, frequency, 0.3), frequency=frequency, sampling_rate=rate)
    assert point.loss_factor == pytest.approx(eta, abs=1e-8)
    assert point.effective_mass_ratio == pytest.approx(mass, abs=1e-8)


@pytest.mark.parametrize("kind", ["velocity", "acceleration", "displacement"])
def test_all_motion_kinds_agree(kind):
    point = result_of(linear_bed(0.7, 0.4, BED, 100.0, 0.3), motion_kind=kind)
    assert point.loss_factor == pytest.approx(0.7, abs=1e-8)  # rounding
    assert point.intensity == pytest.approx(2 * np.pi * 100 * 0.3 / STANDARD_GRAVITY, rel=1e-8)  # rounding


def test_every_derived_quantity_follows_its_definition():
    point = result_of(linear_bed(0.7, 0.4, BED, 100.0, 0.3))
    omega, v = 2 * np.pi * 100, 0.3
    rounding = {"rel": 1e-7}
    assert point.power == pytest.approx(0.5 * 0.7 * BED * v**2 * omega, **rounding)
    assert point.dissipated_energy == pytest.approx(np.pi * 0.7 * BED * v**2, **rounding)
    assert point.energy_per_radian == pytest.approx(point.power / omega, **rounding)
    assert point.viscous_coefficient == pytest.approx(0.7 * BED * omega, **rounding)
    assert point.modulus_ratio == pytest.approx(np.hypot(0.7, 0.4), **rounding)
    assert point.harmonic_power[0] == pytest.approx(point.power, **rounding)
    assert np.abs(point.harmonic_power[1:]).max() < 1e-9 * point.power  # a sine carries no power in harmonics


def test_frequency_is_found_from_the_motion():
    """30 cycles with 1 % noise fix the frequency to a few parts in a million."""
    point = result_of(linear_bed(0.7, 0.4, BED, 137.3, 0.3), frequency=137.3, tell_frequency=False, noise=0.01)
    assert point.frequency == pytest.approx(137.3, rel=2e-5)
    assert point.loss_factor == pytest.approx(0.7, abs=4 * point.loss_factor_error)


@pytest.mark.parametrize("ratio", [1.2, 1.5, 2.0, 10.0])
def test_sliding_block_in_the_time_domain(ratio):
    """A block integrated in time gives the closed form; 1e-3 is the resolution of its slip events in time."""
    friction, frequency, rate = 0.1, 20.0, 40_000.0
    gamma = ratio * friction
    omega = 2 * np.pi * frequency
    v = gamma * STANDARD_GRAVITY / omega
    n = int(40 * rate / frequency)
    time = np.arange(n) / rate
    drag = np.empty(n)
    speed = 0.0
    for k, t in enumerate(time):
        wall, pull = v * np.cos(omega * t), -omega * v * np.sin(omega * t)
        slip = wall - speed
        limit = friction * STANDARD_GRAVITY
        need = pull + slip * rate  # acceleration that would end the slip within this step
        drag[k] = np.clip(need, -limit, limit)
        speed += drag[k] / rate
    record = record_of(lambda angle: BED * drag, frequency, v, 40, rate, CONTAINER)
    point = analyze(record, BED, CONTAINER, phase_uncertainty=0.0, skip_cycles=10)
    exact = sliding_bed(gamma, friction)
    assert point.loss_factor == pytest.approx(exact.loss_factor, abs=4e-3)  # steps of 1/2000 cycle, two events each
    assert point.effective_mass_ratio == pytest.approx(exact.effective_mass_ratio, abs=4e-3)


@pytest.mark.parametrize("stroke_ratio", [1.1, 1.5, 3.0])
def test_bouncing_bed_as_force_signal(stroke_ratio):
    """Impulses spread over two samples: the fundamental sees them to the second order of the sample length."""
    exact = collect_and_collide(stroke_ratio)
    phi = np.linspace(1e-6, np.pi, 400_001)
    phi = phi[np.argmin(np.abs(phi - np.sin(phi) - np.pi / stroke_ratio))]
    frequency, v, rate = 50.0, 0.5, 50_000.0
    step = 2 * np.pi * frequency / rate

    def force(angle):
        folded = np.mod(angle, np.pi)
        sign = np.where(np.mod(angle, 2 * np.pi) < np.pi, 1.0, -1.0)
        riding = np.where(folded > phi, -np.sin(folded), 0.0) * 2 * np.pi * frequency * v
        share = np.maximum(0.0, 1 - np.abs(folded - phi) / step)  # hat of one sample to each side
        kick = v * (np.cos(phi) - 1) * share * rate
        return BED * sign * (riding + kick)

    point = result_of(force, frequency=frequency, velocity_amplitude=v, sampling_rate=rate)
    assert point.loss_factor == pytest.approx(exact.loss_factor, abs=2e-3)  # jump of the riding force, half a sample
    assert point.effective_mass_ratio == pytest.approx(exact.effective_mass_ratio, abs=2e-3)


def test_delay_is_taken_out_by_the_empty_run():
    """The channels of 35 us delay give the clean value once the empty container has told the phase."""
    delay = 35e-6
    bed = linear_bed(0.05, 0.1, BED, 250.0, 0.3)
    options = {"frequency": 250.0, "container_mass": CONTAINER, "delay": delay, "noise": 1e-3}
    empty = record_of(lambda angle: 0 * angle, seed=7, is_empty=True, **options)
    calibration, problems = calibration_from([empty], CONTAINER)
    assert not problems
    assert calibration.phase[0] == pytest.approx(-2 * np.pi * 250 * delay, abs=4 * calibration.standard_error[0])
    filled = record_of(bed, **options)
    clean = analyze(filled, BED, CONTAINER, calibration)
    assert clean.loss_factor == pytest.approx(0.05, abs=4 * clean.loss_factor_error)
    raw = analyze(filled, BED, CONTAINER)
    bias = 2 * np.pi * 250 * delay * (CONTAINER / BED + 0.1)
    assert raw.loss_factor - 0.05 == pytest.approx(bias, rel=0.02)  # small-angle form of the phase error
    assert raw.status & Status.PHASE_UNCERTAIN
    assert "%" in raw.problems[-1].text
    assert not clean.status & Status.PHASE_UNCERTAIN


def test_one_degree_costs_what_the_mass_ratio_says():
    """1 degree on total mass M biases eta by 0.0175 M / m_bed: the number in the warning and in the error."""
    record = record_of(linear_bed(0.2, 1.0, BED, 100.0, 0.3), container_mass=CONTAINER)
    point = analyze(record, BED, CONTAINER)
    assert point.loss_factor_error == pytest.approx(np.deg2rad(1) * (BED + CONTAINER) / BED, rel=1e-6)


def test_equivalents_of_2009():
    """c_eq agrees with d_eff; m_eq of a pure mass is that mass, with impact noise it is biased upwards."""
    frequency, v = 100.0, 0.3
    record = record_of(linear_bed(0.5, 0.3, BED, frequency, v), container_mass=CONTAINER)
    pair = equivalent(record, CONTAINER)
    omega = 2 * np.pi * frequency
    assert pair.viscous_coefficient == pytest.approx(0.5 * BED * omega, rel=5e-3)  # windows of whole samples
    assert pair.mass == pytest.approx(0.3 * BED, rel=5e-3)  # likewise
    noisy = equivalent(
        record._replace(force=record.force + 20 * np.random.default_rng(3).normal(size=len(record.force))), CONTAINER
    )
    assert noisy.mass > 2 * pair.mass
    assert noisy.is_mass_biased
