"""The main job on shipped data."""

from collections.abc import Callable
from importlib.resources import as_file, files
from pathlib import Path
from typing import Any

from graindamp.couple.predict import Prediction, predict
from graindamp.errors import InputError
from graindamp.field.measured import measure
from graindamp.field.store import write_field
from graindamp.report.document import measurement_document, prediction_document
from graindamp.report.prediction import Files, write_prediction
from graindamp.spec.measurement import MeasurementSpec
from graindamp.spec.model import load_spec
from graindamp.spec.project import ProjectSpec


def run_demo(folder: Path, progress: Callable[[str], None]) -> tuple[Files, Prediction, dict[str, Any]]:
    """Signals of 500 spheres to a field, the field on a beam, the damping into `folder`.

    The folder also gets field.nc and project.toml, so that `graindamp predict` can repeat and vary the second half.

    Raises:
        InputError: the folder cannot be written.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{folder}: cannot be made ({error.strerror or error})") from None
    data = files("graindamp") / "data"
    with as_file(data / "demo-signals.h5") as signals:
        spec = MeasurementSpec(
            files=(str(signals),),
            name="500 spheres",
            description="500 spheres of 2 mm radius in a cylinder lying along the motion, gravity across it",
            clearance=3.0e-3,
        )
        measurement = measure(spec, progress=lambda k, n, label: progress(f"signals: {k} of {n} records {label}"))
    write_field(measurement.field, folder / "field.nc")
    text = (data / "demo-project.toml").read_text(encoding="utf-8")
    (folder / "project.toml").write_text(text, encoding="utf-8")
    project = load_spec(folder / "project.toml", ProjectSpec)
    prediction = predict(project, folder, progress)
    written = write_prediction(prediction, folder, text, measurement, progress)
    document = prediction_document(prediction) | {"measurement": measurement_document(measurement)}
    return written, prediction, document
