"""The command that simulates fields."""

import signal
import sys
import threading
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from graindamp.cli.options import AsJson, print_json, warn
from graindamp.cli.simulate import INTERRUPTED, tell_of_compiling
from graindamp.errors import InputError

if TYPE_CHECKING:
    from graindamp.campaign.descriptions import StoredField
    from graindamp.campaign.executors import Executor
    from graindamp.campaign.run import FieldRun
    from graindamp.campaign.store import Store
    from graindamp.spec.field import FieldSpec

ALONE = ("local", "serial")
"""Executors that compute in this process, whose GPU is then the one that counts."""


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
    workers: Annotated[
        int | None, typer.Option(min=1, help="Points at a time; default: the cores, or what fills the GPU.")
    ] = None,
    slurm: Annotated[list[str] | None, typer.Option(help="Option of SLURM jobs, as queue=short; repeatable.")] = None,
    batch: Annotated[int | None, typer.Option(min=1, help="Points that an adaptive plan chooses at a time.")] = None,
    backend: Annotated[
        str, typer.Option(help="What computes: auto (the GPU of this machine if there is one), cpu, cuda.")
    ] = "auto",
    precision: Annotated[
        str | None, typer.Option(help="Of the forces on a GPU: mixed (default) or double; the CPU has double.")
    ] = None,
    resume: Annotated[
        bool, typer.Option("--resume", help="Go on with a campaign; refuse if there is none or the file has changed.")
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Simulate all operating points of a damper: an effective field.

    Points that the store holds are never computed again: after a stop or crash give the same command.
    """
    from graindamp.campaign.backends import chosen, is_device
    from graindamp.campaign.executors import KINDS
    from graindamp.campaign.slurm import read_options
    from graindamp.campaign.store import Store
    from graindamp.spec.field import FieldSpec
    from graindamp.spec.model import load_spec

    specs = [load_spec(project, FieldSpec) for project in projects]
    outputs = _outputs(projects, output)
    kind = executor or ("dask" if scheduler else "local")
    if kind not in KINDS:
        raise InputError(f"--executor: given '{kind}'; allowed are {', '.join(KINDS)}")
    if scheduler and kind != "dask":
        raise InputError(f"--scheduler goes with --executor dask, not {kind}")
    options = read_options(slurm or [])
    if options and kind != "slurm":
        raise InputError(f"--slurm goes with --executor slurm, not {kind}")
    place = _store_place(projects, output, store)
    if not place.exists():  # a back end that is refused leaves no empty store behind
        chosen(backend, precision, None, alone=kind in ALONE)
        if resume:
            raise InputError(f"--resume: {place} holds no campaign of {projects[0]}; leave --resume out to begin one")
    for target in outputs:
        _check_folder(target)
    tell_of_compiling(as_json or backend == "cuda")
    with Store(place) as opened:
        fields = [
            _asked_for(opened, project, spec, batch, (backend, precision), kind)
            for project, spec in zip(projects, specs, strict=True)
        ]
        if resume:
            for one in fields:
                _check_resumable(opened, one)
        with _stoppable(opened), _crews(fields, kind, workers, scheduler, options) as crews:
            documents = [
                _run_one(opened, crews[is_device(one.backend)], one, target, as_json)
                for one, target in zip(fields, outputs, strict=True)
            ]
    if as_json:
        print_json(documents[0] if len(documents) == 1 else {"fields": documents})


def _asked_for(
    store: "Store", project: Path, spec: "FieldSpec", batch: int | None, backend: tuple[str, str | None], kind: str
) -> "StoredField":
    """The field with its back end, and with its batch, 0 where that depends on the executor. Of a campaign that was
    begun they are those that it was begun with, where nothing else is said."""
    from graindamp.campaign.backends import chosen, is_device
    from graindamp.campaign.descriptions import BATCH, known_field
    from graindamp.campaign.run import described

    field = described(spec, project)
    known = known_field(store, field)
    name = chosen(*backend, None if known is None else known.backend, alone=kind in ALONE)
    usual = BATCH
    if spec.plan.kind == "adaptive":
        begun = known is not None and known.backend == name and known.spec.plan.kind == "adaptive"
        usual = known.batch if known is not None and begun else 0 if is_device(name) else BATCH
    return field._replace(backend=name, batch=batch or usual)


def _run_one(store: "Store", crew: "Executor", field: "StoredField", target: Path, as_json: bool) -> dict[str, Any]:
    """Run one field, write it, and say so."""
    from graindamp.campaign.adaptive import batch_for
    from graindamp.campaign.run import run_field
    from graindamp.field.remarks import remarks_on
    from graindamp.report.console import show
    from graindamp.report.field_pictures import write_pictures
    from graindamp.report.field_progress import FieldProgress
    from graindamp.report.field_run import run_document, warnings_of, write_run
    from graindamp.report.study_tables import tables_of

    with FieldProgress(target, field.spec.title, quiet=as_json) as progress:
        run = run_field(
            field.spec,
            store,
            crew,
            project=Path(field.project),
            watch=progress,
            batch=field.batch or batch_for(field.spec, crew.n_worker),
            backend=field.backend,
        )
        points = write_run(run, target)
        tables = tables_of(run.points)
        known = None if points is None else run.points
        pictures = write_pictures(run.field, target.with_suffix(""), known)
        progress.conclude(remarks_on(run.points), tables, pictures)
    warn(warnings_of(run, store.folder))
    if not as_json:
        for table in tables:
            show(table)
        print(f"field    {target} ({run.n_point} runs, {run.n_computed} of them computed now, {_computed_by(run)})")
        if points is not None:
            print(f"points   {points}")
        print(f"map      {progress.picture}")
        for one in pictures:
            print(f"{one.name:<8} {one.path}")
        print(f"page     {progress.page}\nstore    {store.folder}")
    more = {"points": None if points is None else str(points), "map": str(progress.picture), "page": str(progress.page)}
    more |= {one.name: str(one.path) for one in pictures}
    return run_document(run, target, store) | more


def _outputs(projects: list[Path], output: Path | None) -> list[Path]:
    """A field file for each project."""
    from graindamp.field.store import SUFFIXES
    from graindamp.report.field_run import check_suffix

    if len(projects) == 1 and (output is None or output.suffix):
        target = output if output is not None else projects[0].with_suffix(".nc")
        check_suffix(target)
        return [target]
    if output is not None and output.suffix in SUFFIXES:
        raise InputError(f"--output: given '{output}', one file for {len(projects)} projects; give a folder")
    names = [project.stem for project in projects]
    if len(set(names)) < len(names):
        raise InputError("two projects have the same name, and so would their fields; rename one")
    folder = output if output is not None else Path("fields")
    return [folder / f"{name}.nc" for name in names]


def _check_folder(target: Path) -> None:
    """Make the folder of a field before it is computed; else an InputError."""
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"--output: {target} cannot be written ({error.strerror or error})") from None


def _computed_by(run: "FieldRun") -> str:
    """The back end of a field's points in words."""
    attrs = run.points.attrs
    return f"on the GPU in {attrs['precision']} precision" if attrs["backend"] == "cuda" else "on the CPU"


def _store_place(projects: list[Path], output: Path | None, store: Path | None) -> Path:
    if store is not None:
        return store
    if len(projects) == 1:
        return projects[0].parent / f"{projects[0].stem}-store"
    return (output if output is not None else Path("fields")) / "store"


def _check_resumable(store: "Store", field: "StoredField") -> None:
    from graindamp.campaign.descriptions import known_field

    known = known_field(store, field)
    if known is None:
        raise InputError(
            f"--resume: {store.folder} holds no campaign of {field.project}; leave --resume out to begin one"
        )
    if not known.is_same(field):
        raise InputError(
            f"--resume: {field.project}, --batch or the back end is not what the campaign in {store.folder} was begun "
            "with; undo the changes, or leave --resume out: points that are the same are used again"
        )


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
def _crews(
    fields: list["StoredField"], kind: str, workers: int | None, scheduler: str | None, options: dict[str, Any]
) -> Iterator[dict[bool, "Executor"]]:
    """An executor for the fields of processors, one for those of GPUs, as far as there are such fields."""
    from graindamp.campaign.backends import is_device
    from graindamp.campaign.executors import executor_of

    with ExitStack() as stack:
        crews: dict[bool, Executor] = {}
        for on_device in sorted({is_device(one.backend) for one in fields}):
            crew = executor_of(kind, n_worker=workers, address=scheduler, options=options, on_device=on_device)
            crews[on_device] = stack.enter_context(_closing(crew))
        yield crews


@contextmanager
def _closing(crew: "Executor") -> Iterator["Executor"]:
    """An executor that is shut down at the end: at once if something went wrong."""
    try:
        yield crew
    except BaseException:
        crew.shutdown(now=True)
        raise
    crew.shutdown()
