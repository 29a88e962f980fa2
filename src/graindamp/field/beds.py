"""How much a field would differ with another bed of the same description, from a few points with several beds.

The standard error of a run tells how well the mean of that run is known. Another bed of the same description, poured
with another seed, comes to other arrangements, and one bed wanders between them more slowly than a run lasts; so its
answer differs by more than the error of a run says. A study runs a few points with several beds. What is left of their
scatter beyond the errors of the runs, over the larger of eta and a floor, is pooled over the points and added to the
errors of the whole field.
"""

import json
import math
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from graindamp.errors import InputError
from graindamp.field.schema import is_asked_for

Real = NDArray[np.float64]

NAMES = ("loss_factor", "effective_mass_ratio")

PARTED = 3.0
"""Ratio of the largest to the smallest loss factor of the beds at a point, or floor, from which they are said to move
in different ways: no scatter, but two answers."""


class BedPoint(NamedTuple):
    """What several beds answer at one operating point; NaN where a run has no value."""

    frequency: float
    """[Hz]"""
    intensity: float
    """Gamma [-]."""
    loss_factor: Real
    """eta [-]; (bed,)."""
    loss_factor_se: Real
    """Its standard error within each run [-]; (bed,)."""
    effective_mass_ratio: Real
    """m' [-]; (bed,)."""
    effective_mass_ratio_se: Real
    """Likewise."""


class Scatter(NamedTuple):
    """Standard deviation between beds over the larger of eta and the floor [-]."""

    value: float
    error: float
    """Standard error of the value, from the number of beds and points."""


class BedStudy(NamedTuple):
    """How beds of one description differ."""

    points: tuple[BedPoint, ...]
    """Each with two values at least."""
    floor: float
    """Size of eta below which differences are held to that of this value [-]."""

    @property
    def are_parted(self) -> tuple[bool, ...]:
        """Whether the beds move in different ways, at each point."""
        found = []
        for one in self.points:
            size = np.maximum(np.abs(one.loss_factor), self.floor)
            found.append(bool(np.nanmax(size) >= PARTED * np.nanmin(size)))
        return tuple(found)

    def scatters(self, k: int) -> tuple[float, float]:
        """Scatter of eta and of m' at point `k` beyond the errors of the runs, over the loss factor [-]."""
        whole, within = self._variances(k)
        eta, mass = np.sqrt(np.maximum(whole - within, 0.0)).tolist()
        return eta, mass

    def _variances(self, k: int) -> tuple[Real, Real]:
        """Variances at point `k` over the square of the loss factor, of the values and within the runs; (2,) each, of
        eta and of m'."""
        one = self.points[k]
        size = max(abs(float(np.nanmean(one.loss_factor))), self.floor)
        whole, within = [], []
        for name in NAMES:
            value, error = getattr(one, name), getattr(one, f"{name}_se")
            known = np.isfinite(value)
            whole.append(float(np.var(value[known], ddof=1)))
            within.append(float(np.mean(np.where(np.isfinite(error), error, 0.0)[known] ** 2)))
        return np.array(whole) / size**2, np.array(within) / size**2

    @property
    def pooled(self) -> tuple[Scatter, Scatter] | None:
        """Scatter of eta and m' over all points at which the beds move alike; None if there is no such point.

        From the mean of the variances less those within the runs. The variance of values that n - 1 degrees of freedom
        tell has the relative error sqrt(2 / (n - 1)); that of the difference is taken to the scatter.
        """
        alike = [k for k, parted in enumerate(self.are_parted) if not parted]
        if not alike:
            return None
        free = np.array([np.isfinite(self.points[k].loss_factor).sum() - 1 for k in alike], float)
        whole, within = (free @ np.array(part) / free.sum() for part in zip(*map(self._variances, alike), strict=True))
        value = np.sqrt(np.maximum(whole - within, 0.0))
        error = np.sqrt(2.0 / free.sum()) * whole
        least = np.sqrt(error)  # of a scatter near 0, whose square may be anything up to its error
        with np.errstate(divide="ignore", invalid="ignore"):
            error = np.where(value > 0.0, np.minimum(error / (2.0 * value), least), least)
        first, second = (Scatter(float(v), float(e)) for v, e in zip(value, error, strict=True))
        return first, second

    def dump(self) -> str:
        """The study as JSON, for the attributes of a field."""
        columns = [name for name in BedPoint._fields if name not in ("frequency", "intensity")]
        points = [
            {"frequency": one.frequency, "intensity": one.intensity}
            | {name: [v if math.isfinite(v) else None for v in getattr(one, name).tolist()] for name in columns}
            for one in self.points
        ]
        return json.dumps({"floor": self.floor, "points": points}, sort_keys=True)

    @classmethod
    def load(cls, text: str) -> "BedStudy":
        """The study that :meth:`dump` wrote.

        Raises:
            ValueError: the text is no such study.
        """
        try:
            told = json.loads(text)
            points = tuple(_point(one) for one in told["points"])
            study = cls(points, float(told["floor"]))
        except (AttributeError, KeyError, TypeError) as error:
            raise ValueError(f"not a study ({error})") from None
        if not points or not study.floor > 0.0:
            raise ValueError("a point at least and a floor above 0 are needed")
        return study


def _point(told: dict[str, Any]) -> BedPoint:
    values: dict[str, Any] = {name: np.array(told[name], float)[()] for name in BedPoint._fields}
    one = BedPoint(**values)
    shapes = {getattr(one, f"{name}{end}").shape for name in NAMES for end in ("", "_se")}
    if len(shapes) != 1 or np.isfinite(one.loss_factor).sum() < 2:
        raise ValueError("values of two beds at least are needed, with as many errors")
    return one._replace(frequency=float(one.frequency), intensity=float(one.intensity))


def bed_study_of(field: xr.Dataset, where: str = "field") -> BedStudy | None:
    """The study of beds that a field keeps, and whose scatter is in its errors, if there is one.

    Args:
        field: an effective field.
        where: opens the message.

    Raises:
        InputError: what it keeps under that name is no study.
    """
    text = field.attrs.get("bed_study")
    try:
        return None if text is None else BedStudy.load(text)
    except (TypeError, ValueError) as error:
        raise InputError(f"{where}: bed_study is not what a campaign wrote ({error}); take it out") from None


def widened(field: xr.Dataset, study: BedStudy, seeds: int) -> xr.Dataset:
    """The field with the study, and with errors that contain the scatter of beds.

    To the error of a value of one bed the scatter is added in squares. Errors of several beds have seen their scatter,
    but from few values: they become no smaller than the pooled scatter over the root of their number.

    Args:
        field: an effective field; left as it is.
        study: of its beds.
        seeds: number of beds that a value is the mean of, where the field does not say (n_beds, n_beds_other).
    """
    found = field.copy()
    found.attrs = field.attrs | {"bed_study": study.dump()}
    if (pooled := study.pooled) is None:
        return found
    for name, scatter in zip(NAMES, pooled, strict=True):
        for end in ("", "_other"):
            if f"{name}{end}_se" not in field:
                continue
            told = field[f"{name}{end}_se"]
            error, eta = told.to_numpy(), field[f"loss_factor{end}"].to_numpy()
            beds = np.asarray(field.get(f"n_beds{end}", seeds))
            of_mean = scatter.value * np.maximum(np.abs(eta), study.floor) / np.sqrt(np.maximum(beds, 1))
            wide = np.where(beds <= 1, np.hypot(error, of_mean), np.maximum(error, of_mean))
            found[f"{name}{end}_se"] = (told.dims, wide, told.attrs)
    return found


def bed_remarks(field: xr.Dataset) -> tuple[str, ...]:
    """What a reader must be told of the beds behind a field's errors, a sentence each."""
    study = bed_study_of(field)
    if study is None:
        if field.attrs.get("seeds") != 1:
            return ()
        told = "errors are those within the run of one bed, other beds differ by more: "
        if is_asked_for(field, "bed_study"):
            return (told + "the study of the beds has no point with values of two of them",)
        more = "add [bed_study] to the project of the field, with a point for each kind of motion, or seeds = 3"
        return (told + more,)
    parted = [
        f"{one.frequency:g} Hz, {one.intensity:g} g "
        f"(η {', '.join(f'{v:.3g}' for v in one.loss_factor if math.isfinite(v))})"
        for one, is_parted in zip(study.points, study.are_parted, strict=True)
        if is_parted
    ]
    if not parted:
        return ()
    told = f"beds of one description move in different ways at {'; '.join(parted)}; "
    rest = "no error bar holds there" if study.pooled else "no point is left that errors could be widened by"
    return (told + rest,)
