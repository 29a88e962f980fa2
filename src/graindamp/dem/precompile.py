"""The engine's first compilation on two cores: another process compiles one half, and the disk cache hands it over.

The compiler works on one core, for half a minute. The functions that a loop over steps calls are compiled apart from
one another, so that a second process can take the forces while this one takes the lists. What it leaves in the cache is
what this process would have left there; what it has not done in time, this process does as well.
"""

import os
import pickle
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numba

from graindamp.dem import backend, energy
from graindamp.dem.compile import CACHED, cache_folder
from graindamp.dem.contact import pair_forces
from graindamp.dem.motion import move
from graindamp.dem.state import Worlds
from graindamp.dem.wall_contact import wall_forces
from graindamp.locks import alone

Task = tuple[str, str, tuple[Any, ...]]
"""Module and name of a function, and the numba types of its arguments."""


def first_compilation(loop: Any, *arguments: Any) -> None:
    """Compile a loop over steps and all that it calls, on two cores where this machine has them; nothing if it is kept.

    Of several processes one compiles, and the others wait for it.

    Args:
        loop: compiled function of the loop.
        arguments: what it will be called with, the worlds last.
    """
    if not CACHED or loop.overloads or is_kept(loop):
        return
    with alone(cache_folder() / "compiling.lock"):
        if is_kept(loop):
            return
        if n_core() > 1 and not is_kept(pair_forces):
            _compile_halves(*halves(arguments[-1]))
        loop.compile(tuple(map(numba.typeof, arguments)))


def is_kept(function: Any) -> bool:
    """Whether the cache has machine code of a function, from these sources at this place."""
    return bool(kept_code(function))


def kept_code(function: Any) -> list[Path]:
    """Files of a function's machine code, one for each set of types. The same sources at another place, as in a second
    virtual environment, have files of their own beside these."""
    module = function.__module__.rpartition(".")[-1]
    return list(Path(function.stats.cache_path).glob(f"{module}.{function.__name__}-*.nbc"))


def _compile_halves(mine: list[Task], others: list[Task]) -> None:
    """Compile the first half here while another process does the second, for which it gets as much time."""
    other = begin(others)
    begun = time.monotonic()
    try:
        for task in mine:
            compile_task(task)
        if other is not None:
            other.wait(timeout=time.monotonic() - begun)
    except subprocess.TimeoutExpired:
        pass
    finally:
        if other is not None:
            other.kill()
            other.wait()


def n_core() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def halves(worlds: Worlds) -> tuple[list[Task], list[Task]]:
    """What this process compiles, and what the other one does: about as much."""
    integer, number = numba.types.int64, numba.types.float64
    particles, pairs, touches, walls, rules, motion, clock, record, scratch = map(numba.typeof, worlds)
    lists = {
        backend.renew_lists: (integer, particles, pairs, touches, walls, rules, clock, scratch),
        backend.narrow: (integer, particles, pairs, touches, walls, rules, clock),
        backend.drift: (integer, particles, rules, motion, clock),
        move: (integer, number, motion),
        backend.observe: (integer, motion, rules, clock, numba.types.int32, record),
    }
    forces = {
        pair_forces: (integer, integer, particles, pairs, rules, record, scratch),
        wall_forces: (integer, integer, particles, touches, walls, rules, record, scratch),
        energy.elastic_pairs: (integer, particles, pairs, rules),
        energy.elastic_walls: (integer, particles, touches, walls, rules),
    }

    def tasks(half: dict[Any, tuple[Any, ...]]) -> list[Task]:
        return [(function.__module__, function.__name__, arguments) for function, arguments in half.items()]

    return tasks(lists), tasks(forces)


def begin(tasks: list[Task]) -> "subprocess.Popen[bytes] | None":
    """A process that compiles the tasks; None where none can be started."""
    if not Path(sys.executable or "").stem.lower().startswith("python"):
        return None  # Python within another program, which would start that program once more
    words = [sys.executable, "-P", "-c", "from graindamp.dem.precompile import obey; obey()"]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(path for path in sys.path if path)}
    quiet = subprocess.DEVNULL
    try:
        process = subprocess.Popen(words, stdin=subprocess.PIPE, stdout=quiet, stderr=quiet, env=environment)
        assert process.stdin is not None
        with process.stdin as pipe:
            pipe.write(pickle.dumps(tasks))
    except OSError:
        return None
    return process


def obey() -> None:
    """Compile what standard input tells."""
    for task in pickle.load(sys.stdin.buffer):
        compile_task(task)


def compile_task(task: Task) -> None:
    """Compile a function for types of arguments, or take it from the cache."""
    module, name, arguments = task
    getattr(sys.modules[module], name).compile(arguments)
