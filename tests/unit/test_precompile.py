"""The engine's first compilation on two cores."""

import os
import shutil
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import numba
import numpy as np
import pytest

from dem_made import damper_of, made
from graindamp.dem import energy, precompile
from graindamp.dem.compile import CACHED

TASK = ("graindamp.dem.energy", "spring_energy", (numba.types.float64[::1],))
"""Compiled in a moment."""


class Loop:
    """Stands for a function that this process has not compiled."""

    __module__ = "graindamp.dem.backend"

    def __init__(self, folder, overloads=(), name="loop"):
        self.__name__ = name
        self.stats = SimpleNamespace(cache_path=str(folder))
        self.overloads = overloads
        self.compiled = []

    def compile(self, types):
        self.compiled.append(types)


@pytest.fixture
def nothing_kept(tmp_path, monkeypatch):
    monkeypatch.setattr(precompile, "CACHED", True)
    monkeypatch.setattr(precompile, "cache_folder", lambda: tmp_path)
    monkeypatch.setattr(precompile, "n_core", lambda: 2)
    monkeypatch.setattr(precompile, "pair_forces", Loop(tmp_path, name="forces"))
    monkeypatch.setattr(precompile, "halves", lambda worlds: ([TASK], [TASK]))


@pytest.mark.skipif(not CACHED, reason="needs a folder for compiled code")
def test_the_halves_are_what_the_loop_calls():
    """A function that is compiled for other types than those that the loop calls it with is in the cache twice."""
    place = np.column_stack([np.arange(3) * 3e-3, np.zeros(3), np.full(3, 2e-3)])
    worlds = made(damper_of(), 1e-7, place, 1e-3)
    energy.elastic_pairs(0, worlds.particles, worlds.pairs, worlds.rules)
    energy.elastic_walls(0, worlds.particles, worlds.touches, worlds.walls, worlds.rules)
    for module, name, _ in [task for half in precompile.halves(worlds) for task in half]:
        assert len(precompile.kept_code(getattr(sys.modules[module], name))) == 1, name


@pytest.mark.slow
def test_another_process_leaves_machine_code_in_the_cache(tmp_path, monkeypatch):
    monkeypatch.setenv("GRAINDAMP_CACHE", str(tmp_path))
    other = precompile.begin([TASK])
    assert other.wait(timeout=300) == 0
    assert list(tmp_path.rglob("energy.spring_energy-*.nbc"))


@pytest.mark.slow
def test_files_of_the_user_are_not_taken_for_modules(tmp_path, monkeypatch):
    (tmp_path / "signal.py").write_text("open('taken', 'w').close()", encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    other = precompile.begin([])
    assert other.wait(timeout=300) == 0
    assert not (tmp_path / "taken").exists()


@pytest.mark.parametrize("program", ["", "/opt/solver/solver-gui", "/nowhere/python3"])
def test_python_that_cannot_be_started_is_done_without(monkeypatch, program):
    monkeypatch.setattr(sys, "executable", program)
    assert precompile.begin([TASK]) is None


@pytest.mark.parametrize("does", ["raise SystemExit(1)", "import time; time.sleep(600)"])
def test_another_process_that_fails_or_hangs_stops_nothing(nothing_kept, tmp_path, monkeypatch, does):
    other = subprocess.Popen([sys.executable, "-c", does])
    monkeypatch.setattr(precompile, "begin", lambda tasks: other)
    loop = Loop(tmp_path)
    precompile.first_compilation(loop, 0, np.zeros(2))
    assert other.poll() is not None
    assert loop.compiled == [(numba.types.int64, numba.types.float64[::1])]


def test_what_is_kept_is_not_compiled(nothing_kept, tmp_path, monkeypatch):
    begun = []
    monkeypatch.setattr(precompile, "begin", begun.append)
    running, kept, other = Loop(tmp_path, {"types": "code"}), Loop(tmp_path), Loop(tmp_path)
    precompile.first_compilation(running, 0)
    (tmp_path / "backend.loop-1.py311.nbc").touch()
    precompile.first_compilation(kept, 0)
    assert not running.compiled
    assert not kept.compiled
    (tmp_path / "backend.loop-1.py311.nbc").rename(tmp_path / "backend.forces-1.py311.nbc")
    precompile.first_compilation(other, 0)  # another loop, whose parts are there
    assert other.compiled
    assert not begun


@pytest.mark.slow
@pytest.mark.skipif(not CACHED, reason="needs a folder for compiled code")
def test_the_same_sources_at_another_place_are_compiled_for_themselves(tmp_path):
    """Two virtual environments share a folder for compiled code, but numba takes none of it from the other place."""
    package = Path(precompile.__file__).parents[1]
    shutil.copytree(package, tmp_path / "graindamp", ignore=shutil.ignore_patterns("__pycache__"))
    words = "from graindamp.dem import precompile; print(precompile.is_kept(precompile.pair_forces))"
    environment = os.environ | {"PYTHONPATH": str(tmp_path)}
    answer = subprocess.run(
        [sys.executable, "-c", words], cwd=tmp_path, env=environment, capture_output=True, text=True, check=True
    )
    assert answer.stdout.strip() == "False"
