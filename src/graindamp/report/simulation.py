"""All that is written about a simulated run: document, run file, signals, figures, page."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from matplotlib.figure import Figure

import graindamp
from graindamp.errors import InputError
from graindamp.report import mode_figures, motion_picture, simulation_figures
from graindamp.report.document import status_names
from graindamp.report.figures import save
from graindamp.report.ledger import Ledger, ledger_of, ledger_table
from graindamp.report.page import Section, write_page
from graindamp.report.plain import plain
from graindamp.report.run_file import save_run
from graindamp.report.signal_files import write_signals, write_uff
from graindamp.report.tables import Table, points_table
from graindamp.report.wording import plain as digits
from graindamp.report.wording import softened
from graindamp.signals.motion_modes import NAMES, ModeVerdict, classify
from graindamp.signals.power import OperatingPoint
from graindamp.signals.simulated import (
    bed_mass_of,
    cycle_values,
    label_of,
    nominal_intensity_of,
    point_of,
    record_of,
    status_of,
)
from graindamp.spec.simulation import SimulationSpec
from graindamp.status import Status, describe

if TYPE_CHECKING:
    from graindamp.dem.packing_store import Packing
    from graindamp.dem.run import Run

DOCUMENT, RUN, SIGNALS, UNIVERSAL, PAGE = "result.json", "run.h5", "signals.h5", "signals.uff", "report.html"
PICTURES = (
    "bed",
    "snapshot",
    "signals",
    "cycles",
    "stirring",
    "energy",
    "energy-path",
    "velocity-field",
    "impacts",
)
"""Names of the figures, each a PNG."""
_OURS = "graindamp_version"


class Simulated(NamedTuple):
    """A run and what was found in it."""

    run: "Run"
    point: OperatingPoint
    """Loss factor and effective mass; of a motion without cycles all NaN."""
    ledger: Ledger | None
    status: Status
    """Bits of the engine and of the signals."""
    warnings: tuple[str, ...]
    """What to know before the numbers are used, a line each."""

    @property
    def verdict(self) -> ModeVerdict:
        """Motion mode and why, over the cycles that the values are means of."""
        return classify(self.run, self.point.n_skipped)


class Files(NamedTuple):
    """Where a run was written."""

    folder: Path
    page: Path
    document: Path
    run: Path
    signals: Path
    others: tuple[Path, ...]
    """Universal file, film, list for ParaView, as asked for."""
    pictures: tuple[Path, ...]


class Wanted(NamedTuple):
    """What is written on request."""

    uff: bool = False
    film: motion_picture.Format | None = None
    vtk: bool = False


SETTLING = 0.2
"""Share of stored energy in what is dissipated above which a bed counts as still settling [-]. A steady bed has a
percent or less; a fifth is a loss factor that is wrong by as much."""


def examine(run: "Run") -> Simulated:
    """Loss factor, effective mass, energies and warnings of a run."""
    point = point_of(run) if run.frequency is not None else OperatingPoint(label_of(run.spec), float("nan"))
    status = status_of(run, point)
    warnings = describe(run.status)
    warnings += [f"{point.label}: {problem.text}" for problem in point.problems]
    warnings += softened([run.spec.damper.contact.softening])
    ledger = ledger_of(run, point.n_skipped)
    if run.frequency is not None and ledger is not None:
        lost = sum(ledger.losses.values())
        if -ledger.stored > SETTLING * lost > 0.0:
            share = f"{-100.0 * ledger.stored / lost:.0f} %"
            warnings.append(
                f"the bed still settles: {share} of what was dissipated was stored in it before, no work of the "
                "container; simulate more cycles"
            )
    if status & Status.INTERRUPTED:
        text = f"PARTIAL RESULT: the run was stopped after {_length(run)} of {_planned(run.spec)}"
        warnings = [text, *(line for line in warnings if not line.startswith("INTERRUPTED"))]
    return Simulated(run, point, ledger, status, tuple(warnings))


def _length(run: "Run") -> str:
    time = run.n_step * run.time_step
    return f"{time:.4g} s" if run.frequency is None else f"{time * run.frequency:.4g} cycles"


def _planned(spec: SimulationSpec) -> str:
    if spec.duration is None:
        return "its motion"
    return f"{spec.duration:.4g} s" if spec.base_frequency is None else f"{spec.duration * spec.base_frequency:.4g}"


def claim(folder: Path, wanted: Wanted) -> None:
    """Make sure before a long run that its files can be written, and that none of somebody else is lost.

    A folder with a result.json of ours is ours; in any other folder no file of the names needed may exist.

    Raises:
        InputError: it holds such a file, or cannot be written.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        probe = folder / ".graindamp-probe"
        probe.touch()
        probe.unlink()
    except OSError as error:
        reason = error.strerror or error
        raise InputError(f"{folder}: cannot be written ({reason}); choose another with --out") from None
    if _is_ours(folder / DOCUMENT):
        return
    names = [DOCUMENT, RUN, SIGNALS, UNIVERSAL, PAGE, *(f"{name}.png" for name in PICTURES)]
    names += [f"motion.{wanted.film}"] if wanted.film else []
    names += ["vtk"] if wanted.vtk else []
    taken = [name for name in names if (folder / name).exists()]
    if taken:
        raise InputError(
            f"{folder}: holds {', '.join(taken)}, not written by 'graindamp simulate'; choose another folder with --out"
        )


def _is_ours(document: Path) -> bool:
    try:
        content = json.loads(document.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return False
    return isinstance(content, dict) and _OURS in content and content.get("kind") == "simulation"


def write_simulation(
    result: Simulated,
    folder: Path,
    inputs: str,
    wanted: Wanted | None = None,
    progress: Callable[[str], None] = lambda text: None,
) -> Files:
    """Write everything about a run into `folder`; the numbers first, pictures after them.

    Args:
        result: the run and what was found in it.
        folder: made if it is not there.
        inputs: text of the project, shown in the page.
        wanted: what is asked for beside the rest.
        progress: told what is being written.

    Raises:
        InputError: a file cannot be written; there are no snapshots for a film.
    """
    wanted = Wanted() if wanted is None else wanted
    run = result.run
    target = folder / DOCUMENT
    try:
        folder.mkdir(parents=True, exist_ok=True)
        target.write_text(json.dumps(simulation_document(result), indent=1) + "\n", encoding="utf-8")
    except OSError as error:
        raise InputError(f"{target}: cannot be written ({error.strerror or error})") from None
    progress("writing the run")
    stored = save_run(run, folder / RUN)
    record = record_of(run)
    signals = write_signals(record, folder / SIGNALS)
    others = [write_uff(record, folder / UNIVERSAL)] if wanted.uff else []
    pictures, sections = draw_all(result, folder, progress)
    page = write_page(folder / PAGE, run.spec.title, sections, result.warnings, inputs)
    if wanted.vtk:
        from graindamp.report.vtk_files import write_vtk

        progress("writing files for ParaView")
        others.append(write_vtk(run, folder / "vtk"))
    if wanted.film:
        name = f"motion.{wanted.film}"
        report = _percent(progress, f"filming {name}")
        others.append(motion_picture.animate(run, folder / name, wanted.film, report))
    return Files(folder, page, target, stored, signals, tuple(others), pictures)


def _percent(progress: Callable[[str], None], what: str) -> Callable[[float], None]:
    return lambda done: progress(f"{what}: {100.0 * done:.0f} %")


def draw_all(
    result: Simulated, folder: Path, progress: Callable[[str], None] = lambda text: None
) -> tuple[tuple[Path, ...], list[Section]]:
    """Draw every figure that the run has data for; their files, and the sections of a page with them."""
    run, point = result.run, result.point
    drawn: dict[str, Path] = {}

    def picture(name: str, figure: Figure) -> tuple[Path, str]:
        progress(f"drawing {name}")
        drawn[name] = save(figure, folder / f"{name}.png")
        return drawn[name], _CAPTIONS[name]

    bed = [picture("bed", motion_picture.packing_figure(run.spec, run.packing, run.enclosure, run.direction))]
    if run.snapshots:
        bed.append(picture("snapshot", motion_picture.snapshot_figure(run)))
    moving = [picture("signals", simulation_figures.signals(run, point))] if len(run.time) > 1 else []
    if len(run.cycle_force):
        moving.append(picture("cycles", simulation_figures.cycles(run, point)))
    modes = []
    if run.stirring is not None:
        modes.append(picture("stirring", simulation_figures.stirring(run, result.verdict)))
    spent = [picture("energy", simulation_figures.energy(run))] if len(run.energy) > 1 else []
    if result.ledger is not None and result.ledger.throughput > 0.0:
        spent.append(picture("energy-path", mode_figures.energy_path(run, point.n_skipped)))
    inside = [picture("impacts", simulation_figures.impacts(run))] if np.any(run.impact_counts) else []
    if run.velocity_field is not None:
        inside.insert(0, picture("velocity-field", motion_picture.velocity_figure(run)))
    ledger = (ledger_table(result.ledger),) if result.ledger is not None else ()
    points = (points_table([point], [result.status]),) if point.n_cycle else ()
    sections = [
        Section("Result", "", points, tuple(moving)),
        *([Section("Motion mode", "", (mode_table(result.verdict),), tuple(modes))] if modes else []),
        Section("Energy", "", ledger, tuple(spent)),
        Section("Bed", "", (packing_table(run.spec, run.packing, bed_mass_of(run)),), tuple(bed)),
        Section("Inside the bed", "", (engine_table(run),), tuple(inside)),
    ]
    return tuple(drawn.values()), sections


_CAPTIONS = {
    "bed": "The packed bed before the motion, drawn to scale; gravity as in the run.",
    "snapshot": "The last snapshot, drawn to scale.",
    "signals": "Force that drives the bed, without the container's own mass, and velocity of the container.",
    "cycles": "Loss factor and effective mass ratio of each cycle.",
    "stirring": "How the bed moves in its container, and the thresholds between motion modes.",
    "energy": "Work of the container on the bed and where it went.",
    "energy-path": "Work of the container per cycle and the mechanisms that dissipate it.",
    "velocity-field": "Mean velocity of the particles in the middle plane.",
    "impacts": "Approach speeds of all impacts.",
}


def result_table(result: Simulated) -> Table:
    """The operating point and what the run was like, a row each."""
    return points_table([result.point], [result.status])


def mode_table(verdict: ModeVerdict) -> Table:
    """The motion mode and the numbers it was judged by."""
    c = verdict.criteria
    rows = [
        ("motion mode", NAMES[verdict.mode] + (" (close to another)" if verdict.is_close else "")),
        ("kinetic energy relative to the container, over m V²/2", digits(c.relative_energy, 3)),
        ("kinetic energy in the frame at rest, over m V²/2", digits(c.absolute_energy, 3)),
        ("share of the relative energy in motion as a block", digits(c.cohesion, 3)),
        ("share of moving particles", digits(c.moving, 3)),
        ("speed of the lowest third / V", digits(c.lowest_speed, 3)),
        ("speed of the highest third / V", digits(c.highest_speed, 3)),
        ("travel of the bed / clearance", digits(c.travel, 3)),
        ("contact with an end wall, share of the cycle", digits(c.contact, 3)),
        ("impacts on both ends per cycle", digits(c.impacts, 3)),
        ("indentation of coated ends / X", digits(c.indentation, 3)),
    ]
    note = "Means over the cycles after the transient. What they mean: docs/motion-modes.md."
    return Table("Motion mode", ("", "value"), tuple(rows), note)


def packing_table(spec: SimulationSpec, packing: "Packing", mass: float) -> Table:
    """A packed bed in numbers."""
    rows = [
        ("particles", f"{len(packing.radius)}"),
        ("mass", f"{1e3 * mass:.5g} g"),
        ("bed height", f"{1e3 * packing.height:.4g} mm"),
        ("bed height as poured", f"{1e3 * packing.poured_height:.4g} mm"),
        ("solid fraction", digits(packing.solid_fraction, 4)),
        ("lid above the floor", "–" if packing.lid_height is None else f"{1e3 * packing.lid_height:.5g} mm"),
        ("clearance h", "–" if packing.clearance is None else f"{1e3 * packing.clearance:.4g} mm"),
        ("cycles of tapping", f"{packing.tap_cycles}"),
        ("time to pack", f"{packing.seconds:.3g} s"),
    ]
    return Table(f"Packed bed of {spec.damper.name}", ("", "value"), tuple(rows))


def engine_table(run: "Run") -> Table:
    """Contacts, resolution and speed of a run."""
    rows = [
        ("touching pairs per particle, mean", f"{run.contacts_per_particle:.3g}"),
        ("particles touching walls, mean", f"{run.wall_contacts:.3g}"),
        ("largest overlap between particles", f"{100 * run.largest_overlap[0]:.3g} % of a radius"),
        ("largest overlap with walls", f"{100 * run.largest_overlap[1]:.3g} % of a radius"),
        ("fastest impact", f"{run.largest_speed:.3g} m/s"),
        ("time step", f"{1e6 * run.time_step:.4g} µs"),
        ("steps in the fastest impact", f"{run.steps_per_contact:.3g}"),
        ("steps", f"{run.n_step}"),
        ("time to compute", f"{run.seconds:.3g} s"),
        ("particle-steps per second", digits(rate_of(run) / 1e6, 3, "million")),
    ]
    return Table("Contacts and computation", ("", "value"), tuple(rows))


def rate_of(run: "Run") -> float:
    """Particles times steps over computing time [1/s]."""
    return len(run.radius) * run.n_step / run.seconds if run.seconds > 0.0 else float("nan")


def packing_document(spec: SimulationSpec, packing: "Packing", mass: float) -> dict[str, Any]:
    """A packed bed as a plain document."""
    document: dict[str, Any] = plain(
        {
            _OURS: graindamp.__version__,
            "kind": "packing",
            "damper": spec.damper.name,
            "count": len(packing.radius),
            "mass": mass,
            "height": packing.height,
            "poured_height": packing.poured_height,
            "top": packing.top,
            "solid_fraction": packing.solid_fraction,
            "lid_height": packing.lid_height,
            "clearance": packing.clearance,
            "tap_cycles": packing.tap_cycles,
            "seconds": packing.seconds,
            "units": {
                "mass": "kg", "height": "m", "poured_height": "m", "top": "m", "solid_fraction": "1",
                "lid_height": "m", "clearance": "m", "seconds": "s",
            },
        }
    )  # fmt: skip
    return document


def simulation_document(result: Simulated) -> dict[str, Any]:
    """A run as a plain document: SI units, NaN as null."""
    run, point, ledger = result.run, result.point, result.ledger
    cycles, verdict = cycle_values(run), result.verdict
    energies = None
    if ledger is not None:
        n = ledger.n_cycle or 1.0
        energies = {
            "per_cycle": ledger.n_cycle is not None,
            "n_cycle": ledger.n_cycle,
            "start": ledger.start,
            "stop": ledger.stop,
            "work": ledger.work / n,
            **{name: loss / n for name, loss in ledger.losses.items()},
            "loss_total": sum(ledger.losses.values()) / n,
            "stored_gain": ledger.stored / n,
            "closure": ledger.closure / n,
            "closure_share": ledger.closure_share,
        }
    packing = packing_document(run.spec, run.packing, bed_mass_of(run))
    del packing[_OURS], packing["kind"], packing["damper"], packing["units"]
    document: dict[str, Any] = plain(
        {
            _OURS: graindamp.__version__,
            "kind": "simulation",
            "title": run.spec.title,
            "damper": run.spec.damper.name,
            "label": point.label,
            "partial": bool(result.status & Status.INTERRUPTED),
            "frequency": run.frequency,
            "intensity": point.intensity if np.isfinite(point.intensity) else nominal_intensity_of(run.spec),
            "nominal_intensity": nominal_intensity_of(run.spec),
            "direction": np.asarray(run.direction),
            "bed_mass": bed_mass_of(run),
            "eta": point.loss_factor,
            "eta_se": point.loss_factor_error,
            "m_prime": point.effective_mass_ratio,
            "m_prime_se": point.effective_mass_ratio_error,
            "dissipated_energy": point.dissipated_energy,
            "power": point.power,
            "n_cycle": point.n_cycle,
            "n_skipped": point.n_skipped,
            "motion_mode": NAMES[verdict.mode],
            "motion_mode_close": verdict.is_close,
            "motion_criteria": verdict.criteria._asdict(),
            "cycle_eta": cycles.loss_factor,
            "cycle_m_prime": cycles.effective_mass_ratio,
            "status": int(result.status),
            "status_names": status_names(result.status),
            "warnings": result.warnings,
            "energies": energies,
            "packing": packing,
            "contacts": {
                "contacts_per_particle": run.contacts_per_particle,
                "wall_contacts": run.wall_contacts,
                "largest_overlap_pairs": float(run.largest_overlap[0]),
                "largest_overlap_walls": float(run.largest_overlap[1]),
                "largest_speed": run.largest_speed,
                "impacts_pairs": int(np.sum(run.impact_counts[0])),
                "impacts_walls": int(np.sum(run.impact_counts[1])),
            },
            "timing": {
                "seconds": run.seconds,
                "n_step": run.n_step,
                "time_step": run.time_step,
                "simulated_time": run.n_step * run.time_step,
                "steps_at_fastest_impact": run.steps_per_contact,
                "particle_steps_per_second": rate_of(run),
            },
            "units": {
                "frequency": "Hz", "intensity": "1", "bed_mass": "kg", "eta": "1", "m_prime": "1",
                "dissipated_energy": "J", "power": "W", "energies": "J", "mass": "kg", "length": "m",
                "overlap": "1 (of a radius)", "speed": "m/s", "time": "s",
            },
        }
    )  # fmt: skip
    return document
