"""What a report leaves in its folder, and how its tables and its document are written."""

import csv
import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from graindamp.errors import InputError


class Files(NamedTuple):
    """Where the results were written."""

    page: Path
    document: Path
    tables: tuple[Path, ...]
    pictures: tuple[Path, ...]


def write_columns(columns: Mapping[str, Iterable[Any]], path: Path) -> Path:
    """Write columns of the same length as CSV under their titles; numbers to nine digits, NaN as an empty cell.

    Raises:
        InputError: the file cannot be written.
    """
    cells = [[_cell(value) for value in values] for values in columns.values()]
    try:
        with path.open("w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file)
            writer.writerow(columns)
            writer.writerows(zip(*cells, strict=True))
    except OSError as error:
        raise InputError(f"{path}: cannot be written ({error.strerror or error})") from None
    return path


def write_document(document: Mapping[str, Any], path: Path) -> Path:
    """Write a plain document as JSON.

    Raises:
        InputError: the file cannot be written.
    """
    try:
        path.write_text(json.dumps(document, indent=1) + "\n", encoding="utf-8")
    except OSError as error:
        raise InputError(f"{path}: cannot be written ({error.strerror or error})") from None
    return path


def _cell(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:.9g}" if np.isfinite(value) else ""
    return str(value)
