"""Second answers: every point of a grid started from the ends of its neighbours' runs as well."""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from graindamp.campaign.backends import CPU
from graindamp.campaign.point import PointResult, PointTask, task_of
from graindamp.spec.field import FieldSpec, GridPlan

ERRORS_APART = 3.0
"""Combined standard errors that two answers differ by, at least [-]."""
SHARE_APART = 0.4
"""Difference of two answers over max(eta, SMALLEST_ETA), at least [-]. Beds wander by up to a tenth of eta, more slowly
than the error of one run sees: two runs of one motion may be three times the root of two of that apart."""
SMALLEST_ETA = 0.05

Cell = tuple[int, int, int]
"""Number of frequency and intensity on the grid, and of the bed."""
Fetch = Callable[[Sequence[PointTask]], Mapping[str, PointResult]]
"""Gives the results of tasks by key, without those that have none."""


class Second(NamedTuple):
    """What the starts from neighbours gave at one cell."""

    answer: PointResult | None
    """The answer that differs most from that of rest; None if all agree."""
    key: str | None
    """Its key."""
    particle_steps: float
    """Cost of all of them [-]."""


def second_answers(
    spec: FieldSpec,
    folder: Path | None,
    rest: Mapping[Cell, tuple[str, PointResult]],
    fetch: Fetch,
    backend: str = CPU,
) -> dict[Cell, Second]:
    """Answers of the points when they start from their neighbours' ends.

    First from the neighbours' runs from rest. Where an answer differs from that of rest, there is a second branch, and
    the neighbours are started from its end, too, until no new one is found. Which tasks a round has depends on the
    results before it alone, not on who computed them when.

    Args:
        spec: a field on a grid with hysteresis.
        folder: what files in the description are relative to.
        rest: key and result of the runs from rest; those that failed are left out.
        fetch: runs tasks, or looks their results up.
        backend: what computes them.
    """
    found: dict[Cell, Second] = {}
    starts = {cell: key for cell, (key, _) in rest.items()}
    while starts:
        goals: dict[str, Cell] = {}
        tasks: list[PointTask] = []
        for cell, start in starts.items():
            for other in _neighbours(spec, cell):
                second = found.get(other)
                if other not in rest or (second is not None and second.answer is not None):
                    continue
                task = _task(spec, folder, other, start, backend)
                goals[task.key] = other
                tasks.append(task)
        results = fetch(tasks)
        before = {cell for cell, second in found.items() if second.answer is not None}
        for key, cell in goals.items():
            if key in results:
                found[cell] = _chosen(found.get(cell), rest[cell][1], key, results[key])
        starts = {cell: second.key for cell, second in found.items() if second.key is not None and cell not in before}
    return found


def distance(first: PointResult, second: PointResult) -> float:
    """How far apart two answers are, over what makes them differ [-]: they do above 1; the larger of eta and m'."""
    size = SHARE_APART * max(abs(first.loss_factor), SMALLEST_ETA)
    apart: list[float] = []
    for name in ("loss_factor", "effective_mass_ratio"):
        error = math.hypot(getattr(first, f"{name}_se"), getattr(second, f"{name}_se"))
        apart.append(float(abs(getattr(first, name) - getattr(second, name)) / max(ERRORS_APART * error, size)))
    return max(apart)


def _chosen(known: Second | None, rest: PointResult, key: str, result: PointResult) -> Second:
    """The new answer if it differs from that of rest, and more than the one known."""
    steps = result.particle_steps + (known.particle_steps if known else 0.0)
    answer = known.answer if known else None
    new = 0.0 if result.failed else distance(rest, result)
    if new > 1.0 and (answer is None or new > distance(rest, answer)):
        return Second(result, key, steps)
    return Second(answer, known.key if known else None, steps)


def _neighbours(spec: FieldSpec, cell: Cell) -> Iterator[Cell]:
    """Cells next to one: in intensity, and in frequency too if the spec says "all"."""
    assert isinstance(spec.plan, GridPlan)
    i, j, seed = cell
    steps = [(0, -1), (0, 1)] + ([(-1, 0), (1, 0)] if spec.hysteresis == "all" else [])
    for di, dj in steps:
        if 0 <= i + di < len(spec.plan.frequencies) and 0 <= j + dj < len(spec.plan.intensities):
            yield i + di, j + dj, seed


def _task(spec: FieldSpec, folder: Path | None, cell: Cell, start: str, backend: str) -> PointTask:
    assert isinstance(spec.plan, GridPlan)
    i, j, seed = cell
    return task_of(spec, spec.plan.frequencies[i], spec.plan.intensities[j], seed, start, folder, backend)
