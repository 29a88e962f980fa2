"""Table 2 of Meyer & Seifried (2023): baseline and triple cross at 100 Hz, Gamma 20 and 40, for several beds.

    python table_2.py [--out FOLDER] [--seeds 3] [--cycles 40] [--softening 1] [--names baseline] [--clearance 2.8]

Full stiffness takes 5 to 12 minutes a run of 25 cycles on a free core, and as long to pack each bed. Runs that are
there already are not run again. Writes table-2.txt, and a figure of every setup that shows how the bed gets there.
"""

import argparse
from pathlib import Path

import numpy as np
from courses import WINDOW, Course, course
from matplotlib.figure import Figure
from numpy.typing import NDArray
from setups import load, small, with_contact, with_lid_at

from graindamp.dem.packing import pack
from graindamp.field.theory import stroke_ratio_min
from graindamp.report.figures import COLORS, save

FREQUENCY = 100.0
INTENSITIES = (40.0, 20.0)

PUBLISHED = {("baseline", 20.0): (0.17, 0.13), ("baseline", 40.0): (1.0, 0.98)}
"""Loss factor of test and simulation in the paper's Table 2 [-]; its other values are not available here."""

PAPER_CYCLES = 25


def runs(
    name: str, intensity: float, seeds: int, cycles: int, folder: Path, count: int, softening: float,
    clearance: float | None,
) -> list[Course]:  # fmt: skip
    """One course for every bed."""
    spec = load(name)
    spec = spec if count >= 4500 else small(spec, count)
    found = []
    for seed in range(seeds):
        packing = spec.damper.packing.model_copy(update={"seed": seed})
        # The bed is packed at full stiffness whatever it is run with, so that it is packed once.
        bed = pack(with_contact(spec, softening=1.0).damper.model_copy(update={"packing": packing}))
        bed = bed if clearance is None else with_lid_at(bed, clearance)
        one = with_contact(spec, softening=softening)
        found.append(course(one, FREQUENCY, intensity, folder, name, cycles=cycles, seed=seed, packing=bed))
        print(line_of(found[-1]), flush=True)
    return found


def over(one: Course, first: int) -> float:
    """Mean loss factor from a cycle to the last that the paper simulates [-]."""
    return float(np.mean(one.cycle_loss_factor[first:PAPER_CYCLES]))


def line_of(one: Course) -> str:
    """A line of the table for one bed."""
    return (
        f"{one.label:12s} Gamma {one.intensity:2.0f} bed {one.seed}: eta {one.loss_factor:6.3f} +- "
        f"{one.loss_factor_se:5.3f}{'' if one.is_steady else ' (drifts)'} after {one.n_skipped} of "
        f"{len(one.cycle_loss_factor)} cycles, {over(one, WINDOW):5.3f} over cycles {WINDOW} to {PAPER_CYCLES}, "
        f"{over(one, 0):5.3f} over the first {PAPER_CYCLES}; "
        f"held {one.held}; solid fraction {one.solid_fraction:.3f}, clearance {1e3 * one.clearance:.2f} mm, "
        f"travel {1e3 * one.travel:.2f} mm"
    )


def summary(name: str, intensity: float, found: list[Course]) -> str:
    """Means over the beds beside the paper's values: of the steady cycles, and of those that the paper simulates."""
    eta = np.array([one.loss_factor for one in found])
    inner = float(np.sqrt(np.mean([one.loss_factor_se**2 for one in found])))
    early, whole = (np.array([over(one, first) for one in found]) for first in (WINDOW, 0))
    told = PUBLISHED.get((name, intensity))
    paper = "not compared" if told is None else f"test {told[0]:g}, simulation {told[1]:g}"
    return (
        f"{name:12s} Gamma {intensity:2.0f}: eta {_with_error(eta, inner)}, from {eta.min():.3f} to {eta.max():.3f} "
        f"over {len(eta)} beds; {_with_error(early, inner)} over cycles {WINDOW} to {PAPER_CYCLES}, "
        f"{_with_error(whole, inner)} over the first {PAPER_CYCLES}; paper: {paper}"
    )


def _with_error(eta: NDArray[np.float64], inner: float) -> str:
    """Mean over beds and its standard error, that of one run where their scatter is smaller or unknown."""
    spread = float(eta.std(ddof=1)) if len(eta) > 1 else inner
    return f"{eta.mean():6.3f} +- {max(spread, inner) / np.sqrt(len(eta)):5.3f}"


def courses_figure(found: list[Course]) -> Figure:
    """Cycle by cycle: loss factor, m', and the stroke over its optimum that the travel of the bed's centre tells of."""
    figure = Figure(figsize=(9, 8), layout="constrained")
    loss, mass, ratio = figure.subplots(3, 1, sharex=True)
    for k, one in enumerate(found):
        look = {"color": COLORS[k % len(COLORS)], "marker": ".", "lw": 1}
        number = np.arange(len(one.cycle_loss_factor)) + 1
        label = f"Γ = {one.intensity:g}, bed {one.seed}, h = {1e3 * one.clearance:.2f} mm, softening {one.softening:g}"
        loss.plot(number, one.cycle_loss_factor, label=label, **look)
        mass.plot(number, one.cycle_mass_ratio, **look)
        ratio.plot(number, np.pi * one.stroke / np.array(one.cycle_travel), **look)
        ratio.axhline(one.stroke_ratio, color=look["color"], ls=":", lw=1)
    ratio.axhline(stroke_ratio_min(0.0), color="black", ls="--", lw=1, label="a plastic block needs more")
    loss.set(ylabel="loss factor η [-]", ylim=(0, None))
    mass.set(ylabel="mass ratio m′ [-]")
    ratio.set(ylabel="X / X_opt [-]: nominal (dotted), by travel", xlabel="cycle")
    loss.legend(fontsize=8)
    ratio.legend(fontsize=8)
    return figure


def main() -> None:
    """Run what is missing, print the table, draw the figures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path("meyer-seifried-2023"), help="folder of results")
    parser.add_argument("--names", nargs="+", default=["baseline", "triple-cross"], help="dampers")
    parser.add_argument("--intensities", nargs="+", type=float, default=list(INTENSITIES))
    parser.add_argument("--seeds", type=int, default=3, help="number of beds")
    parser.add_argument("--cycles", type=int, default=40)
    parser.add_argument("--softening", type=float, default=1.0, help="divisor of the stiffness")
    parser.add_argument("--clearance", type=float, default=None, help="of the packed bed [mm]; default: as described")
    parser.add_argument("--count", type=int, default=4500, help="spheres; fewer for a trial")
    asked = parser.parse_args()
    clearance = None if asked.clearance is None else 1e-3 * asked.clearance
    lines = []
    for name in asked.names:
        both = []
        for intensity in asked.intensities:
            found = runs(
                name, intensity, asked.seeds, asked.cycles, asked.out / "courses", asked.count, asked.softening,
                clearance,
            )  # fmt: skip
            both += found
            lines += [*map(line_of, found), summary(name, intensity, found)]
        print(save(courses_figure(both), asked.out / f"table-2-{name}.png"))
    (asked.out / "table-2.txt").write_text("\n".join(lines) + "\n", encoding="utf-8")
    print("\n".join(line for line in lines if "paper:" in line))


if __name__ == "__main__":
    main()
