"""The command line: particles to signals, signals to field, field and structure to damping, closed-form rules.

Exit code 0: done. 2: a mistake in what was typed or given, with one message. 130: stopped by Ctrl-C. 1: anything else.
"""

import os
import sys
from pathlib import Path
from typing import Annotated, Any

import typer

import graindamp
from graindamp.cli.campaign import campaign
from graindamp.cli.cosimulate import cosimulate
from graindamp.cli.decay import decay
from graindamp.cli.field import field
from graindamp.cli.impact import register_impact
from graindamp.cli.options import AsJson, print_json, progress_of, warn
from graindamp.cli.rules import rules
from graindamp.cli.show import show
from graindamp.cli.simulate import register
from graindamp.errors import InputError

app = typer.Typer(
    name="graindamp",
    help="Predict and design particle dampers.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,  # it would take "[kg]" in a help text for markup
    context_settings={"help_option_names": ["-h", "--help"]},
)
app.add_typer(rules, name="rules")
register_impact(rules)


def main() -> None:
    """Run the command line and leave with its exit code."""
    # The matrices here are small: threads of the linear algebra would only wait for one another, at full load.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    try:
        app(standalone_mode=True)
    except InputError as error:
        _fail(f"error: {error}", 2)
    except KeyboardInterrupt:
        _fail("interrupted", 130)
    except BrokenPipeError:
        os._exit(0)  # the reader of our output has left; there is no one to tell
    except Exception as error:
        if os.environ.get("GRAINDAMP_DEBUG"):
            raise
        _fail(
            f"internal error: {type(error).__name__}: {error}\nThis is a defect of graindamp. Set GRAINDAMP_DEBUG=1 to "
            "see where, and report it with the command and its input.",
            1,
        )


def _fail(text: str, code: int) -> None:
    print(text, file=sys.stderr)
    sys.exit(code)


def _version(value: bool) -> None:
    if value:
        print(f"graindamp {graindamp.__version__}")
        raise typer.Exit


@app.callback()
def _top(
    version: Annotated[bool, typer.Option("--version", callback=_version, is_eager=True, help="Show version.")] = False,
) -> None:
    """Predict and design particle dampers."""


@app.command()
def demo(
    out: Annotated[Path, typer.Option(help="Folder for report and figures.")] = Path("graindamp-demo"),
    measured: Annotated[
        bool, typer.Option("--measured", help="Analyse the shipped signals of a shaken damper; simulate nothing.")
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Run the main job: simulate a damper, couple it to a beam, report the damping."""
    from graindamp.report.demo import run_demo, run_measured_demo

    with progress_of(as_json) as progress:
        files, prediction, document = (run_measured_demo if measured else run_demo)(out, progress)
    _finish(prediction, files, document, as_json)


@app.command()
def analyze(
    inputs: Annotated[
        list[Path],
        typer.Argument(help="Signal files (.csv .txt .h5 .hdf5 .mat .uff .unv), or one description (.toml)."),
    ],
    output: Annotated[Path | None, typer.Option("-o", "--output", help="Field file to write, .nc or .csv.")] = None,
    bed_mass: Annotated[str | None, typer.Option(help="Mass of all particles [kg].")] = None,
    container_mass: Annotated[str | None, typer.Option(help="Mass of the empty container [kg].")] = None,
    empty: Annotated[list[str] | None, typer.Option(help="Signal file of the empty container; repeatable.")] = None,
    frequency: Annotated[str | None, typer.Option(help="Driving frequency of all files [Hz].")] = None,
    skip_cycles: Annotated[int | None, typer.Option(min=0, help="Cycles to drop; default: detect.")] = None,
    clearance: Annotated[str | None, typer.Option(help="Free travel of the bed [m], for stroke lines.")] = None,
    name: Annotated[str | None, typer.Option(help="Name of the damper.")] = None,
    force_channel: Annotated[str | None, typer.Option(help="Name of the force channel.")] = None,
    motion_channel: Annotated[str | None, typer.Option(help="Name of the motion channel.")] = None,
    motion_kind: Annotated[str | None, typer.Option(help="velocity, acceleration or displacement.")] = None,
    force_unit: Annotated[str | None, typer.Option(help="Unit of the force channel.")] = None,
    motion_unit: Annotated[str | None, typer.Option(help="Unit of the motion channel.")] = None,
    force_sign: Annotated[
        int | None, typer.Option(help="-1 where the sensor's positive force points against the motion.")
    ] = None,
    sampling_rate: Annotated[str | None, typer.Option(help="Samples per second [Hz].")] = None,
    figures: Annotated[Path | None, typer.Option(help="Folder for field.png and cycles.png.")] = None,
    as_json: AsJson = False,
) -> None:
    """Force and motion signals to an effective field."""
    from graindamp.field.measured import measure
    from graindamp.field.store import SUFFIXES, write_field
    from graindamp.report.document import measurement_document
    from graindamp.report.tables import points_table
    from graindamp.spec.measurement import MeasurementSpec
    from graindamp.spec.model import parse_spec, read_toml

    if output is not None and output.suffix not in SUFFIXES:
        raise InputError(f"--output: given '{output}'; a field file ends in {' or '.join(SUFFIXES)}")
    descriptions = [path for path in inputs if path.suffix == ".toml"]
    if descriptions and len(inputs) > 1:
        raise InputError("give one description (.toml) alone, or signal files; a description names its own files")
    where, folder = "command line", Path()
    data: dict[str, Any] = {"files": [str(path) for path in inputs]}
    if descriptions:
        where, folder = str(inputs[0]), inputs[0].parent
        data = read_toml(inputs[0])
    given = {
        "bed_mass": bed_mass,
        "container_mass": container_mass,
        "empty_files": [str(Path(path).resolve()) for path in empty] if empty else None,
        "frequency": frequency,
        "skip_cycles": skip_cycles,
        "clearance": clearance,
        "name": name,
    }
    channels = {
        "force": force_channel,
        "motion": motion_channel,
        "motion_kind": motion_kind,
        "force_unit": force_unit,
        "motion_unit": motion_unit,
        "force_sign": force_sign,
        "sampling_rate": sampling_rate,
    }
    data |= {key: value for key, value in given.items() if value is not None}
    if any(value is not None for value in channels.values()):
        data["channels"] = dict(data.get("channels", {})) | {k: v for k, v in channels.items() if v is not None}
    spec = parse_spec(data, MeasurementSpec, where)
    with progress_of(as_json) as progress:
        result = measure(spec, folder, lambda done, total, label: progress(f"{done} of {total} records: {label}"))
    lines = [problem.text for problem in result.problems]
    lines += [f"{point.label}: {problem.text}" for point in result.points for problem in point.problems]
    if output is not None:
        write_field(result.field, output)
    if figures is not None:
        from graindamp.report import figures as draw

        draw.save(draw.field_map(result.field), figures / "field.png")
        draw.save(draw.cycles(result.points), figures / "cycles.png")
    warn(lines)
    if as_json:
        print_json(measurement_document(result) | {"written": str(output) if output else None})
        return
    from graindamp.report.console import show

    show(points_table(result.points))
    if output is None:
        print("not written; add -o field.nc to keep the field")
    else:
        print(f"field written to {output}")
    if figures is not None:
        print(f"figures in {figures}")


@app.command()
def predict(
    project: Annotated[Path, typer.Argument(help="Project file (.toml): structure, dampers, drive.")],
    out: Annotated[Path | None, typer.Option(help="Folder for report and figures; default: <project>-report.")] = None,
    as_json: AsJson = False,
) -> None:
    """Fields and structure to damping ratios, frequencies and responses."""
    from graindamp.couple.predict import predict as solve
    from graindamp.report.document import prediction_document
    from graindamp.report.prediction import write_prediction
    from graindamp.spec.model import load_spec
    from graindamp.spec.project import ProjectSpec

    spec = load_spec(project, ProjectSpec)
    with progress_of(as_json) as progress:
        prediction = solve(spec, project.parent, progress)
        files = None
        if out is not None or not as_json:
            folder = out if out is not None else Path(f"{project.stem}-report")
            files = write_prediction(prediction, folder, project.read_text(encoding="utf-8"), progress=progress)
    _finish(prediction, files, prediction_document(prediction), as_json)


def _finish(prediction: Any, files: Any, document: dict[str, Any], as_json: bool) -> None:
    """Warnings, then the result as JSON or as tables with the places of the files."""
    warn(prediction.warnings)
    if as_json:
        print_json(document)
        return
    from graindamp.report.console import show
    from graindamp.report.tables import damping_table

    show(damping_table(prediction))
    print(f"report   {files.page}\nresult   {files.document}")
    for picture in files.pictures:
        print(f"picture  {picture}")


app.command()(show)
register(app)
app.command()(field)
app.add_typer(campaign)
app.command()(cosimulate)
app.command()(decay)

if __name__ == "__main__":
    main()
