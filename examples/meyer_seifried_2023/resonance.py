"""How softer contacts move the resonance of a bed: eta and m' over frequency at Gamma = 1, for several stiffnesses.

    python resonance.py [--out FOLDER] [--count 500] [--softenings 1000 100 10 1] [--intensity 1]

Sound runs through a bed at a speed that goes with the third root of the contacts' stiffness (Hertz contacts under a
given pressure), so that all curves should meet over f s^(1/3), f the frequency and s the softening. Runs 500 spheres in
a cylinder scaled alike, two minutes on a free core. Writes resonance.png.
"""

import argparse
from pathlib import Path

import numpy as np
import xarray as xr
from matplotlib.figure import Figure
from setups import HERE, load, on_grid, small, with_contact

from graindamp.campaign.executors import Serial
from graindamp.campaign.run import run_field
from graindamp.campaign.store import Store
from graindamp.report.figures import COLORS, save
from graindamp.spec.field import FieldSpec

FREQUENCIES = tuple(float(f) for f in np.round(np.geomspace(60.0, 4000.0, 19), 1))
"""[Hz]"""


def row(spec: FieldSpec, softening: float, intensity: float, out: Path) -> xr.Dataset:
    """Values over frequency at one stiffness."""
    asked = on_grid(with_contact(spec, softening=softening), FREQUENCIES, (intensity,), 15)
    with Store(out / "store") as store:
        return run_field(asked, store, Serial(), project=HERE / "baseline.toml").field.isel(intensity=0)


def picture(rows: dict[float, xr.Dataset]) -> Figure:
    """Loss factor and m' over frequency, and over frequency times the third root of the softening."""
    figure = Figure(figsize=(10, 6), layout="constrained")
    panels = figure.subplots(2, 2, sharey="row", sharex="col")
    for k, (softening, values) in enumerate(rows.items()):
        for column, scale in enumerate((1.0, softening ** (1 / 3))):
            x = values["frequency"] * scale
            for axes, name in zip(panels[:, column], ("loss_factor", "effective_mass_ratio"), strict=True):
                axes.errorbar(
                    x, values[name], values[f"{name}_se"], color=COLORS[k], marker=".", lw=1, label=f"s = {softening:g}"
                )
                axes.set_xscale("log")
    panels[0, 0].set_ylabel("loss factor η [-]")
    panels[1, 0].set_ylabel("mass ratio m′ [-]")
    panels[1, 0].set_xlabel("frequency f [Hz]")
    panels[1, 1].set_xlabel("f s^(1/3) [Hz]")
    panels[0, 0].legend()
    return figure


def main() -> None:
    """Run what is missing, print the peaks, draw."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path("meyer-seifried-2023"), help="folder of results")
    parser.add_argument("--count", type=int, default=500, help="spheres")
    parser.add_argument("--softenings", nargs="+", type=float, default=[1000.0, 100.0, 10.0, 1.0])
    parser.add_argument("--intensity", type=float, default=1.0)
    asked = parser.parse_args()
    spec = load("baseline")
    spec = spec if asked.count >= 4500 else small(spec, asked.count)
    rows = {}
    for softening in asked.softenings:
        rows[softening] = row(spec, softening, asked.intensity, asked.out)
        eta = rows[softening]["loss_factor"]
        top = float(eta["frequency"][int(np.argmax(eta.values))])
        print(
            f"softening {softening:5g}: eta {float(eta.max()):.2f} at {top:.0f} Hz, "
            f"f s^(1/3) = {top * softening ** (1 / 3):.0f} Hz; {float(eta[0]):.2f} at {FREQUENCIES[0]:g} Hz"
        )
    print(save(picture(rows), asked.out / "resonance.png"))


if __name__ == "__main__":
    main()
