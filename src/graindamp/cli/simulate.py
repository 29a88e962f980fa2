"""Commands about particles: simulate an operating point, pack a bed, view what was computed."""

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, cast

import typer

from graindamp.cli.options import AsJson, print_json, warn
from graindamp.errors import InputError

if TYPE_CHECKING:
    from graindamp.dem.packing_store import Packing
    from graindamp.spec.simulation import SimulationSpec

Progress = Callable[[str, float, float | None], None]

INTERRUPTED = 130
"""Exit code of a run that was stopped by Ctrl-C, as shells have it."""

_LINE_EVERY = 30.0
"""Seconds between lines of progress where the error stream is no terminal."""

Project = Annotated[Path, typer.Argument(help="Project file (.toml): [damper], [motion], [run].")]
Film = Annotated[str | None, typer.Option(help="Film of the snapshots: gif, or mp4 (needs ffmpeg).")]
Cache = Annotated[Path | None, typer.Option(help="Folder where packings are kept; default: the user's cache.")]
Seed = Annotated[int | None, typer.Option(min=0, help="Another bed of the same description, in place of the file's.")]


def simulate(
    project: Project,
    out: Annotated[
        Path | None, typer.Option(help="Folder to write; default: <project>-run beside the project.")
    ] = None,
    uff: Annotated[bool, typer.Option("--uff", help="Signals as universal file (dataset 58) too.")] = False,
    animation: Film = None,
    vtk: Annotated[bool, typer.Option("--vtk", help="Snapshots and walls for ParaView and OVITO too.")] = False,
    cache: Cache = None,
    seed: Seed = None,
    as_json: AsJson = False,
) -> None:
    """Simulate the particles at one operating point: eta, m', energies.

    Ctrl-C ends the run early and keeps what there is (exit code 130).
    """
    from graindamp.report.motion_picture import check_film
    from graindamp.report.simulation import Wanted, claim, examine, simulation_document, write_simulation
    from graindamp.spec.model import load_spec
    from graindamp.spec.simulation import SimulationSpec
    from graindamp.status import Status

    spec = _with_seed(load_spec(project, SimulationSpec), seed)
    if animation is not None:
        check_film(animation)
    if (animation or vtk) and not spec.run.snapshots_per_cycle:
        raise InputError(
            f"{project}: {'--animation' if animation else '--vtk'} needs snapshots; write snapshots_per_cycle = 24 "
            "under [run]"
        )
    folder = out if out is not None else project.parent / f"{project.stem}-run"
    wanted = Wanted(uff, cast(Literal["gif", "mp4"] | None, animation), vtk)
    claim(folder, wanted)
    with progress_bar(as_json) as progress:
        tell_of_compiling(as_json)
        from graindamp.dem.simulate import simulate as run_one

        try:
            run = run_one(spec, folder=project.parent, cache=cache, progress=progress)
        except KeyboardInterrupt:
            print("stopped before the container moved; there is nothing to keep", file=sys.stderr)
            raise typer.Exit(INTERRUPTED) from None
        result = examine(run)
        text = project.read_text(encoding="utf-8")
        files = write_simulation(result, folder, text, wanted, lambda what: progress(what, 1.0, None))
    warn(result.warnings)
    warn(_unsettled(spec, run.packing))
    if as_json:
        listed = [files.page, files.document, files.run, files.signals, *files.others, *files.pictures]
        print_json(simulation_document(result) | {"files": [str(path) for path in listed]})
    else:
        _show(result, files)
    if result.status & Status.INTERRUPTED:
        raise typer.Exit(INTERRUPTED)


def pack(
    project: Project,
    out: Annotated[Path | None, typer.Option(help="File of the packing to write, .npz.")] = None,
    picture: Annotated[bool, typer.Option("--picture", help="Picture of the bed too, <project>-bed.png.")] = False,
    cache: Cache = None,
    seed: Seed = None,
    as_json: AsJson = False,
) -> None:
    """Pack the bed and set the lid: mass, height, solid fraction, clearance."""
    from graindamp.report.simulation import packing_document, packing_table
    from graindamp.spec.model import load_spec
    from graindamp.spec.simulation import SimulationSpec

    spec = _with_seed(load_spec(project, SimulationSpec), seed)
    if out is not None and out.suffix != ".npz":
        raise InputError(f"--out: given '{out}'; a packing is written as .npz")
    if out is not None and out.exists():
        _check_ours(out)
    with progress_bar(as_json) as progress:
        tell_of_compiling(as_json)
        from graindamp.dem.packing import pack as pack_bed

        packing = pack_bed(spec.damper, folder=project.parent, cache=cache, progress=progress)
    mass = _mass(spec, packing)
    warn(_unsettled(spec, packing))
    written: dict[str, str] = {}
    if out is not None:
        from graindamp.report.run_file import save_packing

        written["packing"] = str(save_packing(packing, spec, out))
    if picture:
        target = (out.parent if out is not None else project.parent) / f"{project.stem}-bed.png"
        written["picture"] = str(_draw_packing(spec, packing, project.parent, target))
    if as_json:
        print_json(packing_document(spec, packing, mass) | {"files": list(written.values())})
        return
    from graindamp.report.console import show

    show(packing_table(spec, packing, mass))
    for what, where in written.items():
        print(f"{what:<8} {where}")


def view(
    source: Annotated[Path, typer.Argument(help="A run (run.h5) or a packing (.npz).")],
    out: Annotated[Path | None, typer.Option(help="Folder for the pictures; default: beside the file.")] = None,
    animation: Film = None,
    vtk: Annotated[Path | None, typer.Option(help="Folder for files of ParaView and OVITO.")] = None,
    as_json: AsJson = False,
) -> None:
    """Pictures and films of a stored run or packing."""
    if source.suffix not in (".h5", ".hdf5", ".npz"):
        raise InputError(f"{source}: give a run (run.h5) or a packing (.npz)")
    folder = out if out is not None else source.parent
    if source.suffix == ".npz":
        written = _view_packing(source, folder, animation, vtk)
    else:
        with progress_bar(as_json) as progress:
            written = _view_run(source, folder, animation, vtk, progress)
    if as_json:
        print_json({"source": str(source), "files": [str(path) for path in written]})
        return
    for path in written:
        print(f"written  {path}")


def register(app: typer.Typer) -> None:
    """Add the commands to the command line."""
    for command in (simulate, pack, view):
        app.command()(command)


def _view_run(source: Path, folder: Path, animation: str | None, vtk: Path | None, progress: Progress) -> list[Path]:
    from graindamp.report.motion_picture import animate, check_film, scenes_of
    from graindamp.report.run_file import load_run
    from graindamp.report.simulation import draw_all, examine

    if animation is not None:
        check_film(animation)
    run = load_run(source)
    if animation is not None or vtk is not None:
        scenes_of(run)
    result = examine(run)
    warn(result.warnings)
    pictures, _ = draw_all(result, folder, lambda what: progress(what, 1.0, None))
    written = list(pictures)
    if animation is not None:
        kind = cast(Literal["gif", "mp4"], animation)
        film = folder / f"motion.{animation}"
        written.append(animate(run, film, kind, lambda done: progress(f"filming {film.name}", done, None)))
    if vtk is not None:
        from graindamp.report.vtk_files import write_vtk

        written.append(write_vtk(run, vtk))
    return written


def _view_packing(source: Path, folder: Path, animation: str | None, vtk: Path | None) -> list[Path]:
    from graindamp.report.run_file import load_packing

    if animation is not None:
        raise InputError(f"{source}: a packing does not move; films are made of a run with snapshots (run.h5)")
    stored = load_packing(source)
    written = [_draw_packing(stored.spec, stored.packing, source.parent, folder / f"{source.stem}.png")]
    if vtk is not None:
        from graindamp.report.vtk_files import write_packing_vtk

        enclosure = _enclosure(stored.spec, stored.packing, source.parent)
        written.append(write_packing_vtk(stored.spec, stored.packing, enclosure, vtk))
    return written


def _with_seed(spec: "SimulationSpec", seed: int | None) -> "SimulationSpec":
    """The description with another seed for its bed."""
    if seed is None:
        return spec
    packing = spec.damper.packing.model_copy(update={"seed": seed})
    damper = spec.damper.model_copy(update={"packing": packing})
    return spec.model_copy(update={"damper": damper})


def _check_ours(path: Path) -> None:
    """Refuse to overwrite what is not a packing of ours."""
    from graindamp.report.run_file import load_packing

    try:
        load_packing(path)
    except InputError:
        raise InputError(f"{path}: exists and is no packing of 'graindamp pack'; choose another --out") from None


def _enclosure(spec: "SimulationSpec", packing: Any, folder: Path) -> Any:
    from graindamp.dem.container import enclosure_of
    from graindamp.dem.interactions import interactions_of

    return enclosure_of(spec.damper, interactions_of(spec.damper), packing.lid_height, folder=folder)


def _mass(spec: "SimulationSpec", packing: Any) -> float:
    """Mass of all particles [kg]."""
    from math import pi

    densities = [component.density for component in spec.damper.particles]
    volumes = (4.0 / 3.0 * pi * radius**3 for radius in packing.radius)
    return float(sum(densities[int(c)] * volume for c, volume in zip(packing.component, volumes, strict=True)))


def _draw_packing(spec: "SimulationSpec", packing: Any, folder: Path, target: Path) -> Path:
    from graindamp.report.figures import save
    from graindamp.report.motion_picture import packing_figure

    direction = getattr(spec.motion, "direction", (1.0, 0.0, 0.0))
    return save(packing_figure(spec, packing, _enclosure(spec, packing, folder), direction), target)


def _show(result: Any, files: Any) -> None:
    from graindamp.report.console import show
    from graindamp.report.ledger import ledger_table
    from graindamp.report.simulation import engine_table, packing_table, result_table

    run = result.run
    if run.frequency is not None:
        show(result_table(result))
    else:
        print(f"{run.spec.motion.kind}: a motion without cycles has no eta and m'; its forces are in {files.signals}")
    if result.ledger is not None:
        show(ledger_table(result.ledger))
    show(packing_table(run.spec, run.packing, float(run.mass.sum())))
    show(engine_table(run))
    print(f"report   {files.page}\nresult   {files.document}\nrun      {files.run}\nsignals  {files.signals}")
    for path in files.others:
        print(f"written  {path}")
    for path in files.pictures:
        print(f"picture  {path}")


def _unsettled(spec: "SimulationSpec", packing: "Packing") -> list[str]:
    """What to say of a bed whose shaking ended although it still settled."""
    tap = spec.damper.packing.tap
    if tap is None or packing.tap_cycles < tap.max_cycles:
        return []
    return [
        f"the bed of {spec.damper.name} may still settle: shaking it ended after {tap.max_cycles} cycles, before "
        "packing.tap.tolerance was kept; raise packing.tap.max_cycles"
    ]


def tell_of_compiling(quiet: bool) -> None:
    """Say why nothing happens for a while, where no compiled engine is kept yet."""
    from graindamp.dem.compile import CACHED
    from graindamp.dem.contact import pair_forces
    from graindamp.dem.precompile import is_kept

    if not quiet and not (CACHED and is_kept(pair_forces)):
        print("compiling the engine (once, about half a minute)", file=sys.stderr)


@contextmanager
def progress_bar(quiet: bool) -> Iterator[Progress]:
    """Stage, part done and time left on the error stream: a bar on a terminal, else a line now and then."""
    if quiet:
        yield lambda stage, done, left: None
        return
    from graindamp.report.console import messages

    console = messages()
    if not console.is_terminal:
        yield _Lines()
        return
    from rich.progress import BarColumn, TaskProgressColumn, TextColumn
    from rich.progress import Progress as Bar

    columns = (TextColumn("{task.description}"), BarColumn(), TaskProgressColumn(), TextColumn("{task.fields[left]}"))
    with Bar(*columns, console=console, transient=True) as bar:
        task = bar.add_task("starting", total=1.0, left="")

        def show(stage: str, done: float, left: float | None) -> None:
            bar.update(task, description=stage, completed=done, left=_left(done, left))

        yield show


class _Lines:
    """Progress as lines of a log: each stage once, and how far it is every half minute."""

    def __init__(self) -> None:
        self.stage, self.told = "", time.monotonic()

    def __call__(self, stage: str, done: float, left: float | None) -> None:
        """Print a line if it is time for one."""
        now = time.monotonic()
        if stage == self.stage and now - self.told < _LINE_EVERY:
            return
        if stage != self.stage and stage.startswith(("drawing", "filming", "writing")):
            return
        tail = _left(done, left)
        print(f"{stage}: {100 * done:.0f} %{', ' + tail if tail else ''}", file=sys.stderr)
        self.stage, self.told = stage, now


def _left(done: float, seconds: float | None) -> str:
    """Time left in words; nothing in the first hundredth, where compiling would count for the rest."""
    if seconds is None or done < 0.01:
        return ""
    whole = round(seconds)
    hours, rest = divmod(whole, 3600)
    clock = f"{hours}:{rest // 60:02d}:{rest % 60:02d}" if hours else f"{rest // 60}:{rest % 60:02d}"
    return f"{clock} left"
