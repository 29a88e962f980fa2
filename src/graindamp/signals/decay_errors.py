"""Standard errors of what is made of peaks, with the peaks that neighbouring cycles share."""

from typing import Any, TypeAlias

import numpy as np
import scipy.sparse
from numpy.typing import NDArray

Real = NDArray[np.float64]
Matrix: TypeAlias = Any
"""A sparse array of scipy, which has no types."""


def cycle_sensitivity(factor: Real) -> Matrix:
    """How values of cycles follow the logarithms of the peaks: `factor` times (first - last) of each cycle.

    Args:
        factor: derivative of the value by the logarithm of the first peak over the last; shape (cycle,).

    Returns:
        shape (cycle, cycle + 2): cycle i runs from peak i to peak i + 2, of the same sign.
    """
    n = len(factor)
    return scipy.sparse.csr_array(scipy.sparse.diags_array([factor, -factor], offsets=[0, 2], shape=(n, n + 2)))


def moving_average(n: int, width: int) -> Matrix:
    """Mean of `width` neighbours, of as many as there are on both sides near the ends; shape (n, n)."""
    half = np.minimum(width // 2, np.minimum(np.arange(n), np.arange(n)[::-1]))
    row = np.repeat(np.arange(n), 2 * half + 1)
    column = np.concatenate([np.arange(i - h, i + h + 1) for i, h in enumerate(half)])
    return scipy.sparse.csr_array((1.0 / np.repeat(2 * half + 1, 2 * half + 1), (row, column)), shape=(n, n))


def spread(matrix: Matrix, error: Real) -> Real:
    """Standard errors of `matrix` times independent values with these standard errors."""
    return np.asarray(np.sqrt(matrix.power(2) @ error**2), float)
