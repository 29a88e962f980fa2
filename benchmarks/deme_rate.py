"""The other side of gpu_check.py: the same shaken bed, advanced by DEM-Engine on the same GPU.

    python -m venv ENV && ENV/bin/pip install "deme[cuda12]==3.0.19"      its environment
    python benchmarks/gpu_check.py --deme ENV/bin/python                  who asks for it

DEM-Engine runs as a separate program in an environment of its own: this file, started by that environment's Python. It
compiles its kernels when it starts, which without a cache takes minutes, so that it is started early, says "ready", and
times the bed when it is told to go. It advances one bed at a time; beds side by side in one domain would need walls
that are meshes, which cost it more.

The container stands still and the bed feels the body acceleration amplitude omega^2 sin(omega t) along the axis x, as
in lammps_rate.py. Laws: Hertz with Mindlin's tangential spring, constant restitution, Coulomb's limit, no rolling
resistance; forces in single precision. The bed starts with its positions and velocities, but without spins, which the
interface does not take before the kernels are there."""

import importlib
import json
import math
import os
import queue
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

PIECES = 64
"""Pieces of a cycle between which the clock is looked at [-]."""

STAND_IN = '''
class Anything:
    """Stands for every object of DEM-Engine: takes every call, and gives velocities of resting spheres."""

    def __init__(self, *given):
        self.centres = []

    def __getattr__(self, name):
        return lambda *given: self

    def AddClumps(self, kind, centres):
        self.centres = centres
        return self

    def Velocities(self):
        return [[0.0, 0.0, 0.0] for _ in self.centres]


__version__ = "none: a stand-in"
DEMSolver = Anything
'''
"""A module `deme` for rehearsals."""


class Shaken(NamedTuple):
    """A bed and how it is shaken; SI units."""

    states: str
    """File of :func:`particle_steps_per_second.prepared`; its first state is taken."""
    radius: float
    """Of the particles [m]."""
    density: float
    """[kg/m^3]"""
    cylinder: float
    """Inner radius of the container [m]."""
    frequency: float
    """[Hz]"""
    acceleration: float
    """Amplitude omega^2 x of the container's [m/s^2]."""
    gravity: float
    """Along -z [m/s^2]."""
    time_step: float
    """[s]"""


class DemEngine:
    """DEM-Engine at work in another process.

    Attributes:
        trouble: why there is nothing to measure, if so.
    """

    def __init__(self, python: Path | None, shaken: Shaken, log: Path, stand_in: bool = False) -> None:
        """Start it; it compiles while others work.

        Args:
            python: of an environment with `deme`; None: there is none.
            shaken: the bed.
            log: file for what it says.
            stand_in: with a module in place of `deme`, for rehearsals.
        """
        self.trouble = "" if python is not None else "no environment with deme was given (--deme PYTHON)"
        self.begun = time.perf_counter()
        self._lines: queue.Queue[str] = queue.Queue()
        self._process: subprocess.Popen[str] | None = None
        if python is None:
            return
        environment = dict(os.environ)
        if stand_in:
            self._module = tempfile.TemporaryDirectory()
            Path(self._module.name, "deme.py").write_text(STAND_IN, encoding="utf-8")
            environment["PYTHONPATH"] = self._module.name
        environment.setdefault("DEME_PERSISTENT_JITIFY_CACHE", str(log.with_suffix(".cache").resolve()))
        try:
            with log.open("w", encoding="utf-8") as errors:
                self._process = subprocess.Popen(
                    [str(python), __file__, json.dumps(shaken._asdict())],
                    stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=errors, text=True, env=environment,
                )  # fmt: skip
        except OSError as error:
            self.trouble = f"{python} does not start ({error})"
            return
        threading.Thread(target=self._listen, daemon=True).start()

    def _listen(self) -> None:
        assert self._process is not None
        assert self._process.stdout is not None
        for line in self._process.stdout:
            if line.startswith("{"):
                self._lines.put(line)
        self._lines.put('{"error": "it ended without an answer"}')

    def _told(self, seconds: float) -> dict[str, Any]:
        try:
            told: dict[str, Any] = json.loads(self._lines.get(timeout=max(seconds, 0.1)))
        except queue.Empty:
            waited = time.perf_counter() - self.begun
            told = {
                "error": f"no answer {waited:.0f} s after its start; its kernels compile for minutes without a cache"
            }
        return told

    def rate(self, seconds: float, patience: float) -> dict[str, Any]:
        """What it measured, or {"not measured": reason}.

        Args:
            seconds: to advance the bed for, at most a cycle [s].
            patience: to wait for all of it [s].
        """
        deadline = time.perf_counter() + patience
        if self.trouble or self._process is None:
            return {"not measured": self.trouble}
        ready = self._told(patience - seconds)
        if "error" in ready:
            return {"not measured": ready["error"]}
        assert self._process.stdin is not None
        try:
            self._process.stdin.write(f"{seconds}\n")
            self._process.stdin.flush()
        except OSError as error:
            return {"not measured": f"it is gone ({error})"}
        found = self._told(deadline - time.perf_counter())
        return {"not measured": found["error"]} if "error" in found else ready | found

    def end(self) -> None:
        """End it, whatever it is doing."""
        if self._process is not None:
            self._process.kill()
            self._process.wait()


def solver_of(deme: Any, shaken: Shaken, file: Any) -> tuple[Any, Any]:
    """Solver and tracker of the bed, ready to run. The names are those of deme 3.0.19."""
    length = float(file["length"])
    margin = 4.0 * shaken.radius
    side = shaken.cylinder + margin
    solver = deme.DEMSolver([0])
    solver.SetVerbosity("ERROR")
    solver.SetNoForceRecord(True)
    solver.UseFrictionalHertzianModel()
    steel = solver.LoadMaterial({"E": 208e9, "nu": 0.3, "CoR": 0.63, "mu": 0.1, "Crr": 0.0})
    aluminium = solver.LoadMaterial({"E": 70e9, "nu": 0.33, "CoR": 0.54, "mu": 0.1, "Crr": 0.0})
    solver.SetMaterialPropertyPair("CoR", steel, aluminium, 0.54)
    solver.SetMaterialPropertyPair("mu", steel, aluminium, 0.1)
    solver.InstructBoxDomainDimension((-margin, length + margin), (-side, side), (-side, side))
    solver.InstructBoxDomainBoundingBC("none", aluminium)
    container = solver.AddExternalObject()
    container.AddCylinder([0.0, 0.0, 0.0], [1.0, 0.0, 0.0], shaken.cylinder, aluminium)
    container.AddPlane([0.0, 0.0, 0.0], [1.0, 0.0, 0.0], aluminium)
    container.AddPlane([length, 0.0, 0.0], [-1.0, 0.0, 0.0], aluminium)
    container.SetFamily(10)
    solver.SetFamilyFixed(10)
    mass = shaken.density * 4.0 / 3.0 * math.pi * shaken.radius**3
    sphere = solver.LoadSphereType(mass, shaken.radius, steel)
    bed = solver.AddClumps(sphere, file["position"][0].tolist())
    bed.SetVel(file["velocity"][0].tolist())
    bed.SetFamily(0)
    tracker = solver.Track(bed)
    omega = 2.0 * math.pi * shaken.frequency
    wave = f"{shaken.acceleration:.9g} * sin({omega:.12g} * t + {omega * float(file['time'][0]):.9g})"
    solver.AddFamilyPrescribedAcc(0, wave, "none", "none")
    solver.SetGravitationalAcceleration([0.0, 0.0, -shaken.gravity])
    solver.SetErrorOutVelocity(100.0)
    solver.SetTimeStepSize(shaken.time_step)
    solver.Initialize()
    return solver, tracker


def advanced(solver: Any, tracker: Any, shaken: Shaken, n: int, seconds: float) -> dict[str, Any]:
    """Particle-steps per second over at most a cycle, after some steps that warm it up; and the mean of the particles'
    squared speed after an eighth of a cycle [m^2/s^2], None if it did not get so far."""
    n_piece = round(1.0 / shaken.frequency / shaken.time_step / PIECES)
    warm = n_piece // 8
    solver.DoDynamicsThenSync(warm * shaken.time_step)
    spent, done, squared = 0.0, 0, None
    while done < PIECES and spent < seconds:
        steps = n_piece - (warm if done == 0 else 0)
        begin = time.perf_counter()
        solver.DoDynamicsThenSync(steps * shaken.time_step)
        spent += time.perf_counter() - begin
        done += 1
        if done == PIECES // 8:
            squared = float(np.mean(np.sum(np.square(tracker.Velocities()), axis=1)))
    n_step = done * n_piece - warm
    share = done / PIECES
    return {"rate": n * n_step / spent, "steps": n_step, "seconds": spent, "cycle": share, "squared_speed": squared}


def main() -> None:
    shaken = Shaken(**json.loads(sys.argv[1]))
    begin = time.perf_counter()
    try:
        deme = importlib.import_module("deme")
        with np.load(shaken.states) as file:
            n = file["position"].shape[1]
            solver, tracker = solver_of(deme, shaken, file)
        ready = {"version": getattr(deme, "__version__", "?"), "start_up_seconds": time.perf_counter() - begin}
        print(json.dumps(ready), flush=True)
        print(json.dumps(advanced(solver, tracker, shaken, n, float(sys.stdin.readline()))), flush=True)
    except Exception as error:  # of whatever kind, it is the answer
        lines = f"{type(error).__name__}: {error}".splitlines()
        print(json.dumps({"error": f"deme cannot be used: {lines[0]}"}), flush=True)


if __name__ == "__main__":
    main()
