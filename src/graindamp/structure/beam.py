"""Stiffness and mass of a straight beam in one plane: Euler-Bernoulli elements with cubic shape functions.

Each node has two degrees of freedom, its deflection w [m] and its rotation dw/dx [rad]. Shear and rotary inertia of the
cross-section are neglected, so a mode wants several section heights between its nodes.
"""

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array, csc_array

from graindamp.spec.structure import BeamSpec, End, PointMassSpec

SAME_NODE = 2e-5
"""Positions closer than this part of the length share a node [-]. Shifting a point so far changes a squared mode shape
by some 1e-4 at most; a shorter element would cost as much in rounding, for its stiffness grows with h^-3."""

_STIFFNESS = np.array([[12.0, 6, -12, 6], [6, 4, -6, 2], [-12, -6, 12, -6], [6, 2, -6, 4]])
_MASS = np.array([[156.0, 22, 54, -13], [22, 4, 13, -3], [54, 13, 156, -22], [-13, -3, -22, 4]]) / 420
_FIXED: dict[End, tuple[int, ...]] = {"free": (), "pinned": (0,), "clamped": (0, 1)}


class BeamModel(NamedTuple):
    """Matrices of a beam over its free degrees of freedom, and where its points are in them."""

    stiffness: csc_array
    """Stiffness matrix [N/m, N, N m] (free dof, free dof), springs included."""
    mass: csc_array
    """Consistent mass matrix [kg, kg m, kg m^2] (free dof, free dof), point masses included."""
    position: NDArray[np.float64]
    """Positions of the nodes [m] (node,), ascending."""
    free: NDArray[np.intp]
    """Degrees of freedom that are free (free dof,): 2 n is the deflection of node n, 2 n + 1 its rotation."""
    deflection: NDArray[np.intp]
    """Row of each point's deflection in the matrices (point,), -1 where the support holds it."""
    rotation: NDArray[np.intp]
    """Row of each point's rotation in the matrices (point,), -1 where the support holds it."""


def assemble(spec: BeamSpec, points: Mapping[str, float], extra_masses: Sequence[PointMassSpec] = ()) -> BeamModel:
    """Matrices of the beam with a node at every mass, spring and point.

    Args:
        spec: the beam.
        points: position of each named point [m], 0 to the length.
        extra_masses: bodies fixed to the beam besides those of `spec`, such as damper containers.

    Raises:
        InputError: a point or an extra mass lies off the beam.

    Source: Przemieniecki (1968), Theory of Matrix Structural Analysis, chapters 5 and 11 (without shear).
    """
    for name, place in points.items():
        spec.check_position(f"point '{name}'", place)
    for extra in extra_masses:
        spec.check_position(f"extra mass '{extra.name}'", extra.position)
    masses = (*spec.masses, *extra_masses)
    special = [*(m.position for m in masses), *(s.position for s in spec.springs), *points.values()]
    position = node_positions(spec.length, spec.n_element, special)
    stiffness, mass = _element_matrices(np.diff(position), spec.flexural_rigidity, spec.linear_density)

    def node_at(places: Sequence[float]) -> NDArray[np.intp]:
        return np.asarray(abs(position - np.asarray(places, dtype=float)[:, None]).argmin(axis=1))

    at_mass, at_spring = node_at([m.position for m in masses]), node_at([s.position for s in spec.springs])
    n_dof = 2 * position.size
    mass = mass + _at_nodes(at_mass, [m.mass for m in masses], [m.rotary_inertia for m in masses], n_dof)
    stiffness = stiffness + _at_nodes(
        at_spring, [s.stiffness for s in spec.springs], [s.torsion_stiffness for s in spec.springs], n_dof
    )
    first, last = spec.ends
    held = [*_FIXED[first], *(n_dof - 2 + dof for dof in _FIXED[last])]
    free = np.setdiff1d(np.arange(n_dof), held)
    row = np.full(n_dof, -1, dtype=np.intp)
    row[free] = np.arange(free.size)
    at_point = node_at(list(points.values()))
    return BeamModel(
        csc_array(stiffness[free][:, free]),
        csc_array(mass[free][:, free]),
        position,
        free,
        row[2 * at_point],
        row[2 * at_point + 1],
    )


def node_positions(length: float, n_element: int, special: Sequence[float] = ()) -> NDArray[np.float64]:
    """Positions of the nodes [m] (node,): every special position is one, no element exceeds length / n_element.

    Between special positions the elements are equal; without any there are exactly `n_element`. Special positions
    within :data:`SAME_NODE` of the length of each other, or of an end, share a node.

    Args:
        length: length of the beam [m].
        n_element: least number of elements.
        special: positions that need a node [m], in any order.
    """
    breaks = [0.0]
    for place in sorted(special):
        if place - breaks[-1] > SAME_NODE * length and length - place > SAME_NODE * length:
            breaks.append(place)
    breaks.append(length)
    pieces = [
        np.linspace(start, stop, max(1, int(np.ceil((stop - start) / length * n_element - 1e-6))), endpoint=False)
        for start, stop in pairwise(breaks)
    ]
    return np.concatenate([*pieces, [length]])


def _element_matrices(size: NDArray[np.float64], rigidity: float, density: float) -> tuple[csc_array, csc_array]:
    """Stiffness and mass of all elements, each `size` long [m] (element,), over all degrees of freedom."""
    scale = np.stack([np.ones_like(size), size, np.ones_like(size), size], axis=1)  # a rotation counts as w / size
    outer = scale[:, :, None] * scale[:, None, :]
    stiffness = (rigidity / size**3)[:, None, None] * outer * _STIFFNESS
    mass = (density * size)[:, None, None] * outer * _MASS
    dof = 2 * np.arange(size.size)[:, None] + np.arange(4)
    row, column = (index.ravel() for index in np.broadcast_arrays(dof[:, :, None], dof[:, None, :]))
    shape = (2 * size.size + 2, 2 * size.size + 2)
    return (
        coo_array((stiffness.ravel(), (row, column)), shape=shape).tocsc(),
        coo_array((mass.ravel(), (row, column)), shape=shape).tocsc(),
    )


def _at_nodes(
    node: NDArray[np.intp], of_deflection: Sequence[float], of_rotation: Sequence[float], n_dof: int
) -> csc_array:
    """Diagonal matrix with the given values at deflection and rotation of the nodes; repeated nodes add up."""
    dof = np.concatenate([2 * node, 2 * node + 1])
    return coo_array(([*of_deflection, *of_rotation], (dof, dof)), shape=(n_dof, n_dof)).tocsc()
