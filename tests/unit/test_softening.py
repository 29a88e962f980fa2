import numpy as np
import pytest
from numpy.testing import assert_allclose

from field_made import field_document
from graindamp.campaign.softening import SofteningStudy, evaluate, extrapolate, softened, study_tasks
from graindamp.spec.field import FieldSpec

FACTORS = np.array([1.0, 10.0, 100.0])


def test_a_straight_line_in_time_of_contact_is_found_exactly():
    value = 0.8 + 0.03 * (FACTORS**0.4 - 1.0)
    fit = extrapolate(FACTORS, value, np.full(3, 0.01), chosen=30.0, power=0.4)
    assert_allclose(fit.described, 0.8, rtol=1e-12)
    assert_allclose(fit.error, 0.03 * (30.0**0.4 - 1.0), rtol=1e-12)
    assert_allclose(fit.scatter, 0.0, atol=1e-9)


def test_errors_of_the_line_are_those_that_repeats_show():
    """The scatter of 2000 repeats is known to 1.6 %, three times that is allowed."""
    rng = np.random.default_rng(3)
    factors = np.array([1.0, 3.0, 10.0, 30.0, 100.0])
    sigma = np.array([0.01, 0.02, 0.01, 0.02, 0.03])
    fits = [
        extrapolate(factors, 0.5 + 0.02 * factors**0.4 + sigma * rng.normal(size=5), sigma, 100.0, 0.4)
        for _ in range(2000)
    ]
    narrow = [fit for fit in fits if fit.scatter <= 1.0]  # errors not widened by chance
    assert_allclose(np.std([fit.described for fit in fits]), narrow[0].described_se, rtol=0.05)
    assert_allclose(np.std([fit.error for fit in fits]), narrow[0].error_se, rtol=0.05)


def test_points_off_the_line_widen_its_errors():
    bent = np.array([0.5, 0.7, 0.5])
    fit = extrapolate(FACTORS, bent, np.full(3, 0.01), 100.0, 0.4)
    straight = extrapolate(FACTORS, np.full(3, 0.5), np.full(3, 0.01), 100.0, 0.4)
    assert fit.scatter > 5.0
    assert_allclose(fit.described_se / straight.described_se, fit.scatter, rtol=1e-12)


def test_failed_points_are_left_out():
    value = np.array([0.5, np.nan, 0.6])
    fit = extrapolate(FACTORS, value, np.array([0.01, np.nan, 0.01]), 100.0, 0.4)
    assert_allclose(fit.error, 0.1, rtol=1e-9)
    assert np.isnan(fit.scatter)
    with pytest.raises(ValueError, match="two softenings"):
        extrapolate(FACTORS, np.array([0.5, np.nan, np.nan]), np.full(3, 0.01), 100.0, 0.4)


def study_spec():
    document = field_document() | {"seeds": 2}
    document["softening_study"] = {"points": [["100 Hz", 20], [500, 3]], "factors": [1, 10, 100]}
    document["damper"]["contact"]["softening"] = 100
    return FieldSpec.model_validate(document)


def test_a_study_runs_every_point_at_every_softening_with_every_bed():
    spec = study_spec()
    tasks = study_tasks(spec)
    assert [len(row) for row in tasks] == [6, 6]
    assert [task.simulation.damper.contact.softening for task in tasks[0]] == [1, 1, 10, 10, 100, 100]
    assert [task.seed for task in tasks[0]] == [0, 1] * 3
    # The softening of the field itself needs no runs of its own.
    assert tasks[0][4].key == study_tasks(softened(spec, 100))[0][4].key


class Made:
    """A result with just what a study reads."""

    def __init__(self, task):
        s = task.simulation.damper.contact.softening**0.4 - 1.0
        self.loss_factor = 0.5 + 0.01 * s + 0.001 * (2 * task.seed - 1)
        self.effective_mass_ratio = 0.1 - 0.02 * s
        self.loss_factor_se = self.effective_mass_ratio_se = 1e-4


def test_a_study_gives_the_error_of_the_chosen_softening_and_survives_storage():
    study = evaluate(study_spec(), Made)
    way = 100**0.4 - 1.0
    one = study.points[0]
    assert_allclose([one.loss_factor.described, one.loss_factor.error], [0.5, 0.01 * way], rtol=1e-9)
    assert_allclose(one.loss_factor.standard_error, 0.001, rtol=1e-9)  # the beds scatter more than their cycles
    assert_allclose(study.relative_errors, 0.02 * way / 0.5, rtol=1e-9)
    again = SofteningStudy.load(study.dump())
    assert again.dump() == study.dump()
    assert_allclose(again.points[1].effective_mass_ratio.value, study.points[1].effective_mass_ratio.value)
