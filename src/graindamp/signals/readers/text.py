"""Text tables (.csv, .txt), with or without a header block, names and units."""

import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from graindamp.signals.readers.channels import Channel, named_channel
from graindamp.signals.readers.clock import printed_resolution
from graindamp.signals.readers.facts import Facts, fact_named, read_fact
from graindamp.signals.readers.kinds import is_unit, kind_of_name, kind_of_unit, split_unit
from graindamp.signals.readers.runs import Run, records_of
from graindamp.signals.readers.table import (
    COMMENT,
    Line,
    Style,
    columns,
    find_style,
    first_row,
    fitted,
    number,
    numbers,
    read_lines,
    split,
)
from graindamp.signals.record import Record
from graindamp.spec.measurement import ChannelsSpec


def read_text(path: Path, spec: ChannelsSpec) -> list[Record]:
    """The one record of a text table.

    Delimiter (; tab , white space), decimal mark and encoding are recognised. Above the table may stand rows of key
    and value ("Sampling rate [Hz];39215,686"), the names of the columns and their units. Lines that begin with # or %
    may hold any of these, or are comments. Cells without a number become NaN, which the analysis reports.

    Raises:
        InputError: no table, a row with another number of columns, or channels, units or sampling rate missing,
            contradictory or ambiguous.
    """
    lines = read_lines(path)
    style = find_style(lines, path, may_be_single=not spec.with_force)
    start = first_row(lines, style)
    rows = [line for line in lines[start:] if not line.text.startswith(COMMENT)]
    header = [line._replace(text=line.text.lstrip("#% ")) for line in lines[:start]]
    cells = columns(rows, style, path)
    names, units, n_title = _titles(header, style)
    run = Run(
        channels=tuple(
            _channel(*column) for column in zip(names, units, cells, numbers(cells, rows, style, path), strict=True)
        ),
        facts=_facts(header[: len(header) - n_title], style, path),
        label=path.stem,
        source=path.name,
        place=str(path),
        rate_hint="add a header row 'Sampling rate [Hz];51200' or a column 'Time [s]'",
        where=lambda i: f"line {rows[i].number}",
    )
    return records_of([run], spec, path)


def _channel(name: str, unit: str | None, cells: list[str], values: NDArray[np.float64]) -> Channel:
    channel = named_channel(name, values, unit)
    if channel.kind != "time" or not np.isfinite(values).all():
        return channel
    return channel._replace(resolution=printed_resolution(cells, values))


def _titles(header: list[Line], style: Style) -> tuple[list[str], list[str | None], int]:
    """Name and unit of every column, and how many lines at the end of the header give them."""
    unnamed = [f"column {i + 1}" for i in range(style.n_column)]
    unitless: list[str | None] = [None] * style.n_column
    last, above = _title_cells(header[-1:], style), _title_cells(header[-2:-1], style)
    if last is None:
        return unnamed, unitless, 0
    # "t;F;v" are names although t, F and v are units too; under a row of names they would be units.
    told = [kind_of_name(split_unit(cell)[0]) for cell in last]
    is_below_names = above is not None and any(kind_of_name(split_unit(cell)[0])[0] for cell in above)
    may_be_units = not any(is_word for _, is_word in told) and (is_below_names or not any(kind for kind, _ in told))
    if may_be_units and any(kind_of_unit(cell) for cell in last):
        names = [name or other for name, other in zip(above or unnamed, unnamed, strict=True)]
        return names, list(last), 2 if above else 1
    return [name or other for name, other in zip(last, unnamed, strict=True)], unitless, 1


def _title_cells(lines: list[Line], style: Style) -> list[str] | None:
    """Cells of a row of names or units; None if it is no such row."""
    for line in lines:
        splits = [fitted(line, style) or []]
        if style.delimiter is None:  # names may hold blanks: "Force [N]", or columns set apart by several
            splits += [re.findall(r"[^\s\[(]+(?:\s*[\[(][^\])]*[\])])?", line.text), re.split(r"\s{2,}", line.text)]
        for cells in splits:
            if len(cells) != style.n_column or any(number(cell, ",") is not None for cell in cells):
                continue
            if style.n_column > 2 or not fact_named(cells[0]) or kind_of_name(cells[1])[0]:  # else a key and its value
                return cells
    return None


def _facts(header: list[Line], style: Style, path: Path) -> Facts:
    """Facts in the rows of key and value: "Drive frequency [Hz];100", "fs = 51200 Hz", "Bed mass: 132 g"."""
    facts: Facts = {}
    for line in header:
        splits = [split(line.text, style.delimiter)] if style.delimiter else []
        splits += [re.split(pattern, line.text, maxsplit=1) for pattern in (r"\s*[:=;\t]\s*", r"\s{2,}", r"\s(?=\S+$)")]
        for cells in splits:
            key, *values = (cell.strip(' ":=') for cell in cells)
            if values and fact_named(key):
                unit = values[1] if len(values) > 1 and is_unit(values[1]) else None  # else a remark
                facts |= read_fact(key, values[0], f"{path}, line {line.number}", unit, style.decimal)
                break
    return facts
