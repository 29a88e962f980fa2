"""A damper on a free-free beam: damping of the first mode over the driving force, and where it is lowest."""

from importlib.resources import as_file, files
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import graindamp as gd


def main(folder: Path = Path()) -> float:
    """Write field.nc and beam.png into `folder`; return the lowest damping ratio of mode 1 from 1 to 50 N [-]."""
    data = files("graindamp") / "data"
    with as_file(data / "demo-signals.h5") as signals:
        measurement = gd.measure(gd.MeasurementSpec(files=(str(signals),), name="500 spheres"))
    gd.write_field(measurement.field, folder / "field.nc")
    with as_file(data / "demo-project.toml") as file:
        project = gd.load_spec(file, gd.ProjectSpec)
    # The same beam and damper, with a force study of our own in place of the other results.
    forces = np.geomspace(1.0, 50.0, 40)
    study_only = {"response": None, "position_study": None, "force_study": tuple(forces.tolist())}
    prediction = gd.predict(project.model_copy(update=study_only), folder)

    solved = [modes[0] for modes in prediction.studies[0].predictions]
    ratio = np.array([mode.stable[0].damping_ratio for mode in solved])
    error = np.array([mode.stable[0].damping_ratio_se for mode in solved])
    lowest = int(np.argmin(ratio))

    figure = Figure(figsize=(6, 4), layout="constrained")
    axes = figure.subplots()
    axes.semilogx(forces, 100 * ratio)
    axes.fill_between(forces, 100 * (ratio - error), 100 * (ratio + error), alpha=0.3)
    axes.axhline(100 * solved[0].efficient_damping_ratio, color="black", ls="--", label="η = 1")
    axes.axhline(100 * solved[0].bare_damping_ratio, color="gray", label="beam alone")
    axes.set(xlabel="force [N]", ylabel="damping ratio of mode 1 [%]", ylim=(0, None))
    axes.legend(loc="center right")
    figure.savefig(folder / "beam.png", dpi=130)
    value = f"{100 * ratio[lowest]:.3f} ± {100 * error[lowest]:.3f} %"
    print(f"mode 1: lowest damping ratio {value} at {forces[lowest]:.1f} N")
    return float(ratio[lowest])


if __name__ == "__main__":
    main()
