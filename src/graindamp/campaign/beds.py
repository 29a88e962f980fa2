"""A few points of a field with several beds: how much it would differ with another bed of the same description."""

from collections.abc import Callable
from pathlib import Path

import numpy as np

from graindamp.campaign.backends import CPU
from graindamp.campaign.point import PointResult, PointTask, task_of
from graindamp.field.beds import BedPoint, BedStudy
from graindamp.spec.field import FieldSpec


def bed_tasks(spec: FieldSpec, folder: Path | None = None, backend: str = CPU) -> list[list[PointTask]]:
    """Tasks of a study: a list for each point, with a task for each bed.

    Args:
        spec: a field with a bed_study.
        folder: what files in the description are relative to.
        backend: what computes them.
    """
    study = spec.bed_study
    assert study is not None
    return [
        [task_of(spec, f, gamma, seed, folder=folder, backend=backend) for seed in range(study.seeds)]
        for f, gamma in study.points
    ]


def compare(
    spec: FieldSpec, result_of: Callable[[PointTask], PointResult], folder: Path | None = None, backend: str = CPU
) -> BedStudy:
    """The study, from the results of its tasks; points with values of fewer than two beds are left out.

    Args:
        spec: as :func:`bed_tasks` got it.
        result_of: gives the result of a task.
        folder: likewise.
        backend: likewise.
    """
    assert spec.bed_study is not None
    points = []
    for (f, gamma), tasks in zip(spec.bed_study.points, bed_tasks(spec, folder, backend), strict=True):
        results = [result_of(task) for task in tasks]
        columns = {name: np.array([getattr(one, name) for one in results]) for name in BedPoint._fields[2:]}
        if np.isfinite(columns["loss_factor"]).sum() >= 2:
            points.append(BedPoint(f, gamma, **columns))
    return BedStudy(tuple(points), spec.stop.floor)
