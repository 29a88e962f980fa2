"""Compilation of the engine's functions for the processor, and where the compiled code is kept between runs.

Compiled code is kept in the user's cache folder under a key made of the engine's own sources, the versions of Python
and numba, and the kind of processor, so that a changed line in any file of the engine is never answered by old code.
"""

import hashlib
import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import numba
from llvmlite.binding import get_host_cpu_name

numba.config.SLP_VECTORIZE = 1  # type: ignore[attr-defined] # rows of four numbers become one vector; off by default in numba

Body = TypeVar("Body", bound=Callable[..., Any])

FAST = {"contract", "arcp", "nsz", "nnan"}
"""Liberties of the arithmetic: fused multiply-add, reciprocals, no signed zeros, no NaN. Sums keep their order."""


def cache_folder() -> Path:
    """Folder of the compiled code of exactly these sources, for this kind of processor."""
    key = hashlib.sha256(f"{sys.version} {numba.__version__} {get_host_cpu_name()}".encode())
    for path in sorted(Path(__file__).parent.glob("*.py")):
        key.update(path.name.encode() + path.read_bytes())
    home = os.environ.get("GRAINDAMP_CACHE") or os.environ.get("XDG_CACHE_HOME") or "~/.cache"
    return Path(home).expanduser() / "graindamp" / f"compiled-{key.hexdigest()[:16]}"


def _cacheable() -> bool:
    if os.environ.get("NUMBA_DISABLE_JIT", "0") != "0":
        return False
    try:
        folder = cache_folder()
        folder.mkdir(parents=True, exist_ok=True)
    except OSError:
        return False
    numba.config.CACHE_DIR = str(folder)  # type: ignore[attr-defined]
    return os.access(folder, os.W_OK)


CACHED = _cacheable()
"""Whether compiled code outlives the process; False where no folder can be written."""


OPTIONS: dict[str, Any] = {"nogil": True, "error_model": "numpy", "cache": CACHED, "_nrt": False}
NO_ENTRANCE: dict[str, Any] = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}


def compiled(body: Body) -> Body:
    """The function, compiled for the processor; releases Python's lock so that threads run worlds side by side."""
    result: Body = numba.njit(fastmath=FAST, **OPTIONS)(body)
    return result


def inner(body: Body) -> Body:
    """As :func:`compiled`, for a function that only compiled code calls: without its entrance from Python, which takes
    longer to compile than most bodies, because it unpacks every array of the worlds."""
    result: Body = numba.njit(fastmath=FAST, **OPTIONS, **NO_ENTRANCE)(body)
    return result


def merged(body: Body) -> Body:
    """As :func:`inner`, made part of the machine code of each caller. A call hands over place, sizes and strides of
    every array of the worlds, hundreds of numbers, which takes longer than the work on a few contacts."""
    result: Body = numba.njit(fastmath=FAST, forceinline=True, **OPTIONS, **NO_ENTRANCE)(body)
    return result


def checked(body: Body) -> Body:
    """As :func:`inner`, with arithmetic that still sees NaN and infinity."""
    result: Body = numba.njit(**OPTIONS, **NO_ENTRANCE)(body)
    return result


def pointwise(body: Body) -> Body:
    """A function of scalars, woven into its caller."""
    options: dict[str, Any] = {"inline": "always", "error_model": "numpy", "fastmath": FAST}
    result: Body = numba.njit(**options)(body)
    return result
