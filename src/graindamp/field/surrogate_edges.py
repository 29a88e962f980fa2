"""The uncertain edge of a surrogate: a lattice of edges with their prior weights, and the gate through each.

An edge is a row of position, slope, curvature, width and log prior; its gate passes from the regime below to that
above along ln(X / X_opt) = position + slope F + curvature F^2, F = ln(f / 100 Hz), over the width.
"""

import numpy as np
from numpy.typing import NDArray

from graindamp.field.surrogate_prior import Form, Places

Real = NDArray[np.float64]

EDGE_SPREAD, EDGE_LIMIT, EDGE_STEP = 0.7, 1.6, 0.1
SLOPES, SLOPE_SPREAD = (-0.3, -0.15, 0.0, 0.15, 0.3), 0.15
CURVATURES, CURVATURE_SPREAD = (-0.35, 0.0, 0.35), 0.25
COARSE_WIDTHS, WIDTHS = (0.03, 0.1), (0.02, 0.05, 0.12)
"""Values and spreads of position, slope, curvature and width, as the formula of the edge has them [-]."""
NO_EDGE = 1e3
"""Position of an edge above all points, which is none."""
NO_EDGE_PROBABILITY = 0.02


def lattice(form: Form, free: Real | None) -> Real:
    """Edges to weigh at first, the first of them none; (edge, 5). `free`: ln X of the points, if X_opt is unknown."""
    none = np.array([[NO_EDGE, 0.0, 0.0, 0.1, np.log(NO_EDGE_PROBABILITY) if form.has_edge else 0.0]])
    if not form.has_edge:
        return none
    low, high = (-EDGE_LIMIT, EDGE_LIMIT) if free is None else (float(free.min()), float(free.max()))
    position = np.linspace(low, high, max(2, round((high - low) / EDGE_STEP) + 1))
    return np.concatenate([none, lattice_of(position, np.array(SLOPES), (0.0,), COARSE_WIDTHS, free is not None)])


def lattice_of(
    position: Real, slope: Real, curvatures: tuple[float, ...], widths: tuple[float, ...], is_free: bool
) -> Real:
    """All edges of a lattice with equally spaced positions and slopes, each with its log prior; (edge, 5).

    Positions are normal about X_opt, or uniform if `is_free`; slopes are normal about 0, and curvatures and widths take
    the given values only, curvatures with normal weights.
    """
    axes = np.meshgrid(position, slope, curvatures, widths, indexing="ij")
    edges = np.column_stack([axis.ravel() for axis in axes])
    bent = np.exp(-0.5 * (np.array(curvatures) / CURVATURE_SPREAD) ** 2).sum() * len(widths)
    log_prior = -0.5 * ((edges[:, 1] / SLOPE_SPREAD) ** 2 + (edges[:, 2] / CURVATURE_SPREAD) ** 2)
    log_prior -= np.log(np.sqrt(2 * np.pi) * SLOPE_SPREAD * bent)
    if is_free:
        log_prior -= np.log(2 * EDGE_LIMIT)
    else:
        log_prior -= 0.5 * (edges[:, 0] / EDGE_SPREAD) ** 2 + np.log(np.sqrt(2 * np.pi) * EDGE_SPREAD)
    cell = (position[1] - position[0]) * (slope[1] - slope[0])
    return np.column_stack([edges, log_prior + np.log(cell)])


def threshold(edges: Real, frequency: Real) -> Real:
    """ln(X / X_opt) of each edge, at ln(f / 100 Hz) of shape (..., 1)."""
    return np.asarray(edges[:, 0] + (edges[:, 1] + edges[:, 2] * frequency) * frequency)


def gate_of(edges: Real, places: Places) -> Real:
    """Share of the regime above the edge; (edge, place)."""
    distance = (places.stroke[:, None] - threshold(edges, places.frequency[:, None])) / edges[:, 3]
    return np.asarray(1.0 / (1.0 + np.exp(-np.clip(distance.T, -40.0, 40.0))))


def gated(first: Real, second: Real, below: Real, above: Real) -> Real:
    """Covariance of the gated sum of two independent processes; (edge, first place, second place)."""
    both_below = (1.0 - first)[:, :, None] * (1.0 - second)[:, None, :]
    return np.asarray(both_below * below + first[:, :, None] * second[:, None, :] * above)


def regions(weight: Real, gate: Real) -> Real:
    """How far each place belongs below, at and above the edge; (region, place), sums to 1."""
    share = weight @ gate
    return np.asarray(np.stack([(1.0 - share) ** 2, 2.0 * share * (1.0 - share), share**2]), np.float64)


def probable(edges: Real, log_weight: Real, least: float, most: int | None = None) -> Real:
    """Edges with at least this weight over that of the best, in descending order."""
    order = np.argsort(-log_weight, kind="stable")[:most]
    return np.asarray(edges[order[log_weight[order] > log_weight[order[0]] + np.log(least)]])
