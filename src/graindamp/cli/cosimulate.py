"""`graindamp cosimulate`: a structure and the particles in its dampers together."""

from pathlib import Path
from typing import Annotated

import typer

from graindamp.cli.options import AsJson, print_json, warn
from graindamp.cli.simulate import INTERRUPTED, Cache, progress_bar, tell_of_compiling


def cosimulate(
    project: Annotated[Path, typer.Argument(help="Project file (.toml): [structure], [[dampers]], [release], [run].")],
    out: Annotated[
        Path | None, typer.Option(help="Folder to write; default: <project>-together beside the project.")
    ] = None,
    cache: Cache = None,
    as_json: AsJson = False,
) -> None:
    """Simulate a structure and the particles in its dampers together.

    Free decays, transients, sweeps: force and motion are exchanged every time step. Ctrl-C ends the run early and keeps
    what there is (exit code 130). With --json nothing is written unless --out says where.
    """
    from graindamp.couple.described import case_of, output_points
    from graindamp.report.cosimulation import (
        cosimulation_document,
        energy_table,
        examine,
        run_table,
        write_cosimulation,
    )
    from graindamp.spec.cosimulation import CosimulationSpec
    from graindamp.spec.model import load_spec
    from graindamp.status import Status

    spec = load_spec(project, CosimulationSpec)
    case = case_of(spec, project.parent)
    files = None
    with progress_bar(as_json) as progress:
        tell_of_compiling(as_json)
        from graindamp.couple.cosimulate import cosimulate as run_together

        run = run_together(case, folder=project.parent, cache=cache, progress=progress)
        result = examine(run, output_points(spec))
        if out is not None or not as_json:
            folder = out if out is not None else project.parent / f"{project.stem}-together"
            text = project.read_text(encoding="utf-8")
            files = write_cosimulation(result, folder, spec.title, text, lambda what: progress(what, 1.0, None))
    warn(result.warnings)
    if as_json:
        written = [] if files is None else [files.page, files.document, *files.tables, *files.pictures]
        print_json(cosimulation_document(result) | {"files": [str(path) for path in written]})
    else:
        from graindamp.report.console import show

        show(run_table(result))
        show(energy_table(result))
        if result.decay is not None:
            print(
                f"decay    {result.decay.frequency:.4g} Hz, mean damping ratio {100 * result.decay.damping_ratio:.3g} %"
            )
        assert files is not None
        print(f"report   {files.page}\nresult   {files.document}")
        for path in files.tables:
            print(f"table    {path}")
        for path in files.pictures:
            print(f"picture  {path}")
    if run.status & Status.INTERRUPTED:
        raise typer.Exit(INTERRUPTED)
