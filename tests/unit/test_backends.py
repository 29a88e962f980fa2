"""Which back end a campaign gets, and how tasks, stores and fields know it."""

import json

import pytest

from campaign_made import field_spec, made
from graindamp.campaign.adaptive import batch_for
from graindamp.campaign.backends import CPU, CUDA, chosen
from graindamp.campaign.descriptions import fields_of
from graindamp.campaign.executors import Serial, Threads, executor_of
from graindamp.campaign.point import PointTask, task_of
from graindamp.campaign.run import field_in_store, run_field
from graindamp.campaign.store import Store
from graindamp.dem.gpu import device
from graindamp.errors import InputError

MIXED, DOUBLE = CUDA["mixed"], CUDA["double"]


@pytest.fixture
def gpu(monkeypatch):
    """As on a machine with a GPU."""
    monkeypatch.setattr(device, "available", lambda: True)
    monkeypatch.setattr(device, "require", lambda: None)


@pytest.mark.parametrize(
    ("asked", "precision", "known", "alone", "expected"),
    [
        ("auto", None, None, True, MIXED),
        ("auto", "double", None, True, DOUBLE),
        ("auto", None, None, False, CPU),  # a scheduler's workers decide, and were not asked
        ("auto", None, CPU, True, CPU),  # what was begun is gone on with
        ("auto", None, DOUBLE, True, DOUBLE),
        ("cuda", None, DOUBLE, True, DOUBLE),
        ("cuda", None, CPU, True, MIXED),
        ("cuda", None, None, False, MIXED),
        ("cpu", None, MIXED, True, CPU),
    ],
)
def test_the_back_end_of_a_campaign(gpu, asked, precision, known, alone, expected):
    assert chosen(asked, precision, known, alone=alone) == expected


def test_without_a_gpu_auto_is_the_processor():
    """Numba's simulator, which the tests run in, is no GPU."""
    assert not device.available()
    assert chosen("auto", None, None, alone=True) == CPU


def test_who_asks_for_a_gpu_is_told_what_is_missing(monkeypatch):
    for wrong in (("gpu", None), ("cuda", "half")):
        with pytest.raises(InputError, match=r"given '(gpu|half)'; allowed are"):
            chosen(*wrong, None, alone=True)
    find = device.importlib.util.find_spec
    monkeypatch.setattr(device.importlib.util, "find_spec", lambda name: None if name == "numba_cuda" else find(name))
    with pytest.raises(InputError, match=r"numba-cuda; install.*pip install \"graindamp\[gpu\]\".*--backend cpu"):
        chosen("cuda", None, None, alone=True)
    assert chosen("auto", None, None, alone=True) == CPU


def test_no_gpu_in_the_driver_is_no_gpu(monkeypatch):
    pytest.importorskip("numba_cuda", reason="the extra `gpu` (numba-cuda) is not installed")
    cuda = pytest.importorskip("numba.cuda")
    monkeypatch.setattr(device, "simulated", lambda: False)
    monkeypatch.setattr(cuda, "is_available", lambda: False)
    with pytest.raises(InputError, match=r"nvidia-smi.*--backend cpu"):
        chosen("cuda", None, None, alone=True)


def test_every_back_end_has_keys_of_its_own():
    """Those of the processor are as they were before there was another."""
    tasks = [task_of(field_spec(), 100.0, 5.0, backend=name) for name in (CPU, MIXED, DOUBLE)]
    assert len({task.key for task in tasks}) == 3
    assert "backend" not in tasks[0].document()
    assert [PointTask.load(task.dump()).key for task in tasks] == [task.key for task in tasks]
    old = {key: value for key, value in json.loads(tasks[0].dump()).items() if key != "backend"}
    assert PointTask.load(json.dumps(old)).backend == CPU
    with pytest.raises(InputError, match="backend is 'abacus'"):
        PointTask.load(json.dumps(old | {"backend": "abacus"}))


def test_fields_of_two_back_ends_share_a_store_and_no_point(tmp_path):
    more = {"hysteresis": "intensity", "softening_study": {"points": [[50, 1]], "factors": [1, 10]}}
    spec = field_spec(**more)
    with Store(tmp_path / "s") as opened:
        runs = [run_field(spec, opened, Serial(), how=made, backend=name) for name in (CPU, MIXED)]
        assert fields_of(opened)[0].backend == MIXED
        again = field_in_store(fields_of(opened)[0], opened)
        assert len(opened.entries()) == 2 * runs[0].n_computed
    assert runs[0].n_computed == runs[1].n_computed
    assert again.field.identical(runs[1].field)
    assert [run.field.attrs["backend"] for run in runs] == ["cpu", "cuda"]
    assert [run.field.attrs["precision"] for run in runs] == ["double", "mixed"]


def test_batches_of_an_adaptive_plan_fill_the_gpu():
    plan = {"kind": "adaptive", "frequency_range": [50, 200], "intensity_range": [1, 40], "max_points": 400}
    assert batch_for(field_spec(plan), 120) == 60
    assert batch_for(field_spec(plan, seeds=3), 120) == 20
    assert batch_for(field_spec(plan), 2000) == 100
    assert batch_for(field_spec(plan), 1) == 2


def test_executors_for_gpus():
    assert isinstance(executor_of("local", n_worker=3, on_device=True), Threads)
    for kind in ("processes", "slurm"):
        with pytest.raises(InputError, match=f"'{kind}' knows no GPUs"):
            executor_of(kind, on_device=True)


@pytest.mark.slow
def test_jobs_that_slurm_refuses_are_told_at_once(tmp_path, monkeypatch):
    pytest.importorskip("dask_jobqueue", reason="the extra `slurm` (dask-jobqueue) is not installed")
    from graindamp.campaign.slurm import slurm

    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(InputError, match="there is no sbatch here"):
        slurm(2, {"queue": "short"})
    command = tmp_path / "sbatch"
    command.write_text("#!/bin/sh\necho 'invalid partition specified: short' >&2\nexit 1\n")
    command.chmod(0o755)
    with pytest.raises(InputError, match=r"the jobs cannot be made .*invalid partition specified: short"):
        slurm(2, {"queue": "short", "interface": "lo"})
