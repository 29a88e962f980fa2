"""Adaptive plans: which points come next, chosen so that neither a kill nor the number of workers changes them.

Points are chosen in batches of fixed size. Batch k is chosen from the results of all batches before k - 1, with those
of batch k - 1 counted as under way, whatever has come back by then. So two batches are under way at any time, workers
are busy while the next one is awaited, and the same points are chosen however long each takes. If nothing more is
wanted, the last batch is awaited and the question asked again, with all results. Every choice is written to the store
before its points are run; a campaign that goes on reads them from there.
"""

import math
import time
from collections.abc import Sequence
from typing import Protocol

import numpy as np

from graindamp.campaign.descriptions import BATCH, StoredField, save_field
from graindamp.campaign.point import PointResult, PointTask, task_of
from graindamp.campaign.runner import Runner
from graindamp.errors import InputError
from graindamp.spec.container import RigidLid
from graindamp.spec.field import AdaptivePlan, FieldSpec

Place = tuple[float, float]
"""Frequency [Hz] and intensity Gamma [-]."""


class AdaptiveSource(Protocol):
    """Chooses points."""

    def first(self) -> Sequence[Place]:
        """Points to begin with."""

    def next(
        self, results: Sequence[tuple[Place, Sequence[PointResult]]], running: Sequence[Place], n_point: int
    ) -> Sequence[Place]:
        """Points to run next, at most `n_point`; none when the field is good enough.

        Args:
            results: of every bed at the points that are done and usable.
            running: points under way, and those that gave no value; none of them is wanted again.
            n_point: number of points wanted.
        """


def run_adaptive(field: StoredField, runner: Runner, source: AdaptiveSource | None = None) -> StoredField:
    """Run an adaptive plan to its end; the description with all points chosen.

    It ends when the accuracy is predicted everywhere, or at the limits of points, cost or time. A limit of time makes
    the number of points depend on the computer.

    Args:
        field: what was asked for, with the points chosen by an earlier campaign.
        runner: runs the points.
        source: chooses the points; None: :mod:`graindamp.field.adaptive`.
    """
    spec, plan = field.spec, field.spec.plan
    assert isinstance(plan, AdaptivePlan)
    source = SurrogateSource(spec) if source is None else source
    begun = time.monotonic()
    runner.stage = "adaptive"
    if not field.chosen:
        field = _extended(field, runner, source.first())
    for batch in field.chosen:
        runner.begin(tasks_at(field, batch))
    is_settled = False
    while True:
        known: tuple[tuple[Place, ...], ...] = field.chosen
        busy: tuple[Place, ...] = ()
        if len(field.chosen) > 1 and not is_settled:
            known, busy = field.chosen[:-1], field.chosen[-1]
        points = [place for batch in known for place in batch]
        runner.finish([task.key for task in tasks_at(field, points)])
        room = plan.max_points - len(points) - len(busy)
        late = plan.max_seconds is not None and time.monotonic() - begun > plan.max_seconds
        results = [(place, found) for place in points if (found := _results(field, runner, place))]
        valued = {place for place, _ in results}
        aside = (*busy, *(place for place in points if place not in valued))
        new = [] if room <= 0 or late or not results else source.next(results, aside, min(field.batch, room))
        if not new and not busy:
            return field
        is_settled = not new  # nothing is wanted yet: ask again when what is under way is known
        if new:
            field = _extended(field, runner, new)
            runner.begin(tasks_at(field, new))


def batch_for(spec: FieldSpec, n_worker: int) -> int:
    """Points to choose at a time so that `n_worker` runs are under way: two batches are, with all their beds. At most a
    quarter of the points that the plan allows, lest nothing be left to choose."""
    assert isinstance(spec.plan, AdaptivePlan)
    return max(BATCH, min(math.ceil(n_worker / (2 * spec.seeds)), spec.plan.max_points // 4))


def tasks_at(field: StoredField, places: Sequence[Place]) -> list[PointTask]:
    """Tasks from rest of all beds at some points."""
    return [
        task_of(field.spec, *place, seed=seed, folder=field.where, backend=field.backend)
        for place in places
        for seed in range(field.spec.seeds)
    ]


def _extended(field: StoredField, runner: Runner, places: Sequence[Place]) -> StoredField:
    field = field._replace(chosen=(*field.chosen, tuple(places)))
    save_field(runner.store, field)
    return field


def _results(field: StoredField, runner: Runner, place: Place) -> list[PointResult]:
    found = [runner.results.get(task.key) for task in tasks_at(field, [place])]
    return [result for result in found if result is not None and not result.failed]


class SurrogateSource:
    """Points that lower the errors of the Gaussian process of :mod:`graindamp.field.surrogate` most, for their cost."""

    def __init__(self, spec: FieldSpec) -> None:
        """Choose points of an adaptive plan."""
        assert isinstance(spec.plan, AdaptivePlan)
        self._spec, self._plan = spec, spec.plan
        lid = spec.damper.lid
        self._clearance = lid.clearance if isinstance(lid, RigidLid) else None

    def first(self) -> Sequence[Place]:
        """A coarse grid, and where the edge of collect and collide is expected; all of them candidates."""
        from graindamp.field.adaptive import candidates, coarse_start, nearest

        plan = self._plan
        counts = plan.start_frequencies, plan.start_intensities
        start = coarse_start(plan.frequency_range, plan.intensity_range, *counts, clearance=self._clearance)
        return nearest(start, candidates(plan.frequency_range, plan.intensity_range))[: plan.max_points]

    def next(
        self, results: Sequence[tuple[Place, Sequence[PointResult]]], running: Sequence[Place], n_point: int
    ) -> Sequence[Place]:
        """The points that take away most of what the errors are above the asked ones, for their cost."""
        from graindamp.campaign.consolidate import Answer, field_of
        from graindamp.field.adaptive import candidates, is_accurate, learned_cost, next_points
        from graindamp.field.schema import damper_of, places_of
        from graindamp.field.surrogate import Surrogate

        plan, floor = self._plan, self._spec.stop.floor
        points = field_of(self._spec, {place: [Answer(one) for one in found] for place, found in results})
        try:
            surrogate = Surrogate(points, damper_of(points).get("clearance", self._clearance))
        except InputError:  # too few, or all in one line
            return self._spread([place for place, _ in results], running, n_point)
        ranges = plan.frequency_range, plan.intensity_range
        if is_accurate(surrogate, *ranges, accuracy=plan.accuracy, floor=floor).is_accurate:
            return []
        grid, paid = candidates(*ranges), points["particle_steps"].to_numpy() / self._spec.seeds
        cost = learned_cost(*places_of(points), paid)
        left = np.inf
        if plan.max_cost is not None:
            under_way = cost(*np.array(running, float).reshape(-1, 2).T)
            left = plan.max_cost * float(np.sum(cost(*grid))) - float(np.sum(paid)) - float(np.sum(under_way))
        choices = next_points(surrogate, grid, n_point, plan.accuracy, floor, busy=running, cost=cost, budget=left)
        return [(choice.frequency, choice.intensity) for choice in choices]

    def _spread(self, known: Sequence[Place], running: Sequence[Place], n_point: int) -> Sequence[Place]:
        """Candidates far from all points so far, as many as a surrogate lacks."""
        from graindamp.field.adaptive import candidates
        from graindamp.field.surrogate import MIN_POINTS

        plan = self._plan
        grid = np.column_stack(candidates(plan.frequency_range, plan.intensity_range))
        taken, chosen = [*known, *running], []
        for _ in range(min(n_point, max(1, MIN_POINTS - len(known)))):
            apart = np.log(grid[:, None] / np.array(taken)) / np.log(grid.max(axis=0) / grid.min(axis=0))
            distance = np.linalg.norm(apart, axis=-1).min(axis=1)
            if distance.max() <= 0.0:
                break
            f, gamma = grid[int(np.argmax(distance))]
            chosen.append((float(f), float(gamma)))
            taken.append(chosen[-1])
        return chosen
