"""Figures. Each function draws one picture and returns it; nothing here computes results or shows windows."""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke
from matplotlib.ticker import FuncFormatter, LogLocator, MaxNLocator, NullFormatter

from graindamp.couple.equilibrium import Equilibrium, holding_curve
from graindamp.couple.predict import DRIVE, Prediction, Study
from graindamp.couple.response import Response
from graindamp.couple.single_mode import load_mode, search_box
from graindamp.errors import InputError
from graindamp.field.interpolate import Interpolant
from graindamp.field.schema import damper_of, is_grid
from graindamp.field.store import table_of
from graindamp.report.wording import verbatim
from graindamp.signals.power import OperatingPoint
from graindamp.status import FATAL, Status
from graindamp.units import STANDARD_GRAVITY

COLORS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#555555", "#f0e442")
"""Okabe & Ito (2008): told apart by all forms of colour vision."""
MARKERS = ("^", "o", "s", "D", "v", "P", "X", "*")
"""Markers of forces, triangle, circle, square as in Meyer & Seifried (2021)."""


PICTURES = (".png", ".pdf", ".svg", ".jpg", ".tif")


def save(figure: Figure, path: Path) -> Path:
    """Write a figure as its name says, .png, .pdf, .svg and others.

    Raises:
        InputError: no such kind of picture, or the file cannot be written.
    """
    if path.suffix.lower() not in PICTURES:
        raise InputError(f"{path}: not a kind of picture; allowed are {', '.join(PICTURES)}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        figure.savefig(path, dpi=130)
    except OSError as error:
        raise InputError(f"{path}: cannot be written ({error.strerror or error})") from None
    return path


class _Ticks(LogLocator):
    """At 1, 2 and 5 of every decade, and closer over a range that has fewer than three of them."""

    def tick_values(self, vmin: float, vmax: float) -> Any:
        for subs in ((1.0, 2.0, 5.0), tuple(range(1, 10))):
            self.set_params(subs=subs)
            ticks = np.asarray(super().tick_values(vmin, vmax))
            if np.count_nonzero((ticks >= vmin) & (ticks <= vmax)) >= 3:
                return ticks
        return MaxNLocator(5, steps=[1, 2, 5, 10]).tick_values(vmin, vmax)


def log_axis(axis: Any) -> None:
    """Plain numbers on a logarithmic axis, at 1, 2 and 5 of every decade where those are enough."""
    axis.set_major_locator(_Ticks())
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
    axis.set_minor_formatter(NullFormatter())


def field_map(
    field: xr.Dataset, equilibria: Mapping[str, Sequence[tuple[float, float, bool]]] | None = None, title: str = ""
) -> Figure:
    """Loss factor and effective mass ratio over frequency and intensity, with lines of constant stroke.

    Args:
        field: the effective field.
        equilibria: by label, (frequency [Hz], intensity [-], is stable) of operating points to mark.
        title: heading; default the name of the damper.
    """
    damper = damper_of(field)
    figure = Figure(figsize=(11, 4.4), layout="constrained")
    panels = figure.subplots(1, 2, sharex=True, sharey=True)
    columns = table_of(field)
    usable = (columns["status"] & int(FATAL)) == 0
    twofold = (columns["status"] & int(Status.BISTABLE)) != 0
    f, gamma = columns["frequency"], columns["intensity"]
    for axes, name, label, clip in (
        (panels[0], "loss_factor", "loss factor η [-]", 1.0),
        (panels[1], "effective_mass_ratio", "effective mass ratio m′ [-]", None),
    ):
        _filled(figure, axes, field, name, label, clip)
        axes.plot(f[usable], gamma[usable], "o", color="white", mec="#555555", mew=0.3, ms=2.5, clip_on=False, zorder=4)
        if not usable.all():
            axes.plot(f[~usable], gamma[~usable], "x", color="#888888", ms=5, clip_on=False, zorder=4)
        if twofold.any():
            axes.plot(f[twofold], gamma[twofold], "D", mfc="none", mec="white", ms=6, label="two answers")
        _stroke_lines(axes, field, damper.get("clearance"))
        for k, (force, states) in enumerate((equilibria or {}).items()):
            for j, (f0, g0, stable) in enumerate(states):
                axes.plot(
                    f0,
                    g0,
                    MARKERS[k % len(MARKERS)],
                    color="#ff2d2d" if stable else "none",
                    mec="black" if stable else "#ff2d2d",
                    ms=8,
                    zorder=5,
                    label=force if j == 0 else None,
                )
        axes.set(xlabel="frequency f [Hz]", xscale="log", yscale="log")
        log_axis(axes.xaxis)
        log_axis(axes.yaxis)
    panels[0].set_ylabel("excitation intensity Γ = A/g [-]")
    if equilibria and any(equilibria.values()):
        panels[1].legend(loc="upper right", fontsize=8, title="equilibria", title_fontsize=8)
    if twofold.any():
        panels[0].legend(loc="upper right", fontsize=8, labelcolor="white", facecolor="#555555")
    mass = f"bed {1e3 * field.attrs['bed_mass']:.4g} g"
    told = f"{title or damper.get('name') or 'effective field'} ({mass}; {field.attrs.get('source', '')})"
    figure.suptitle(verbatim(told))
    return figure


def _filled(figure: Figure, axes: Axes, field: xr.Dataset, name: str, label: str, clip: float | None) -> None:
    """Filled contours of the interpolated field inside its points, or bare points where there is nothing between."""
    columns = table_of(field)
    usable = (columns["status"] & int(FATAL)) == 0
    values = columns[name][usable]
    low, high = float(values.min()), float(values.max())
    if clip is not None:
        low, high = 0.0, max(min(high, clip), 0.1)
    else:
        low, high = min(low, 0.0), max(high, 1.0)
    cmap = "viridis" if clip is not None else "cividis"
    drawn: Any = None
    with suppress(InputError):
        if is_grid(field) and (field.sizes["frequency"] < 2 or field.sizes["intensity"] < 2):
            raise InputError("a line of points")
        at = Interpolant(field, "constant")
        f = np.geomspace(*at.frequency_range, 200)
        gamma = np.geomspace(*at.intensity_range, 200)
        grid = at(f[:, None], gamma[None, :])
        z = np.where(grid.extrapolated, np.nan, getattr(grid, name))
        if np.isfinite(z[1:-1, 1:-1]).any():
            beyond = (float(values.min()) < low, float(values.max()) > high)
            extend = {(True, True): "both", (True, False): "min", (False, True): "max"}.get(beyond, "neither")
            drawn = axes.contourf(f, gamma, z.T, levels=np.linspace(low, high, 21), extend=extend, cmap=cmap)
    if drawn is None:
        drawn = axes.scatter(
            columns["frequency"][usable], columns["intensity"][usable], c=values, vmin=low, vmax=high, cmap=cmap, s=90
        )
    ticks = np.asarray(MaxNLocator(8).tick_values(low, high))
    bar = figure.colorbar(drawn, ax=axes, ticks=ticks[(ticks >= low) & (ticks <= high)])
    bar.set_label(label)


def _stroke_lines(axes: Axes, field: xr.Dataset, clearance: float | None) -> None:
    """Lines X = h / pi and its multiples; the motion of best loss factor of a bouncing bed."""
    f, gamma = field["frequency"].to_numpy(), field["intensity"].to_numpy()
    if clearance is None or f.min() == f.max():
        return
    line = np.geomspace(f.min(), f.max(), 200)
    for factor, style in ((0.5, ":"), (1.0, "--"), (2.0, ":"), (4.0, ":")):
        level = factor * clearance / np.pi * (2 * np.pi * line) ** 2 / STANDARD_GRAVITY
        inside = (level >= gamma.min()) & (level <= gamma.max())
        if inside.sum() > 10:
            axes.plot(line[inside], level[inside], style, color="white", lw=1.3)
            text = "X = h/π" if factor == 1 else f"{factor:g} h/π"
            k = np.flatnonzero(inside)[int(inside.sum() * 0.5)]
            (left, right), (bottom, top), box = axes.get_xlim(), axes.get_ylim(), axes.get_window_extent()
            angle = np.degrees(np.arctan2(2.0 * box.height / np.log(top / bottom), box.width / np.log(right / left)))
            axes.annotate(
                text, (line[k], level[k]), (-2, 2), textcoords="offset points", color="white", fontsize=8,
                rotation=angle, rotation_mode="anchor", ha="center", va="bottom",
                path_effects=[withStroke(linewidth=2.0, foreground="black", alpha=0.5)],
            )  # fmt: skip


def cycles(points: Sequence[OperatingPoint], columns: int = 5) -> Figure:
    """Loss factor and effective mass ratio of every cycle used, a panel per record."""
    shown = [point for point in points if point.n_cycle]
    columns = min(columns, max(2, len(shown)))
    rows = max(1, -(-len(shown) // columns))
    figure = Figure(figsize=(2.6 * columns, 1.9 * rows + 0.3))
    grid = {
        "hspace": 0.5,
        "wspace": 0.3,
        "left": 0.06,
        "right": 0.99,
        "top": 1 - 0.35 / (1.9 * rows),
        "bottom": 0.9 / (2 * rows + 1),
    }
    panels = np.atleast_1d(figure.subplots(rows, columns, squeeze=False, gridspec_kw=grid)).ravel()
    for axes, point in zip(panels, shown, strict=False):
        number = point.n_skipped + np.arange(point.n_cycle)
        for values, mean, error, color, label in (
            (point.cycle_loss_factor, point.loss_factor, point.loss_factor_error, COLORS[0], "η"),
            (point.cycle_mass_ratio, point.effective_mass_ratio, point.effective_mass_ratio_error, COLORS[1], "m′"),
        ):
            axes.plot(number, values, ".-", color=color, lw=0.7, ms=3, label=label)
            axes.axhspan(mean - error, mean + error, color=color, alpha=0.25, lw=0)
        axes.set_title(f"{point.frequency:.4g} Hz, Γ {point.intensity:.3g}", fontsize=8)
        axes.tick_params(labelsize=7)
        axes.locator_params(nbins=4)
    for axes in panels[len(shown) :]:
        axes.set_axis_off()
    if shown:
        panels[0].legend(fontsize=7)
    figure.supxlabel("cycle [-]", fontsize=9)
    figure.supylabel("η, m′ of each cycle [-]; band: mean ± standard error", fontsize=9)
    return figure


def _best(states: Sequence[Equilibrium]) -> Equilibrium | None:
    """The equilibrium a mode reaches from rest: the stable one of smallest amplitude, else the first."""
    stable = [state for state in states if state.is_stable]
    return (stable or list(states) or [None])[0]  # type: ignore[list-item]


def damping_bars(prediction: Prediction) -> Figure:
    """Damping ratio of every mode under every force, with structural damping and the efficiency bound."""
    n_force = len(prediction.forces)
    figure = Figure(figsize=(8.5, 4.2), layout="constrained")
    axes = figure.subplots()
    first = prediction.modes[0]
    place = np.arange(len(first))
    width = 0.8 / n_force
    for k, (force, solved) in enumerate(zip(prediction.forces, prediction.modes, strict=True)):
        at = place + (k - (n_force - 1) / 2) * width
        for j, mode in enumerate(solved):
            state = _best(mode.result.equilibria)
            label = f"{force:g} N" if j == 0 else None
            if state is None:
                axes.bar(at[j], 0, width, color=COLORS[k % 8], label=label)
                axes.annotate("none", (at[j], 0), ha="center", va="bottom", fontsize=7, rotation=90)
                continue
            error = 0.0 if np.isnan(state.damping_ratio_se) else 100 * state.damping_ratio_se
            axes.bar(
                at[j],
                100 * state.damping_ratio,
                width * 0.92,
                yerr=error,
                color=COLORS[k % 8],
                hatch="///" if state.extrapolated else None,
                edgecolor="white",
                ecolor="black",
                capsize=3,
                label=label,
            )
            if mode.fixed_point is not None and mode.fixed_point.converged:
                axes.plot(at[j], 100 * mode.fixed_point.last.damping_ratio, "x", color="black", ms=6)
    for j, mode in enumerate(first):
        side = [j - 0.45, j + 0.45]
        axes.plot(
            side, [100 * mode.result.efficient_damping_ratio] * 2, "k--", lw=1.2, label="η = 1" if j == 0 else None
        )
        bare = [100 * mode.result.bare_damping_ratio] * 2
        axes.plot(side, bare, "-", color="#777777", lw=1.5, label="structure alone" if j == 0 else None)
    axes.set_xticks(place, [f"mode {m.result.number}\n{m.result.bare_frequency:.1f} Hz" for m in first])
    axes.set_ylabel("damping ratio ζ [%]")
    axes.legend(fontsize=8, ncols=2)
    axes.set_title("Damping at resonance (hatched: field extrapolated; ×: fixed-point scheme)", fontsize=10)
    return figure


def responses(prediction: Prediction, linear: Response | None = None) -> Figure:
    """Mobility of the output point at each force, upward and downward sweep."""
    figure = Figure(figsize=(9.5, 4.6), layout="constrained")
    axes = figure.subplots()
    if linear is not None:
        axes.loglog(linear.frequency, np.abs(linear.mobility), color="#999999", lw=1, label="without particles")
    for k, (force, (up, down)) in enumerate(zip(prediction.forces, prediction.responses, strict=True)):
        size = np.where(up.converged, np.abs(up.mobility), np.nan)
        axes.loglog(up.frequency, size, color=COLORS[k % 8], lw=1.4, label=f"{force:g} N")
        back = np.where(down.converged, np.abs(down.mobility), np.nan)
        if np.any(np.abs(back / size - 1) > 1e-3):
            axes.loglog(down.frequency, back, "--", color=COLORS[k % 8], lw=1.0, label=f"{force:g} N, downwards")
    axes.set(xlabel="frequency f [Hz]", ylabel="mobility |v/F| [m/(N s)]")
    log_axis(axes.xaxis)
    axes.grid(True, alpha=0.3)
    axes.legend(fontsize=8)
    axes.set_title("Response at fixed force, all modes and dampers", fontsize=10)
    return figure


def mode_shapes(prediction: Prediction) -> Figure:
    """Mode shapes along a beam, with the places of drive and dampers."""
    assert prediction.shapes is not None
    figure = Figure(figsize=(8.5, 3.6), layout="constrained")
    axes = figure.subplots()
    for j, mode in enumerate(prediction.modes[0]):
        name = f"mode {mode.result.number}, {mode.result.bare_frequency:.1f} Hz"
        axes.plot(prediction.shapes.position, prediction.shapes.shape[:, j], color=COLORS[j % 8], label=name)
    axes.axhline(0, color="black", lw=0.6)
    for name, place in prediction.places.items():
        if isinstance(place, float):
            axes.axvline(place, ls="--", color="black", lw=0.9)
            axes.annotate(
                f" {verbatim(name)}", (place, axes.get_ylim()[1]), rotation=90, va="top", ha="right", fontsize=8
            )
    axes.set(xlabel="position [m]", ylabel="shape φ [kg$^{-1/2}$]")
    axes.grid(True, alpha=0.25)
    figure.legend(fontsize=8, loc="outside lower center", ncols=len(prediction.modes[0]))
    axes.set_title("Mass-normalised mode shapes with empty containers", fontsize=10)
    return figure


def balances(prediction: Prediction) -> Figure:
    """Force that the dampers hold over amplitude, mode by mode; equilibria where it meets a driving force."""
    elastic = np.flatnonzero(prediction.model.omega > 0)
    columns = min(len(elastic), 4)
    rows = -(-len(elastic) // columns)
    figure = Figure(figsize=(3.2 * columns, 3.1 * rows), layout="constrained")
    panels = np.atleast_1d(figure.subplots(rows, columns, squeeze=False)).ravel()
    for axes, mode, index in zip(panels, elastic, range(len(elastic)), strict=False):
        loaded = load_mode(prediction.model, int(mode), DRIVE, prediction.forces[0], prediction.dampers)
        box = search_box(loaded, reach=float(np.log(10.0))) if loaded.dampers else "no damper moves in this mode"
        result = prediction.modes[0][index].result
        axes.set_title(f"mode {result.number}, {result.bare_frequency:.1f} Hz", fontsize=9)
        if isinstance(box, str) or loaded.drive_shape == 0:
            axes.text(0.5, 0.5, "outside the field", ha="center", va="center", transform=axes.transAxes, fontsize=8)
            continue
        curve = holding_curve(loaded, box, 300)
        axes.loglog(curve.intensity, curve.force, ".", ms=2, color="black")
        for k, force in enumerate(prediction.forces):
            axes.axhline(force, color=COLORS[k % 8], lw=1, label=f"{force:g} N")
            for state in prediction.modes[k][index].result.equilibria:
                axes.plot(
                    np.nanmax(state.intensity),
                    force,
                    "o",
                    color=COLORS[k % 8] if state.is_stable else "white",
                    mec=COLORS[k % 8],
                )
        if not np.isfinite(curve.force).any():
            axes.text(0.5, 0.5, "no force is held", ha="center", va="center", transform=axes.transAxes, fontsize=8)
        axes.grid(True, alpha=0.3)
        for axis in (axes.xaxis, axes.yaxis):
            low, high = axis.get_view_interval()
            if high < 50.0 * low:
                log_axis(axis)
            else:  # room for powers of ten only
                axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))
                axis.set_minor_formatter(NullFormatter())
    for axes in panels[len(elastic) :]:
        axes.set_axis_off()
    first = next((axes for axes in panels if axes.get_legend_handles_labels()[0]), None)
    if first is not None:
        first.legend(fontsize=7)
    figure.supxlabel("intensity Γ of the damper that moves most [-]", fontsize=9)
    figure.supylabel("force held at resonance [N]", fontsize=9)
    figure.suptitle("Energy balance (filled: stable, open: unstable)", fontsize=10)
    return figure


def study(data: Study) -> Figure:
    """Damping ratio and frequency shift of every mode over force or position."""
    figure = Figure(figsize=(11, 4.2), layout="constrained")
    left, right = figure.subplots(1, 2)
    for j in range(len(data.predictions[0])):
        states = [_best(row[j].equilibria) for row in data.predictions]
        zeta = np.array([100 * state.damping_ratio if state else np.nan for state in states])
        error = np.array([100 * state.damping_ratio_se if state else np.nan for state in states])
        beyond = np.array([bool(state and state.extrapolated) for state in states])
        bare = np.array([row[j].bare_frequency for row in data.predictions])
        shift = np.array(
            [100 * (state.frequency / f - 1) if state else np.nan for state, f in zip(states, bare, strict=True)]
        )
        color = COLORS[j % 8]
        name = f"mode {data.predictions[0][j].number}"
        for axes, values in ((left, zeta), (right, shift)):
            axes.plot(data.value, values, "-", color=color, lw=1.3, label=name)
            axes.plot(data.value[beyond], values[beyond], "o", mfc="white", mec=color, ms=4)
            axes.plot(data.value[~beyond], values[~beyond], "o", color=color, ms=3)
        left.fill_between(data.value, zeta - error, zeta + error, color=color, alpha=0.2, lw=0)
    left.set(xlabel=data.name, ylabel="damping ratio ζ [%]", ylim=(0, None))
    right.set(xlabel=data.name, ylabel="shift of the resonance by the bed [%]")
    if not any(mode.equilibria for row in data.predictions for mode in row):
        left.text(0.5, 0.5, "no equilibrium", transform=left.transAxes, ha="center")
        if len(data.value) > 1:  # nothing is drawn that the axes could be fitted to
            for axes in (left, right):
                axes.set_xlim(np.min(data.value), np.max(data.value))
    if data.name.startswith("force"):
        for axes in (left, right):
            axes.set_xscale("log")
            log_axis(axes.xaxis)
    for axes in (left, right):
        axes.grid(True, alpha=0.25)
    left.legend(fontsize=8)
    figure.suptitle(
        f"Every mode over {data.name} (open markers: field extrapolated; band: standard error)", fontsize=10
    )
    return figure
