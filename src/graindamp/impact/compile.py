"""Compilation of the event-driven solver for the processor, and where the compiled code is kept between processes.

numba's cache does not see edits in other files, so the code is kept under a key made of all sources concerned."""

import hashlib
import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import numba

COMPILED = ("compile.py", "state.py", "series.py", "contacts.py", "events.py")
"""Sources that the compiled code depends on."""
Body = TypeVar("Body", bound=Callable[..., Any])


def _cache_folder() -> Path | None:
    """Folder of the compiled code of exactly these sources; None where no folder can be written."""
    key = hashlib.sha256(f"{sys.version} {numba.__version__}".encode())
    for name in COMPILED:
        key.update((Path(__file__).parent / name).read_bytes())
    home = os.environ.get("GRAINDAMP_CACHE") or os.environ.get("XDG_CACHE_HOME") or "~/.cache"
    folder = Path(home).expanduser() / "graindamp" / f"impact-{key.hexdigest()[:16]}"
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError:
        return None
    return folder if os.access(folder, os.W_OK) else None


_FOLDER = None if os.environ.get("NUMBA_DISABLE_JIT", "0") != "0" else _cache_folder()


def compiled(body: Body) -> Body:
    """The function as machine code; it allocates nothing and takes no liberties with the arithmetic."""
    return _compile(body, nogil=True)


def inner(body: Body) -> Body:
    """As :func:`compiled`, for a function that only compiled code calls; its entrance from Python is left out."""
    return _compile(body, no_cpython_wrapper=True, no_cfunc_wrapper=True)


def _compile(body: Body, **options: Any) -> Body:
    # Without counting of references, which nothing here needs, compilation takes a third of the time.
    options |= {"error_model": "numpy", "cache": _FOLDER is not None, "_nrt": False}
    before = numba.config.CACHE_DIR  # type: ignore[attr-defined] # read when a function is declared
    if _FOLDER is not None:
        numba.config.CACHE_DIR = str(_FOLDER)  # type: ignore[attr-defined]
    try:
        result: Body = numba.njit(**options)(body)
    finally:
        numba.config.CACHE_DIR = before  # type: ignore[attr-defined]
    return result
