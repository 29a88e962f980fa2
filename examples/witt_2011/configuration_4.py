"""Configuration 4: one layer of one to four rows of nine balls, over U/d.

    python configuration_4.py [--out FOLDER] [--seeds 3] [--restitution 0.6] [--no-turning]

Writes configuration-4*.png and prints the numbers; runs that are there already are not run again.
"""

import argparse
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import witt_dampers
from configuration_1 import PSI_LABEL, collapses, curves_of, mark_phases
from decays import RATE, Ringing, closing, cycles_of, peak, ring
from matplotlib.figure import Figure

from graindamp.report.figures import COLORS, MARKERS, log_axis, save

SOFTENING = 100.0
"""Divisor of the stiffness of all contacts [-]."""

DISPLACEMENTS = (1e-3, 2e-3, 4e-3, 6e-3, 8e-3, 10e-3)
"""Initial displacements U0 [m]."""

STEPS_PER_CONTACT = 30
"""Time steps in the contact of the fastest impact that could happen [-]."""

DURATION = 1.0
"""Time that a decay is followed for [s]."""

Family = Mapping[float, list[Ringing]]
"""Runs by clearance [m]."""


def possible(n_row: int, clearance: float) -> bool:
    """Whether the cavity is at most as long as the enclosure allows; four rows with 19.74 mm are not."""
    return n_row * witt_dampers.ROW_BALL + clearance <= 35.15e-3


class Kind(NamedTuple):
    """What is the same for all tests of a figure."""

    restitution: float
    turning: bool
    """Whether the enclosure turns with the slope of the beam."""

    @property
    def suffix(self) -> str:
        """What names of files end in."""
        changed = "" if self.restitution == witt_dampers.STEEL_RESTITUTION else f"-e{self.restitution:g}"
        return changed + ("" if self.turning else "-straight")


def rows_run(folder: Path, n_row: int, clearance: float, displacement: float, seed: int, kind: Kind) -> Ringing:
    """One decay; clearance and initial displacement [m], seed of the balls' places."""
    whole = witt_dampers.structure()

    def make(steps: int) -> Ringing:
        damper, bed = witt_dampers.rows(n_row, clearance, seed=seed, restitution=kind.restitution, softening=SOFTENING)
        carried = witt_dampers.mounted(damper, bed, kind.turning)
        case = witt_dampers.decay_case(whole, (carried,), displacement, DURATION, RATE)
        return ring(case._replace(steps_per_contact=steps), displacement, whole.mass)

    name = f"c4-{n_row}rows-d{1e3 * clearance:g}-u{1e3 * displacement:g}-e{kind.restitution:g}-s{seed}"
    name += "-turning" if kind.turning else ""
    return closing(folder, name, make, STEPS_PER_CONTACT)


def family_of(folder: Path, n_row: int, seeds: int, kind: Kind) -> Family:
    """All tests with a number of rows."""
    return {
        clearance: [
            rows_run(folder, n_row, clearance, displacement, seed, kind)
            for seed in range(seeds)
            for displacement in DISPLACEMENTS
        ]
        for clearance in witt_dampers.ROW_CLEARANCES
        if possible(n_row, clearance)
    }


def wide(family: Family) -> Family:
    """The tests whose clearance is at least about a diameter: those of Fig. 4.16a."""
    return {clearance: runs for clearance, runs in family.items() if clearance > 3.9e-3}


def drawn(found: Mapping[int, Family]) -> Figure:
    """Psi_m of every cycle over U/d: wide clearances, narrow ones, and narrow ones of two rows by clearance."""
    figure = Figure(figsize=(11, 3.8), layout="constrained")
    panels = figure.subplots(1, 3, sharey=True)
    for k, (n_row, family) in enumerate(found.items()):
        chosen = wide(family)
        for axes, tests in ((panels[0], chosen), (panels[1], {d: r for d, r in family.items() if d not in chosen})):
            label = f"{n_row} row" + "s" * (n_row > 1)
            for clearance, runs in tests.items():
                for run in runs:
                    displacement, _, damping = cycles_of(run)
                    look = {"marker": MARKERS[k], "color": COLORS[k], "ls": "none", "ms": 2.5, "mew": 0, "alpha": 0.5}
                    axes.plot(displacement / clearance, damping, label=label, **look)
                    label = ""
    for k, clearance in enumerate((1.22e-3, 2.25e-3)):
        for number, run in enumerate(found.get(2, {}).get(clearance, [])):
            displacement, _, damping = cycles_of(run)
            label = f"d = {1e3 * clearance:.2f} mm" if number == 0 else ""
            look = {"marker": MARKERS[k], "color": COLORS[k + 4], "ls": "none", "ms": 3, "mew": 0}
            panels[2].plot(displacement / clearance, damping, label=label, **look)
    for axes, title in zip(panels, ("d from 4 mm on", "d = 1.22 and 2.25 mm", "two rows, by d"), strict=True):
        axes.set(xscale="log", ylim=(0, 18), xlim=(0.04, 10), xlabel="α = U/d [-]")
        axes.set_title(title, fontsize=9)
        axes.grid(alpha=0.3)
        log_axis(axes.xaxis)
        mark_phases(axes)
        axes.legend(fontsize=8, markerscale=2.5)
    panels[0].set_ylabel(PSI_LABEL)
    return figure


def tell(n_row: int, family: Family) -> None:
    """Peak of the mean over all wide clearances and the collapses, printed."""
    for name, tests in (("d >= 4 mm", wide(family)), ("d < D", {d: family[d] for d in (1.22e-3, 2.25e-3)})):
        curves = curves_of(tests)
        tops = {d: peak(one) for d, one in curves.items()}
        best = [one.displacement[tops[d].place] / d for d, one in curves.items()]
        values = [top.damping for top in tops.values()]
        mean = sum(values) / len(values)
        error = (sum((value - mean) ** 2 for value in values) / max(len(values) - 1, 1) / len(values)) ** 0.5
        before, after = collapses(curves)
        print(
            f"{n_row} rows, {name}: peak Psi_m {mean:.2f} +- {error:.2f} over {len(values)} clearances at U/d "
            f"{min(best):.2f} to {max(best):.2f}; scatter {before.scatter:.2f} over U ({before.unexplained:.2f} "
            f"unexplained), {after.scatter:.2f} over U/d ({after.unexplained:.2f})"
        )
    runs = [run for group in family.values() for run in group]
    print(
        f"  {len(runs)} runs, residual up to {max(run.residual for run in runs):.1e}, overlap up to "
        f"{max(run.overlap for run in runs):.2f} R, {sum(run.seconds for run in runs):.0f} s"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path("witt-2011"), help="folder of results")
    parser.add_argument("--seeds", type=int, default=3, help="places of the balls at the start")
    parser.add_argument("--restitution", type=float, default=witt_dampers.STEEL_RESTITUTION)
    parser.add_argument("--no-turning", action="store_true", help="the enclosure only moves to and fro")
    asked = parser.parse_args()
    kind = Kind(asked.restitution, not asked.no_turning)
    found = {n_row: family_of(asked.out, n_row, asked.seeds, kind) for n_row in (1, 2, 3, 4)}
    for n_row, family in found.items():
        tell(n_row, family)
    print(save(drawn(found), asked.out / f"configuration-4{kind.suffix}.png"))


if __name__ == "__main__":
    main()
