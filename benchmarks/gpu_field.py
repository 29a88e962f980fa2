"""The whole field of the baseline damper through `graindamp field`: 28 x 15 points of 25 cycles at full stiffness."""

import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from gpu_report import Report
from graindamp.dem.packing_store import default_folder

PATIENCE = 570.0
"""Time that the command has [s]; the goal is 600."""
EXAMPLE = Path(__file__).parent.parent / "examples" / "baseline-damper.toml"

PLAN = """
[plan]
kind = "grid"
frequency = { start = "40 Hz", stop = "1000 Hz", count = 28 }
intensity = { start = 0.8, stop = 40, count = 15 }

[stop]
min_cycles = 25
max_cycles = 25
"""

TINY = """
[damper]
gravity = [0, 0, 0]
particles = [{ material = "steel", radius = "1 mm" }]
fill = { count = 1 }
container = { kind = "box", size = [0.01, 0.01, 0.0022], material = "steel" }
contact = { restitution = 0.6, friction = 0.2, softening = 1e4 }
packing = { direction = "-z", tap = false }

[plan]
kind = "list"
points = [[1500, 200], [1400, 180]]

[stop]
min_cycles = 8
max_cycles = 8
"""

SIMULATOR = (
    "import sys; sys.setswitchinterval(2e-5); from graindamp.dem.gpu import batch; batch.SIMULATED_THREADS = 1; "
    "from graindamp.cli.main import main; main()"
)
"""`graindamp` with one simulated thread per block, which waits for nobody."""


def run_field(data: Path, out: Path, rehearse: bool, report: Report, found: dict[str, Any]) -> None:
    """Run the command, and say how long it took from its start to its end, compilation included, and what it gave."""
    with tempfile.TemporaryDirectory() as temporary:
        project = Path(temporary) / "gpu-field.toml"
        project.write_text(TINY if rehearse else EXAMPLE.read_text("utf-8").split("[motion]")[0] + PLAN, "utf-8")
        target = out / ("gpu_field_rehearsal.nc" if rehearse else "gpu_field.nc")
        if not rehearse:
            _lend_beds(data)
        start = ["-c", SIMULATOR] if rehearse else ["-m", "graindamp"]
        command = [sys.executable, *start, "field", str(project), "-o", str(target), "--backend", "cuda", "--json"]
        begin = time.perf_counter()
        process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=dict(os.environ))
        try:
            text, _ = process.communicate(timeout=PATIENCE)
        except subprocess.TimeoutExpired:
            process.send_signal(signal.SIGINT)  # what is done stays in its store, and is counted
            try:
                process.communicate(timeout=30.0)
            except subprocess.TimeoutExpired:
                process.kill()
                process.communicate()
            done = len(list((project.parent / "gpu-field-store" / "points").rglob("*.h5")))
            found["left_out"] = f"it was stopped after {PATIENCE:.0f} s with {done} points done"
            report.demand(False, f"whole field: {found['left_out']}")
            return
        seconds = time.perf_counter() - begin
    report.demand(process.returncode == 0, f"whole field: the command ended with {process.returncode}")
    if process.returncode == 0:
        told = json.loads(text)
        steps = told["particle_steps"]
        found |= {"seconds": seconds, "usable": told["usable"], "places": told["places"], "rate": steps / seconds}
        found |= {"particle_steps": steps, "precision": told["precision"], "file": target.name}
        report.demand(told["usable"] == told["places"], f"whole field: {told['places'] - told['usable']} points failed")
        report.demand(told["backend"] == "cuda", f"whole field: computed by {told['backend']}")


def _lend_beds(data: Path) -> None:
    """Put the prepared beds where the command looks for them; their names say what they are."""
    folder = default_folder()
    folder.mkdir(parents=True, exist_ok=True)
    for path in data.glob("*.npz"):
        if not (folder / path.name).exists():
            shutil.copy(path, folder)
