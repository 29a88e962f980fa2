"""One ball between shaken walls: loss factor over the stroke, beside the closed forms of a bed that moves as one."""

from math import pi
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import graindamp as gd
from graindamp.field.theory import collect_and_collide, stroke_ratio_min
from graindamp.report.figures import COLORS, save
from graindamp.signals.simulated import point_of

RADIUS, CLEARANCE, FREQUENCY = 5e-3, 0.1, 20.0  # [m], [m], [Hz]: impacts at several m/s, short beside the cycle
STROKES = {0.01: (1.05, 1.2, 1.5, 2.0, 3.0, 5.0), 0.2: (0.65, 0.8, 1.0, 1.5), 0.5: (0.4, 0.5, 0.7, 1.0)}
"""X / X_opt by restitution; 0.01, the least possible, stands for 0. Started at rest, 0.5 misses its orbit at 0.35."""


def described(stroke_ratio: float, restitution: float, cycles: int) -> gd.SimulationSpec:
    """A ball in a box without gravity and friction, at rest at the wall "x-"."""
    damper = {
        "gravity": "none",
        "particles": [{"material": "steel-s235", "radius": RADIUS}],
        "fill": {"count": 1},
        "container": {"kind": "box", "size": [2 * RADIUS + CLEARANCE, 0.03, 0.03], "material": "steel-s235"},
        "contact": {"restitution": restitution, "friction": 0, "tangential": "none", "softening": 10},
        "packing": {"direction": "-x", "tap": False},
    }
    motion = {"kind": "harmonic", "frequency": FREQUENCY, "amplitude": stroke_ratio * CLEARANCE / pi}
    # Every impact counts as in the middle of its sample: with 200 a cycle its phase would be off by up to 0.9 degrees.
    run = {"cycles": cycles, "settle": 0, "steps_per_contact": 150, "samples_per_cycle": 4000}
    return gd.SimulationSpec.model_validate({"damper": damper, "motion": motion, "run": run})


def main(folder: Path = Path(), cycles: int = 20, strokes: dict[float, tuple[float, ...]] = STROKES) -> float:
    """Write single-ball.png into `folder`; return the largest distance of eta from its closed form, relative [-]."""
    figure = Figure(figsize=(6, 4), layout="constrained")
    axes = figure.subplots()
    off = []
    for color, (restitution, ratios) in zip(COLORS, strokes.items(), strict=False):
        ideal = restitution if restitution > 0.01 else 0.0
        line = np.geomspace(max(stroke_ratio_min(ideal), 1.001 if ideal == 0.0 else 0.0), max(ratios), 200)
        axes.plot(line, [collect_and_collide(r, ideal).loss_factor for r in line], color=color, lw=1)
        points = [point_of(gd.simulate(described(r, restitution, cycles))) for r in ratios]
        eta, error = np.array([(p.loss_factor, p.loss_factor_error) for p in points]).T
        axes.errorbar(ratios, eta, error, fmt="o", ms=4, color=color, label=f"restitution {restitution:g}")
        exact = np.array([collect_and_collide(r, ideal).loss_factor for r in ratios])
        off += list(zip(abs(eta / exact - 1), error / exact, strict=True))
    axes.set(xlabel="stroke X / X_opt [-]", ylabel="loss factor η [-]", title="lines: closed form")
    axes.legend()
    picture = save(figure, folder / "single-ball.png")
    worst, its_error = max(off)
    print(f"largest distance from the closed form: {100 * worst:.2f} ± {100 * its_error:.2f} %; drawn in {picture}")
    return float(worst)


if __name__ == "__main__":
    main()
