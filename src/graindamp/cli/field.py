"""Commands about fields by simulation: run them, and look after the store of their results."""

import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from graindamp.cli.options import AsJson, print_json, warn
from graindamp.cli.simulate import INTERRUPTED
from graindamp.errors import InputError

if TYPE_CHECKING:
    from graindamp.campaign.descriptions import StoredField
    from graindamp.campaign.executors import Executor
    from graindamp.campaign.run import FieldRun
    from graindamp.campaign.store import Store
    from graindamp.spec.field import FieldSpec

SHOWN = 10
"""Failed points that are listed; the others are counted."""

campaign = typer.Typer(
    name="campaign",
    help="Stores of simulated points: what is done, what failed, fields so far.",
    no_args_is_help=True,
    rich_markup_mode=None,
)

StoreArgument = Annotated[Path, typer.Argument(help="Folder of the store.", metavar="STORE")]


def field(
    projects: Annotated[list[Path], typer.Argument(help="Project files (.toml): [damper], [plan], [stop].")],
    output: Annotated[
        Path | None,
        typer.Option("-o", "--output", help="Field file to write, .nc or .csv; a folder for several projects."),
    ] = None,
    store: Annotated[
        Path | None, typer.Option(help="Folder where points are kept; default: <project>-store beside the project.")
    ] = None,
    executor: Annotated[
        str | None, typer.Option(help="Who computes: local (default), processes, serial, dask, slurm.")
    ] = None,
    scheduler: Annotated[str | None, typer.Option(help="Address of a Dask scheduler, tcp://host:8786.")] = None,
    workers: Annotated[int | None, typer.Option(min=1, help="Points at a time; default: the cores.")] = None,
    slurm: Annotated[list[str] | None, typer.Option(help="Option of SLURM jobs, as queue=short; repeatable.")] = None,
    batch: Annotated[int | None, typer.Option(min=1, help="Points that an adaptive plan chooses at a time.")] = None,
    resume: Annotated[
        bool, typer.Option("--resume", help="Go on with a campaign; refuse if there is none or the file has changed.")
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Simulate all operating points of a damper: an effective field.

    Points that the store holds are never computed again: after a stop or crash give the same command.
    """
    from graindamp.campaign.descriptions import BATCH
    from graindamp.campaign.executors import executor_of
    from graindamp.campaign.slurm import read_options
    from graindamp.campaign.store import Store
    from graindamp.spec.field import FieldSpec
    from graindamp.spec.model import load_spec

    specs = [load_spec(project, FieldSpec) for project in projects]
    outputs = _outputs(projects, output)
    kind = executor or ("dask" if scheduler else "local")
    if scheduler and kind != "dask":
        raise InputError(f"--scheduler goes with --executor dask, not {kind}")
    options = read_options(slurm or [])
    with Store(_store_place(projects, output, store)) as opened:
        if resume:
            for project, spec in zip(projects, specs, strict=True):
                _check_resumable(opened, project, spec, batch or BATCH)
        with (
            _stoppable(opened),
            _closing(executor_of(kind, n_worker=workers, address=scheduler, options=options)) as crew,
        ):
            documents = [
                _run_one(opened, crew, project, spec, target, batch or BATCH, as_json)
                for project, spec, target in zip(projects, specs, outputs, strict=True)
            ]
    if as_json:
        print_json(documents[0] if len(documents) == 1 else {"fields": documents})


def _run_one(
    store: "Store", crew: "Executor", project: Path, spec: "FieldSpec", target: Path, batch: int, as_json: bool
) -> dict[str, Any]:
    """Run one field, write it, and say so."""
    from graindamp.campaign.run import run_field
    from graindamp.report.field_progress import FieldProgress

    with FieldProgress(target, spec.title, quiet=as_json) as progress:
        run = run_field(spec, store, crew, project=project, watch=progress, batch=batch)
    points = _write_run(run, target)
    warn(run.warnings)
    warn(_failures(run.failures, store.folder))
    if not as_json:
        print(f"field    {target} ({run.n_point} runs, {run.n_computed} of them computed now)")
        if points is not None:
            print(f"points   {points}")
        print(f"map      {progress.picture}\npage     {progress.page}\nstore    {store.folder}")
    more = {"points": None if points is None else str(points), "map": str(progress.picture), "page": str(progress.page)}
    return _document(run, target, store) | more


@campaign.command()
def status(store: StoreArgument, as_json: AsJson = False) -> None:
    """What a store holds: points queued, running, done and failed, with reasons."""
    from collections import Counter

    from graindamp.campaign.descriptions import fields_of
    from graindamp.campaign.store import Store

    with Store(store, create=False) as opened:
        entries = opened.entries()
        fields = fields_of(opened)
        warnings = list(opened.warnings)
    count = Counter(entry.state for entry in entries.values())
    failed = [entry for entry in entries.values() if entry.state == "failed"]
    rows = [_field_row(one, entries) for one in fields]
    warn(warnings)
    if as_json:
        states = {state: count[state] for state in ("queued", "running", "done", "failed")}
        reasons = [{"key": entry.key, "reason": entry.reason, "tries": entry.tries} for entry in failed]
        print_json({"store": str(store), "points": states, "fields": rows, "failed": reasons, "warnings": warnings})
        return
    print(", ".join(f"{count[state]} {state}" for state in ("done", "running", "queued", "failed")))
    for row in rows:
        print(f"{row['name']}: {row['done']} of {row['points']} points from rest done ({row['project']})")
    for entry in failed[:SHOWN]:
        print(f"failed   {entry.key[:12]}: {entry.reason} (tries: {entry.tries})")
    if len(failed) > SHOWN:
        print(f"         and {len(failed) - SHOWN} more; --json lists all")
    if failed:
        print(f"'graindamp campaign retry {store}' queues the failed points again")


@campaign.command()
def retry(store: StoreArgument, as_json: AsJson = False) -> None:
    """Queue the failed points of a store again; the next 'graindamp field' runs them."""
    from graindamp.campaign.store import Store

    with Store(store, create=False) as opened:
        keys = opened.retry()
    if as_json:
        print_json({"store": str(store), "queued": keys})
        return
    print(f"{len(keys)} failed points queued again" if keys else "no point has failed")


@campaign.command()
def export(
    store: StoreArgument,
    output: Annotated[Path, typer.Option("-o", "--output", help="Field file to write, .nc or .csv.")],
    name: Annotated[str | None, typer.Option(help="Name of the field, where the store holds several.")] = None,
    as_json: AsJson = False,
) -> None:
    """Write the field that a store holds so far; points that are not done have no value."""
    from graindamp.campaign.descriptions import fields_of
    from graindamp.campaign.run import field_in_store
    from graindamp.campaign.store import Store

    _check_suffix(output)
    with Store(store, create=False) as opened:
        run = field_in_store(_choose(fields_of(opened), name, store), opened)
        document = _document(run, output, opened)
    document |= {"points": str(points) if (points := _write_run(run, output)) else None}
    warn(run.warnings)
    warn(_failures(run.failures, store))
    if as_json:
        print_json(document)
        return
    print(f"field    {output} ({document['usable']} of {document['places']} points have a value)")


def register_field(app: typer.Typer) -> None:
    """Add the commands to the command line."""
    app.command()(field)
    app.add_typer(campaign, name="campaign")


def _outputs(projects: list[Path], output: Path | None) -> list[Path]:
    """A field file for each project."""
    from graindamp.field.store import SUFFIXES

    if len(projects) == 1 and (output is None or output.suffix):
        target = output if output is not None else projects[0].with_suffix(".nc")
        _check_suffix(target)
        return [target]
    if output is not None and output.suffix in SUFFIXES:
        raise InputError(f"--output: given '{output}', one file for {len(projects)} projects; give a folder")
    names = [project.stem for project in projects]
    if len(set(names)) < len(names):
        raise InputError("two projects have the same name, and so would their fields; rename one")
    folder = output if output is not None else Path("fields")
    return [folder / f"{name}.nc" for name in names]


def _check_suffix(target: Path) -> None:
    from graindamp.field.store import SUFFIXES

    if target.suffix not in SUFFIXES:
        raise InputError(f"--output: given '{target}'; a field file ends in {' or '.join(SUFFIXES)}")


def _write_run(run: "FieldRun", target: Path) -> Path | None:
    """Write the field, and of an adaptive plan the points it was made from; their file, or None."""
    _write(run.field, target)
    if run.points is run.field:
        return None
    points = target.with_name(f"{target.stem}.points{target.suffix}")
    _write(run.points, points)
    return points


def _write(field: Any, target: Path) -> None:
    """Write a field under a name that appears when all of it is there."""
    from graindamp.field.store import write_field

    draft = target.with_name(f".{target.stem}.part{target.suffix}")
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        write_field(field, draft)
        draft.replace(target)
    except OSError as error:
        raise InputError(f"{target}: cannot be written ({error.strerror or error})") from None
    finally:
        with suppress(OSError):
            draft.unlink(missing_ok=True)


def _store_place(projects: list[Path], output: Path | None, store: Path | None) -> Path:
    if store is not None:
        return store
    if len(projects) == 1:
        return projects[0].parent / f"{projects[0].stem}-store"
    return (output if output is not None else Path("fields")) / "store"


def _check_resumable(store: "Store", project: Path, spec: "FieldSpec", batch: int) -> None:
    from graindamp.campaign.descriptions import known_field
    from graindamp.campaign.run import described

    field = described(spec, project, batch)
    known = known_field(store, field)
    if known is None:
        raise InputError(f"--resume: {store.folder} holds no campaign of {project}; leave --resume out to begin one")
    if not known.is_same(field):
        raise InputError(
            f"--resume: {project} is not what the campaign in {store.folder} was begun with; undo the changes, or "
            "leave --resume out: points that are the same are used again"
        )


def _field_row(field: "StoredField", entries: dict[str, Any]) -> dict[str, Any]:
    from graindamp.campaign.run import rest_tasks

    keys = [task.key for task in rest_tasks(field)]
    states = [entries[key].state if key in entries else "queued" for key in keys]
    told = {state: states.count(state) for state in ("queued", "running", "done", "failed")}
    return {"name": field.name, "project": field.project, "title": field.spec.title, "points": len(keys), **told}


def _choose(fields: list["StoredField"], name: str | None, store: Path) -> "StoredField":
    names = [field.name for field in fields]
    if not fields:
        raise InputError(f"{store}: holds no description of a field; run 'graindamp field' on it once")
    if name is None and len(fields) > 1:
        raise InputError(f"{store}: holds several fields; add --name, one of {', '.join(names)}")
    if name is not None and name not in names:
        raise InputError(f"--name: given '{name}'; the store holds {', '.join(names)}")
    return fields[0] if name is None else fields[names.index(name)]


def _document(run: "FieldRun", target: Path, store: "Store") -> dict[str, Any]:
    import numpy as np

    usable = np.isfinite(run.points["loss_factor"].to_numpy())
    return {
        "field": str(target),
        "store": str(store.folder),
        "places": int(usable.size),
        "usable": int(usable.sum()),
        "runs": run.n_point,
        "computed": run.n_computed,
        "particle_steps": float(run.points["particle_steps"].sum()),
        "failed": list(run.failures),
        "warnings": list(run.warnings),
    }


def _failures(failures: tuple[str, ...], store: Path) -> list[str]:
    if not failures:
        return []
    more = [f"and {len(failures) - SHOWN} more points failed"] if len(failures) > SHOWN else []
    lines = [f"failed: {line}" for line in failures[:SHOWN]]
    return [*lines, *more, f"'graindamp campaign retry {store}' queues them again; then give the same command"]


@contextmanager
def _stoppable(store: "Store") -> Iterator[None]:
    """Ctrl-C, or the end that a cluster announces, leaves a store that the same command goes on with."""
    is_main = threading.current_thread() is threading.main_thread()
    before = signal.signal(signal.SIGTERM, signal.default_int_handler) if is_main else None
    try:
        yield
    except KeyboardInterrupt:
        print(f"stopped; what was done is in {store.folder}. Give the same command to go on", file=sys.stderr)
        raise typer.Exit(INTERRUPTED) from None
    finally:
        if is_main:
            signal.signal(signal.SIGTERM, before)


@contextmanager
def _closing(crew: "Executor") -> Iterator["Executor"]:
    """An executor that is shut down at the end: at once if something went wrong."""
    try:
        yield crew
    except BaseException:
        crew.shutdown(now=True)
        raise
    crew.shutdown()
