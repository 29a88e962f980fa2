"""The part of the fields that softening spoils, at the stiffness of steel.

    python stiff.py [--out FOLDER] [--names baseline ...] [--workers 1] [--whole]

Softer contacts make the bed itself softer: sound runs through it more slowly, and a resonance of the bed that lies
above the range of Meyer & Seifried falls into it at low intensities. So the points of Gamma <= 4 from 96 Hz on are run
again with softening 1, 36 of the 108; with --whole all of them. Writes NAME-stiff.nc, which fields.py puts in the place
of the softened values. The store is that of fields.py; points that are there are not run again.
"""

import argparse
from pathlib import Path

from setups import HERE, NAMES, load, stiff

from graindamp.campaign.executors import Processes
from graindamp.campaign.outlook import Outlook
from graindamp.campaign.run import run_field
from graindamp.campaign.store import Store
from graindamp.field.store import write_field


class Lines:
    """A line of progress for every point that is done."""

    def __init__(self) -> None:
        """Nothing has been printed."""
        self.shown = -1

    def __call__(self, outlook: Outlook) -> None:
        """Print, if there is news."""
        if outlook.n_done > self.shown:
            left = "" if outlook.seconds_left is None else f", {outlook.seconds_left / 60:.0f} min left"
            print(f"{outlook.n_done} of {outlook.n_point} done{left}", flush=True)
            self.shown = outlook.n_done


def main() -> None:
    """Run what is missing."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path("meyer-seifried-2023"), help="folder of results")
    parser.add_argument("--names", nargs="+", default=list(NAMES), choices=NAMES, help="dampers")
    parser.add_argument("--workers", type=int, default=2, help="processes")
    parser.add_argument("--whole", action="store_true", help="the whole grid, not only where softening matters most")
    asked = parser.parse_args()
    for name in asked.names:
        crew = Processes(asked.workers)
        try:
            with Store(asked.out / "store") as store:
                run = run_field(
                    stiff(load(name), asked.whole), store, crew, project=HERE / f"{name}.toml", watch=Lines()
                )
        finally:
            crew.shutdown()
        path = asked.out / f"{name}-stiff.nc"
        write_field(run.field, path)
        print(f"{path}: {run.n_point} points, {run.n_computed} computed now")
        for failure in run.failures:
            print(f"failed: {failure}")


if __name__ == "__main__":
    main()
