"""Locks of files, which the system takes away from a process that dies."""

import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

HAS_LOCKS = sys.platform != "win32"
"""Whether this system has them."""


def lock(file: Any, *, wait: bool) -> None:
    """Lock an open file until it is closed; nothing where there are no such locks.

    Args:
        file: an open file.
        wait: until another process lets go of it.

    Raises:
        OSError: another process holds it and `wait` is false, or the file system has no locks.
    """
    if sys.platform != "win32":
        import fcntl

        fcntl.flock(file, fcntl.LOCK_EX if wait else fcntl.LOCK_EX | fcntl.LOCK_NB)


@contextmanager
def alone(path: Path) -> Iterator[None]:
    """No other process of the machine is in here with the same file; where there are no locks or the file cannot be
    written, others may be."""
    file = None
    with suppress(OSError):
        path.parent.mkdir(parents=True, exist_ok=True)
        file = path.open("w")
        lock(file, wait=True)
    try:
        yield
    finally:
        if file is not None:
            file.close()
