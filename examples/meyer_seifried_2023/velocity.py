"""How the bed moves: velocity fields as in Figs 1, 9 and 13 of Meyer & Seifried (2023), and the map of its modes.

    python velocity.py [--out FOLDER] [--softening 100] [--cycles 12] [--count 4500]

Each run is kept in FOLDER/runs, and not run again. Writes velocity-modes.png, velocity-inserts.png and
velocity-coating.png; and modes.png, of the baseline's field where fields.py has left one in FOLDER.
"""

import argparse
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

from setups import HERE, load, small, with_contact, with_lid_at

from graindamp.dem.packing import pack
from graindamp.dem.run import Run
from graindamp.dem.simulate import simulate
from graindamp.field.store import read_field
from graindamp.report.figures import save
from graindamp.report.mode_figures import mode_map, velocity_fields
from graindamp.report.run_file import load_run, save_run
from graindamp.spec.simulation import VelocityFieldSpec

CELL = 5e-3
"""Side of the cells that velocities are averaged over [m], two diameters of a sphere."""

HELD = 2.6e-3
"""Lid of the baseline under which 100 Hz, Gamma 40 keeps bouncing [m]; see table_2.py."""


class View(NamedTuple):
    """One panel."""

    name: str
    frequency: float
    """[Hz]"""
    intensity: float
    """Gamma [-]."""
    title: str = ""
    clearance: float | None = None
    """[m]; None: as described."""


FIGURES = {
    "modes": (
        View("baseline", 40.0, 1.0, "local fluidisation"),
        View("baseline", 96.2, 4.0, "global fluidisation"),
        View("baseline", 53.6, 16.0, "bouncing collect-and-collide"),
        View("baseline", 231.5, 16.0, "decoupled"),
    ),
    "inserts": (
        View("baseline", 100.0, 20.0, "baseline", HELD),
        View("baseline", 100.0, 40.0, "baseline", HELD),
        View("triple-cross", 100.0, 20.0, "triple cross"),
        View("triple-cross", 100.0, 40.0, "triple cross"),
    ),
    "coating": (
        View("baseline", 60.0, 2.0, "aluminium walls"),
        View("baseline", 60.0, 15.0, "aluminium walls"),
        View("coated-60hz", 60.0, 2.0, "walls coated with 0.72 MPa"),
        View("coated-60hz", 60.0, 15.0, "walls coated with 0.72 MPa"),
    ),
}
"""Panels of Figs 1, 9 and 13; the solid-like state of Fig. 1 is not among those that the bed takes here."""

OFFSET = {"inserts": 3e-3}
"""Distance of the plane from the middle [m], as in Fig. 9; it hides the crosses."""


def run_of(view: View, folder: Path, softening: float, cycles: int, count: int) -> Run:
    """The run of a panel, from its file or now."""
    lid = "" if view.clearance is None else f"-h{1e3 * view.clearance:g}"
    name = f"{view.name}-{view.frequency:g}-{view.intensity:g}{lid}-s{softening:g}-c{cycles}-n{count}.h5"
    if (folder / name).is_file():
        return load_run(folder / name)
    field = load(view.name)
    field = field if count >= 4500 else small(field, count)
    field = with_contact(field, softening=softening)
    spec = field.at(view.frequency, view.intensity)
    shown = {"cycles": float(cycles), "velocity_field": VelocityFieldSpec(cell=CELL)}
    spec = spec.model_copy(update={"run": spec.run.model_copy(update=shown)})
    bed = pack(spec.damper, folder=HERE)
    found = simulate(spec, packing=bed if view.clearance is None else with_lid_at(bed, view.clearance), folder=HERE)
    folder.mkdir(parents=True, exist_ok=True)
    save_run(found, folder / name)
    return found


def panels(
    views: tuple[View, ...], folder: Path, softening: float, cycles: int, count: int
) -> Iterator[tuple[str, Run]]:
    """Headings and runs of a figure."""
    for view in views:
        run = run_of(view, folder, softening, cycles, count)
        heading = f"{view.title}\n{view.frequency:g} Hz, Γ = {view.intensity:g}"
        print(f"{view.name:12s} {view.frequency:g} Hz Gamma {view.intensity:g}: {run.n_step} steps", flush=True)
        yield heading, run


def main() -> None:
    """Run what is missing, draw the figures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path("meyer-seifried-2023"), help="folder of results")
    parser.add_argument("--softening", type=float, default=100.0, help="divisor of the stiffness")
    parser.add_argument("--cycles", type=int, default=12, help="cycles of a run")
    parser.add_argument("--count", type=int, default=4500, help="spheres; fewer for a trial")
    parser.add_argument("--figures", nargs="+", default=list(FIGURES), choices=FIGURES, help="which to draw")
    asked = parser.parse_args()
    for figure in asked.figures:
        runs = dict(panels(FIGURES[figure], asked.out / "runs", asked.softening, asked.cycles, asked.count))
        print(save(velocity_fields(runs, OFFSET.get(figure, 0.0)), asked.out / f"velocity-{figure}.png"))
    known = asked.out / "baseline.nc"
    if known.is_file():
        print(save(mode_map(read_field(known)), asked.out / "modes.png"))


if __name__ == "__main__":
    main()
