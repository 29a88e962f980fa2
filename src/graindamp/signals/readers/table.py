"""A table of numbers in a text file: its delimiter, decimal mark, first line and columns."""

import csv
import math
import re
from collections import Counter
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from graindamp.errors import InputError


class Line(NamedTuple):
    """A line that is not blank."""

    number: int
    """From 1, as an editor counts."""
    text: str


class Style(NamedTuple):
    """How a file writes its table."""

    delimiter: str | None
    """None for any white space."""
    decimal: str
    n_column: int


_STYLES = ((";", "."), (";", ","), ("\t", "."), ("\t", ","), (",", "."), (",", ","), (None, "."), (None, ","))
COMMENT = ("#", "%")


def read_lines(path: Path) -> list[Line]:
    """Lines of a text file in UTF-8, UTF-16 or Windows-1252, without the blank ones.

    Raises:
        InputError: the file is no text.
    """
    data = path.read_bytes()
    if data.startswith((b"\xff\xfe", b"\xfe\xff")):
        text = data.decode("utf-16", "replace")
    elif b"\0" in data:
        raise InputError(f"{path}: holds binary data, not text; name it by its format or export it as text")
    else:
        try:
            text = data.decode("utf-8-sig")
        except UnicodeDecodeError:
            text = data.decode("cp1252", "replace")
    numbered = enumerate(re.split(r"\r\n|\n|\r", text), start=1)
    return [Line(number, line.strip(" ")) for number, line in numbered if line.strip()]


def find_style(lines: list[Line], path: Path, may_be_single: bool = False) -> Style:
    """Delimiter, decimal mark and number of columns under which most lines are rows of numbers.

    Args:
        lines: of the file.
        path: to open messages.
        may_be_single: whether one column will do where no delimiter makes more of them.

    Raises:
        InputError: no delimiter makes rows of as many numbers as needed.
    """
    best = _best_style(lines, 2) or (_best_style(lines, 1) if may_be_single else None)
    if best is None:
        needed = "numbers found" if may_be_single else "numbers with two or more columns found"
        signals = "the motion" if may_be_single else "force and motion each"
        raise InputError(
            f"{path}: no table of {needed}; expected rows such as '0.0001;0.0550;249.1' "
            f"(delimiter ; tab , or white space), {signals} in a column"
        )
    return best


def _best_style(lines: list[Line], least_columns: int) -> Style | None:
    sample = lines[:: len(lines) // 500 + 1] + lines[-1:]
    best, n_best = None, 0
    for delimiter, decimal in _STYLES:
        counts: Counter[int] = Counter()
        for line in sample:
            cells = split(line.text, delimiter)
            cells = cells[:-1] if cells[-1] == "" else cells
            if _is_numeric(cells, decimal):
                counts[len(cells)] += 1
        n_column, n_row = max(counts.items(), key=lambda item: item[1], default=(0, 0))
        if n_column >= least_columns and n_row > n_best:
            best, n_best = Style(delimiter, decimal, n_column), n_row
    return best


def first_row(lines: list[Line], style: Style) -> int:
    """Index of the first line of the table; a cell of text among its numbers does not make a row a header."""
    start = next(i for i, line in enumerate(lines) if _is_numeric(fitted(line, style) or [], style.decimal))
    while start > 0 and number((fitted(lines[start - 1], style) or [""])[0], style.decimal) is not None:
        start -= 1
    return start


def columns(rows: list[Line], style: Style, path: Path) -> list[list[str]]:
    """Cells of each column.

    Raises:
        InputError: a row with another number of columns.
    """
    table = []
    for line in rows:
        cells = fitted(line, style)
        if cells is None:
            raise InputError(
                f"{path}, line {line.number}: has {len(split(line.text, style.delimiter))} columns, the table has "
                f"{style.n_column}; given '{_short(line.text)}'; export the table whole, one record per file"
            )
        table.append(cells)
    return [list(column) for column in zip(*table, strict=True)]


def numbers(cells: list[list[str]], rows: list[Line], style: Style, path: Path) -> NDArray[np.float64]:
    """Values of the cells, NaN where they hold no number; shape (column, row).

    Raises:
        InputError: a row of nothing but text, such as the names of a second table.
    """
    values = np.array([_column_values(column, style.decimal) for column in cells])
    for i in np.flatnonzero(np.isnan(values).all(axis=0)):
        if all(column[i] and number(column[i], style.decimal) is None for column in cells):
            raise InputError(
                f"{path}, line {rows[i].number}: text in the middle of the table: '{_short(rows[i].text)}'; "
                "keep one table of numbers per file"
            )
    return values


def _column_values(cells: list[str], decimal: str) -> list[float]:
    if decimal == ",":
        cells = [cell.replace(",", ".") for cell in cells]
    try:
        return list(map(float, cells))
    except ValueError:
        found = (number(cell, ".") for cell in cells)
        return [math.nan if value is None else value for value in found]


def fitted(line: Line, style: Style) -> list[str] | None:
    """Cells of a line, less an empty one after a last delimiter; None where their number is not the table's."""
    cells = split(line.text, style.delimiter)
    if len(cells) == style.n_column + 1 and cells[-1] == "":
        cells = cells[:-1]
    return cells if len(cells) == style.n_column else None


def split(text: str, delimiter: str | None) -> list[str]:
    """Cells of a line, without blanks and quotes around them."""
    if delimiter is None:
        return text.split()
    if '"' in text and len(text) < csv.field_size_limit():
        return [cell.strip() for cell in next(csv.reader([text], delimiter=delimiter))]
    return [cell.strip() for cell in text.split(delimiter)]


def number(cell: str, decimal: str) -> float | None:
    """Number of a cell; None where it is none."""
    try:
        return float(cell if decimal == "." else cell.replace(",", "."))
    except ValueError:
        return None


def _is_numeric(cells: list[str], decimal: str) -> bool:
    """Whether a row holds numbers, perhaps with empty cells, and nothing else."""
    return any(cells) and all(number(cell, decimal) is not None for cell in cells if cell)


def _short(text: str) -> str:
    return text if len(text) <= 60 else text[:57] + "..."
