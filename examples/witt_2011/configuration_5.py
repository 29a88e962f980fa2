"""Configuration 5: beds of lead shot of several layers, the 36 runs of Table 4.2, over Gamma and over beta.

    python configuration_5.py [--out FOLDER] [--seeds 3] [--softening 1000] [--runs 1 2 3] [--no-run]

Writes configuration-5.png and prints the numbers; runs that are there already are not run again.
"""

import argparse
import time
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import witt_dampers
from configuration_1 import PSI_LABEL
from decays import RATE, Curve, Ringing, closing, curve, cycles_of, peak, ring
from matplotlib.figure import Figure

from graindamp.design.layers import beta, critical_intensity
from graindamp.errors import InputError
from graindamp.report.figures import COLORS, log_axis, save
from graindamp.signals.collapse import Collapse, collapse

STEPS_PER_CONTACT = 20
"""Time steps in the contact of the fastest impact that could happen [-], at twice the greatest speed of the beam."""

SOFTENING = 1000.0
"""Divisor of the stiffness of lead, polycarbonate and aluminium [-]; what it does is measured by stiffness.py."""

ORDER = [3 * k + 2 for k in (8, 4, 0, 9, 5, 1, 10, 6, 2, 11, 7, 3)]
ORDER += [12 * length + 3 * height + u for length in (2, 1, 0) for height in range(4) for u in (1, 0)]
"""Runs from 0: the largest displacement first, light beds before heavy ones."""


def duration_of(mass_ratio: float, displacement: float) -> float:
    """Time to follow a decay for [s]: with Psi_m = 1.5 the amplitude falls to a third from the largest displacement,
    to half from the others, where the next smaller one has begun; ten and six cycles at least."""
    cycle = 0.05
    cycles_per_fold = 2.0 * (1.0 + mass_ratio) ** 2 / (1.5 * mass_ratio)
    if displacement > 3e-3:
        return max(10.0 * cycle, 1.2 * cycles_per_fold * cycle)
    return max(6.0 * cycle, 0.72 * cycles_per_fold * cycle)


def run_of(
    number: int,
    folder: Path,
    seed: int = 0,
    softening: float = SOFTENING,
    steps: int = STEPS_PER_CONTACT,
    duration: float | None = None,
    turning: bool = False,
    **options: float,
) -> Ringing:
    """Run `number` of Table 4.2, from 0, for a time [s] or :func:`duration_of`, the enclosure `turning` with
    the slope of the beam or not; options as for the damper."""
    length, height, displacement = witt_dampers.LAYERS[number]
    whole = witt_dampers.structure()
    ratio = witt_dampers.COUNTS[length][height] * witt_dampers.SHOT_MASS / whole.mass

    def make(steps: int) -> Ringing:
        damper = witt_dampers.layers(length, height, seed=seed, softening=softening, **options)
        carried = witt_dampers.mounted(damper, witt_dampers.poured(damper), turning)
        time_of = duration or duration_of(ratio, displacement)
        case = witt_dampers.decay_case(whole, (carried,), displacement, time_of, RATE)
        return ring(case._replace(steps_per_contact=steps), displacement, whole.mass)

    changed = "".join(f"-{name}-{value:g}" for name, value in options.items())
    changed += "" if steps == STEPS_PER_CONTACT else f"-steps-{steps}"
    changed += "" if duration is None else f"-{duration:g}s"
    changed += "-turning" if turning else ""
    return closing(folder, f"c5-{number + 1:02d}-s{seed}-softening-{softening:g}{changed}", make, steps)


SHAPES = {1e-3: "^", 2.5e-3: "o", 5e-3: "s"}
"""Marker of every initial displacement [m]."""

Beds = Mapping[int, list[Ringing]]
"""Runs by number of the bed's height, 0 to 3; those of all displacements and seeds."""


def there(folder: Path, length: float, seeds: int, softening: float) -> Beds:
    """Runs of a cavity of length l_e [m] that are in the folder."""
    found: dict[int, list[Ringing]] = {}
    for number, (one, height, _) in enumerate(witt_dampers.LAYERS):
        for seed in range(seeds):
            name = f"c5-{number + 1:02d}-s{seed}-softening-{softening:g}"
            if one == length and (folder / f"{name}.npz").is_file():
                found.setdefault(height, []).append(run_of(number, folder, seed, softening))
    return dict(sorted(found.items()))


def beta_over_intensity(height: int) -> float:
    """beta / Gamma of a bed of the stated height [-], from Eq. 4.4."""
    rule = beta(1e-3, 20.0, witt_dampers.SHOT, witt_dampers.BED_HEIGHTS[height], witt_dampers.CAVITY_HEIGHT)
    return rule.beta / rule.intensity


def curves_of(beds: Beds) -> dict[int, Curve]:
    """Mean curve of every height of the bed."""
    return {height: curve(f"{1e3 * witt_dampers.BED_HEIGHTS[height]:.2f} mm", runs) for height, runs in beds.items()}


def collapse_over(curves: Sequence[tuple[int, Curve]], power: float, least: float = 0.0) -> Collapse:
    """Scatter about a common curve over Gamma (beta / Gamma)^power, Gamma for 0 and beta for 1, of the points whose
    Gamma is above the least; NaN where no two curves meet."""
    x, y = [], []
    for height, one in curves:
        above = one.intensity > least
        x.append(one.intensity[above] * beta_over_intensity(height) ** power)
        y.append(one.damping[above])
    try:
        return collapse(x, y)
    except InputError:
        return Collapse(np.nan, np.nan, 0, sum(len(one) for one in x))


def drawn(found: Mapping[float, Beds]) -> Figure:
    """Psi_m of every cycle over Gamma and over beta, linear and logarithmic, for the three lengths: a colour for each
    height, a marker for each initial displacement."""
    figure = Figure(figsize=(11, 9.4), layout="constrained")
    panels = figure.subplots(3, 3, sharey=True)
    for column, (length, beds) in enumerate(found.items()):
        for height, runs in beds.items():
            for number, run in enumerate(runs):
                _, intensity, damping = cycles_of(run)
                look = {"marker": SHAPES[run.displacement], "color": COLORS[height], "ls": "none", "ms": 3.5, "mew": 0}
                label = f"h_p = {1e3 * witt_dampers.BED_HEIGHTS[height]:.2f} mm" if number == 0 else None
                panels[0, column].plot(intensity, damping, label=label, **look)
                for row in (1, 2):
                    panels[row, column].plot(intensity * beta_over_intensity(height), damping, **look)
        panels[0, column].set(xlim=(0, 9), xlabel="Γ [-]")
        panels[1, column].set(xlim=(0, 20), xlabel="β [-]")
        panels[2, column].set(xscale="log", xlim=(0.02, 25), xlabel="β [-]")
        log_axis(panels[2, column].xaxis)
        panels[0, column].set_title(f"l_e = {1e3 * length:.2f} mm", fontsize=9)
    for axes in panels.flat:
        axes.set_ylim(0, 4)
        axes.grid(alpha=0.3)
    for axes in panels[:, 0]:
        axes.set_ylabel(PSI_LABEL)
    for displacement, shape in SHAPES.items():
        panels[1, 0].plot([], [], shape, color="black", ms=3.5, mew=0, label=f"U0 = {1e3 * displacement:g} mm")
    for axes in panels[:2, 0]:
        axes.legend(fontsize=8, markerscale=1.5)
    return figure


def tell(length: float, beds: Beds) -> None:
    """Peaks and collapses, printed."""
    curves = curves_of(beds)
    for height, one in curves.items():
        top, runs = peak(one, least_runs=2), beds[height]
        damping = np.interp([1.0, 2.0, 4.0], one.intensity, one.damping, left=np.nan, right=np.nan)
        print(
            f"l_e {1e3 * length:.2f}, h_p {1e3 * witt_dampers.BED_HEIGHTS[height]:5.2f} mm (here "
            f"{1e3 * runs[0].bed_height:5.2f}), mu {runs[0].mass_ratio:.3f}, {len(runs)} runs: peak Psi_m "
            f"{top.damping:.2f} +- {top.error:.2f} at Gamma {one.intensity[top.place]:.2f}, beta "
            f"{one.intensity[top.place] * beta_over_intensity(height):.2f}; at Gamma 1, 2, 4: "
            + ", ".join(f"{value:.2f}" for value in damping)
            + f"; {one.frequency.min():.1f} to {one.frequency.max():.1f} Hz"
        )
    if len(curves) > 1:
        tell_collapse(f"l_e {1e3 * length:.2f} mm", list(curves.items()))


def tell_collapse(name: str, curves: Sequence[tuple[int, Curve]]) -> None:
    """Scatter over Gamma, over beta, and over the power between or beyond them that has the least, printed; of all
    points, and of those above the intensity at which the top layer begins to roll (Eq. 4.3)."""
    for least in (0.0, critical_intensity()):
        over_gamma, over_beta = collapse_over(curves, 0.0, least), collapse_over(curves, 1.0, least)
        powers = np.arange(-0.5, 1.51, 0.05)
        unexplained = [collapse_over(curves, float(power), least).unexplained for power in powers]
        best = float(powers[int(np.nanargmin(unexplained))])
        print(
            f"{name}, Gamma > {least:.2f}: scatter {over_gamma.scatter:.2f} over Gamma "
            f"({over_gamma.unexplained:.2f} unexplained, {over_gamma.n_point} points), {over_beta.scatter:.2f} over "
            f"beta ({over_beta.unexplained:.2f}, {over_beta.n_point}); least over Gamma (beta/Gamma)^{best:.2f} "
            f"({np.nanmin(unexplained):.2f})"
        )


def tell_displacements(beds: Beds) -> None:
    """How far decays of one bed from different initial displacements lie apart, printed."""
    for height, runs in beds.items():
        if len({run.displacement for run in runs}) < 2:
            continue
        singles = [curve("", [run]) for run in runs]
        found = collapse([one.intensity for one in singles], [one.damping for one in singles])
        print(
            f"  h_p {1e3 * witt_dampers.BED_HEIGHTS[height]:5.2f} mm, single decays over Gamma: scatter "
            f"{found.scatter:.2f} ({found.n_point} points)"
        )


def run_all(folder: Path, seeds: int, softening: float, numbers: Sequence[int] = ORDER) -> None:
    """Every run of the table that is not there yet, a line each."""
    for seed in range(seeds):
        for number in numbers:
            begun = time.perf_counter()
            run = run_of(number, folder, seed, softening)
            print(
                f"run {number + 1:2d}, seed {seed}: {run.seconds:6.1f} s, residual {run.residual:.1e}, "
                f"overlap {run.overlap:.2f} R, bed {1e3 * run.bed_height:.2f} mm, status {run.status}, "
                f"{time.perf_counter() - begun:.0f} s in all",
                flush=True,
            )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path("witt-2011"), help="folder of results")
    parser.add_argument("--seeds", type=int, default=3, help="beds of each kind")
    parser.add_argument("--softening", type=float, default=SOFTENING)
    parser.add_argument("--runs", type=int, nargs="*", help="numbers as in Table 4.2; default: all")
    parser.add_argument("--no-run", action="store_true", help="draw what is there")
    asked = parser.parse_args()
    numbers = [number - 1 for number in asked.runs] if asked.runs else ORDER
    if not asked.no_run:
        run_all(asked.out, asked.seeds, asked.softening, numbers)
    found = {length: there(asked.out, length, asked.seeds, asked.softening) for length in witt_dampers.LENGTHS}
    for length, beds in found.items():
        tell(length, beds)
        tell_displacements(beds)
    everything = [pair for beds in found.values() for pair in curves_of(beds).items()]
    if len(everything) > 1:
        tell_collapse("all lengths", everything)
    print(save(drawn(found), asked.out / "configuration-5.png"))


if __name__ == "__main__":
    main()
