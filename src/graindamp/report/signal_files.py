"""Signals of a simulated run as files that `graindamp analyze` and other programs read: HDF5 and universal files."""

from pathlib import Path
from typing import Any

import h5py
import numpy as np

import graindamp
from graindamp.errors import InputError
from graindamp.signals.record import Record

_FORCE_TYPE, _VELOCITY_TYPE = 13, 11
"""Specific data types of dataset 58: excitation force and velocity."""


def write_signals(record: Record, path: Path) -> Path:
    """Write force and velocity as HDF5: a group named like f100_G40, facts as its attributes.

    Args:
        record: of a simulated run; its force is without the container's own mass, so that container_mass is 0.
        path: file to write.

    Raises:
        InputError: the file cannot be written.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with h5py.File(path, "w") as file:
            file.attrs["source"] = f"simulated by graindamp {graindamp.__version__}"
            group = file.create_group(record.label)
            for name, values, unit in (("force", record.force, "N"), ("velocity", record.motion, "m/s")):
                group[name] = values
                group[name].attrs["units"] = unit
            group.attrs["sampling_rate_hz"] = record.sampling_rate
            group.attrs["bed_mass_kg"], group.attrs["container_mass_kg"] = record.bed_mass, record.container_mass
            if record.frequency is not None:
                group.attrs["frequency_hz"] = record.frequency
            if record.nominal_intensity is not None:
                group.attrs["nominal_intensity"] = record.nominal_intensity
    except OSError as error:
        raise InputError(f"{path}: cannot be written ({error.strerror or error})") from None
    return path


def write_uff(record: Record, path: Path) -> Path:
    """Write force and velocity as time records of a universal file (dataset 58, ASCII, double precision).

    What a universal file has no place for stands in the text lines: masses and frequency.

    Raises:
        InputError: the file cannot be written.
    """
    import pyuff

    time = np.arange(len(record.force)) / record.sampling_rate
    facts = f"bed_mass {record.bed_mass:.9g} kg, container_mass {record.container_mass:g} kg"
    drive = f"frequency {record.frequency:.9g} Hz" if record.frequency is not None else "no fixed frequency"
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.unlink(missing_ok=True)
        for name, values, kind, unit in (
            ("force", record.force, _FORCE_TYPE, "N"),
            ("velocity", record.motion, _VELOCITY_TYPE, "m/s"),
        ):
            dataset: dict[str, Any] = {
                "type": 58,
                "binary": 0,
                "func_type": 1,
                "id1": name,
                "id2": record.label,
                "id3": f"simulated by graindamp {graindamp.__version__}",
                "id4": facts,
                "id5": drive,
                "rsp_ent_name": "DAMPER",
                "rsp_node": 1,
                "rsp_dir": 1,
                "ref_node": 0,
                "ref_dir": 0,
                "ord_data_type": 4,
                "data": values,
                "x": time,
                "abscissa_spacing": 1,
                "abscissa_min": 0.0,
                "abscissa_inc": 1.0 / record.sampling_rate,
                "abscissa_spec_data_type": 17,
                "abscissa_axis_lab": "time",
                "abscissa_axis_units_lab": "s",
                "ordinate_spec_data_type": kind,
                "ordinate_axis_lab": name,
                "ordinate_axis_units_lab": unit,
                "orddenom_spec_data_type": 0,
            }
            pyuff.UFF(str(path)).write_sets(dataset, "add")
    except OSError as error:
        raise InputError(f"{path}: cannot be written ({error.strerror or error})") from None
    return path
