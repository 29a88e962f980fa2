"""Configuration 1: one ball in one channel, over U and over U/d; co-simulated, and from event to event.

    python configuration_1.py [--out FOLDER] [--seeds 3] [--no-turning]

Writes configuration-1*.png and prints the numbers; runs that are there already are not run again.
"""

import argparse
import math
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import witt_dampers
from decays import RATE, Curve, Ringing, curve, cycles_of, kept, peak, ring, ringing_of_events
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from graindamp.impact.decay import free_decay
from graindamp.impact.system import on_structure
from graindamp.report.figures import COLORS, MARKERS, log_axis, save
from graindamp.signals.collapse import Collapse, collapse

SOFTENING = 10.0
"""Divisor of the stiffness of the ball's contacts [-]: 1 gives the same decay until it becomes irregular."""

DURATION = 4.0
"""Time that a decay is followed for [s]."""

RESTITUTIONS = (0.6, 0.3)
"""Of the ball with walls and floor in the co-simulation [-]: an ordinary one, and half of it."""

EFFECTIVE = (0.0, 0.15, 0.3, 0.6)
"""Effective restitutions R of the event-driven solver [-]."""

PSI_LABEL = r"$\Psi_m$ [-]"

Family = Mapping[float, Sequence[Ringing]]
"""Runs by clearance [m]."""


def ball_run(
    folder: Path, clearance: float, displacement: float, seed: int, restitution: float, turning: bool = True
) -> Ringing:
    """One co-simulated decay: clearance and initial displacement [m], seed of the ball's place, restitution [-], the
    channel `turning` with the slope of the beam or not."""
    whole = witt_dampers.structure(witt_dampers.INSERT_MASS[clearance])

    def make() -> Ringing:
        damper, bed = witt_dampers.channel(
            clearance, displacement, seed=seed, restitution=restitution, softening=SOFTENING
        )
        carried = witt_dampers.mounted(damper, bed, turning)
        return ring(witt_dampers.decay_case(whole, (carried,), displacement, DURATION, RATE), displacement, whole.mass)

    name = f"c1-d{1e3 * clearance:g}-u{1e3 * displacement:g}-e{restitution:g}-s{seed}"
    return kept(folder, name + "-turning" * turning, make)


def event_run(folder: Path, clearance: float, displacement: float, restitution: float) -> Ringing:
    """The same from event to event, with an effective restitution R [-] in place of floor, friction and gravity."""
    whole = witt_dampers.structure(witt_dampers.INSERT_MASS[clearance])

    def make() -> Ringing:
        system = on_structure(whole.model, [witt_dampers.ball(clearance, restitution)])
        begun = time.perf_counter()
        run = free_decay(system, displacement, cycles_max=DURATION * whole.mode.frequency, sample_rate=RATE)
        spent = time.perf_counter() - begun
        return ringing_of_events(run, whole.model.shape[1], displacement, witt_dampers.BALL_MASS / whole.mass, spent)

    return kept(folder, f"c1-d{1e3 * clearance:g}-u{1e3 * displacement:g}-R{restitution:g}", make)


def families(folder: Path, seeds: int, turning: bool) -> tuple[dict[float, Family], dict[float, Family]]:
    """All tests by restitution: co-simulated, and from event to event."""

    def by_clearance(restitution: float, events: bool) -> Family:
        found: dict[float, list[Ringing]] = {clearance: [] for clearance in witt_dampers.INSERT_MASS}
        for clearance, displacement in witt_dampers.SINGLE_BALL:
            if events:
                found[clearance].append(event_run(folder, clearance, displacement, restitution))
                continue
            for seed in range(seeds):
                found[clearance].append(ball_run(folder, clearance, displacement, seed, restitution, turning))
        return found

    return {e: by_clearance(e, False) for e in RESTITUTIONS}, {r: by_clearance(r, True) for r in EFFECTIVE}


def curves_of(family: Family) -> dict[float, Curve]:
    """Mean curve of every clearance [m]."""
    return {d: curve(f"d = {1e3 * d:.2f} mm", runs) for d, runs in family.items()}


def collapses(curves: Mapping[float, Curve]) -> tuple[Collapse, Collapse]:
    """Scatter about a common curve over U, and over U/d."""
    damping = [one.damping for one in curves.values()]
    over_u = collapse([one.displacement for one in curves.values()], damping)
    return over_u, collapse([one.displacement / d for d, one in curves.items()], damping)


def over_amplitude(axes: Axes, family: Family, scaled: bool) -> None:
    """Psi_m of every cycle over U in mm, or over U/d where `scaled`."""
    for k, (clearance, runs) in enumerate(family.items()):
        for number, run in enumerate(runs):
            displacement, _, damping = cycles_of(run)
            look: dict[str, Any] = {
                "marker": MARKERS[k],
                "color": COLORS[k],
                "ls": "none",
                "ms": 2.5,
                "mew": 0,
                "alpha": 0.6,
            }
            label = f"d = {1e3 * clearance:.2f} mm" if number == 0 else None
            axes.plot(displacement / (clearance if scaled else 1e-3), damping, label=label, **look)
    axes.set(xscale="log", ylim=(0, None), ylabel=PSI_LABEL, xlabel="α = U/d [-]" if scaled else "U [mm]")
    axes.grid(alpha=0.3)
    log_axis(axes.xaxis)
    if scaled:
        mark_phases(axes)


def mark_phases(axes: Axes) -> None:
    """Lines at U/d = 1/pi, the criterion of the most damping, and 1/(2 pi), that of the least."""
    axes.axvline(1.0 / math.pi, color="black", lw=1)
    axes.axvline(0.5 / math.pi, color="black", lw=1, ls="--")


def clouds(cosimulated: Family, events: Family, titles: tuple[str, str]) -> Figure:
    """Psi_m of every cycle over U and over U/d."""
    figure = Figure(figsize=(9, 6.4), layout="constrained")
    panels = figure.subplots(2, 2)
    for row, (family, title) in enumerate(zip((cosimulated, events), titles, strict=True)):
        for column in range(2):
            over_amplitude(panels[row, column], family, scaled=column == 1)
            panels[row, column].set_title(title, fontsize=9)
    panels[0, 0].legend(fontsize=8, markerscale=2.5)
    return figure


def means(cosimulated: Mapping[float, Family], events: Mapping[float, Family]) -> Figure:
    """Mean Psi_m over U/d of all clearances together, for every restitution."""
    figure = Figure(figsize=(9, 3.8), layout="constrained")
    panels = figure.subplots(1, 2, sharey=True)
    for axes, found, name in ((panels[0], cosimulated, "e"), (panels[1], events, "R")):
        for k, (restitution, family) in enumerate(found.items()):
            for number, (clearance, one) in enumerate(curves_of(family).items()):
                axes.plot(
                    one.displacement / clearance,
                    one.damping,
                    color=COLORS[k],
                    lw=1,
                    ls=("-", "--", "-.", ":")[number],
                    label=f"{name} = {restitution:g}" if number == 0 else None,
                )
        axes.set(xscale="log", ylim=(0, 20), xlabel="α = U/d [-]", xlim=(0.03, 8))
        axes.grid(alpha=0.3)
        log_axis(axes.xaxis)
        mark_phases(axes)
        axes.legend(fontsize=8)
    panels[0].set(ylabel=PSI_LABEL, title="co-simulated, floor and friction 0.3")
    panels[1].set(title="from event to event, no floor")
    panels[0].title.set_fontsize(9)
    panels[1].title.set_fontsize(9)
    return figure


def tell(name: str, family: Family) -> None:
    """Peak of every clearance and the collapse, printed."""
    curves = curves_of(family)
    for clearance, one in curves.items():
        top = peak(one)
        print(
            f"{name}, d = {1e3 * clearance:5.2f} mm: peak Psi_m {top.damping:5.2f} +- {top.error:.2f} "
            f"at U/d = {one.displacement[top.place] / clearance:.3f}"
        )
    before, after = collapses(curves)
    print(
        f"{name}: scatter {before.scatter:.2f} over U ({before.unexplained:.2f} unexplained), {after.scatter:.2f} over "
        f"U/d ({after.unexplained:.2f}); {before.n_point} and {after.n_point} points"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path("witt-2011"), help="folder of results")
    parser.add_argument("--seeds", type=int, default=3, help="places of the ball at the start")
    parser.add_argument("--no-turning", action="store_true", help="the enclosure only moves to and fro")
    asked = parser.parse_args()
    cosimulated, events = families(asked.out, asked.seeds, not asked.no_turning)
    for restitution, family in cosimulated.items():
        tell(f"co-simulated, e = {restitution:g}", family)
        runs = [run for group in family.values() for run in group]
        print(f"  residual {max(run.residual for run in runs):.1e}, {sum(run.seconds for run in runs):.0f} s")
    for restitution, family in events.items():
        tell(f"events, R = {restitution:g}", family)
    suffix = "-straight" * asked.no_turning
    titles = (f"co-simulated, e = {RESTITUTIONS[1]:g}", "from event to event, R = 0.15")
    print(save(clouds(cosimulated[RESTITUTIONS[1]], events[0.15], titles), asked.out / f"configuration-1{suffix}.png"))
    print(save(means(cosimulated, events), asked.out / f"configuration-1-restitution{suffix}.png"))


if __name__ == "__main__":
    main()
