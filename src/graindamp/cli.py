"""The command line: signals to field, field and structure to damping, closed-form rules.

Exit code 0: done. 2: a mistake in what was typed or given, with one message. 1: anything else.
"""

import json
import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any

import typer

import graindamp
from graindamp.errors import InputError
from graindamp.units import STANDARD_GRAVITY, to_si

app = typer.Typer(
    name="graindamp",
    help="Predict and design particle dampers.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)
rules = typer.Typer(no_args_is_help=True, help="Closed-form rules: fields of idealised beds, and design formulas.")
app.add_typer(rules, name="rules")

AsJson = Annotated[bool, typer.Option("--json", help="Print one JSON document (SI units) and nothing else.")]


def main() -> None:
    """Run the command line and leave with its exit code."""
    # The matrices here are small: threads of the linear algebra would only wait for one another, at full load.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    try:
        app(standalone_mode=True)
    except InputError as error:
        _fail(f"error: {error}", 2)
    except KeyboardInterrupt:
        _fail("interrupted", 1)
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


def _print_json(document: Any) -> None:
    print(json.dumps(document, indent=1, allow_nan=False))


def _read(option: str, value: str | None, unit: str) -> float | None:
    """SI number of an option's text.

    Raises:
        InputError: naming the option.
    """
    if value is None:
        return None
    try:
        return to_si(value, unit)
    except ValueError as error:
        raise InputError(f"--{option}: given '{value}'; {error}") from None


def _need(option: str, value: str | None, unit: str) -> float:
    number = _read(option, value, unit)
    if number is None:
        raise InputError(f"--{option} is needed")
    return number


def _intensity(option: str, value: str | None) -> float | None:
    """Intensity [-], typed as a plain number or as an acceleration such as '40 g' or '392 m/s^2'."""
    if value is None:
        return None
    try:
        return to_si(value, "")
    except ValueError:
        number = _read(option, value, "m/s^2")
        return None if number is None else number / STANDARD_GRAVITY


@contextmanager
def _progress(quiet: bool) -> Iterator[Callable[[str], None]]:
    """Tells a person what is going on, on the error stream; nothing if that is not a terminal or `quiet`."""
    if quiet:
        yield lambda text: None
        return
    from graindamp.report.console import messages

    console = messages()
    if not console.is_terminal:
        yield lambda text: None
        return
    with console.status("starting") as status:
        yield lambda text: status.update(text)


def _warn(lines: list[str] | tuple[str, ...]) -> None:
    for line in lines:
        print(f"warning: {line}", file=sys.stderr)


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
    as_json: AsJson = False,
) -> None:
    """Run the main job on shipped data: signals, field, beam, damping, report."""
    from graindamp.report.demo import run_demo

    with _progress(as_json) as progress:
        files, prediction, document = run_demo(out, progress)
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
        "sampling_rate": sampling_rate,
    }
    data |= {key: value for key, value in given.items() if value is not None}
    if any(value is not None for value in channels.values()):
        data["channels"] = dict(data.get("channels", {})) | {k: v for k, v in channels.items() if v is not None}
    spec = parse_spec(data, MeasurementSpec, where)
    with _progress(as_json) as progress:
        result = measure(spec, folder, lambda done, total, label: progress(f"{done} of {total} records: {label}"))
    lines = [problem.text for problem in result.problems]
    lines += [f"{point.label}: {problem.text}" for point in result.points for problem in point.problems]
    if output is not None:
        write_field(result.field, output)
    if figures is not None:
        from graindamp.report import figures as draw

        draw.save(draw.field_map(result.field), figures / "field.png")
        draw.save(draw.cycles(result.points), figures / "cycles.png")
    _warn(lines)
    if as_json:
        _print_json(measurement_document(result) | {"written": str(output) if output else None})
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
    with _progress(as_json) as progress:
        prediction = solve(spec, project.parent, progress)
        files = None
        if out is not None or not as_json:
            folder = out if out is not None else Path(f"{project.stem}-report")
            files = write_prediction(prediction, folder, project.read_text(encoding="utf-8"), progress=progress)
    _finish(prediction, files, prediction_document(prediction), as_json)


def _finish(prediction: Any, files: Any, document: dict[str, Any], as_json: bool) -> None:
    """Warnings, then the result as JSON or as tables with the places of the files."""
    _warn(prediction.warnings)
    if as_json:
        _print_json(document)
        return
    from graindamp.report.console import show
    from graindamp.report.tables import damping_table

    show(damping_table(prediction))
    print(f"report   {files.page}\nresult   {files.document}")
    for picture in files.pictures:
        print(f"picture  {picture}")


@app.command()
def show(
    field: Annotated[Path, typer.Argument(help="Field file, .nc or .csv.")],
    bed_mass: Annotated[str | None, typer.Option(help="Mass of all particles [kg], where a CSV does not tell.")] = None,
    figure: Annotated[Path | None, typer.Option(help="Picture to write; default: <field>.png here.")] = None,
    convert: Annotated[Path | None, typer.Option(help="Write the field again as .nc or .csv.")] = None,
    as_json: AsJson = False,
) -> None:
    """What a field holds: table, and map as a picture."""
    from graindamp.field.store import read_field, write_field
    from graindamp.report.document import field_document

    data = read_field(field, _read("bed-mass", bed_mass, "kg"))
    if convert is not None:
        write_field(data, convert)
    if figure is not None or not as_json:
        from graindamp.report import figures as draw

        figure = figure if figure is not None else Path(f"{field.stem}.png")
        draw.save(draw.field_map(data), figure)
    if as_json:
        _print_json(field_document(data))
        return
    from graindamp.report.console import show as show_table
    from graindamp.report.tables import field_table

    show_table(field_table(data))
    print(f"picture  {figure}")
    if convert is not None:
        print(f"written  {convert}")


def _rule(document: dict[str, Any], units: dict[str, str], source: str, as_json: bool) -> None:
    """A rule's answer: JSON, or one line per value with its unit and the source."""
    from graindamp.report.wording import plain

    if as_json:
        from graindamp.report.document import plain as as_plain

        _print_json(as_plain(document | {"units": units, "source": source}))
        return
    for key, value in document.items():
        if value == "":
            continue
        text = plain(value, 5, units.get(key, "")) if isinstance(value, float) else str(value)
        print(f"{key.replace('_', ' '):24s} {text}")
    print(f"{'source':24s} {source}")


Text = str | None
_DIMENSIONLESS = dict.fromkeys(("loss_factor", "effective_mass_ratio"), "-")


@rules.command("bouncing")
def rules_bouncing(
    stroke_ratio: Annotated[Text, typer.Option(help="Stroke over its optimum, X / (h / pi) [-].")] = None,
    restitution: Annotated[str, typer.Option(help="Restitution of bed and wall [-], 0 to below 1.")] = "0",
    clearance: Annotated[Text, typer.Option(help="Free travel h [m]; with frequency and intensity.")] = None,
    frequency: Annotated[Text, typer.Option(help="Driving frequency [Hz].")] = None,
    intensity: Annotated[Text, typer.Option(help="Intensity [-], or an acceleration such as '20 g'.")] = None,
    as_json: AsJson = False,
) -> None:
    """Bed thrown from wall to wall (collect and collide), no gravity."""
    from math import pi

    from graindamp.field import theory

    e = _need("restitution", restitution, "")
    if stroke_ratio is not None:
        r = _need("stroke-ratio", stroke_ratio, "")
    elif clearance is not None and frequency is not None and intensity is not None:
        omega = 2 * pi * _need("frequency", frequency, "Hz")
        level = _intensity("intensity", intensity) or 0.0
        r = level * STANDARD_GRAVITY / omega**2 * pi / _need("clearance", clearance, "m")
    else:
        raise InputError("give --stroke-ratio, or --clearance with --frequency and --intensity")
    point = theory.collect_and_collide(r, e)
    low, high, stable = theory.stroke_ratio_min(e), theory.stroke_ratio_max(e), theory.stroke_ratio_stable_max(e)
    note = ""
    if r < low:
        note = f"does not exist: below X/X_opt = {low:.4g} the bed cannot keep up with two impacts per cycle"
    elif r > high:
        note = f"does not exist: above X/X_opt = {high:.4g} the wall just left catches the bed again"
    elif r > stable:
        note = f"exists, but is unstable above X/X_opt = {stable:.4g}; motions nearby give a similar loss factor"
    document = point._asdict() | {
        "stroke_ratio": r,
        "stroke_ratio_min": low,
        "stroke_ratio_best": theory.stroke_ratio_best(e),
        "stroke_ratio_max": high,
        "stroke_ratio_stable_max": stable,
        "note": note,
    }
    source = "exact for one body without gravity; optimum of Bannerman et al. (2011) and Sack et al. (2013)"
    _rule(document, _DIMENSIONLESS, source, as_json)


@rules.command("sliding")
def rules_sliding(
    intensity: Annotated[str, typer.Option(help="Intensity [-], or an acceleration such as '0.2 g'.")],
    friction: Annotated[str, typer.Option(help="Coefficient of friction of bed and floor [-].")],
    as_json: AsJson = False,
) -> None:
    """Bed that slides as one block on a shaken floor, walls out of reach."""
    from graindamp.field import theory

    point = theory.sliding_bed(_intensity("intensity", intensity) or 0.0, _need("friction", friction, ""))
    _rule(
        point._asdict(), dict.fromkeys(("loss_factor", "effective_mass_ratio"), "-"), "docs: theory, sliding", as_json
    )


@rules.command("bouncing-vertical")
def rules_bouncing_vertical(
    intensity: Annotated[str, typer.Option(help="Intensity [-], or an acceleration such as '1.5 g'.")],
    as_json: AsJson = False,
) -> None:
    """Plastic bed on a vertically shaken floor, no lid."""
    from graindamp.field import theory

    point = theory.bouncing_bed_vertical(_intensity("intensity", intensity) or 0.0)
    _rule(point._asdict(), _DIMENSIONLESS, "exact for one plastic body on a shaken floor under gravity", as_json)


@rules.command("coating")
def rules_coating(
    frequency: Annotated[Text, typer.Option(help="Design frequency [Hz]: gives the wall's modulus.")] = None,
    wall_modulus: Annotated[Text, typer.Option(help="Modulus of the coating [Pa]: gives its frequency.")] = None,
    n_line: Annotated[float | None, typer.Option(help="Particles in line along the motion [-].")] = None,
    bed_length: Annotated[Text, typer.Option(help="Length of the bed [m], in place of n-line.")] = None,
    radius: Annotated[str, typer.Option(help="Particle radius [m].")] = "1.25 mm",
    density: Annotated[str, typer.Option(help="Particle density [kg/m^3].")] = "7900 kg/m^3",
    youngs_modulus: Annotated[str, typer.Option(help="Particle Young's modulus [Pa].")] = "208 GPa",
    poisson: Annotated[float, typer.Option(help="Particle Poisson's ratio [-].")] = 0.3,
    wall_poisson: Annotated[float, typer.Option(help="Wall Poisson's ratio [-].")] = 0.5,
    as_json: AsJson = False,
) -> None:
    """Modulus of an elastic wall coating that makes the bed bounce in resonance at low intensity."""
    from math import pi

    from graindamp.design.rules import coating_frequency, coating_modulus

    r = _need("radius", radius, "m")
    if n_line is None:
        n_line = _need("n-line or --bed-length", bed_length, "m") / (2 * r)
    mass = 4 / 3 * pi * r**3 * _need("density", density, "kg/m^3")
    rest = (n_line, mass, r, _need("youngs-modulus", youngs_modulus, "Pa"), poisson, wall_poisson)
    if (frequency is None) == (wall_modulus is None):
        raise InputError("give either --frequency or --wall-modulus")
    if frequency is not None:
        rule = coating_modulus(_need("frequency", frequency, "Hz"), *rest)
    else:
        rule = coating_frequency(_need("wall-modulus", wall_modulus, "Pa"), *rest)
    units = {"wall_modulus": "Pa", "effective_modulus": "Pa", "frequency": "Hz"}
    document = rule._asdict() | {"n_line": n_line, "particle_mass": mass}
    _rule(document, units | {"particle_mass": "kg"}, "Meyer & Seifried (2023), Eqs 14, 20", as_json)


@rules.command("clearance")
def rules_clearance(
    frequency: Annotated[Text, typer.Option(help="Frequency [Hz]: gives the clearance.")] = None,
    clearance: Annotated[Text, typer.Option(help="Clearance [m]: gives the frequency.")] = None,
    intensity: Annotated[str, typer.Option(help="Intensity to be best at [-], or an acceleration.")] = "15",
    as_json: AsJson = False,
) -> None:
    """Clearance that is best at a frequency and intensity, or the frequency for a clearance."""
    from graindamp.design.rules import clearance_for, frequency_for

    level = _intensity("intensity", intensity) or 0.0
    if (frequency is None) == (clearance is None):
        raise InputError("give either --frequency or --clearance")
    if frequency is not None:
        rule = clearance_for(_need("frequency", frequency, "Hz"), level)
    else:
        rule = frequency_for(_need("clearance", clearance, "m"), level)
    units = {"clearance": "m", "stroke": "m", "frequency": "Hz", "intensity": "-"}
    _rule(rule._asdict(), units, "Meyer & Seifried (2023), Eqs 11, 21", as_json)


@rules.command("efficiency")
def rules_efficiency(
    bed_mass: Annotated[str, typer.Option(help="Mass of all particles [kg].")],
    shape_squared: Annotated[Text, typer.Option(help="Squared mass-normalised shape at the damper [1/kg].")] = None,
    modal_mass: Annotated[Text, typer.Option(help="Modal mass at the damper [kg], in place of shape-squared.")] = None,
    loss_factor: Annotated[float, typer.Option(help="Loss factor eta [-].")] = 1.0,
    effective_mass_ratio: Annotated[float, typer.Option(help="Effective mass ratio m' [-].")] = 1.0,
    as_json: AsJson = False,
) -> None:
    """Damping ratio that a bed of given loss factor gives to a mode; defaults: the efficiency bound."""
    from graindamp.design.rules import efficiency_damping_ratio

    if (shape_squared is None) == (modal_mass is None):
        raise InputError("give either --shape-squared or --modal-mass")
    if shape_squared is not None:
        squared = _need("shape-squared", shape_squared, "1/kg")
    else:
        mass = _need("modal-mass", modal_mass, "kg")
        if mass <= 0:
            raise InputError(f"--modal-mass: given '{modal_mass}'; a mass above 0 is needed")
        squared = 1 / mass
    rule = efficiency_damping_ratio(squared, _need("bed-mass", bed_mass, "kg"), loss_factor, effective_mass_ratio)
    units = dict.fromkeys(("damping_ratio", "specific_damping", "mass_ratio"), "-")
    _rule(rule._asdict(), units, "Meyer & Seifried (2021), Eq. 18", as_json)


if __name__ == "__main__":
    main()
