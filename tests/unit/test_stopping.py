import numpy as np
import pytest
from numpy.testing import assert_allclose

from graindamp.signals.stopping import LEAST_CYCLES, Stopping, estimate, standard_error

SEED = 11


def correlated(n, time, rng):
    """First-order autoregressive noise of unit variance whose integrated autocorrelation time is `time` cycles."""
    r = (time - 1.0) / (time + 1.0)
    noise = rng.normal(size=n)
    value = np.empty(n)
    value[0] = noise[0]
    for k in range(1, n):
        value[k] = r * value[k - 1] + np.sqrt(1.0 - r * r) * noise[k]
    return value


@pytest.mark.parametrize("time", [1.0, 3.0, 8.0])
def test_standard_errors_are_those_that_repeats_show(time):
    """Mean estimate over 300 series of 160 cycles against their scatter; the larger of two estimates is high by about a
    fifth, and 20 correlation times in a series leave it low by as much."""
    rng = np.random.default_rng(SEED)
    series = [correlated(160, time, rng) for _ in range(300)]
    told = np.sqrt(np.mean([standard_error(one) ** 2 for one in series]))
    assert 0.85 < told / np.std([one.mean() for one in series]) < 1.45


def test_slow_wandering_is_seen_by_the_batches():
    """A wave over half the record is invisible to neighbouring cycles; the error must be of the size of its mean."""
    rng = np.random.default_rng(SEED)
    fast = 0.01 * rng.normal(size=128)
    slow = 0.1 * np.sin(2 * np.pi * np.arange(128) / 64.0)
    assert standard_error(fast + slow) > 10 * standard_error(fast)


def test_a_transient_is_dropped_and_the_rest_averaged():
    rng = np.random.default_rng(SEED)
    k = np.arange(60)
    loss = 0.8 + 0.5 * np.exp(-k / 4.0) + 0.01 * rng.normal(size=60)
    ratio = 0.3 + 0.01 * rng.normal(size=60)
    found = estimate(loss, ratio)
    assert 8 <= found.n_skipped <= 30
    assert found.n_skipped + found.n_cycle == 60
    assert found.is_steady
    assert_allclose(found.loss_factor, 0.8, atol=4 * found.loss_factor_se + 0.005)


@pytest.mark.parametrize("which", ["loss", "ratio"])
def test_a_slow_drift_of_either_value_is_no_steady_state(which):
    rng = np.random.default_rng(SEED)
    drift = 0.3 * np.linspace(0.0, 1.0, 80)
    loss, ratio = (0.5 + 0.005 * rng.normal(size=80) for _ in range(2))
    found = estimate(loss + drift, ratio) if which == "loss" else estimate(loss, ratio + drift)
    assert not found.is_steady
    assert estimate(loss, ratio).is_steady


def test_drift_below_the_floor_does_not_matter():
    drift = np.linspace(0.0, 0.002, 80)  # 4 % of the floor of 0.05
    assert estimate(0.001 + drift, np.ones(80)).is_steady
    assert not estimate(0.001 + drift, np.ones(80), floor=0.005).is_steady


def run_of(rule, loss, ratio):
    """Cycles after which a rule ends a series; its length where it never does."""
    return next((n for n in range(1, len(loss) + 1) if rule.enough(loss[:n], ratio[:n])), len(loss))


def test_a_repeating_bed_ends_at_the_first_look():
    assert run_of(Stopping(0.02, 0.05, 12), np.full(100, 0.4), np.full(100, 0.2)) == 12
    assert run_of(Stopping(0.02, 0.05, 2), np.full(100, 0.4), np.full(100, 0.2)) == LEAST_CYCLES


def test_the_error_asked_for_is_reached_at_about_the_right_length():
    """White noise of 20 % needs (0.2/0.02)^2 = 100 cycles for 2 %; looking at growing lengths, the larger of two errors
    and a dropped start make it up to about 2.5 times as many."""
    rng = np.random.default_rng(SEED)
    lengths = []
    for _ in range(20):
        loss, ratio = 0.4 * (1 + 0.2 * rng.normal(size=600)), np.zeros(600)
        lengths.append(run_of(Stopping(0.02, 0.05, 12), loss, ratio))
    assert 60 < np.median(lengths) < 260


def test_a_bounce_that_locks_in_late_is_waited_for():
    loss = np.concatenate([np.full(18, 0.2), 0.2 + 0.8 * np.linspace(0, 1, 12), np.full(200, 1.0)])
    rng = np.random.default_rng(SEED)
    loss = loss * (1 + 0.03 * rng.normal(size=len(loss)))
    n = run_of(Stopping(0.02, 0.05, 20), loss, np.zeros(len(loss)))
    found = estimate(loss[:n], np.zeros(n))
    assert_allclose(found.loss_factor, 1.0, atol=0.03)
    assert found.n_skipped >= 28


def test_three_cycles_give_a_mean_without_a_warning():
    found = estimate(np.array([1.0, 0.5, 0.2]), np.zeros(3))
    assert found.n_cycle == 3
    assert np.isfinite(found.loss_factor_se)


def test_too_few_cycles_are_refused():
    with pytest.raises(ValueError, match="two cycles"):
        estimate(np.array([1.0]), np.array([1.0]))
