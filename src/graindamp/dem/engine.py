"""Running worlds from Python: start, advance, and more room where lists are full."""

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graindamp.dem.backend import advance
from graindamp.dem.precompile import first_compilation
from graindamp.dem.state import Contacts, Worlds, aligned, empty_contacts
from graindamp.status import Status

GROWTH = 1.5
"""Factor by which lists grow when they are full [-]."""


def start(worlds: Worlds) -> Worlds:
    """Worlds with forces and lists at their first positions, ready for :func:`run`.

    The velocities in `worlds.particles` are those at the first positions; they are taken back to mid-step here.
    """
    return run(worlds, 0)


def run(worlds: Worlds, n_step: int, n_thread: int = 1) -> Worlds:
    """Worlds `n_step` steps later; arrays are changed in place, and renewed only where lists had to grow.

    Args:
        worlds: from :func:`graindamp.dem.world.world_of`, or as this function left them.
        n_step: steps to do [-].
        n_thread: processor cores to use; worlds are shared out among them.
    """
    target = int(worlds.clock.step.max()) + n_step
    n_world = len(worlds.clock.step)
    first_compilation(advance, 0, n_world, target, worlds)
    bounds = np.linspace(0, n_world, min(n_thread, n_world) + 1).astype(int)
    full = int(Status.LISTS_FULL)
    while True:
        if len(bounds) == 2:
            advance(0, n_world, target, worlds)
        else:
            with ThreadPoolExecutor(len(bounds) - 1) as pool:
                jobs = [pool.submit(advance, a, b, target, worlds) for a, b in pairwise(bounds)]
                for job in jobs:
                    job.result()
        if not np.any(worlds.clock.status & full):
            return worlds
        worlds = with_room(worlds)
        worlds.clock.status[:] &= ~full


def with_room(worlds: Worlds) -> Worlds:
    """The same worlds with longer lists."""
    pairs, touches = _longer(worlds.pairs), _longer(worlds.touches)
    return aligned(worlds._replace(pairs=pairs, touches=touches))


def _longer(old: Contacts) -> Contacts:
    n_world, capacity = old.first.shape
    new = empty_contacts(n_world, int(GROWTH * capacity) + 16, old.stretch.shape[1] == capacity)
    both: list[tuple[Any, Any]] = list(zip(old, new, strict=True))
    for source, target in both:
        if source.ndim == 1:
            target[:] = source
        else:
            target[:, : source.shape[1]] = source
    return new


def together(batch: Sequence[Worlds]) -> Worlds:
    """One batch of worlds; where they differ in size, the rows of the smaller ones are padded."""

    def join(*parts: Any) -> Any:
        if isinstance(parts[0], tuple):
            return type(parts[0])(*(join(*columns) for columns in zip(*parts, strict=True)))
        return np.concatenate([_padded(part, np.max([other.shape for other in parts], axis=0)) for part in parts])

    joined: Worlds = join(*batch)
    return aligned(joined)


def _padded(array: NDArray[Any], size: NDArray[np.int64]) -> NDArray[Any]:
    """The array with every axis but the first lengthened to `size` by zeros."""
    missing = [(0, 0), *((0, int(n) - have) for n, have in zip(size[1:], array.shape[1:], strict=True))]
    return np.pad(array, missing) if any(after for _, after in missing) else array
