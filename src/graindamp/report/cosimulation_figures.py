"""Figures of structure and particles simulated together. Each function draws one picture and returns it."""

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from graindamp.couple.cosimulate import CoRun
from graindamp.report.figures import COLORS
from graindamp.report.ledger import LOSSES
from graindamp.report.wording import verbatim
from graindamp.units import STANDARD_GRAVITY


def motion(run: CoRun, points: Sequence[str]) -> Figure:
    """Displacement of every point over time, and the force of the particles on every container."""
    n = len(points) + 1
    figure = Figure(figsize=(10.5, 0.6 + 2.1 * n), layout="constrained")
    panels = figure.subplots(n, 1, sharex=True)
    for k, (axes, point) in enumerate(zip(panels, points, strict=False)):
        axes.plot(run.time, 1e3 * run.displacement(point), color=COLORS[k % len(COLORS)], lw=0.8)
        axes.set_ylabel("displacement [mm]")
        axes.set_title(verbatim(point), fontsize=9, loc="left")
    for number, (carried, mass) in enumerate(zip(run.case.dampers, run.bed_mass, strict=True)):
        along = run.force[:, number] @ np.asarray(carried.direction)
        label = f"{verbatim(carried.point)}, {1e3 * mass:.4g} g"
        panels[-1].plot(run.time, along, color=COLORS[number % len(COLORS)], lw=0.6, label=label)
    panels[-1].set_ylabel("force of the bed [N]")
    panels[-1].set_xlabel("time t [s]")
    panels[-1].legend(fontsize=8, loc="upper right")
    weight = max(run.bed_mass) * STANDARD_GRAVITY
    panels[-1].set_title(
        f"force of the particles on the container (largest weight {weight:.3g} N)", fontsize=9, loc="left"
    )
    for axes in panels:
        axes.axhline(0.0, color="black", lw=0.5)
        axes.grid(True, alpha=0.25)
    return figure


def energies(run: CoRun) -> Figure:
    """Where the energy is and where it went, over time."""
    figure = Figure(figsize=(10.5, 4.0), layout="constrained")
    axes = figure.subplots()
    beds = {name: np.array([sum(getattr(bed, name) for bed in look) for look in run.energy]) for name in LOSSES}
    moving = np.array([sum(bed.stored for bed in look) for look in run.energy])
    layers = [("structure", run.structure_energy), ("particles, gain", moving - moving[0])]
    layers += [(LOSSES[name], values) for name, values in beds.items() if values[-1] > 0.0]
    layers.append(("damping of the structure", run.damped))
    scale, unit = (1e3, "mJ") if max(values.max() for _, values in layers) < 0.1 else (1.0, "J")
    base = np.zeros(len(run.energy_time))
    for k, (name, values) in enumerate(layers):
        top = base + np.maximum(values, 0.0)
        axes.fill_between(
            run.energy_time, scale * base, scale * top, color=COLORS[k % len(COLORS)], alpha=0.75, lw=0, label=name
        )
        base = top
    given = run.structure_energy[0] + run.forced
    axes.plot(run.energy_time, scale * given, color="black", lw=1.2, ls="--", label="at the start and by forces")
    axes.set_xlabel("time t [s]")
    axes.set_ylabel(f"energy [{unit}]")
    axes.set_xlim(run.energy_time[0], run.energy_time[-1])
    axes.set_ylim(bottom=0.0)
    axes.legend(fontsize=8, loc="center left", bbox_to_anchor=(1.0, 0.5))
    return figure
