"""Robustness of fields whose share, worst value and steepness are known in closed form."""

import numpy as np
import pytest

from graindamp.errors import InputError
from graindamp.field.ideal import ideal_field
from graindamp.field.robustness import BELOW, N_PLACE, robustness
from graindamp.field.schema import make_field
from graindamp.units import STANDARD_GRAVITY

F, G = np.geomspace(20.0, 200.0, 41), np.geomspace(1.0, 40.0, 61)


def field_of(eta, se=None, f=F, gamma=G, **others):
    eta = np.broadcast_to(eta, (len(f), len(gamma)))
    variables = {} if se is None else {"loss_factor_se": np.broadcast_to(se, eta.shape)}
    return make_field(f, gamma, eta, np.zeros_like(eta), 0.3, source="made", variables=variables, **others)


def test_a_field_alike_everywhere():
    found = robustness(field_of(0.6, 0.0), 0.5)
    assert found.share == (1.0, 0.0)
    assert found.worst.value == pytest.approx(0.6, rel=1e-12)  # interpolation of a constant: rounding
    assert found.worst.error == pytest.approx(0.0, abs=1e-12)
    assert robustness(field_of(0.6), 0.7).share.value == 0.0
    assert np.isnan(robustness(field_of(0.6), 0.5).share.error)
    assert found.covered == pytest.approx(1.0)
    assert np.isnan(found.steepness.value)  # no clearance, no X_opt


def test_share_of_a_field_linear_in_the_logarithm():
    """eta = ln Gamma / ln 40 reaches 0.25 at a quarter of the range."""
    found = robustness(field_of(np.log(G) / np.log(40.0)), 0.25)
    assert found.share.value == pytest.approx(0.75, abs=1.0 / N_PLACE)  # one sample of the border
    assert found.worst.value == pytest.approx(0.0, abs=1e-12)
    upper = robustness(field_of(np.log(G) / np.log(40.0)), 0.25, (30.0, 100.0), (np.sqrt(40.0), 40.0))
    assert upper.share.value == 1.0
    assert upper.worst.value == pytest.approx(0.5, rel=1e-9)


@pytest.mark.parametrize("power", [1.0, 3.0])
def test_steepness_of_a_power_law(power):
    """eta ~ X^p has d ln eta / d ln X = p everywhere; a chord between nodes is off by (p dy)^2 / 12 in the mean."""
    clearance = 3e-3
    optimum = clearance / np.pi
    stroke = G[None, :] * STANDARD_GRAVITY / (2 * np.pi * F[:, None]) ** 2
    found = robustness(field_of(1e2 * (stroke / optimum) ** power), 0.5, clearance=clearance)
    gap = power * np.log(G[1] / G[0])
    assert found.steepness.value == pytest.approx(power, rel=gap**2 / 12 + 0.01)
    assert power <= found.steepest.value <= power * (1 + gap)


def test_the_plastic_bounce_is_steep_only_where_it_ends():
    """Above X_opt the ideal bounce falls slowly; the field from the closed form has no point below 0.84 X_opt."""
    field = ideal_field("bouncing", np.geomspace(40, 120, 21), np.geomspace(3, 40, 25), 0.3, clearance=3e-3)
    found = robustness(field, 0.5, clearance=3e-3)
    assert 0.0 < found.covered < 1.0
    assert 0.0 < found.share.value <= 1.0


def test_errors_of_a_mean_field_follow_from_those_of_its_points():
    """One column of points: worst = the only low node, whose error is its own standard error."""
    eta = np.full((2, 2), 0.8)
    eta[0, 0] = 0.3
    se = np.zeros((2, 2))
    se[0, 0] = 0.02
    field = field_of(eta, se, f=np.array([50.0, 100.0]), gamma=np.array([1.0, 10.0]))
    found = robustness(field, 0.5)
    assert found.worst.value == pytest.approx(0.3, rel=1e-12)
    assert found.worst.error == pytest.approx(0.02, rel=0.22)  # three times 1 / sqrt(2 * 100)
    assert found.worst == robustness(field, 0.5).worst  # the seed is fixed
    # eta = 0.8 - 0.5 (1 - s)(1 - t) >= 0.5 where (1 - s)(1 - t) <= 0.6: share 0.6 (1 - ln 0.6)
    assert found.share.value == pytest.approx(0.6 * (1 - np.log(0.6)), abs=1.0 / N_PLACE)
    assert 0.0 < found.share.error < 0.1


def test_scattered_points_are_taken_too():
    f, gamma = np.meshgrid(F[::8], G[::10])
    field = make_field(
        f.ravel(), gamma.ravel(), np.full(f.size, 0.4), np.zeros(f.size), 0.3, source="made", scattered=True,
        variables={"loss_factor_se": np.full(f.size, 0.01)},
    )  # fmt: skip
    found = robustness(field, 0.3)
    assert found.share.value == pytest.approx(1.0)
    assert found.share.error == 0.0


def test_clearance_comes_from_the_damper():
    stroke = G[None, :] * STANDARD_GRAVITY / (2 * np.pi * F[:, None]) ** 2
    told = robustness(field_of(1e2 * stroke / 1e-3, damper={"clearance": 3e-3}), 0.5)
    given = robustness(field_of(1e2 * stroke / 1e-3), 0.5, clearance=3e-3)
    assert told.steepness == given.steepness
    assert BELOW > 1.0


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({"level": 0.0}, "level is 0"),
        ({"frequency_range": (10.0, 100.0)}, "frequency_range is 10 to 100 Hz"),
        ({"intensity_range": (5.0, 2.0)}, "must ascend"),
    ],
)
def test_what_cannot_be_answered(change, word):
    with pytest.raises(InputError, match=word):
        robustness(field_of(0.5), **({"level": 0.5} | change))
