import csv
import json
import math

import numpy as np
import pytest
from numpy.testing import assert_allclose

from campaign_made import field_spec, made
from fields_made import constant_field
from graindamp.campaign.beds import bed_tasks, compare
from graindamp.campaign.executors import Serial
from graindamp.campaign.point import task_of
from graindamp.campaign.run import described, field_in_store, run_field
from graindamp.campaign.store import Store
from graindamp.errors import InputError
from graindamp.field.beds import BedPoint, BedStudy, bed_remarks, bed_study_of, widened
from graindamp.field.softening import study_of
from graindamp.field.store import read_field, write_field
from graindamp.report.document import bed_document
from graindamp.report.study_tables import bed_table, tables_of
from graindamp.status import Status

POINTS = [[50, 1], [100, 20], [200, 5]]
STUDY = {"points": POINTS, "seeds": 3}


def study_of_values(*rows, se=0.0, floor=0.05):
    """A study with these loss factors of the beds at each point, m' half of each."""
    points = []
    for k, row in enumerate(rows):
        eta = np.array(row, float)
        errors = np.full(len(eta), se)
        points.append(BedPoint(100.0 + k, 20.0, eta, errors, 0.5 * eta, errors))
    return BedStudy(tuple(points), floor)


def test_scatter_of_known_beds():
    study = study_of_values([0.9, 1.0, 1.1])
    assert_allclose(study.scatters(0), (0.1, 0.05), rtol=1e-12)
    eta, mass = study.pooled
    assert_allclose([eta.value, mass.value], [0.1, 0.05], rtol=1e-12)
    assert_allclose(eta.error, 0.1 / math.sqrt(4.0), rtol=1e-12)  # two degrees of freedom


def test_errors_of_the_runs_are_taken_out_and_small_loss_factors_count_as_the_floor():
    assert_allclose(study_of_values([0.9, 1.0, 1.1], se=0.06).scatters(0)[0], 0.08, rtol=1e-12)
    assert study_of_values([0.9, 1.0, 1.1], se=0.2).scatters(0) == (0.0, 0.0)
    assert_allclose(study_of_values([0.01, 0.02, 0.03]).scatters(0)[0], 0.2, rtol=1e-12)


def test_points_at_which_beds_move_in_different_ways_are_left_out():
    study = study_of_values([0.9, 1.0, 1.1], [1.2, 0.1, 1.2], [0.01, 0.04, 0.03])
    assert study.are_parted == (False, True, False)
    assert_allclose(study.pooled[0].value, math.sqrt((0.1**2 + study.scatters(2)[0] ** 2) / 2), rtol=1e-12)
    parted = study_of_values([1.2, 0.1])
    assert parted.pooled is None
    field = widened(constant_field(se=0.01), parted, 1)
    assert_allclose(field["loss_factor_se"], 0.01)
    (remark,) = bed_remarks(field)
    assert "100 Hz, 20 g (η 1.2, 0.1)" in remark
    assert "no point is left" in remark
    assert bed_table(parted).rows[0][3] == "–"


def test_errors_with_the_scatter_hold_for_beds_that_were_not_run():
    """Fields of one bed, and studies of it, whose beds scatter by 8 % and runs by 2 %: two thirds of other beds' true
    values are within one error. 400 fields know that share to 2.3 %; three times that is allowed, and 1 % for the
    normal distribution that a scatter from ten degrees of freedom is not."""
    rng = np.random.default_rng(5)
    inside, variances = [], []
    for _ in range(400):
        beds = 0.6 * (1.0 + 0.08 * rng.normal(size=(5, 3))) + 0.012 * rng.normal(size=(5, 3))
        study = study_of_values(*beds, se=0.012)
        variances.append(np.mean([study.scatters(k)[0] ** 2 for k in range(5)]))
        one = 0.6 * (1.0 + 0.08 * rng.normal()) + 0.012 * rng.normal()
        field = widened(constant_field(loss_factor=one, se=0.012), study, 1)
        inside.append(abs(0.6 - one) <= float(field["loss_factor_se"][0, 0]))
    assert_allclose(np.mean(inside), 0.683, atol=0.08)
    # Variances cut off at 0 are a little large: a tenth at most here.
    assert_allclose(np.sqrt(np.mean(variances)), 0.08, rtol=0.06)


def test_errors_become_wider_once_for_one_bed_and_no_smaller_for_several():
    study = study_of_values([0.9, 1.0, 1.1])
    one = widened(constant_field(loss_factor=0.6, se=0.03), study, 1)
    assert_allclose(one["loss_factor_se"], math.hypot(0.03, 0.06), rtol=1e-12)
    assert_allclose(one["effective_mass_ratio_se"], math.hypot(0.03, 0.03), rtol=1e-12)
    four = widened(constant_field(loss_factor=0.6, se=0.02), study, 4)
    assert_allclose(four["loss_factor_se"], 0.03, rtol=1e-12)
    assert_allclose(four["effective_mass_ratio_se"], 0.02, rtol=1e-12)


def test_second_answers_have_the_scatter_too():
    field = constant_field(loss_factor=0.6, se=0.03)
    for name, value in (("loss_factor_other", 0.2), ("loss_factor_other_se", 0.01)):
        field[name] = (field["loss_factor"].dims, np.full((2, 2), value))
    found = widened(field, study_of_values([0.9, 1.0, 1.1]), 1)
    assert_allclose(found["loss_factor_other_se"], math.hypot(0.01, 0.02), rtol=1e-12)


def by_bed(task, start):
    """A measurement whose beds differ by a tenth of eta."""
    result = made(task, start)
    return result._replace(loss_factor=(result.loss_factor - 0.01 * task.seed) * (0.9 + 0.1 * task.seed))


def test_a_study_runs_other_beds_and_widens_the_field(tmp_path):
    alone, spec = field_spec(), field_spec(bed_study=STUDY)
    with Store(tmp_path / "s") as opened:
        before = run_field(alone, opened, Serial(), how=by_bed)
        found = run_field(spec, opened, Serial(), how=by_bed)
        assert found.n_point == 12 + 6
        assert found.n_computed == 6  # the first bed's are those of the field
        exported = field_in_store(described(spec, None), opened)
        again = run_field(spec, opened, Serial(), how=by_bed)
    assert again.n_computed == 0
    study = bed_study_of(found.field)
    assert study.are_parted == (False, False, False)
    assert study.pooled[0].value == pytest.approx(0.1, rel=0.02)
    assert np.all(found.field["loss_factor_se"] > before.field["loss_factor_se"])
    np.testing.assert_array_equal(found.field["loss_factor"], before.field["loss_factor"])
    for other in (exported, again):
        np.testing.assert_array_equal(other.field["loss_factor_se"], found.field["loss_factor_se"])
        assert other.field.attrs == found.field.attrs


def test_points_of_a_study_that_are_lost_do_not_cost_the_field(tmp_path):
    def lost(task, start):
        result = made(task, start)
        if task.frequency == 100 and task.seed > 0:
            return result._replace(
                loss_factor=math.nan, effective_mass_ratio=math.nan, status=int(Status.PARTICLE_LOST)
            )
        return result

    with Store(tmp_path / "s") as opened:
        found = run_field(field_spec(bed_study=STUDY), opened, Serial(), how=lost)
    assert [one.frequency for one in bed_study_of(found.field).points] == [50, 200]
    assert "bed study: 1 of 3 points left out, which have no values of two beds" in found.warnings


def test_tasks_are_those_of_other_seeds():
    spec = field_spec(bed_study=STUDY)
    assert [[task.seed for task in row] for row in bed_tasks(spec)] == [[0, 1, 2]] * 3
    assert bed_tasks(spec)[1][2].key == task_of(spec, 100.0, 20.0, 2).key
    study = compare(spec, lambda task: made(task, None))
    assert study.floor == spec.stop.floor
    assert study.points[0].loss_factor.shape == (3,)


@pytest.mark.parametrize("suffix", [".nc", ".csv"])
def test_the_study_survives_the_disk(tmp_path, suffix):
    study = study_of_values([0.9, 1.0, math.nan], [0.2, 0.21, 0.22])
    field = widened(constant_field(), study, 1)
    write_field(field, tmp_path / f"field{suffix}")
    read = bed_study_of(read_field(tmp_path / f"field{suffix}"))
    assert read.dump() == study.dump()
    assert read.pooled == study.pooled


@pytest.mark.parametrize("delimiter", [",", ";"])
def test_the_study_survives_a_spreadsheet(tmp_path, delimiter):
    """Which cuts the head at commas, fills every row up to the length of the longest, and quotes what needs it."""
    field = widened(constant_field(), study_of_values([0.9, 1.0, math.nan], [0.2, 0.21, 0.22]), 1)
    field.attrs |= {"seeds": 1, "softening": 10.0}
    write_field(field, tmp_path / "field.csv")
    with open(tmp_path / "field.csv", newline="", encoding="utf-8") as file:
        rows = list(csv.reader(file))
    longest = max(map(len, rows))
    with open(tmp_path / "saved.csv", "w", newline="", encoding="utf-8") as file:
        csv.writer(file, delimiter=delimiter).writerows([*row, *[""] * (longest - len(row))] for row in rows)
    read = read_field(tmp_path / "saved.csv")
    assert bed_study_of(read).dump() == bed_study_of(field).dump()
    assert (read.attrs["seeds"], read.attrs["softening"]) == (1, 10)
    np.testing.assert_array_equal(read["loss_factor_se"], field["loss_factor_se"])


@pytest.mark.parametrize(
    "text", ["[1]", "{}", '{"floor": 0.05, "points": []}', json.dumps({"floor": 0.05, "points": [{"frequency": 1}]})]
)
def test_a_study_that_was_edited_badly(tmp_path, text):
    field = constant_field()
    field.attrs["bed_study"] = text
    with pytest.raises(InputError, match="bed_study is not what a campaign wrote"):
        bed_study_of(field)
    write_field(field, tmp_path / "field.nc")
    with pytest.raises(InputError, match=r"field\.nc: bed_study is not what"):
        read_field(tmp_path / "field.nc")


def test_what_readers_of_a_field_are_told():
    field = constant_field()
    assert bed_remarks(field) == ()
    field.attrs |= {"source": "simulated", "seeds": 1}
    (alone,) = bed_remarks(field)
    assert "add [bed_study]" in alone
    known = widened(field, study_of_values([0.9, 1.0, 1.1]), 1)
    assert bed_remarks(known) == ()
    (table,) = tables_of(known, "jar")
    assert table.title == "How beds of one description differ, jar"
    assert table.rows[0] == ("100", "20", "0.9, 1, 1.1", "10.0", "0.45, 0.5, 0.55", "5.0")
    assert "10.0 ± 5.0 % for η" in table.note
    assert bed_document(known)["study"]["scatter"]["loss_factor"]["value"] == pytest.approx(0.1)
    assert bed_document(field)["study"] is None


def test_a_scatter_as_small_as_the_errors_of_the_runs_is_known_as_badly_as_that():
    """Beds without scatter and runs with errors of 2 %: the pooled value is 0 or what chance leaves, and its error is
    about as large as its root mean square over many studies."""
    rng = np.random.default_rng(2)
    pooled = [study_of_values(*(0.5 + 0.01 * rng.normal(size=(4, 3))), se=0.01).pooled[0] for _ in range(300)]
    values, errors = np.array(pooled).T
    assert np.any(values == 0.0)
    assert np.all(errors > 0.0)
    assert 0.5 < np.mean(errors) / np.sqrt(np.mean(values**2)) < 2.0


def test_a_value_of_one_bed_of_three_has_the_scatter_of_one(tmp_path):
    def lost(task, start):
        result = by_bed(task, start)._replace(loss_factor_se=1e-3)
        if task.seed > 0 and (task.frequency, task.intensity) == (100, 20):
            return result._replace(
                loss_factor=math.nan, effective_mass_ratio=math.nan, status=int(Status.PARTICLE_LOST)
            )
        return result

    spec = field_spec(seeds=3, bed_study=STUDY | {"points": [[50, 1], [200, 5]]})
    with Store(tmp_path / "s") as opened:
        found = run_field(spec, opened, Serial(), how=lost).field
    scatter = bed_study_of(found).pooled[0].value
    one = found.sel(frequency=100, intensity=20)
    assert int(one["n_beds"]) == 1
    assert int(found["n_beds"].max()) == 3
    assert float(one["loss_factor_se"]) == pytest.approx(math.hypot(1e-3, scatter * float(one["loss_factor"])))


def test_a_run_that_fails_costs_a_study_one_bed(tmp_path):
    def failing(task, start):
        if task.seed == 1 and task.frequency == 100:
            raise InputError("does not fit")
        return by_bed(task, start)

    with Store(tmp_path / "s") as opened:
        found = run_field(field_spec(bed_study=STUDY), opened, Serial(), how=failing)
        exported = field_in_store(described(field_spec(bed_study=STUDY), None), opened)
    assert len(bed_study_of(found.field).points) == 3
    for run in (found, exported):
        assert "bed study: 1 of 9 runs have no result; it is made of the others" in run.warnings
        assert run.failures == ("100 Hz, 20, bed 1: does not fit",)
        assert run.n_point == 18
    assert bed_remarks(found.field) == ()


def test_a_study_without_values_is_not_asked_for_again(tmp_path):
    def failing(task, start):
        if task.seed > 0:
            raise InputError("does not fit")
        return by_bed(task, start)

    with Store(tmp_path / "s") as opened:
        found = run_field(field_spec(bed_study=STUDY), opened, Serial(), how=failing)
    (remark,) = bed_remarks(found.field)
    assert "no point with values of two" in remark
    assert "add" not in remark


def test_a_softening_study_knows_the_scatter_of_beds(tmp_path):
    softening = {"points": POINTS, "factors": [1, 10, 100]}
    with Store(tmp_path / "s") as opened:
        alone = run_field(field_spec(softening_study=softening), opened, Serial(), how=by_bed).field
        both = run_field(field_spec(softening_study=softening, bed_study=STUDY), opened, Serial(), how=by_bed).field
    scatter = bed_study_of(both).pooled[0].value
    for one, other in zip(study_of(alone).points, study_of(both).points, strict=True):
        wide = np.hypot(one.loss_factor.standard_error, scatter * one.loss_factor.value)
        np.testing.assert_allclose(other.loss_factor.standard_error, wide, rtol=1e-12)
        np.testing.assert_array_equal(other.loss_factor.value, one.loss_factor.value)


def test_an_adaptive_plan_that_asks_for_more_than_beds_have_in_common(tmp_path):
    pytest.importorskip("sklearn")
    plan = {"kind": "adaptive", "frequency_range": [50, 200], "intensity_range": [1, 40], "max_points": 8}
    plan |= {"start_frequencies": 2, "start_intensities": 2, "accuracy": 0.05}
    with Store(tmp_path / "s") as opened:
        found = run_field(field_spec(plan, bed_study=STUDY), opened, Serial(), how=by_bed)
        alone = run_field(field_spec(plan), opened, Serial(), how=by_bed)
    assert any(
        "beds of this description differ by 10 %, more than the accuracy of 5 %" in text for text in found.warnings
    )
    assert np.all(found.field["loss_factor_se"] >= 0.1 * np.abs(found.field["loss_factor"]) * (1 - 1e-9))
    assert "add [bed_study]" in bed_remarks(alone.field)[0]


def test_the_last_that_a_campaign_tells_is_of_its_field(tmp_path):
    seen = []
    with Store(tmp_path / "s") as opened:
        run_field(field_spec(bed_study=STUDY), opened, Serial(), how=by_bed, watch=seen.append)
    assert any(outlook.stage == "bed study" for outlook in seen)
    assert (seen[-1].stage, seen[-1].n_point) == ("from rest", 12)
