"""Fields on disk: netCDF for machines, CSV for people, checked both ways."""

import csv
import re
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from graindamp.errors import InputError
from graindamp.field.beds import bed_study_of
from graindamp.field.schema import TABLE, check, damper_of, make_field, places_of
from graindamp.field.softening import softening_of, study_of
from graindamp.signals.motion_modes import MotionMode
from graindamp.status import Status
from graindamp.units import STANDARD_GRAVITY, to_si

SUFFIXES = (".nc", ".csv")

_KEPT = ("graindamp_version", "seeds", "softening", "softening_study", "bed_study", "backend", "precision")
"""Attributes of a simulated field that a CSV keeps in its head."""

_TEXTS = ("name", "description")
"""What is told of a damper in words, even if they look like numbers."""

BLANK = {"motion_mode": int(MotionMode.UNKNOWN)}
"""What an empty cell of a column of whole numbers means, where that is not 0."""

_ALIASES: dict[str, tuple[str, ...]] = {
    "frequency": ("frequency", "f", "freq"),
    "intensity": ("intensity", "gamma", "g", "acceleration", "acc", "amplitude"),
    "loss_factor": ("lossfactor", "eta", "loss", "reducedlossfactor", "effectivelossfactor"),
    "effective_mass_ratio": ("effectivemassratio", "m", "mprime", "massratio", "meffmbed", "effectivemass"),
    "loss_factor_se": ("lossfactorse", "etase", "seeta", "lossfactorstandarderror", "etastandarderror"),
    "effective_mass_ratio_se": ("effectivemassratiose", "mse", "sem", "massratiose", "mprimese"),
    "dissipated_energy": ("dissipatedenergy", "energy"),
    "power": ("power",),
    "n_cycles": ("ncycles", "ncycle", "cycles"),
    "status": ("status",),
    "measured_intensity": ("measuredintensity",),
    "effective_mass_modulus_ratio": ("effectivemassmodulusratio",),
}
_ALIASES |= {name: (name.replace("_", ""),) for name in TABLE if name not in _ALIASES}

_ACCELERATIONS = ("acceleration", "acc", "amplitude")
"""Names of an intensity that need a unit."""


def write_field(field: xr.Dataset, path: str | Path) -> None:
    """Write a valid field to .nc or .csv, as the name says.

    Raises:
        InputError: not a valid field, unknown suffix, or the file cannot be written.
    """
    path = Path(path)
    check(field, where=str(path))
    _check_suffix(path)
    try:
        if path.suffix == ".nc":
            field.to_netcdf(path, engine="h5netcdf")
        else:
            path.write_text(_to_csv(field), encoding="utf-8")
    except OSError as error:
        raise InputError(f"{path}: cannot be written ({error.strerror or error})") from None


def read_field(path: str | Path, bed_mass: float | None = None) -> xr.Dataset:
    """Field from .nc or .csv, checked.

    A CSV typed by hand needs the columns frequency [Hz], intensity (or acceleration [m/s^2]), eta and m'; header lines
    "# bed_mass = 350 g" give what is not a column. Points that fill a grid become one, others stay scattered.

    Args:
        path: file to read.
        bed_mass: mass of all particles [kg], where the file does not tell.

    Raises:
        InputError: naming file, line or variable, and what is allowed.
    """
    path = Path(path)
    _check_suffix(path)
    if not path.is_file():
        raise InputError(f"{path}: there is no such file; a field is a {' or '.join(SUFFIXES)} file")
    if path.suffix == ".csv":
        return _studies_checked(_from_csv(path, bed_mass), path)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", UserWarning)  # of other kinds of HDF5 files, which are refused below
            with xr.open_dataset(path, engine="h5netcdf") as opened:
                field: xr.Dataset = opened.load()
    except (OSError, ValueError, KeyError) as error:
        raise InputError(f"{path}: not a readable netCDF-4 file ({error})") from None
    check(field, where=str(path))
    field.attrs["bed_mass"] = float(field.attrs["bed_mass"])
    return _studies_checked(field, path)


def _studies_checked(field: xr.Dataset, path: Path) -> xr.Dataset:
    """The same; what it tells of its softening and beds can be read, or an InputError names the file."""
    softening_of(field, str(path))
    study_of(field, str(path))
    bed_study_of(field, str(path))
    return field


def _check_suffix(path: Path) -> None:
    if path.suffix not in SUFFIXES:
        raise InputError(f"{path}: a field file ends in {' or '.join(SUFFIXES)}")


def table_of(field: xr.Dataset) -> dict[str, NDArray[Any]]:
    """Columns of a field, one row per operating point, frequency first."""
    f, gamma = places_of(field)
    axes = {"frequency": f.ravel(), "intensity": gamma.ravel()}
    return axes | {name: field[name].to_numpy().ravel() for name in TABLE if name in field.data_vars}


def _to_csv(field: xr.Dataset) -> str:
    columns = table_of(field)
    lines = [
        "# effective field of a particle damper",
        f"# bed_mass = {field.attrs['bed_mass']!r} kg",
        f"# source = {_in_a_line(field.attrs.get('source', ''))}",
        *(f"# {key} = {_in_a_line(field.attrs[key])}" for key in _KEPT if key in field.attrs),
        *(f"# damper.{key} = {_in_a_line(value)}" for key, value in damper_of(field).items()),
        ",".join(f"{name} [{TABLE[name].units.replace('1', '-')}]" for name in columns),
    ]
    rows = zip(*(column.tolist() for column in columns.values()), strict=True)
    return "\n".join(lines + [",".join("" if value != value else repr(value) for value in row) for row in rows]) + "\n"


def _in_a_line(value: Any) -> str:
    return " ".join(str(value).split())


def _from_csv(path: Path, bed_mass: float | None) -> xr.Dataset:
    header, names, rows = _split_csv(path)
    columns = _columns(path, names, rows)
    needed = ("frequency", "intensity", "loss_factor", "effective_mass_ratio")
    missing = [name for name in needed if name not in columns]
    if missing:
        raise InputError(
            f"{path}: no column for {', '.join(missing)}; found {', '.join(names)}; a field needs frequency [Hz], "
            "intensity [-] (or acceleration [m/s^2]), eta [-] and m' [-]"
        )
    mass = bed_mass if bed_mass is not None else _header_value(path, header, "bed_mass", "kg")
    damper: dict[str, Any] = {}
    for key, text in header.items():
        if key.startswith("damper."):
            name = key.removeprefix("damper.")
            damper[name] = text if name in _TEXTS else _number_or_text(text)
    if "clearance" in header:
        damper["clearance"] = _header_value(path, header, "clearance", "m")
        if not damper["clearance"] > 0.0:
            raise InputError(f"{path}: clearance: given {header['clearance']!r}; a length above 0 is needed")
    damper.setdefault("bed_mass", mass)
    source = header.get("source", f"typed by hand, {path.name}")
    field = field_from_points(columns, mass, source, damper, str(path))
    if "status" not in columns:
        gives = field["loss_factor"] < -3.0 * field["loss_factor_se"].fillna(0.0)
        status = field["status"].to_numpy() | np.where(gives.to_numpy(), int(Status.NOT_PASSIVE), 0)
        field["status"] = (field["status"].dims, status, field["status"].attrs)
    field.attrs |= {key: _number_or_text(header[key]) for key in _KEPT if key in header}
    return field


def _number_or_text(text: str) -> float | str:
    try:
        return float(text)
    except ValueError:
        return text


def field_from_points(
    columns: Mapping[str, NDArray[Any]], bed_mass: float, source: str, damper: Mapping[str, Any], where: str
) -> xr.Dataset:
    """Field from one row per operating point: a grid where the points fill one, scattered otherwise.

    Args:
        columns: by name of the schema, each of shape (point,); frequency, intensity, loss_factor, effective_mass_ratio
            at least.
        bed_mass: mass of all particles [kg].
        source: where the values come from.
        damper: description of the damper.
        where: opens every message.

    Raises:
        InputError: as :func:`graindamp.field.schema.check`.
    """
    f, gamma = columns["frequency"], columns["intensity"]
    f_axis, f_index = np.unique(f, return_inverse=True)
    g_axis, g_index = np.unique(gamma, return_inverse=True)
    place = f_index * len(g_axis) + g_index
    fills_grid = len(place) == len(f_axis) * len(g_axis) == len(np.unique(place))
    values = {name: column for name, column in columns.items() if name not in ("frequency", "intensity")}
    if fills_grid:
        order = np.argsort(place)
        values = {name: column[order].reshape(len(f_axis), len(g_axis)) for name, column in values.items()}
        f, gamma = f_axis, g_axis
    try:
        return make_field(
            f,
            gamma,
            values.pop("loss_factor"),
            values.pop("effective_mass_ratio"),
            bed_mass,
            source=source,
            scattered=not fills_grid,
            variables=values,
            damper=damper,
        )
    except InputError as error:
        raise InputError(f"{where}: {str(error).removeprefix('field: ')}") from None


def _split_csv(path: Path) -> tuple[dict[str, str], list[str], list[tuple[int, list[str]]]]:
    """Header entries, column names, and numbered rows of cells."""
    try:
        text = path.read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: not a readable text file ({error})") from None
    heads: list[str] = []
    lines: list[tuple[int, str]] = []
    for number, line in enumerate(text.splitlines(), start=1):
        if line.lstrip(' "').startswith("#"):
            heads.append(line)
        elif line.strip(" \t,;"):
            lines.append((number, line))
    if len(lines) < 2:
        raise InputError(f"{path}: no table; a row of column names and at least one row of numbers are needed")
    delimiter = max(";\t,", key=lambda mark: lines[0][1].count(mark))
    cells = [
        (number, [cell.strip() for cell in next(csv.reader([line], delimiter=delimiter))]) for number, line in lines
    ]
    return _header(heads, delimiter), cells[0][1], cells[1:]


def _header(lines: list[str], delimiter: str) -> dict[str, str]:
    """Entries "# name = value" of the head, also as a spreadsheet saves it: cut at commas, quoted, filled up with empty
    cells."""
    header = {}
    for line in lines:
        if line.lstrip().startswith('"'):
            line = ",".join(next(csv.reader([line.strip()], delimiter=delimiter)))
        key, _, value = line.strip(" \t,;").lstrip("# ").partition("=")
        header[key.strip().lower().replace(" ", "_")] = value.strip()
    return header


def _columns(path: Path, names: list[str], rows: list[tuple[int, list[str]]]) -> dict[str, NDArray[Any]]:
    columns: dict[str, NDArray[Any]] = {}
    has_comma = any("," in cell for _, cells in rows for cell in cells)
    for index, title in enumerate(names):
        name, factor = _meaning(path, title)
        if name is None:
            continue
        if name in columns:
            raise InputError(f"{path}: two columns mean {name}; keep one of them ({', '.join(names)})")
        values = []
        for number, cells in rows:
            if len(cells) < len(names):
                raise InputError(f"{path}: line {number} has {len(cells)} cells, the names row has {len(names)}")
            if any(cells[len(names) :]):
                told = f"{path}: line {number} has {len(cells)} cells, the names row has {len(names)}"
                raise InputError(f"{told}; decimal commas need semicolons between the cells")
            cell = cells[index].replace(",", ".") if has_comma else cells[index]
            try:
                values.append(float(cell) * factor if cell else float("nan"))
            except ValueError:
                raise InputError(f"{path}: line {number}, column {title}: given {cell!r}, a number is needed") from None
        column = np.array(values)
        if TABLE[name].kind == "int":
            column = np.nan_to_num(column, nan=BLANK.get(name, 0)).astype(np.int64)
        columns[name] = column
    return columns


def _meaning(path: Path, title: str) -> tuple[str | None, float]:
    """Schema name of a column and the factor to its SI unit; (None, 1) for a column that means nothing here."""
    label, _, unit = title.partition("[")
    unit = unit.rstrip("] ").strip()
    key = re.sub(r"[^a-z]", "", label.lower().replace("η", "eta").replace("\u03b3", "gamma"))
    if key.endswith("hz"):
        key = key.removesuffix("hz")
    name = next((name for name, aliases in _ALIASES.items() if key in aliases), None)
    if key in _ACCELERATIONS and unit in ("", "-", "1"):
        raise InputError(f"{path}: column '{title}' has no unit; write acceleration [m/s^2] or [g], or intensity")
    if name is None or unit in ("", "-", "1"):
        return name, 1.0
    try:
        if name == "intensity":
            return name, to_si(f"1 {unit}", "m/s^2") / STANDARD_GRAVITY
        return name, to_si(f"1 {unit}", TABLE[name].units.replace("1", ""))
    except ValueError as error:
        raise InputError(f"{path}: column '{title}': {error}") from None


def _header_value(path: Path, header: Mapping[str, str], key: str, unit: str) -> float:
    if key not in header:
        raise InputError(
            f"{path}: {key} is missing; add a line '# {key} = 350 g' above the table, or give it as an option"
        )
    try:
        return to_si(header[key], unit)
    except ValueError as error:
        raise InputError(f"{path}: {key}: given {header[key]!r}; {error}") from None
