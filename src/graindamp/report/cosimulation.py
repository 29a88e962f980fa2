"""Results of structure and particles simulated together, as tables, JSON and files."""

from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from matplotlib.figure import Figure

import graindamp
from graindamp.couple.cosimulate import CoRun
from graindamp.errors import InputError
from graindamp.report import cosimulation_figures, decay_figures
from graindamp.report.document import status_names
from graindamp.report.figures import save
from graindamp.report.ledger import LOSSES
from graindamp.report.page import Section, write_page
from graindamp.report.plain import plain as as_plain
from graindamp.report.tables import Table
from graindamp.report.wording import plain, softened
from graindamp.report.written import Files, write_columns, write_document
from graindamp.signals.decay import Decay, analyze_decay
from graindamp.signals.decay_record import DecayRecord
from graindamp.signals.decay_repeats import combine
from graindamp.status import describe

LEAST_CLOSURE = 1e-3
"""Share of the energy that may be unexplained before it is said [-]."""


class CoResult(NamedTuple):
    """A run and what was found in it."""

    run: CoRun
    points: tuple[str, ...]
    """Points whose motion is shown."""
    decay: Decay | None
    """Free decay of the first point; None where forces act, or where none was found."""
    warnings: tuple[str, ...]
    """What to know before the numbers are used, a line each."""


def examine(run: CoRun, points: tuple[str, ...]) -> CoResult:
    """Look for a free decay, and for what a user should know."""
    warnings = list(describe(run.status))
    worst = float(np.abs(run.residual).max())
    if worst > LEAST_CLOSURE:
        warnings.append(f"{100 * worst:.2g} % of the energy is not accounted for; raise steps_per_contact")
    warnings += softened(one.damper.contact.softening for one in run.case.dampers)
    decay = None
    if not run.case.forces and run.case.q is not None:
        rate = 1.0 / (run.time[1] - run.time[0])
        try:
            decay = analyze_decay(DecayRecord(run.velocity(points[0]), "velocity", rate, points[0], points[0]))
            warnings += [*decay.warnings, "standard errors are those of one run; other beds (packing.seed) differ too"]
        except InputError as error:
            warnings.append(f"no free decay was found: {error}")
    return CoResult(run, points, decay, tuple(warnings))


def run_table(result: CoResult) -> Table:
    """What was computed."""
    run = result.run
    n_particle = sum(len(packing.radius) for packing in run.packings)
    rows = [
        ("beds", ", ".join(f"{1e3 * mass:.4g} g" for mass in run.bed_mass)),
        ("particles", str(n_particle)),
        ("time followed", plain(run.n_step * run.time_step, 4, "s")),
        ("time step", plain(1e6 * run.time_step, 3, "µs")),
        ("fastest impact", plain(run.largest_speed, 3, "m/s")),
        ("largest overlap", f"{100 * float(run.largest_overlap.max()):.2g} % of a radius"),
        (
            "computed in",
            f"{run.seconds:.1f} s, {n_particle * run.n_step / max(run.seconds, 1e-9):.2g} particle-steps/s",
        ),
        ("energy not accounted for", f"{100 * float(np.abs(run.residual).max()):.2g} %, at most"),
    ]
    return Table("Run", ("", ""), tuple(rows))


def energy_table(result: CoResult) -> Table:
    """Where the energy went."""
    run = result.run
    given = run.structure_energy[0] + run.forced[-1]
    entries = [("structure at the start", run.structure_energy[0]), ("work of the forces", run.forced[-1])]
    for name, words in LOSSES.items():
        entries.append((words, sum(getattr(bed, name) for bed in run.energy[-1])))
    entries.append(("damping of the structure", run.damped[-1]))
    entries.append(("structure at the end", run.structure_energy[-1]))
    gain = sum(b.stored - a.stored for a, b in zip(run.energy[0], run.energy[-1], strict=True))
    entries.append(("gain of the particles", gain))
    rows = tuple(
        (words, plain(1e3 * float(value), 4), f"{100 * float(value) / given:.1f}" if given > 0.0 else "–")
        for words, value in entries
        if value != 0.0
    )
    return Table("Energy", ("", "[mJ]", "share of start and forces [%]"), rows)


def cosimulation_document(result: CoResult) -> dict[str, Any]:
    """The result as a plain document, SI units."""
    run = result.run
    end = {name: sum(getattr(bed, name) for bed in run.energy[-1]) for name in LOSSES}
    document: dict[str, Any] = {
        "graindamp_version": graindamp.__version__,
        "status": run.status,
        "status_names": status_names(run.status),
        "warnings": list(result.warnings),
        "dampers": [
            {"point": carried.point, "bed_mass": mass, "n_particle": len(packing.radius)}
            for carried, mass, packing in zip(run.case.dampers, run.bed_mass, run.packings, strict=True)
        ],
        "time_step": run.time_step,
        "n_step": run.n_step,
        "seconds": run.seconds,
        "energy": {
            "structure_start": run.structure_energy[0],
            "structure_end": run.structure_energy[-1],
            "forced": run.forced[-1],
            "damped": run.damped[-1],
            **end,
            "residual": np.abs(run.residual).max(),
        },
        "points": {
            point: {
                "largest_displacement": np.abs(run.displacement(point)).max(),
                "largest_velocity": np.abs(run.velocity(point)).max(),
            }
            for point in result.points
        },
        "units": {"mass": "kg", "time": "s", "energy": "J", "displacement": "m", "velocity": "m/s", "residual": "-"},
        "decay": None,
    }
    if result.decay is not None:
        decay = result.decay
        document["decay"] = {
            "frequency": decay.frequency,
            "damping_ratio": decay.damping_ratio,
            "cycles": decay.cycles._asdict(),
        }
    plain_document: dict[str, Any] = as_plain(document)
    return plain_document


def write_cosimulation(
    result: CoResult, folder: Path, title: str, inputs: str, progress: Callable[[str], None] = lambda text: None
) -> Files:
    """Write report.html, result.json, motion.csv, energies.csv and the figures into `folder`.

    Args:
        result: the results.
        folder: made if it is not there.
        title: heading of the page.
        inputs: what was given, shown in the page.
        progress: told what is being drawn.

    Raises:
        InputError: a file cannot be written.
    """
    run, pictures = result.run, []

    def picture(name: str, figure: Figure) -> Path:
        progress(f"drawing {name}")
        pictures.append(save(figure, folder / f"{name}.png"))
        return pictures[-1]

    of_motion = picture("motion", cosimulation_figures.motion(run, result.points))
    of_energy = picture("energies", cosimulation_figures.energies(run))
    sections = []
    if result.decay is not None:
        curve = combine([result.decay])
        of_damping = picture("damping", decay_figures.damping([result.decay], curve))
        of_frequency = picture("frequency", decay_figures.frequency([result.decay], curve))
        sections.append(
            Section(
                "Damping",
                f"Free decay of {result.points[0]}. Ψ is the share of the energy that a cycle takes.",
                (),
                ((of_damping, "Damping over amplitude."), (of_frequency, "Frequency and damping ratio.")),
            )
        )
    sections += [
        Section("Motion", "", (run_table(result),), ((of_motion, "Motion of the points, and force of the beds."),)),
        Section("Energy", "", (energy_table(result),), ((of_energy, "Where the energy is and where it went."),)),
    ]
    tables = (
        write_columns(_motion_columns(result), folder / "motion.csv"),
        write_columns(_energy_columns(run), folder / "energies.csv"),
    )
    document = write_document(cosimulation_document(result), folder / "result.json")
    page = write_page(folder / "report.html", title, sections, result.warnings, inputs)
    return Files(page, document, tables, tuple(pictures))


def _motion_columns(result: CoResult) -> dict[str, Any]:
    run = result.run
    columns: dict[str, Any] = {"time [s]": run.time}
    for point in result.points:
        columns[f"{point} velocity [m/s]"] = run.velocity(point)
        columns[f"{point} displacement [m]"] = run.displacement(point)
    for number, carried in enumerate(run.case.dampers):
        columns[f"{carried.point} force [N]"] = run.force[:, number] @ np.asarray(carried.direction)
    return columns


def _energy_columns(run: CoRun) -> dict[str, Any]:
    columns: dict[str, Any] = {
        "time [s]": run.energy_time,
        "structure [J]": run.structure_energy,
        "work of forces [J]": run.forced,
        "damping of the structure [J]": run.damped,
        "particles [J]": np.array([sum(bed.stored for bed in beds) for beds in run.energy]),
    }
    for name, words in LOSSES.items():
        columns[f"{words} [J]"] = np.array([sum(getattr(bed, name) for bed in beds) for beds in run.energy])
    return columns
