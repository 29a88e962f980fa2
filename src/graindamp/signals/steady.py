"""Is it steady yet, and how well is its mean known: transient, drift and standard error of a value per cycle."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Real = NDArray[np.float64]

MIN_CYCLES = 4
"""Fewest cycles from which a mean and its error are given."""


def transient_length(value: NDArray[np.complex128] | Real, share: float = 1.0 / 3.0, least: int = MIN_CYCLES) -> int:
    """Number of cycles to drop at the start: those whose removal most lowers the standard error of the mean.

    Marginal standard error rule on means of two cycles, because beds often answer with half the driving frequency and
    the alternation would drown the transient. Of a record at most a third is dropped, so that a slow drift is
    reported, not cut away; a run that goes on until it is steady may drop more.

    Args:
        value: one value per cycle; (cycle,).
        share: part of the cycles that is dropped at most [-].
        least: cycles that stay at least [-].

    Source: White (1997), Simulation 69, 323-334.
    """
    n = len(value)
    pairs = value[n % 2 :].reshape(-1, 2).mean(axis=1)
    longest = min(int(n * share + 1e-9), n - least) // 2
    statistic = [np.var(pairs[drop:]) / (len(pairs) - drop) for drop in range(max(longest, 0) + 1)]
    best = int(np.argmin(statistic))
    return 2 * best + (n % 2 if best else 0)


def correlation_time(value: Real) -> float:
    """Integrated autocorrelation time of a series, in its own steps, at least 1.

    Sums the autocorrelation until it is first not positive (initial positive sequence).

    Source: Geyer (1992), Statistical Science 7, 473-483; Sokal (1997) on bias for short series.
    """
    n = len(value)
    centred = value - value.mean()
    variance = np.dot(centred, centred)
    if n < 4 or variance == 0.0:
        return 1.0
    total = 1.0
    for lag in range(1, n // 2):
        correlation = np.dot(centred[:-lag], centred[lag:]) / variance + 1.0 / n  # the estimator is low by about 1/n
        if correlation <= 0.0:
            break
        total += 2.0 * (1.0 - lag / n) * correlation
    return float(total)


class Mean(NamedTuple):
    """Mean of a value per cycle."""

    mean: float
    standard_error: float
    """With the correlation between cycles, and with the drift where there is one; same unit as the mean."""
    is_steady: bool
    """False where a trend over the record is significant and matters."""


def steady_mean(value: Real, floor: float = 0.05) -> Mean:
    """Mean of a series of values per cycle, its standard error, and whether it still drifts.

    Neighbouring cycles are paired first, because beds often answer with half the driving frequency; the pairs are far
    less correlated. A trend counts as drift when it exceeds three standard errors and its change over the record 5 %
    of the larger of the mean and `floor`; its root mean square about the mean is then added to the error.

    Args:
        value: one value per cycle, steady apart from noise; shape (cycle,).
        floor: size below which changes do not matter, same unit as `value`.
    """
    n = len(value)
    pairs = value[n % 2 :].reshape(-1, 2).mean(axis=1) if n >= 2 * MIN_CYCLES else value
    m = len(pairs)
    index = np.arange(m) - (m - 1) / 2
    slope = float(np.dot(index, pairs) / np.dot(index, index))
    residual = pairs - pairs.mean() - slope * index
    time = correlation_time(residual)
    spread = np.dot(residual, residual) / max(m - 2, 1)
    change = abs(slope) * m
    slope_error = float(np.sqrt(spread * time / np.dot(index, index)))
    drifts = abs(slope) > 3 * slope_error and change > 0.05 * max(abs(float(value.mean())), floor)
    if drifts:
        variance = spread * time / m + change**2 / 12
    else:
        time = correlation_time(pairs)
        variance = float(np.var(pairs, ddof=1)) / m * time / max(1 - time / m, 0.25)
    return Mean(float(value.mean()), float(np.sqrt(variance)), not drifts)
