"""Which operating points to compute next, so that a field becomes accurate at little cost. Plans only, runs nothing.

    coarse_start        what to compute first; then, with Surrogate(points, clearance):
    is_accurate         stop?
    next_points         what to compute now, while other points are still running; and again

Accuracy is asked relative to max(eta, floor), for eta and for m'. Everything is deterministic.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graindamp.errors import InputError
from graindamp.field.surrogate import Surrogate
from graindamp.units import STANDARD_GRAVITY

Real = NDArray[np.float64]
Cost = Callable[[Real, Real], Real]
"""Cost of points at f [Hz] and Gamma, in any unit; same shape as both."""

ACCURACY, FLOOR = 0.05, 0.05
"""Asked standard error over max(eta, floor), and the eta below which accuracy becomes absolute."""
GRID_SHAPE = 28, 15
"""Frequencies and intensities of the full grid to which an adaptive field is compared."""
LEAST_DISTANCE = 0.05
"""Distance in ln f, ln Gamma below which two points are one."""
EDGE_STROKE = 0.6
"""X / X_opt at which collect and collide is expected to begin, between the 0.5 and 0.7 of shaken beds."""


class Choice(NamedTuple):
    """A point to compute."""

    frequency: float
    """[Hz]."""
    intensity: float
    """Gamma [-]."""
    ratio: float
    """Predicted standard error over the asked one when the point was chosen, the larger of eta and m' [-]."""


class Verdict(NamedTuple):
    """Whether a surrogate is accurate over a range."""

    is_accurate: bool
    """True if the predicted standard error is within the asked one everywhere."""
    worst_ratio: float
    """Largest predicted standard error over the asked one [-]."""
    frequency: float
    """Where that is [Hz]."""
    intensity: float
    """Where that is, Gamma [-]."""
    share: float
    """Share of the range, in ln f and ln Gamma, that is accurate [-]."""
    median_ratio: float
    """Median over the range [-]."""


def candidates(
    frequency_range: tuple[float, float],
    intensity_range: tuple[float, float],
    shape: tuple[int, int] = GRID_SHAPE,
) -> tuple[Real, Real]:
    """Frequencies [Hz] and intensities [-] of a grid equally spaced in their logarithms, ends included; (point,) each.

    Raises:
        InputError: a range that is not ascending and above 0, or fewer than two values along an axis.
    """
    _check_range("frequency_range", frequency_range)
    _check_range("intensity_range", intensity_range)
    if min(shape) < 2:
        raise InputError(f"shape is {shape}; at least two frequencies and two intensities are needed")
    axes = np.geomspace(*frequency_range, shape[0]), np.geomspace(*intensity_range, shape[1])
    f, gamma = np.meshgrid(*axes, indexing="ij")
    return f.ravel(), gamma.ravel()


def coarse_start(
    frequency_range: tuple[float, float],
    intensity_range: tuple[float, float],
    n_frequency: int = 4,
    n_intensity: int = 4,
    clearance: float | None = None,
    edge_stroke: float = EDGE_STROKE,
) -> list[tuple[float, float]]:
    """First points of an adaptive field: frequency [Hz] and intensity [-] of each.

    A grid, ends included. With a clearance, also one point at half and one at twice the stroke of the expected edge of
    collect and collide, at the same intensity, a quarter of the range below its top: they show whether there is an
    edge. Points outside the range or too near to others are left out.

    Args:
        frequency_range: lowest and highest frequency [Hz].
        intensity_range: lowest and highest Gamma [-].
        n_frequency: frequencies of the grid.
        n_intensity: intensities of the grid.
        clearance: free travel h of the bed [m].
        edge_stroke: X / X_opt of the expected edge [-], X_opt = h / pi.

    Raises:
        InputError: a range or number outside its limits.
    """
    f, gamma = candidates(frequency_range, intensity_range, (n_frequency, n_intensity))
    if clearance is not None:
        if not (clearance > 0 and edge_stroke > 0):
            raise InputError(f"clearance is {clearance} m, edge_stroke is {edge_stroke}, but both must be above 0")
        low, high = np.log(intensity_range)
        extra_gamma = np.full(2, np.exp(high - (high - low) / 4.0))
        amplitude = np.array([0.5, 2.0]) * edge_stroke * clearance / np.pi
        extra_f = np.sqrt(extra_gamma * STANDARD_GRAVITY / amplitude) / (2 * np.pi)
        keep = (extra_f >= frequency_range[0]) & (extra_f <= frequency_range[1])
        keep &= _far_from(extra_f, extra_gamma, f, gamma, LEAST_DISTANCE)
        f, gamma = np.append(f, extra_f[keep]), np.append(gamma, extra_gamma[keep])
    return list(zip(f.tolist(), gamma.tolist(), strict=True))


def error_ratio(
    surrogate: Surrogate, frequency: ArrayLike, intensity: ArrayLike, accuracy: float = ACCURACY, floor: float = FLOOR
) -> Real:
    """Predicted standard error over the asked one, accuracy times max(eta, floor): the larger of eta and m' [-]."""
    values = surrogate.predict(frequency, intensity)
    asked = accuracy * np.maximum(values.loss_factor, floor)
    return np.asarray(np.maximum(values.loss_factor_se, values.effective_mass_ratio_se) / asked)


def cycles_cost(frequency: Real, intensity: Real) -> Real:
    """Cost of a fixed number of cycles at an equal time step, proportional to 1 / f [s]."""
    return np.asarray(1.0 / frequency + 0.0 * intensity)


def next_points(
    surrogate: Surrogate,
    candidate: tuple[ArrayLike, ArrayLike],
    n_batch: int,
    accuracy: float = ACCURACY,
    floor: float = FLOOR,
    *,
    busy: Sequence[tuple[float, float]] = (),
    cost: Cost | None = None,
    budget: float = np.inf,
    least_distance: float = LEAST_DISTANCE,
) -> list[Choice]:
    """Points to compute next, the most wanted first: those of the largest predicted error over the asked one.

    After each choice the surrogate believes to have found what it expects there, so that a batch spreads out; so it
    does for the points that are still running. With a cost, the point of the largest squared error ratio per cost is
    taken: what a run takes away is variance. Points already within the accuracy are never chosen, and the list ends
    early, or is empty, when there is no other.

    Args:
        surrogate: of all points computed so far.
        candidate: frequencies [Hz] and intensities [-] to choose from, of one shape or broadcast to one.
        n_batch: most points to choose.
        accuracy: asked relative standard error [-].
        floor: eta below which the asked error is accuracy times floor [-].
        busy: frequency [Hz] and intensity [-] of each point still running.
        cost: cost of points, such as particle-steps; None for equal costs.
        budget: what all chosen points may cost together, in the unit of `cost`, or in points without.
        least_distance: from other points, in ln f, ln Gamma [-].

    Raises:
        InputError: an argument outside its range, or a cost that is not above 0.
    """
    _check_asked(accuracy, floor)
    f, gamma = (axis.ravel() for axis in np.broadcast_arrays(*(np.asarray(axis, float) for axis in candidate)))
    price = np.ones_like(f) if cost is None else np.broadcast_to(np.asarray(cost(f, gamma), float), f.shape)
    if not np.all(np.isfinite(price) & (price > 0)):
        raise InputError("cost gives a value that is not finite or not above 0 at some candidate")
    believed = surrogate.believing(*np.array(busy, float).reshape(-1, 2).T)
    is_free = _far_from(f, gamma, believed.frequency, believed.intensity, least_distance)
    chosen: list[Choice] = []
    left = budget
    while len(chosen) < n_batch:
        is_free &= price <= left
        f, gamma, price = f[is_free], gamma[is_free], price[is_free]
        if not f.size:
            break
        ratio = error_ratio(believed, f, gamma, accuracy, floor)
        best = int(np.argmax(np.where(ratio > 1.0, ratio**2 / price, 0.0)))
        if ratio[best] <= 1.0:
            break
        chosen.append(Choice(float(f[best]), float(gamma[best]), float(ratio[best])))
        left -= price[best]
        is_free = _far_from(f, gamma, f[best : best + 1], gamma[best : best + 1], least_distance)
        believed = believed.believing(f[best], gamma[best])
    return chosen


def is_accurate(
    surrogate: Surrogate,
    frequency_range: tuple[float, float],
    intensity_range: tuple[float, float],
    accuracy: float = ACCURACY,
    floor: float = FLOOR,
    shape: tuple[int, int] = GRID_SHAPE,
) -> Verdict:
    """Whether the predicted standard errors of eta and m' are within accuracy times max(eta, floor) on a grid.

    Args:
        surrogate: of all points computed so far.
        frequency_range: lowest and highest frequency [Hz].
        intensity_range: lowest and highest Gamma [-].
        accuracy: asked relative standard error [-].
        floor: eta below which the asked error is accuracy times floor [-].
        shape: frequencies and intensities of the grid on which to look.

    Raises:
        InputError: an argument outside its range.
    """
    _check_asked(accuracy, floor)
    f, gamma = candidates(frequency_range, intensity_range, shape)
    ratio = error_ratio(surrogate, f, gamma, accuracy, floor)
    worst = int(np.argmax(ratio))
    return Verdict(
        bool(ratio[worst] <= 1.0),
        float(ratio[worst]),
        float(f[worst]),
        float(gamma[worst]),
        float(np.mean(ratio <= 1.0)),
        float(np.median(ratio)),
    )


def _far_from(f: Real, gamma: Real, other_f: Real, other_gamma: Real, distance: float) -> NDArray[np.bool_]:
    """True for each point at least this far, in ln f, ln Gamma, from all others."""
    gaps = np.hypot(np.log(f[:, None] / other_f), np.log(gamma[:, None] / other_gamma))
    return np.asarray(np.all(gaps >= distance, axis=1))


def _check_range(name: str, limits: tuple[float, float]) -> None:
    if not 0 < limits[0] < limits[1] < np.inf:
        raise InputError(f"{name} is {limits}, but must ascend from a value above 0")


def _check_asked(accuracy: float, floor: float) -> None:
    if not (accuracy > 0 and floor > 0):
        raise InputError(f"accuracy is {accuracy} and floor is {floor}, but both must be above 0")
