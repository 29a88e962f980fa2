"""HDF5 files: every group with force and motion datasets is a run; attributes tell the rest."""

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from graindamp.errors import InputError
from graindamp.signals.readers.channels import Channel, named_channel
from graindamp.signals.readers.facts import Facts, read_facts
from graindamp.signals.readers.runs import Run, records_of
from graindamp.signals.record import Record
from graindamp.spec.measurement import ChannelsSpec


def read_hdf5(path: Path, spec: ChannelsSpec) -> list[Record]:
    """Records of an HDF5 file, groups in natural order (f63 before f100).

    Facts are attributes or scalar datasets of the run's group or of any group around it, the nearest counts. Groups
    called empty... or with the attribute empty = True are runs of the empty container. A dataset's own attributes
    `units` and `sampling_rate_hz` count for it alone.

    Raises:
        InputError: not HDF5, damaged, or channels, units or sampling rate missing or ambiguous.
    """
    try:
        with h5py.File(path, "r") as file:
            return records_of(_runs(file, (), {}, False, path), spec, path)
    except InputError:
        raise
    except Exception as error:  # a damaged file raises anything, from OSError to MemoryError
        raise InputError(f"{path}: not an HDF5 file, or damaged ({error}); export it again") from None


def _runs(group: Any, parents: tuple[Any, ...], around: Facts, is_empty: bool, path: Path) -> Iterator[Run]:
    """Runs of a group and all groups in it; `around` are the facts and `is_empty` the state of those around it."""
    name = group.name.strip("/")
    place = f"{path}: group /{name}"
    datasets = {key: item for key, item in _members(group) if isinstance(item, h5py.Dataset)}
    scalars = {key: _plain(item[()]) for key, item in datasets.items() if item.size == 1}
    facts = around | read_facts(scalars, place) | read_facts(_attributes(group), place)
    is_empty = is_empty or _is_empty(group)
    vectors = tuple(_channel(key, item, place) for key, item in datasets.items() if _is_vector(item))
    if vectors:
        yield Run(
            channels=vectors,
            facts=facts,
            label=name or path.stem,
            source=f"{path.name}:{name}" if name else path.name,
            place=place,
            rate_hint="give the group or the root an attribute sampling_rate_hz",
            is_empty=is_empty,
        )
    for _, item in _members(group):
        if isinstance(item, h5py.Group) and item not in (*parents, group):  # a link may lead back up
            yield from _runs(item, (*parents, group), facts, is_empty, path)


def _members(group: Any) -> Iterator[tuple[str, Any]]:
    """Members in natural order, without links that lead nowhere."""
    for key in sorted(group, key=_natural):
        item = group.get(key)
        if item is not None:
            yield key, item


def _natural(name: str) -> list[tuple[int, float, str]]:
    """Sorting key that puts f63 before f100 and G2.5 before G16."""
    parts = re.split(r"(\d+(?:\.\d+)?)", name)
    return [(1, float(part), "") if i % 2 else (0, 0.0, part.lower()) for i, part in enumerate(parts)]


def _is_vector(dataset: Any) -> bool:
    return bool(
        dataset.size and dataset.size > 1 and max(dataset.shape) == dataset.size and dataset.dtype.kind in "iuf"
    )


def _channel(name: str, dataset: Any, place: str) -> Channel:
    attributes = _attributes(dataset)
    unit = next((attributes[key] for key in attributes if key.lower() in ("units", "unit", "einheit")), None)
    rate = read_facts(attributes, f"{place}: dataset '{name}'").get("sampling_rate")
    return named_channel(name, dataset, unit if isinstance(unit, str) else None, rate)


def _is_empty(group: Any) -> bool:
    attributes = {key.lower(): value for key, value in _attributes(group).items()}
    flag = attributes.get("empty", attributes.get("is_empty", False))
    is_flagged = flag.strip().lower() in ("true", "yes", "1") if isinstance(flag, str) else bool(np.any(flag))
    return is_flagged or group.name.rpartition("/")[2].lower().startswith("empty")


def _attributes(item: Any) -> dict[str, Any]:
    return {key: _plain(value) for key, value in item.attrs.items()}


def _plain(value: Any) -> Any:
    """Attribute value with text as str and arrays of one as their element."""
    if isinstance(value, np.ndarray) and value.size == 1:
        value = value.reshape(-1)[0]
    return value.decode("utf-8", "replace") if isinstance(value, bytes) else value
