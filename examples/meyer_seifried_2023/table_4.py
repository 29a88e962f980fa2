"""Table 4 of Meyer & Seifried (2023): 60 Hz, Gamma 2 and 15, without and with coated walls, at the stiffness of steel.

    python table_4.py [--out FOLDER] [--workers 2] [--softening 1] [--max-cycles 25] [--count 4500]

The paper's values are not available here. Writes table-4.txt; points that are in the store are not run again.
"""

import argparse
from pathlib import Path

from setups import HERE, load, on_grid, small, with_contact

from graindamp.campaign.executors import Processes
from graindamp.campaign.run import run_field
from graindamp.campaign.store import Store
from graindamp.spec.field import FieldSpec

DAMPERS = ("baseline", "coated-60hz")
FREQUENCY = 60.0
INTENSITIES = (2.0, 15.0)


def asked_of(name: str, softening: float, max_cycles: int, count: int) -> FieldSpec:
    """The points of one damper."""
    spec = load(name)
    spec = spec if count >= 4500 else small(spec, count)
    return on_grid(with_contact(spec, softening=softening), (FREQUENCY,), INTENSITIES, max_cycles)


def main() -> None:
    """Run what is missing, print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path("meyer-seifried-2023"), help="folder of results")
    parser.add_argument("--workers", type=int, default=2, help="processes")
    parser.add_argument("--softening", type=float, default=1.0, help="divisor of the stiffness")
    parser.add_argument("--max-cycles", type=int, default=25, help="cycles of a point at most")
    parser.add_argument("--count", type=int, default=4500, help="spheres; fewer for a trial")
    asked = parser.parse_args()
    lines = []
    for name in DAMPERS:
        spec = asked_of(name, asked.softening, asked.max_cycles, asked.count)
        crew = Processes(asked.workers)
        try:
            with Store(asked.out / "store") as store:
                run = run_field(spec, store, crew, project=HERE / f"{name}.toml")
        finally:
            crew.shutdown()
        for intensity in INTENSITIES:
            point = run.field.sel(frequency=FREQUENCY, intensity=intensity)
            lines.append(
                f"{name:12s} {FREQUENCY:g} Hz Gamma {intensity:2g}: eta {float(point['loss_factor']):.3f} +- "
                f"{float(point['loss_factor_se']):.3f}, m' {float(point['effective_mass_ratio']):.3f} +- "
                f"{float(point['effective_mass_ratio_se']):.3f}, {float(point['particle_steps']):.2g} particle-steps"
            )
            print(lines[-1], flush=True)
    (asked.out / "table-4.txt").write_text("\n".join(lines) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
