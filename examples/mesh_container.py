"""A container from a surface of triangles: a tapered hexagonal cavity, packed, shaken, and its energies balanced."""

from pathlib import Path

import numpy as np
import trimesh

import graindamp as gd
from graindamp.report import motion_picture
from graindamp.report.figures import save
from graindamp.report.ledger import ledger_of
from graindamp.signals.simulated import point_of


def write_cavity(path: Path, bottom: float = 12.0, top: float = 16.0, height: float = 20.0) -> None:
    """Write a hexagonal cavity that widens upwards, as STL in mm: distances of its edges from the axis, and height."""
    angle = np.arange(6) * np.pi / 3.0
    corners = [(r * np.cos(a), r * np.sin(a), z) for r, z in ((bottom, 0.0), (top, height)) for a in angle]
    trimesh.convex.convex_hull(np.array(corners)).export(path)


def main(folder: Path = Path(), count: int = 300, cycles: int = 20) -> float:
    """Write cavity.stl and mesh-container.png into `folder`; return the closure of the energies over work [-]."""
    write_cavity(folder / "cavity.stl")
    damper = {
        "name": "tapered hexagon",
        "particles": [{"material": "steel-s235", "radius": "1.25 mm"}],
        "fill": {"count": count},
        "container": {"kind": "mesh", "file": "cavity.stl", "length_unit": "mm", "material": "aluminium-6060"},
        "contact": {"restitution": 0.6, "friction": 0.1, "softening": 10},
        "packing": {"tap": False},
    }
    motion = {"kind": "harmonic", "frequency": "60 Hz", "intensity": 10, "direction": "z"}
    run_for = {"cycles": cycles, "snapshots_per_cycle": 4}
    spec = gd.SimulationSpec.model_validate({"damper": damper, "motion": motion, "run": run_for})
    run = gd.simulate(spec, folder=folder)
    point = point_of(run)
    picture = save(motion_picture.snapshot_figure(run), folder / "mesh-container.png")

    ledger = ledger_of(run, point.n_skipped)
    assert ledger is not None
    error = point.dissipated_energy * point.loss_factor_error / point.loss_factor
    print(f"dissipated energy: {1e3 * point.dissipated_energy:.3f} ± {1e3 * error:.3f} mJ per cycle")
    print(f"work less losses less gain of stored energy: {100 * ledger.closure_share:.3f} % of the work")
    print(f"drawn in {picture}")
    return ledger.closure_share


if __name__ == "__main__":
    main()
