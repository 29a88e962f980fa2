"""From a described measurement, or from analysed records, to an effective field."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from graindamp.errors import InputError
from graindamp.field.store import field_from_points
from graindamp.signals.checks import Problem
from graindamp.signals.phase import PhaseCalibration
from graindamp.signals.power import OperatingPoint, analyze, calibration_from
from graindamp.signals.readers.read import once, read_records
from graindamp.signals.record import Record
from graindamp.spec.measurement import MeasurementSpec
from graindamp.status import FATAL

SAME_INTENSITY = 0.02
"""Intensities within this share count as one setting of the rig; its controller holds levels no better."""
SAME_FREQUENCY = 1e-3
"""The same for frequencies as they are found in the signals."""


class Measurement(NamedTuple):
    """A measurement, analysed."""

    field: xr.Dataset
    points: tuple[OperatingPoint, ...]
    """One per record, in the order of the files."""
    records: tuple[Record, ...]
    calibration: PhaseCalibration | None
    """Phase of the channels; None without an empty-container run."""
    problems: tuple[Problem, ...]
    """What concerns the measurement as a whole; each point has its own."""
    bed_mass: float
    """[kg]."""
    container_mass: float
    """[kg]."""


def measure(
    spec: MeasurementSpec,
    folder: str | Path = ".",
    progress: Callable[[int, int, str], None] = lambda k, n, label: None,
) -> Measurement:
    """Effective field of a described measurement.

    Records that cannot be used are named in their operating points and leave NaN; the others are kept.

    Args:
        spec: files, channels, masses.
        folder: what the files are relative to.
        progress: told how many of how many records are done, and the next one's label.

    Raises:
        InputError: a file cannot be read, masses are missing or contradict each other, or no record gives a value.
    """
    once(spec.files, folder)
    records = [record for name in spec.files for record in read_records(Path(folder) / name, spec.channels)]
    empty = [record for record in records if record.is_empty]
    for name in spec.empty_files:
        found = read_records(Path(folder) / name, spec.channels)
        marked = [record for record in found if record.is_empty]
        empty += marked or [record._replace(is_empty=True) for record in found]
    filled = [record for record in records if not record.is_empty]
    if spec.frequency is not None:
        filled = [record._replace(frequency=spec.frequency) for record in filled]
    if not filled:
        raise InputError(f"{', '.join(spec.files)}: only empty-container runs; give runs of the filled damper too")
    bed_mass = _mass("bed_mass", spec.bed_mass, filled)
    if bed_mass is None or bed_mass <= 0:
        raise InputError(_mass_missing("bed_mass", "bed", "350 g", spec))
    container_mass = _mass("container_mass", spec.container_mass, [*filled, *empty])
    calibration, problems = calibration_from(empty, container_mass) if empty else (None, [])
    if container_mass is None:
        if calibration is None:
            raise InputError(_mass_missing("container_mass", "container", "200 g", spec))
        container_mass = float(calibration.mass.mean())
    points = []
    for k, record in enumerate(filled):
        progress(k, len(filled), record.label)
        points.append(analyze(record, bed_mass, container_mass, calibration, spec.phase_uncertainty, spec.skip_cycles))
    progress(len(filled), len(filled), "")
    damper = {
        "name": spec.name,
        "description": spec.description,
        "bed_mass": bed_mass,
        "container_mass": container_mass,
    } | ({} if spec.clearance is None else {"clearance": spec.clearance})
    names = [Path(name).name for name in spec.files]
    source = "signals of " + ", ".join(names[:4]) + (f" and {len(names) - 4} more files" if len(names) > 4 else "")
    field = field_of(points, bed_mass, source, damper)
    return Measurement(field, tuple(points), tuple(filled), calibration, tuple(problems), bed_mass, container_mass)


def _mass(key: str, given: float | None, records: Sequence[Record]) -> float | None:
    if given is not None:
        return given
    told = {getattr(record, key): record.source for record in records if getattr(record, key) is not None}
    if len(told) > 1 and max(told) - min(told) > 1e-6 * max(told):
        values = ", ".join(f"{value:g} kg in {source}" for value, source in told.items())
        raise InputError(f"{key} differs between the files ({values}); one field belongs to one damper")
    return next(iter(told), None)


def _mass_missing(key: str, what: str, example: str, spec: MeasurementSpec) -> str:
    return (
        f"{', '.join(spec.files[:3])}: the mass of the {what} is not in the file; give it as --{key.replace('_', '-')} "
        f"'{example}' or as {key} = \"{example}\" in a measurement description"
    )


def field_of(points: Sequence[OperatingPoint], bed_mass: float, source: str, damper: Mapping[str, Any]) -> xr.Dataset:
    """Effective field of analysed records, on a grid where they fill one.

    The axis shows the intensity the rig was set to where the records tell it and the measured one agrees to 2 %, else
    the mean of the measured ones that belong together; the intensity measured at each point is kept beside it.

    Args:
        points: analysed records; those with a fatal problem keep their place, with NaN.
        bed_mass: mass of all particles [kg].
        source: where the records come from.
        damper: description of the damper, kept as JSON.

    Raises:
        InputError: no record has a usable value, with the reason of each.
    """
    if not any(np.isfinite(point.loss_factor) for point in points):
        reasons = "\n".join(f"{point.label}: {problem.text}" for point in points for problem in point.problems)
        raise InputError(f"no record gives a value\n{reasons}")
    kept = [point for point in points if np.isfinite(point.loss_factor) or point.nominal_intensity is not None]
    kept = [point for point in kept if np.isfinite(point.frequency)]
    measured = np.array([point.intensity for point in kept])
    columns = {
        "frequency": _settings(np.array([point.frequency for point in kept]), SAME_FREQUENCY),
        "intensity": _intensity_settings(kept),
        "loss_factor": np.array([point.loss_factor for point in kept]),
        "effective_mass_ratio": np.array([point.effective_mass_ratio for point in kept]),
        "loss_factor_se": np.array([point.loss_factor_error for point in kept]),
        "effective_mass_ratio_se": np.array([point.effective_mass_ratio_error for point in kept]),
        "dissipated_energy": np.array([point.dissipated_energy for point in kept]),
        "power": np.array([point.power for point in kept]),
        "n_cycles": np.array([point.n_cycle for point in kept]),
        "status": np.array([int(point.status) for point in kept]),
        "measured_intensity": measured,
        "effective_mass_modulus_ratio": np.array([point.modulus_ratio for point in kept]),
    }
    return field_from_points(_averaged(columns), bed_mass, source, damper, "signals")


def _intensity_settings(points: Sequence[OperatingPoint]) -> NDArray[np.float64]:
    measured = np.array([point.intensity for point in points])
    nominal = np.array([point.nominal_intensity or np.nan for point in points])
    with np.errstate(invalid="ignore"):
        agrees = np.isfinite(nominal) & ~(np.abs(measured / nominal - 1) > SAME_INTENSITY)
    return np.where(
        agrees.all(), nominal, _settings(np.where(np.isfinite(measured), measured, nominal), SAME_INTENSITY)
    )


def _settings(values: NDArray[np.float64], share: float) -> NDArray[np.float64]:
    """Each value replaced by the mean of those that belong together: each lies within `share` of its lower neighbour,
    and all within twice that. Steps so small that a row of them is wider are settings of their own."""
    order = np.argsort(values)
    ordered = values[order]
    result = values.copy()
    for group in np.split(order, 1 + np.flatnonzero(np.diff(ordered) > share * ordered[:-1])):
        if np.ptp(values[group]) > 2.0 * share * values[group[0]]:
            continue
        result[group] = float(f"{values[group].mean():.4g}") if np.ptp(values[group]) > 0 else values[group[0]]
    return result


def _averaged(columns: dict[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
    """Repeats of one operating point as their mean; the standard error is the larger of within and between them."""
    pairs = np.column_stack([columns["frequency"], columns["intensity"]])
    unique, index = np.unique(pairs, axis=0, return_inverse=True)
    if len(unique) == len(pairs):
        return columns
    usable = (columns["status"] & int(FATAL)) == 0
    rows: dict[str, list[Any]] = {name: [] for name in columns}
    for group in range(len(unique)):
        members = np.flatnonzero(index.ravel() == group)
        good = members[usable[members]]
        for name, column in columns.items():
            if len(good) <= 1:
                rows[name].append(column[good[0] if len(good) else members[0]])
            elif name == "n_cycles":
                rows[name].append(column[good].sum())
            elif name == "status":
                rows[name].append(np.bitwise_or.reduce(column[good]))
            elif name.endswith("_se"):
                within = np.sqrt(np.sum(column[good] ** 2)) / len(good)
                between = np.std(columns[name.removesuffix("_se")][good], ddof=1) / np.sqrt(len(good))
                rows[name].append(max(within, between))
            else:
                rows[name].append(column[good].mean())
    return {name: np.array(values) for name, values in rows.items()}
