"""Figures of how beds move and where their energy goes: maps of motion modes, velocity fields, energy paths.

Each function draws one picture and returns it. The maps and velocity fields are laid out as in Meyer & Seifried (2023),
"Design of robust particle dampers", Figs 1, 4, 9 and 13.
"""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import xarray as xr
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.colors import BoundaryNorm, ListedColormap
from matplotlib.figure import Figure
from matplotlib.patches import Patch, PathPatch
from matplotlib.path import Path as Outline
from matplotlib.patheffects import withStroke
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from graindamp.campaign.point import LOSSES as MECHANISMS
from graindamp.campaign.point import PointResult
from graindamp.errors import InputError
from graindamp.field.interpolate import Interpolant
from graindamp.field.schema import damper_of, places_of
from graindamp.report.figures import COLORS, log_axis
from graindamp.report.ledger import LOSSES, ledger_of
from graindamp.report.motion_picture import RARE, Scene, headline, stage_of, velocity_amplitude_of, view_of
from graindamp.report.wording import verbatim
from graindamp.signals.motion_modes import NAMES, MotionMode
from graindamp.status import FATAL
from graindamp.units import STANDARD_GRAVITY

if TYPE_CHECKING:
    from graindamp.dem.run import Run

Real = NDArray[np.float64]

MARKS: dict[MotionMode, tuple[str, str]] = {
    MotionMode.UNKNOWN: ("#ffffff", "?"),
    MotionMode.SOLID_LIKE: ("#bdbdbd", "S"),
    MotionMode.LOCAL_FLUIDIZATION: ("#a6d8f5", "L"),
    MotionMode.GLOBAL_FLUIDIZATION: ("#4a9fd0", "G"),
    MotionMode.BOUNCING: ("#e8843c", "B"),
    MotionMode.DECOUPLED: ("#f3e96b", "D"),
    MotionMode.COMPRESSION: ("#4dbb95", "C"),
}
"""Colour and letter of each mode, after Okabe & Ito (2008), lightened so that black letters can be read on them. The
letters carry the same as the colours."""

STROKES = (1e-7, 1e-6, 1e-5, 1e-4, 1e-3, 1e-2)
"""Strokes whose lines are drawn [m]."""

_BLUE_TO_RED = ListedColormap(colormaps["turbo"](np.linspace(0.08, 0.93, 256)))

MOST_LETTERS = 700
"""Points above which a map shows colours alone [-]."""

_GAP = 0.09
"""Between the bands of an energy path, over what goes through it [-]; two lines of text high."""

FINE = 300
"""Places per axis that a map is coloured at [-]."""


def mode_map(
    field: xr.Dataset, clearance: float | None = None, title: str = "", points: xr.Dataset | None = None
) -> Figure:
    """Loss factor above, motion modes below, over frequency and intensity, with lines of constant stroke.

    Args:
        field: an effective field with the variable `motion_mode`.
        clearance: free travel h [m], for the line X_opt = h / pi; None: that in the description of the damper.
        title: heading; default the name of the damper.
        points: what was simulated, where the field is a prediction from it: modes and letters are theirs.

    Raises:
        InputError: the field holds no motion modes.
    """
    known = field if points is None else points
    if "motion_mode" not in known:
        raise InputError("the field holds no motion_mode; simulate it, measured fields have none")
    damper = damper_of(field)
    clearance = damper.get("clearance") if clearance is None else clearance
    f, gamma = (values.ravel() for values in places_of(known))
    figure = Figure(figsize=(7.6, 8.6), layout="constrained")
    upper, lower = figure.subplots(2, 1, sharex=True, sharey=True)
    _filled_loss_factor(figure, upper, field)
    modes = known["motion_mode"].to_numpy().ravel()
    present = _coloured_modes(lower, f, gamma, modes)
    for axes in (upper, lower):
        axes.set(xscale="log", yscale="log", xlim=(f.min(), f.max()), ylim=(gamma.min(), gamma.max()))
        axes.set_ylabel("excitation intensity Γ = A/g [-]")
        for axis in (axes.xaxis, axes.yaxis):
            log_axis(axis)
    lower.set_xlabel("frequency f [Hz]")
    if len(modes) <= MOST_LETTERS:
        for x, y, mode in zip(f, gamma, modes, strict=True):
            inward = (5 * (x == f.min()) - 5 * (x == f.max()), 5 * (y == gamma.min()) - 5 * (y == gamma.max()))
            lower.annotate(
                MARKS[MotionMode(mode)][1], (x, y), inward, textcoords="offset points", ha="center", va="center",
                fontsize=7,
            )  # fmt: skip
    handles = [
        Patch(facecolor=MARKS[mode][0], edgecolor="black", lw=0.5, label=f"{MARKS[mode][1]}  {NAMES[mode]}")
        for mode in present
    ]
    figure.legend(handles=handles, loc="outside lower center", ncols=3, fontsize=8, frameon=False)
    figure.suptitle(verbatim(title or damper.get("name") or "effective field"), fontsize=11)
    figure.draw_without_rendering()  # places the panels, so that the slope of the lines is known
    stroke_lines(upper, clearance, "white")
    stroke_lines(lower, clearance, "black")
    return figure


def _filled_loss_factor(figure: Figure, axes: Axes, field: xr.Dataset) -> None:
    """Contours of eta up to 1, as the paper shows it."""
    at = Interpolant(field, "constant")
    f, gamma = np.geomspace(*at.frequency_range, FINE), np.geomspace(*at.intensity_range, FINE)
    values = at(f[:, None], gamma[None, :])
    eta = np.where(values.extrapolated, np.nan, values.loss_factor)
    drawn = axes.contourf(f, gamma, np.maximum(eta, 0.0).T, levels=np.linspace(0.0, 1.0, 21), extend="max")
    bar = figure.colorbar(drawn, ax=axes, ticks=np.linspace(0.0, 1.0, 6))
    bar.set_label("loss factor η [-]")


def _coloured_modes(axes: Axes, f: Real, gamma: Real, modes: NDArray[np.int64]) -> list[MotionMode]:
    """Each place in the colour of the nearest point; the modes that are there."""
    x, y = np.geomspace(f.min(), f.max(), FINE), np.geomspace(gamma.min(), gamma.max(), FINE)
    scale = np.array([_spacing(f), _spacing(gamma)])
    fine = np.stack(np.meshgrid(np.log(x), np.log(y), indexing="ij"), axis=-1) / scale
    _, nearest = cKDTree(np.column_stack([np.log(f), np.log(gamma)]) / scale).query(fine)
    codes = [int(mode) for mode in MARKS]
    colors = ListedColormap([color for color, _ in MARKS.values()])
    norm = BoundaryNorm([*(code - 0.5 for code in codes), codes[-1] + 0.5], len(codes))
    axes.pcolormesh(x, y, modes[nearest].T, cmap=colors, norm=norm, shading="nearest", rasterized=True)
    return [mode for mode in MARKS if mode in modes]


def _spacing(values: Real) -> float:
    """Typical distance of neighbouring values in the logarithm; 1 where all are one."""
    steps = np.diff(np.unique(np.log(values)))
    return float(np.median(steps)) if len(steps) else 1.0


def stroke_lines(axes: Axes, clearance: float | None, color: str = "black") -> None:
    """Lines of constant stroke X with their value, and X_opt = h / pi dashed, on axes of f and Gamma whose limits and
    place in the figure are final."""
    (left, right), (bottom, top) = axes.get_xlim(), axes.get_ylim()
    lines: list[tuple[float, str, str, float]] = [(stroke, f"X = {1e3 * stroke:g} mm", "-", 0.7) for stroke in STROKES]
    if clearance is not None and clearance > 0.0:
        optimum = clearance / np.pi
        lines = [line for line in lines if abs(np.log(line[0] / optimum)) > 0.3]
        lines.append((optimum, f"$X_{{opt}}$ = h/π = {1e3 * optimum:.3g} mm", "--", 1.6))
    f = np.geomspace(left, right, 400)
    for stroke, text, style, width in lines:
        level = stroke * (2.0 * np.pi * f) ** 2 / STANDARD_GRAVITY
        inside = np.flatnonzero((level >= bottom) & (level <= top))
        if len(inside) < 40:
            continue
        axes.plot(f[inside], level[inside], style, color=color, lw=width)
        k = inside[int(0.62 * len(inside))]
        box = axes.get_window_extent()
        angle = np.degrees(np.arctan2(2.0 * box.height / np.log(top / bottom), box.width / np.log(right / left)))
        axes.annotate(
            text, (f[k], level[k]), (-2, 2), textcoords="offset points", color=color, fontsize=7, rotation=angle,
            rotation_mode="anchor", ha="center", va="bottom",
            path_effects=[withStroke(linewidth=2.0, foreground="black" if color == "white" else "white", alpha=0.5)],
        )  # fmt: skip


def velocity_fields(runs: Mapping[str, "Run"], offset: float = 0.0, columns: int = 2) -> Figure:
    """Absolute in-plane particle velocity over V in the plane of motion and gravity, a panel for each run, blue to red.

    All panels share one scale. White: cells that fewer than RARE particles a cycle visit.

    Args:
        runs: simulated runs with a velocity field, by what stands above their panels.
        offset: distance of the plane from the middle of the container [m], towards the viewer; it hides inserts.
        columns: panels beside each other.

    Raises:
        InputError: a run has no velocity field, or the plane misses the bed.
    """
    slices = {name: _slice(run, offset) for name, run in runs.items()}
    most = max(float(np.nanmax(one.size)) for one in slices.values())
    columns = min(columns, len(slices))
    rows = -(-len(slices) // columns)
    shape = next(iter(slices.values())).bounds
    ratio = (shape[3] - shape[2]) / (shape[1] - shape[0])
    figure = Figure(figsize=(4.6 * columns + 0.9, (4.0 * ratio + 0.8) * rows + 0.3), layout="compressed")
    panels = np.atleast_1d(figure.subplots(rows, columns, squeeze=False)).ravel()
    drawn: Any = None
    for axes, (name, one) in zip(panels, slices.items(), strict=False):
        drawn = axes.pcolormesh(one.right, one.up, one.size.T, cmap=_BLUE_TO_RED, vmin=0.0, vmax=most)
        axes.quiver(
            0.5 * (one.right[1:] + one.right[:-1]), 0.5 * (one.up[1:] + one.up[:-1]), one.x.T, one.y.T, angles="xy",
            scale_units="xy", scale=most / (one.right[1] - one.right[0]) / 1.2, width=0.003, pivot="middle",
        )  # fmt: skip
        for line in one.walls:
            axes.plot(*line.T, color="#222222", lw=1.2)
        axes.set(aspect="equal", xlim=one.bounds[:2], ylim=one.bounds[2:])
        axes.set_title(name, fontsize=9)
        axes.set(xlabel=f"{one.names[0]} [mm]", ylabel=f"{one.names[1]} [mm]")
    for axes in panels[len(slices) :]:
        axes.set_axis_off()
    bar = figure.colorbar(drawn, ax=list(panels), fraction=0.04, pad=0.02)
    bar.set_label("in-plane speed in the frame at rest / V [-]")
    first = next(iter(runs.values()))
    assert first.velocity_field is not None
    place = f"phase {np.rad2deg(first.velocity_field.phase):.3g}°"
    if abs(np.cos(first.velocity_field.phase)) < 1e-6:
        place = "$x_c$ = X" if np.sin(first.velocity_field.phase) > 0 else "$x_c$ = −X"
    beside = f", {1e3 * offset:g} mm beside the middle plane" if offset else ""
    figure.suptitle(f"velocity fields at {place}{beside}", fontsize=10)
    return figure


class _Slice(NamedTuple):
    """Velocities of one plane, in mm and over V."""

    right: Real
    up: Real
    x: Real
    y: Real
    size: Real
    walls: list[Real]
    bounds: tuple[float, float, float, float]
    names: tuple[str, str]


def _slice(run: "Run", offset: float) -> _Slice:
    field = run.velocity_field
    unit = velocity_amplitude_of(run.spec)
    if field is None or unit is None:
        raise InputError("a run holds no velocity field, or its motion is not harmonic; add [run.velocity_field]")
    view = view_of(run.spec, run.direction)
    axes = [int(np.argmax(np.abs(axis))) for axis in view[:3]]
    signs = [float(axis[k]) for axis, k in zip(view[:3], axes, strict=True)]
    scene = Scene(run.packing.position, None, np.zeros(3))
    stage = stage_of(run.spec, run.enclosure, run.radius, [scene], run.direction, (0.0, 1.0, ""))
    velocity = np.asarray(field.velocity) + unit * np.cos(field.phase) * np.asarray(run.direction)
    layers, met = np.moveaxis(velocity, axes, (0, 1, 2)), np.moveaxis(np.asarray(field.met), axes, (0, 1, 2))
    depth = signs[2] * (field.origin[axes[2]] + field.cell * (np.arange(layers.shape[2]) + 0.5))
    near = np.abs(depth - stage.middle - offset) <= 0.5001 * field.cell  # two where the plane lies between them
    seen = np.isfinite(layers).all(axis=3) & (met >= RARE * field.n_cycle) & near
    number = np.where(seen, met, 0).sum(axis=2)
    if not number.any():
        raise InputError(
            f"cells of {1e3 * field.cell:g} mm at {1e3 * offset:g} mm beside the middle plane are visited by fewer "
            f"than {RARE:g} particles a cycle; choose larger cells in [run.velocity_field], or a smaller offset"
        )
    weight = np.where(seen, met, 0)[..., None]
    mean = np.sum(weight * np.where(seen[..., None], layers, 0.0), axis=2) / np.maximum(number, 1)[..., None] / unit
    mean = np.where(number[..., None] > 0, mean, np.nan)
    x, y = mean @ view.right, mean @ view.up
    edges = []
    for n in (0, 1):
        edge = signs[n] * (field.origin[axes[n]] + field.cell * np.arange(layers.shape[n] + 1))
        if signs[n] < 0.0:
            edge, x, y = edge[::-1], np.flip(x, axis=n), np.flip(y, axis=n)
        edges.append(1e3 * edge)
    lines = [1e3 * line @ np.stack([view.right, view.up], axis=1) for part in stage.walls.values() for line in part]
    left, right, low, high = (1e3 * bound for bound in stage.bounds)
    return _Slice(edges[0], edges[1], x, y, np.hypot(x, y), lines, (left, right, low, high), view.names)


class LossShares(NamedTuple):
    """Share of each mechanism in all that is dissipated, at some operating points."""

    frequency: Real
    """[Hz]; (point,)."""
    intensity: Real
    """[-]; (point,)."""
    share: Real
    """[-], NaN where unknown; (point, mechanism), in the order of :data:`graindamp.campaign.point.LOSSES`."""


def shares_of_points(points: Sequence[PointResult]) -> LossShares:
    """Shares from simulated operating points."""
    losses = np.array([point.losses for point in points], dtype=np.float64).reshape(len(points), len(MECHANISMS))
    total = losses.sum(axis=1, keepdims=True)
    with np.errstate(invalid="ignore", divide="ignore"):
        share = np.where(total > 0.0, losses / total, np.nan)
    return LossShares(
        np.array([point.frequency for point in points]), np.array([point.intensity for point in points]), share
    )


def shares_of_field(field: xr.Dataset) -> LossShares:
    """Shares from a field with variables such as loss_share_friction.

    Raises:
        InputError: it has none.
    """
    names = [name.replace("loss_", "loss_share_", 1) for name in MECHANISMS]
    if not any(name in field for name in names):
        raise InputError(f"the field holds no {names[0]}; simulate it, measured fields have none")
    f, gamma = (values.ravel() for values in places_of(field))
    share = np.stack([field[name].to_numpy().ravel() if name in field else np.zeros(f.size) for name in names], axis=1)
    failed = (field["status"].to_numpy().ravel() & int(FATAL)) != 0
    return LossShares(f, gamma, np.where(failed[:, None], np.nan, share))


def _taking_part(shares: LossShares) -> list[int]:
    """Mechanisms that dissipate anything, by number; the largest alone where none is worth showing."""
    largest = np.max(np.nan_to_num(shares.share), axis=0)
    return np.flatnonzero(largest > 1e-4).tolist() or [int(np.argmax(largest))]


def loss_shares(shares: LossShares, frequencies: Sequence[float] | None = None) -> Figure:
    """Which mechanism dissipates what share over intensity, a panel for each frequency.

    Args:
        shares: at operating points of which several have one frequency.
        frequencies: those to show [Hz], each taken at the nearest there is; None: up to four, spread evenly.
    """
    there = np.unique(shares.frequency)
    if frequencies is None:
        chosen = there[np.unique(np.linspace(0, len(there) - 1, 4).round().astype(int))]
    else:
        chosen = np.unique([there[np.argmin(np.abs(np.log(there / f)))] for f in frequencies])
    figure = Figure(figsize=(3.0 * len(chosen) + 0.6, 3.7), layout="constrained")
    panels = np.atleast_1d(figure.subplots(1, len(chosen), sharey=True, squeeze=False)).ravel()
    used = _taking_part(shares)
    for axes, f in zip(panels, chosen, strict=True):
        rows = np.flatnonzero((shares.frequency == f) & np.isfinite(shares.share).all(axis=1))
        rows = rows[np.argsort(shares.intensity[rows])]
        axes.stackplot(
            shares.intensity[rows], 100.0 * shares.share[rows][:, used].T, colors=[COLORS[k] for k in used],
            labels=[LOSSES[MECHANISMS[k]] for k in used], edgecolor="white", linewidth=0.6,
        )  # fmt: skip
        axes.set(xscale="log", ylim=(0.0, 100.0), xlabel="intensity Γ [-]")
        axes.set_title(f"{f:.4g} Hz", fontsize=10)
        log_axis(axes.xaxis)
        axes.tick_params(axis="x", labelsize=8)
        axes.margins(x=0.0)
    panels[0].set_ylabel("share of what is dissipated [%]")
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=3, fontsize=8, frameon=False)
    return figure


def loss_share_maps(shares: LossShares, clearance: float | None = None) -> Figure:
    """Share of each mechanism over frequency and intensity, a panel for each that takes part.

    Args:
        shares: at operating points.
        clearance: free travel h [m], for the line X_opt = h / pi.
    """
    used = _taking_part(shares)
    columns = min(len(used), 2)
    rows = -(-len(used) // columns)
    figure = Figure(figsize=(4.6 * columns + 0.8, 3.4 * rows + 0.2), layout="constrained")
    panels = np.atleast_1d(figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False)).ravel()
    known = np.isfinite(shares.share).all(axis=1)
    f, gamma = shares.frequency[known], shares.intensity[known]
    x, y = np.geomspace(f.min(), f.max(), FINE), np.geomspace(gamma.min(), gamma.max(), FINE)
    scale = np.array([_spacing(f), _spacing(gamma)])
    fine = np.stack(np.meshgrid(np.log(x), np.log(y), indexing="ij"), axis=-1) / scale
    _, nearest = cKDTree(np.column_stack([np.log(f), np.log(gamma)]) / scale).query(fine)
    drawn: Any = None
    for axes, k in zip(panels, used, strict=False):
        drawn = axes.pcolormesh(
            x, y, 100.0 * shares.share[known, k][nearest].T, cmap="viridis", vmin=0.0, vmax=100.0, shading="nearest",
            rasterized=True,
        )  # fmt: skip
        axes.set(xscale="log", yscale="log", xlim=(x[0], x[-1]), ylim=(y[0], y[-1]))
        for axis in (axes.xaxis, axes.yaxis):
            log_axis(axis)
        axes.tick_params(labelsize=8)
        axes.set_title(LOSSES[MECHANISMS[k]], fontsize=9)
    for axes in panels[len(used) :]:
        axes.set_axis_off()
    figure.supxlabel("frequency f [Hz]", fontsize=9)
    figure.supylabel("excitation intensity Γ [-]", fontsize=9)
    figure.colorbar(drawn, ax=list(panels), label="share of what is dissipated [%]")
    figure.draw_without_rendering()
    for axes in panels[: len(used)]:
        stroke_lines(axes, clearance, "white")
    return figure


def energy_path(run: "Run", n_skipped: int = 0) -> Figure:
    """The container's work per cycle and the mechanisms that it goes to, as bands whose widths are energies.

    Args:
        run: a simulated run.
        n_skipped: cycles to leave out at the start.

    Raises:
        InputError: the run recorded no energies.
    """
    ledger = ledger_of(run, n_skipped)
    if ledger is None:
        raise InputError("the run recorded no energies; simulate at least one cycle")
    n = ledger.n_cycle or 1.0
    ends = {LOSSES[name]: (value / n, COLORS[list(LOSSES).index(name)]) for name, value in ledger.losses.items()}
    ends["gain of stored energy"] = (ledger.stored / n, "#999999")
    starts = {"work of the\ncontainer": (ledger.work / n, "#333333"), "stored before": (-ledger.stored / n, "#999999")}
    total = max(ledger.throughput / n, 1e-300)
    ends = {name: pair for name, pair in ends.items() if pair[0] > 1e-4 * total}
    starts = {name: pair for name, pair in starts.items() if pair[0] > 1e-4 * total}
    power = int(np.clip(np.floor(np.log10(total) / 3.0), -4, 0))
    unit, scale = ("J", "mJ", "µJ", "nJ", "pJ")[-power], 10.0 ** (-3 * power)
    per = "per cycle" if ledger.n_cycle else ""
    figure = Figure(figsize=(8.4, 3.9), layout="constrained")
    axes = figure.subplots()
    axes.set_axis_off()
    height = max(sum(value for value, _ in part.values()) for part in (starts, ends)) / total
    right_top = height + _GAP * (len(ends) - 1)
    top = left_top = 0.5 * (height + right_top)
    for name, (value, color) in starts.items():
        width = value / total
        axes.fill_between([0.0, 0.05], left_top - width, left_top, color=color, lw=0)
        told = f"{name}\n{scale * value:.3g} {unit} {per}"
        axes.text(-0.02, left_top - 0.5 * width, told, ha="right", va="center", fontsize=9)
        left_top -= width
    for name, (value, color) in sorted(ends.items(), key=lambda item: -item[1][0]):
        width = value / total
        _band(axes, (0.05, top, top - width), (0.62, right_top, right_top - width), color)
        axes.fill_between([0.62, 0.65], right_top - width, right_top, color=color, lw=0)
        told = f"{name}\n{scale * value:.3g} {unit}, {100 * width:.3g} %"
        axes.text(0.67, right_top - 0.5 * width, told, va="center", fontsize=9)
        top -= width
        right_top -= width + _GAP
    axes.set(xlim=(-0.3, 1.1), ylim=(-0.1, height + _GAP * len(ends)))
    span = f"mean of {ledger.n_cycle:.4g} cycles" if ledger.n_cycle else f"over {ledger.stop - ledger.start:.3g} s"
    figure.suptitle(f"{headline(run.spec, run.packing.clearance)}\nenergy path, {span}", fontsize=10)
    return figure


def _band(axes: Axes, start: tuple[float, float, float], end: tuple[float, float, float], color: str) -> None:
    """A curved band between two upright edges, each given as place, top and bottom."""
    (a, a_top, a_low), (b, b_top, b_low) = start, end
    middle = 0.5 * (a + b)
    corners = [
        (a, a_top), (middle, a_top), (middle, b_top), (b, b_top), (b, b_low), (middle, b_low), (middle, a_low),
        (a, a_low), (a, a_top),
    ]  # fmt: skip
    codes = [Outline.MOVETO, *[Outline.CURVE4] * 3, Outline.LINETO, *[Outline.CURVE4] * 3, Outline.CLOSEPOLY]
    axes.add_patch(PathPatch(Outline(corners, codes), facecolor=color, alpha=0.55, lw=0))
