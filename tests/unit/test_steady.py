"""Means over correlated cycles: coverage of the errors, transients, drift."""

import numpy as np
import pytest

from graindamp.signals.steady import correlation_time, steady_mean, transient_length


def autoregressive(memory, n, rng):
    noise = rng.normal(size=n + 100)
    value = np.zeros(n + 100)
    for k in range(1, n + 100):
        value[k] = memory * value[k - 1] + noise[k]
    return value[100:]


def test_correlation_time_of_an_autoregressive_series():
    """(1 + a) / (1 - a) = 3 for a = 0.5; the estimate over 20000 steps scatters by a few per cent."""
    value = autoregressive(0.5, 20_000, np.random.default_rng(5))
    assert correlation_time(value) == pytest.approx(3.0, rel=0.1)


@pytest.mark.parametrize(
    ("memory", "n", "least"), [(0.0, 22, 0.90), (0.0, 200, 0.93), (0.5, 40, 0.84), (0.5, 400, 0.91)]
)
def test_two_standard_errors_cover_the_mean(memory, n, least):
    """95 % for a normal mean; fewer for short correlated series, whose correlation no estimator knows well."""
    rng = np.random.default_rng(11)
    hits = 0
    for _ in range(300):
        result = steady_mean(10 + autoregressive(memory, n, rng))
        hits += abs(result.mean - 10) < 2 * result.standard_error
    assert least < hits / 300 <= 1.0


def test_alternating_cycles_do_not_inflate_the_error():
    """A bed that answers with half the drive repeats every two cycles; its mean is then known exactly."""
    value = 0.3 + 0.1 * (-1.0) ** np.arange(30)
    result = steady_mean(value)
    assert result.mean == pytest.approx(0.3)
    assert result.standard_error < 1e-12
    assert result.is_steady


def test_transient_is_dropped_and_no_more():
    rng = np.random.default_rng(2)
    value = 0.5 + 0.02 * rng.normal(size=40) + np.exp(-np.arange(40) / 2.0)
    assert 4 <= transient_length(value) <= 13  # the transient is below the noise after 8 cycles
    assert transient_length(0.5 + 0 * value) == 0


def test_drift_is_named_and_widens_the_error():
    rng = np.random.default_rng(3)
    value = np.linspace(0.8, 1.0, 22) + 0.01 * rng.normal(size=22)
    result = steady_mean(value)
    assert not result.is_steady
    assert result.standard_error > 0.2 / np.sqrt(12) * 0.9  # rms of the trend about its mean
    assert steady_mean(0.9 + 0.01 * rng.normal(size=22)).is_steady


def test_a_drift_that_does_not_matter_is_left_alone():
    """A perfectly straight trend of 1 % is significant, but smaller than what anyone asks of a loss factor."""
    assert steady_mean(np.linspace(1.0, 1.01, 30)).is_steady
