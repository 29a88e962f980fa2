"""What softened contacts do to a field: a few points at several stiffnesses, extrapolated to the described ones.

A contact lasts as long as its stiffness to the power -2/5 (Hertz) or -1/2 (linear), and what a bed does differently
when softened goes, to first order, with that time: an impact of the bed takes longer, and more particles share it. So
the values at several softenings s are fitted by a straight line in s^0.4 or s^0.5, whose value at s = 1 stands for the
described stiffness.
"""

import json
import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from graindamp.campaign.backends import CPU
from graindamp.campaign.point import PointResult, PointTask, task_of
from graindamp.spec.field import FieldSpec

Real = NDArray[np.float64]

POWER = {"hertz-gonthier": 0.4, "hertz-viscoelastic": 0.4, "linear": 0.5}
"""Power of the softening that the time in contact grows with, by normal law [-]."""


class Extrapolation(NamedTuple):
    """A value over softening, and what the line through it says; same unit as the value."""

    value: Real
    """At each softening; (factor,)."""
    standard_error: Real
    """Of each; (factor,)."""
    described: float
    """At softening 1, by the line."""
    described_se: float
    """Its standard error, widened where the points scatter more about the line than their errors."""
    chosen: float
    """At the chosen softening, by the line."""
    error: float
    """Of the chosen softening, chosen - described."""
    error_se: float
    """Its standard error, widened likewise."""
    scatter: float
    """Root mean square of residual over standard error, 1 where the line fits; NaN with two softenings."""


class StudiedPoint(NamedTuple):
    """One operating point of a study."""

    frequency: float
    """[Hz]"""
    intensity: float
    """Gamma [-]."""
    loss_factor: Extrapolation
    effective_mass_ratio: Extrapolation


class SofteningStudy(NamedTuple):
    """What the chosen softening does to a field."""

    chosen: float
    """Softening of the field [-]."""
    factors: Real
    """Softenings compared [-]; (factor,)."""
    power: float
    """Power of the softening that values are linear in [-]."""
    points: tuple[StudiedPoint, ...]
    floor: float
    """Size of eta below which errors are held to that of this value [-]."""

    @property
    def relative_errors(self) -> Real:
        """Larger of the errors of eta and m' over the larger of |eta| and the floor, at each point [-]; (point,)."""
        return np.array([
            max(abs(one.loss_factor.error), abs(one.effective_mass_ratio.error))
            / max(abs(one.loss_factor.described), self.floor)
            for one in self.points
        ])  # fmt: skip

    def dump(self) -> str:
        """The study as JSON, for the attributes of a field."""
        return json.dumps(
            {
                "chosen": self.chosen,
                "factors": self.factors.tolist(),
                "power": self.power,
                "floor": self.floor,
                "points": [
                    {
                        "frequency": one.frequency,
                        "intensity": one.intensity,
                        "loss_factor": _plain(one.loss_factor),
                        "effective_mass_ratio": _plain(one.effective_mass_ratio),
                    }
                    for one in self.points
                ],
            },
            sort_keys=True,
        )

    @classmethod
    def load(cls, text: str) -> "SofteningStudy":
        """The study that :meth:`dump` wrote."""
        told = json.loads(text)

        def fit(values: dict[str, Any]) -> Extrapolation:
            read: dict[str, Any] = {name: np.array(value, float)[()] for name, value in values.items()}
            return Extrapolation(**read)

        points = tuple(
            StudiedPoint(one["frequency"], one["intensity"], fit(one["loss_factor"]), fit(one["effective_mass_ratio"]))
            for one in told["points"]
        )
        return cls(told["chosen"], np.array(told["factors"], float), told["power"], points, told["floor"])


def softened(spec: FieldSpec, factor: float) -> FieldSpec:
    """The same field with contacts softened by `factor` [-]."""
    contact = spec.damper.contact.model_copy(update={"softening": float(factor)})
    return spec.model_copy(update={"damper": spec.damper.model_copy(update={"contact": contact})})


def study_tasks(spec: FieldSpec, folder: Path | None = None, backend: str = CPU) -> list[list[PointTask]]:
    """Tasks of a study: a list for each point, with a task for each softening and seed, seeds running fastest.

    Args:
        spec: a field with a softening_study.
        folder: what files in the description are relative to.
        backend: what computes them.
    """
    assert spec.softening_study is not None
    return [
        [
            task_of(softened(spec, factor), f, gamma, seed, folder=folder, backend=backend)
            for factor in spec.softening_study.factors
            for seed in range(spec.seeds)
        ]
        for f, gamma in spec.softening_study.points
    ]


def evaluate(
    spec: FieldSpec, result_of: Callable[[PointTask], PointResult], folder: Path | None = None, backend: str = CPU
) -> SofteningStudy:
    """The study, from the results of its tasks.

    Args:
        spec: as :func:`study_tasks` got it.
        result_of: gives the result of a task.
        folder: likewise.
        backend: likewise.

    Raises:
        ValueError: fewer than two softenings of a point gave a value.
    """
    assert spec.softening_study is not None
    factors = np.array(spec.softening_study.factors)
    chosen, power = spec.damper.contact.softening, POWER[spec.damper.contact.law]
    points = []
    for (f, gamma), tasks in zip(spec.softening_study.points, study_tasks(spec, folder, backend), strict=True):
        results = [result_of(task) for task in tasks]
        groups = [results[k : k + spec.seeds] for k in range(0, len(results), spec.seeds)]
        columns = [_mean_of_seeds(groups, name) for name in ("loss_factor", "effective_mass_ratio")]
        fits = [extrapolate(factors, value, error, chosen, power) for value, error in columns]
        points.append(StudiedPoint(f, gamma, *fits))
    return SofteningStudy(chosen, factors, power, tuple(points), spec.stop.floor)


def extrapolate(factors: Real, value: Real, standard_error: Real, chosen: float, power: float) -> Extrapolation:
    """Straight line through values over softening to a power, weighted by their errors.

    Args:
        factors: softenings [-]; (factor,).
        value: at each; NaN where there is none; (factor,).
        standard_error: of each, same unit; (factor,).
        chosen: softening whose error is asked for [-].
        power: that time in contact grows with [-].

    Raises:
        ValueError: fewer than two values.
    """
    good = np.isfinite(value)
    if good.sum() < 2:
        raise ValueError(f"a line needs values at two softenings, given {good.sum()}")
    # An error of 0, where every cycle repeats the last, would leave the line no freedom at all.
    least = 1e-3 * max(float(np.max(np.abs(value[good]))), 1e-9)
    sigma = np.maximum(np.where(np.isfinite(standard_error), standard_error, 0.0), least)[good]
    x = factors[good] ** power - 1.0
    design = np.column_stack([np.ones(len(x)), x]) / sigma[:, None]
    covariance = np.linalg.inv(design.T @ design)
    line = covariance @ (design.T @ (value[good] / sigma))
    residual = (value[good] - line[0] - line[1] * x) / sigma
    free = len(x) - 2
    scatter = math.sqrt(float(residual @ residual) / free) if free else math.nan
    covariance = covariance * max(scatter, 1.0) ** 2 if free else covariance
    way = chosen**power - 1.0
    return Extrapolation(
        value=np.asarray(value, float),
        standard_error=np.asarray(standard_error, float),
        described=float(line[0]),
        described_se=math.sqrt(covariance[0, 0]),
        chosen=float(line[0] + line[1] * way),
        error=float(line[1] * way),
        error_se=math.sqrt(covariance[1, 1]) * way,
        scatter=scatter,
    )


def _mean_of_seeds(groups: Sequence[Sequence[PointResult]], name: str) -> tuple[Real, Real]:
    """Mean over the beds and its standard error, for each softening; each (factor,)."""
    value = np.array([[getattr(one, name) for one in group] for group in groups])
    error = np.array([[getattr(one, f"{name}_se") for one in group] for group in groups])
    n = np.isfinite(value).sum(axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = np.nansum(value, axis=1) / n
        inner = np.sqrt(np.nansum(error**2, axis=1)) / n
        outer = np.sqrt(np.nansum((value - mean[:, None]) ** 2, axis=1) / np.maximum(n - 1, 1) / n)
    return mean, np.where(n > 1, np.maximum(inner, outer), inner)


def _plain(fit: Extrapolation) -> dict[str, Any]:
    """Fields of a fit as JSON knows them; None for what is no number."""

    def number(value: float) -> float | None:
        return value if math.isfinite(value) else None

    arrays = {name: [number(v) for v in getattr(fit, name).tolist()] for name in ("value", "standard_error")}
    others = {name: number(getattr(fit, name)) for name in Extrapolation._fields if name not in arrays}
    return arrays | others
