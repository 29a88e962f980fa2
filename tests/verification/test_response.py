"""Response at fixed force against direct solution of the full matrices, and where it folds."""

import numpy as np
import pytest

from fields_made import constant_field
from graindamp.couple.balance import Attached
from graindamp.couple.equilibrium import solve_mode
from graindamp.couple.response import peaks, respond, response_grid
from graindamp.couple.single_mode import load_mode
from graindamp.errors import InputError
from graindamp.field.interpolate import Interpolant
from graindamp.field.schema import make_field
from graindamp.spec.structure import BeamSpec
from graindamp.structure.beam import assemble
from graindamp.structure.modal import ModalModel, beam_modal_model

POINTS = {"a": 1.5, "b": 0.6, "drive": 0.0}


def beam(n_mode):
    return BeamSpec(
        kind="beam",
        length=1.8,
        bending_stiffness=9930,
        mass_per_length=2.89,
        n_element=6,
        n_mode=n_mode,
        damping={"kind": "rayleigh", "alpha": 2.0, "beta": 1e-6},
    )


def test_two_linear_dampers_equal_the_full_matrices():
    """With every mode kept, modal superposition with two complex masses is the direct solution, to rounding."""
    model_matrices = assemble(beam(1), POINTS)
    n = model_matrices.stiffness.shape[0]
    spec = beam(n - 2)  # two rigid-body modes come in addition
    model = beam_modal_model(spec, POINTS)
    fields = {"a": constant_field(0.6, 0.4, 0.2), "b": constant_field(1.1, -0.3, 0.1)}
    dampers = [Attached(name, name, Interpolant(f), f.attrs["bed_mass"]) for name, f in fields.items()]
    frequency = np.linspace(20.0, 400.0, 37)
    response = respond(model, dampers, "drive", "b", 7.0, frequency)
    k, m = model_matrices.stiffness.toarray(), model_matrices.mass.toarray()
    row = dict(zip(POINTS, model_matrices.deflection, strict=True))
    complex_mass = m.astype(complex)
    complex_mass[row["a"], row["a"]] += 0.2 * (0.4 - 0.6j)
    complex_mass[row["b"], row["b"]] += 0.1 * (-0.3 - 1.1j)
    load = np.zeros(n)
    load[row["drive"]] = 1.0
    for f, mobility in zip(frequency, response.mobility, strict=True):
        omega = 2 * np.pi * f
        dynamic = k * (1 + 1j * omega * 1e-6) + 1j * omega * 2.0 * m - omega**2 * complex_mass
        exact = 1j * omega * np.linalg.solve(dynamic, load)[row["b"]]
        assert mobility == pytest.approx(exact, rel=1e-6)  # Newton's tolerance and rounding of the eigensolution
    assert response.converged.all()
    assert response.residual.max() < 1e-6


def softening_mode():
    """One mode and a damper that weighs less the more it moves: the resonance bends to higher frequencies and folds."""
    omega = 2 * np.pi * np.array([100.0])
    shape = np.array([[0.8], [0.5]])
    model = ModalModel(omega, 2 * 0.002 * omega, shape, np.full_like(shape, np.nan), ("d", "drive"))
    gamma = np.geomspace(0.1, 100, 30)
    mass = 1 / (1 + (gamma / 5) ** 2)
    field = make_field(
        [50.0, 200.0], gamma, np.full((2, 30), 0.02), np.tile(mass, (2, 1)), 0.3, source="made up to fold"
    )
    return model, Attached("d", "d", Interpolant(field, "constant"), 0.3)


def test_up_and_down_differ_where_three_solutions_exist():
    model, damper = softening_mode()
    frequency = np.linspace(85, 105, 801)
    up = respond(model, [damper], "drive", "d", 3.0, frequency, "up")
    down = respond(model, [damper], "drive", "d", 3.0, frequency, "down")
    assert up.converged.all()
    assert down.converged.all()
    assert max(up.residual.max(), down.residual.max()) < 1e-7
    folded = up.n_solution == 3
    assert folded.any()
    differ = np.abs(np.abs(up.mobility) / np.abs(down.mobility) - 1) > 1e-6
    assert differ.any()
    assert (up.n_solution[differ] >= 2).all()  # apart only where there is a choice


def test_peak_agrees_with_the_single_mode():
    """One mode, a field that hardly changes: the curve's peak and half-power damping are those of the equilibrium."""
    omega = 2 * np.pi * np.array([100.0])
    shape = np.array([[0.8], [0.5]])
    model = ModalModel(omega, 0 * omega, shape, np.full_like(shape, np.nan), ("d", "drive"))
    damper = Attached("d", "d", Interpolant(constant_field(0.1, 0.5, 0.2)), 0.2)
    result = solve_mode(load_mode(model, 0, "drive", 3.0, [damper]), 1)
    grid = response_grid((50.0, 150.0), [result])
    (peak,) = peaks(respond(model, [damper], "drive", "d", 3.0, grid))
    state = result.equilibria[0]
    assert peak.frequency == pytest.approx(state.frequency, rel=1e-3)  # spacing of the grid, 0.2 zeta
    assert peak.damping_ratio == pytest.approx(state.damping_ratio, rel=0.02)  # linear between grid points
    assert peak.mobility == pytest.approx(2 * np.pi * state.frequency * state.displacement[0] / 3.0, rel=1e-3)


def test_without_dampers_it_is_the_linear_response():
    model = beam_modal_model(beam(4), POINTS)
    response = respond(model, (), "drive", "a", 1.0, np.array([30.0, 60.0]))
    assert response.converged.all()
    assert np.isfinite(response.mobility).all()


def test_an_undamped_pole_is_no_obstacle():
    """At the bare frequency of an undamped structure the receptance is infinite, the damped response is not."""
    omega = 2 * np.pi * np.array([100.0])
    shape = np.array([[0.8], [0.5]])
    model = ModalModel(omega, 0 * omega, shape, np.full_like(shape, np.nan), ("d", "drive"))
    damper = Attached("d", "d", Interpolant(constant_field(0.1, 0.5, 0.2)), 0.2)
    response = respond(model, [damper], "drive", "d", 3.0, np.array([99.0, 100.0, 101.0]))
    assert response.converged.all()
    middle = np.abs(response.mobility)
    assert middle.min() < middle[1] < middle.max()


@pytest.mark.parametrize(
    ("force", "frequency", "word"), [(0.0, [1.0, 2.0], "above 0"), (1.0, [2.0, 1.0], "ascend"), (1.0, [0.0], "above 0")]
)
def test_bad_calls(force, frequency, word):
    with pytest.raises(InputError, match=word):
        respond(beam_modal_model(beam(2), POINTS), (), "drive", "a", force, np.array(frequency))
