"""MATLAB files: variables, a struct or a struct array of runs, in the formats v4 to v7 and v7.3 (HDF5)."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import scipy.io

from graindamp.errors import InputError
from graindamp.signals.readers.channels import Channel, named_channel
from graindamp.signals.readers.facts import Facts, read_facts
from graindamp.signals.readers.mat5 import is_mat5, read_mat5
from graindamp.signals.readers.runs import Run, records_of
from graindamp.signals.record import Record
from graindamp.spec.measurement import ChannelsSpec


def read_mat(path: Path, spec: ChannelsSpec) -> list[Record]:
    """Records of a MATLAB file: one of its plain variables, and one of each struct or element of a struct array.

    Vectors are channels, scalars and text are facts; facts beside the structs count for all of them. A text variable
    force_unit is the unit of the variable force.

    Raises:
        InputError: damaged, without plain arrays, or channels, units or sampling rate missing or ambiguous.
    """
    try:
        variables = _load(path)
    except Exception as error:  # a damaged file raises anything, from zlib's errors to TypeError and MemoryError
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise InputError(f"{path}: not a MATLAB file, or damaged ({reason}); save it again") from None
    runs = list(_runs(variables, path))
    if not any(run.channels for run in runs):
        found = ", ".join(f"{name} ({_what(value)})" for name, value in variables.items() if name[:2] != "__")
        raise InputError(
            f"{path}: holds no arrays of samples (found: {found or 'nothing'}); tables, timetables and objects "
            "are not read, save plain arrays: save('run.mat', 'force', 'velocity', 'fs')"
        )
    return records_of(runs, spec, path)


def _runs(variables: dict[str, Any], path: Path) -> Iterator[Run]:
    facts = _facts(variables, str(path))
    yield _run(variables, facts, path, "")
    for name, value in variables.items():
        if isinstance(value, dict):
            yield _run(value, facts | _facts(value, f"{path}: {name}"), path, name)
        elif isinstance(value, list):
            for i, element in enumerate(value, start=1):
                if isinstance(element, dict):
                    label = f"{name}({i})"
                    yield _run(element, facts | _facts(element, f"{path}: {label}"), path, label)


def _run(variables: dict[str, Any], facts: Facts, path: Path, name: str) -> Run:
    return Run(
        channels=tuple(_channel(key, value, variables) for key, value in variables.items() if _is_vector(value)),
        facts=facts,
        label=name or path.stem,
        source=f"{path.name}:{name}" if name else path.name,
        place=f"{path}: {name}" if name else str(path),
        rate_hint="save it as a variable fs [Hz] beside the signals",
    )


def _channel(name: str, values: Any, variables: dict[str, Any]) -> Channel:
    units = (variables.get(f"{name}_{suffix}") for suffix in ("unit", "units"))
    return named_channel(name, values, next((unit for unit in units if isinstance(unit, str)), None))


def _facts(variables: dict[str, Any], place: str) -> Facts:
    told = {name: value for name, value in variables.items() if isinstance(value, str) or _is_scalar(value)}
    return read_facts(told, place)


def _is_scalar(value: Any) -> bool:
    return not isinstance(value, (dict, list)) and np.size(value) == 1 and np.asarray(value).dtype.kind in "iuf"


def _is_vector(value: Any) -> bool:
    is_array = isinstance(value, np.ndarray) and value.size > 1 and value.dtype.kind in "iuf"
    return bool(is_array and max(value.shape) == value.size)


def _what(value: Any) -> str:
    if isinstance(value, (dict, list)):
        return "struct" if isinstance(value, dict) else "cell"
    return "object" if value is None else "x".join(str(n) for n in np.shape(value)) or type(value).__name__


def _load(path: Path) -> dict[str, Any]:
    """Variables as arrays, text, dict for a struct, list for a struct array or cell array."""
    if h5py.is_hdf5(path):
        return _load_v73(path)
    data = path.read_bytes()
    if is_mat5(data):
        return read_mat5(data)
    if 0 not in data[:4]:
        raise ValueError("its first bytes are of no version from 4 to 7.3")
    variables: dict[str, Any] = scipy.io.loadmat(str(path), appendmat=False, squeeze_me=True)
    return {name: str(value) if isinstance(value, np.str_) else value for name, value in variables.items()}


def _load_v73(path: Path) -> dict[str, Any]:
    with h5py.File(path, "r") as file:
        return {name: _plain_v73(item, file) for name, item in file.items() if not name.startswith("#")}


def _plain_v73(item: Any, file: Any) -> Any:
    """Value of an item. MATLAB transposes arrays, stores text as codes and struct arrays as references by field."""
    if isinstance(item, h5py.Group):
        fields = {name: _plain_v73(field, file) for name, field in item.items()}
        references = {name for name, field in item.items() if _is_reference(field) and not _matlab_class(field)}
        if fields and references == set(fields):
            return [dict(zip(fields, values, strict=True)) for values in zip(*fields.values(), strict=True)]
        return fields
    if "MATLAB_empty" in item.attrs:
        return "" if _matlab_class(item) == "char" else np.zeros(0)
    if _is_reference(item):
        return [_plain_v73(file[reference], file) for reference in item[()].T.reshape(-1)]
    if _matlab_class(item) == "char":
        return "".join(chr(code) for code in item[()].reshape(-1))
    return np.asarray(item[()]).T


def _is_reference(item: Any) -> bool:
    return isinstance(item, h5py.Dataset) and h5py.check_ref_dtype(item.dtype) is not None


def _matlab_class(item: Any) -> str:
    name = item.attrs.get("MATLAB_class", b"")
    return name.decode("ascii", "replace") if isinstance(name, bytes) else str(name)
