"""Loss factor and effective mass of a 500-sphere damper against LAMMPS, at all 30 operating points of the shipped
signals.

    python benchmarks/lammps_field.py [--points N] [--frequencies F ...] [--seeds N] [--json FILE]

The same bed (tests/data/lammps-packing.csv), container, contacts and motion as `graindamp/data/demo-signals.h5`; both
sets of signals go through the same analysis. Prints every point, and chi-square over all of them: the sum of the
squared differences over the squared combined standard errors, for loss factor and effective mass ratio.

Errors from within one run are too small for beds that wander. With several seeds, beds whose first positions differ
by 10 nm and which soon have nothing in common, the scatter between runs is known as well. LAMMPS' run is one more draw
from the same distribution, if the codes agree: its spread is taken as ours, and the difference of one draw from the
mean of n has the variance s^2 (1 + 1/n). Two more chi-squares follow. In the first s is found at every point from its
own n runs; its t-value with n - 1 degrees of freedom is turned into the normal deviate of the same probability, so
that the sum is distributed as chi-square. In the second all points share one ratio of s to the errors from within."""

import argparse
import json
from importlib.resources import as_file, files
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from graindamp import measure
from graindamp.dem.packing_store import Packing
from graindamp.dem.run import Run
from graindamp.dem.simulate import simulate
from graindamp.signals.power import OperatingPoint
from graindamp.signals.simulated import point_of
from graindamp.spec.measurement import MeasurementSpec
from graindamp.spec.model import parse_spec
from graindamp.spec.simulation import SimulationSpec

Real = NDArray[np.float64]

ROOT = Path(__file__).parents[1]
LENGTH, RADIUS, HEIGHT = 0.0448971, 0.015, 0.041897
GRAVITY = 9.81
SHIFT = 1e-8
"""By which beds of different seeds differ, each coordinate at random up to this [m]; the overlaps at rest are some
micrometres."""
QUANTITIES = {"eta": "loss_factor", "mass": "effective_mass_ratio"}
STUFF = {"name": "soft steel", "youngs_modulus": 2e9, "poisson_ratio": 0.3, "density": 7900.0}


def spec_of(frequency: float, intensity: float, cycles: int = 30, settle: float = 0.05) -> SimulationSpec:
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
            "run": {"cycles": cycles, "settle": settle, "time_step": 1.5e-6},
        },
        SimulationSpec,
        where="benchmark",
    )


def lammps_bed(seed: int = 0) -> Packing:
    """The bed that LAMMPS started from; other seeds than 0 move every sphere by some nanometres."""
    position = np.loadtxt(ROOT / "tests" / "data" / "lammps-packing.csv", delimiter=",", skiprows=1)
    n = len(position)
    if seed:
        position = position + np.random.default_rng(seed).uniform(-SHIFT, SHIFT, (n, 3))
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


def compare(theirs: OperatingPoint, n_seed: int = 1, cycles: int = 30, settle: float = 0.05) -> dict[str, Any]:
    """Both codes at one operating point; `eta_z` and `mass_z` are the differences of the first run in combined
    standard errors from within the runs."""
    intensity = theirs.nominal_intensity or 0.0
    row: dict[str, Any] = {"frequency_hz": theirs.frequency, "intensity": intensity, "seconds": 0.0}
    points = []
    for seed in range(n_seed):
        run: Run = simulate(spec_of(theirs.frequency, intensity, cycles, settle), packing=lammps_bed(seed))
        points.append(point_of(run))
        row["seconds"] += run.seconds
    for name, attribute in QUANTITIES.items():
        row[f"{name}_runs"] = [float(getattr(p, attribute)) for p in points]
        row[f"{name}_run_errors"] = [float(getattr(p, f"{attribute}_error")) for p in points]
        row[name], row[f"{name}_error"] = row[f"{name}_runs"][0], row[f"{name}_run_errors"][0]
        row[f"{name}_lammps"] = float(getattr(theirs, attribute))
        row[f"{name}_lammps_error"] = float(getattr(theirs, f"{attribute}_error"))
        error = np.hypot(row[f"{name}_error"], row[f"{name}_lammps_error"])
        row[f"{name}_z"] = float((row[name] - row[f"{name}_lammps"]) / error)
    return row


class Agreement(NamedTuple):
    """Agreement of both codes over all points, in standard errors that know the scatter between runs."""

    z: Real
    """Normal deviates, each with the scatter of its own runs [-]; (point,)."""
    pooled: Real
    """Deviates with one ratio of the scatter to the errors from within for all points [-]; (point,)."""
    ratio: float
    """That ratio [-]: 1 if the errors from within a run were right."""


def agreement(rows: list[dict[str, Any]], name: str) -> Agreement:
    """Deviates of one quantity where every row holds the same number of runs, two or more."""
    runs = np.array([row[f"{name}_runs"] for row in rows])
    within = np.mean(np.array([row[f"{name}_run_errors"] for row in rows]) ** 2, axis=1)
    theirs = np.array([row[f"{name}_lammps"] for row in rows])
    their_error = np.array([row[f"{name}_lammps_error"] for row in rows])
    n = runs.shape[1]
    scatter = runs.var(axis=1, ddof=1)
    gap = runs.mean(axis=1) - theirs
    t = gap / np.sqrt(scatter * (1.0 + 1.0 / n))
    ratio = float(np.sqrt(np.mean(scatter / within)))
    pooled = gap / (ratio * np.sqrt(within / n + their_error**2))
    z = np.sign(t) * stats.norm.isf(stats.t.sf(np.abs(t), n - 1))
    return Agreement(z, pooled, ratio)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--points", type=int, default=30, help="how many of the 30 points")
    parser.add_argument("--frequencies", type=float, nargs="+", help="only points at these frequencies [Hz]")
    parser.add_argument("--json", type=Path, help="write the rows to this file")
    parser.add_argument("--seeds", type=int, default=1, help="runs at every point")
    arguments = parser.parse_args()
    rows = []
    print("  f [Hz]  Gamma      eta            eta LAMMPS       z      m'             m' LAMMPS        z     [s]")
    chosen = [p for p in reference() if arguments.frequencies is None or p.frequency in arguments.frequencies]
    for theirs in chosen[: arguments.points]:
        r = compare(theirs, arguments.seeds)
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
        if arguments.seeds > 1:
            own, pooled, ratio = agreement(rows, name)
            print(
                f"  with the scatter between runs: of each point {np.sum(own**2):.1f}, pooled {np.sum(pooled**2):.1f}; "
                f"the scatter is {ratio:.2f} times the errors from within"
            )
    if arguments.json:
        arguments.json.write_text(json.dumps(rows, indent=1))


if __name__ == "__main__":
    main()
