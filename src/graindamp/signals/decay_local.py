"""Peaks and zeros of a sampled oscillation between its samples, by polynomials over a part of a cycle.

With 7 samples or more the window of the default, a third of a cycle (2 rad) and degree 6, leaves 2e-7 of the
amplitude for a sine, the same at every peak, so that it drops out of ratios. Below 20 samples per cycle the window
holds 7 samples and grows beyond a third of a cycle: errors are then 7e-7 (20 per cycle), 3e-5 (12), 5e-4 (8).
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from graindamp.spec.decay import PeakMethod

Real = NDArray[np.float64]

WINDOW = 1.0
"""Half of the window of the polynomial, as angle of the oscillation [rad]."""
DEGREE, LEAST_HALF = 6, 3
"""Degree of the polynomial, and samples on either side that determine it."""


class Window(NamedTuple):
    """Samples on either side of a middle one, and the degree of the polynomial fitted to all of them."""

    half: int
    degree: int


class Found(NamedTuple):
    """Peaks or zeros. NaN where the window reaches beyond the record."""

    position: Real
    """Place in samples from the first, between samples; shape (point,)."""
    value: Real
    """Value there, in the signal's unit."""
    gain: Real
    """Standard error over that of a single sample, for white noise [-]: of the value of a peak [-], of the position of
    a zero [samples per unit of the signal]."""


def window_of(method: PeakMethod, samples_per_cycle: float) -> Window:
    """Window of a method of interpolation."""
    if method == "polynomial":
        return Window(max(round(WINDOW * samples_per_cycle / (2 * np.pi)), LEAST_HALF), DEGREE)
    return Window(1, 2) if method == "parabola" else Window(0, 0)


def peaks(samples: Real, guess: NDArray[np.int64], window: Window) -> Found:
    """Extreme values near given samples.

    Args:
        samples: shape (sample,).
        guess: index of a sample near each extreme; shape (point,).
        window: what is fitted.
    """
    centre = np.asarray(guess, np.int64)
    shift = np.zeros(len(centre))
    for _ in range(3 if window.half > 1 else 1):  # three samples are those about the highest, a window is centred
        centre = centre + np.round(shift * max(window.half, 1)).astype(np.int64)
        coefficients, inside = _fit(samples, centre, window)
        shift = np.where(inside, _newton(coefficients, 1), 0.0)
    return _found(coefficients, centre, shift, inside, window)


def zeros(samples: Real, guess: NDArray[np.int64], window: Window) -> Found:
    """Zeros near given samples; arguments as of :func:`peaks`."""
    centre = np.asarray(guess, np.int64)
    coefficients, inside = _fit(samples, centre, window)
    shift = _newton(coefficients, 0)
    found = _found(coefficients, centre, shift, inside, window)
    slope = _derivative(coefficients, 1, shift) / window.half
    with np.errstate(divide="ignore"):
        return found._replace(gain=found.gain / np.abs(slope))


def middle_weights(window: Window) -> Real:
    """Weights of the samples in the value at the middle of a window; shape (2 half + 1,)."""
    return np.asarray(_inverse(window)[0], float)


def _inverse(window: Window) -> Real:
    """Coefficients of the polynomial from the samples; shape (degree + 1, 2 half + 1)."""
    offset = np.arange(-window.half, window.half + 1) / max(window.half, 1)
    return np.asarray(np.linalg.pinv(np.vander(offset, window.degree + 1, increasing=True)), float)


def _fit(samples: Real, centre: NDArray[np.int64], window: Window) -> tuple[Real, NDArray[np.bool_]]:
    inside = (centre >= window.half) & (centre < len(samples) - window.half)
    at = np.where(inside, centre, window.half)[:, None] + np.arange(-window.half, window.half + 1)
    return samples[at] @ _inverse(window).T, inside


def _derivative(coefficients: Real, order: int, at: Real) -> Real:
    if coefficients.shape[1] <= order:
        return np.zeros(len(at))
    terms = np.polynomial.polynomial.polyder(coefficients.T, order)
    return np.asarray(np.polynomial.polynomial.polyval(at, terms, tensor=False), float)


def _newton(coefficients: Real, order: int) -> Real:
    """Where the derivative of this order vanishes, within the window; in half windows from the middle."""
    at = np.zeros(len(coefficients))
    for _ in range(12):
        slope = _derivative(coefficients, order + 1, at)
        step = np.divide(_derivative(coefficients, order, at), slope, out=np.zeros_like(at), where=slope != 0.0)
        at = np.clip(at - np.clip(step, -0.5, 0.5), -1.0, 1.0)
    return at


def _found(
    coefficients: Real, centre: NDArray[np.int64], shift: Real, inside: NDArray[np.bool_], window: Window
) -> Found:
    powers = np.vander(shift, window.degree + 1, increasing=True)
    value = np.sum(powers * coefficients, axis=1)
    gain = np.linalg.norm(powers @ _inverse(window), axis=1)
    position = centre + shift * max(window.half, 1)
    nan = np.where(inside, 0.0, np.nan)
    return Found(position + nan, value + nan, gain + nan)
