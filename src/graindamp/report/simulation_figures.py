"""Figures of a simulated run over time. Each function draws one picture and returns it."""

from typing import TYPE_CHECKING

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from graindamp.report.figures import COLORS
from graindamp.report.ledger import LOSSES, closure_series
from graindamp.report.motion_picture import headline
from graindamp.report.wording import with_error
from graindamp.signals.motion_modes import ABSOLUTE, CROSSING, NAMES, SOLID, ModeVerdict
from graindamp.signals.power import OperatingPoint
from graindamp.signals.simulated import cycle_values, record_of

if TYPE_CHECKING:
    from graindamp.dem.run import Run

CYCLES_SHOWN = 4
"""Cycles at the end of a run that the force and motion are shown over."""

_PLATE = {"facecolor": "white", "alpha": 0.7, "lw": 0, "pad": 0.5}
"""Behind text that stands over lines."""


def signals(run: "Run", point: OperatingPoint) -> Figure:
    """Force that drives the bed and velocity of the container, over the last cycles or all of the run."""
    record = record_of(run)
    time = np.arange(len(record.force)) / record.sampling_rate
    unit, label = 1.0, "time t [s]"
    if run.frequency is not None:
        keep = round(CYCLES_SHOWN * record.sampling_rate / run.frequency)
        unit, label = run.frequency, "time t [cycles]"
    else:
        keep = len(time)
    shown = slice(max(len(time) - keep, 0), None)
    figure = Figure(figsize=(9.0, 5.4), layout="constrained")
    upper, lower = figure.subplots(2, 1, sharex=True, gridspec_kw={"height_ratios": (1.5, 1.0)})
    upper.plot(unit * time[shown], record.force[shown], color=COLORS[0], lw=0.9, label="force on the container")
    if run.frequency is not None and np.isfinite(point.loss_factor) and record.bed_mass:
        omega, speed = 2.0 * np.pi * run.frequency, record.motion[shown]
        base = np.exp(-1j * omega * time[shown])
        amplitude = 2.0 * np.mean(speed * base)
        mass = record.bed_mass * (point.effective_mass_ratio - 1j * point.loss_factor)
        wave = (1j * omega * mass * amplitude * base.conj()).real + record.force[shown].mean()
        upper.plot(unit * time[shown], wave, color=COLORS[1], lw=1.6, label="its fundamental, from η and m′")
        upper.legend(fontsize=8, loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2, frameon=False)
    upper.axhline(0.0, color="black", lw=0.5)
    upper.set_ylabel("force F [N]")
    lower.plot(unit * time[shown], record.motion[shown], color=COLORS[2], lw=1.3)
    lower.axhline(0.0, color="black", lw=0.5)
    lower.set(ylabel="velocity v [m/s]", xlabel=label)
    for axes in (upper, lower):
        axes.grid(True, alpha=0.25)
        axes.margins(x=0.0)
    text = "force that drives the bed, and velocity of the container"
    figure.suptitle(f"{headline(run.spec, run.packing.clearance)}\n{text}", fontsize=10)
    return figure


def cycles(run: "Run", point: OperatingPoint) -> Figure:
    """Loss factor and effective mass ratio of every cycle; grey: left out as transient."""
    values = cycle_values(run)
    figure = Figure(figsize=(9.0, 4.6), layout="constrained")
    panels = figure.subplots(2, 1, sharex=True)
    for axes, series, mean, error, color, name in (
        (panels[0], values.loss_factor, point.loss_factor, point.loss_factor_error, COLORS[0], "loss factor η [-]"),
        (
            panels[1],
            values.effective_mass_ratio,
            point.effective_mass_ratio,
            point.effective_mass_ratio_error,
            COLORS[1],
            "mass ratio m′ [-]",
        ),
    ):
        number = 1 + np.arange(len(series))
        first = point.n_skipped if np.isfinite(mean) else 0
        axes.plot(number[: first + 1], series[: first + 1], ".-", color="#999999", lw=0.8, ms=4)
        axes.plot(number[first:], series[first:], ".-", color=color, lw=0.9, ms=5)
        if np.isfinite(mean):
            axes.axhline(mean, color=color, lw=1.0, ls="--")
            axes.axhspan(mean - error, mean + error, color=color, alpha=0.22, lw=0)
            axes.set_title(f"{name.split(' [')[0]} = {with_error(mean, error)}", fontsize=9, loc="left")
        axes.set_ylabel(name)
        axes.grid(True, alpha=0.25)
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    panels[1].set_xlabel("cycle [-]   (dashed and band: mean ± standard error; grey: transient, left out)")
    figure.suptitle(headline(run.spec, run.packing.clearance), fontsize=10)
    return figure


def energy(run: "Run") -> Figure:
    """Where the container's work went, over time, and what does not add up."""
    time = np.asarray(run.energy_time, dtype=np.float64)
    unit, label = (1.0, "time t [s]") if run.frequency is None else (run.frequency, "time t [cycles]")
    begin = run.energy[0]
    figure = Figure(figsize=(9.0, 5.6), layout="constrained")
    upper, lower = figure.subplots(2, 1, sharex=True, gridspec_kw={"height_ratios": (2.6, 1.0)})
    series = {name: np.array([getattr(now, name) - getattr(begin, name) for now in run.energy]) for name in LOSSES}
    shown = {name: values for name, values in series.items() if np.any(values != 0.0)}
    work = np.array([now.work - begin.work for now in run.energy])
    stored = np.array([now.stored - begin.stored for now in run.energy])
    size = max(float(np.max(np.abs(work))), float(sum(np.max(np.abs(values)) for values in series.values())), 1e-300)
    scale, prefix = (1.0, "J") if size >= 1.0 else (1e3, "mJ")
    if shown:
        upper.stackplot(
            unit * time, [scale * values for values in shown.values()], labels=[LOSSES[name] for name in shown],
            colors=COLORS, alpha=0.75,
        )  # fmt: skip
    upper.plot(unit * time, scale * work, color="black", lw=1.6, label="work of the container")
    upper.plot(unit * time, scale * stored, color="black", lw=1.0, ls=":", label="gain of stored energy")
    upper.set_ylabel(f"energy since the start [{prefix}]")
    handles, names = upper.get_legend_handles_labels()
    upper.legend(handles, names, fontsize=8, loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=3, frameon=False)
    closure = 100.0 * closure_series(run) / size
    lower.plot(unit * time, closure, color=COLORS[1], lw=1.2)
    span = 1.15 * max(float(np.max(np.abs(closure))), 1e-4)  # rounding is not worth a scale of its own
    lower.set_ylim(-span, span)
    lower.axhline(0.0, color="black", lw=0.5)
    lower.set(xlabel=label, ylabel="closure\n[% of throughput]")
    for axes in (upper, lower):
        axes.grid(True, alpha=0.25)
        axes.margins(x=0.0)
    figure.suptitle(f"{headline(run.spec, run.packing.clearance)}\nenergy ledger (losses stacked)", fontsize=10)
    return figure


def impacts(run: "Run") -> Figure:
    """How fast particles hit each other and the walls: impacts per bin of a quarter octave of speed."""
    edges = np.asarray(run.impact_edges, dtype=np.float64)
    counts = np.asarray(run.impact_counts)
    figure = Figure(figsize=(7.5, 4.0), layout="constrained")
    axes = figure.subplots()
    for row, color, label in ((counts[0], COLORS[0], "between particles"), (counts[1], COLORS[1], "with walls")):
        axes.stairs(row, edges, color=color, lw=1.4, label=f"{label}: {int(row.sum()):,} in all".replace(",", "\u202f"))
    seen = np.flatnonzero(counts.sum(axis=0))
    if len(seen):
        axes.set_xlim(edges[max(seen[0] - 1, 0)], edges[min(seen[-1] + 2, len(edges) - 1)])
        axes.set_yscale("log")
        axes.set_ylim(0.7, None)
    axes.set(xscale="log", xlabel="approach speed of the impact [m/s]", ylabel="impacts per quarter octave [-]")
    axes.grid(True, alpha=0.25, which="both")
    axes.legend(fontsize=8)
    axes.set_title(f"{headline(run.spec, run.packing.clearance)}: impact speeds", fontsize=10)
    return figure


def stirring(run: "Run", verdict: ModeVerdict) -> Figure:
    """How the bed moves in its container, cycle by cycle, with the thresholds that modes are told apart by."""
    told = run.stirring
    if told is None:
        raise ValueError("the run recorded no whole cycle")
    number = 1 + np.arange(len(told.kinetic))
    figure = Figure(figsize=(9.0, 5.4), layout="constrained")
    upper, lower = figure.subplots(2, 1, sharex=True)
    for values, color, label in (
        (told.kinetic, COLORS[0], "relative to the container"),
        (told.block, COLORS[2], "of that, motion as a block"),
        (told.absolute, COLORS[1], "in the frame at rest"),
    ):
        upper.plot(number, values, ".-", color=color, lw=1.0, ms=4, label=label)
    for level, text in ((ABSOLUTE, "decoupled below (frame at rest)"), (SOLID, "solid-like below (relative)")):
        upper.axhline(level, color="black", lw=0.8, ls=":")
        upper.annotate(text, (number[-1], level), ha="right", va="bottom", fontsize=7, bbox=_PLATE)
    upper.set(ylabel="kinetic energy\nover m$_{bed}$V²/2 [-]", yscale="log")
    for k, name in enumerate(("lowest", "middle", "highest")):
        if np.isfinite(told.layer_speed[:, k]).any():
            label = f"speed of the {name} third / V"
            lower.plot(number, told.layer_speed[:, k], ".-", color=COLORS[k], lw=1.0, ms=4, label=label)
    if run.packing.clearance:
        lower.plot(number, told.travel / run.packing.clearance, "-", color="black", lw=1.3, label="travel / clearance")
        lower.axhline(CROSSING, color="black", lw=0.8, ls=":")
        lower.annotate(
            "crosses above (travel)", (number[-1], CROSSING), ha="right", va="bottom", fontsize=7, bbox=_PLATE
        )
    lower.set(xlabel="cycle [-]", ylabel="speeds and travel [-]")
    lower.set_ylim(0.0, None)
    lower.xaxis.set_major_locator(MaxNLocator(integer=True))
    for axes in (upper, lower):
        axes.grid(True, alpha=0.25)
        axes.legend(fontsize=8, loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=4, frameon=False)
    close = ", close to another" if verdict.is_close else ""
    figure.suptitle(f"{headline(run.spec, run.packing.clearance)}\n{NAMES[verdict.mode]}{close}", fontsize=10)
    return figure
