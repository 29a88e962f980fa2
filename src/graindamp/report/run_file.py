"""Files of simulated runs (.h5) and of packings (.npz): all that was computed, to be read again without loss.

A run file is HDF5: a dataset for each array in SI units, attributes for single numbers, the description as JSON.
Complex amplitudes are stored as real and imaginary part. A file appears under its name only when it is whole.
"""

import io
import json
import os
import secrets
import zipfile
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import h5py
import numpy as np

import graindamp
from graindamp.errors import InputError
from graindamp.spec.model import parse_spec
from graindamp.spec.simulation import SimulationSpec

if TYPE_CHECKING:
    from graindamp.dem.packing_store import Packing
    from graindamp.dem.run import Run

RUN_FORMAT, PACKING_FORMAT = "graindamp-run-1", "graindamp-packing-1"
"""What a file of each kind says it is."""

_COMPLEX = ("cycle_force", "cycle_velocity")
_OWN_GROUP = ("spec", "packing", "enclosure", "energy", "snapshots", "velocity_field", "names", "end", "stirring")
"""Fields of a run that are no plain array or number."""


class StoredPacking(NamedTuple):
    """A packing and what it was made from."""

    packing: "Packing"
    spec: SimulationSpec


def save_run(run: "Run", path: Path) -> Path:
    """Write a run as HDF5.

    Raises:
        InputError: the file cannot be written.
    """

    def fill(part: Path) -> None:
        with h5py.File(part, "w") as file:
            file.attrs["format"], file.attrs["graindamp_version"] = RUN_FORMAT, graindamp.__version__
            file.attrs["spec"] = run.spec.model_dump_json()
            file.attrs["names"] = json.dumps(list(run.names))
            _put(file, run, without=_OWN_GROUP)
            _put(file.create_group("packing"), run.packing)
            _put_enclosure(file.create_group("enclosure"), run.enclosure)
            _put_rows(file.create_group("energy"), run.energy)
            _put_rows(file.create_group("snapshots"), run.snapshots)
            if run.velocity_field is not None:
                _put(file.create_group("velocity_field"), run.velocity_field)
            if run.end is not None:
                _put(file.create_group("end"), run.end)
            if run.stirring is not None:
                _put(file.create_group("stirring"), run.stirring)

    return _written(path, fill)


def load_run(path: Path) -> "Run":
    """A run read from its file.

    Raises:
        InputError: no such file, not a run file, damaged, or of another version of the format.
    """
    from graindamp.dem.energy import Energies
    from graindamp.dem.packing_store import Packing
    from graindamp.dem.run import BedState, Run, Snapshot, VelocityField
    from graindamp.dem.stirring import Stirring

    if not path.exists():
        raise InputError(f"{path}: there is no such file; give a run.h5 that 'graindamp simulate' has written")
    try:
        with h5py.File(path, "r") as file:
            _check_format(path, str(file.attrs.get("format", "")), RUN_FORMAT, "run file of 'graindamp simulate'")
            values = _got(file, Run, without=_OWN_GROUP)
            field, end, stirring = file.get("velocity_field"), file.get("end"), file.get("stirring")
            values |= {
                "spec": _spec(str(file.attrs["spec"]), path),
                "names": tuple(json.loads(file.attrs["names"])),
                "packing": Packing(**_got(file["packing"], Packing)),
                "enclosure": _got_enclosure(file["enclosure"]),
                "energy": _got_rows(file["energy"], Energies),
                "snapshots": _got_rows(file["snapshots"], Snapshot),
                "velocity_field": None if field is None else VelocityField(**_got(field, VelocityField)),
                "end": None if end is None else BedState(**_got(end, BedState)),
                "stirring": None if stirring is None else Stirring(**_got(stirring, Stirring)),
            }
            return Run(**values)
    except InputError:
        raise
    except Exception as error:  # a damaged file raises anything, from OSError to MemoryError
        raise InputError(f"{path}: not a run file, or damaged ({error}); simulate again") from None


def save_packing(packing: "Packing", spec: SimulationSpec, path: Path) -> Path:
    """Write a packing with its description (.npz).

    Raises:
        InputError: the file cannot be written.
    """
    values = {name: value for name, value in packing._asdict().items() if value is not None}

    def fill(part: Path) -> None:
        with part.open("wb") as file:
            np.savez_compressed(file, format=PACKING_FORMAT, spec=spec.model_dump_json(), **values)

    return _written(path, fill)


def load_packing(path: Path) -> StoredPacking:
    """A packing and its description, read from a file.

    Raises:
        InputError: no such file, not a packing of :func:`save_packing`, or damaged.
    """
    from graindamp.dem.packing_store import Packing

    try:
        data = path.read_bytes()
    except OSError as error:
        raise InputError(f"{path}: cannot be opened ({error.strerror or error})") from None
    try:
        with np.load(io.BytesIO(data), allow_pickle=False) as file:
            stored = {name: file[name] for name in file.files}
    except (ValueError, OSError, EOFError, zipfile.BadZipFile) as error:
        raise InputError(f"{path}: not a packing (.npz), or damaged ({error}); pack again") from None
    _check_format(path, str(stored.pop("format", "")), PACKING_FORMAT, "packing of 'graindamp pack'")
    spec = _spec(str(stored.pop("spec")), path)
    values = {name: stored.get(name) for name in Packing._fields}
    return StoredPacking(Packing(**{name: _native(value) for name, value in values.items()}), spec)


def _spec(text: str, path: Path) -> SimulationSpec:
    return parse_spec(json.loads(text), SimulationSpec, f"{path}: description inside")


def _check_format(path: Path, found: str, wanted: str, what: str) -> None:
    if found == wanted:
        return
    if found.rpartition("-")[0] == wanted.rpartition("-")[0]:
        raise InputError(f"{path}: of format {found}, this version reads {wanted}; use the version that wrote it")
    raise InputError(f"{path}: is no {what}")


def _native(value: Any) -> Any:
    """Arrays of no dimension as Python's own number or text; whatever else as it is."""
    if isinstance(value, bytes):
        return value.decode()
    if isinstance(value, np.ndarray) and value.ndim == 0:
        return value.item()
    return value.item() if isinstance(value, np.generic) else value


def _put(group: Any, record: Any, without: tuple[str, ...] = ()) -> None:
    """The fields of a NamedTuple: arrays as datasets, numbers as attributes; None is left out."""
    for name, value in record._asdict().items():
        if name in without or value is None:
            continue
        array = np.asarray(value)
        if array.dtype.kind == "c":
            array = np.stack([array.real, array.imag], axis=-1)
        if array.ndim == 0 and name not in _COMPLEX:
            group.attrs[name] = array.item()
        else:
            _dataset(group, name, array)


def _dataset(group: Any, name: str, array: Any) -> None:
    packed = {"compression": "gzip", "compression_opts": 1, "shuffle": True} if array.size > 4096 else {}
    group.create_dataset(name, data=array, **packed)


def _got(group: Any, kind: Any, without: tuple[str, ...] = ()) -> dict[str, Any]:
    """Fields of a NamedTuple by name, as :func:`_put` left them."""
    values: dict[str, Any] = {}
    for name in kind._fields:
        if name in without:
            continue
        value = group[name][()] if name in group else group.attrs.get(name)
        if name in _COMPLEX and value is not None:
            value = value[..., 0] + 1j * value[..., 1]
        values[name] = _native(value)
    return values


def _put_rows(group: Any, rows: Any) -> None:
    """A tuple of like NamedTuples, a dataset for each field with the rows along axis 0."""
    group.attrs["n_row"] = len(rows)
    for name in rows[0]._fields if rows else ():
        _dataset(group, name, np.stack([np.asarray(getattr(row, name)) for row in rows]))


def _got_rows(group: Any, kind: Any) -> tuple[Any, ...]:
    n_row = int(group.attrs["n_row"])
    columns: Mapping[str, Any] = {name: group[name][()] for name in kind._fields} if n_row else {}
    return tuple(kind(**{name: _native(column[k]) for name, column in columns.items()}) for k in range(n_row))


def _put_enclosure(group: Any, enclosure: Any) -> None:
    from graindamp.dem.walls import N_SHAPE

    elements = enclosure.elements
    numbers = np.zeros((len(elements), N_SHAPE))
    for row, element in zip(numbers, elements, strict=True):
        row[: len(element.numbers)] = element.numbers
    group.attrs["names"], group.attrs["n_plain"] = json.dumps(list(enclosure.names)), enclosure.n_plain
    columns = ("kind", "material", "group", "law", "patch")
    table = [[int(getattr(element, name)) for name in columns] for element in elements]
    _dataset(group, "element", np.asarray(table, dtype=np.int64).reshape(-1, len(columns)))
    _dataset(group, "n_number", np.asarray([len(element.numbers) for element in elements], dtype=np.int64))
    _dataset(group, "numbers", numbers)
    _dataset(group, "edges", np.asarray(enclosure.edges))
    if enclosure.mesh is not None:
        _put(group.create_group("mesh"), enclosure.mesh)


def _got_enclosure(group: Any) -> Any:
    from graindamp.dem.container import Element, Enclosure
    from graindamp.dem.mesh_features import MeshFeatures
    from graindamp.dem.walls import WallKind

    rows, lengths, numbers = group["element"][()].tolist(), group["n_number"][()].tolist(), group["numbers"][()]
    elements = tuple(
        Element(WallKind(kind), tuple(numbers[k, :n].tolist()), material, wall, law, patch)
        for k, ((kind, material, wall, law, patch), n) in enumerate(zip(rows, lengths, strict=True))
    )
    mesh = MeshFeatures(**_got(group["mesh"], MeshFeatures)) if "mesh" in group else None
    names = tuple(json.loads(group.attrs["names"]))
    return Enclosure(names, elements, int(group.attrs["n_plain"]), group["edges"][()], mesh)


def _written(path: Path, fill: Callable[[Path], None]) -> Path:
    """Fill a file that takes its name when all of it is there, and leaves nothing behind when that fails."""
    part = path.with_name(f".{path.name}.{secrets.token_hex(4)}.part")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        fill(part)
        os.replace(part, path)
    except OSError as error:
        raise InputError(
            f"{path}: cannot be written ({error.strerror or error}); free the place, or write elsewhere"
        ) from None
    finally:
        with suppress(OSError):
            part.unlink(missing_ok=True)
    return path
