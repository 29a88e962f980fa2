"""Arrays of a batch of worlds."""

import numpy as np
import pytest

from dem_made import damper_of, made
from graindamp.dem.state import CACHE_LINE, aligned


@pytest.mark.parametrize("count", [3, 4000])
def test_arrays_begin_with_a_cache_line(count):
    """Small worlds and those on large pages alike; what the arrays hold stays."""
    place = np.column_stack([np.arange(count) * 3e-3, np.zeros(count), np.full(count, 2e-3)])
    worlds = made(damper_of(), 1e-7, place, 1e-3, begin=False)
    again = aligned(worlds)
    for one, other in zip(worlds, again, strict=True):
        for before, after in zip(one, other, strict=True):
            assert before.dtype == after.dtype
            assert np.array_equal(before, after)
    for part in (again.particles, again.pairs, again.touches, again.scratch):
        assert all(array.ctypes.data % CACHE_LINE == 0 and array.flags.c_contiguous for array in part)
        assert not any(np.shares_memory(part[0], array) for array in part[1:])
