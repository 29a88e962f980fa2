"""`graindamp decay`: measured or simulated free decays to damping and frequency over amplitude."""

from pathlib import Path
from typing import Annotated, Any

import typer

from graindamp.cli.options import AsJson, print_json, progress_of, warn
from graindamp.errors import InputError


def decay(
    inputs: Annotated[
        list[Path],
        typer.Argument(help="Signal files (.csv .txt .h5 .hdf5 .mat .uff .unv) of one test, or a description (.toml)."),
    ],
    quantity: Annotated[str | None, typer.Option(help="velocity, displacement or acceleration.")] = None,
    channel: Annotated[str | None, typer.Option(help="Name of the motion channel.")] = None,
    unit: Annotated[str | None, typer.Option(help="Unit of the motion channel.")] = None,
    rate: Annotated[str | None, typer.Option(help="Samples per second [Hz], for files without time.")] = None,
    clearance: Annotated[str | None, typer.Option(help="Free travel d of the particles [m], for U/d.")] = None,
    particle_mass: Annotated[str | None, typer.Option(help="Mass of all particles [kg], for Psi_m.")] = None,
    structure_mass: Annotated[str | None, typer.Option(help="Mass of the structure at the point [kg].")] = None,
    intrinsic: Annotated[str | None, typer.Option(help="Psi without particles [-], such as '0.3 %'.")] = None,
    peaks: Annotated[str | None, typer.Option(help="polynomial (default), parabola or samples.")] = None,
    moving_average: Annotated[int | None, typer.Option(help="Values of Psi averaged, odd; default 3.")] = None,
    baseline: Annotated[str | None, typer.Option(help="Offset removed: linear (default), constant, none.")] = None,
    noise_factor: Annotated[float | None, typer.Option(help="End, in standard errors of a peak; default 10.")] = None,
    filter_cycles: Annotated[int | None, typer.Option(help="Length of a band-pass in cycles; default none.")] = None,
    frequency: Annotated[str | None, typer.Option(help="Frequency of the oscillation [Hz], near enough.")] = None,
    start: Annotated[str | None, typer.Option(help="Time after which the decay begins [s].")] = None,
    end: Annotated[str | None, typer.Option(help="Time at which it ends at the latest [s].")] = None,
    bins: Annotated[int | None, typer.Option(help="Bins per factor of ten of amplitude; default 20.")] = None,
    name: Annotated[str | None, typer.Option(help="Name of the test.")] = None,
    out: Annotated[
        Path | None, typer.Option(help="Folder for report and figures; default: <first file>-decay.")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Free decays of a structure to damping and frequency over amplitude.

    Several files are repeats of one test. With --json nothing is written unless --out says where.
    """
    from graindamp.report.decay import curve_table, decay_document, examine, records_table, write_decays
    from graindamp.spec.decay import DecaySpec
    from graindamp.spec.model import parse_spec

    method = {
        "peaks": peaks,
        "moving_average": moving_average,
        "baseline": baseline,
        "noise_factor": noise_factor,
        "filter_cycles": filter_cycles,
        "frequency": frequency,
        "start": start,
        "end": end,
    }
    channels = {"motion": channel, "motion_kind": quantity, "motion_unit": unit, "sampling_rate": rate}
    given = {
        "name": name,
        "clearance": clearance,
        "particle_mass": particle_mass,
        "structure_mass": structure_mass,
        "intrinsic": intrinsic,
        "bins": bins,
    }
    data, where, folder = _described(inputs)
    data |= {key: value for key, value in given.items() if value is not None}
    for table, values in (("method", method), ("channels", channels)):
        told = {key: value for key, value in values.items() if value is not None}
        if told:
            data[table] = dict(data.get(table, {})) | told
    spec = parse_spec(data, DecaySpec, where)
    with progress_of(as_json) as progress:
        result = examine(spec, folder, progress)
        files = None
        if out is not None or not as_json:
            target = out if out is not None else Path(f"{inputs[0].stem}-decay")
            files = write_decays(result, target, _told(spec), progress)
    warn(result.warnings)
    if as_json:
        written = [] if files is None else [files.page, files.document, *files.tables, *files.pictures]
        print_json(decay_document(result) | {"files": [str(path) for path in written]})
        return
    from graindamp.report.console import show

    show(records_table(result))
    show(curve_table(result))
    assert files is not None
    print(f"report   {files.page}\nresult   {files.document}")
    for path in files.tables:
        print(f"table    {path}")
    for path in files.pictures:
        print(f"picture  {path}")


def _described(inputs: list[Path]) -> tuple[dict[str, Any], str, Path]:
    """Tables of a description, or of files named one by one; what opens messages; the folder paths start from."""
    from graindamp.spec.model import read_toml

    if not any(path.suffix == ".toml" for path in inputs):
        data: dict[str, Any] = {"files": [str(path) for path in inputs]}
        if len(inputs) == 1:
            data["name"] = inputs[0].stem
        return data, "command line", Path()
    if len(inputs) > 1:
        raise InputError("give one description (.toml) alone, or signal files; a description names its own files")
    return read_toml(inputs[0]), str(inputs[0]), inputs[0].parent


def _told(spec: Any) -> str:
    """The description as it was understood, for the page."""
    lines = []
    for key, value in spec.model_dump(exclude_none=True).items():
        pairs = value.items() if isinstance(value, dict) else [("", value)]
        lines += [f"{key}{'.' if inner else ''}{inner} = {content}" for inner, content in pairs]
    return "\n".join(lines)
