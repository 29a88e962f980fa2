"""Nothing is lost: what is killed, filled up, damaged or stopped ends in the field of an undisturbed run, bit for bit,
and what was done before is not computed again."""

import gc
import os
import signal
import subprocess
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

import campaign_made
from campaign_made import COUNTER, FAULTS, SLEEP, counted, field_spec, made
from graindamp.campaign import point_file
from graindamp.campaign.executors import Serial, executor_of
from graindamp.campaign.index import StoreFull
from graindamp.campaign.run import run_field
from graindamp.campaign.store import Store

N_POINT = 12


def field_bytes(store, folder, crew=None, spec=None):
    """The field of a store as the bytes of its arrays and attributes, and the run that gave it."""
    with Store(store) as opened:
        run = run_field(spec or field_spec(), opened, crew or Serial(), how=made)
    return content(run.field), run


def content(field):
    arrays = {
        name: (field[name].dims, field[name].dtype.str, field[name].to_numpy().tobytes()) for name in field.variables
    }
    return arrays, dict(field.attrs)


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory):
    return field_bytes(tmp_path_factory.mktemp("undisturbed") / "s", None)[0]


@pytest.fixture
def counter(tmp_path, monkeypatch):
    folder = tmp_path / "counter"
    folder.mkdir()
    monkeypatch.setenv(COUNTER, str(folder))
    return folder


@pytest.fixture
def faults(tmp_path, monkeypatch):
    folder = tmp_path / "faults"
    folder.mkdir()
    monkeypatch.setenv(FAULTS, str(folder))
    return folder


def begun(store, target, counter, least, *words, sleep="0.15"):
    """A campaign in a process of its own, that has begun `least` points."""
    script = Path(campaign_made.__file__)
    environment = os.environ | {SLEEP: sleep, COUNTER: str(counter), "PYTHONPATH": str(script.parent)}
    process = subprocess.Popen([sys.executable, str(script), str(store), str(target), *words], env=environment)
    limit = time.monotonic() + 60
    while len(counted(counter)) < least:
        assert process.poll() is None, "ended too early"
        assert time.monotonic() < limit, "nothing happens"
        time.sleep(0.01)
    return process


def interrupted(process, counter):
    """Exit code after Ctrl-C. Python drops the exception if it comes within a callback of a weak reference; then the
    campaign goes on, and Ctrl-C is given again."""
    limit, seen = time.monotonic() + 60, -1
    while process.poll() is None:
        assert time.monotonic() < limit, "goes on"
        if len(counted(counter)) > seen + 2:
            seen = len(counted(counter))
            process.send_signal(signal.SIGINT)
        time.sleep(0.01)
    return process.returncode


@pytest.mark.slow  # a second interpreter has to start
def test_the_campaign_is_killed(tmp_path, counter, undisturbed):
    process = begun(tmp_path / "s", tmp_path / "x.nc", counter, 5, "processes")
    process.send_signal(signal.SIGKILL)
    process.wait()
    done = len(list((tmp_path / "s" / "points").glob("*/*.h5")))
    assert done >= 3
    before = counted(counter)
    field, run = field_bytes(tmp_path / "s", tmp_path)
    assert field == undisturbed
    assert run.n_computed == N_POINT - done
    assert len(counted(counter)) <= len(before) + N_POINT - done
    assert not run.warnings


@pytest.mark.slow  # a second interpreter has to start
def test_ctrl_c_leaves_a_store_to_go_on_with(tmp_path, counter, undisturbed):
    process = begun(tmp_path / "s", tmp_path / "x.nc", counter, 4)
    assert interrupted(process, counter) == 130
    with Store(tmp_path / "s") as opened:
        states = [entry.state for entry in opened.entries().values()]
    assert states.count("done") >= 2
    assert set(states) == {"done", "queued"}
    field, run = field_bytes(tmp_path / "s", tmp_path)
    assert field == undisturbed
    assert run.n_computed == states.count("queued")


@pytest.mark.slow  # workers are processes of their own
def test_a_worker_dies(tmp_path, counter, faults, undisturbed):
    """kill -9 in the middle of a point, once: it is tried again. Three times: it is given up, the others are not."""
    (faults / "100-5").write_text("die once")
    (faults / "200-40").write_text("die")
    crew = executor_of("processes", n_worker=2)
    try:
        _, run = field_bytes(tmp_path / "s", tmp_path, crew)
    finally:
        crew.shutdown()
    assert run.failures == ("200 Hz, 40, bed 0: worker died, 3 times",)
    assert run.field["status"].sel(frequency=200, intensity=40) != 0
    count = counted(counter)
    assert count.count("100-5-0-") == 2
    assert count.count("200-40-0-") == 3
    assert len(count) == N_POINT + 3
    (faults / "200-40").unlink()
    with Store(tmp_path / "s") as opened:
        assert len(opened.retry()) == 1
    field, again = field_bytes(tmp_path / "s", tmp_path)
    assert field == undisturbed
    assert again.n_computed == 1


@pytest.mark.slow  # a cluster has to start
def test_a_worker_of_dask_dies(tmp_path, counter, faults, undisturbed):
    """Results that its worker still held are lost with it, and computed again by Dask: they were not done yet."""
    pytest.importorskip("distributed")
    (faults / "100-5").write_text("die once")
    crew = executor_of("local", n_worker=2)
    try:
        field, run = field_bytes(tmp_path / "s", tmp_path, crew)
    finally:
        crew.shutdown()
    assert field == undisturbed
    assert not run.failures
    assert counted(counter).count("100-5-0-") == 2
    with Store(tmp_path / "s") as opened:
        assert sorted(entry.tries for entry in opened.entries().values()) == [1] * (N_POINT - 1) + [2]


def test_a_worker_is_told_nothing_of_a_bad_point_of_another(tmp_path, faults, undisturbed):
    """An error is a reason, the field keeps a hole with a status, and retry closes it."""
    (faults / "50-1").write_text("input")
    (faults / "50-5").write_text("value")
    field, run = field_bytes(tmp_path / "s", tmp_path)
    assert run.failures == ("50 Hz, 1, bed 0: the bed does not fit", "50 Hz, 5, bed 0: ValueError: something else")
    assert field != undisturbed
    assert field_bytes(tmp_path / "s", tmp_path)[1].n_computed == 0  # not tried again without being asked
    for path in list(faults.iterdir()):
        path.unlink()
    with Store(tmp_path / "s") as opened:
        opened.retry()
    assert field_bytes(tmp_path / "s", tmp_path)[0] == undisturbed


def test_the_disk_fills_up(tmp_path, counter, undisturbed, monkeypatch):
    n_written = 0
    sync = os.fsync

    def fsync(descriptor):
        nonlocal n_written
        n_written += 1
        if n_written > 5:
            raise OSError(28, "No space left on device")
        sync(descriptor)

    with monkeypatch.context() as patch:
        patch.setattr(point_file.os, "fsync", fsync)
        with pytest.raises(StoreFull, match="every point that was finished is kept"):
            field_bytes(tmp_path / "s", tmp_path)
    done = len(list((tmp_path / "s" / "points").glob("*/*.h5")))
    assert done == 4  # the first file is the description
    assert not list((tmp_path / "s").rglob("*.part"))
    before = len(counted(counter))
    field, run = field_bytes(tmp_path / "s", tmp_path)
    assert field == undisturbed
    assert run.n_computed == len(counted(counter)) - before == N_POINT - done


def test_a_disk_that_is_full_in_truth(tmp_path, undisturbed):
    """A file system of 300 KiB, where one can be mounted."""
    place = tmp_path / "small"
    place.mkdir()
    command = ["mount", "-t", "tmpfs", "-o", "size=300k", "tmpfs", str(place)]
    if os.geteuid() != 0 or subprocess.run(command, capture_output=True).returncode != 0:
        pytest.skip("no file system can be mounted here")
    try:
        with pytest.raises(StoreFull):
            field_bytes(place / "s", tmp_path)
        assert not list(place.rglob("*.part"))
        subprocess.run(["mount", "-o", "remount,size=20m", str(place)], check=True)
        field, run = field_bytes(place / "s", tmp_path)
        assert field == undisturbed
        assert run.n_computed < N_POINT
    finally:
        subprocess.run(["umount", "-l", str(place)], check=True)  # lazily: others may still look at it


def test_files_are_damaged_and_the_index_is_lost(tmp_path, counter, undisturbed):
    field_bytes(tmp_path / "s", tmp_path)
    files = sorted((tmp_path / "s" / "points").glob("*/*.h5"))
    files[0].write_bytes(files[0].read_bytes()[:1000])
    files[3].write_bytes(b"")
    files[5].unlink()
    field, run = field_bytes(tmp_path / "s", tmp_path)
    assert field == undisturbed
    assert run.n_computed == 3
    assert len(run.warnings) == 2
    (tmp_path / "s" / "index.sqlite").unlink()
    field, run = field_bytes(tmp_path / "s", tmp_path)
    assert field == undisturbed
    assert run.n_computed == 0
    assert len(counted(counter)) == N_POINT + 3


def test_two_campaigns_share_a_store(tmp_path, counter, undisturbed, monkeypatch):
    monkeypatch.setenv(SLEEP, "0.1")
    together = threading.Barrier(2)

    def campaign():
        with Store(tmp_path / "s") as opened:
            together.wait()
            return run_field(field_spec(), opened, Serial(), how=made)

    with ThreadPoolExecutor(2) as crew:
        runs = [run.result() for run in [crew.submit(campaign) for _ in range(2)]]
    assert [content(run.field) for run in runs] == [undisturbed, undisturbed]
    assert len(counted(counter)) == N_POINT
    assert all(run.n_computed > 0 for run in runs)


def test_many_campaigns_make_one_store_at_once(tmp_path):
    """Who comes while the folder or the index is being made gets the store, not a message about foreign files."""

    def campaign(folder, together):
        together.wait()
        with Store(folder) as store:
            return store.entries()

    with ThreadPoolExecutor(6) as crew:
        for turn in range(20):
            together = threading.Barrier(6)
            opened = [crew.submit(campaign, tmp_path / f"{turn}", together) for _ in range(6)]
            assert [store.result() for store in opened] == [{}] * 6


def test_a_campaign_takes_over_from_a_dead_one_while_it_runs(tmp_path, counter, undisturbed):
    """Points that another campaign has claimed are waited for until that one is gone."""
    other = Store(tmp_path / "s")
    spec = field_spec()
    with Store(tmp_path / "s") as mine:
        from graindamp.campaign.point import task_of

        tasks = [task_of(spec, f, gamma) for f, gamma in spec.plan.points]
        other.add(tasks)
        for task in tasks[:4]:
            assert other.claim(task.key)
        threading.Timer(0.7, other._owner._file.close).start()  # what the system does when a process dies
        run = run_field(spec, mine, Serial(), how=made)
    assert run.n_computed == N_POINT
    assert len(counted(counter)) == N_POINT
    assert {key: value for key, value in content(run.field)[1].items() if key != "spec"} == {
        key: value for key, value in undisturbed[1].items() if key != "spec"
    }
    other._owner = None
    other.close()


@pytest.mark.slow  # a cluster has to start
def test_a_scheduler_by_its_address(tmp_path, counter, undisturbed):
    distributed = pytest.importorskip("distributed")
    with distributed.LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=":0") as cluster:
        crew = executor_of("dask", address=cluster.scheduler_address)
        assert crew.n_worker == 2
        field, run = field_bytes(tmp_path / "s", tmp_path, crew)
        crew.shutdown()
        assert field == undisturbed
        assert run.n_computed == len(counted(counter)) == N_POINT


@pytest.mark.slow  # jobs have to start
@pytest.mark.filterwarnings("ignore::ResourceWarning")  # the stub never waits for the jobs that it has started
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
def test_jobs_of_a_queue(tmp_path, undisturbed, monkeypatch):
    """SLURM's place is taken by the class of dask-jobqueue that runs jobs on this machine."""
    pytest.importorskip("dask_jobqueue")
    from dask_jobqueue.local import LocalCluster

    from graindamp.campaign.slurm import slurm

    monkeypatch.setenv("PYTHONPATH", str(Path(campaign_made.__file__).parent))
    crew = slurm(2, {"cores": 1, "log_directory": str(tmp_path)}, LocalCluster)
    try:
        assert field_bytes(tmp_path / "s", tmp_path, crew)[0] == undisturbed
    finally:
        crew.shutdown()
        del crew
        gc.collect()  # so that its warnings are ours, not those of the next test


@pytest.mark.slow  # jobs have to start
@pytest.mark.filterwarnings("ignore::ResourceWarning")  # as above
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
def test_a_job_that_ends_is_replaced(tmp_path):
    """Killed with its worker, as by the limit of its time; Dask is told to wait a second for it, not 15."""
    pytest.importorskip("dask_jobqueue")
    import dask
    from dask_jobqueue.local import LocalCluster

    from graindamp.campaign.slurm import slurm

    with dask.config.set({"distributed.deploy.lost-worker-timeout": "1s"}):
        crew = slurm(1, {"cores": 1, "log_directory": str(tmp_path)}, LocalCluster)
        try:
            job, worker = crew.submit(os.getppid).result(timeout=60), crew.submit(os.getpid).result(timeout=60)
            for process in (job, worker):
                os.kill(process, signal.SIGKILL)
            time.sleep(1.0)
            assert crew.submit(os.getpid).result(timeout=60) != worker
        finally:
            crew.shutdown()
            del crew
            gc.collect()  # so that its warnings are ours, not those of the next test
