"""Campaigns on the GPU, in numba's simulator: the field of the processor, and nothing is lost."""

import numpy as np
import pytest

pytest.importorskip("numba_cuda", reason="the extra `gpu` (numba-cuda) is not installed")

from gpu_made import quick_turns, quick_worker
from graindamp.campaign import device
from graindamp.campaign.executors import Serial, Threads, executor_of
from graindamp.campaign.point import task_of
from graindamp.campaign.run import run_field
from graindamp.campaign.store import Store
from graindamp.dem.gpu import batch, outcome
from graindamp.dem.gpu.load import Describer
from graindamp.errors import InputError
from graindamp.spec.field import FieldSpec
from graindamp.spec.model import parse_spec
from graindamp.status import Status

DAMPER = {
    "particles": [{"material": "steel", "radius": 1e-3}],
    "fill": {"count": 2},
    "container": {"kind": "cylinder", "axis": "x", "radius": 2.6e-3, "length": 6e-3, "material": "aluminium-6060"},
    "contact": {"restitution": 0.6, "friction": 0.2, "softening": 1e4},
    "packing": {"tap": {"max_cycles": 1}},
}
POINTS = [(1500.0, 2200.0), (1400.0, 1800.0)]
"""Strokes of 0.24 mm at 2 m/s: the balls meet the ends and each other. 40 steps in a cycle."""
SPEC = parse_spec(
    {
        "damper": DAMPER,
        "plan": {"kind": "list", "points": POINTS},
        "stop": {"min_cycles": 8, "max_cycles": 9, "tolerance": 0.9},
        "steps_per_contact": 10,
    },
    FieldSpec,
    "test",
)
ROUNDING = 1e-6
"""Double precision has 1e-16; each of some ten collisions in a row magnifies it by up to ten."""


@pytest.fixture(autouse=True, scope="module")
def quick():
    """One simulated thread per block, which waits for nobody."""
    with pytest.MonkeyPatch.context() as patch, quick_turns():
        patch.setattr(batch, "SIMULATED_THREADS", 1)
        patch.setattr(batch, "FIRST_CHUNK", 80)  # so that a launch ends soon after Ctrl-C
        yield


def run(folder, crew=None, backend="cuda-double", **more):
    """The field of a store, and what it took to complete it."""
    crew = crew or Threads(None)
    try:
        with Store(folder / "s") as opened:
            return run_field(SPEC, opened, crew, backend=backend, **more)
    except BaseException:
        crew.shutdown(now=True)
        raise
    finally:
        crew.shutdown()


def states(folder):
    """States of the points of a store, sorted."""
    with Store(folder / "s") as opened:
        return sorted(entry.state for entry in opened.entries().values())


def key(k, backend="cuda-double"):
    return task_of(SPEC, *POINTS[k], backend=backend).key


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("gpu")


@pytest.fixture(scope="module")
def whole(folder):
    """The field on the GPU, computed in a store of its own."""
    return run(folder)


@pytest.mark.slow
def test_the_field_is_that_of_the_processor(folder, whole):
    """Every back end has its points in the store; none stands in for another's."""
    cpu = run(folder, Serial(), "cpu")
    assert whole.n_computed == cpu.n_computed == len(POINTS)
    for name in set(cpu.field) - {"motion_mode"}:
        np.testing.assert_allclose(whole.field[name], cpu.field[name], rtol=ROUNDING, atol=1e-9, err_msg=name)
    assert np.all(whole.field["loss_share_normal_wall"] > 0.0)
    assert np.all(whole.field["loss_share_normal"] > 0.0)
    assert (cpu.field.attrs["backend"], cpu.field.attrs["precision"]) == ("cpu", "double")
    assert (whole.field.attrs["backend"], whole.field.attrs["precision"]) == ("cuda", "double")
    with Store(folder / "s") as opened:
        assert len(opened.entries()) == 2 * len(POINTS)
        one, other = opened.load(key(0)), opened.load(key(0, "cpu"))
    assert one.n_cycles + one.n_skipped == other.n_cycles + other.n_skipped
    np.testing.assert_allclose(one.end_position, other.end_position, rtol=0, atol=1e-9)
    np.testing.assert_allclose(one.losses, other.losses, rtol=1e-5, atol=1e-12)


@pytest.mark.slow
def test_what_is_done_needs_no_gpu(folder, whole, monkeypatch):
    def none(gpu=True):
        raise InputError("no GPU")

    monkeypatch.setattr(batch, "require", none)
    again = run(folder)
    assert again.n_computed == 0
    assert again.field.identical(whole.field)
    with pytest.raises(InputError, match="no GPU"):
        run(folder, backend="cuda-mixed")


@pytest.mark.slow
def test_ctrl_c_and_a_failing_gpu_cost_no_point_that_is_done(tmp_path, whole, monkeypatch):
    def interrupted(outlook):
        if outlook.n_running == len(POINTS):
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run(tmp_path, watch=interrupted)
    assert states(tmp_path) == ["queued", "queued"]
    run_of, n_ended = batch.run_of, 0

    def fails(*arguments):
        nonlocal n_ended
        n_ended += 1
        if n_ended > 1:
            raise RuntimeError("CUDA_ERROR_LAUNCH_FAILED")
        return run_of(*arguments)

    with monkeypatch.context() as patch:
        patch.setattr(batch, "run_of", fails)
        with pytest.raises(InputError, match=r"CUDA_ERROR_LAUNCH_FAILED.*what was done is kept"):
            run(tmp_path)
    assert states(tmp_path) == ["done", "queued"]
    again = run(tmp_path)
    assert again.n_computed == 1
    assert again.field.identical(whole.field)


@pytest.mark.slow
def test_a_failing_world_leaves_the_others_alone(tmp_path, monkeypatch):
    """One that loses a particle is done, with its status and no value; one that cannot be described has failed."""
    described = Describer.described

    def refuse(self, spec, *rest):
        if spec.base_frequency == POINTS[0][0]:
            raise InputError("the bed is crooked")
        return described(self, spec, *rest)

    monkeypatch.setattr(Describer, "described", refuse)
    monkeypatch.setattr(outcome, "_lost", lambda world, position: True)
    with pytest.raises(InputError, match=r"not one point.*\n1500 Hz, 2200, bed 0: the bed is crooked"):
        run(tmp_path)
    assert states(tmp_path) == ["done", "failed"]
    with Store(tmp_path / "s") as opened:
        lost = opened.load(key(1))
    assert lost.failed
    assert lost.status & Status.PARTICLE_LOST
    assert np.isnan(lost.loss_factor)


def test_a_world_that_does_not_fit_alone_fails_alone(tmp_path, monkeypatch):
    def full(shape, kind):
        raise MemoryError

    monkeypatch.setattr("graindamp.dem.gpu.memory._empty", full)
    with pytest.raises(InputError, match=r"not one point.*\n.*does not fit the GPU"):
        run(tmp_path)
    assert states(tmp_path) == ["failed", "failed"]


@pytest.mark.slow  # a cluster has to start
def test_each_worker_of_a_cluster_has_its_gpu(tmp_path, whole):
    """Two workers in place of two GPUs; each makes a batch of what its threads hold."""
    distributed = pytest.importorskip("distributed")
    with distributed.LocalCluster(n_workers=2, threads_per_worker=2, dashboard_address=":0") as cluster:
        with distributed.Client(cluster) as client:
            client.run(quick_worker)
        crew = executor_of("dask", address=cluster.scheduler_address, on_device=True)
        assert crew.n_worker == 4
        found = run(tmp_path, crew)
    assert found.n_computed == len(POINTS)
    np.testing.assert_allclose(found.field["loss_factor"], whole.field["loss_factor"], rtol=ROUNDING)


def test_workers_without_a_gpu_are_refused(monkeypatch):
    distributed = pytest.importorskip("distributed")
    monkeypatch.setattr(device, "missing", lambda: "no GPU")
    with (
        distributed.LocalCluster(n_workers=1, processes=False, dashboard_address=":0") as cluster,
        pytest.raises(InputError, match=r"1 workers cannot compute on a GPU.*no GPU"),
    ):
        executor_of("dask", address=cluster.scheduler_address, on_device=True)
