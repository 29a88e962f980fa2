import numpy as np
import pytest
from numpy.testing import assert_allclose

from field_made import field_document
from fields_made import random_field
from graindamp.campaign.softening import evaluate, extrapolate, softened, study_tasks
from graindamp.errors import InputError
from graindamp.field.remarks import remarks_on
from graindamp.field.softening import SofteningStudy, StudiedPoint, study_of
from graindamp.field.store import read_field, write_field
from graindamp.report.study_tables import softening_table
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


def line(value, error=0.001, chosen=100.0):
    return extrapolate(FACTORS, np.array(value), np.full(3, error), chosen, 0.4)


def field_with(points=None, softening=100.0):
    """A field from 20 to 200 Hz and 0.5 to 50 g, softened, with a study of points (f, intensity, eta at FACTORS)."""
    field = random_field(1)
    field.attrs["softening"] = softening
    if points is not None:
        still = line([0.2, 0.2, 0.2])
        studied = tuple(StudiedPoint(f, gamma, line(eta), still) for f, gamma, eta in points)
        field.attrs["softening_study"] = SofteningStudy(softening, FACTORS, 0.4, studied, 0.05).dump()
    return field


STRAIGHT = 0.5 + 0.02 * (FACTORS**0.4 - 1.0)
CORNER = (150.0, 0.8, [0.3, 0.3, 0.3])


def test_a_line_that_does_not_fit_is_no_error_estimate():
    """A bounce that a softened bed loses: the line through 1.0, 0.1, 0.1 would tell of an error near 0."""
    study = study_of(field_with([(100.0, 40.0, [1.0, 0.1, 0.12]), (100.0, 20.0, STRAIGHT), CORNER]))
    assert study.are_straight == (False, True, True)
    assert_allclose(study.relative_errors, [0.9, (STRAIGHT[2] - 0.5) / 0.5, 0.0], atol=1e-9)


def test_small_misfits_do_not_count_however_small_the_errors_are():
    study = study_of(field_with([(100.0, 20.0, STRAIGHT + np.array([0.0, 0.01, 0.0]))]))
    assert study.points[0].loss_factor.scatter > 3
    assert study.are_straight == (True,)


def test_errors_of_zero_do_not_make_a_line_fit():
    study = SofteningStudy(
        100.0, FACTORS, 0.4, (StudiedPoint(100.0, 40.0, line([1.0, 0.1, 0.12], 0.0), line([0.2] * 3, 0.0)),), 0.05
    )
    assert study.are_straight == (False,)


def test_a_vague_value_far_off_the_line_counts():
    """Where some cycles of a run bounced and others did not, the error is large, and the difference much larger."""
    fit = extrapolate(FACTORS, np.array([0.982, 0.119, 0.131]), np.array([0.14, 0.002, 0.002]), 10.0, 0.4)
    study = SofteningStudy(10.0, FACTORS, 0.4, (StudiedPoint(100.0, 40.0, fit, line([0.2] * 3, chosen=10.0)),), 0.05)
    assert study.are_straight == (False,)


def test_one_vague_value_does_not_spoil_a_line():
    factors = np.array([1.0, 10.0, 100.0, 1000.0])
    fit = extrapolate(factors, np.array([0.5, 0.506, 0.5, 0.52]), np.array([1e-3, 1e-3, 1e-3, 0.3]), 100.0, 0.4)
    study = SofteningStudy(100.0, factors, 0.4, (StudiedPoint(100.0, 20.0, fit, fit),), 0.05)
    assert fit.scatter > 3
    assert study.are_straight == (True,)


def test_resonances_of_linear_springs_fall_faster():
    field = field_with([(100.0, 20.0, STRAIGHT)])
    study = study_of(field)._replace(power=0.5)
    field.attrs["softening_study"] = study.dump()
    assert any("lowers the resonance of a packed bed by 10 times" in remark for remark in remarks_on(field))


def test_points_without_values_are_left_out():
    class Lost(Made):
        def __init__(self, task):
            super().__init__(task)
            if task.frequency == 500 and task.simulation.damper.contact.softening > 1:
                self.loss_factor = self.effective_mass_ratio = np.nan

    study = evaluate(study_spec(), Lost)
    assert [(one.frequency, one.intensity) for one in study.points] == [(100, 20)]


def test_two_softenings_cannot_tell_of_a_line():
    with_gap = extrapolate(FACTORS, np.array([0.5, np.nan, 0.6]), np.full(3, 0.01), 100.0, 0.4)
    study = SofteningStudy(100.0, FACTORS, 0.4, (StudiedPoint(100.0, 20.0, with_gap, with_gap),), 0.05)
    assert study.are_straight == (None,)
    assert_allclose(study.relative_errors, 0.2, rtol=1e-9)
    assert softening_table(study).rows[0][-2:] == ("–", "20")


def test_what_readers_of_a_softened_field_are_told():
    assert remarks_on(field_with(softening=1.0)) == ()
    (unknown,) = remarks_on(field_with())
    assert "softened by 100, and the error of that is not known: add [softening_study]" in unknown
    (known,) = remarks_on(field_with([(100.0, 20.0, STRAIGHT), CORNER]))
    assert f"wrong by up to {100 * (STRAIGHT[2] - 0.5) / 0.5:.0f} % of the loss factor (at 100 Hz, 20 g" in known
    _, crooked = remarks_on(field_with([(100.0, 40.0, [1.0, 0.1, 0.12]), CORNER]))
    assert "no line over softening fits" in crooked
    assert "at 100 Hz, 40 g;" in crooked
    _, blind = remarks_on(field_with([(100.0, 20.0, STRAIGHT)]))
    assert "lowers the resonance of a packed bed by 4.6 times" in blind
    assert "add one near 200 Hz, 0.5 g" in blind


@pytest.mark.parametrize("suffix", [".nc", ".csv"])
def test_softening_and_its_study_survive_the_disk(tmp_path, suffix):
    field = field_with([(100.0, 20.0, STRAIGHT), CORNER])
    write_field(field, tmp_path / f"field{suffix}")
    assert remarks_on(read_field(tmp_path / f"field{suffix}")) == remarks_on(field)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        (
            {"softening_study": '{"factors": [1, 10], "points": [], "chosen": 10, "power": 0.4, "floor": 0.05}'},
            "a point",
        ),
        ({"softening_study": '{"factors": [1, 10], "points": [{"frequency": "x"}]}'}, "is not what a campaign wrote"),
        ({"softening_study": "[1]"}, "is not what"),
        ({"softening": "much"}, "softening is 'much'"),
        ({"softening": 0.1}, "from 1 on"),
        ({"softening_study": "{}"}, "is not what"),
    ],
)
def test_heads_of_tables_that_were_edited_badly(wrong, message):
    field = field_with()
    field.attrs |= wrong
    with pytest.raises(InputError, match=message):
        remarks_on(field)
