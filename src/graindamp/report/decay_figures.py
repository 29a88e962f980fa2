"""Figures of free decays. Each function draws one picture and returns it."""

from collections.abc import Sequence
from math import pi

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from graindamp.report.figures import COLORS, log_axis
from graindamp.report.wording import verbatim
from graindamp.signals.decay import Decay, mass_normalised
from graindamp.signals.decay_repeats import Curve
from graindamp.signals.record import MotionKind
from graindamp.units import STANDARD_GRAVITY

Real = NDArray[np.float64]

RECORDS_SHOWN = 4
"""Records drawn over time; of more only the first."""
CYCLES_SHOWN = 8
"""Cycles of the beginning that are drawn large."""

_AXIS: dict[MotionKind, tuple[float, str]] = {
    "displacement": (1e3, "displacement u [mm]"),
    "velocity": (1e3, "velocity v [mm/s]"),
    "acceleration": (1.0 / STANDARD_GRAVITY, "acceleration a [g]"),
}


def decays(results: Sequence[Decay]) -> Figure:
    """Every record with its peaks and envelope: all of it, and its beginning."""
    shown = results[:RECORDS_SHOWN]
    figure = Figure(figsize=(10.5, 0.7 + 2.3 * len(shown)), layout="constrained")
    panels = figure.subplots(len(shown), 2, squeeze=False, gridspec_kw={"width_ratios": (1.7, 1.0)})
    for (whole, beginning), result in zip(panels, shown, strict=True):
        scale, label = _AXIS[result.record.quantity]
        extremes, envelope = result.located.extremes, result.envelope
        time = np.arange(len(result.located.motion)) / result.record.sampling_rate
        for axes, size in ((whole, 2.5), (beginning, 4.5)):
            axes.plot(time, scale * result.located.motion, color="#8c8c8c", lw=0.5 if axes is whole else 1.0)
            for sign in (1.0, -1.0):
                axes.plot(envelope.time, sign * scale * envelope.amplitude, color=COLORS[1], lw=1.0)
                of_sign = np.sign(extremes.value) == sign
                color = COLORS[0] if sign > 0 else COLORS[2]
                axes.plot(extremes.time[of_sign], scale * extremes.value[of_sign], "o", color=color, ms=size, mew=0)
            axes.axhline(0.0, color="black", lw=0.5)
            axes.grid(True, alpha=0.25)
        begin = max(extremes.time[0] - 1.0 / result.frequency, 0.0)
        beginning.set_xlim(begin, begin + CYCLES_SHOWN / result.frequency)
        whole.set_xlim(time[0], time[-1])
        whole.axvline(extremes.time[-1], color="black", lw=0.8, ls=":")
        why = "drowns in noise" if result.located.ends_in_noise else "last peak"
        whole.annotate(
            f" {why}",
            (extremes.time[-1], 0.97),
            xycoords=("data", "axes fraction"),
            va="top",
            ha="right" if extremes.time[-1] > 0.7 * time[-1] else "left",
            fontsize=8,
        )
        whole.set_ylabel(label)
        whole.set_title(verbatim(result.record.label), fontsize=9, loc="left")
        beginning.set_title(f"its first {CYCLES_SHOWN} cycles", fontsize=9, loc="left")
    for axes in panels[-1]:
        axes.set_xlabel("time t [s]")
    marks = [Line2D([], [], marker="o", ls="", color=COLORS[k], ms=5) for k in (0, 2)]
    marks.append(Line2D([], [], color=COLORS[1], lw=1.2))
    names = ["positive peaks", "negative peaks", "Hilbert envelope"]
    figure.legend(marks, names, loc="outside upper right", ncols=3, fontsize=8, frameon=False)
    return figure


def damping(
    results: Sequence[Decay],
    curve: Curve,
    intrinsic: float = 0.0,
    mass_ratio: float | None = None,
    clearance: float | None = None,
) -> Figure:
    """Psi, or Psi_m where masses are known, over displacement amplitude, and over U / d where a clearance is given.

    Args:
        results: records; a point per cycle, moving averages.
        curve: their mean with standard errors.
        intrinsic: Psi_0 taken off [-].
        mass_ratio: mu [-].
        clearance: d [m].
    """
    scales = [(1e3, "displacement amplitude U [mm]")]
    if clearance is not None:
        scales.append((1.0 / clearance, "amplitude over clearance α = U/d [-]"))
    factor = 100.0 if mass_ratio is None else float(mass_normalised(np.ones(1), mass_ratio)[0])
    figure = Figure(figsize=(6.2 * len(scales), 4.3), layout="constrained")
    panels = figure.subplots(1, len(scales), squeeze=False, sharey=True)[0]
    for axes, (scale, label) in zip(panels, scales, strict=True):
        for k, result in enumerate(results):
            values = factor * (result.cycles.psi_average - intrinsic)
            name = verbatim(result.record.label) if len(results) > 1 else "cycles"
            color = COLORS[k % len(COLORS)]
            axes.plot(
                scale * result.cycles.displacement, values, "o", color=color, ms=3.5, alpha=0.55, mew=0, label=name
            )
        mean, error = factor * (curve.psi - intrinsic), factor * curve.psi_error
        _with_errors(axes, scale * curve.displacement, mean, error, "mean ± standard error")
        _amplitude_axis(axes, label)
        axes.axhline(0.0, color="black", lw=0.6)
    points = factor * (np.concatenate([result.cycles.psi_average for result in results]) - intrinsic)
    mean, error = factor * (curve.psi - intrinsic), factor * curve.psi_error
    _limit(panels[0], np.append(mean - error, 0.0), np.append(mean + error, 0.0), points)
    if mass_ratio is None:
        panels[0].set_ylabel("specific damping capacity Ψ [%]")
    else:
        panels[0].set_ylabel("mass-normalised damping Ψ$_m$ [-]")
    without = f", intrinsic {100 * intrinsic:g} % removed" if intrinsic else ""
    normalised = f", Ψ$_m$ = Ψ (1 + μ)²/μ with μ = {mass_ratio:.4g}" if mass_ratio is not None else ""
    figure.suptitle(f"Damping of each cycle{normalised}{without}", fontsize=10)
    if clearance is not None:
        for place, text in ((1.0 / pi, "1/π"), (0.5 / pi, "1/(2π)")):
            panels[1].axvline(place, color="#555555", lw=1.0, ls="-" if text == "1/π" else "--")
            panels[1].annotate(
                f"{text} ", (place, 0.985), xycoords=("data", "axes fraction"), va="top", ha="right", fontsize=9
            )
    panels[0].legend(fontsize=8, markerscale=1.6, ncols=2 if len(results) > 6 else 1)
    return figure


def frequency(results: Sequence[Decay], curve: Curve) -> Figure:
    """Frequency and damping ratio over displacement amplitude."""
    figure = Figure(figsize=(11.0, 4.0), layout="constrained")
    panels = figure.subplots(1, 2)
    for axes, scale, label, name in (
        (panels[0], 1.0, "frequency f [Hz]", "frequency"),
        (panels[1], 100.0, "damping ratio ζ [%]", "damping_ratio"),
    ):
        for k, result in enumerate(results):
            color = COLORS[k % len(COLORS)]
            values = scale * getattr(result.cycles, name)
            label_of = verbatim(result.record.label) if len(results) > 1 else "cycles"
            at = 1e3 * result.cycles.displacement
            axes.plot(at, values, "o", color=color, ms=3.5, alpha=0.5, mew=0, label=label_of)
        mean, error = scale * getattr(curve, name), scale * getattr(curve, f"{name}_error")
        _with_errors(axes, 1e3 * curve.displacement, mean, error, "mean ± standard error")
        points = scale * np.concatenate([getattr(result.cycles, name) for result in results])
        _limit(axes, mean - error, mean + error, points)
        axes.set_ylabel(label)
        axes.yaxis.get_major_formatter().set_useOffset(False)
        _amplitude_axis(axes, "displacement amplitude U [mm]")
    panels[0].legend(fontsize=8, markerscale=1.6, ncols=2 if len(results) > 6 else 1)
    return figure


def _limit(axes: Axes, low: Real, high: Real, points: Real) -> None:
    """Room for the mean with its errors and for all but the farthest hundredth of the points."""
    bottom = min(float(low.min()), float(np.quantile(points, 0.005)))
    top = max(float(high.max()), float(np.quantile(points, 0.995)))
    room = 0.07 * (top - bottom) + 1e-4 * abs(top)
    axes.set_ylim(bottom - room, top + room)


def _with_errors(axes: Axes, at: Real, mean: Real, error: Real, label: str) -> None:
    axes.errorbar(at, mean, error, fmt="s-", color="black", ms=3.5, lw=0.9, elinewidth=1.0, capsize=2, label=label)


def _amplitude_axis(axes: Axes, label: str) -> None:
    axes.set(xlabel=label, xscale="log")
    log_axis(axes.xaxis)
    axes.grid(True, alpha=0.25)
