"""What softened contacts, the time step and the assumed constants do to one bed of configuration 5.

    python stiffness.py [--out FOLDER] [--run 15]

Writes stiffness.png and prints the numbers; runs that are there already are not run again.
"""

import argparse
from pathlib import Path

import numpy as np
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
        "time step halved": run_of(number, folder, steps=40, duration=DURATION),
        "another bed": run_of(number, folder, seed=1, duration=DURATION),
        "friction 0.5": run_of(number, folder, friction=0.5, duration=DURATION),
        "restitution 0.6": run_of(number, folder, restitution=0.6, duration=DURATION),
    }


def mean_damping(run: Ringing) -> list[float]:
    """Psi_m over Gamma 3 to 4, 4 to 6 and 6 to 9 [-], means of the bins; NaN where the decay does not reach."""
    one = curve("", [run])
    found = []
    for low, high in ((3.0, 4.0), (4.0, 6.0), (6.0, 9.0)):
        inside = (one.intensity >= low) & (one.intensity < high)
        found.append(float(one.damping[inside].mean()) if inside.any() else float("nan"))
    return found


def drawn(found: dict[str, Ringing]) -> Figure:
    """Psi_m over Gamma of every variant."""
    figure = Figure(figsize=(6, 3.8), layout="constrained")
    axes = figure.subplots()
    for k, (name, run) in enumerate(found.items()):
        one = curve("", [run])
        axes.plot(one.intensity, one.damping, color=COLORS[k], marker="o", ms=3, lw=1.2, label=name)
    axes.set(xlabel="Γ [-]", ylabel=r"$\Psi_m$ [-]", xlim=(0, 9), ylim=(0, 4))
    axes.grid(alpha=0.3)
    axes.legend(fontsize=8)
    return figure


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path("witt-2011"), help="folder of results")
    parser.add_argument("--run", type=int, default=15, help="number in Table 4.2")
    asked = parser.parse_args()
    found = variants(asked.out, asked.run - 1)
    for name, run in found.items():
        values = ", ".join(f"{value:.2f}" for value in np.array(mean_damping(run)))
        print(
            f"{name:18s} Psi_m at Gamma 3-4, 4-6, 6-9: {values}; overlap {run.overlap:.2f} R, residual "
            f"{run.residual:.1e}, time step {1e6 * run.time_step:.1f} us, {run.seconds:.0f} s"
        )
    print(save(drawn(found), asked.out / "stiffness.png"))


if __name__ == "__main__":
    main()
