"""How long until graindamp answers: import, help, a rule, analysis, the demo, and the engine's first step, each in a
fresh process.

Usage: python benchmarks/start_up.py [--repeat 5] [--out FILE.md]

Prints wall-clock minimum, median and maximum, and checks every answer. The first run of each command warms the disk
cache and is not counted; the engine's first compilation begins with an empty cache every time.
"""

import argparse
import json
import os
import platform
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from datetime import date
from importlib.metadata import version
from importlib.resources import files
from pathlib import Path

ENGINE = """
import numpy as np
from graindamp.dem.packing_store import Packing
from graindamp.dem.simulate import simulate
from graindamp.spec.model import parse_spec
from graindamp.spec.simulation import SimulationSpec
spec = parse_spec({
    "damper": {
        "gravity": [0.0, 0.0, 0.0],
        "particles": [{"material": "steel", "radius": 1e-3}],
        "fill": {"count": 1},
        "container": {"kind": "box", "size": [0.01, 0.01, 0.01], "material": "steel"},
        "contact": {"restitution": 0.5, "friction": 0.1, "softening": 1e4},
    },
    "motion": {"kind": "harmonic", "frequency": 500.0, "intensity": 50.0, "direction": "x"},
    "run": {"cycles": 1, "settle": 1e-5},
}, SimulationSpec, "ball")
nan = float("nan")
bed = Packing(np.full((1, 3), 1.02e-3), np.array([1e-3]), np.zeros(1, np.int32), nan, nan, nan, nan, None, None, 0, 0.0)
print(simulate(spec, packing=bed).n_step)
"""
"""One ball in a box: next to no work, so that what is timed is the engine's start."""

LIMIT_IMPORT = 0.5
"""`import graindamp` stays under this [s], interpreter included."""


def run(*words: str, cache: str | None = None) -> str:
    """Standard output of a Python process; compiled code and packings are in the folder `cache`, or the user's."""
    environment = os.environ | ({} if cache is None else {"GRAINDAMP_CACHE": cache})
    return subprocess.run([sys.executable, *words], capture_output=True, text=True, check=True, env=environment).stdout


def first_step() -> str:
    """What the engine answers where it has never been compiled."""
    with tempfile.TemporaryDirectory() as empty:
        return run("-c", ENGINE, cache=empty)


def graindamp(*words: str) -> str:
    """Standard output of a graindamp command."""
    return run("-c", "from graindamp.cli.main import main; main()", *words)


def questions(folder: Path) -> dict[str, tuple[Callable[[], str], Callable[[str], bool]]]:
    """What is timed, and what its answer must be."""
    signals = str(files("graindamp") / "data" / "demo-signals.h5")
    slide = ("rules", "sliding", "--intensity", "0.2", "--friction", "0.1", "--json")
    return {
        "import graindamp": (
            lambda: run("-c", "import graindamp; print(graindamp.__version__)"),
            lambda out: "." in out,
        ),
        "graindamp --help": (lambda: graindamp("--help"), lambda out: "analyze" in out),
        "graindamp rules sliding": (
            lambda: graindamp(*slide),
            lambda out: abs(json.loads(out)["loss_factor"] - 0.39406) < 1e-5,
        ),
        "graindamp analyze (36 records)": (
            lambda: graindamp("analyze", signals, "--json"),
            lambda out: len(json.loads(out)["points"]) == 30,
        ),
        "graindamp demo --measured": (
            lambda: graindamp("demo", "--measured", "--out", str(folder), "--json"),
            lambda out: all(mode["equilibria"] for mode in json.loads(out)["modes"]),
        ),
        "first step of the engine, never compiled": (first_step, lambda out: int(out) > 0),
        "first step of the engine, compiled before": (lambda: run("-c", ENGINE), lambda out: int(out) > 0),
    }


def yardstick() -> float:
    """Time of five million additions in a plain loop [s]: a machine that others use has slow minutes."""
    begun, total = time.perf_counter(), 0
    for number in range(5_000_000):
        total += number
    return time.perf_counter() - begun


def processor() -> str:
    """Model name of the processor."""
    lines = Path("/proc/cpuinfo").read_text().splitlines() if Path("/proc/cpuinfo").exists() else []
    return next((line.split(":")[1].strip() for line in lines if line.startswith("model name")), platform.processor())


def main() -> None:
    """Time, check, print, and write what was printed."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repeat", type=int, default=5)
    parser.add_argument("--out", type=Path)
    options = parser.parse_args()
    lines = [
        f"# Start-up times, {date.today().isoformat()}",
        "",
        f"{processor()}, Python {platform.python_version()}, numpy {version('numpy')}, xarray {version('xarray')}, "
        f"matplotlib {version('matplotlib')}; wall clock [s] of a whole process, {options.repeat} runs",
        "",
        "| command | minimum | median | maximum |",
        "| --- | --: | --: | --: |",
    ]
    loops: list[float] = []
    with tempfile.TemporaryDirectory() as folder:
        for name, (ask, is_right) in questions(Path(folder)).items():
            seconds = []
            for _ in range(options.repeat + 1):
                loops.append(yardstick())
                start = time.perf_counter()
                answer = ask()
                seconds.append(time.perf_counter() - start)
                if not is_right(answer):
                    sys.exit(f"{name}: wrong answer: {answer[:200]}")
            counted = seconds[1:]
            median = statistics.median(counted)
            lines.append(f"| {name} | {min(counted):.2f} | {median:.2f} | {max(counted):.2f} |")
            if name.startswith("import") and median > LIMIT_IMPORT:
                sys.exit(f"import graindamp takes {median:.2f} s, more than {LIMIT_IMPORT} s")
    lines += [
        "",
        f"Before each run five million additions in a plain Python loop took {min(loops):.2f} to {max(loops):.2f} s, "
        f"median {statistics.median(loops):.2f} s: how slow the machine's minutes were.",
    ]
    text = "\n".join(lines) + "\n"
    print(text)
    if options.out:
        options.out.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
