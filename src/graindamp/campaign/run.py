"""A field by simulation: from its description, over the runs of all its points, to the effective field."""

import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import xarray as xr

from graindamp.campaign import work
from graindamp.campaign.adaptive import AdaptiveSource, run_adaptive, tasks_at
from graindamp.campaign.backends import CPU
from graindamp.campaign.beds import bed_tasks, compare
from graindamp.campaign.consolidate import Answer, Place, field_of
from graindamp.campaign.descriptions import BATCH, StoredField, known_field, save_field
from graindamp.campaign.executors import Executor
from graindamp.campaign.hysteresis import Cell, Fetch, second_answers
from graindamp.campaign.point import PointResult, PointTask
from graindamp.campaign.runner import Runner, Watch, reasons
from graindamp.campaign.softening import evaluate, study_tasks
from graindamp.campaign.store import Store
from graindamp.campaign.work import Measure
from graindamp.errors import InputError
from graindamp.field.beds import BedStudy, widened
from graindamp.field.schema import GRID as GRID_DIMENSIONS
from graindamp.field.schema import damper_of, places_of
from graindamp.spec.field import AdaptivePlan, FieldSpec, GridPlan, logarithmic
from graindamp.status import FATAL, describe

if TYPE_CHECKING:
    from graindamp.field.adaptive import Verdict

GRID = (28, 15)
"""Frequencies and intensities that the field of an adaptive plan is given at [-]."""


class FieldRun(NamedTuple):
    """A field and how it came about."""

    field: xr.Dataset
    """The effective field; NaN with a status at points that failed. Of an adaptive plan what the surrogate predicts on
    a grid, with its errors."""
    points: xr.Dataset
    """The points that were simulated; of grids and lists the field itself."""
    n_point: int
    """Runs that the field is made of, all beds and starts [-]."""
    n_computed: int
    """Runs computed now; the others were in the store [-]."""
    failures: tuple[str, ...]
    """Points that failed, with their reasons."""
    warnings: tuple[str, ...]
    """What was found damaged and dealt with."""
    lost: tuple[str, ...] = ()
    """Runs that ended without a usable value, with their reasons. The same run would end so again."""
    verdict: "Verdict | None" = None
    """Of an adaptive plan: how accurate its field is predicted to be."""
    is_ended: bool = True
    """False for what a store holds so far, where more may come."""


def run_field(
    spec: FieldSpec,
    store: Store,
    executor: Executor,
    *,
    project: Path | None = None,
    watch: Watch | None = None,
    how: Measure | None = None,
    batch: int = BATCH,
    backend: str = CPU,
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
        backend: what computes the points, one of :data:`graindamp.campaign.backends.BACKENDS`.
        source: chooses the points of an adaptive plan; None: by a Gaussian process.

    Raises:
        InputError: every point failed, with the reasons; the store cannot be written, or the workers are gone.
        KeyboardInterrupt: Ctrl-C. The store is left as it is; the same call goes on from there.
    """
    field = described(spec, project, batch, backend)
    known = known_field(store, field)
    if known is not None and known.is_same(field):
        field = field._replace(chosen=known.chosen)
    if known != field:
        save_field(store, field)
    runner = Runner(store, executor, how or work.measure_packed, watch)
    try:
        if isinstance(spec.plan, AdaptivePlan):
            field = run_adaptive(field, runner, source)
        return _outcome(field, runner, watch)
    except BaseException:
        store.release()
        raise


def described(spec: FieldSpec, project: Path | None, batch: int = BATCH, backend: str = CPU) -> StoredField:
    """A field to be run, as the store keeps it."""
    place = "field.toml" if project is None else str(project.resolve())
    folder = None if project is None else str(project.resolve().parent)
    return StoredField(spec, Path(place).stem, place, folder, batch, backend=backend)


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
    points = field_of(field.spec, answers, field.backend)
    predicted, verdict = _predicted(field.spec, points)
    run = FieldRun(predicted, points, 0, 0, (), (), _lost(answers), verdict, is_ended=False)
    run = _with_studies(run, field, lambda _: fetch)
    failures = [
        f"{task.frequency:g} Hz, {task.intensity:g}, bed {task.seed}: {entries[key].reason}"
        for key, task in tasks.items()
        if key in entries and entries[key].state == "failed"
    ]
    warnings = (*store.warnings, *run.warnings)
    return run._replace(n_point=len(tasks), failures=tuple(failures), warnings=warnings)


def rest_tasks(field: StoredField) -> list[PointTask]:
    """Tasks from rest of a field: bed by bed at point after point, as far as they are known yet."""
    return tasks_at(field, _places(field))


def _outcome(field: StoredField, runner: Runner, watch: Watch | None) -> FieldRun:
    """The field with its studies."""
    answers = _answers(field, runner.run, runner)
    if not any(answer.rest is not None and not answer.rest.failed for row in answers.values() for answer in row):
        why = "\n".join([*reasons(runner.failures), *_lost(answers)][:10])
        raise InputError(f"{field.spec.title}: not one point has a usable value\n{why}")
    points = field_of(field.spec, answers, field.backend)
    predicted, verdict = _predicted(field.spec, points)
    run = FieldRun(predicted, points, 0, 0, (), (), _lost(answers), verdict)
    # Points of studies are no part of the map: they have a runner of their own.
    own = runner.outlook()
    aside = Runner(
        runner.store,
        runner.executor,
        runner.how,
        None if watch is None else lambda outlook: watch(outlook._replace(places=own.places)),
    )

    def fetch_for(stage: str) -> Fetch:
        aside.stage = stage
        return aside.run

    run = _with_studies(run, field, fetch_for)
    if watch is not None and aside.n_point:
        watch(own)
    return run._replace(
        n_point=len(runner.keys | aside.keys),
        n_computed=runner.n_computed + aside.n_computed,
        failures=tuple(reasons(runner.failures | aside.failures)),
        warnings=(*runner.store.warnings, *run.warnings),
    )


def _lost(answers: Mapping[Place, Sequence[Answer]]) -> tuple[str, ...]:
    """Runs from rest that ended without a usable value."""
    return tuple(
        f"{f:g} Hz, {gamma:g}, bed {seed}: {'; '.join(describe(answer.rest.status & FATAL))}"
        for (f, gamma), row in answers.items()
        for seed, answer in enumerate(row)
        if answer.rest is not None and answer.rest.failed
    )


def _predicted(spec: FieldSpec, points: xr.Dataset) -> tuple[xr.Dataset, "Verdict | None"]:
    """Of an adaptive plan what the surrogate makes of its points on a grid, motion modes as at the nearest point, and
    how accurate that is; the points themselves where they are too few or span no area, or of another plan."""
    plan = spec.plan
    if not isinstance(plan, AdaptivePlan):
        return points, None
    from graindamp.field.adaptive import is_accurate
    from graindamp.field.surrogate import Surrogate

    f = logarithmic(*plan.frequency_range, GRID[0])
    gamma = logarithmic(*plan.intensity_range, GRID[1])
    try:
        surrogate = Surrogate(points, damper_of(points).get("clearance"))
        predicted = surrogate.field(f, gamma, outside="mark")
    except InputError:  # too few, or all in one line
        return points, None
    ranges = plan.frequency_range, plan.intensity_range
    verdict = is_accurate(surrogate, *ranges, accuracy=plan.accuracy, floor=spec.stop.floor)
    at = np.log(np.stack(places_of(predicted), axis=-1))
    known = np.log(np.stack(places_of(points), axis=-1))
    nearest = np.argmin(np.sum((at[:, :, None] - known) ** 2, axis=-1), axis=-1)
    for name in ("motion_mode", "solid_fraction", *(name for name in points if str(name).startswith("loss_share_"))):
        if name in points:
            predicted[name] = (GRID_DIMENSIONS, points[name].to_numpy()[nearest], points[name].attrs)
    kept = ("damper", "spec", "graindamp_version", "physics", "seeds", "softening", "backend", "precision")
    predicted.attrs |= {name: points.attrs[name] for name in kept}
    predicted.attrs["particle_steps"] = float(points["particle_steps"].sum())
    return predicted, verdict


class _NoResult(NamedTuple):
    """Stands for the result of a task that has none."""

    loss_factor: float = math.nan
    loss_factor_se: float = math.nan
    effective_mass_ratio: float = math.nan
    effective_mass_ratio_se: float = math.nan


def _with_studies(run: FieldRun, field: StoredField, fetch_for: Callable[[str], Fetch]) -> FieldRun:
    """The same with the studies that are asked for, from as many of their runs as there are, and what to know of
    them."""
    spec, where, backend = field.spec, field.where, field.backend
    told = list(run.warnings)
    scatter = (0.0, 0.0)
    if spec.bed_study is not None:
        name = "bed study"
        beds = compare(spec, _looked_up(name, bed_tasks(spec, where, backend), fetch_for, told), where, backend)
        _tell_lost(name, len(spec.bed_study.points), len(beds.points), "of two beds", told)
        if beds.points:
            wide = widened(run.points, beds, spec.seeds)
            whole = wide if run.field is run.points else widened(run.field, beds, spec.seeds)
            run = run._replace(field=whole, points=wide)
            _tell_scatter(spec, beds, told)
        if beds.points and beds.pooled is not None:
            scatter = beds.pooled[0].value, beds.pooled[1].value
    if spec.softening_study is not None:
        name = "softening study"
        result_of = _looked_up(name, study_tasks(spec, where, backend), fetch_for, told)
        study = evaluate(spec, result_of, where, backend, scatter)
        _tell_lost(name, len(spec.softening_study.points), len(study.points), "at two softenings", told)
        if study.points:
            for dataset in (run.field, run.points):
                dataset.attrs["softening_study"] = study.dump()
    return run._replace(warnings=tuple(told))


def _looked_up(
    name: str, tasks: Sequence[Sequence[PointTask]], fetch_for: Callable[[str], Fetch], told: list[str]
) -> Callable[[PointTask], Any]:
    """Gives the results of the tasks of a study; NaN for those that are missing, which is told."""
    asked = [task for row in tasks for task in row]
    results = fetch_for(name)(asked)
    missing = sum(task.key not in results for task in asked)
    if missing:
        told.append(f"{name}: {missing} of {len(asked)} runs have no result; it is made of the others")
    return lambda task: results.get(task.key, _NoResult())


def _tell_lost(name: str, asked: int, found: int, needed: str, told: list[str]) -> None:
    if found < asked:
        told.append(f"{name}: {asked - found} of {asked} points left out, which have no values {needed}")


def _tell_scatter(spec: FieldSpec, beds: BedStudy, told: list[str]) -> None:
    """Whether an adaptive plan asks for more than beds of one description have in common."""
    if not isinstance(spec.plan, AdaptivePlan) or beds.pooled is None:
        return
    scatter = max(part.value for part in beds.pooled) / math.sqrt(spec.seeds)
    if scatter > spec.plan.accuracy:
        told.append(
            f"beds of this description differ by {100 * scatter:.2g} %, more than the accuracy of "
            f"{100 * spec.plan.accuracy:g} % that the plan asks for: more points do not help, more seeds do"
        )


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
    second = second_answers(spec, field.where, usable, fetch, field.backend)
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
