"""Results as plain documents for JSON: SI units, named in the keys' neighbours, NaN as null."""

import json
from typing import Any

import numpy as np
import xarray as xr

import graindamp
from graindamp.couple.equilibrium import Equilibrium, ModeResult
from graindamp.couple.predict import ModePrediction, Prediction, Study
from graindamp.couple.response import Response, peaks
from graindamp.field.beds import NAMES, bed_remarks, bed_study_of
from graindamp.field.measured import Measurement
from graindamp.field.robustness import Measured, Robustness
from graindamp.field.schema import COORDINATES, TABLE, damper_of, is_grid
from graindamp.field.softening import softening_of, softening_remarks, study_of
from graindamp.field.store import table_of
from graindamp.report.plain import plain
from graindamp.signals.equivalent import equivalent
from graindamp.signals.power import OperatingPoint
from graindamp.signals.record import Record
from graindamp.status import Status


def field_document(field: xr.Dataset) -> dict[str, Any]:
    """A field with one entry per operating point, units beside."""
    columns = table_of(field)
    rows = [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]
    for row in rows:
        row["status"] = int(row["status"])
        row["status_names"] = status_names(row["status"])
    document: dict[str, Any] = plain(
        {
            "graindamp_version": graindamp.__version__,
            "layout": "grid" if is_grid(field) else "points",
            "bed_mass": field.attrs["bed_mass"],
            "damper": damper_of(field),
            "source": field.attrs.get("source", ""),
            "units": {name: TABLE[name].units for name in columns} | {"bed_mass": "kg"},
            "frequency_range": [field[COORDINATES[0]].min().item(), field[COORDINATES[0]].max().item()],
            "intensity_range": [field[COORDINATES[1]].min().item(), field[COORDINATES[1]].max().item()],
            "softening": softening_document(field),
            "beds": bed_document(field),
            "points": rows,
        }
    )
    return document


def robustness_document(found: Robustness) -> dict[str, Any]:
    """How good a field stays over its range; numbers with standard errors."""
    told = {
        name: {"value": part.value, "standard_error": part.error}
        for name, part in found._asdict().items()
        if isinstance(part, Measured)
    }
    ranges = {"frequency_range": list(found.frequency_range), "intensity_range": list(found.intensity_range)}
    document: dict[str, Any] = plain({"level": found.level, "covered": found.covered} | told | ranges)
    return document


def softening_document(field: xr.Dataset) -> dict[str, Any]:
    """How far the contacts of a field were softened, what that does by its study, and what to know about it."""
    study = study_of(field)
    document: dict[str, Any] = {
        "softening": softening_of(field),
        "remarks": list(softening_remarks(field)),
        "study": None,
    }
    if study is not None:
        told = json.loads(study.dump())
        checked = zip(told["points"], study.are_straight, study.relative_errors.tolist(), strict=True)
        told["points"] = [one | {"line_fits": fits, "relative_error": error} for one, fits, error in checked]
        document["study"] = told
    return document


def bed_document(field: xr.Dataset) -> dict[str, Any]:
    """How much beds of the field's description differ by its study, and what to know about it."""
    study = bed_study_of(field)
    document: dict[str, Any] = {"remarks": list(bed_remarks(field)), "study": None}
    if study is not None:
        told = json.loads(study.dump())
        parted = zip(told["points"], study.are_parted, strict=True)
        told["points"] = [one | {"beds_part": is_parted} for one, is_parted in parted]
        told["scatter"] = study.pooled and {
            name: {"value": part.value, "standard_error": part.error}
            for name, part in zip(NAMES, study.pooled, strict=True)
        }
        document["study"] = told
    return document


def status_names(status: int) -> list[str]:
    """Names of the bits set."""
    return [str(bit.name) for bit in Status if bit and status & bit]


def measurement_document(measurement: Measurement) -> dict[str, Any]:
    """A measurement: its field, and all that was found at each record."""
    document = field_document(measurement.field)
    document["calibration"] = None if measurement.calibration is None else plain(measurement.calibration._asdict())
    document["problems"] = [problem.text for problem in measurement.problems]
    document["records"] = [
        point_document(point, record, measurement.container_mass)
        for point, record in zip(measurement.points, measurement.records, strict=True)
    ]
    document["units"] |= {
        "energy_per_radian": "J",
        "velocity_amplitude": "m/s",
        "viscous_coefficient": "N s/m",
        "harmonic_power": "W",
        "phase_correction": "rad",
        "phase_error": "rad",
        "equivalent_viscous_coefficient": "N s/m",
        "equivalent_mass_biased": "kg",
    }
    return document


def point_document(point: OperatingPoint, record: Record, container_mass: float) -> dict[str, Any]:
    """One record, with the equivalents of Wong, Spencer & Rongong (2009) beside its own."""
    document = point._asdict()
    del document["problems"]
    document["energy_per_radian"] = point.energy_per_radian
    document["status"] = int(point.status)
    document["status_names"] = status_names(point.status)
    document["problems"] = [problem.text for problem in point.problems]
    pair = equivalent(record, container_mass, point.phase_correction) if point.n_cycle else None
    document["equivalent_viscous_coefficient"] = None if pair is None else pair.viscous_coefficient
    document["equivalent_mass_biased"] = None if pair is None else pair.mass
    result: dict[str, Any] = plain(document)
    return result


def prediction_document(prediction: Prediction) -> dict[str, Any]:
    """A prediction, mode by mode."""
    document: dict[str, Any] = plain(
        {
            "graindamp_version": graindamp.__version__,
            "title": prediction.title,
            "units": {
                "frequency": "Hz",
                "force": "N",
                "damping_ratio": "1",
                "displacement": "m",
                "modal_amplitude": "kg^0.5 m",
                "intensity": "1",
                "mobility": "m/(N s)",
            },
            "dampers": [
                {
                    "name": damper.name,
                    "bed_mass": damper.bed_mass,
                    "source": field.attrs.get("source", ""),
                    "softening": softening_document(field),
                    "beds": bed_document(field),
                }
                for damper, field in zip(prediction.dampers, prediction.fields, strict=True)
            ],
            "modes": [mode_document(mode) for solved in prediction.modes for mode in solved],
            "responses": [
                response_document(force, sweep)
                for force, sweeps in zip(prediction.forces, prediction.responses, strict=False)
                for sweep in sweeps
            ],
            "studies": [study_document(study) for study in prediction.studies],
            "warnings": prediction.warnings,
        }
    )
    return document


def _result_document(result: ModeResult) -> dict[str, Any]:
    document = result._asdict()
    document["equilibria"] = [_state_document(state) for state in result.equilibria]
    return document


def _state_document(state: Equilibrium) -> dict[str, Any]:
    return state._asdict()


def mode_document(mode: ModePrediction) -> dict[str, Any]:
    """One mode: all equilibria, and the fixed-point scheme with its history."""
    document = _result_document(mode.result)
    scheme = mode.fixed_point
    document["fixed_point"] = None
    if scheme is not None:
        document["fixed_point"] = {
            "converged": scheme.converged,
            "n_iter": scheme.n_iter,
            "residual": scheme.residual,
            "reason": scheme.reason,
            "history": [turn._asdict() for turn in scheme.history],
        }
    return document


def response_document(force: float, sweep: Response) -> dict[str, Any]:
    """One sweep: the curve and its resonances."""
    return {
        "force": force,
        "direction": sweep.direction,
        "frequency": sweep.frequency,
        "mobility_modulus": np.abs(sweep.mobility),
        "mobility_phase": np.angle(sweep.mobility),
        "intensity": sweep.intensity,
        "extrapolated": sweep.extrapolated,
        "converged": sweep.converged,
        "peaks": [peak._asdict() for peak in peaks(sweep)],
    }


def study_document(study: Study) -> dict[str, Any]:
    """A study: every mode at every value."""
    return {
        "name": study.name,
        "value": study.value,
        "modes": [[_result_document(result) for result in row] for row in study.predictions],
    }
