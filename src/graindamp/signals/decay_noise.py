"""How noisy a decaying oscillation is: from what it has at high frequency, and from what is left after it."""

from math import comb, sqrt

import numpy as np
from numpy.typing import NDArray

Real = NDArray[np.float64]

QUARTILE = 0.3186394
"""A quarter of normal deviates are smaller than this [-]. The median would count the jumps that impacts leave."""
TAIL_GAP, LEAST_TAIL = 5.0, 10.0
"""Cycles after the end of a decay before its tail begins, and the fewest cycles of a tail."""


def white_noise(motion: Real, per_cycle: float) -> float:
    """Standard deviation of white noise in a smooth signal, rounding of the recorder included.

    From differences of order 6 to 10, in which a sine of unit amplitude leaves (2 sin(pi / per_cycle))^order over the
    noise they keep: 1e-7 at 50 samples per cycle, 2e-8 at 20, 2e-4 at 8. Noise that the recorder has filtered is
    underestimated; see :func:`tail_error`.

    Args:
        motion: the part of the record that is used; shape (sample,).
        per_cycle: samples per cycle [-].
    """
    order = min(6 if per_cycle >= 40 else 10, len(motion) - 2)
    difference = np.abs(np.diff(motion, order))
    noise = float(np.quantile(difference, 0.25)) / QUARTILE / sqrt(comb(2 * order, order))
    return float(np.hypot(noise, _rounding(motion)))


def _rounding(motion: Real) -> float:
    """Standard deviation of the error of a recorder of few levels; 0 where nearly all values differ."""
    levels = np.unique(motion)
    if len(levels) < 3 or len(levels) > len(motion) / 2:
        return 0.0
    return float(np.quantile(np.diff(levels), 0.1)) / sqrt(12.0)


def tail_error(motion: Real, end: int, weights: Real, per_cycle: float) -> float:
    """Standard error of a peak from what is left after the decay, whatever its spectrum; 0 where the record is short.

    The second half of what follows :data:`TAIL_GAP` cycles after the end counts. What may be left of the oscillation
    there, a sine of slowly varying amplitude, is taken out, and so is a straight line.

    Args:
        motion: the record without its offset; shape (sample,).
        end: sample of the last peak.
        weights: of the samples in the value of a peak.
        per_cycle: samples per cycle [-].
    """
    begin = end + round(TAIL_GAP * per_cycle)
    begin += max(len(motion) - begin, 0) // 2
    tail = motion[begin:]
    if len(tail) < LEAST_TAIL * per_cycle:
        return 0.0
    place = np.linspace(-1.0, 1.0, len(tail))[:, None] ** np.arange(3)
    angle = 2 * np.pi * np.arange(len(tail))[:, None] / per_cycle
    design = np.hstack([place[:, :2], place * np.cos(angle), place * np.sin(angle)])
    rest = tail - design @ np.linalg.lstsq(design, tail, rcond=None)[0]
    return float(np.std(np.convolve(rest, weights, mode="valid")))
