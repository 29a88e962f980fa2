"""What softened contacts do to the field: a few points at several stiffnesses, extrapolated to that of steel.

    python softening.py [--out FOLDER] [--count 500] [--name baseline] [--factors 1 10 100 1000]

The points are those of [softening_study] in the damper's file. Writes softening.png; points that are in the store
already are not run again.
"""

import argparse
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from setups import load, small

from graindamp.campaign.executors import Serial
from graindamp.campaign.runner import Runner
from graindamp.campaign.softening import evaluate, study_tasks
from graindamp.campaign.store import Store
from graindamp.campaign.work import measure_packed
from graindamp.field.softening import SofteningStudy
from graindamp.report.figures import COLORS, save
from graindamp.spec.field import FieldSpec


def study(spec: FieldSpec, factors: list[float], store_folder: Path) -> SofteningStudy:
    """Run what is missing, and fit."""
    assert spec.softening_study is not None
    asked = spec.softening_study.model_copy(update={"factors": tuple(factors)})
    spec = spec.model_copy(update={"softening_study": asked})
    with Store(store_folder) as store:
        runner = Runner(store, Serial(), measure_packed)
        results = runner.run([task for group in study_tasks(spec) for task in group])
    for failure in runner.failures.values():
        print(f"failed: {failure.reason}")
    return evaluate(spec, lambda task: results[task.key])


def lines_of(found: SofteningStudy) -> list[str]:
    """The study as a table."""
    lines = [
        f"error of softening {found.chosen:g} against 1, and values at {', '.join(f'{s:g}' for s in found.factors)}"
    ]
    for one in found.points:
        for name, fit in (("eta", one.loss_factor), ("m'", one.effective_mass_ratio)):
            values = " ".join(f"{v:6.3f}+-{e:5.3f}" for v, e in zip(fit.value, fit.standard_error, strict=True))
            lines.append(
                f"{one.frequency:5g} Hz Gamma {one.intensity:4g} {name:4s} {fit.error:+6.3f} +- {fit.error_se:5.3f} "
                f"(line {fit.described:6.3f} +- {fit.described_se:5.3f} at 1, scatter {fit.scatter:4.1f}): {values}"
            )
    return lines


def picture(found: SofteningStudy) -> Figure:
    """Loss factor and m' over the time in contact, with the lines fitted."""
    figure = Figure(figsize=(10, 4.5), layout="constrained")
    x = found.factors**found.power
    for axes, name in zip(figure.subplots(1, 2), ("loss_factor", "effective_mass_ratio"), strict=True):
        for k, one in enumerate(found.points):
            fit = getattr(one, name)
            axes.errorbar(x, fit.value, fit.standard_error, fmt="o", color=COLORS[k], ms=4)
            slope = fit.error / (found.chosen**found.power - 1.0)
            label = f"{one.frequency:g} Hz, Γ = {one.intensity:g}"
            axes.plot(x, fit.described + slope * (x - 1.0), color=COLORS[k], label=label)
        axes.axvline(found.chosen**found.power, color="gray", ls=":")
        axes.set_xlabel("time in contact over that of steel, s^0.4 [-]")
    figure.axes[0].set_ylabel("loss factor η [-]")
    figure.axes[1].set_ylabel("effective mass ratio m′ [-]")
    figure.axes[0].legend(fontsize=8)
    return figure


def main() -> None:
    """Run, print, draw."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path("meyer-seifried-2023"), help="folder of results")
    parser.add_argument("--name", default="baseline", help="damper")
    parser.add_argument("--count", type=int, default=500, help="spheres; 4500 is the full damper")
    parser.add_argument("--factors", nargs="+", type=float, default=[1.0, 10.0, 100.0, 1000.0])
    asked = parser.parse_args()
    spec = load(asked.name)
    spec = spec if asked.count >= 4500 else small(spec, asked.count)
    found = study(spec, asked.factors, asked.out / "store")
    text = "\n".join(lines_of(found))
    print(text)
    worst = float(np.max(found.relative_errors))
    print(f"largest error of eta or m' over eta (at least {found.floor:g}): {100 * worst:.0f} %")
    (asked.out / f"softening-{asked.name}.txt").write_text(text + "\n", encoding="utf-8")
    print(save(picture(found), asked.out / f"softening-{asked.name}.png"))


if __name__ == "__main__":
    main()
