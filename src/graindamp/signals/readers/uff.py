"""Universal files: time records of dataset 58, paired into runs."""

import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pyuff

from graindamp.errors import InputError
from graindamp.signals.readers.channels import named_channel
from graindamp.signals.readers.clock import rate_of_time, stored_resolution
from graindamp.signals.readers.kinds import Kind, is_unit, unit_factor
from graindamp.signals.readers.runs import records_of
from graindamp.signals.readers.uff_blocks import tidy_datasets
from graindamp.signals.readers.uff_pairs import TimeRecord, paired_runs
from graindamp.signals.record import Record
from graindamp.spec.measurement import ChannelsSpec

_KIND: dict[int, Kind] = {8: "displacement", 11: "velocity", 12: "acceleration", 13: "force"}


def read_uff(path: Path, spec: ChannelsSpec) -> list[Record]:
    """Records of a universal file: one of each pair of a force and a motion time record.

    The ordinate's data type tells the kind, its units label the unit; without a readable label dataset 164 does, else
    SI. A record measured along a negative direction is turned to the positive axis.

    Raises:
        InputError: damaged, without time records, not to be paired, or channels or units missing or ambiguous.
    """
    records = list(_time_records(path))
    if not records:
        raise InputError(
            f"{path}: holds no time records (dataset 58, function type 1); frequency response functions do not tell "
            "the force of a damper, export the time signals of force and motion"
        )
    return records_of(paired_runs(records, spec, path), spec, path)


def _time_records(path: Path) -> Iterator[TimeRecord]:
    blocks = tidy_datasets(path, (58, 164))
    # pyuff reads paths only, and not the stray bytes of some front ends: it gets the datasets it needs, tidied.
    with tempfile.TemporaryDirectory() as folder:
        tidy = Path(folder) / "tidy.uff"
        tidy.write_bytes(b"".join(blocks))
        try:
            file = pyuff.UFF(str(tidy))
            types = [int(number) for number in file.get_set_types()]
        except Exception as error:  # pyuff raises bare Exception
            raise InputError(f"{path}: not a universal file, or damaged ({error}); export it again") from None
        units, number = {"length": 1.0, "force": 1.0}, 0
        for index, kind in enumerate(types):
            number += kind == 58
            place = f"{path}: dataset {kind}" + (f", record {number}" if kind == 58 else "")
            header = _dataset(file, index, place, header_only=True)
            if kind == 164:
                units = {key: 1 / header[key] if header[key] > 0 else 1.0 for key in units}
            elif header["func_type"] == 1 or (header["func_type"] == 0 and header["abscissa_spec_data_type"] == 17):
                yield _time_record(_dataset(file, index, place), number, units, place)


def _dataset(file: Any, index: int, place: str, header_only: bool = False) -> dict[str, Any]:
    try:
        dataset: dict[str, Any] = file.read_sets(index, header_only=header_only)
    except Exception:  # pyuff raises bare Exception, without a reason worth passing on
        raise InputError(
            f"{place}: its header or numbers do not follow the format; export ASCII, double precision"
        ) from None
    return dataset


def _time_record(dataset: dict[str, Any], number: int, units: dict[str, float], place: str) -> TimeRecord:
    ids = [dataset[f"id{i}"] for i in range(1, 6)]
    name = next((text for text in (ids[0], dataset["ordinate_axis_lab"]) if _text(text)), f"record {number}")
    n_value = dataset["num_pts"]
    values = np.asarray(dataset["data"])
    if values.size < n_value:
        raise InputError(
            f"{place} '{name}': announces {n_value} values, holds {values.size}; the file is cut off, export it again"
        )
    if np.iscomplexobj(values):
        raise InputError(f"{place} '{name}': a time record of complex numbers; export the real signal")
    sign = -1.0 if dataset["rsp_dir"] < 0 else 1.0
    label = _text(dataset["ordinate_axis_units_lab"])
    channel = named_channel(name, sign * values[:n_value], label)
    kind = _KIND.get(dataset["ordinate_spec_data_type"], channel.kind)
    if label and not is_unit(label):
        label = None  # "EU", "user": no unit that anyone could convert
    scale = 1.0 if kind is None else units["force" if kind == "force" else "length"]
    channel = channel._replace(
        kind=kind, is_named=kind is not None, unit=label, scale=scale, rate=_rate(dataset, n_value, place)
    )
    return TimeRecord(
        channel=channel,
        number=number,
        run=(*ids[1:], dataset["ver_num"], dataset["load_case_id"]),
        node=(dataset["rsp_ent_name"], dataset["rsp_node"]),
        direction=abs(dataset["rsp_dir"]),
    )


def _rate(dataset: dict[str, Any], n_value: int, place: str) -> float | None:
    """Samples per second [Hz]; None where the abscissa has no increment."""
    second = unit_factor(_text(dataset["abscissa_axis_units_lab"]) or "s", "s") or 1.0
    if not dataset["abscissa_spacing"]:
        time = np.asarray(dataset["x"], dtype=np.float64)[:n_value] * second
        # Uneven spacing stores times as E13.5: six digits.
        resolution = np.maximum(stored_resolution(time), 10.0 ** (np.floor(np.log10(np.abs(time) + 1e-300)) - 5))
        return rate_of_time(time, resolution, f"{place}: abscissa", "value {}".format)
    step = dataset["abscissa_inc"] * second
    return 1 / step if step > 0 else None


def _text(label: str) -> str | None:
    return None if label.strip().upper() in ("", "NONE") else label.strip()
