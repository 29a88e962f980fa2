"""What softened contacts, the time step, the assumed constants and the beam's slope do to two beds of configuration 5.

One is thin and thrown hard (run 15 of Table 4.2), one deep and moved gently (run 34).

    python stiffness.py [--out FOLDER] [--runs 15 34]

Writes stiffness.png and prints the numbers; runs that are there already are not run again.
"""

import argparse
from pathlib import Path

from configuration_5 import SOFTENING, run_of
from decays import RATE, Ringing, curve
from matplotlib.figure import Figure

from graindamp.report.figures import COLORS, save

DURATION = 0.4
"""Time that is followed [s]."""


def variants(folder: Path, number: int) -> dict[str, Ringing]:
    """Run `number` of Table 4.2, from 0, with one thing changed at a time, by what is changed."""
    whole = run_of(number, folder)
    return {
        f"softening {SOFTENING:g}": whole._replace(velocity=whole.velocity[: round(DURATION * RATE) + 1]),
        "softening 300": run_of(number, folder, softening=300.0, duration=DURATION),
        "softening 100": run_of(number, folder, softening=100.0, duration=DURATION),
        "40 steps per contact": run_of(number, folder, steps=40, duration=DURATION),
        "another bed": run_of(number, folder, seed=1, duration=DURATION),
        "friction 0.5": run_of(number, folder, friction=0.5, duration=DURATION),
        "restitution 0.6": run_of(number, folder, restitution=0.6, duration=DURATION),
        "turning with the slope": run_of(number, folder, turning=True, duration=DURATION),
    }


BANDS = ((0.4, 0.7), (0.7, 1.2), (1.2, 2.0), (2.0, 4.0), (4.0, 6.0), (6.0, 9.0))
"""Ranges of Gamma over which Psi_m is averaged [-]."""


def mean_damping(run: Ringing) -> dict[tuple[float, float], float]:
    """Mean Psi_m of the bins in each of the bands that the decay crosses [-]."""
    one = curve("", [run])
    inside = {band: (one.intensity >= band[0]) & (one.intensity < band[1]) for band in BANDS}
    return {band: float(one.damping[here].mean()) for band, here in inside.items() if here.any()}


def drawn(studies: dict[int, dict[str, Ringing]]) -> Figure:
    """Psi_m over Gamma of every variant, a panel for each run."""
    figure = Figure(figsize=(9, 3.8), layout="constrained")
    panels = figure.subplots(1, len(studies), sharey=True, squeeze=False)[0]
    for axes, (number, found) in zip(panels, studies.items(), strict=True):
        for k, (name, run) in enumerate(found.items()):
            one = curve("", [run])
            axes.plot(one.intensity, one.damping, color=COLORS[k], marker="o", ms=3, lw=1.2, label=name)
        axes.set(xlabel="Γ [-]", ylim=(0, 4))
        axes.set_title(f"run {number} of Table 4.2", fontsize=9)
        axes.grid(alpha=0.3)
    panels[0].set_ylabel(r"$\Psi_m$ [-]")
    panels[0].legend(fontsize=8)
    return figure


def tell(number: int, found: dict[str, Ringing]) -> None:
    """Mean damping, overlap, residual and time of every variant, printed."""
    for name, run in found.items():
        values = ", ".join(f"{low:g}-{high:g}: {mean:.2f}" for (low, high), mean in mean_damping(run).items())
        print(
            f"run {number}, {name:22s} Psi_m at Gamma {values}; overlap {run.overlap:.2f} R, residual "
            f"{run.residual:.1e}, time step {1e6 * run.time_step:.1f} us, {run.seconds:.0f} s",
            flush=True,
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path("witt-2011"), help="folder of results")
    parser.add_argument("--runs", type=int, nargs="+", default=[15, 34], help="numbers in Table 4.2")
    asked = parser.parse_args()
    studies = {number: variants(asked.out, number - 1) for number in asked.runs}
    for number, found in studies.items():
        tell(number, found)
    print(save(drawn(studies), asked.out / "stiffness.png"))


if __name__ == "__main__":
    main()
