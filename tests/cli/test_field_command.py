"""graindamp field and graindamp campaign: what they write, print and refuse. The engine is replaced by a formula."""

import json

import numpy as np
import pytest
from typer.testing import CliRunner

from campaign_made import FAULTS, GRID, made, project, result_of
from graindamp.campaign.store import Store
from graindamp.cli.main import app
from graindamp.errors import InputError
from graindamp.field.store import read_field
from graindamp.report.field_progress import FieldProgress, clock, line_of, progress_map


@pytest.fixture(autouse=True)
def no_engine(monkeypatch):
    monkeypatch.setattr("graindamp.campaign.work.measure_packed", made)


@pytest.fixture
def unpictured(monkeypatch):
    """The map alone is drawn."""
    monkeypatch.setattr("graindamp.report.field_pictures.write_pictures", lambda field, stem, points=None: ())


@pytest.fixture
def undrawn(unpictured, monkeypatch):
    monkeypatch.setattr(FieldProgress, "draw", lambda self, state: None)


def call(*words):
    return CliRunner().invoke(app, [str(word) for word in words])


def done(*words):
    result = call(*words)
    assert result.exit_code == 0, (result.exception, result.output)
    return result.stdout


def error(*words):
    result = call(*words)
    assert isinstance(result.exception, InputError), (result.exception, result.output)
    return str(result.exception)


def test_a_project_becomes_a_field_that_other_commands_take(tmp_path):
    path = project(tmp_path)
    out = done("field", path, "-o", tmp_path / "x.nc", "--executor", "serial")
    assert "12 runs, 12 of them computed now" in out
    field = read_field(tmp_path / "x.nc")
    assert field.sizes == {"frequency": 3, "intensity": 4}
    assert (tmp_path / "made-store" / "index.sqlite").exists()
    assert (tmp_path / "x.map.png").read_bytes().startswith(b"\x89PNG")
    page = (tmp_path / "x.html").read_text()
    assert "finished" in page
    assert "refresh" not in page
    assert f"losses   {tmp_path / 'x.losses.png'}" in out
    assert 'src="x.losses.png"' in page
    shown = json.loads(done("show", tmp_path / "x.nc", "--json"))
    assert shown["damper"]["clearance"] == 3e-3
    assert not [path for path in tmp_path.rglob("*") if ".part" in path.name]


def test_the_second_time_nothing_is_computed_and_json_is_one_document(undrawn, tmp_path):
    path = project(tmp_path)
    first = json.loads(done("field", path, "--executor", "serial", "--json"))
    second = json.loads(done("field", path, "--executor", "serial", "--json", "--resume"))
    assert (first["computed"], second["computed"]) == (12, 0)
    assert first["field"] == str(tmp_path / "made.nc")
    assert first["usable"] == first["places"] == 12
    assert first["particle_steps"] == 50 * 4 * (2000 + 1000 + 500)


@pytest.mark.slow
def test_what_softening_does_is_told_wherever_a_field_is_shown(unpictured, tmp_path):
    more = "\n[softening_study]\npoints = [[50, 1], [100, 20]]\nfactors = [1, 10, 100]\n"
    path = project(tmp_path)
    text = path.read_text(encoding="utf-8").replace("[damper.contact]", "[damper.contact]\nsoftening = 100")
    assert "softening" in text
    path.write_text(text, encoding="utf-8")
    alone = call("field", path, "--executor", "serial")
    assert "the error of that is not known" in alone.stderr
    path.write_text(text + more, encoding="utf-8")
    result = call("field", path, "--executor", "serial")
    assert result.exit_code == 0, result.output
    assert "What softening 100 does to the field" in result.stdout
    assert "contacts softened by 100: " in result.stderr
    page = (tmp_path / "made.html").read_text(encoding="utf-8")
    assert "What softening 100 does to the field" in page
    assert "contacts softened by 100: " in page
    shown = call("show", tmp_path / "made.nc", "--figure", tmp_path / "made.png")
    assert "What softening 100 does to the field" in shown.stdout
    assert "contacts softened by 100: " in shown.stderr
    document = json.loads(done("show", tmp_path / "made.nc", "--json"))["softening"]
    assert document["softening"] == 100
    assert [point["line_fits"] for point in document["study"]["points"]] == [True, True]
    again = json.loads(done("field", path, "--executor", "serial", "--json"))["softening"]
    assert again == document


def test_failed_points_are_listed_and_queued_again(undrawn, tmp_path, monkeypatch):
    faults = tmp_path / "faults"
    faults.mkdir()
    monkeypatch.setenv(FAULTS, str(faults))
    (faults / "100-5").write_text("input")
    path, store = project(tmp_path), tmp_path / "made-store"
    result = call("field", path, "--executor", "serial")
    assert result.exit_code == 0
    assert "failed: 100 Hz, 5, bed 0: the bed does not fit" in result.stderr
    assert f"graindamp campaign retry {store}" in result.stderr
    assert np.isnan(read_field(tmp_path / "made.nc")["loss_factor"].sel(frequency=100, intensity=5))
    told = done("campaign", "status", store)
    assert "11 done, 0 running, 0 queued, 1 failed" in told
    assert "the bed does not fit (tries: 1)" in told
    (faults / "100-5").unlink()
    assert "1 failed points queued again" in done("campaign", "retry", store)
    assert "no point has failed" in done("campaign", "retry", store)
    assert "1 of them computed now" in done("field", path, "--executor", "serial")
    told = json.loads(done("campaign", "status", store, "--json"))
    assert told["points"] == {"queued": 0, "running": 0, "done": 12, "failed": 0}
    assert told["fields"][0]["done"] == 12


def test_runs_that_give_no_value_are_told(undrawn, tmp_path, monkeypatch):
    """They are done, and would end so again: nothing to retry. Remarks on points with a value are counted."""
    faults = tmp_path / "faults"
    faults.mkdir()
    monkeypatch.setenv(FAULTS, str(faults))
    (faults / "100-5").write_text("PARTICLE_LOST")
    (faults / "50-1").write_text("NOT_CONVERGED")
    path = project(tmp_path)
    result = call("field", path, "--executor", "serial")
    assert result.exit_code == 0
    assert "no value: 100 Hz, 5, bed 0: PARTICLE_LOST: a particle left its container" in result.stderr
    assert "1 of 12 points NOT_CONVERGED: the standard error is above" in result.stderr
    assert "retry" not in result.stderr
    told = json.loads(done("field", path, "--executor", "serial", "--json"))
    assert told["status"] == {"PARTICLE_LOST": 1, "NOT_CONVERGED": 1}
    assert len(told["lost"]) == 1
    assert told["failed"] == []
    for f in (50, 100, 200):
        for gamma in (1, 5, 20, 40):
            (faults / f"{f}-{gamma}").write_text("PARTICLE_LOST")
    message = error("field", path, "--executor", "serial", "--store", tmp_path / "another")
    assert "not one point has a usable value" in message
    assert "100 Hz, 20, bed 0: PARTICLE_LOST" in message


def test_points_of_another_field_are_left_aside(undrawn, tmp_path):
    pytest.importorskip("sklearn")
    plan = {"kind": "adaptive", "frequency_range": [50, 200], "intensity_range": [1, 40], "max_points": 8}
    path = project(tmp_path, plan | {"start_frequencies": 2, "start_intensities": 2})
    result = call("field", path, "-o", tmp_path / "x.nc", "--executor", "serial")
    assert "the plan ended before its accuracy was reached" in result.stderr
    points = tmp_path / "x.points.nc"
    kept = points.read_bytes()
    alone = call("show", tmp_path / "x.nc", "--figure", tmp_path / "x.png").stderr
    assert "left aside" not in alone
    assert "add [bed_study]" in alone
    project(tmp_path)
    done("field", path, "-o", tmp_path / "x.nc", "--executor", "serial")
    assert not points.exists()
    points.write_bytes(kept)
    result = call("show", tmp_path / "x.nc", "--figure", tmp_path / "x.png")
    assert f"{points}: not what x.nc was made from" in result.stderr


def test_projects_of_one_name_are_told_apart(undrawn, tmp_path):
    paths = []
    for name, frequency in (("a", [50, 100]), ("b", [200, 400])):
        (tmp_path / name).mkdir()
        paths.append(project(tmp_path / name, GRID | {"frequency": frequency}))
        done("field", paths[-1], "-o", tmp_path / f"{name}.nc", "--executor", "serial", "--store", tmp_path / "s")
    assert f"of which the store holds 2; give one of {paths[0]}" in error(
        "campaign", "export", tmp_path / "s", "-o", tmp_path / "x.nc", "--name", "made"
    )
    for path, frequency in zip(paths, (50, 200), strict=True):
        done("campaign", "export", tmp_path / "s", "-o", tmp_path / "x.nc", "--name", path)
        assert read_field(tmp_path / "x.nc")["frequency"][0] == frequency


def test_refused_commands_leave_nothing_behind(tmp_path):
    path = project(tmp_path)
    (tmp_path / "file").write_text("")
    for words in (["--executor", "many"], ["--resume"], ["-o", tmp_path / "file" / "x.nc"]):
        error("field", path, "--executor", "serial", *words)
    assert sorted(one.name for one in tmp_path.iterdir()) == ["file", "made.toml"]


def test_a_part_of_a_field_is_exported(undrawn, tmp_path):
    path, store = project(tmp_path), tmp_path / "made-store"
    done("field", path, "--executor", "serial")
    whole = read_field(tmp_path / "made.nc")
    assert "12 of 12" in done("campaign", "export", store, "-o", tmp_path / "whole.nc")
    assert (tmp_path / "whole.nc").read_bytes() == (tmp_path / "made.nc").read_bytes()
    for file in sorted((store / "points").glob("*/*.h5"))[:5]:
        file.unlink()
    told = json.loads(done("campaign", "export", store, "-o", tmp_path / "part.nc", "--json"))
    assert (told["usable"], told["places"]) == (7, 12)
    part = read_field(tmp_path / "part.nc")
    known = np.isfinite(part["loss_factor"])
    assert known.sum() == 7
    np.testing.assert_array_equal(part["loss_factor"].where(known, 0.0), whole["loss_factor"].where(known, 0.0))


def test_several_projects_share_a_store(undrawn, tmp_path):
    one = project(tmp_path)
    two = project(tmp_path, GRID | {"frequency": [50, 100, 400]}, "two.toml")
    told = json.loads(done("field", one, two, "-o", tmp_path / "out", "--executor", "serial", "--json"))
    assert [field["computed"] for field in told["fields"]] == [12, 4]
    assert (tmp_path / "out" / "store").is_dir()
    assert (tmp_path / "out" / "two.nc").exists()
    store = tmp_path / "out" / "store"
    assert "--name, one of made, two" in error("campaign", "export", store, "-o", tmp_path / "x.nc")
    done("campaign", "export", store, "-o", tmp_path / "x.nc", "--name", "two")
    assert "the store holds made, two" in error("campaign", "export", store, "-o", tmp_path / "x.nc", "--name", "no")
    assert "give a folder" in error("field", one, two, "-o", tmp_path / "x.nc")


def test_resume_wants_something_to_go_on_with(undrawn, tmp_path):
    path = project(tmp_path)
    assert "holds no campaign of" in error("field", path, "--executor", "serial", "--resume")
    done("field", path, "--executor", "serial")
    project(tmp_path, GRID | {"frequency": [50, 100]})
    assert "is not what the campaign" in error("field", path, "--executor", "serial", "--resume")
    assert "8 runs, 0 of them computed now" in done("field", path, "--executor", "serial")


def test_ctrl_c_ends_with_its_code_and_says_how_to_go_on(undrawn, tmp_path, monkeypatch):
    path, seen = project(tmp_path), []

    def stopped(task, start):
        seen.append(task)
        if len(seen) == 4:
            raise KeyboardInterrupt
        return made(task, start)

    with monkeypatch.context() as patch:
        patch.setattr("graindamp.campaign.work.measure_packed", stopped)
        result = call("field", path, "--executor", "serial")
    assert result.exit_code == 130
    assert "Give the same command to go on" in result.stderr
    assert "3 of 12 points from rest done" in done("campaign", "status", tmp_path / "made-store")
    assert "9 of them computed now" in done("field", path, "--executor", "serial", "--resume")


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("campaign", "status", "{here}"), "is no store"),
        (("campaign", "status", "{here}/none"), "is no store"),
        (("campaign", "retry", "{here}/made.toml"), "is a file"),
        (("field", "{here}/made.toml", "-o", "x.txt"), "a field file ends in .nc or .csv"),
        (("field", "{here}/made.toml", "--executor", "many"), "allowed are local"),
        (("field", "{here}/made.toml", "--executor", "dask"), "needs the address"),
        (
            ("field", "{here}/made.toml", "--executor", "serial", "--scheduler", "tcp://x:1"),
            "goes with --executor dask",
        ),
        (("field", "{here}/made.toml", "--slurm", "colour=red"), "name one of queue"),
        (("field", "{here}/made.toml", "--slurm", "queue=short"), "--slurm goes with --executor slurm"),
        (("field", "{here}/none.toml"), "cannot be opened"),
    ],
)
def test_nonsense_is_refused(tmp_path, words, message):
    project(tmp_path)
    assert message in error(*(word.format(here=tmp_path) for word in words))
    assert not list(tmp_path.glob("made-store/points/*/*"))


def test_an_empty_store_has_no_field(tmp_path):
    Store(tmp_path / "s").close()
    assert "holds no description" in error("campaign", "export", tmp_path / "s", "-o", tmp_path / "x.nc")


def outlook(states, plan=None):
    from campaign_made import field_spec
    from graindamp.campaign.outlook import outlook_of
    from graindamp.campaign.point import task_of

    spec = field_spec(plan)
    tasks = {task.key: task for task in (task_of(spec, f, gamma) for f, gamma in spec.plan.points)}
    state = dict(zip(tasks, states, strict=False))
    results = {key: result_of(tasks[key], 0.1 + 0.1 * k) for k, key in enumerate(tasks) if state.get(key) == "done"}
    return outlook_of("from rest", tasks, results, state, 125.0)


@pytest.mark.parametrize("plan", [None, {"kind": "list", "points": [[50, 1], [70, 5], [200, 20]]}])
def test_the_map_shows_every_state(tmp_path, plan):
    state = outlook(["done", "failed", "running", "elsewhere", "done", "queued"], plan)
    figure = progress_map(state, "made")
    assert "made" in figure.get_suptitle()
    figure.savefig(tmp_path / "map.png")


def test_the_line_counts(tmp_path):
    line = line_of(outlook(["done", "failed", "running", "elsewhere", "done", "queued"]))
    assert line == "from rest: 2 of 12 done, 1 running, 1 elsewhere, 1 failed, worst error 1 %, 2:05 left"
    assert clock(3725) == "1:02:05"


def test_the_page_loads_itself_again_while_the_campaign_runs(tmp_path, capsys):
    with FieldProgress(tmp_path / "x.nc", "made") as progress:
        progress(outlook(["done"]))
        assert 'http-equiv="refresh"' in progress.page.read_text()
        progress(outlook(["done", "done"]))
    assert 'http-equiv="refresh"' not in progress.page.read_text()
    assert capsys.readouterr().err.splitlines() == [line_of(outlook(["done"])), line_of(outlook(["done", "done"]))]


def test_the_page_is_drawn_again_only_when_a_point_has_changed(tmp_path, monkeypatch):
    """Points without a value are NaN, and no NaN is equal to another."""
    drawn = []
    monkeypatch.setattr(FieldProgress, "draw", lambda self, state: drawn.append(state))
    monkeypatch.setattr("graindamp.report.field_progress.DRAW_EVERY", 0.0)
    progress = FieldProgress(tmp_path / "x.nc", "made", quiet=True)
    for states in (["queued"], ["queued"], ["running"], ["running"], ["done"], ["done"]):
        progress(outlook(states))
    assert len(drawn) == 3


def test_a_campaign_stays_with_its_back_end(undrawn, tmp_path, monkeypatch):
    """`auto` goes on with what a campaign was begun with; another one computes points of its own and says so."""
    pytest.importorskip("numba_cuda", reason="the extra `gpu` (numba-cuda) is not installed")
    path = project(tmp_path)
    assert "12 of them computed now, on the CPU)" in done("field", path, "--executor", "serial")
    out = done("field", path, "--executor", "serial", "--backend", "cuda")
    assert "12 of them computed now, on the GPU in mixed precision)" in out
    told = json.loads(done("field", path, "--executor", "serial", "--json"))
    assert (told["computed"], told["backend"], told["precision"]) == (0, "cuda", "mixed")
    assert "or the back end is not what" in error("field", path, "--executor", "serial", "--resume", "--backend", "cpu")
    told = json.loads(done("campaign", "status", tmp_path / "made-store", "--json"))
    assert told["points"]["done"] == 24
    assert (told["fields"][0]["backend"], told["fields"][0]["done"]) == ("cuda-mixed", 12)
    assert "knows no GPUs" in error("field", path, "--executor", "processes")
    assert "given 'gpu'" in error("field", path, "--backend", "gpu")


def test_a_gpu_that_is_not_there_leaves_no_store_behind(undrawn, tmp_path, monkeypatch):
    def none():
        raise InputError("no GPU")

    monkeypatch.setattr("graindamp.dem.gpu.device.require", none)
    path = project(tmp_path)
    for more in ([], ["--resume"], ["--store", tmp_path / "a" / "b"]):
        assert "no GPU" in error("field", path, "--executor", "serial", "--backend", "cuda", *more)
    assert "given 'gpu'" in error("field", path, "--backend", "gpu")
    assert [one.name for one in tmp_path.iterdir()] == ["made.toml"]
    done("field", path, "--executor", "serial")
    assert "no GPU" in error("field", path, "--executor", "serial", "--backend", "cuda")  # where there is a store, too
