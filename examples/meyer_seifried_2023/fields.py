"""The fields of all dampers of Meyer & Seifried (2023) on the paper's 12 x 9 grid, beside what the paper says of them.

    python fields.py [--out FOLDER] [--names baseline triple-star ...] [--no-run]

Each field is `graindamp field NAME.toml`; all share one store, so that stopping and starting again costs nothing.
Where stiff.py has run points at the stiffness of steel, they take the place of the softened ones. Writes fields.png and
fields.txt of whatever fields there are.
"""

import argparse
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
import xarray as xr
from matplotlib.figure import Figure
from setups import HERE, NAMES

from graindamp.field.robustness import robustness
from graindamp.field.store import read_field
from graindamp.report.figures import log_axis, save
from graindamp.units import STANDARD_GRAVITY

Region = Callable[[xr.DataArray, xr.DataArray], xr.DataArray]


class Landmark(NamedTuple):
    """A statement of the paper about the loss factor in a part of the field."""

    name: str
    region: Region
    """Whether a point belongs to it, of frequency [Hz] and intensity [-]."""
    published: str


def stroke(frequency: xr.DataArray, intensity: xr.DataArray) -> xr.DataArray:
    """Displacement amplitude X [m]."""
    return intensity * STANDARD_GRAVITY / (2.0 * np.pi * frequency) ** 2


def bounce(frequency: xr.DataArray, intensity: xr.DataArray) -> xr.DataArray:
    """Points at strokes of 1 to 1.6 mm, at and just above the optimum of a clearance of pi mm, gravity being small."""
    x = stroke(frequency, intensity)
    return (x >= 0.95e-3) & (x <= 1.6e-3) & (intensity >= 10)


def fluidised_high(frequency: xr.DataArray, intensity: xr.DataArray) -> xr.DataArray:
    """Points of high frequency and low intensity, where the paper calls its own simulations inaccurate."""
    return (frequency > 500) & (intensity < 4)


LANDMARKS: dict[str, tuple[Landmark, ...]] = {
    "baseline": (
        Landmark("solid-like: Γ = 1, f <= 100 Hz", lambda f, g: (g < 1.2) & (f <= 100), "below 0.1"),
        Landmark(
            "locally fluidised: Γ <= 2, 40 to 250 Hz", lambda f, g: (g > 1.2) & (g <= 2) & (f <= 250), "0.2 to 0.3"
        ),
        Landmark("decoupled: Γ >= 10, f >= 150 Hz", lambda f, g: (g >= 10) & (f >= 150), "0.05 to 0.15"),
        Landmark("bouncing: Γ >= 10, f < 150 Hz", lambda f, g: (g >= 10) & (f < 150), "0.1 to 1.0"),
        Landmark("bouncing at its best stroke", bounce, "1.0"),
        Landmark("Γ < 3, f > 500 Hz", fluidised_high, "up to 1.6 (test; not comparable)"),
    ),
    "triple-star": (
        Landmark("bouncing at its best stroke", bounce, "0.8"),
        Landmark("Γ < 4, f > 500 Hz", fluidised_high, "up to 2.0 (test; not comparable)"),
    ),
    "coated-1.4mpa": (Landmark("Γ <= 2.5 about 100 Hz", lambda f, g: (g <= 2.6) & (f > 70) & (f < 135), "high"),),
    "coated-55mpa": (Landmark("Γ <= 2.5 about 500 Hz", lambda f, g: (g <= 2.6) & (f > 400) & (f < 600), "high"),),
    "coated-50hz": (Landmark("all Γ about 50 Hz", lambda f, g: (f > 45) & (f < 60), "high at almost all Γ"),),
    "coated-60hz": (Landmark("all Γ about 60 Hz", lambda f, g: (f > 50) & (f < 75), "high at almost all Γ"),),
    "coated-80hz": (Landmark("all Γ about 80 Hz", lambda f, g: (f > 70) & (f < 100), "high at almost all Γ"),),
}


MERGED = (
    "loss_factor", "loss_factor_se", "effective_mass_ratio", "effective_mass_ratio_se", "dissipated_energy", "power",
    "particle_steps",
)  # fmt: skip
"""What a part of a field that was run again replaces."""


def cost(name: str, field: xr.Dataset) -> str:
    """How many particle-steps a field took."""
    stiff = field["is_stiff"]
    steps = field["particle_steps"]
    return (
        f"{name:14s} {int(stiff.count())} points, {int(stiff.sum())} of them at the stiffness of steel; "
        f"{float(steps.where(~stiff).sum()):.2g} and {float(steps.where(stiff).sum()):.2g} particle-steps"
    )


def rows(name: str, field: xr.Dataset) -> list[str]:
    """What the field says at the paper's landmarks."""
    lines = []
    for mark in LANDMARKS.get(name, ()):
        inside = field["loss_factor"].where(mark.region(field["frequency"], field["intensity"]))
        n = int(inside.count())
        low, high = (float(inside.min()), float(inside.max())) if n else (np.nan, np.nan)
        lines.append(
            f"{name:14s} {mark.name:42s} {n:3d} points, eta {low:5.2f} to {high:5.2f}; paper: {mark.published}"
        )
    return lines


def robust(name: str, softened: xr.Dataset, field: xr.Dataset) -> str:
    """How robust a damper is, as `graindamp show --level 0.2` says of a field; with the stiff values where there are
    such."""
    found = robustness(softened.assign({part: field[part] for part in MERGED if part in field}), 0.2)
    return (
        f"{name:14s} eta of 0.2 or more over {100 * found.share.value:.1f} +- {100 * found.share.error:.1f} % of the "
        f"range; d ln eta / d ln X below X_opt: mean {found.steepness.value:.2f} +- {found.steepness.error:.2f}, "
        f"steepest {found.steepest.value:.1f} +- {found.steepest.error:.1f}"
    )


def merged(softened: xr.Dataset, stiff: xr.Dataset | None) -> xr.Dataset:
    """A field with the values of a part of it that was run with stiffer contacts; `is_stiff` says where."""
    names = [name for name in MERGED if name in softened]
    field = softened[names]
    if stiff is None:
        return field.assign(is_stiff=xr.zeros_like(field["loss_factor"], bool))
    place = {"frequency": softened["frequency"], "intensity": softened["intensity"]}
    found = stiff[names].reindex(place, method="nearest", tolerance=1e-6)
    there = found["loss_factor"].notnull()
    return found.where(there, field).assign(is_stiff=there)


def borders(axis: np.ndarray) -> np.ndarray:
    """Where the cells about places on a logarithmic axis end."""
    between = np.sqrt(axis[1:] * axis[:-1])
    return np.concatenate([axis[:1] ** 2 / between[:1], between, axis[-1:] ** 2 / between[-1:]])


def maps(fields: dict[str, xr.Dataset]) -> Figure:
    """Loss factors side by side as in the paper's Figs 4, 7, 11 and 12: everything above 1 has one colour."""
    across = min(len(fields), 3)
    down = -(-len(fields) // across)
    figure = Figure(figsize=(4.2 * across, 3.4 * down), layout="constrained")
    panels = figure.subplots(down, across, squeeze=False, sharex=True, sharey=True)
    for axes, (name, field) in zip(panels.flat, fields.items(), strict=False):
        values = field["loss_factor"].transpose("intensity", "frequency")
        right, up = borders(field["frequency"].values), borders(field["intensity"].values)
        axes.pcolormesh(right, up, values, vmin=0, vmax=1)
        f = np.geomspace(40, 1000, 50)
        axes.plot(f, 1e-3 * (2 * np.pi * f) ** 2 / STANDARD_GRAVITY, "w--", lw=1)
        stiff = field["is_stiff"].transpose("intensity", "frequency").values.astype(int)
        for row, column in np.argwhere(np.diff(stiff, axis=1)):
            axes.vlines(right[column + 1], up[row], up[row + 1], "w", lw=1)
        for row, column in np.argwhere(np.diff(stiff, axis=0)):
            axes.hlines(up[row + 1], right[column], right[column + 1], "w", lw=1)
        axes.set(xscale="log", yscale="log", title=name, ylim=(0.9, 44))
        for axis in (axes.xaxis, axes.yaxis):
            log_axis(axis)
    for axes in panels[-1]:
        axes.set_xlabel("frequency [Hz]")
    for axes in panels[:, 0]:
        axes.set_ylabel("intensity Γ [-]")
    for axes in panels.flat[len(fields) :]:
        axes.set_visible(False)
    figure.colorbar(panels.flat[0].collections[0], ax=panels, label="loss factor η [-]")
    figure.suptitle("dashed: X = 1 mm; framed: at the stiffness of steel", fontsize=9)
    return figure


def main() -> None:
    """Run what is missing, print the landmarks, draw the maps."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path("meyer-seifried-2023"), help="folder of results")
    parser.add_argument("--names", nargs="+", default=list(NAMES), choices=NAMES, help="dampers")
    parser.add_argument("--no-run", action="store_true", help="only show the fields that are there")
    asked = parser.parse_args()
    asked.out.mkdir(parents=True, exist_ok=True)
    fields, lines = {}, []
    for name in asked.names:
        file = asked.out / f"{name}.nc"
        if not asked.no_run:
            words = ["field", str(HERE / f"{name}.toml"), "-o", str(file), "--store", str(asked.out / "store")]
            subprocess.run([sys.executable, "-m", "graindamp", *words], check=True)
        if file.is_file():
            stiff = asked.out / f"{name}-stiff.nc"
            softened = read_field(file)
            fields[name] = merged(softened, read_field(stiff) if stiff.is_file() else None)
            lines += [cost(name, fields[name]), robust(name, softened, fields[name]), *rows(name, fields[name])]
    print("\n".join(lines))
    if not fields:
        print("no fields yet; run without --no-run")
        return
    (asked.out / "fields.txt").write_text("\n".join(lines) + "\n", encoding="utf-8")
    print(save(maps(fields), asked.out / "fields.png"))


if __name__ == "__main__":
    main()
