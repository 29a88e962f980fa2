"""One HDF5 file per operating point: its task, its result, and a checksum of both."""

import hashlib
import io
import json
import os
import secrets
from contextlib import suppress
from importlib.metadata import version
from pathlib import Path
from typing import Any, NamedTuple

import h5py
import numpy as np

from graindamp.campaign.point import PointResult, PointTask
from graindamp.errors import InputError

FORMAT = "graindamp-point-1"
"""What a point file says it is."""


class StoredPoint(NamedTuple):
    """A result and what it is the result of."""

    task: PointTask
    result: PointResult


class DamagedPoint(Exception):
    """A point file that is truncated, changed, or none at all. It is set aside and its point computed again."""


def write_point(path: Path, task: PointTask, result: PointResult) -> None:
    """Write a point file, whole and on the disk, or not at all.

    Raises:
        OSError: it cannot be written; nothing is left behind then.
    """
    write_whole(path, _packed(task, result))


def read_point(path: Path) -> StoredPoint:
    """Task and result of a point file.

    Raises:
        DamagedPoint: the file is truncated, its content differs from its checksum, or it is no point file.
        FileNotFoundError: there is no such file.
    """
    data = path.read_bytes()
    try:
        with h5py.File(io.BytesIO(data), "r") as file:
            found = str(file.attrs.get("format", ""))
            if found != FORMAT:
                raise DamagedPoint(f"{path}: of format '{found}', not {FORMAT}")
            text, key, checksum = (str(file.attrs[name]) for name in ("task", "key", "checksum"))
            values = _values(file["result"])
        if checksum != _checksum(text, key, values):
            raise DamagedPoint(f"{path}: content and checksum differ")
        if key != path.stem:
            raise DamagedPoint(f"{path}: holds the point {key}, not that of its name")
        known = {name: value for name, value in values.items() if name in PointResult._fields}
        return StoredPoint(PointTask.load(text), PointResult(**known))
    except (OSError, KeyError, ValueError, RuntimeError, TypeError, AttributeError, InputError) as error:
        raise DamagedPoint(f"{path}: damaged ({error})") from None  # a changed byte raises whatever it likes


def write_whole(path: Path, data: bytes) -> None:
    """Write bytes under a name that appears when all of them are on the disk.

    Raises:
        OSError: they cannot be written; nothing is left behind then.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_name(f".{path.name}.{secrets.token_hex(4)}.part")
    try:
        with part.open("wb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        os.replace(part, path)
    finally:
        with suppress(OSError):
            part.unlink(missing_ok=True)


def _packed(task: PointTask, result: PointResult) -> bytes:
    """The file as bytes. It is made in memory: then a full disk is met by one plain write, not inside HDF5."""
    text, key, values = task.dump(), task.key, result._asdict()
    memory = io.BytesIO()
    with h5py.File(memory, "w") as file:
        file.attrs["format"], file.attrs["graindamp_version"] = FORMAT, version("graindamp")
        file.attrs["task"], file.attrs["key"] = text, key
        file.attrs["checksum"] = _checksum(text, key, values)
        group = file.create_group("result")
        for name, value in values.items():
            if isinstance(value, np.ndarray):
                group.create_dataset(name, data=value)
            else:
                group.attrs[name] = value
    return memory.getvalue()


def _values(group: Any) -> dict[str, Any]:
    """Fields of the result with the types they had; a version before or after this one may have others."""
    values: dict[str, Any] = {name: value.item() for name, value in group.attrs.items()}
    return values | {name: np.asarray(dataset[()]) for name, dataset in group.items()}


def _checksum(text: str, key: str, values: dict[str, Any]) -> str:
    """Hash of the task's text, its key, and every value with its name, type and shape."""
    total = hashlib.sha256(f"{key} {text}".encode())
    for name, value in sorted(values.items()):
        array = np.asarray(value)
        total.update(json.dumps([name, array.dtype.str, array.shape]).encode() + array.tobytes())
    return total.hexdigest()
