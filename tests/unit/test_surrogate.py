import copy
import sys

import numpy as np
import pytest

from graindamp.errors import InputError
from graindamp.field.schema import check, make_field
from graindamp.field.surrogate import Surrogate
from graindamp.field.surrogate_prior import Form
from graindamp.status import Status
from graindamp.units import STANDARD_GRAVITY

pytest.importorskip("sklearn")

OPTIMUM = 1e-3
CLEARANCE = np.pi * OPTIMUM


def stepped(frequency, intensity, edge=0.6):
    """eta and m' that jump at X = edge X_opt, and change smoothly with Gamma elsewhere."""
    stroke = intensity * STANDARD_GRAVITY / (2 * np.pi * frequency) ** 2 / OPTIMUM
    above = stroke > edge
    return np.where(above, 1.2 / (1 + stroke), 0.4 / (1 + intensity / 3)), np.where(above, 0.8, 1 / (1 + intensity))


@pytest.fixture(scope="module")
def points():
    f, gamma = (axis.ravel() for axis in np.meshgrid(np.geomspace(40, 400, 5), np.geomspace(1, 40, 5), indexing="ij"))
    eta, mass = stepped(f, gamma)
    error = 0.02 * np.maximum(eta, 0.05)
    rng = np.random.default_rng(3)
    return make_field(
        f,
        gamma,
        eta + error * rng.normal(size=25),
        mass + error * rng.normal(size=25),
        0.13,
        source="made up",
        scattered=True,
        variables={"loss_factor_se": error, "effective_mass_ratio_se": error},
    )


@pytest.fixture(scope="module")
def surrogate(points):
    return Surrogate(points, CLEARANCE)


def test_scikit_learn_is_asked_for_by_the_name_of_its_extra(points, monkeypatch):
    monkeypatch.setitem(sys.modules, "sklearn", None)
    with pytest.raises(InputError, match=r'pip install "graindamp\[opt\]"'):
        Surrogate(points, CLEARANCE)


@pytest.mark.parametrize("clearance", [0.0, -1.0, np.nan, np.inf])
def test_a_clearance_is_a_length_or_unknown(points, clearance):
    with pytest.raises(InputError, match="clearance is"):
        Surrogate(points, clearance)


def test_a_few_points_are_too_few(points):
    with pytest.raises(InputError, match="at least 6 usable points, given 5"):
        Surrogate(points.isel(point=slice(5)), CLEARANCE)


def test_places_must_be_above_zero(surrogate):
    for place in ((0.0, 1.0), (100.0, -1.0), (np.nan, 1.0)):
        with pytest.raises(InputError, match="above 0"):
            surrogate.predict(*place)


def test_values_have_the_shape_of_the_question(surrogate):
    assert surrogate.predict(100.0, 5.0).loss_factor.shape == ()
    assert all(value.shape == (4, 3) for value in surrogate.predict(np.full((4, 1), 90.0), [1.0, 2.0, 5.0]))


def test_points_are_met_within_their_errors(surrogate):
    """25 standardised residuals of each quantity: a root mean square of 1 plus 5 of its own errors is 1.7."""
    values = surrogate.predict(surrogate.frequency, surrogate.intensity)
    for k, value in enumerate((values.loss_factor, values.effective_mass_ratio)):
        assert np.sqrt(np.mean(((value - surrogate.values[k]) / surrogate.errors[k]) ** 2)) < 1.7


@pytest.mark.slow
def test_same_points_same_answer_in_any_order(points, surrogate):
    """Sums in another order differ by rounding, which the search for hyperparameters ends with at 1e-5."""
    again = Surrogate(points, CLEARANCE).predict(150.0, [1.5, 7.0, 30.0])
    turned = Surrogate(points.isel(point=slice(None, None, -1)), CLEARANCE).predict(150.0, [1.5, 7.0, 30.0])
    for value, same, other in zip(surrogate.predict(150.0, [1.5, 7.0, 30.0]), again, turned, strict=True):
        np.testing.assert_array_equal(value, same)
        np.testing.assert_allclose(value, other, rtol=0.01, atol=1e-3)


def test_leave_one_out_formula_is_a_real_omission(surrogate):
    """The formula against conditioning on all points but one, with the same edges and hyperparameters; rounding."""
    left = surrogate.leave_one_out()
    for i in (0, 7, 24):
        rest = copy.copy(surrogate)
        keep = np.arange(25) != i
        rest.frequency, rest.intensity = surrogate.frequency[keep], surrogate.intensity[keep]
        rest.values, rest.errors = surrogate.values[:, keep], surrogate.errors[:, keep]
        rest._posterior = rest._conditioned(surrogate._posterior.edges)
        value = rest.predict(surrogate.frequency[i], surrogate.intensity[i])
        assert surrogate.values[0, i] - value.loss_factor == pytest.approx(left.loss_factor_residual[i], abs=1e-4)
        assert surrogate.values[1, i] - value.effective_mass_ratio == pytest.approx(
            left.effective_mass_ratio_residual[i], abs=1e-7
        )
        assert left.effective_mass_ratio_sd[i] >= surrogate.errors[1, i]


def test_hyperparameters_are_at_a_maximum(surrogate):
    """Steps of 0.3 in any logarithm lower the marginal likelihood given the best edge, up to what its spread moves."""
    best = surrogate._posterior.edges[:1]
    for k in (0, 1):
        other = copy.copy(surrogate)
        other._theta = list(surrogate._theta)
        other._theta[k] = surrogate._maximised(k, best[0])
        top, peak = other._evidence(other._log_weights(best)), other._theta[k]
        for j in range(7):
            for step in (-0.3, 0.3):
                other._theta[k] = peak + step * (np.arange(7) == j)
                assert other._evidence(other._log_weights(best)) < top + 1e-3


def test_the_edge_is_found_and_its_gap_is_uncertain(surrogate):
    """Points are a factor 2.5 in Gamma apart: the edge is known to half of that, 0.46 in ln Gamma."""
    f = np.array([50.0, 80.0])
    exact = 0.6 * OPTIMUM * (2 * np.pi * f) ** 2 / STANDARD_GRAVITY
    edge = surrogate.edge(f)
    assert edge.probability > 0.95
    assert np.all(np.abs(np.log(edge.intensity / exact)) < 0.46)
    assert np.all(edge.log_sd < 0.46)
    at_edge, away = surrogate.predict(50.0, exact[0]), surrogate.predict(300.0, 10.0)
    assert at_edge.loss_factor_se > 5 * away.loss_factor_se


@pytest.mark.slow
def test_without_an_edge_there_is_none():
    f, gamma = (axis.ravel() for axis in np.meshgrid(np.geomspace(40, 400, 4), np.geomspace(1, 40, 4), indexing="ij"))
    eta, error = 0.4 / (1 + gamma / 3), np.full(16, 0.004)
    smooth = Surrogate.of_arrays(f, gamma, eta, 1 / (1 + gamma), error, error, clearance=None)
    value = smooth.predict(130.0, 4.0)
    assert abs(value.loss_factor - 0.4 / (1 + 4 / 3)) < 3 * value.loss_factor_se
    if smooth.edge(100.0).probability < 0.5:
        assert np.isnan(smooth.edge(100.0).intensity)


def test_one_process_without_edge_is_possible(points):
    plain = Surrogate(points, CLEARANCE, form=Form(offset=np.inf, has_edge=False, has_stretch=False, smoothness=1.5))
    assert plain.edge(100.0).probability == 0.0
    assert np.isfinite(plain.predict(100.0, 5.0).loss_factor)
    assert np.all(np.isfinite(plain.leave_one_out().log_density))


@pytest.mark.slow
def test_restitution_changes_the_theory(points):
    elastic = Surrogate(points, CLEARANCE, restitution=0.5)
    assert np.all(np.diff(elastic._table[0]) > 0)
    assert np.all(np.isfinite(elastic._table))
    with pytest.raises(InputError, match="restitution"):
        Surrogate(points, CLEARANCE, restitution=1.5)


@pytest.mark.slow
def test_failed_points_and_unknown_errors(points, surrogate):
    """A fatal point is left out, an unknown error counts as 2 % of max(eta, 0.05): that which the others have."""
    spoilt = points.copy(deep=True)
    for name in ("loss_factor_se", "effective_mass_ratio_se"):
        spoilt[name][3] = np.nan
    for name in ("loss_factor", "effective_mass_ratio", "dissipated_energy", "power"):
        spoilt[name][12] = np.nan
    spoilt["status"][12] = int(Status.PARTICLE_LOST)
    rest = Surrogate(spoilt, CLEARANCE)
    assert len(rest.frequency) == 24
    assert rest.errors[1, 3] == pytest.approx(surrogate.errors[1, 3], rel=0.1)  # 0.1: noise of eta itself, 2 %


def test_a_field_comes_out_valid(surrogate):
    field = surrogate.field(np.geomspace(40, 400, 6), np.geomspace(1, 40, 4))
    check(field)
    assert np.all(field["status"] == 0)
    assert np.all(field["loss_factor_se"] > 0)
    assert field.attrs["bed_mass"] == 0.13
    assert "25 points (made up)" in field.attrs["source"]


def test_a_grid_is_as_good_as_points(surrogate):
    grid = surrogate.field(np.geomspace(40, 400, 4), np.geomspace(1, 40, 4))
    assert len(Surrogate(grid, CLEARANCE).frequency) == 16


def test_a_field_ends_where_the_points_end(surrogate):
    axes = np.array([20.0, 100.0]), np.array([2.0, 60.0])
    with pytest.raises(InputError, match=r"20 Hz, intensity 2 is outside the points .*outside = 'mark'"):
        surrogate.field(*axes)
    marked = surrogate.field(*axes, outside="mark")
    np.testing.assert_array_equal(np.isnan(marked["loss_factor"]), [[True, True], [False, True]])
    np.testing.assert_array_equal(marked["status"] == int(Status.NOT_COVERED), np.isnan(marked["loss_factor"]))
    with pytest.raises(InputError, match="outside is 'guess'"):
        surrogate.field(*axes, outside="guess")


def test_joint_covariances_are_those_of_the_prediction(surrogate):
    """On the diagonal what predict says of m', but for inflation; and neighbours vary together."""
    f, gamma = np.array([60.0, 62.0, 300.0]), np.array([9.0, 9.0, 1.5])
    joint, values = surrogate.joint(f, gamma), surrogate.predict(f, gamma)
    variance = np.diagonal(joint.covariance[1])
    share = values.effective_mass_ratio_se**2 / variance
    assert np.all((share >= 0.5 - 1e-9) & (share <= 9.0 + 1e-9))  # limits of the inflation
    for covariance, noise in zip(*joint, strict=True):
        np.testing.assert_allclose(covariance, covariance.T, rtol=1e-6, atol=1e-9)
        correlation = covariance / np.sqrt(np.outer(np.diagonal(covariance), np.diagonal(covariance)))
        assert correlation[0, 1] > 0.8
        assert abs(correlation[0, 2]) < 0.5
        assert np.all(noise > 0)


def test_scatter_of_the_mass_fades_with_intensity(surrogate, points):
    """Far from all points at high Gamma below the edge, m' is presumed to be small, unless fading is switched off."""
    plain = Surrogate(points, CLEARANCE, form=Form(has_fade=False))
    errors = [one.predict(3000.0, 40.0).effective_mass_ratio_se for one in (surrogate, plain)]
    assert errors[0] < errors[1]
