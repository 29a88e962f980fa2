"""Natural modes of sparse symmetric matrices: K v = omega^2 M v."""

from typing import Any, NamedTuple

import numpy as np
import scipy.linalg
from numpy.typing import NDArray
from scipy.sparse import csc_array
from scipy.sparse.linalg import ArpackError, LinearOperator, eigsh, splu

from graindamp.errors import InputError

ROUNDING = float(np.finfo(float).eps)
"""Relative rounding error of a float64 [-]."""

RIGID_ENERGY = 10.0
"""A mode is rigid when its strain energy is below this multiple of what errors in the stiffness amount to [-]. Measured
on free beams of 3 to 2000 elements: rigid-body modes stay below 0.3, elastic ones above 1000; on a stiffness matrix
from a file with 14 digits, at a precision of 1e-14: below 0.5 and above 1e6."""

LANCZOS_TOLERANCE = 1e-10
"""Residual of the iteration, relative to the eigenvalue theta [-]. Frequencies err by its square, shapes by itself over
the relative gap; asking for full precision takes a fifth longer and changed neither."""

_Eigenpairs = tuple[NDArray[np.float64], NDArray[np.float64]]


class Modes(NamedTuple):
    """Rigid-body modes and the lowest elastic modes of a structure."""

    omega: NDArray[np.float64]
    """Natural angular frequencies [rad/s] (mode,), ascending; exactly 0 for rigid-body modes."""
    vectors: NDArray[np.float64]
    """Mass-normalised mode shapes (dof, mode); the largest component of each is positive."""
    n_rigid: int
    """Number of rigid-body modes, which come first."""
    residual: NDArray[np.float64]
    """Largest component of K v - omega^2 M v against that of |K| |v| + omega^2 |M| |v| [-] (mode,)."""


def solve_modes(stiffness: Any, mass: Any, n_mode: int, *, precision: float = 1e-14, n_dense: int = 400) -> Modes:
    """Rigid-body modes and the `n_mode` lowest elastic modes of an undamped structure.

    Solves M v = theta (K + s M) v for the largest theta = 1 / (omega^2 + s). The small positive shift s makes K + s M
    definite for free structures; M may be singular, and the low modes keep their digits however stiff the highest are.
    A mode is rigid when errors in K can explain its strain energy, see :data:`RIGID_ENERGY`.
    The choice of start vector, basis of the rigid-body modes and signs is fixed, so equal matrices give equal modes.

    Args:
        stiffness: symmetric, positive semidefinite matrix K (dof, dof), sparse or dense.
        mass: symmetric, positive semidefinite matrix M (dof, dof), sparse or dense.
        n_mode: number of elastic modes; rigid-body modes come in addition.
        precision: relative error of the entries of K [-], which tells rigid-body modes from those of a very soft
            support. The default suits files of finite element programs; a matrix just assembled has 2e-16.
        n_dense: matrices up to this size are solved densely, larger ones by Lanczos iteration on one sparse factor.

    Raises:
        InputError: sizes differ, entries are not finite, a matrix is not symmetric or not positive semidefinite (by
            Lanczos iteration noticed only if diagonals or low modes show it), more modes are asked for than there are,
            or the matrices are scaled too badly to be solved.

    Source: Ericsson & Ruhe (1980), Mathematics of Computation 35, 1251-1268 (spectral transformation).
    """
    stiffness, mass = _checked("stiffness", stiffness), _checked("mass", mass)
    if stiffness.shape != mass.shape:
        raise InputError(f"stiffness has {stiffness.shape[0]} rows, mass {mass.shape[0]}; they must be of one size")
    if n_mode < 1:
        raise InputError(f"n_mode is {n_mode}; ask for at least one elastic mode")
    shift = _first_shift(stiffness, mass)
    eigenvalue, vector, n_rigid = _lowest(stiffness, mass, n_mode, shift, precision, n_dense)
    if not 1e-3 < shift / eigenvalue[n_rigid] < 1e2:  # beyond, digits are lost or the iteration crawls
        shift = 0.1 * eigenvalue[n_rigid]
        eigenvalue, vector, n_rigid = _lowest(stiffness, mass, n_mode, shift, precision, n_dense)
    eigenvalue[:n_rigid] = 0.0
    residual = _verified(stiffness, mass, eigenvalue, vector, shift)
    vector[:, :n_rigid] = _settled_basis(vector[:, :n_rigid])
    return Modes(np.sqrt(eigenvalue), vector * _sign(vector), n_rigid, residual)


def _checked(name: str, matrix: Any) -> csc_array:
    """The matrix in compressed columns, known to be square, finite and symmetric with no negative diagonal."""
    sparse = csc_array(matrix, dtype=float)
    if sparse.ndim != 2 or sparse.shape[0] != sparse.shape[1] or sparse.shape[0] == 0:
        raise InputError(f"{name} has shape {sparse.shape}; a square matrix with at least one row is needed")
    if not np.isfinite(sparse.data).all():
        raise InputError(f"{name} has entries that are not finite")
    skew = abs(sparse - sparse.T).max()
    if skew > 1e-9 * abs(sparse).max():
        raise InputError(
            f"{name} is not symmetric: an entry and its mirror image differ by {skew:.3g}; "
            "if the file holds one triangle only, mirror it"
        )
    if (sparse.diagonal() < 0).any():
        raise InputError(f"{name} is not positive semidefinite: a diagonal entry is {sparse.diagonal().min():.3g}")
    return sparse


def _first_shift(stiffness: csc_array, mass: csc_array) -> float:
    """A shift [1/s^2] that lies, for most structures, within some orders of the lowest elastic eigenvalue."""
    massive = mass.diagonal() > 0
    if not massive.any():
        raise InputError("mass is zero on the whole diagonal; a structure needs mass")
    scale = float(np.median(stiffness.diagonal()[massive] / mass.diagonal()[massive]))
    return 1e-10 * scale if scale > 0 else 1.0


def _lowest(
    stiffness: csc_array, mass: csc_array, n_mode: int, shift: float, precision: float, n_dense: int
) -> tuple[NDArray[np.float64], NDArray[np.float64], int]:
    """All rigid and the `n_mode` lowest elastic eigenpairs, ascending, and how many are rigid."""
    n_dof, n_asked = stiffness.shape[0], n_mode + 6
    while True:
        n_asked = min(n_asked, n_dof)
        solve = _dense if n_dof <= max(n_dense, 3 * n_asked) else _sparse
        eigenvalue, vector = solve(stiffness, mass, n_asked, shift)
        n_rigid = _count_rigid(stiffness, vector, precision)
        if eigenvalue.size >= n_rigid + n_mode:
            return eigenvalue[: n_rigid + n_mode], vector[:, : n_rigid + n_mode], n_rigid
        if eigenvalue.size < n_asked or n_asked == n_dof:
            raise InputError(
                f"{n_mode} elastic modes are asked for, but the structure has only {eigenvalue.size - n_rigid} "
                f"(and {n_rigid} rigid-body modes); ask for fewer or refine the model"
            )
        n_asked *= 2


def _dense(stiffness: csc_array, mass: csc_array, n_asked: int, shift: float) -> _Eigenpairs:
    n_dof = stiffness.shape[0]
    dense_mass = mass.toarray()
    try:
        theta, vector = scipy.linalg.eigh(
            dense_mass, stiffness.toarray() + shift * dense_mass, subset_by_index=[n_dof - n_asked, n_dof - 1]
        )
    except np.linalg.LinAlgError:
        raise InputError(
            "stiffness is not positive semidefinite, or a degree of freedom has neither stiffness nor mass"
        ) from None
    least = n_dof * ROUNDING * theta[-1]  # below it theta is that of a massless mode, of infinite frequency
    if theta[0] < -least:
        raise InputError("mass is not positive semidefinite: a motion has negative kinetic energy")
    keep = np.flatnonzero(theta > least)[::-1]
    return 1 / theta[keep] - shift, vector[:, keep] / np.sqrt(theta[keep])


def _sparse(stiffness: csc_array, mass: csc_array, n_asked: int, shift: float) -> _Eigenpairs:
    n_dof = stiffness.shape[0]
    try:
        # The default column ordering ignores symmetry and takes about twice the time and fill.
        factor = splu(
            csc_array(stiffness + shift * mass),
            permc_spec="MMD_AT_PLUS_A",
            diag_pivot_thresh=0.0,
            options={"SymmetricMode": True},
        )
        inverse = LinearOperator((n_dof, n_dof), matvec=factor.solve, dtype=float)
        start = np.random.default_rng(0).standard_normal(n_dof)
        eigenvalue, vector = eigsh(
            stiffness, n_asked, mass, sigma=-shift, OPinv=inverse, v0=start, tol=LANCZOS_TOLERANCE
        )
    except (RuntimeError, ArpackError) as error:
        raise InputError(
            f"the modes cannot be solved ({error}); a degree of freedom may have neither stiffness nor mass, "
            "or a matrix may not be positive semidefinite"
        ) from None
    theta = 1 / (eigenvalue + shift)
    keep = np.argsort(eigenvalue)
    keep = keep[np.abs(theta[keep]) > n_dof * ROUNDING * np.abs(theta).max()]
    return eigenvalue[keep], vector[:, keep]


def _count_rigid(stiffness: csc_array, vector: NDArray[np.float64], precision: float) -> int:
    """Number of leading modes without strain energy beyond what errors in the stiffness amount to."""
    energy = np.einsum("ij,ij->j", vector, stiffness @ vector)
    error = precision * np.einsum("ij,ij->j", abs(vector), abs(stiffness) @ abs(vector))
    if (energy < -RIGID_ENERGY * error).any():
        raise InputError("stiffness is not positive semidefinite: a motion has negative strain energy")
    return int(np.argmin(np.append(energy <= RIGID_ENERGY * error, False)))


def _verified(
    stiffness: csc_array, mass: csc_array, eigenvalue: NDArray[np.float64], vector: NDArray[np.float64], shift: float
) -> NDArray[np.float64]:
    """Residual of each mode [-]; complains where it, or the orthogonality of the modes, is far above rounding."""
    inertia = mass @ vector
    size = (abs(stiffness) @ abs(vector) + eigenvalue * (abs(mass) @ abs(vector))).max(axis=0)
    residual = np.asarray(abs(stiffness @ vector - eigenvalue * inertia).max(axis=0) / size)
    skewness = abs(vector.T @ inertia - np.eye(eigenvalue.size)).max()
    # Vectors come orthonormal in K + s M, so in M they lose what the spread of theta costs.
    allowed = 1e-8 + 1e2 * ROUNDING * (eigenvalue[-1] + shift) / shift
    if residual.max() > 1e-8 or not skewness <= allowed:
        raise InputError(
            f"the modes are not accurate (residual {residual.max():.1e}, orthogonality {skewness:.1e}); "
            "the matrices may be scaled too badly or not be positive semidefinite"
        )
    return residual


def _settled_basis(rigid: NDArray[np.float64]) -> NDArray[np.float64]:
    """The basis of the rigid-body modes that does not hang on rounding: orthogonal under a fixed weight of the rows."""
    weight = np.arange(1, rigid.shape[0] + 1) / rigid.shape[0]
    return np.asarray(rigid @ np.linalg.eigh(rigid.T @ (weight[:, None] * rigid))[1])


def _sign(vector: NDArray[np.float64]) -> NDArray[np.float64]:
    """+1 or -1 for each mode, so that its largest component becomes positive; the first one of equals decides."""
    size = abs(vector)
    decisive = np.argmax(size >= (1 - 1e-6) * size.max(axis=0), axis=0)
    return np.asarray(np.sign(vector[decisive, np.arange(vector.shape[1])]))
