"""Do second answers exist about the edge of collect and collide? The hysteresis plan on points just above and below it.

Every point is run from rest and from the ends of its neighbours' runs in intensity: bouncing beds are carried down
below the edge, collapsed ones up above it.

    python benchmarks/hysteresis.py --store FOLDER [--out FILE.md]
"""

import argparse
from datetime import date
from importlib.metadata import version
from pathlib import Path

import numpy as np
import xarray as xr

from graindamp.campaign.executors import executor_of
from graindamp.campaign.hysteresis import SHARE_APART, distance
from graindamp.campaign.point import PointResult, task_of
from graindamp.campaign.run import run_field
from graindamp.campaign.store import Store
from graindamp.spec.field import FieldSpec, GridPlan, StopSpec, logarithmic
from graindamp.spec.model import load_spec
from graindamp.units import STANDARD_GRAVITY

DAMPER = Path(__file__).parent.parent / "examples" / "small-damper-field.toml"
OPTIMUM = 1e-3
"""Best stroke h / pi of the damper [m]."""
FREQUENCIES = logarithmic(40.0, 1000.0, 28)[4:6]
INTENSITIES = (15.0, logarithmic(0.8, 40.0, 15)[11], 20.0)
"""The middle one and the frequencies are of the 28 x 15 grid."""


def row(start: str, rest: PointResult, result: PointResult, first: bool) -> str:
    stroke = result.intensity * STANDARD_GRAVITY / (2 * np.pi * result.frequency) ** 2 / OPTIMUM
    place = f"{result.frequency:.1f} | {result.intensity:.1f} | {stroke:.2f}" if first else " | | "
    apart = "" if first else f"{distance(rest, result):.1f}"
    return (
        f"| {place} | {start} | {result.loss_factor:.3f} ± {result.loss_factor_se:.3f} | "
        f"{result.effective_mass_ratio:.3f} ± {result.effective_mass_ratio_se:.3f} | "
        f"{result.cycle_loss_factor[0]:.2f} | {result.n_skipped} + {result.n_cycles} | {apart} |"
    )


def marked(field: xr.Dataset, i: int, j: int) -> str:
    """Both answers of a bistable point."""
    one = field.isel(frequency=i, intensity=j)
    names = (f"{name}{which}" for name in ("loss_factor", "effective_mass_ratio") for which in ("", "_other"))
    values = " | ".join(f"{float(one[name]):.3f}" for name in names)
    return f"| {float(one['frequency']):.1f} | {float(one['intensity']):.1f} | {values} |"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--store", type=Path, required=True)
    parser.add_argument("--out", type=Path, default=Path(__file__).parent / "results" / "hysteresis.md")
    given = parser.parse_args()
    changes = {
        "stop": StopSpec(tolerance=0.04, max_cycles=80),
        "softening_study": None,
        "hysteresis": "intensity",
        "plan": GridPlan(frequency=FREQUENCIES, intensity=INTENSITIES),
    }
    spec = load_spec(DAMPER, FieldSpec).model_copy(update=changes)
    crew = executor_of("local")
    lines = []
    with Store(given.store) as store:
        run = run_field(spec, store, crew, project=DAMPER)
        crew.shutdown()
        for f in FREQUENCIES:
            keys = [task_of(spec, f, gamma, folder=DAMPER.parent).key for gamma in INTENSITIES]
            for j, gamma in enumerate(INTENSITIES):
                rest = store.load(keys[j])
                assert rest is not None
                lines.append(row("rest", rest, rest, first=True))
                for k in (j - 1, j + 1):
                    if 0 <= k < len(keys):
                        found = store.load(task_of(spec, f, gamma, start=keys[k], folder=DAMPER.parent).key)
                        assert found is not None
                        lines.append(row(f"end at Γ = {INTENSITIES[k]:.1f}", rest, found, first=False))
    other = np.isfinite(run.field["loss_factor_other"].to_numpy())
    told = "\n".join([
        f"# Second answers about the edge, {date.today()}",
        "",
        f"`python benchmarks/hysteresis.py --store FOLDER`; damper of examples/{DAMPER.name} (500 spheres, softening",
        "100), `hysteresis = 'intensity'`, stop.tolerance 0.04, at most 80 cycles; graindamp "
        f"{version('graindamp')}. X_opt = h/π.",
        "First: η of the first cycle. Cycles: dropped + averaged. Distance: from the answer from rest, over what makes",
        f"two answers differ (three combined standard errors, and {100 * SHARE_APART:g} % of max(η, 0.05)); they are",
        "two above 1.",
        "",
        "| f [Hz] | Γ | X / X_opt | start | η | m′ | first | cycles | distance |",
        "| --: | --: | --: | --- | --: | --: | --: | --: | --: |",
        *lines,
        "",
        f"{int(other.sum())} of {other.size} points are marked bistable, the starts from second answers included:",
        "",
        "| f [Hz] | Γ | η from rest | η other | m′ from rest | m′ other |",
        "| --: | --: | --: | --: | --: | --: |",
        *(marked(run.field, i, j) for i, j in np.argwhere(other)),
        "",
    ])  # fmt: skip
    given.out.write_text(told, encoding="utf-8")
    print(told)


if __name__ == "__main__":
    main()
