"""Configuration 2: one ball in each of three channels, in a row along the beam or abreast, over U/d.

    python configuration_2.py [--out FOLDER] [--seeds 3]

Writes configuration-2.png and prints the numbers; runs that are there already are not run again.
"""

import argparse
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Literal

import witt_dampers
from configuration_1 import (
    DURATION,
    PSI_LABEL,
    SOFTENING,
    ball_run,
    collapses,
    curves_of,
    event_run,
    mark_phases,
)
from decays import RATE, Ringing, kept, peak, ring, ringing_of_events
from matplotlib.figure import Figure

from graindamp.impact.decay import free_decay
from graindamp.impact.system import on_structure
from graindamp.report.figures import COLORS, log_axis, save

DISPLACEMENT = 6e-3
"""Initial displacement of the tip U0 [m]."""

PLACES = {"along": ("tip", "inner", "outer"), "abreast": ("tip", "tip", "tip")}
"""Points of the three channels; the first is measured."""

Arrangement = Literal["along", "abreast"]


def balls_run(folder: Path, clearance: float, arrangement: Arrangement, seed: int, restitution: float) -> Ringing:
    """Three balls co-simulated; clearance [m], seed of the balls' places, restitution [-]."""
    whole = witt_dampers.structure(witt_dampers.INSERT_MASS[clearance])

    def make() -> Ringing:
        carried = []
        for number, point in enumerate(PLACES[arrangement]):
            # Abreast and without a shift the three move as one.
            place = 3 * seed + number if seed else 0
            damper, bed = witt_dampers.channel(
                clearance, DISPLACEMENT, seed=place, restitution=restitution, softening=SOFTENING
            )
            carried.append(witt_dampers.mounted(damper, bed, True, point))
        return ring(
            witt_dampers.decay_case(whole, tuple(carried), DISPLACEMENT, DURATION, RATE), DISPLACEMENT, whole.mass
        )

    return kept(folder, f"c2-{arrangement}-d{1e3 * clearance:g}-e{restitution:g}-s{seed}-turning", make)


def balls_events(folder: Path, clearance: float, arrangement: Arrangement, restitution: float) -> Ringing:
    """The same from event to event, with an effective restitution R [-]."""
    whole = witt_dampers.structure(witt_dampers.INSERT_MASS[clearance])

    def make() -> Ringing:
        system = on_structure(
            whole.model, [witt_dampers.ball(clearance, restitution, point) for point in PLACES[arrangement]]
        )
        begun = time.perf_counter()
        run = free_decay(system, DISPLACEMENT, cycles_max=DURATION * whole.mode.frequency, sample_rate=RATE)
        ratio = 3 * witt_dampers.BALL_MASS / whole.mass
        return ringing_of_events(run, whole.model.shape[1], DISPLACEMENT, ratio, time.perf_counter() - begun)

    return kept(folder, f"c2-{arrangement}-d{1e3 * clearance:g}-R{restitution:g}", make)


Tests = Mapping[str, Mapping[float, list[Ringing]]]
"""Runs by name of the arrangement and clearance [m]."""


def tests_of(folder: Path, seeds: int, restitution: float, events: bool) -> Tests:
    """One ball, three along the beam and three abreast, all from 6 mm."""
    found: dict[str, dict[float, list[Ringing]]] = {}
    for name in ("one ball", "along", "abreast"):
        found[name] = {}
        for clearance in witt_dampers.INSERT_MASS:
            if name == "one ball" and events:
                runs = [event_run(folder, clearance, DISPLACEMENT, restitution)]
            elif name == "one ball":
                runs = [ball_run(folder, clearance, DISPLACEMENT, seed, restitution) for seed in range(seeds)]
            elif events:
                runs = [balls_events(folder, clearance, name, restitution)]  # type: ignore[arg-type]
            else:
                runs = [balls_run(folder, clearance, name, seed, restitution) for seed in range(seeds)]  # type: ignore[arg-type]
            found[name][clearance] = runs
    return found


def drawn(cosimulated: Tests, events: Tests) -> Figure:
    """Mean Psi_m over U/d, a line per clearance."""
    figure = Figure(figsize=(9, 3.8), layout="constrained")
    panels = figure.subplots(1, 2, sharey=True)
    for axes, tests in zip(panels, (cosimulated, events), strict=True):
        for k, (name, family) in enumerate(tests.items()):
            for number, (clearance, one) in enumerate(curves_of(family).items()):
                label = {"along": "three along the beam", "abreast": "three abreast"}.get(name, name)
                axes.plot(
                    one.displacement / clearance,
                    one.damping,
                    color=COLORS[k],
                    lw=1.2,
                    ls=("-", "--", "-.", ":")[number],
                    label=label if number == 0 else None,
                )
        axes.set(xscale="log", ylim=(0, 14), xlabel="α = U/d [-]", xlim=(0.05, 6))
        axes.grid(alpha=0.3)
        log_axis(axes.xaxis)
        mark_phases(axes)
    panels[0].legend(fontsize=8)
    panels[0].set_ylabel(PSI_LABEL)
    panels[0].set_title("co-simulated, e = 0.3", fontsize=9)
    panels[1].set_title("from event to event, R = 0.15", fontsize=9)
    return figure


def tell(title: str, tests: Tests) -> None:
    """Peaks and collapse of every arrangement, printed."""
    for name, family in tests.items():
        curves = curves_of(family)
        for clearance, one in curves.items():
            top = peak(one)
            print(
                f"{title}, {name}, d = {1e3 * clearance:5.2f} mm: peak Psi_m {top.damping:5.2f} +- {top.error:.2f} at "
                f"U/d = {one.displacement[top.place] / clearance:.3f}"
            )
        before, after = collapses(curves)
        print(
            f"{title}, {name}: scatter {before.scatter:.2f} over U ({before.unexplained:.2f} unexplained), "
            f"{after.scatter:.2f} over U/d ({after.unexplained:.2f})"
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path("witt-2011"), help="folder of results")
    parser.add_argument("--seeds", type=int, default=3, help="places of the balls at the start")
    asked = parser.parse_args()
    cosimulated = tests_of(asked.out, asked.seeds, 0.3, events=False)
    events = tests_of(asked.out, asked.seeds, 0.15, events=True)
    tell("co-simulated", cosimulated)
    tell("events", events)
    print(save(drawn(cosimulated, events), asked.out / "configuration-2.png"))


if __name__ == "__main__":
    main()
