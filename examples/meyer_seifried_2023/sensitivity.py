"""What decides whether the bed keeps bouncing at 100 Hz: one thing changed at a time, for a small or the full damper.

    python sensitivity.py [--out FOLDER] [--count 500] [--cycles 40] [--intensity 40] [--clearance 2.7]

Writes sensitivity-*.png, what-decides-*.png and sensitivity-*.txt; runs that are there already are not run again.
"""

import argparse
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from courses import Course, course
from matplotlib.figure import Figure
from setups import CLEARANCE, load, small, with_contact, with_lid_at

from graindamp.dem.packing import pack
from graindamp.dem.packing_store import Packing
from graindamp.field.theory import collect_and_collide, stroke_ratio_min
from graindamp.report.figures import COLORS, save
from graindamp.spec.field import FieldSpec

FREQUENCY = 100.0


class Change(NamedTuple):
    """One thing that is different."""

    name: str
    spec: FieldSpec
    bed: Packing
    options: dict[str, Any] = {}  # noqa: RUF012 - a NamedTuple's default, never changed


def restitution(plateau: float, wall: float, speed: float, exponent: float) -> dict[str, Any]:
    """Values of [damper.contact] for other constants of the curve of Fig. 3."""

    def curve(value: float) -> dict[str, float]:
        return {"plateau": value, "reference_speed": speed, "exponent": exponent}

    pair = {"between": ["steel-s235", "aluminium-6060"], "restitution": curve(wall)}
    return {"restitution": curve(plateau), "pairs": [pair]}


def changes(spec: FieldSpec, clearance: float) -> Iterator[Change]:
    """All changes of a damper with a clearance [m]. The bed is packed once and put under other lids and laws."""
    bed = with_lid_at(pack(spec.damper), clearance)
    yield Change("as described", spec, bed)
    for other in (2.5e-3, 3.5e-3, 4.0e-3, 5.0e-3, 2.8e-3):
        yield Change(f"clearance {1e3 * other:.1f} mm", spec, with_lid_at(bed, other))
    on_poured = bed.poured_height + clearance - bed.height
    yield Change(f"lid set on the poured bed ({1e3 * on_poured:.1f} mm)", spec, with_lid_at(bed, on_poured))
    for speed in (0.01, 0.1):
        yield Change(f"restitution v0 {speed} m/s", with_contact(spec, **restitution(0.63, 0.54, speed, 1.0)), bed)
    for friction in (0.05, 0.2, 0.3):
        yield Change(f"friction {friction}", with_contact(spec, friction=friction), bed)
    yield Change("from 20 cycles at 1.5 Γ", spec, bed, {"before": 1.5})
    yield Change("motion grows over 5 cycles", spec, bed, {"soft_start": 5.0})
    yield Change("softening 1000", with_contact(spec, softening=1000.0), bed)
    yield Change("softening 10", with_contact(spec, softening=10.0), bed)
    for exponent in (0.5, 2.0):
        yield Change(f"restitution p {exponent}", with_contact(spec, **restitution(0.63, 0.54, 0.03, exponent)), bed)
    for seed in (1, 2):
        again = spec.damper.packing.model_copy(update={"seed": seed})
        yield Change(
            f"another bed, seed {seed}",
            spec,
            with_lid_at(pack(spec.damper.model_copy(update={"packing": again})), clearance),
        )
    loose = spec.damper.packing.model_copy(update={"tap": None})
    yield Change(
        "bed not shaken", spec, with_lid_at(pack(spec.damper.model_copy(update={"packing": loose})), clearance)
    )
    yield Change("softening 1", with_contact(spec, softening=1.0), bed)
    yield Change("time step halved", spec.model_copy(update={"steps_per_contact": 2 * spec.steps_per_contact}), bed)


def run_all(
    count: int, intensity: float, cycles: int, folder: Path, softening: float, clearance: float
) -> dict[str, Course]:
    """Courses of all changes by name."""
    whole = with_contact(load("baseline"), softening=softening)
    found = {}
    for change in changes(whole if count >= 4500 else small(whole, count), clearance):
        options = dict(change.options)
        if "before" in options:
            options["before"] = (options["before"] * intensity, 20)
        one = course(
            change.spec, FREQUENCY, intensity, folder, f"s{count}", cycles=cycles, packing=change.bed, **options
        )
        found[change.name] = one
        print(line_of(change.name, one), flush=True)
    return found


def line_of(name: str, one: Course) -> str:
    """A line of the table."""
    block = one.block
    like = (
        "like no block"
        if block is None
        else f"like a block of X/Xopt {block.stroke_ratio:.2f}, R {block.restitution:.2f}"
    )
    return (
        f"{name:34s} eta {one.loss_factor:6.3f} +- {one.loss_factor_se:5.3f}  m' {one.effective_mass_ratio:6.3f}  "
        f"held {one.held:3d} of {len(one.cycle_loss_factor)}  X/Xopt {one.stroke_ratio:.2f} by clearance, "
        f"{math.pi * one.stroke / one.travel:.2f} by travel ({1e3 * one.travel:.2f} mm); {like}"
    )


def bars(found: dict[str, Course]) -> Figure:
    """Loss factor, m' and cycles held of every change."""
    figure = Figure(figsize=(11, 0.28 * len(found) + 1.2), layout="constrained")
    panels = figure.subplots(1, 3, sharey=True)
    place = np.arange(len(found))[::-1]
    for axes, name, values, errors in (
        (panels[0], "loss factor η [-]", [c.loss_factor for c in found.values()], "loss_factor_se"),
        (panels[1], "effective mass ratio m′ [-]", [c.effective_mass_ratio for c in found.values()],
         "effective_mass_ratio_se"),
        (panels[2], "cycles that the bounce held [-]", [c.held for c in found.values()], ""),
    ):  # fmt: skip
        spread = [getattr(c, errors) if errors else 0.0 for c in found.values()]
        axes.barh(place, values, xerr=spread, color=COLORS[0], height=0.7)
        axes.axvline(values[0], color=COLORS[1], lw=1)
        axes.set_xlabel(name)
    panels[0].set_yticks(place, list(found))
    return figure


def decides(found: dict[str, Course]) -> Figure:
    """Loss factor over the stroke by nominal clearance and by measured travel, and m' by travel, with single bodies."""
    figure = Figure(figsize=(12, 4.2), layout="constrained")
    panels = figure.subplots(1, 3)
    for restitution, style in ((0.0, "-"), (0.1, "--"), (0.2, ":")):
        ratio = np.linspace(stroke_ratio_min(restitution) + 1e-6, 2.0, 300)
        theory = [collect_and_collide(float(value), restitution) for value in ratio]
        look = {"color": "black", "ls": style, "lw": 1, "label": f"one body, R = {restitution:g}"}
        for axes in panels[:2]:
            axes.plot(ratio, [point.loss_factor if point.exists else np.nan for point in theory], **look)
        panels[2].plot(ratio, [point.effective_mass_ratio if point.exists else np.nan for point in theory], **look)
    for name, one in found.items():
        lids = "clearance" in name or "lid" in name or name == "as described"
        bounces = one.held == len(one.cycle_loss_factor) and one.block is not None
        look = {"color": COLORS[1 if lids else 0], "marker": "o", "ls": "none", "ms": 5}
        look["mfc"] = look["color"] if bounces else "none"
        by_travel = math.pi * one.stroke / one.travel
        panels[0].errorbar(one.stroke_ratio, one.loss_factor, one.loss_factor_se, **look)
        if bounces:
            panels[1].errorbar(by_travel, one.loss_factor, one.loss_factor_se, **look)
            panels[2].errorbar(by_travel, one.effective_mass_ratio, one.effective_mass_ratio_se, **look)
    panels[0].set(xlabel="X / X_opt by nominal clearance [-]", ylabel="loss factor η [-]", ylim=(0, 2), xlim=(0.4, 2))
    panels[1].set(xlabel="X / X_opt by the bed's travel [-]", ylabel="η where the bounce is held [-]", ylim=(0, 2))
    panels[2].set(xlabel="X / X_opt by the bed's travel [-]", ylabel="m′ where the bounce is held [-]")
    panels[0].set_title("other clearances (orange), other changes (blue); open: lost", fontsize=9)
    panels[0].legend(fontsize=8)
    return figure


def main() -> None:
    """Run what is missing, print the table, draw the figures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path("meyer-seifried-2023"), help="folder of results")
    parser.add_argument("--count", type=int, default=500, help="spheres; 4500 is the full damper")
    parser.add_argument("--cycles", type=int, default=40)
    parser.add_argument("--intensity", type=float, default=40.0)
    parser.add_argument("--softening", type=float, default=100.0)
    parser.add_argument("--clearance", type=float, default=1e3 * CLEARANCE, help="of the packed bed [mm]")
    asked = parser.parse_args()
    found = run_all(
        asked.count,
        asked.intensity,
        asked.cycles,
        asked.out / "courses",
        asked.softening,
        1e-3 * asked.clearance,
    )
    tag = f"{asked.count}-{asked.intensity:g}-{asked.clearance:.2f}"
    table = "\n".join(line_of(name, one) for name, one in found.items())
    (asked.out / f"sensitivity-{tag}.txt").write_text(table + "\n", encoding="utf-8")
    print(save(bars(found), asked.out / f"sensitivity-{tag}.png"))
    print(save(decides(found), asked.out / f"what-decides-{tag}.png"))


if __name__ == "__main__":
    main()
