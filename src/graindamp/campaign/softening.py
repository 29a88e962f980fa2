"""What softened contacts do to a field: a few points at several stiffnesses, extrapolated to the described ones.

A contact lasts as long as its stiffness to the power -2/5 (Hertz) or -1/2 (linear), and what a bed does differently
when softened goes, to first order, with that time: an impact of the bed takes longer, and more particles share it. So
the values at several softenings s are fitted by a straight line in s^0.4 or s^0.5, whose value at s = 1 stands for the
described stiffness.
"""

import math
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from graindamp.campaign.backends import CPU
from graindamp.campaign.point import PointResult, PointTask, task_of
from graindamp.field.softening import Extrapolation, SofteningStudy, StudiedPoint, sigma_of
from graindamp.spec.field import FieldSpec

Real = NDArray[np.float64]

POWER = {"hertz-gonthier": 0.4, "hertz-viscoelastic": 0.4, "linear": 0.5}
"""Power of the softening that the time in contact grows with, by normal law [-]."""


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
    spec: FieldSpec,
    result_of: Callable[[PointTask], PointResult],
    folder: Path | None = None,
    backend: str = CPU,
    scatter: tuple[float, float] = (0.0, 0.0),
) -> SofteningStudy:
    """The study, from the results of its tasks; points with values at fewer than two softenings are left out.

    Args:
        spec: as :func:`study_tasks` got it.
        result_of: gives the result of a task.
        folder: likewise.
        backend: likewise.
        scatter: of beds beyond the errors of their runs, of eta and of m' over the loss factor [-], which every value
            has too.
    """
    assert spec.softening_study is not None
    factors = np.array(spec.softening_study.factors)
    chosen, power = spec.damper.contact.softening, POWER[spec.damper.contact.law]
    points = []
    for (f, gamma), tasks in zip(spec.softening_study.points, study_tasks(spec, folder, backend), strict=True):
        results = [result_of(task) for task in tasks]
        groups = [results[k : k + spec.seeds] for k in range(0, len(results), spec.seeds)]
        columns = [_mean_of_seeds(groups, name) for name in ("loss_factor", "effective_mass_ratio")]
        size = np.maximum(np.abs(columns[0][0]), spec.stop.floor) / math.sqrt(spec.seeds)
        wider = np.hypot if spec.seeds == 1 else np.maximum  # errors of several beds have seen their scatter
        columns = [
            (value, wider(error, of_bed * size)) for (value, error), of_bed in zip(columns, scatter, strict=True)
        ]
        if min(np.isfinite(value).sum() for value, _ in columns) >= 2:
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
    sigma = sigma_of(value, standard_error)[good]
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
