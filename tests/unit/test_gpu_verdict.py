"""The rule that the device stops by, as plain Python, against the rule of the processor."""

import math

import numpy as np
import pytest

from graindamp.dem.gpu import verdict
from graindamp.dem.gpu.columns import (
    ENOUGH,
    ETA,
    FLOOR,
    N_CODE,
    N_COUNT,
    N_NUMBER,
    N_ROW,
    N_SERIES,
    NEXT_LOOK,
    PAIRS,
    PER_ROW,
    RATIO,
    ROW,
    ROW_STEPS,
    TOLERANCE,
    UNTIL,
    UNTIL_CYCLE,
    UNTIL_KNOWN,
    WHOLE_MASS,
)
from graindamp.signals.simulated import ratios_of
from graindamp.signals.steady import correlation_time
from graindamp.signals.stopping import LEAST_CYCLES, Stopping, _drifts, estimate, standard_error

ROUNDING = 1e-9
"""Sums of a hundred numbers in another order differ by 1e-14; differences of sums magnify it."""
OMEGA, MASS, STEPS = 700.0, 0.3, 40


def autoregressive(n, r, rng):
    """Noise of which the share `r` is that of the cycle before."""
    value = np.empty(n)
    value[0] = rng.normal()
    for k in range(1, n):
        value[k] = r * value[k - 1] + math.sqrt(1.0 - r * r) * rng.normal()
    return value


def series_of(kind, n, rng):
    """eta and m' of `n` cycles."""
    k, noise = np.arange(n), rng.normal(size=(2, n))
    size = 10.0 ** rng.uniform(-3.0, -0.5)
    eta, ratio = rng.uniform(-0.3, 1.2) + size * noise[0], rng.uniform(-0.5, 1.0) + size * noise[1]
    if kind == "short":
        eta += size * autoregressive(n, 0.4, rng)
    elif kind == "long":
        ratio += 2.0 * size * autoregressive(n, 0.95, rng)
    elif kind == "alternating":
        eta += 0.2 * (-1.0) ** k
    elif kind == "drift":
        eta += rng.uniform(0.0, 0.4) * k / n
    elif kind == "transient":
        ratio += np.exp(-k / rng.uniform(1.0, 20.0))
    elif kind == "locked":
        eta[k > n // 3] += 0.8
    elif kind == "repeating":
        eta, ratio = np.full(n, 0.5), np.full(n, -0.25)  # whose sums are exact
    return eta, ratio


KINDS = ["white", "short", "long", "alternating", "drift", "transient", "locked", "repeating"]


def slot_of(eta, ratio, tolerance, floor, first):
    """What a slot holds of a world before its first cycle, and the rows that it will have."""
    n = len(eta)
    counts, codes, numbers = np.zeros(N_COUNT, np.int64), np.zeros(N_CODE, np.int64), np.zeros(N_NUMBER)
    codes[PER_ROW], codes[UNTIL] = STEPS, UNTIL_KNOWN
    numbers[TOLERANCE], numbers[FLOOR], numbers[WHOLE_MASS], counts[NEXT_LOOK] = tolerance, floor, MASS, first
    rows, series = np.zeros((n + 1, N_ROW)), np.full((N_SERIES, n + 1), np.nan)
    rows[:, ROW_STEPS], rows[1:, 2:4] = STEPS, [3.0, -2.0]
    force = -(ratio - 1j * eta) * 1j * OMEGA * MASS * (3.0 + 2.0j)
    rows[1:, 0], rows[1:, 1] = force.real, -force.imag
    return counts, codes, numbers, rows, series


def ended(slot):
    """Whole cycles after which the device ends a world; None: it does not."""
    counts, _, _, rows, _ = slot
    for n in range(len(rows)):
        counts[ROW] = n + 1
        verdict.judge(*slot, OMEGA)
        if counts[ENOUGH]:
            return n
    return None


@pytest.mark.parametrize("kind", KINDS)
def test_estimates_are_those_of_the_processor(kind):
    """Transient, correlation time, errors and drift of series of 2 to 120 cycles, even and odd."""
    rng = np.random.default_rng(7)
    drifting = skipping = 0
    for n in [*range(2, 40), *rng.integers(40, 121, 25)]:
        eta, ratio = series_of(kind, int(n), rng)
        series = np.full((N_SERIES, n + 1), np.nan)
        series[ETA, :n], series[RATIO, :n] = eta, ratio
        found = estimate(eta, ratio)
        skipped = verdict.transient_length(series, n)
        # Of cycles that repeat exactly numpy drops some to get rid of rounding in the mean of complex numbers.
        assert skipped == (0 if kind == "repeating" else found.n_skipped)
        for value in (eta[skipped:], ratio[skipped:]):
            assert verdict.correlation_time(value) == pytest.approx(correlation_time(value), rel=ROUNDING)
            assert verdict.standard_error(value, series[PAIRS]) == pytest.approx(standard_error(value), rel=ROUNDING)
            for scale in (0.0, 0.02):
                assert verdict.drifts(value, scale, series) == _drifts(value, scale)
                drifting += _drifts(value, scale)
        skipping += skipped > 0
    assert skipping > 0 or kind == "repeating"
    assert drifting > 0 or kind != "drift"


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("tolerance", [0.003, 0.02, 0.1])
def test_a_world_ends_with_the_cycle_with_which_the_processor_ends_it(kind, tolerance):
    rng = np.random.default_rng(int(1000 * tolerance))
    for _ in range(6):
        n, least = int(rng.integers(60, 121)), int(rng.integers(8, 20))
        eta, ratio = series_of(kind, n, rng)
        rule = Stopping(tolerance, 0.05, least)
        slot = slot_of(eta, ratio, tolerance, 0.05, rule.next_look)
        last = next((k for k in range(1, n + 1) if rule.enough(eta[:k], ratio[:k])), None)
        assert ended(slot) == last
        assert slot[0][NEXT_LOOK] == rule.next_look


def test_some_worlds_end_early_and_some_do_not():
    """So that the test above says something."""
    rng = np.random.default_rng(3)
    found = [ended(slot_of(*series_of("white", 80, rng), 0.02, 0.05, 12)) for _ in range(30)]
    assert {None, 12} < set(found)


def test_loss_factor_and_mass_are_those_of_the_signals():
    rng = np.random.default_rng(2)
    rows = rng.normal(size=(20, N_ROW))
    force, speed = rows[:, 0] - 1j * rows[:, 1], rows[:, 2] - 1j * rows[:, 3]
    wanted = ratios_of(force, speed, OMEGA, MASS)
    found = np.array([verdict.ratios(row, OMEGA * MASS) for row in rows])
    np.testing.assert_allclose(found, np.column_stack(wanted), rtol=1e-12)
    assert all(map(math.isnan, verdict.ratios(np.zeros(N_ROW), OMEGA * MASS)))


def test_what_is_no_number_is_never_enough():
    eta, ratio = np.full(40, 0.5), np.full(40, 0.25)
    eta[3] = ratio[3] = math.nan
    assert ended(slot_of(eta, ratio, 0.5, 0.05, 8)) is None


def test_a_world_in_a_hurry_ends_with_the_fewest_cycles_of_a_mean():
    noise = np.random.default_rng(1).normal(size=(2, 30))
    slot = slot_of(*noise, 0.01, 0.05, 12)
    slot[1][UNTIL] = UNTIL_CYCLE
    assert ended(slot) == LEAST_CYCLES


def test_a_part_of_a_cycle_is_none():
    slot = slot_of(np.full(9, 0.5), np.full(9, 0.25), 0.1, 0.05, 9)
    slot[3][9, ROW_STEPS] = STEPS - 1
    assert ended(slot) is None
