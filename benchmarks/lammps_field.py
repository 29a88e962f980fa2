"""Loss factor and effective mass of a 500-sphere damper against LAMMPS, at all 30 operating points of the shipped
signals.

    python benchmarks/lammps_field.py [--points N] [--json FILE]

The same bed (tests/data/lammps-packing.csv), container, contacts and motion as `graindamp/data/demo-signals.h5`; both
sets of signals go through the same analysis. Prints every point, and chi-square over all of them: the sum of the
squared differences over the squared combined standard errors, for loss factor and effective mass ratio."""

import argparse
import json
from importlib.resources import as_file, files
from pathlib import Path

import numpy as np

from graindamp import measure
from graindamp.dem.packing_store import Packing
from graindamp.dem.run import Run
from graindamp.dem.simulate import simulate
from graindamp.signals.power import OperatingPoint
from graindamp.signals.simulated import point_of
from graindamp.spec.measurement import MeasurementSpec
from graindamp.spec.model import parse_spec
from graindamp.spec.simulation import SimulationSpec

ROOT = Path(__file__).parents[1]
LENGTH, RADIUS, HEIGHT = 0.0448971, 0.015, 0.041897
GRAVITY = 9.81
STUFF = {"name": "soft steel", "youngs_modulus": 2e9, "poisson_ratio": 0.3, "density": 7900.0}


def spec_of(frequency: float, intensity: float, cycles: int = 30) -> SimulationSpec:
    """One point of the LAMMPS field; its intensities are multiples of 9.81 m/s^2."""
    wall = {**STUFF, "name": "wall"}
    return parse_spec(
        {
            "damper": {
                "gravity": [0.0, 0.0, -GRAVITY],
                "particles": [{"material": STUFF, "radius": 0.002}],
                "fill": {"count": 500},
                "container": {"kind": "cylinder", "radius": RADIUS, "length": LENGTH, "axis": "x", "material": wall},
                "contact": {
                    "law": "hertz-viscoelastic",
                    "tension": True,
                    "tangential": "mindlin",
                    "tangential_dashpot": 1.0,
                    "restitution": 0.7,
                    "friction": 0.2,
                },
            },
            "motion": {
                "kind": "harmonic",
                "frequency": frequency,
                "intensity": f"{intensity * GRAVITY} m/s^2",
                "direction": "x",
            },
            "run": {"cycles": cycles, "settle": 0.05, "time_step": 1.5e-6},
        },
        SimulationSpec,
        where="benchmark",
    )


def lammps_bed() -> Packing:
    """The bed that LAMMPS started from."""
    position = np.loadtxt(ROOT / "tests" / "data" / "lammps-packing.csv", delimiter=",", skiprows=1)
    n = len(position)
    return Packing(
        position=position,
        radius=np.full(n, 0.002),
        component=np.zeros(n, np.int32),
        height=HEIGHT,
        poured_height=HEIGHT,
        top=HEIGHT,
        solid_fraction=0.566,
        lid_height=LENGTH,
        clearance=LENGTH - HEIGHT,
        tap_cycles=0,
        seconds=0.0,
    )


def reference() -> list[OperatingPoint]:
    """What the analysis makes of the LAMMPS signals."""
    with as_file(files("graindamp") / "data" / "demo-signals.h5") as path:
        return list(measure(MeasurementSpec(files=(str(path),))).points)


def compare(theirs: OperatingPoint) -> dict[str, float]:
    """Both codes at one operating point, differences in combined standard errors."""
    intensity = theirs.nominal_intensity or 0.0
    run: Run = simulate(spec_of(theirs.frequency, intensity), packing=lammps_bed())
    ours = point_of(run)
    row = {
        "frequency_hz": theirs.frequency,
        "intensity": intensity,
        "eta": ours.loss_factor,
        "eta_error": ours.loss_factor_error,
        "eta_lammps": theirs.loss_factor,
        "eta_lammps_error": theirs.loss_factor_error,
        "mass": ours.effective_mass_ratio,
        "mass_error": ours.effective_mass_ratio_error,
        "mass_lammps": theirs.effective_mass_ratio,
        "mass_lammps_error": theirs.effective_mass_ratio_error,
        "seconds": run.seconds,
    }
    for name in ("eta", "mass"):
        error = np.hypot(row[f"{name}_error"], row[f"{name}_lammps_error"])
        row[f"{name}_z"] = (row[name] - row[f"{name}_lammps"]) / error
    return row


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--points", type=int, default=30, help="how many of the 30 points")
    parser.add_argument("--json", type=Path, help="write the rows to this file")
    arguments = parser.parse_args()
    rows = []
    print("  f [Hz]  Gamma      eta            eta LAMMPS       z      m'             m' LAMMPS        z     [s]")
    for theirs in reference()[: arguments.points]:
        r = compare(theirs)
        rows.append(r)
        print(
            f"{r['frequency_hz']:8.1f} {r['intensity']:6.1f}  {r['eta']:7.4f} ± {r['eta_error']:.4f} "
            f"{r['eta_lammps']:7.4f} ± {r['eta_lammps_error']:.4f} {r['eta_z']:6.2f}  "
            f"{r['mass']:7.4f} ± {r['mass_error']:.4f} {r['mass_lammps']:7.4f} ± {r['mass_lammps_error']:.4f} "
            f"{r['mass_z']:6.2f} {r['seconds']:6.1f}",
            flush=True,
        )
    for name in ("eta", "mass"):
        z = np.array([r[f"{name}_z"] for r in rows])
        print(f"chi-square of {name}: {np.sum(z**2):.1f} over {len(z)} points; largest |z| {np.abs(z).max():.2f}")
    if arguments.json:
        arguments.json.write_text(json.dumps(rows, indent=1))


if __name__ == "__main__":
    main()
