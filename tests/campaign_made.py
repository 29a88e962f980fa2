"""A campaign without an engine: a damper, a plan, and a measurement that follows from the task at once.

Run as a script it is a campaign of its own process, for tests that stop or kill one:

    python campaign_made.py STORE FIELD [processes]
"""

import json
import math
import os
import secrets
import signal
import sys
import time
from pathlib import Path

import numpy as np

from graindamp.campaign.point import PointResult
from graindamp.errors import InputError
from graindamp.spec.field import FieldSpec
from graindamp.spec.model import parse_spec
from graindamp.status import Status

COUNTER = "GRAINDAMP_TEST_COUNTER"
"""Folder in which every call of :func:`made` leaves a file named after its point."""
SLEEP = "GRAINDAMP_TEST_SLEEP"
"""Seconds that every call takes."""
FAULTS = "GRAINDAMP_TEST_FAULTS"
"""Folder with files "<f>-<Gamma>" that say what goes wrong there: die, die once, input, value, or a status."""

DAMPER = {
    "name": "made",
    "particles": [{"material": "steel-s235", "radius": "2 mm"}],
    "fill": {"count": 50},
    "container": {"kind": "cylinder", "axis": "x", "radius": "10 mm", "length": "40 mm", "material": "aluminium-6060"},
    "lid": {"kind": "rigid", "clearance": "3 mm"},
    "contact": {"restitution": 0.6, "friction": 0.2},
}
GRID = {"kind": "grid", "frequency": [50, 100, 200], "intensity": [1, 5, 20, 40]}


def field_spec(plan=None, **more):
    """A field of 12 points, or of another plan."""
    return parse_spec({"title": "made", "damper": DAMPER, "plan": plan or GRID} | more, FieldSpec, "test")


def project(folder, plan=GRID, name="made.toml"):
    """A project file with a plan."""
    lines = ['title = "made"', f"[plan]\n{_toml(plan)}", "[damper]", 'name = "made"']
    lines += ["[[damper.particles]]", _toml(DAMPER["particles"][0])]
    for part in ("fill", "container", "lid", "contact"):
        lines += [f"[damper.{part}]", _toml(DAMPER[part])]
    path = folder / name
    path.write_text("\n".join(lines))
    return path


def _toml(table):
    return "\n".join(f"{key} = {json.dumps(value)}" for key, value in table.items())


def result_of(task, eta, mass=0.5, error=0.001, status=0, n_particle=50):
    """A result with given values; the rest follows from the task."""
    rng = np.random.default_rng(int(task.key[:8], 16))
    return PointResult(
        frequency=task.frequency, intensity=task.intensity, bed_mass=0.0131, loss_factor=eta, loss_factor_se=error,
        effective_mass_ratio=mass, effective_mass_ratio_se=error, n_cycles=20, n_skipped=5, status=status,
        n_particle=n_particle, n_step=int(1e5 / task.frequency), time_step=1e-6, seconds=time.perf_counter(),
        solid_fraction=0.6, clearance=3e-3, largest_overlap=0.01, largest_speed=1.0, losses=np.arange(6.0),
        cycle_loss_factor=eta + 0.01 * rng.normal(size=20), cycle_mass_ratio=mass + 0.01 * rng.normal(size=20),
        end_position=rng.normal(size=(n_particle, 3)), end_velocity=rng.normal(size=(n_particle, 3)),
        end_spin=rng.normal(size=(n_particle, 3)),
    )  # fmt: skip


def made(task, start):
    """A measurement that takes no engine. Bistable for 100 Hz: a start from the high branch stays on it."""
    time.sleep(float(os.environ.get(SLEEP, "0")))
    if COUNTER in os.environ:
        name = f"{task.frequency:g}-{task.intensity:g}-{task.seed}-{task.start or ''}"
        (Path(os.environ[COUNTER]) / f"{name}_{secrets.token_hex(4)}").touch()
    status = _fault(task)
    eta = 0.3 + 0.2 * math.sin(3 * math.log(task.frequency)) + 0.01 * task.seed + 0.001 * task.intensity
    high = task.frequency == 100 and (task.intensity == 40 or (start is not None and start.loss_factor > 0.8))
    return result_of(task, eta + 0.6 * high, status=int(status))


def _fault(task):
    if FAULTS not in os.environ:
        return Status.OK
    path = Path(os.environ[FAULTS]) / f"{task.frequency:g}-{task.intensity:g}"
    if not path.exists():
        return Status.OK
    fault = path.read_text()
    if fault == "die once":
        path.unlink()
    if fault.startswith("die"):
        os.kill(os.getpid(), 9)
    if fault in Status.__members__:
        return Status[fault]
    if fault == "input":
        raise InputError("the bed does not fit")
    raise ValueError("something else")


def counted(folder):
    """Names of the points measured, one for each time."""
    return sorted(path.name.partition("_")[0] for path in folder.iterdir())


def main():
    """A campaign of its own process."""
    # Not above: workers load this module, too, and each would take a second longer to start.
    from graindamp.campaign.executors import executor_of
    from graindamp.campaign.run import run_field
    from graindamp.campaign.store import Store
    from graindamp.field.store import write_field

    # A shell's background jobs, and what they start, ignore Ctrl-C.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    store, field = Path(sys.argv[1]), Path(sys.argv[2])
    crew = executor_of(sys.argv[3] if len(sys.argv) > 3 else "serial", n_worker=2)
    with Store(store) as opened:
        try:
            write_field(run_field(field_spec(), opened, crew, how=made).field, field)
        except KeyboardInterrupt:
            crew.shutdown(now=True)
            opened.close()
            sys.exit(130)
    crew.shutdown()


if __name__ == "__main__":
    from campaign_made import main as start  # the workers know the module under its own name

    start()
