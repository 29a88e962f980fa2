"""Files of a prediction: figures, page, document, tables."""

import csv
import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib.figure import Figure

from graindamp.couple.predict import DRIVE, OUTPUT, Prediction
from graindamp.couple.response import respond
from graindamp.errors import InputError
from graindamp.field.measured import Measurement
from graindamp.report import figures
from graindamp.report.document import measurement_document, prediction_document
from graindamp.report.page import Section, write_page
from graindamp.report.study_tables import tables_of
from graindamp.report.tables import (
    Table,
    damping_table,
    points_table,
    resonance_table,
    study_table,
)

_HOW_TO_READ = (
    "A loss factor η of one means that the damper dissipates per radian as much as its whole bed would hold in kinetic "
    "energy; m′ is the share of the bed's mass that moves with the container. At resonance a mode with shape φ at the "
    "damper gets ζ = φ² m_bed η / (2 (1 + φ² m_bed m′)) on top of its own damping."
)


class Files(NamedTuple):
    """Where a prediction was written."""

    page: Path
    document: Path
    pictures: tuple[Path, ...]


def write_prediction(
    prediction: Prediction,
    folder: Path,
    inputs: str,
    measurement: Measurement | None = None,
    progress: Callable[[str], None] = lambda text: None,
    opening: Sequence[Section] = (),
    more: Mapping[str, Any] | None = None,
) -> Files:
    """Write report.html, result.json, damping.csv and one PNG per figure into `folder`.

    Args:
        prediction: the result.
        folder: made if it is not there.
        inputs: text of the project, shown in the page.
        measurement: where the field of the first damper comes from, if it was analysed along the way.
        progress: told what is being drawn.
        opening: sections that come before all others, their pictures written already.
        more: further entries of result.json.

    Raises:
        InputError: a file cannot be written.
    """
    sections: list[Section] = list(opening)
    pictures: list[Path] = [path for section in opening for path, _ in section.pictures]

    def picture(name: str, figure: Figure) -> Path:
        progress(f"drawing {name}")
        pictures.append(figures.save(figure, folder / f"{name}.png"))
        return pictures[-1]

    if measurement is not None:
        drawn = picture("cycles", figures.cycles(measurement.points))
        note = "Loss factor (blue) and effective mass ratio (orange) of each cycle after the transient."
        text = "From force and velocity to complex effective mass, cycle by cycle, phase corrected by the empty run."
        sections.append(Section("Signals", text, (points_table(measurement.points),), ((drawn, note),)))
    maps = []
    for d, (damper, field) in enumerate(zip(prediction.dampers, prediction.fields, strict=True)):
        marks = {
            f"{force:g} N": [
                (state.frequency, state.intensity[d], state.is_stable)
                for mode in solved
                for state in mode.result.equilibria
                if np.isfinite(state.intensity[d])
            ]
            for force, solved in zip(prediction.forces, prediction.modes, strict=True)
        }
        name = "field" if len(prediction.dampers) == 1 else f"field-{d + 1}"
        maps.append((picture(name, figures.field_map(field, marks, damper.name)), f"Effective field of {damper.name}."))
    alike: dict[tuple[str | None, ...], list[int]] = {}
    for d, field in enumerate(prediction.fields):
        studies = tuple(field.attrs.get(name) for name in ("softening_study", "bed_study"))
        alike.setdefault(studies, []).append(d)
    tables = tuple(
        table
        for which in alike.values()
        for table in tables_of(prediction.fields[which[0]], ", ".join(prediction.dampers[d].name for d in which))
    )
    sections.append(Section("Effective field", _HOW_TO_READ, tables, tuple(maps)))
    sections.append(_damping_section(prediction, picture))
    if prediction.responses:
        grid = prediction.responses[0][0].frequency
        bare = respond(prediction.model, (), DRIVE, OUTPUT, prediction.forces[0], grid)
        drawn = picture("response", figures.responses(prediction, bare))
        table = resonance_table(prediction)
        sections.append(Section("Response", "", (table,) if table else (), ((drawn, "Mobility at fixed force."),)))
    for study in prediction.studies:
        name = f"study-{study.name.split()[0]}"
        drawn = picture(name, figures.study(study))
        write_table(study_table(study), folder / f"{name}.csv")
        sections.append(Section(f"Study over {study.name}", "", (study_table(study),), ((drawn, "Every mode."),)))
    document = prediction_document(prediction) | dict(more or {})
    if measurement is not None:
        document["measurement"] = measurement_document(measurement)
    target = folder / "result.json"
    try:
        target.write_text(json.dumps(document, indent=1) + "\n", encoding="utf-8")
    except OSError as error:
        raise InputError(f"{target}: cannot be written ({error.strerror or error})") from None
    write_table(damping_table(prediction), folder / "damping.csv")
    page = write_page(folder / "report.html", prediction.title, sections, prediction.warnings, inputs)
    return Files(page, target, tuple(pictures))


def _damping_section(prediction: Prediction, picture: Callable[[str, Figure], Path]) -> Section:
    shapes: tuple[tuple[Path, str], ...] = ()
    if prediction.shapes is not None:
        shapes = ((picture("shapes", figures.mode_shapes(prediction)), "Mode shapes and where drive and dampers sit."),)
    drawn = (
        *shapes,
        (picture("damping", figures.damping_bars(prediction)), "Damping ratio of each mode under each force."),
        (picture("balance", figures.balances(prediction)), "Where the force held meets the force given."),
    )
    return Section("Damping", "", (damping_table(prediction),), drawn)


def write_table(table: Table, path: Path) -> None:
    """Write a table as CSV.

    Raises:
        InputError: the file cannot be written.
    """
    rows: Sequence[Sequence[str]] = [table.columns, *table.rows]
    try:
        with path.open("w", newline="", encoding="utf-8") as file:
            csv.writer(file).writerows(rows)
    except OSError as error:
        raise InputError(f"{path}: cannot be written ({error.strerror or error})") from None
