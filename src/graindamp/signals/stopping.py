"""When an operating point has been simulated long enough: transient, drift and standard error of its cycles so far.

The rule looks at nothing but loss factor and effective mass ratio of every whole cycle. It drops a transient of up to
half of them, asks whether the rest still drifts, and compares its standard error with the tolerance. It looks only
when the number of cycles has grown by a fifth since it last did: a rule that looks after every cycle stops where an
error happens to look small.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from graindamp.signals.steady import correlation_time, transient_length

Real = NDArray[np.float64]

GROWTH = 1.2
"""Factor between the numbers of cycles at which the rule looks [-]."""

LEAST_CYCLES = 8
"""Fewest cycles, transient excluded, that a mean is taken over [-]."""

LONGEST_TRANSIENT = 0.5
"""Share of the cycles that is dropped at most [-]."""

BATCHES = 8
"""Batches whose means show correlation over many cycles [-]."""

DRIFT_ERRORS = 3.0
"""Standard errors by which the two halves must differ to be called drifting [-]."""

DRIFT_SHARE = 0.05
"""Difference of the halves over the larger of |eta| and the floor below which it does not matter [-]."""


class Estimate(NamedTuple):
    """Loss factor and effective mass ratio of an operating point from the cycles so far."""

    loss_factor: float
    """eta [-]."""
    loss_factor_se: float
    """Its standard error [-]."""
    effective_mass_ratio: float
    """m' [-]."""
    effective_mass_ratio_se: float
    """Its standard error [-]."""
    n_cycle: int
    """Cycles averaged over [-]."""
    n_skipped: int
    """Cycles dropped before them [-]."""
    is_steady: bool
    """False where the two halves of the cycles averaged over differ by more than chance."""


def estimate(loss_factor: Real, effective_mass_ratio: Real, floor: float = 0.05) -> Estimate:
    """Means over the steady part of a run, with errors that allow for correlation over few and over many cycles.

    Args:
        loss_factor: eta of every cycle from the first on [-]; (cycle,).
        effective_mass_ratio: m' of every cycle [-]; (cycle,).
        floor: size of eta below which drift does not matter [-].

    Raises:
        ValueError: fewer than two cycles.
    """
    if len(loss_factor) < 2:
        raise ValueError(f"a mean needs two cycles, given {len(loss_factor)}")
    skipped = transient_length(effective_mass_ratio + 1j * loss_factor, LONGEST_TRANSIENT, LEAST_CYCLES)
    eta, ratio = loss_factor[skipped:], effective_mass_ratio[skipped:]
    scale = DRIFT_SHARE * max(abs(float(eta.mean())), floor)
    return Estimate(
        loss_factor=float(eta.mean()),
        loss_factor_se=standard_error(eta),
        effective_mass_ratio=float(ratio.mean()),
        effective_mass_ratio_se=standard_error(ratio),
        n_cycle=len(eta),
        n_skipped=skipped,
        is_steady=not (_drifts(eta, scale) or _drifts(ratio, scale)),
    )


def standard_error(value: Real) -> float:
    """Standard error of the mean of a value per cycle, the larger of two estimates.

    Pairs of cycles with their integrated autocorrelation time see correlation over a few cycles; the scatter of eight
    batch means sees correlation over a good part of the record, which the first misses. Where values repeat to rounding
    both are 0.

    Args:
        value: steady apart from noise; (cycle,).

    Source: Flyvbjerg & Petersen (1989), J. Chem. Phys. 91, 461-466, on batches; see
    :func:`graindamp.signals.steady.correlation_time` for the other.
    """
    n = len(value)
    pairs = value[n % 2 :].reshape(-1, 2).mean(axis=1) if n >= LEAST_CYCLES else value
    m = len(pairs)
    time = correlation_time(pairs)
    variance = float(np.var(pairs, ddof=1)) / m * time / max(1.0 - time / m, 0.25)
    if n >= 2 * BATCHES:
        length = n // BATCHES
        batches = value[n - BATCHES * length :].reshape(BATCHES, length).mean(axis=1)
        variance = max(variance, float(np.var(batches, ddof=1)) / BATCHES)
    return math.sqrt(variance)


def _drifts(value: Real, scale: float) -> bool:
    """Whether the halves of a series differ by more than `scale` and by more than chance.

    Chance is judged on what a straight line leaves over, since a drift would count as scatter otherwise.
    """
    half = len(value) // 2
    if half < 2:
        return False  # no scatter to judge by
    first, second = slice(0, half), slice(len(value) - half, None)
    change = abs(float(value[second].mean() - value[first].mean()))
    place = np.arange(len(value)) - 0.5 * (len(value) - 1)
    rest = value - place * (np.dot(place, value) / np.dot(place, place))
    return change > scale and change > DRIFT_ERRORS * math.hypot(
        standard_error(rest[first]), standard_error(rest[second])
    )


class Stopping:
    """The rule of one run, asked after every cycle."""

    def __init__(self, tolerance: float, floor: float, min_cycles: int) -> None:
        """A rule that has not looked yet.

        Args:
            tolerance: standard error of eta and m' that is asked for, over the larger of |eta| and `floor` [-].
            floor: size of eta below which the error is held to that of `floor` [-].
            min_cycles: cycles before it first looks [-].
        """
        self.tolerance, self.floor, self.next_look = tolerance, floor, max(min_cycles, LEAST_CYCLES)

    def met(self, found: Estimate) -> bool:
        """Whether an estimate is steady and as good as asked."""
        allowed = self.tolerance * max(abs(found.loss_factor), self.floor)
        return found.is_steady and max(found.loss_factor_se, found.effective_mass_ratio_se) <= allowed

    def enough(self, loss_factor: Real, effective_mass_ratio: Real) -> bool:
        """Whether the run may end, from eta and m' of all cycles so far; each (cycle,)."""
        n = len(loss_factor)
        if n < self.next_look:
            return False
        self.next_look = math.ceil(GROWTH * n)
        return self.met(estimate(loss_factor, effective_mass_ratio, self.floor))
