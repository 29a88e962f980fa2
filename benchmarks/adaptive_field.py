"""Cost and error of an adaptive field against the full grid of the same damper, and against a plain coarse grid.

The full grid of 28 x 15 points is the reference. It is computed into the store as far as it is not there; a stopped
run goes on. The adaptive plan chooses among the same points and finds all its answers in the store, so that both see
the same runs; that nothing is computed anew is checked.

    python benchmarks/adaptive_field.py --store FOLDER [--max-cost 0.1] [--out FILE.md]
"""

import argparse
import platform
from datetime import date
from importlib.metadata import version
from pathlib import Path
from typing import NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from graindamp.campaign.executors import executor_of
from graindamp.campaign.run import FieldRun, run_field
from graindamp.campaign.store import Store
from graindamp.field.schema import places_of
from graindamp.field.surrogate import Surrogate
from graindamp.spec.field import AdaptivePlan, FieldSpec, FrequencyAxis, GridPlan, IntensityAxis, StopSpec
from graindamp.spec.model import load_spec
from graindamp.units import STANDARD_GRAVITY

Real = NDArray[np.float64]

DAMPER = Path(__file__).parent.parent / "examples" / "small-damper-field.toml"
STOP = StopSpec(tolerance=0.04, max_cycles=80)
RANGES = (40.0, 1000.0), (0.8, 40.0)
SHAPE = 28, 15
CLEARANCE = 3.14159e-3
FLOOR = 0.05
QUANTITIES = ("loss_factor", "effective_mass_ratio")


class Way(NamedTuple):
    """One way to a field on the full grid; axis 0 of the arrays is eta, m'."""

    name: str
    values: Real  # (quantity, frequency, intensity)
    errors: Real | None
    is_simulated: NDArray[np.bool_]
    cost: float  # over that of the full grid


def specs(max_cost: float) -> tuple[FieldSpec, FieldSpec]:
    """Full grid and adaptive plan of the damper."""
    spec = load_spec(DAMPER, FieldSpec).model_copy(update={"stop": STOP, "softening_study": None})
    axes = (
        FrequencyAxis(start=RANGES[0][0], stop=RANGES[0][1], count=SHAPE[0]),
        IntensityAxis(start=RANGES[1][0], stop=RANGES[1][1], count=SHAPE[1]),
    )
    grid = GridPlan(frequency=axes[0], intensity=axes[1])
    plan = AdaptivePlan(
        kind="adaptive", frequency_range=RANGES[0], intensity_range=RANGES[1], max_points=420, max_cost=max_cost
    )
    return spec.model_copy(update={"plan": grid}), spec.model_copy(update={"plan": plan})


def simulated(spec: FieldSpec, folder: Path) -> FieldRun:
    """A field, its points from the store or computed into it."""
    crew = executor_of("local")
    try:
        with Store(folder) as store:
            return run_field(spec, store, crew, project=DAMPER)
    finally:
        crew.shutdown()


def values_of(field: xr.Dataset, suffix: str = "") -> Real:
    return np.stack([field[name + suffix].to_numpy() for name in QUANTITIES])


def adaptive(run: FieldRun, full: xr.Dataset) -> Way:
    """The surrogate's field."""
    f, gamma = (axis.round(6) for axis in places_of(full))
    points = {(round(a, 6), round(b, 6)) for a, b in np.column_stack([axis.ravel() for axis in places_of(run.points)])}
    is_simulated = np.array(
        [[place in points for place in zip(*row, strict=True)] for row in zip(f, gamma, strict=True)]
    )
    cost = float(run.points["particle_steps"].sum() / full["particle_steps"].sum())
    name = f"adaptive, {run.points.sizes['point']} points"
    return Way(name, values_of(run.field), values_of(run.field, "_se"), is_simulated, cost)


def uniform(full: xr.Dataset, budget: float) -> Way:
    """The evenly spread subgrid of most points that costs no more, interpolated linearly in ln f, ln Gamma.

    eta is interpolated as its logarithm, m' as it is.
    """
    from scipy.interpolate import RegularGridInterpolator

    steps, total = full["particle_steps"].to_numpy(), float(full["particle_steps"].sum())
    found: list[tuple[int, float, NDArray[np.int64], NDArray[np.int64]]] = []
    for n in range(2, SHAPE[0] + 1):
        for m in range(2, SHAPE[1] + 1):
            rows = np.round(np.linspace(0, SHAPE[0] - 1, n)).astype(np.int64)
            columns = np.round(np.linspace(0, SHAPE[1] - 1, m)).astype(np.int64)
            cost = float(steps[np.ix_(rows, columns)].sum() / total)
            if cost <= budget and 0.5 < n / m < 3.0:
                found.append((n * m, cost, rows, columns))
    _, cost, rows, columns = max(found, key=lambda one: one[:2])
    f, gamma = (np.log(full[name].to_numpy()) for name in ("frequency", "intensity"))
    where = np.stack(np.meshgrid(f, gamma, indexing="ij"), axis=-1)
    eta, mass = values_of(full)[:, rows][:, :, columns]
    axes = f[rows], gamma[columns]
    values = [np.exp(RegularGridInterpolator(axes, np.log(eta))(where)), RegularGridInterpolator(axes, mass)(where)]
    is_simulated = np.zeros(SHAPE, bool)
    is_simulated[np.ix_(rows, columns)] = True
    return Way(f"uniform {len(rows)} × {len(columns)}, interpolated", np.stack(values), None, is_simulated, cost)


def relative_errors(way: Way, full: xr.Dataset) -> Real:
    """|error| of eta over max(eta, 0.05), of m' over the same, and of m' over max(|m'|, 0.05); (3, ...)."""
    exact = values_of(full)
    wrong = np.abs(way.values - exact)
    sizes = [np.maximum(np.abs(exact[k]), FLOOR) for k in (0, 1)]
    return np.stack([wrong[0] / sizes[0], wrong[1] / sizes[0], wrong[1] / sizes[1]])


def edge_frequency(frequency: Real, eta: Real) -> float:
    """Frequency above that of the largest eta at which eta has fallen to half of it [Hz]; NaN if it does not."""
    peak = int(np.argmax(eta))
    below = np.flatnonzero(eta[peak:] < eta[peak] / 2)
    if not below.size:
        return np.nan
    k = peak + int(below[0])
    share = (eta[k - 1] - eta[peak] / 2) / (eta[k - 1] - eta[k])
    return float(frequency[k - 1] * (frequency[k] / frequency[k - 1]) ** share)


def edges(full: xr.Dataset, values: Real) -> Real:
    """Edge of every row of intensity where the best stroke h / pi lies inside the range; (intensity,) [Hz]."""
    frequency, intensity = full["frequency"].to_numpy(), full["intensity"].to_numpy()
    best = np.sqrt(intensity * STANDARD_GRAVITY / (CLEARANCE / np.pi)) / (2 * np.pi)
    cell = frequency[1] / frequency[0]
    rows = best > frequency[0] * np.sqrt(cell)
    return np.array([edge_frequency(frequency, values[0, :, j]) if rows[j] else np.nan for j in range(len(intensity))])


def coverage(way: Way, full: xr.Dataset, width: float) -> Real:
    """Share of the points not simulated whose value lies within so many standard errors, the grid's own included."""
    assert way.errors is not None
    error = np.hypot(way.errors, values_of(full, "_se"))
    inside = np.abs(way.values - values_of(full)) <= width * error
    return np.asarray(inside[:, ~way.is_simulated].mean(axis=1))


def repeatability(full: xr.Dataset) -> Real:
    """Median difference of a point from the mean of its two neighbours in f, over sqrt(1.5), in the same measures (3,).

    That is what even a perfect field would show against single runs, as long as neighbours lie on a straight line.
    """
    v = values_of(full)
    wrong = np.abs(v[:, 1:-1] - 0.5 * (v[:, 2:] + v[:, :-2])) / np.sqrt(1.5)
    sizes = [np.maximum(np.abs(v[k, 1:-1]), FLOOR) for k in (0, 1)]
    return np.array([np.median(wrong[0] / sizes[0]), np.median(wrong[1] / sizes[0]), np.median(wrong[1] / sizes[1])])


def error_table(ways: list[Way], full: xr.Dataset) -> list[str]:
    lines = [
        "| field | cost | where | η median | η 90 % | m′ median | m′ 90 % | m′ over its own size, median | 90 % |",
        "| --- | --: | --- | --: | --: | --: | --: | --: | --: |",
    ]
    for way in ways:
        error = relative_errors(way, full)
        for where, chosen in (("all 420 points", np.ones(SHAPE, bool)), ("not simulated", ~way.is_simulated)):
            cells = [f"{np.quantile(one[chosen], share):.3f}" for one in error for share in (0.5, 0.9)]
            lines.append(f"| {way.name} | {way.cost:.3f} | {where} | " + " | ".join(cells) + " |")
    return lines


def edge_table(ways: list[Way], full: xr.Dataset) -> tuple[list[str], list[float]]:
    """Table of the edges, and the largest error of each way in cells of the grid."""
    exact = edges(full, values_of(full))
    frequency = full["frequency"].to_numpy()
    cell = np.log(frequency[1] / frequency[0])
    lines = [
        "| Γ | edge of the full grid [Hz] | " + " | ".join(f"{way.name} [Hz] | % | cells" for way in ways) + " |",
        "| --: | --: |" + " --: | --: | --: |" * len(ways),
    ]
    worst = [0.0] * len(ways)
    for j in np.flatnonzero(np.isfinite(exact)):
        row = f"| {full['intensity'].to_numpy()[j]:.3g} | {exact[j]:.1f} |"
        for k, way in enumerate(ways):
            found = edges(full, way.values)[j]
            away = np.log(found / exact[j])
            worst[k] = max(worst[k], abs(away) / cell if np.isfinite(away) else np.inf)
            row += f" {found:.1f} | {100 * np.expm1(away):+.1f} | {away / cell:+.2f} |"
        lines.append(row)
    return lines, worst


def draw(way: Way, run: FieldRun, full: xr.Dataset, path: Path) -> None:
    """Full map, adaptive map with its points, and the error of eta."""
    from matplotlib.colors import LogNorm, Normalize
    from matplotlib.figure import Figure
    from matplotlib.ticker import FuncFormatter, NullFormatter

    f, gamma = full["frequency"].to_numpy(), full["intensity"].to_numpy()
    figure = Figure(figsize=(12.0, 7.0), layout="constrained")
    panels = figure.subplots(2, 3, sharex=True, sharey=True)
    exact, error = values_of(full), relative_errors(way, full)
    names = ("loss factor η", "effective mass ratio m′")
    points_f, points_gamma = places_of(run.points)
    stroke = CLEARANCE / np.pi * (2 * np.pi * f) ** 2 / STANDARD_GRAVITY
    for k in (0, 1):
        norm = LogNorm(0.02, 1.3) if k == 0 else Normalize(-0.2, 1.2)
        colors = "viridis" if k == 0 else "cividis"
        maps = (
            (f"full grid, 420 points: {names[k]}", exact[k], norm, colors),
            (f"{way.name}, {100 * way.cost:.1f} % of the cost", way.values[k], norm, colors),
            ("|error| / max(η, 0.05)", np.maximum(error[k], 1e-3), LogNorm(0.01, 1.0), "magma_r"),
        )
        for axes, (title, shown, scale, palette) in zip(panels[k], maps, strict=True):
            mesh = axes.pcolormesh(f, gamma, shown.T, norm=scale, cmap=palette, shading="nearest")
            axes.plot(f, stroke, "--", color="tab:orange", lw=1.2, label="X = h/π")
            axes.set(xscale="log", yscale="log", title=title, ylim=(0.7, 46.0))
            axes.title.set_fontsize(10)
            bar = figure.colorbar(mesh, ax=axes)
            if isinstance(scale, LogNorm):
                bar.ax.yaxis.set_major_formatter(FuncFormatter(lambda x, _: f"{x:g}"))
                bar.ax.yaxis.set_minor_formatter(NullFormatter())
        for axes in panels[k, 1:]:
            axes.plot(points_f, points_gamma, "o", ms=4, mfc="white", mec="black", mew=0.8, label="simulated")
        panels[k, 0].set_ylabel("excitation intensity Γ [-]")
    for axes in panels[1]:
        axes.set_xlabel("frequency f [Hz]")
    for axis, ticks in ((panels[0, 0].xaxis, (50, 100, 200, 500, 1000)), (panels[0, 0].yaxis, (1, 2, 5, 10, 20, 40))):
        axis.set_ticks(ticks)
        axis.set_major_formatter(FuncFormatter(lambda x, _: f"{x:g}"))
        axis.set_minor_formatter(NullFormatter())
    figure.legend(*panels[0, 1].get_legend_handles_labels(), loc="outside lower center", ncols=2, fontsize=9)
    figure.savefig(path, dpi=110)


def verdict_of(run: FieldRun, max_cost: float) -> str:
    """How the plan ended, in words."""
    from graindamp.field.adaptive import is_accurate

    surrogate = Surrogate(run.points, CLEARANCE)
    found = is_accurate(surrogate, *RANGES)
    if found.is_accurate:
        return "It ended because the predicted errors are within 5 % everywhere."
    share, median = 100 * found.share, 5 * found.median_ratio
    return "\n".join([
        f"It ended at its limit of cost, max_cost = {max_cost:g}. Predicted errors are then within 5 % of max(η, 0.05)",
        f"at {share:.0f} % of the range; their median is {median:.1f} %; the worst, at {found.frequency:.0f} Hz and",
        f"Γ = {found.intensity:.3g}, is {found.worst_ratio:.0f} times the asked one.",
    ])  # fmt: skip


def report(full_run: FieldRun, run: FieldRun, max_cost: float) -> tuple[str, Way]:
    full = full_run.field
    found = adaptive(run, full)
    ways = [found, uniform(full, max(found.cost, 0.1))]
    edge_lines, worst = edge_table(ways, full)
    noise = repeatability(full)
    cell = 100.0 * float(full["frequency"][1] / full["frequency"][0] - 1.0)
    shares = [coverage(found, full, width) for width in (1.0, 2.0)]
    steps = [float(one["particle_steps"].sum()) for one in (full, run.points)]
    text = "\n".join([
        "| | points | particle-steps |",
        "| --- | --: | --: |",
        f"| full grid | 420 | {steps[0]:.3g} |",
        f"| adaptive | {run.points.sizes['point']} | {steps[1]:.3g} |",
        f"| ratio | {run.points.sizes['point'] / 420:.3f} | {steps[1] / steps[0]:.3f} |",
        "",
        verdict_of(run, max_cost),
        "",
        "## Errors against the full grid",
        "",
        "|error| of η and of m′ over max(η, 0.05), which is what the plan is asked for; in the last two columns",
        "that of m′ over max(|m′|, 0.05). The uniform grid is the one of most points that costs no more than a tenth.",
        "",
        *error_table(ways, full),
        "",
        "The full grid is itself a single run at each point. Its points differ from the mean of their neighbours",
        f"in f by {noise[0]:.3f} (η), {noise[1]:.3f} (m′) and {noise[2]:.3f} (m′ over its own size) in the median,",
        "already divided by √1.5: that much is scatter of "
        "the runs.",
        "",
        "## Where the edge lies",
        "",
        "Frequency at which η has fallen to half of its peak over f, for each Γ whose best stroke X = h/π lies in",
        f"the range; a cell of the grid is {cell:.1f} % of f.",
        "",
        *edge_lines,
        "",
        "## Error bars",
        "",
        "Share of the points not simulated that lie within so many standard errors, those of the grid added in",
        "quadrature (68 % and 95 % would be right if all errors were independent and normal):",
        "",
        "| | 1 σ | 2 σ |",
        "| --- | --: | --: |",
        *(f"| {name} | {100 * shares[0][k]:.0f} % | {100 * shares[1][k]:.0f} % |" for k, name in ((0, "η"), (1, "m′"))),
    ])  # fmt: skip
    error = relative_errors(found, full)
    assert run.n_computed == 0, "the adaptive plan left the full grid"
    assert steps[1] <= 0.1 * steps[0], "the adaptive field costs more than a tenth of the full grid"
    assert np.all(np.median(error[:2], axis=(1, 2)) <= 0.05), "the median error of η or m′ is above 5 %"
    assert worst[0] <= 1.0, "the edge lies more than a cell of the grid from where it should"
    # A share of 0.95 that errors of neighbours make scatter; below 0.8 the error bars would mislead.
    assert np.all(shares[1] >= 0.8), "the error bars are too small"
    return text, found


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--store", type=Path, required=True)
    parser.add_argument("--max-cost", type=float, default=0.1)
    parser.add_argument("--out", type=Path, default=Path(__file__).parent / "results" / "adaptive_field.md")
    given = parser.parse_args()
    grid, plan = specs(given.max_cost)
    full_run, run = simulated(grid, given.store), simulated(plan, given.store)
    text, found = report(full_run, run, given.max_cost)
    picture = given.out.with_suffix(".png")
    draw(found, run, full_run.field, picture)
    told = "\n".join([
        f"# Adaptive field against the full grid, {date.today()}",
        "",
        f"`python benchmarks/adaptive_field.py --store FOLDER`; damper of examples/{DAMPER.name} (500",
        f"spheres, softening 100), 28 × 15 points, stop.tolerance {STOP.tolerance:g}, at most {STOP.max_cycles}",
        f"cycles; graindamp {version('graindamp')}, physics {full_run.field.attrs['physics']},",
        f"Python {platform.python_version()}, numpy {np.__version__}, scikit-learn {version('scikit-learn')}.",
        "",
        text,
        "",
        f"![full map, adaptive map, error]({picture.name})",
        "",
    ])  # fmt: skip
    given.out.write_text(told, encoding="utf-8")
    print(told)


if __name__ == "__main__":
    main()
