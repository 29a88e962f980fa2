"""From results to a field: errors over beds, second answers, adaptive plans, executors."""

import math
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise

import numpy as np
import pytest

from campaign_made import COUNTER, DAMPER, SLEEP, counted, field_spec, made, result_of
from graindamp.campaign.adaptive import AdaptiveSource
from graindamp.campaign.consolidate import MISSING, Answer, field_of
from graindamp.campaign.descriptions import fields_of
from graindamp.campaign.executors import Serial, executor_of
from graindamp.campaign.hysteresis import distance
from graindamp.campaign.outlook import Outlook
from graindamp.campaign.point import task_of
from graindamp.campaign.run import field_in_store, run_field
from graindamp.campaign.slurm import read_options
from graindamp.campaign.store import Store
from graindamp.errors import InputError
from graindamp.field.schema import check
from graindamp.field.softening import SofteningStudy
from graindamp.status import FATAL, Status

LINE = {"kind": "list", "points": [[100, 5]]}
TASK = task_of(field_spec(), 100.0, 5.0)


@pytest.fixture
def counter(tmp_path, monkeypatch):
    folder = tmp_path / "counter"
    folder.mkdir()
    monkeypatch.setenv(COUNTER, str(folder))
    return folder


def field_of_answers(*answers):
    return field_of(field_spec(LINE, seeds=max(1, len(answers))), {(100.0, 5.0): answers})


def run(folder, spec=None, **more):
    with Store(folder / "s") as opened:
        return run_field(spec or field_spec(), opened, Serial(), how=made, **more)


def test_a_field_is_valid_and_tells_where_it_comes_from(tmp_path):
    field = run(tmp_path).field
    check(field)
    assert field.sizes == {"frequency": 3, "intensity": 4}
    assert (
        field["loss_factor"].sel(frequency=50, intensity=20)
        == made(task_of(field_spec(), 50.0, 20.0), None).loss_factor
    )
    assert field["particle_steps"].sel(frequency=50, intensity=1) == 50 * 2000
    assert field.attrs["spec"] == field_spec().model_dump_json()
    assert field.attrs["source"] == "simulated"


@pytest.mark.parametrize(("errors", "expected"), [((0.2, 0.2), math.hypot(0.2, 0.2) / 2), ((0.001, 0.001), 0.05)])
def test_the_error_is_the_larger_of_that_within_beds_and_that_of_their_scatter(errors, expected):
    """Scatter of 0.4 and 0.5: standard deviation 0.1 / sqrt 2, of their mean 0.05."""
    beds = [result_of(TASK, eta, error=error) for eta, error in zip((0.4, 0.5), errors, strict=True)]
    field = field_of_answers(*(Answer(bed) for bed in beds))
    assert field["loss_factor"].item() == pytest.approx(0.45, rel=1e-15)  # rounding
    assert field["loss_factor_se"].item() == pytest.approx(expected, rel=1e-14)  # rounding
    assert field["n_cycles"].item() == 40


def test_status_bits_add_up_and_a_usable_bed_outweighs_a_failed_one():
    beds = [
        result_of(TASK, 0.4, status=int(Status.NOT_STEADY)),
        result_of(TASK, 0.4, status=int(Status.FEW_STEPS)),
        result_of(TASK, math.nan, math.nan, status=int(Status.PARTICLE_LOST)),
    ]
    field = field_of_answers(*(Answer(bed) for bed in beds))
    assert field["status"].item() == Status.NOT_STEADY | Status.FEW_STEPS
    assert field["loss_factor"].item() == 0.4


def test_beds_that_start_on_different_branches_are_kept_apart():
    """Two of three beds are low from rest; the third is high and has no second answer. Neither value is a mixture."""
    low, high = ((0.10, 0.12), (0.50, 0.54, 0.52))
    field = field_of(
        field_spec({"kind": "grid", "frequency": [100, 200], "intensity": [5, 10]}, seeds=3, hysteresis="all"),
        {
            (100.0, 5.0): [
                Answer(result_of(TASK, low[0], 0.1), result_of(TASK, high[0], 0.9)),
                Answer(result_of(TASK, high[1], 0.9), result_of(TASK, low[1], 0.1)),
                Answer(result_of(TASK, low[1], 0.1)),
            ]
        },
    ).sel(frequency=100, intensity=5)
    assert field["loss_factor"].item() == pytest.approx(np.mean([low[0], low[1], low[1]]), rel=1e-14)
    assert field["loss_factor_other"].item() == pytest.approx(np.mean(high[:2]), rel=1e-14)
    assert field["loss_factor_other_se"].item() == pytest.approx(0.02, rel=1e-12)  # half of their difference
    assert field["effective_mass_ratio"].item() == pytest.approx(0.1, rel=1e-14)
    assert field["n_cycles"].item() == 60
    assert field["status"].item() == Status.BISTABLE


def test_points_without_result_keep_their_place(tmp_path):
    spec = field_spec()
    task = task_of(spec, 100.0, 5.0)
    lost = result_of(task, math.nan, math.nan, status=int(Status.PARTICLE_LOST))
    field = field_of(spec, {(100.0, 5.0): [Answer(result_of(task, 0.4))], (100.0, 20.0): [Answer(lost)]})
    assert np.isfinite(field["loss_factor"]).sum() == 1
    assert field["status"].sel(frequency=100, intensity=20) == Status.PARTICLE_LOST
    assert field["status"].sel(frequency=50, intensity=1) == MISSING
    assert int(MISSING) & int(FATAL)
    with pytest.raises(InputError, match="no operating point has a usable value"):
        field_of(spec, {(100.0, 20.0): [Answer(lost)]})


def test_points_of_a_list_and_several_beds(tmp_path):
    spec = field_spec({"kind": "list", "points": [[100, 5], [73, 11], [50, 1]]}, seeds=3)
    field = run(tmp_path, spec).field
    assert field["frequency"].to_numpy().tolist() == [100, 73, 50]
    middle = made(task_of(spec, 73.0, 11.0, seed=1), None).loss_factor
    assert field["loss_factor"].to_numpy()[1] == pytest.approx(middle, rel=1e-14)  # rounding of the mean
    assert field["loss_factor_se"].to_numpy()[1] == pytest.approx(0.01 / math.sqrt(3), rel=1e-12)  # scatter 0.01


def test_answers_differ_by_errors_and_by_share():
    """At eta = 0.5 they must be 0.2 apart, or 3 combined errors, whichever is more."""
    one = result_of(TASK, 0.5, error=0.001)
    assert distance(one, result_of(TASK, 0.52, error=0.001)) == pytest.approx(0.02 / 0.2)
    assert distance(one, result_of(TASK, 0.52, mass=0.6, error=0.001)) == pytest.approx(0.1 / 0.2)
    assert distance(one, result_of(TASK, 0.6, error=0.1)) == pytest.approx(0.1 / (3 * math.hypot(0.1, 0.001)))


@pytest.mark.parametrize(("kind", "n_run"), [("intensity", 12 + 18 + 3), ("all", 12 + 34 + 9)])
def test_a_second_branch_is_followed_as_far_as_it_goes(tmp_path, counter, kind, n_run):
    """The made damper keeps its high branch at 100 Hz once it is on it; from rest it has it at 40 alone.

    18 neighbours in intensity, 34 in all. From the second answer at 20, its neighbours without one, 5 and 40, then 1;
    with frequency two more each time, 4 + 3 + 2.
    """
    spec = field_spec(hysteresis=kind)
    found = run(tmp_path, spec)
    bistable = (found.field["status"] & int(Status.BISTABLE)) != 0
    assert bistable.sel(frequency=100).to_numpy().tolist() == [True, True, True, False]
    assert not bistable.sel(frequency=[50, 200]).any()
    other = found.field["loss_factor_other"]
    assert np.isnan(other.sel(frequency=[50, 200])).all()
    apart = (other - found.field["loss_factor"]).sel(frequency=100).to_numpy()
    np.testing.assert_allclose(apart[:3], 0.6, rtol=1e-12)
    assert found.n_point == n_run == len(counted(counter))
    again = run(tmp_path, spec)
    assert again.n_computed == 0
    assert again.field.identical(found.field)
    with Store(tmp_path / "s") as opened:
        exported = field_in_store(fields_of(opened)[0], opened)
    assert exported.field.identical(found.field)


class Pool(Serial):
    """Threads, of which a campaign keeps all busy."""

    def __init__(self, n_worker):
        self.n_worker, self._pool = n_worker, ThreadPoolExecutor(n_worker)

    def submit(self, function, /, *arguments):
        return self._pool.submit(function, *arguments)

    def shutdown(self, *, now=False):
        self._pool.shutdown()


def test_a_start_that_is_lost_on_the_way_is_computed_once_more(tmp_path, counter, monkeypatch):
    """Every worker wants to begin with a run from the lost one's end; one of them computes that, the others wait."""
    monkeypatch.setenv(SLEEP, "0.02")
    spec = field_spec(hysteresis="intensity")
    lost = task_of(spec, 50.0, 5.0)
    crew = Pool(4)
    with Store(tmp_path / "s") as opened:

        def watch(outlook):
            if outlook.stage == "from rest" and outlook.n_done == 12:
                opened.path(lost.key).unlink()

        found = run_field(spec, opened, crew, how=made, watch=watch)
    crew.shutdown()
    assert len(found.warnings) == 1
    assert "is gone" in found.warnings[0]
    assert len(counted(counter)) == 12 + 18 + 3 + 1
    assert counted(counter).count("50-5-0-") == 2


class Bisection(AdaptiveSource):
    """Chooses between the two neighbours in frequency that differ most, under way or not; remembers what it saw."""

    def __init__(self):
        self.seen = []

    def first(self):
        return [(50.0, 5.0), (100.0, 5.0), (200.0, 5.0)]

    def next(self, results, running, n_point):
        self.seen.append((tuple(place for place, _ in results), tuple(running)))
        known = sorted((place[0], found[0].loss_factor) for place, found in results)
        taken = {place[0] for place, _ in results} | {f for f, _ in running}
        gaps = sorted((-abs(a[1] - b[1]), math.sqrt(a[0] * b[0])) for a, b in pairwise(known))
        return [(f, 5.0) for _, f in gaps if f not in taken][:n_point]


ADAPTIVE = {"kind": "adaptive", "frequency_range": [50, 200], "intensity_range": [1, 40], "max_points": 20}


def test_an_adaptive_plan_goes_on_where_runs_give_no_value(tmp_path):
    """Half of the coarse start is lost, so that a surrogate cannot be made yet; no point is chosen twice."""
    pytest.importorskip("sklearn")
    seen = []

    def partly(task, start):
        seen.append((task.frequency, task.intensity))
        lost = task.intensity > 10
        return result_of(task, math.nan if lost else 0.4, status=int(Status.PARTICLE_LOST) if lost else 0)

    plan = ADAPTIVE | {"start_frequencies": 2, "start_intensities": 2, "max_points": 16}
    with Store(tmp_path / "s") as opened:
        found = run_field(field_spec(plan), opened, Serial(), how=partly)
    assert len(seen) == len(set(seen)) <= 16
    assert found.lost
    assert np.isfinite(found.points["loss_factor"]).sum() >= 6
    assert found.verdict is not None
    assert found.field.sizes == {"frequency": 28, "intensity": 15}


def test_adaptive_points_do_not_depend_on_stops(tmp_path, counter):
    spec = field_spec(ADAPTIVE)
    whole = Bisection()
    field = run(tmp_path / "a", spec, source=whole, batch=2).field
    assert field.sizes == {"point": 20}
    assert len({(seen, running) for seen, running in whole.seen}) == len(whole.seen)
    assert all(len(running) <= 2 for _, running in whole.seen)

    class Stopped(Bisection):
        def next(self, *asked):
            if len(self.seen) == 4:
                raise KeyboardInterrupt
            return super().next(*asked)

    with pytest.raises(KeyboardInterrupt):
        run(tmp_path / "b", spec, source=Stopped(), batch=2)
    rest = Bisection()
    again = run(tmp_path / "b", spec, source=rest, batch=2)
    assert again.field.identical(field)
    assert whole.seen[4:] == rest.seen
    assert len(counted(counter)) == 40


def test_a_failing_damper_says_why(tmp_path, monkeypatch):
    def nothing(task, start):
        raise InputError("the bed does not fit")

    with Store(tmp_path / "s") as opened, pytest.raises(InputError, match=r"not one point.*\n.*the bed does not fit"):
        run_field(field_spec(), opened, Serial(), how=nothing)


def test_workers_that_cannot_load_the_engine_fail_no_point(tmp_path):
    def nothing(task, start):
        raise ImportError("no engine")

    with Store(tmp_path / "s") as opened:
        with pytest.raises(InputError, match="cannot be loaded there"):
            run_field(field_spec(), opened, Serial(), how=nothing)
        assert {entry.state for entry in opened.entries().values()} == {"queued"}


def test_the_outlook_tells_where_it_is(tmp_path):
    told: list[Outlook] = []
    run(tmp_path, watch=told.append)
    last = told[-1]
    assert (last.n_point, last.n_done, last.n_running, last.n_failed) == (12, 12, 0, 0)
    assert last.worst_error == pytest.approx(0.001 / 0.1, rel=0.9)  # eta of the made damper is 0.1 to 1.1
    assert last.clearance == 3e-3
    assert {place.state for place in last.places} == {"done"}
    assert told[0].n_done == 0


def test_only_what_is_new_of_a_larger_plan_is_computed(tmp_path, counter):
    run(tmp_path)
    larger = field_spec({"kind": "grid", "frequency": [50, 100, 200, 400], "intensity": [1, 5, 20, 40]})
    assert run(tmp_path, larger).n_computed == 4
    assert run(tmp_path, field_spec(title="another")).n_computed == 0


@pytest.mark.slow  # the engine has to be loaded or compiled
def test_a_point_by_the_engine(tmp_path):
    damper = DAMPER | {"fill": {"count": 10}}
    spec = field_spec({"kind": "list", "points": [[200, 10]]}, damper=damper, stop={"min_cycles": 8, "max_cycles": 8})
    with Store(tmp_path / "s") as opened:
        first = run_field(spec, opened, Serial())
        second = run_field(spec, opened, Serial())
    assert first.n_computed == 1
    assert second.n_computed == 0
    assert second.field.identical(first.field)
    assert first.field["loss_factor"].item() > 0
    assert first.field["particle_steps"].item() > 0


def test_the_surrogate_chooses_points_within_their_range(tmp_path):
    pytest.importorskip("sklearn")
    spec = field_spec(ADAPTIVE | {"start_frequencies": 3, "start_intensities": 3, "max_points": 14})
    found = run(tmp_path, spec)
    assert 9 <= found.points.sizes["point"] <= 14
    assert found.points["frequency"].min() >= 50
    assert found.points["intensity"].max() <= 40 * (1 + 1e-12)  # rounding of the logarithm
    # The field is what the surrogate predicts over the whole range, with an error everywhere.
    assert found.field["loss_factor"].shape == (28, 15)
    assert np.isfinite(found.field["loss_factor_se"]).all()
    assert found.field.attrs["particle_steps"] == found.points["particle_steps"].sum()


def test_an_adaptive_plan_keeps_to_a_share_of_the_cost_of_the_grid(tmp_path, counter):
    """Here cycles cost the same everywhere, so that the estimate is exact, and the grid's points are the plan's."""
    pytest.importorskip("sklearn")
    found = run(tmp_path, field_spec(ADAPTIVE | {"max_cost": 0.07, "max_points": 100, "accuracy": 0.001}), batch=8)
    axes = [{"start": low, "stop": high, "count": n} for low, high, n in ((50, 200, 28), (1, 40, 15))]
    full = field_spec({"kind": "grid", "frequency": axes[0], "intensity": axes[1]})
    points = {(float(f), float(g)) for f, g in zip(found.points["frequency"], found.points["intensity"], strict=True)}
    assert len(points) == len(counted(counter))
    grid = set(full.plan.points)
    assert len(grid) == 420
    assert points <= grid
    # Steps of a point are those of its time: a cycle of every one costs as many there.
    whole = sum(made(task_of(full, f, g), None).particle_steps for f, g in grid)
    share = float(found.points["particle_steps"].sum() / whole)
    assert 0.05 < share <= 0.07 * (1 + 1e-3)  # steps are whole numbers


def test_a_softening_study_is_kept_with_the_field(tmp_path):
    spec = field_spec(softening_study={"points": [[50, 1], [100, 20]], "factors": [1, 10, 100]})
    found = run(tmp_path, spec)
    study = SofteningStudy.load(found.field.attrs["softening_study"])
    assert [(one.frequency, one.intensity) for one in study.points] == [(50, 1), (100, 20)]
    assert study.points[0].loss_factor.value.shape == (3,)
    # The field's own softening, 1, needs no run of its own.
    assert found.n_point == found.n_computed == 12 + 4
    again = run(tmp_path, spec)
    assert again.n_computed == 0
    assert again.field.attrs == found.field.attrs


def lost_where_stiffer(task, start):
    """A run that ends without a value at one point of a study."""
    result = made(task, start)
    if task.simulation.damper.contact.softening == 10 and task.frequency == 100:
        return result._replace(loss_factor=math.nan, effective_mass_ratio=math.nan, status=int(Status.PARTICLE_LOST))
    return result


def test_points_of_a_study_that_are_lost_do_not_cost_the_field(tmp_path):
    study = {"points": [[50, 1], [100, 20]], "factors": [1, 10]}
    spec = field_spec(softening_study=study)
    with Store(tmp_path / "s") as opened:
        found = run_field(spec, opened, Serial(), how=lost_where_stiffer)
    kept = SofteningStudy.load(found.field.attrs["softening_study"])
    assert [one.frequency for one in kept.points] == [50]
    assert any("1 of 2 points left out" in text for text in found.warnings)
    alone = field_spec(softening_study=study | {"points": [[100, 20]]})
    with Store(tmp_path / "s") as opened:
        assert "softening_study" not in run_field(alone, opened, Serial(), how=lost_where_stiffer).field.attrs


@pytest.mark.parametrize(
    ("kind", "more", "message"),
    [
        ("many", {}, "executor: given 'many'; allowed are local"),
        ("dask", {}, "needs the address"),
        ("dask", {"address": "tcp://127.0.0.1:1"}, "nobody answers"),
    ],
)
def test_executors_that_there_are_not(kind, more, message, monkeypatch):
    monkeypatch.setattr("graindamp.campaign.executors.PATIENCE", 0.2)
    with pytest.raises(InputError, match=message):
        executor_of(kind, **more)


def test_options_of_slurm():
    assert read_options(["queue=short", "cores=8", "job-extra-directives=--exclusive; --nice"]) == {
        "queue": "short",
        "cores": 8,
        "job_extra_directives": ["--exclusive", "--nice"],
    }
    for wrong, message in (("queue", "name=value"), ("colour=red", "one of queue"), ("cores=few", "whole number")):
        with pytest.raises(InputError, match=message):
            read_options([wrong])
