"""Baseline at 100 Hz, Gamma 20: beds of one description that bounce every third half cycle, or lose it and float.

    python third.py [--out FOLDER] [--seeds 1 0] [--clearance 2.8] [--cycles 50] [--softening 1] [--count 4500]

Draws third.png: place and speed of each bed's centre over the last nine cycles. Two minutes a run on a free core.
"""

import argparse
import math
from pathlib import Path
from typing import NamedTuple

import numpy as np
from courses import simulation_of
from matplotlib.figure import Figure
from numpy.typing import NDArray
from setups import load, small, with_contact, with_lid_at

from graindamp.dem.packing import pack
from graindamp.dem.simulate import simulate
from graindamp.report.figures import COLORS, save
from graindamp.signals.simulated import cycle_values
from graindamp.signals.stopping import estimate
from graindamp.spec.field import FieldSpec
from graindamp.units import STANDARD_GRAVITY

FREQUENCY, INTENSITY = 100.0, 20.0
SHOWN = 9
"""Cycles in the figure [-]."""


class Centre(NamedTuple):
    """How the centre of a bed moves."""

    seed: int
    loss_factor: float
    """eta over the steady cycles [-]."""
    loss_factor_se: float
    """Its standard error [-]."""
    cycle: NDArray[np.float64]
    """Time over the period of the motion [-]; (sample,)."""
    place: NDArray[np.float64]
    """Of the centre along the axis in the frame of the container [m]; (sample,)."""

    @property
    def stroke(self) -> float:
        """Displacement amplitude of the container [m]."""
        return INTENSITY * STANDARD_GRAVITY / (2.0 * math.pi * FREQUENCY) ** 2


def centre_of(spec: FieldSpec, seed: int, clearance: float, cycles: int) -> Centre:
    """One run from rest; the bed is packed at full stiffness under a lid at `clearance` [m]."""
    packing = spec.damper.packing.model_copy(update={"seed": seed})
    bed = pack(with_contact(spec, softening=1.0).damper.model_copy(update={"packing": packing}))
    run = simulate(simulation_of(spec, FREQUENCY, INTENSITY, cycles, seed), packing=with_lid_at(bed, clearance))
    each = cycle_values(run)
    found = estimate(each.loss_factor, each.effective_mass_ratio)
    return Centre(seed, found.loss_factor, found.loss_factor_se, run.energy_time * FREQUENCY, run.centre[:, 0])


def third_figure(found: list[Centre]) -> Figure:
    """Place and speed of the centre, a column for each bed."""
    figure = Figure(figsize=(5.5 * len(found), 6.0), layout="constrained")
    panels = figure.subplots(2, len(found), sharex=True, sharey="row", squeeze=False)
    for (place, speed), one in zip(panels.T, found, strict=True):
        last = one.cycle >= one.cycle[-1] - SHOWN
        cycle, shaken = one.cycle[last], one.stroke * np.sin(2.0 * math.pi * one.cycle)
        place.plot(cycle, 1e3 * (one.place - one.place[last].mean())[last], color=COLORS[0])
        velocity = np.gradient(one.place + shaken, one.cycle / FREQUENCY)
        speed.plot(cycle, velocity[last], color=COLORS[0], label="bed")
        walls = 2.0 * math.pi * FREQUENCY * one.stroke * np.cos(2.0 * math.pi * cycle)
        speed.plot(cycle, walls, color=COLORS[1], ls=":", label="container")
        place.set_title(f"bed {one.seed}: η = {one.loss_factor:.3f} ± {one.loss_factor_se:.3f}", fontsize=10)
        speed.set_xlabel("cycle")
        speed.set_xticks(np.arange(math.ceil(cycle[0]), cycle[-1] + 0.5))
    panels[0, 0].set_ylabel("bed's centre in the container [mm]")
    panels[1, 0].set_ylabel("speed in the frame at rest [m/s]")
    figure.legend(*panels[1, 0].get_legend_handles_labels(), fontsize=8, ncols=2, loc="outside lower center")
    return figure


def main() -> None:
    """Run, and draw the figure."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path("meyer-seifried-2023"), help="folder of results")
    parser.add_argument("--seeds", type=int, nargs="+", default=[1, 0], help="beds")
    parser.add_argument("--clearance", type=float, default=2.8, help="of the packed bed [mm]")
    parser.add_argument("--cycles", type=int, default=50)
    parser.add_argument("--softening", type=float, default=1.0, help="divisor of the stiffness")
    parser.add_argument("--count", type=int, default=4500, help="spheres; fewer for a trial")
    asked = parser.parse_args()
    spec = with_contact(load("baseline"), softening=asked.softening)
    spec = spec if asked.count >= 4500 else small(spec, asked.count)
    found = []
    for seed in asked.seeds:
        found.append(centre_of(spec, seed, 1e-3 * asked.clearance, asked.cycles))
        print(f"bed {seed}: eta {found[-1].loss_factor:.3f} +- {found[-1].loss_factor_se:.3f}", flush=True)
    print(save(third_figure(found), asked.out / "third.png"))


if __name__ == "__main__":
    main()
