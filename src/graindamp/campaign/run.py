"""A field by simulation: from its description, over the runs of all its points, to the effective field."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import xarray as xr

from graindamp.campaign import work
from graindamp.campaign.adaptive import AdaptiveSource, run_adaptive, tasks_at
from graindamp.campaign.consolidate import Answer, Place, field_of
from graindamp.campaign.descriptions import BATCH, StoredField, known_field, save_field
from graindamp.campaign.executors import Executor
from graindamp.campaign.hysteresis import Cell, Fetch, second_answers
from graindamp.campaign.point import PointResult, PointTask
from graindamp.campaign.runner import Runner, Watch, reasons
from graindamp.campaign.store import Store
from graindamp.campaign.work import Measure
from graindamp.errors import InputError
from graindamp.spec.field import AdaptivePlan, FieldSpec, GridPlan


class FieldRun(NamedTuple):
    """A field and how it came about."""

    field: xr.Dataset
    """The effective field; NaN with a status at points that failed."""
    n_point: int
    """Runs that the field is made of, all beds and starts [-]."""
    n_computed: int
    """Runs computed now; the others were in the store [-]."""
    failures: tuple[str, ...]
    """Points that failed, with their reasons."""
    warnings: tuple[str, ...]
    """What was found damaged and dealt with."""


def run_field(
    spec: FieldSpec,
    store: Store,
    executor: Executor,
    *,
    project: Path | None = None,
    watch: Watch | None = None,
    how: Measure | None = None,
    batch: int = BATCH,
    source: AdaptiveSource | None = None,
) -> FieldRun:
    """Effective field of a damper, computed as far as the store does not hold it yet.

    The field depends on the description alone: not on the executor, on the order in which points come back, or on how
    often the campaign was killed on the way.

    Args:
        spec: the field.
        store: holds what is done, and takes the rest.
        executor: who computes; it is left running.
        project: file of the description; what it names is relative to its folder. None: the working directory.
        watch: told how far it is.
        how: how a point is measured; None: simulated.
        batch: points of an adaptive plan chosen at a time; more keep more workers busy, fewer need fewer points.
        source: chooses the points of an adaptive plan; None: by a Gaussian process.

    Raises:
        InputError: every point failed, with the reasons; the store cannot be written, or the workers are gone.
        KeyboardInterrupt: Ctrl-C. The store is left as it is; the same call goes on from there.
    """
    field = described(spec, project, batch)
    known = known_field(store, field)
    if known is not None and known.is_same(field):
        field = field._replace(chosen=known.chosen)
    if known != field:
        save_field(store, field)
    runner = Runner(store, executor, how or work.measure_packed, watch)
    try:
        if isinstance(spec.plan, AdaptivePlan):
            field = run_adaptive(field, runner, source)
        return _outcome(field, runner)
    except BaseException:
        store.release()
        raise


def described(spec: FieldSpec, project: Path | None, batch: int = BATCH) -> StoredField:
    """A field to be run, as the store keeps it."""
    place = "field.toml" if project is None else str(project.resolve())
    folder = None if project is None else str(project.resolve().parent)
    return StoredField(spec, Path(place).stem, place, folder, batch)


def field_in_store(field: StoredField, store: Store) -> FieldRun:
    """The part of a field that a store holds; nothing is run.

    Raises:
        InputError: no point with a usable value is done.
    """
    entries = store.entries()
    results: dict[str, PointResult] = {}
    tasks: dict[str, PointTask] = {}

    def fetch(asked: Sequence[PointTask]) -> Mapping[str, PointResult]:
        tasks.update({task.key: task for task in asked})
        for key in (task.key for task in asked):
            entry = entries.get(key)
            if key not in results and entry is not None and entry.state == "done":
                found = store.load(key)
                if found is not None:
                    results[key] = found
        return {task.key: results[task.key] for task in asked if task.key in results}

    answers = _answers(field, fetch)
    failures = [
        f"{task.frequency:g} Hz, {task.intensity:g}, bed {task.seed}: {entries[key].reason}"
        for key, task in tasks.items()
        if key in entries and entries[key].state == "failed"
    ]
    return FieldRun(field_of(field.spec, answers), len(tasks), 0, tuple(failures), tuple(store.warnings))


def rest_tasks(field: StoredField) -> list[PointTask]:
    """Tasks from rest of a field: bed by bed at point after point, as far as they are known yet."""
    return tasks_at(field, _places(field))


def _outcome(field: StoredField, runner: Runner) -> FieldRun:
    answers = _answers(field, runner.run, runner)
    failures = reasons(runner.failures)
    if not any(answer.rest is not None and not answer.rest.failed for row in answers.values() for answer in row):
        why = "\n".join(failures[:10])
        raise InputError(f"{field.spec.title}: not one point has a usable value\n{why}")
    dataset = field_of(field.spec, answers)
    return FieldRun(dataset, runner.n_point, runner.n_computed, tuple(failures), tuple(runner.store.warnings))


def _answers(field: StoredField, fetch: Fetch, runner: Runner | None = None) -> dict[Place, list[Answer]]:
    """What every bed answers at every point, fetched by running or by looking up."""
    spec = field.spec
    places = _places(field)
    tasks = {(places[k // spec.seeds], k % spec.seeds): task for k, task in enumerate(rest_tasks(field))}
    results = fetch(list(tasks.values()))
    rest = {at: results.get(task.key) for at, task in tasks.items()}
    if spec.hysteresis == "none":
        return {place: [Answer(rest[place, seed]) for seed in range(spec.seeds)] for place in places}
    if runner is not None:
        runner.stage = "from neighbours"
    assert isinstance(spec.plan, GridPlan)
    axes = spec.plan.frequencies, spec.plan.intensities
    cells: dict[tuple[Place, int], Cell] = {
        (place, seed): (axes[0].index(place[0]), axes[1].index(place[1]), seed) for place, seed in tasks
    }
    usable = {
        cells[at]: (tasks[at].key, result) for at, result in rest.items() if result is not None and not result.failed
    }
    second = second_answers(spec, field.where, usable, fetch)
    answers: dict[Place, list[Answer]] = {place: [] for place in places}
    for (place, seed), cell in cells.items():
        found = second.get(cell)
        answer = Answer(rest[place, seed])
        answers[place].append(
            answer if found is None else Answer(rest[place, seed], found.answer, found.particle_steps)
        )
    return answers


def _places(field: StoredField) -> list[Place]:
    plan = field.spec.plan
    if isinstance(plan, AdaptivePlan):
        return [place for batch in field.chosen for place in batch]
    return list(plan.points)
