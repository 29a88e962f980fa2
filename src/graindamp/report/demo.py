"""The main job from end to end: a damper is simulated, put on a beam, and reported."""

from collections.abc import Callable
from importlib.resources import as_file, files
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from graindamp.couple.predict import Prediction, predict
from graindamp.errors import InputError
from graindamp.field.measured import measure
from graindamp.field.schema import places_of
from graindamp.field.store import write_field
from graindamp.report.document import measurement_document, prediction_document
from graindamp.report.page import Section
from graindamp.report.prediction import Files, write_prediction
from graindamp.report.tables import Table
from graindamp.report.wording import with_error
from graindamp.spec.field import FieldSpec
from graindamp.spec.measurement import MeasurementSpec
from graindamp.spec.model import load_spec
from graindamp.spec.project import ProjectSpec

if TYPE_CHECKING:
    import xarray as xr

    from graindamp.campaign.run import FieldRun
    from graindamp.dem.run import Run

FILM_CYCLES = 5
"""Cycles of the film, from rest [-]."""

FILM_FRAMES = 16
"""Pictures per cycle [-]."""

Progress = Callable[[str], None]


def run_demo(folder: Path, progress: Progress) -> tuple[Files, Prediction, dict[str, Any]]:
    """Simulate a damper of 300 spheres, put its field on a beam, and write the damping into `folder`.

    The folder also gets damper.toml, store/, field.nc and project.toml, so that `graindamp field` and `graindamp
    predict` can repeat and vary both halves. Points that the store holds are not computed again.

    Raises:
        InputError: the folder cannot be written, or scikit-learn is missing.
    """
    _make(folder)
    damper = _copied("demo-damper.toml", folder / "damper.toml")
    spec = load_spec(damper, FieldSpec)
    found = _simulated(spec, damper, folder, progress)
    write_field(found.field, folder / "field.nc")
    write_field(found.points, folder / "field.points.nc")
    path = _copied("demo-project.toml", folder / "project.toml")
    prediction = predict(load_spec(path, ProjectSpec), folder, progress)
    opening = _simulation_section(spec, found, prediction, folder, progress)
    text = damper.read_text(encoding="utf-8") + "\n" + path.read_text(encoding="utf-8")
    simulation: dict[str, Any] = {
        "points": found.points.sizes["point"],
        "computed": found.n_computed,
        "particle_steps": float(found.points["particle_steps"].sum()),
    }
    more = {"simulation": simulation}
    written = write_prediction(prediction, folder, text, progress=progress, opening=(opening,), more=more)
    return written, prediction, prediction_document(prediction) | more


def run_measured_demo(folder: Path, progress: Progress) -> tuple[Files, Prediction, dict[str, Any]]:
    """As :func:`run_demo` from the shipped signals of a shaken damper of 500 spheres.

    Raises:
        InputError: the folder cannot be written.
    """
    _make(folder)
    with as_file(files("graindamp") / "data" / "demo-signals.h5") as signals:
        spec = MeasurementSpec(
            files=(str(signals),),
            name="500 spheres",
            description="500 spheres of 2 mm radius in a cylinder lying along the motion, gravity across it",
            clearance=3.0e-3,
        )
        measurement = measure(spec, progress=lambda k, n, label: progress(f"signals: {k} of {n} records {label}"))
    write_field(measurement.field, folder / "field.nc")
    path = _copied("demo-project.toml", folder / "project.toml")
    prediction = predict(load_spec(path, ProjectSpec), folder, progress)
    written = write_prediction(prediction, folder, path.read_text(encoding="utf-8"), measurement, progress)
    document = prediction_document(prediction) | {"measurement": measurement_document(measurement)}
    return written, prediction, document


def _make(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{folder}: cannot be made ({error.strerror or error})") from None


def _copied(name: str, target: Path) -> Path:
    """A shipped description in the folder of the demo."""
    target.write_text((files("graindamp") / "data" / name).read_text(encoding="utf-8"), encoding="utf-8")
    return target


def _simulated(spec: FieldSpec, project: Path, folder: Path, progress: Progress) -> "FieldRun":
    """The field of the damper, on all cores of this machine."""
    from graindamp.campaign.executors import executor_of
    from graindamp.campaign.run import run_field
    from graindamp.campaign.store import Store
    from graindamp.report.field_progress import line_of

    progress("simulating the damper (compiling the engine first, once)")
    with Store(folder / "store") as store:
        crew = executor_of("processes")
        now = True
        try:
            found = run_field(spec, store, crew, project=project, watch=lambda outlook: progress(line_of(outlook)))
            now = False
            return found
        finally:
            crew.shutdown(now=now)


def _simulation_section(
    spec: FieldSpec, found: "FieldRun", prediction: Prediction, folder: Path, progress: Progress
) -> Section:
    """How the bed moves: map of the modes, and a film where the strongest force drives the first mode that it can."""
    from graindamp.report import figures
    from graindamp.report.field_run import accuracy_text
    from graindamp.report.mode_figures import energy_path, mode_map
    from graindamp.report.motion_picture import animate

    progress("drawing modes")
    modes = figures.save(mode_map(found.field, points=found.points), folder / "modes.png")
    pictures = [(modes, "Loss factor, and how the bed moves; letters: points simulated; lines: constant stroke.")]
    place = _filmed(prediction)
    if place is not None:
        f, gamma = place
        progress(f"simulating {f:.4g} Hz, {gamma:.3g} g for a film")
        run = _film_run(spec, f, gamma, folder)
        film = animate(run, folder / "motion.gif", "gif", lambda done: progress(f"filming: {100 * done:.0f} %"))
        pictures.append((film, f"The bed at {f:.4g} Hz and {gamma:.3g} g, where it works on the beam's first mode."))
        pictures.append((figures.save(energy_path(run), folder / "energy-path.png"), "Where its energy goes."))
    text = (
        f"{found.points.sizes['point']} operating points were simulated, each until its standard error was small "
        "enough, and chosen where a Gaussian process knew least for what they cost. Between them stands its prediction."
    )
    if found.verdict is not None:
        text += f" Its {accuracy_text(found.verdict)}."
    return Section("Simulation", text, (_points_table(found.points),), tuple(pictures))


def _filmed(prediction: Prediction) -> tuple[float, float] | None:
    """Frequency [Hz] and intensity [-] of the first mode that has a stable equilibrium, under the strongest force."""
    for mode in prediction.modes[-1]:
        for state in mode.result.equilibria:
            if state.is_stable and np.isfinite(state.intensity[0]):
                return state.frequency, float(state.intensity[0])
    return None


def _film_run(spec: FieldSpec, frequency: float, intensity: float, folder: Path) -> "Run":
    """A short run with snapshots."""
    from graindamp.dem.simulate import simulate

    point = spec.at(frequency, intensity)
    more = {"cycles": float(FILM_CYCLES), "snapshots_per_cycle": FILM_FRAMES}
    return simulate(point.model_copy(update={"run": point.run.model_copy(update=more)}), folder=folder)


def _points_table(points: "xr.Dataset") -> Table:
    """The points simulated, by frequency and intensity."""
    from graindamp.signals.motion_modes import NAMES, MotionMode

    f, gamma = places_of(points)
    rows = []
    for k in np.lexsort((gamma, f)):
        one = points.isel(point=int(k))
        mode = NAMES[MotionMode(int(one["motion_mode"]))] if "motion_mode" in points else "–"
        eta = with_error(float(one["loss_factor"]), float(one["loss_factor_se"]))
        ratio = with_error(float(one["effective_mass_ratio"]), float(one["effective_mass_ratio_se"]))
        rows.append((f"{f[k]:.4g}", f"{gamma[k]:.3g}", eta, ratio, f"{int(one['n_cycles'])}", mode))
    return Table(
        "Simulated operating points", ("f [Hz]", "Γ [-]", "η [-]", "m′ [-]", "cycles [-]", "motion"), tuple(rows)
    )
