import numpy as np
import pytest
import scipy.linalg
from scipy.sparse import block_diag, csc_array, diags_array, tril

from graindamp.errors import InputError
from graindamp.spec.structure import BeamSpec
from graindamp.structure.beam import assemble
from graindamp.structure.eigen import solve_modes


def chain(n, grounded=True):
    """`n` unit masses joined by unit springs; omega_k = 2 sin(k pi / 2 / (n + 1)) when both ends are grounded."""
    stiffness = diags_array([-np.ones(n - 1), np.full(n, 2.0), -np.ones(n - 1)], offsets=[-1, 0, 1]).tolil()
    if not grounded:
        stiffness[0, 0] = stiffness[n - 1, n - 1] = 1.0
    return csc_array(stiffness), csc_array(diags_array([np.ones(n)], offsets=[0]))


def free_beam(n_element):
    return assemble(BeamSpec(length=1, bending_stiffness=1, mass_per_length=1, n_element=n_element), {})


@pytest.mark.parametrize("n_dense", [400, 0], ids=["dense", "sparse"])
def test_grounded_chain_matches_closed_form(n_dense):
    modes = solve_modes(*chain(120), 5, n_dense=n_dense)
    exact = 2 * np.sin(np.arange(1, 6) * np.pi / 2 / 121)
    assert modes.n_rigid == 0
    assert modes.omega == pytest.approx(exact, rel=1e-11)  # rounding of omega^2 against the largest, 4
    shape = np.sqrt(2 / 121) * np.sin(np.outer(np.arange(1, 121), np.arange(1, 6)) * np.pi / 121)
    assert abs(modes.vectors) == pytest.approx(abs(shape), abs=1e-9)  # as above, over the gap between modes


@pytest.mark.parametrize("n_dense", [400, 0], ids=["dense", "sparse"])
def test_free_chain_keeps_its_rigid_mode(n_dense):
    modes = solve_modes(*chain(120, grounded=False), 3, n_dense=n_dense)
    assert modes.n_rigid == 1
    assert modes.omega[0] == 0
    assert modes.omega[1:] == pytest.approx(2 * np.sin(np.arange(1, 4) * np.pi / 240), rel=1e-10)  # rounding
    assert modes.vectors[:, 0] == pytest.approx(1 / np.sqrt(120), rel=1e-9)  # rounding over the gap


def test_dense_and_sparse_agree_on_a_free_beam():
    beam = free_beam(90)
    dense, sparse = (solve_modes(beam.stiffness, beam.mass, 4, n_dense=n) for n in (400, 0))
    assert dense.n_rigid == sparse.n_rigid == 2
    # 1e-7: rounding of 12 EI / h^3 against omega^2 = 500, 4e-12, times the elements it may add up over
    assert sparse.omega == pytest.approx(dense.omega, rel=1e-7)
    assert sparse.vectors == pytest.approx(dense.vectors, abs=1e-5 * abs(dense.vectors).max())


def test_rigid_modes_of_several_bodies_are_all_found():
    """Five free beams have ten rigid-body modes, more than a single body in space."""
    beam = free_beam(12)
    stiffness, mass = (block_diag([matrix] * 5, format="csc") for matrix in (beam.stiffness, beam.mass))
    modes = solve_modes(stiffness, mass, 5)
    assert modes.n_rigid == 10
    assert modes.omega[10:] == pytest.approx(4.730040744862704**2, rel=1e-4)  # (beta h)^4 / 1440 = 2e-5 of 12 elements


@pytest.mark.parametrize("scale", [1e-12, 1e12])
def test_units_do_not_matter(scale):
    beam = free_beam(20)
    modes = solve_modes(scale * beam.stiffness, beam.mass, 3)
    plain = solve_modes(beam.stiffness, beam.mass, 3)
    assert modes.n_rigid == 2
    assert modes.omega == pytest.approx(np.sqrt(scale) * plain.omega, rel=1e-8)  # rounding, see above


def test_soft_suspension_is_not_taken_for_a_rigid_mode():
    beam = assemble(
        BeamSpec(
            length=1.8,
            bending_stiffness=9930,
            mass_per_length=2.89,
            springs=[{"position": 0.4, "stiffness": 10}, {"position": 1.4, "stiffness": 10}],
        ),
        {},
    )
    modes = solve_modes(beam.stiffness, beam.mass, 3, precision=2e-16)
    assert modes.n_rigid == 0
    pitch = np.sqrt(20 * 0.5**2 / (2.89 * 1.8**3 / 12))
    bounce = np.sqrt(20 / (2.89 * 1.8))
    assert modes.omega[:2] == pytest.approx([pitch, bounce], rel=1e-4)  # the bending it excites, (0.3 / 50 Hz)^2


def test_rigid_modes_survive_the_digits_of_a_file():
    """A file with 14 digits leaves rigid motions a strain energy, positive or negative, that is no stiffness."""
    beam = free_beam(90)
    lower = tril(beam.stiffness, format="csc")
    lower.data *= 1 + 5e-15 * np.random.default_rng(3).uniform(-1, 1, lower.nnz)
    modes = solve_modes(lower + tril(lower, -1, format="csc").T, beam.mass, 3)
    assert modes.n_rigid == 2
    assert modes.omega[2] == pytest.approx(4.730040744862704**2, rel=1e-6)  # 5e-15 of 12 EI / h^3, and the mesh


@pytest.mark.parametrize("n_dense", [400, 0], ids=["dense", "sparse"])
def test_singular_mass(n_dense):
    """Massless degrees of freedom between masses act as springs in series: a chain of half the stiffness."""
    stiffness, _ = chain(241)
    mass = np.zeros(241)
    mass[1::2] = 1.0
    modes = solve_modes(stiffness, np.diag(mass), 4, n_dense=n_dense)
    exact = np.sqrt(0.5) * 2 * np.sin(np.arange(1, 5) * np.pi / 2 / 121)
    assert modes.omega == pytest.approx(exact, rel=1e-10)  # rounding


def test_all_modes_of_a_small_system():
    stiffness, mass = chain(3)
    modes = solve_modes(stiffness, mass, 3)
    assert modes.omega**2 == pytest.approx([2 - np.sqrt(2), 2, 2 + np.sqrt(2)], rel=1e-12)  # rounding


def test_vectors_are_mass_normalised_orthogonal_and_verified():
    beam = free_beam(30)
    modes = solve_modes(beam.stiffness, beam.mass, 6)
    gram = modes.vectors.T @ beam.mass @ modes.vectors
    assert gram == pytest.approx(np.eye(8), abs=1e-8)  # rounding times the spread of omega^2 up to mode 6
    assert modes.residual.max() < 1e-10  # rounding
    direct = scipy.linalg.eigh(beam.stiffness.toarray(), beam.mass.toarray(), eigvals_only=True)
    assert modes.omega[2:] ** 2 == pytest.approx(direct[2:8], rel=1e-5)  # the direct solver loses digits to the highest


def test_same_matrices_give_same_modes_and_signs():
    beam = free_beam(250)
    first, second = (solve_modes(beam.stiffness, beam.mass, 4) for _ in range(2))
    assert (first.vectors == second.vectors).all()
    decisive = np.where(abs(first.vectors) >= (1 - 1e-6) * abs(first.vectors).max(axis=0), first.vectors, np.nan)
    assert all(column[~np.isnan(column)][0] > 0 for column in decisive.T)


def test_basis_of_rigid_modes_does_not_depend_on_the_method():
    beam = free_beam(60)
    dense, sparse = (solve_modes(beam.stiffness, beam.mass, 2, n_dense=n).vectors[:, :2] for n in (400, 0))
    assert sparse == pytest.approx(dense, abs=1e-6)  # rounding over the gap to the elastic modes


ONE = csc_array(np.eye(3))


@pytest.mark.parametrize(
    ("stiffness", "mass", "n_mode", "message"),
    [
        (np.array([[2.0, -1, 0], [0, 2, -1], [0, -1, 2]]), ONE, 1, "stiffness is not symmetric.*mirror it"),
        (ONE, np.triu(np.full((3, 3), 0.1)) + np.eye(3), 1, "mass is not symmetric"),
        (np.ones((3, 2)), ONE, 1, r"stiffness has shape \(3, 2\); a square matrix"),
        (np.eye(4), ONE, 1, "stiffness has 4 rows, mass 3"),
        (np.diag([1.0, np.nan, 1.0]), ONE, 1, "stiffness has entries that are not finite"),
        (ONE, np.diag([1.0, -1.0, 1.0]), 1, "mass is not positive semidefinite: a diagonal entry is -1"),
        (ONE, np.zeros((3, 3)), 1, "mass is zero"),
        (ONE, np.array([[1.0, 2, 0], [2, 1, 0], [0, 0, 1]]), 1, "mass is not positive semidefinite: a motion"),
        (np.array([[1.0, 2, 0], [2, 1, 0], [0, 0, 1]]), ONE, 1, "stiffness is not positive semidefinite"),
        (np.diag([1.0, 1.0, 0.0]), np.diag([1.0, 1.0, 0.0]), 1, "neither stiffness nor mass"),
        (ONE, ONE, 0, "n_mode is 0"),
        (ONE, ONE, 4, "4 elastic modes are asked for, but the structure has only 3"),
        (ONE, np.diag([1.0, 0.0, 0.0]), 2, "2 elastic modes are asked for, but the structure has only 1"),
        (np.zeros((3, 3)), ONE, 1, r"only 0 \(and 3 rigid-body modes\)"),
    ],
)
def test_bad_input_is_explained(stiffness, mass, n_mode, message):
    with pytest.raises(InputError, match=message):
        solve_modes(stiffness, mass, n_mode)


def test_bad_sparse_input_is_explained():
    stiffness, mass = chain(100)
    with pytest.raises(InputError, match="stiffness is not positive semidefinite"):
        solve_modes(stiffness - 2e-3 * mass, mass, 2, n_dense=0)
    hollow_stiffness, hollow_mass = stiffness.tolil(), mass.tolil()
    hollow_stiffness[50, :] = hollow_stiffness[:, 50] = 0
    hollow_mass[50, 50] = 0
    with pytest.raises(InputError, match="neither stiffness nor mass"):
        solve_modes(hollow_stiffness.tocsc(), hollow_mass.tocsc(), 2, n_dense=0)
