"""Do curves fall onto one when they are plotted over another variable? The answer as a number."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graindamp.errors import InputError

Real = NDArray[np.float64]


class Collapse(NamedTuple):
    """How far curves lie from what the other curves say at the same place."""

    scatter: float
    """Root mean square of the difference between a point and the mean of the other curves there, in the unit of y."""
    spread: float
    """Standard deviation of the same points, in the unit of y: the scatter if the variable told nothing."""
    n_point: int
    """Points compared: those near which another curve has points too."""
    n_left: int
    """Points not compared, where only their own curve reaches."""

    @property
    def unexplained(self) -> float:
        """Share of the variance that the variable does not explain, (scatter / spread)^2 [-]: 0 one line, about 1 no
        relation; above 1 the curves contradict each other."""
        return (self.scatter / self.spread) ** 2


def collapse(x: Sequence[ArrayLike], y: Sequence[ArrayLike], width: float = 0.05) -> Collapse:
    """Scatter of several curves about a common one, each judged by the others alone.

    A point is compared with the mean over the other curves of their local means, weighted by a Gaussian of ln x. A
    curve counts at a place where it has a point within two widths; points that no other curve reaches are left out. So
    no curve explains itself, and the scale of x does not matter.

    Args:
        x: the variable along each curve, > 0; curves of any lengths, at least two.
        y: the value along each curve, in any one unit.
        width: standard deviation of the Gaussian in powers of ten of x [-], > 0.

    Raises:
        InputError: fewer than two curves, shapes that do not fit, values out of range, or curves that never meet.
    """
    places, values = _checked(x, y, width)
    differences, compared = [], []
    for number, (place, value) in enumerate(zip(places, values, strict=True)):
        others = [
            _local_mean(place, other, values[k], width) for k, other in enumerate(places) if k != number and len(other)
        ]
        here = np.isfinite(others)
        count = here.sum(axis=0)
        met = count > 0
        common = np.where(here, others, 0.0).sum(axis=0)[met] / count[met]
        differences.append(value[met] - common)
        compared.append(value[met])
    residual, points = np.concatenate(differences), np.concatenate(compared)
    if len(points) < 2:
        raise InputError("no two curves have points at the same x; there is nothing to compare")
    total = sum(len(value) for value in values)
    return Collapse(float(np.sqrt(np.mean(residual**2))), float(points.std()), len(points), total - len(points))


def _checked(x: Sequence[ArrayLike], y: Sequence[ArrayLike], width: float) -> tuple[list[Real], list[Real]]:
    if len(x) != len(y) or len(x) < 2:
        raise InputError(f"x holds {len(x)} and y {len(y)} curves; give as many, two at least")
    if not (np.isfinite(width) and width > 0.0):
        raise InputError(f"width is {width}, but must be a finite number > 0")
    places, values = [], []
    for number, (one, other) in enumerate(zip(x, y, strict=True), 1):
        place, value = np.asarray(one, float), np.asarray(other, float)
        if place.ndim != 1 or place.shape != value.shape:
            raise InputError(f"curve {number} has shapes {place.shape} and {value.shape}; give two equal lengths")
        if not (np.isfinite(place).all() and np.isfinite(value).all() and (place > 0.0).all()):
            raise InputError(f"curve {number} holds values that are not finite, or x that is not above 0")
        places.append(np.log10(place))
        values.append(value)
    return places, values


def _local_mean(place: Real, other: Real, value: Real, width: float) -> Real:
    """Of another curve's values at places, NaN where it has no point within two widths."""
    distance = np.abs(place[:, None] - other[None, :]) / width
    weight = np.exp(-0.5 * distance**2)
    reached = distance.min(axis=1) <= 2.0
    with np.errstate(invalid="ignore"):
        return np.where(reached, weight @ value / weight.sum(axis=1), np.nan)
