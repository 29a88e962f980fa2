"""Which operating points to compute next, so that a field becomes accurate at little cost. Plans only, runs nothing.

    coarse_start        what to compute first; then, with Surrogate(points, clearance):
    is_accurate         stop?
    next_points         what to compute now, while other points are still running; and again

Accuracy is asked relative to max(eta, floor), for eta and for m'. Everything is deterministic.

Source of the choice, linear regression on a run not yet made: Cohn (1996), Neural Networks 9, 1071-1083.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graindamp.errors import InputError
from graindamp.field.surrogate import Surrogate
from graindamp.spec.field import logarithmic
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

COST_LENGTH = 0.5
"""Distance in ln f, ln Gamma over which costs of points are averaged."""
_TINY = 1e-12


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

    They are those of a grid plan, to the last bit: results of one plan serve the other.

    Raises:
        InputError: a range that is not ascending and above 0, or fewer than two values along an axis.
    """
    _check_range("frequency_range", frequency_range)
    _check_range("intensity_range", intensity_range)
    if min(shape) < 2:
        raise InputError(f"shape is {shape}; at least two frequencies and two intensities are needed")
    axes = logarithmic(*frequency_range, shape[0]), logarithmic(*intensity_range, shape[1])
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

    A staggered grid, ends included: every second frequency has its intensities halfway between those of the others,
    one fewer, so that both sets together tell how the field changes with Gamma. With a clearance, also one point at
    half and one at twice the stroke of the expected edge of collect and collide, at the same intensity, a quarter of
    the range below its top: they show whether there is an edge. Points outside the range or too near to others are
    left out.

    Args:
        frequency_range: lowest and highest frequency [Hz].
        intensity_range: lowest and highest Gamma [-].
        n_frequency: frequencies of the grid.
        n_intensity: intensities at the first frequency, and at every second; at the highest, too, its ends.
        clearance: free travel h of the bed [m].
        edge_stroke: X / X_opt of the expected edge [-], X_opt = h / pi.

    Raises:
        InputError: a range or number outside its limits.
    """
    f, gamma = candidates(frequency_range, intensity_range, (n_frequency, 2 * n_intensity - 1))
    column, row = np.divmod(np.arange(len(f)), 2 * n_intensity - 1)
    is_corner = (column == n_frequency - 1) & ((row == 0) | (row == 2 * n_intensity - 2))
    used = ((column + row) % 2 == 0) | is_corner
    f, gamma = f[used], gamma[used]
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


def nearest(points: Sequence[tuple[float, float]], candidate: tuple[Real, Real]) -> list[tuple[float, float]]:
    """The candidate nearest to each point in ln f, ln Gamma, none of them twice; frequency [Hz] and intensity [-]."""
    f, gamma = candidate
    found = [int(np.argmin(np.hypot(np.log(f / a), np.log(gamma / b)))) for a, b in points]
    return [(float(f[k]), float(gamma[k])) for k in dict.fromkeys(found)]


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


def learned_cost(frequency: ArrayLike, intensity: ArrayLike, paid: ArrayLike) -> Cost:
    """Cost as the points computed so far have it: beds near the edge take several times as many cycles as others.

    The cost of a second of simulated motion, cost times f, is the geometric mean of what the points had, with weights
    that fall as a Gaussian of their distance in ln f, ln Gamma.

    Args:
        frequency: of the points computed [Hz], shape (point,).
        intensity: their Gamma [-], shape (point,).
        paid: what they have cost, such as particle-steps, above 0, shape (point,).

    Raises:
        InputError: no points, or a cost that is not finite or not above 0.
    """
    f, gamma, cost = (np.asarray(values, float).ravel() for values in (frequency, intensity, paid))
    if not (cost.size and np.all(np.isfinite(cost) & (cost > 0))):
        raise InputError("costs of points must be finite and above 0, and of one point at least")
    known = np.log(cost * f)

    def expected(frequency: Real, intensity: Real) -> Real:
        squares = np.log(frequency[..., None] / f) ** 2 + np.log(intensity[..., None] / gamma) ** 2
        away = (squares - squares.min(axis=-1, keepdims=True)) / (2.0 * COST_LENGTH**2)
        weight = np.exp(-away)
        return np.asarray(np.exp((weight @ known) / weight.sum(axis=-1)) / frequency)

    return expected


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
    """Points to compute next, the most wanted first: those that lower the errors most, all over the range.

    The error ratio of a place is its predicted standard error over the asked one, the larger of eta and m'. A run
    lowers it there and wherever the field is correlated with it. Taken is the candidate after whose run the sum of
    the square roots of all ratios above 1 will have fallen most, with a cost: most per cost. So a doubtful region
    counts by its size more than by its worst place. Then the next is chosen as if that run had been made; points still
    running count likewise. Nothing is chosen if all places are within the accuracy.

    Args:
        surrogate: of all points computed so far.
        candidate: frequencies [Hz] and intensities [-] to choose from, and at which errors count, of one shape or
            broadcast to one.
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
    busy_f, busy_gamma = np.array(busy, float).reshape(-1, 2).T
    outlook = _outlook(surrogate, np.append(f, busy_f), np.append(gamma, busy_gamma), accuracy, floor)
    for k in range(len(f), len(f) + len(busy)):
        outlook = _after(outlook, k)
    is_free = _far_from(f, gamma, np.append(surrogate.frequency, busy_f), np.append(surrogate.intensity, busy_gamma),
                        least_distance)  # fmt: skip
    chosen: list[Choice] = []
    left = budget
    while len(chosen) < n_batch:
        is_free &= price <= left
        gain = np.where(is_free, _gains(outlook, len(f)) / price, 0.0)
        best = int(np.argmax(gain))
        if gain[best] <= 0.0:
            break
        ratio = np.sqrt(max(square[best] for square in outlook.squares))
        chosen.append(Choice(float(f[best]), float(gamma[best]), float(ratio)))
        left -= price[best]
        is_free &= _far_from(f, gamma, f[best : best + 1], gamma[best : best + 1], least_distance)
        outlook = _after(outlook, best)
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


class _Outlook(NamedTuple):
    """What is expected at some places once the runs chosen so far are made; pairs are of eta and m'."""

    squares: tuple[Real, Real]  # of the error ratio; (place,)
    covariance: tuple[Real, Real]  # (place, place)
    noise: tuple[Real, Real]  # variance of a run; (place,)


def _outlook(surrogate: Surrogate, f: Real, gamma: Real, accuracy: float, floor: float) -> _Outlook:
    values = surrogate.predict(f, gamma)
    asked = accuracy * np.maximum(values.loss_factor, floor)
    squares = (values.loss_factor_se / asked) ** 2, (values.effective_mass_ratio_se / asked) ** 2
    return _Outlook(squares, *surrogate.joint(f, gamma))


def _after(outlook: _Outlook, k: int) -> _Outlook:
    """The same after a run at place k, by linear regression on what it will give."""
    squares, covariances = [], []
    for square, covariance, noise in zip(*outlook, strict=True):
        rest = covariance - np.outer(covariance[:, k], covariance[k]) / (covariance[k, k] + noise[k])
        share = np.diagonal(rest) / np.maximum(np.diagonal(covariance), _TINY)
        squares.append(square * np.clip(share, 0.0, 1.0))
        covariances.append(rest)
    return _Outlook((squares[0], squares[1]), (covariances[0], covariances[1]), outlook.noise)


def _gains(outlook: _Outlook, n: int) -> Real:
    """By how much a run at each of the first n places lowers the sum of the square roots of error ratios above 1."""
    after = []
    for square, covariance, noise in zip(*outlook, strict=True):
        variance = np.maximum(np.diagonal(covariance), _TINY)
        taken = covariance[:n, :n] ** 2 / (variance[:n, None] * (variance + noise)[:n])
        after.append(square[:n, None] * np.clip(1.0 - taken, 0.0, 1.0))
    now = np.maximum(np.maximum(*outlook.squares)[:n], 1.0) ** 0.25
    return np.asarray((now[:, None] - np.maximum(np.maximum(*after), 1.0) ** 0.25).sum(axis=0))


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
