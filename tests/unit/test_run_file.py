"""Runs and packings survive their files; what is no such file is told."""

import h5py
import numpy as np
import pytest

from graindamp.errors import InputError
from graindamp.report.run_file import load_packing, load_run, save_packing, save_run
from runs_made import made_run


def same(a, b, where="run"):
    """Two values are alike in type of nesting and in every number."""
    if isinstance(a, tuple) and hasattr(a, "_fields"):
        assert type(a) is type(b), where
        for name in a._fields:
            same(getattr(a, name), getattr(b, name), f"{where}.{name}")
    elif isinstance(a, tuple):
        assert len(a) == len(b), where
        for k, (x, y) in enumerate(zip(a, b, strict=True)):
            same(x, y, f"{where}[{k}]")
    elif isinstance(a, np.ndarray):
        assert a.dtype == b.dtype, where
        assert np.array_equal(a, b, equal_nan=a.dtype.kind in "fc"), where
    else:
        assert a == b, where
        assert isinstance(a, type(b)), where


def test_a_run_comes_back_whole(tmp_path):
    run = made_run()
    same(run, load_run(save_run(run, tmp_path / "deep" / "run.h5")))
    assert [path.name for path in (tmp_path / "deep").iterdir()] == ["run.h5"]


def test_a_run_without_cycles_snapshots_or_field(tmp_path):
    run = made_run()._replace(
        frequency=None,
        cycle_force=np.empty(0, complex),
        cycle_velocity=np.empty(0, complex),
        snapshots=(),
        velocity_field=None,
        energy=(),
    )
    run = run._replace(packing=run.packing._replace(lid_height=None, clearance=None))
    same(run, load_run(save_run(run, tmp_path / "run.h5")))


def test_a_packing_comes_back_with_its_description(tmp_path):
    run = made_run()
    stored = load_packing(save_packing(run.packing, run.spec, tmp_path / "bed.npz"))
    same(run.packing, stored.packing)
    assert stored.spec == run.spec


def test_other_files_are_refused(tmp_path):
    with pytest.raises(InputError, match="no such file"):
        load_run(tmp_path / "none.h5")
    text = tmp_path / "text.h5"
    text.write_text("nothing")
    with pytest.raises(InputError, match="damaged"):
        load_run(text)
    with h5py.File(tmp_path / "signals.h5", "w") as file:
        file["force"] = [1.0, 2.0]
    with pytest.raises(InputError, match="is no run file"):
        load_run(tmp_path / "signals.h5")
    with h5py.File(tmp_path / "later.h5", "w") as file:
        file.attrs["format"] = "graindamp-run-99"
    with pytest.raises(InputError, match="graindamp-run-99"):
        load_run(tmp_path / "later.h5")
    np.savez(tmp_path / "other.npz", a=1)
    with pytest.raises(InputError, match="is no packing"):
        load_packing(tmp_path / "other.npz")
    text.rename(tmp_path / "text.npz")
    with pytest.raises(InputError, match="damaged"):
        load_packing(tmp_path / "text.npz")
    with pytest.raises(InputError, match="cannot be opened"):
        load_packing(tmp_path / "none.npz")


def test_a_folder_that_cannot_be_written(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="cannot be written"):
        save_run(made_run(n_snapshot=0), tmp_path / "file" / "run.h5")
