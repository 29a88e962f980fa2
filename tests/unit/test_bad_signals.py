"""Records that cannot be trusted are named as what they are, with the number that shows it."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from graindamp.errors import InputError
from graindamp.signals.checks import clipped_share
from graindamp.signals.power import analyze, calibration_from
from graindamp.status import FATAL, REMEDY, Status, describe
from signals_made import linear_bed, record_of

BED = 0.132


def good(**options):
    return record_of(linear_bed(0.5, 0.5, BED, 100.0, 0.3), noise=1e-3, **options)


def spoiled(name):
    record = good()
    n = len(record.force)
    time = np.arange(n) / record.sampling_rate
    if name == "nan":
        return record._replace(force=np.where(np.arange(n) == 123, np.nan, record.force))
    if name == "inf":
        return record._replace(motion=np.where(np.arange(n) > n - 5, np.inf, record.motion))
    if name == "short":
        return record._replace(force=record.force[:900], motion=record.motion[:900])
    if name == "few samples":
        return record._replace(force=record.force[:9], motion=record.motion[:9])
    if name == "empty":
        return record._replace(force=record.force[:0], motion=record.motion[:0])
    if name == "clipped force":
        return record._replace(force=np.clip(record.force, -0.7 * record.force.max(), 0.7 * record.force.max()))
    if name == "clipped motion":
        return record._replace(motion=np.minimum(record.motion, 0.25))
    if name == "sweep":
        return record._replace(motion=0.3 * np.cos(2 * np.pi * (95 * time + 20 * time**2)), frequency=None)
    if name == "square":
        return record._replace(motion=0.3 * np.sign(np.cos(2 * np.pi * 100 * time)) + 1e-3 * time)
    if name == "noise":
        return record._replace(motion=np.random.default_rng(1).normal(size=n), frequency=None)
    if name == "length":
        return record._replace(force=record.force[:-7])
    if name == "rate":
        return record._replace(motion_rate=2 * record.sampling_rate)
    if name == "still":
        return record._replace(motion=np.full(n, 0.1))
    if name == "dead force":
        return record._replace(force=np.zeros(n))
    if name == "other frequency":
        return record._replace(frequency=120.0)
    if name == "harmonic given":
        return record._replace(frequency=200.0)
    if name == "slow sampling":
        return record._replace(sampling_rate=300.0, motion_rate=300.0)
    raise ValueError(name)


@pytest.mark.parametrize(
    ("name", "status", "word"),
    [
        ("nan", Status.NOT_FINITE, "sample 124"),
        ("inf", Status.NOT_FINITE, "velocity"),
        ("short", Status.TOO_SHORT, "cycles"),
        ("few samples", Status.TOO_SHORT, "9 samples"),
        ("empty", Status.TOO_SHORT, "0 samples"),
        ("clipped force", Status.CLIPPED, "force"),
        ("clipped motion", Status.CLIPPED, "velocity"),
        ("sweep", Status.FREQUENCY_DRIFT, "rad"),
        ("square", Status.NOT_SINUSOIDAL, "%"),
        ("length", Status.LENGTH_MISMATCH, "samples"),
        ("rate", Status.RATE_MISMATCH, "Hz"),
        ("still", Status.NO_MOTION, "constant"),
        ("dead force", Status.NO_FORCE, "constant"),
        ("other frequency", Status.FREQUENCY_MISMATCH, "100"),
        ("harmonic given", Status.FREQUENCY_MISMATCH, "100"),
        ("slow sampling", Status.UNDERSAMPLED, "300 Hz"),
    ],
)
def test_is_named_and_gives_no_value(name, status, word):
    point = analyze(spoiled(name), BED, 0.085)
    assert point.status & status, point.problems
    assert any(word in problem.text for problem in point.problems)
    assert np.isnan(point.loss_factor)
    assert describe(int(point.status))


def test_noise_has_no_frequency_to_find():
    """Which of the two names it gets depends on the noise; that it gets no value does not."""
    point = analyze(spoiled("noise"), BED, 0.085)
    assert point.status & (Status.FREQUENCY_DRIFT | Status.NOT_SINUSOIDAL | Status.NO_MOTION)
    assert np.isnan(point.loss_factor)


def test_a_good_record_has_no_problem():
    point = analyze(good(), BED, 0.085, phase_uncertainty=1e-4)
    assert point.problems == ()
    assert point.loss_factor == pytest.approx(0.5, abs=4 * point.loss_factor_error)


def test_harmonics_in_the_motion_are_flagged_and_the_fundamental_kept():
    record = good()
    time = np.arange(len(record.motion)) / record.sampling_rate
    point = analyze(record._replace(motion=record.motion + 0.03 * np.cos(2 * np.pi * 300 * time)), BED, 0.085)
    assert point.status & Status.DISTORTED
    assert point.loss_factor == pytest.approx(0.5, abs=0.01)


def test_accelerometer_noise_weighs_as_the_velocity_it_is():
    """White noise of 30 % in an acceleration is harmless ringing at kHz; as velocity it would be refused."""
    record = record_of(linear_bed(0.5, 0.5, BED, 100.0, 0.3), motion_kind="acceleration")
    noise = 0.5 * np.std(record.motion) * np.random.default_rng(1).normal(size=len(record.motion))
    assert not analyze(record._replace(motion=record.motion + noise), BED, 0.085).status & FATAL
    velocity = good()
    noise = 0.5 * np.std(velocity.motion) * np.random.default_rng(1).normal(size=len(velocity.motion))
    assert analyze(velocity._replace(motion=velocity.motion + noise), BED, 0.085).status & Status.NOT_SINUSOIDAL


def test_growing_amplitude_is_flagged():
    record = good()
    ramp = np.linspace(0.8, 1.2, len(record.motion))
    point = analyze(record._replace(motion=ramp * record.motion, force=ramp * record.force), BED, 0.085)
    assert point.status & Status.AMPLITUDE_DRIFT


@pytest.mark.parametrize("kind", ["velocity", "acceleration", "displacement"])
def test_rest_before_and_after_the_motion_is_left_out(kind):
    """Five cycles at rest before the drive starts and ten after it ends: the motion in between gives the value."""
    record = record_of(linear_bed(0.5, 0.5, BED, 100.0, 0.3), motion_kind=kind, n_cycle=30)
    before, after = round(5 * record.sampling_rate / 100), round(10 * record.sampling_rate / 100)
    rest = {"force": record.force, "motion": record.motion}
    padded = {name: np.concatenate([np.zeros(before), v, np.zeros(after)]) for name, v in rest.items()}
    noise = 1e-4 * np.random.default_rng(5).normal(size=(2, before + len(record.force) + after))
    spread = {name: padded[name] + row * np.std(padded[name]) for name, row in zip(padded, noise, strict=True)}
    point = analyze(record._replace(**spread), BED, 0.085, phase_uncertainty=0.0)
    assert not point.status & (FATAL | Status.AMPLITUDE_DRIFT | Status.DISTORTED), point.problems
    assert point.loss_factor == pytest.approx(0.5, abs=1e-3)  # noise of 1e-4 over 20 cycles
    assert np.isfinite(point.loss_factor_error)
    assert 20 <= point.n_cycle <= 30


def test_reversed_force_is_not_passive():
    record = good()
    assert analyze(record._replace(force=-record.force), BED, 0.0).status & Status.NOT_PASSIVE


def test_units_that_are_a_thousand_times_off_are_doubted():
    record = good()
    for changed, mass, told in (
        (record._replace(motion=1e3 * record.motion), 0.0, "Gamma"),
        (record._replace(force=1e-3 * record.force), 0.085, "nothing beside"),
        (record, 85.0, "nothing beside"),
    ):
        point = analyze(changed, BED, mass)
        assert point.status & Status.IMPLAUSIBLE
        assert any(told in problem.text for problem in point.problems)
    assert not analyze(record, BED, 0.085).status & Status.IMPLAUSIBLE


@given(levels=st.integers(3, 2000), offset=st.floats(-0.5, 0.5), samples=st.floats(8, 400))
@settings(max_examples=60, deadline=None)
def test_a_coarse_converter_is_not_clipping(levels, offset, samples):
    """Quantised sines pile up at their peaks, by no more than 2.4 times the next level."""
    angle = 2 * np.pi * np.arange(12_000) / samples
    assert clipped_share(np.round(levels * np.sin(angle + 0.3) + offset)) == 0.0


def test_empty_run_that_weighs_wrong_is_told():
    empty = record_of(lambda angle: 0 * angle, container_mass=0.085)
    calibration, problems = calibration_from([empty], 0.1)
    assert problems[0].status == Status.MASS_MISMATCH
    assert "85" in problems[0].text
    assert calibration.mass[0] == pytest.approx(0.085, rel=1e-6)
    with pytest.raises(InputError, match="empty-container run cannot be used"):
        calibration_from([spoiled("nan")], None)


def test_every_bit_has_a_remedy():
    assert set(REMEDY) == {bit for bit in Status if bit}
