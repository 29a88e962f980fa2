"""The command that shows a field."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from graindamp.cli.options import AsJson, print_json, read_option, warn
from graindamp.errors import InputError

if TYPE_CHECKING:
    import xarray as xr


def show(
    field: Annotated[Path, typer.Argument(help="Field file, .nc or .csv.")],
    bed_mass: Annotated[str | None, typer.Option(help="Mass of all particles [kg], where a CSV does not tell.")] = None,
    figure: Annotated[Path | None, typer.Option(help="Picture to write; default: <field>.png here.")] = None,
    level: Annotated[
        str | None, typer.Option(help="Loss factor that counts as good [-]: how robust the damper is.")
    ] = None,
    convert: Annotated[Path | None, typer.Option(help="Write the field again as .nc or .csv.")] = None,
    as_json: AsJson = False,
) -> None:
    """What a field holds: table, map, motion modes and losses as pictures, robustness."""
    from graindamp.field.remarks import remarks_on
    from graindamp.field.robustness import robustness
    from graindamp.field.store import read_field, write_field
    from graindamp.report.document import field_document, robustness_document

    if convert is not None and convert.resolve() == field.resolve():
        raise InputError(f"--convert: {convert} is the field itself; give another name")
    data = read_field(field, read_option("bed-mass", bed_mass, "kg"))
    good = read_option("level", level, "")
    found = None if good is None else robustness(data, good)
    if convert is not None:
        write_field(data, convert)
    written: dict[str, Path] = {}
    if figure is not None or not as_json:
        from graindamp.report import figures as draw
        from graindamp.report.field_pictures import write_pictures
        from graindamp.report.field_run import points_beside

        target = figure if figure is not None else Path(f"{field.stem}.png")
        written["picture"] = draw.save(draw.field_map(data), target)
        points = points_beside(field)
        known = read_field(points, data.attrs["bed_mass"]) if points.is_file() else None
        if known is not None and not _are_points_of(data, known):
            warn([f"{points}: not what {field.name} was made from; left aside"])
            known = None
        written |= {one.name: one.path for one in write_pictures(data, target.with_suffix(""), known)}
    if as_json:
        print_json(field_document(data) | ({} if found is None else {"robustness": robustness_document(found)}))
        return
    from graindamp.report.console import show as show_table
    from graindamp.report.study_tables import tables_of
    from graindamp.report.tables import field_table, robustness_table

    show_table(field_table(data))
    warn(remarks_on(data))
    for table in tables_of(data):
        show_table(table)
    if found is not None:
        show_table(robustness_table(found))
    for name, path in written.items():
        print(f"{name:<8} {path}")
    if convert is not None:
        print(f"written  {convert}")


def _are_points_of(field: "xr.Dataset", points: "xr.Dataset") -> bool:
    """Whether a field may be a prediction from these points: of the same damper, within the field's range."""
    from graindamp.field.schema import damper_of, places_of

    within = all(
        inner.min() >= outer.min() * (1 - 1e-9) and inner.max() <= outer.max() * (1 + 1e-9)
        for inner, outer in zip(places_of(points), places_of(field), strict=True)
    )
    return damper_of(field) == damper_of(points) and field.attrs.get("spec") == points.attrs.get("spec") and within
