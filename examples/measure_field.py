"""Force and velocity of a shaken damper to its effective field: the best operating point, and a map of the field."""

from importlib.resources import as_file, files
from pathlib import Path

import numpy as np

import graindamp as gd
from graindamp.report import figures


def main(folder: Path = Path()) -> float:
    """Write field.nc and field.png into `folder`; return the largest loss factor [-]."""
    with as_file(files("graindamp") / "data" / "demo-signals.h5") as signals:
        spec = gd.MeasurementSpec(files=(str(signals),), name="500 spheres", clearance=3.0e-3)
        measurement = gd.measure(spec)
    gd.write_field(measurement.field, folder / "field.nc")
    picture = figures.save(figures.field_map(measurement.field), folder / "field.png")

    for point in measurement.points:
        for problem in point.problems:
            print(f"{point.label}: {problem.text}")
    best = max(measurement.points, key=lambda point: point.loss_factor)
    stroke = best.velocity_amplitude / (2 * np.pi * best.frequency)
    print(
        f"largest loss factor: {best.loss_factor:.3f} ± {best.loss_factor_error:.3f} at {best.frequency:g} Hz, "
        f"intensity {best.intensity:.1f}, stroke {1e3 * stroke:.2f} mm; field drawn in {picture}"
    )
    return best.loss_factor


if __name__ == "__main__":
    main()
