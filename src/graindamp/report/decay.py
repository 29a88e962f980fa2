"""All that is written about free decays: tables, document, CSV files, figures, page."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

import graindamp
from graindamp.design.rules import loss_factor_from_decay
from graindamp.errors import InputError
from graindamp.report import decay_figures
from graindamp.report.figures import save
from graindamp.report.page import Section, write_page
from graindamp.report.plain import plain
from graindamp.report.tables import Table
from graindamp.report.wording import plain as digits
from graindamp.report.wording import with_error
from graindamp.report.written import Files, write_columns, write_document
from graindamp.signals.decay import Decay, analyze_decay, mass_normalised
from graindamp.signals.decay_record import read_decays
from graindamp.signals.decay_repeats import Curve, combine
from graindamp.signals.readers.read import once
from graindamp.signals.record import MOTION_UNIT
from graindamp.spec.decay import DecaySpec

Real = NDArray[np.float64]

UNITS = {
    "time": "s",
    "displacement": "m",
    "alpha": "1",
    "velocity": "m/s",
    "intensity": "1",
    "psi": "1",
    "psi_particles": "1",
    "psi_mass_normalised": "1",
    "log_decrement": "1",
    "damping_ratio": "1",
    "frequency": "Hz",
    "loss_factor": "1",
}
"""Unit of each quantity of the document and the CSV files; an error has that of its quantity."""

_HOW_TO_READ = (
    "Cycle by cycle, Ψ = 1 − (V_next/V)² is the share of its energy that the structure loses between two peaks of one "
    "sign; both signs count. A value stands at the amplitude at which its cycle begins. Points are moving averages, "
    "the line is the mean of single cycles over bins of amplitude and over records."
)


class Decays(NamedTuple):
    """Records of one test and what they say together."""

    spec: DecaySpec
    results: tuple[Decay, ...]
    curve: Curve
    warnings: tuple[str, ...]
    """What to know before the numbers are used, a line each; records left out among them."""


def examine(spec: DecaySpec, folder: Path, progress: Callable[[str], None] = lambda text: None) -> Decays:
    """Read and analyse all records of a test. A record without a decay is left out, with a warning.

    Args:
        spec: files, masses, method.
        folder: that relative paths start from.
        progress: told which record is being analysed.

    Raises:
        InputError: a file cannot be read, or no record holds a decay.
    """
    once(spec.files, folder)
    records = [record for name in spec.files for record in read_decays(folder / name, spec.channels)]
    results: list[Decay] = []
    failed: list[str] = []
    for record in _with_own_labels(records):
        progress(record.label)
        try:
            results.append(analyze_decay(record, spec.method))
        except InputError as error:
            failed.append(str(error))
    if not results:
        raise InputError("\n".join(failed))
    warnings = [f"left out: {text}" for text in failed]
    warnings += [line for result in results for line in result.warnings]
    found = [result.frequency for result in results]
    if max(found) > 1.1 * min(found):
        warnings.append(
            f"the records oscillate at {min(found):.4g} to {max(found):.4g} Hz; are they repeats of one test? Say "
            "which mode is meant with the frequency of the method"
        )
    curve = combine(results, spec.bins)
    below = int(np.count_nonzero(curve.psi + 3.0 * curve.psi_error < spec.intrinsic))
    if below:
        warnings.append(
            f"intrinsic is {100 * spec.intrinsic:g} %, but Ψ is smaller at {below} of {len(curve.psi)} amplitudes, and "
            f"{100 * float(np.nanmin(curve.psi)):.3g} % at the least: what is left for the particles is negative there"
        )
    return Decays(spec, tuple(results), curve, tuple(warnings))


def _with_own_labels(records: Sequence[Any]) -> list[Any]:
    """Records whose labels differ, numbered where files name them alike."""
    labels = [record.label for record in records]
    return [
        record._replace(label=f"{record.label} ({i})") if labels.count(record.label) > 1 else record
        for i, record in enumerate(records, 1)
    ]


def curve_columns(decays: Decays) -> dict[str, Real]:
    """Columns over amplitude in SI: the curve, and what masses, clearance and intrinsic damping make of it."""
    spec, curve = decays.spec, decays.curve
    columns: dict[str, Real] = {"displacement": curve.displacement}
    if spec.clearance is not None:
        columns["alpha"] = curve.displacement / spec.clearance
    columns |= {"velocity": curve.velocity, "intensity": curve.intensity}
    columns |= {"psi": curve.psi, "psi_error": curve.psi_error}
    columns |= {"psi_noise": curve.psi_noise, "psi_scatter": curve.psi_scatter}
    columns["psi_particles"] = curve.psi - spec.intrinsic
    ratio = spec.mass_ratio
    if ratio is not None:
        columns["psi_mass_normalised"] = mass_normalised(curve.psi - spec.intrinsic, ratio)
        columns["psi_mass_normalised_error"] = mass_normalised(curve.psi_error, ratio)
        columns["loss_factor"] = np.array([_loss_factor(value, ratio) for value in curve.psi - spec.intrinsic])
    for name in ("damping_ratio", "damping_ratio_error", "frequency", "frequency_error", "n_record", "n_cycle"):
        columns[name] = getattr(curve, name)
    return columns


def _loss_factor(psi: float, mass_ratio: float) -> float:
    return loss_factor_from_decay(psi, mass_ratio).loss_factor if 0.0 <= psi < 1.0 else float("nan")


def curve_table(decays: Decays) -> Table:
    """Damping and frequency over amplitude, largest first."""
    spec = decays.spec
    columns = {name: values[::-1] for name, values in curve_columns(decays).items()}
    titles = ["U [mm]", *(["U/d [-]"] if spec.clearance else []), "V [mm/s]", "Γ [-]", "Ψ [%]"]
    titles += ["Ψ_m [-]", "η [-]"] if spec.mass_ratio else []
    titles += ["ζ [%]", "f [Hz]", "cycles", "records"]
    rows = []
    for i in range(len(columns["displacement"])):
        at = {name: float(values[i]) for name, values in columns.items()}
        row = [digits(1e3 * at["displacement"], 4)]
        row += [digits(at["alpha"], 3)] if spec.clearance else []
        row += [digits(1e3 * at["velocity"], 4), digits(at["intensity"], 3)]
        row.append(with_error(at["psi_particles"], at["psi_error"], scale=100.0))
        if spec.mass_ratio:
            row.append(with_error(at["psi_mass_normalised"], at["psi_mass_normalised_error"]))
            row.append(digits(at["loss_factor"]))
        row.append(with_error(at["damping_ratio"], at["damping_ratio_error"], scale=100.0))
        row.append(with_error(at["frequency"], at["frequency_error"]))
        rows.append((*row, f"{at['n_cycle']:.0f}", f"{at['n_record']:.0f}"))
    note = "± is one standard error: noise, or the scatter of the records where that is larger. "
    note += f"Ψ without the intrinsic {100 * spec.intrinsic:g} %; ζ with it. " if spec.intrinsic else ""
    note += "η is the loss factor of a damper that moves with the mode, m′ = 1." if spec.mass_ratio else ""
    return Table("Damping over amplitude", tuple(titles), tuple(rows), note.strip())


def records_table(decays: Decays) -> Table:
    """Each record: where its decay lies, and how good it is."""
    rows = []
    for result in decays.results:
        extremes, cycles, located = result.located.extremes, result.cycles, result.located
        unit = MOTION_UNIT[result.record.quantity]
        rows.append(
            (
                result.record.label,
                f"{extremes.time[0]:.4g} to {extremes.time[-1]:.4g}",
                "noise" if located.ends_in_noise else "record",
                str(len(cycles.time)),
                f"{1e3 * cycles.displacement[0]:.4g} to {1e3 * cycles.displacement[-1]:.3g}",
                f"{result.frequency:.4f}",
                f"{100 * result.damping_ratio:.3g}",
                f"{located.peak_noise:.2g} {unit}",
                f"{located.offset[0]:.2g} {unit}",
            )
        )
    titles = ("record", "decay [s]", "ends by", "cycles", "U [mm]", "f [Hz]", "mean ζ [%]", "error of a peak", "offset")
    note = "Cycles of both signs, overlapping by half. f is the median over cycles, ζ that of the mean decrement."
    return Table("Records", titles, tuple(rows), note)


def decay_document(decays: Decays) -> dict[str, Any]:
    """Everything in SI: the curve over amplitude, and every record with its cycles."""
    spec = decays.spec
    document: dict[str, Any] = plain(
        {
            "graindamp_version": graindamp.__version__,
            "kind": "decay",
            "name": spec.name,
            "units": UNITS,
            "mass_ratio": spec.mass_ratio,
            "clearance": spec.clearance,
            "intrinsic": spec.intrinsic,
            "method": spec.method.model_dump(),
            "curve": curve_columns(decays),
            "records": [_record_document(result) for result in decays.results],
            "warnings": decays.warnings,
        }
    )
    return document


def _record_document(result: Decay) -> dict[str, Any]:
    record, located = result.record, result.located
    return {
        "label": record.label,
        "source": record.source,
        "quantity": record.quantity,
        "unit": MOTION_UNIT[record.quantity],
        "sampling_rate": record.sampling_rate,
        "start": located.extremes.time[0],
        "end": located.extremes.time[-1],
        "ends_in_noise": located.ends_in_noise,
        "offset": located.offset[0],
        "drift": located.offset[1],
        "sample_noise": located.sample_noise,
        "peak_noise": located.peak_noise,
        "frequency": result.frequency,
        "damping_ratio": result.damping_ratio,
        "cycles": result.cycles._asdict(),
    }


def write_decays(
    decays: Decays, folder: Path, inputs: str, progress: Callable[[str], None] = lambda text: None
) -> Files:
    """Write report.html, result.json, curve.csv, cycles.csv and the figures into `folder`.

    Args:
        decays: the results.
        folder: made if it is not there.
        inputs: what was given, shown in the page.
        progress: told what is being drawn.

    Raises:
        InputError: a file cannot be written.
    """
    spec, results, curve = decays.spec, decays.results, decays.curve
    pictures: list[Path] = []

    def picture(name: str, figure: Figure) -> Path:
        progress(f"drawing {name}")
        pictures.append(save(figure, folder / f"{name}.png"))
        return pictures[-1]

    over_time = picture("decay", decay_figures.decays(results))
    of_damping = picture(
        "damping", decay_figures.damping(results, curve, spec.intrinsic, spec.mass_ratio, spec.clearance)
    )
    of_frequency = picture("frequency", decay_figures.frequency(results, curve))
    lines = "Lines: α = 1/π, where one ball meets the wall head on, and 1/(2π), where the wall catches it."
    caption = "Damping over amplitude." + (f" {lines}" if spec.clearance else "")
    more = "" if len(results) <= decay_figures.RECORDS_SHOWN else f" The first {decay_figures.RECORDS_SHOWN} records."
    sections = [
        Section("Damping", _HOW_TO_READ, (curve_table(decays),), ((of_damping, caption),)),
        Section("Frequency", "", (), ((of_frequency, "Frequency and damping ratio of every cycle, and their means."),)),
        Section("Records", "", (records_table(decays),), ((over_time, f"Peaks and envelope, offset removed.{more}"),)),
    ]
    tables = (
        write_columns(_titled(curve_columns(decays)), folder / "curve.csv"),
        write_columns(_titled(_all_cycles(decays)), folder / "cycles.csv"),
    )
    document = write_document(decay_document(decays), folder / "result.json")
    page = write_page(folder / "report.html", f"Free decay: {spec.name}", sections, decays.warnings, inputs)
    return Files(page, document, tables, tuple(pictures))


def _all_cycles(decays: Decays) -> dict[str, Any]:
    """Columns of the cycles of all records, one below the other."""
    columns: dict[str, Any] = {"record": [result.record.label for result in decays.results for _ in result.cycles.time]}
    for name in decays.results[0].cycles._fields:
        columns[name] = np.concatenate([getattr(result.cycles, name) for result in decays.results])
    return columns


def _titled(columns: dict[str, Any]) -> dict[str, Any]:
    """The columns under their names with units."""
    return {f"{name} [{unit}]" if (unit := _unit_of(name)) else name: values for name, values in columns.items()}


def _unit_of(name: str) -> str:
    for end in ("", "_error", "_noise", "_scatter", "_average_error", "_average", "_envelope"):
        if name.endswith(end) and (unit := UNITS.get(name.removesuffix(end))):
            return "-" if unit == "1" else unit
    return ""
