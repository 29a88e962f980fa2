"""HDF5 files: groups of runs, attributes at any level, odd and damaged files."""

from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from graindamp.errors import InputError
from graindamp.signals.readers.read import read_records
from graindamp.spec.measurement import ChannelsSpec

FORCE, VELOCITY = np.array([1.0, -2.0, 3.0, 4.0]), np.array([0.5, 0.25, -0.5, 0.0])


def _fill(group: Any, **attributes: object) -> Any:
    group["force"], group["velocity"] = FORCE, VELOCITY
    group.attrs.update(attributes)
    return group


def test_groups_are_runs_in_natural_order(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "rig.h5", "w") as file:
        file.attrs.update({"container_mass_kg": 0.085, "bed_mass_kg": 0.132, "sampling_rate_hz": 1000.0})
        for name in ("f100_G16", "f63_G16", "f63_G2.5", "empty_f63"):
            _fill(file.create_group(name), frequency_hz=63.0, nominal_intensity=2.5)
    records = read_records(tmp_path / "rig.h5")
    assert [record.label for record in records] == ["empty_f63", "f63_G2.5", "f63_G16", "f100_G16"]
    assert [record.is_empty for record in records] == [True, False, False, False]
    first = records[1]
    assert first.source == "rig.h5:f63_G2.5"
    assert first.force.tolist() == FORCE.tolist()
    assert first.motion.tolist() == VELOCITY.tolist()
    assert (first.sampling_rate, first.frequency, first.nominal_intensity) == (1000.0, 63.0, 2.5)
    assert (first.container_mass, first.bed_mass) == (0.085, 0.132)


def test_datasets_at_the_root(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "rig.hdf5", "w") as file:
        _fill(file, fs="1 kHz", Frequency=np.array([63.0]))
    (record,) = read_records(tmp_path / "rig.hdf5")
    assert (record.label, record.source, record.sampling_rate, record.frequency) == ("rig", "rig.hdf5", 1000.0, 63.0)


def test_the_nearest_fact_counts(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "rig.h5", "w") as file:
        file.attrs.update({"fs": 1000.0, "bed_mass_kg": 0.1})
        _fill(file.create_group("day/one"))
        _fill(file.create_group("day/two"), fs=2000.0)
        file["day"].attrs["bed_mass"] = "200 g"
    one, two = read_records(tmp_path / "rig.h5")
    assert (one.label, two.label) == ("day/one", "day/two")
    assert (one.sampling_rate, two.sampling_rate) == (1000.0, 2000.0)
    assert one.bed_mass == two.bed_mass == 0.2


def test_units_rates_lengths_and_shapes_of_datasets(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "rig.h5", "w") as file:
        run = file.create_group("run")
        run["force"] = np.array([[1, 2, 3]], dtype=np.int16)
        run["acceleration"] = np.ones((5, 1), dtype=np.float32)
        run["force"].attrs.update({"units": np.bytes_("kN"), "sampling_rate_hz": 1000.0})
        run["acceleration"].attrs.update({"unit": "g", "sampling_rate_hz": 500.0})
        run.attrs["empty"] = True
    (record,) = read_records(tmp_path / "rig.h5")
    assert record.force.tolist() == [1e3, 2e3, 3e3]
    assert record.motion.tolist() == [9.80665] * 5  # lengths differ; the analysis names that
    assert (record.motion_kind, record.sampling_rate, record.motion_rate) == ("acceleration", 1000.0, 500.0)
    assert record.is_empty
    (record,) = read_records(tmp_path / "rig.h5", ChannelsSpec(sampling_rate=2000.0))
    assert (record.sampling_rate, record.motion_rate) == (2000.0, 1000.0)  # two rates stay two rates


def test_time_dataset_and_scalar_datasets(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "rig.h5", "w") as file:
        _fill(file)
        file["time"] = np.arange(4) / np.float32(51200)
        file["bed_mass"] = 0.132
    (record,) = read_records(tmp_path / "rig.h5")
    assert record.sampling_rate == pytest.approx(51200, rel=1e-6)  # times in single precision
    assert record.bed_mass == 0.132


def test_other_groups_and_links_up_are_passed_over(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "rig.h5", "w") as file:
        _fill(file.create_group("run"), sampling_rate_hz=1000.0)
        file["run/back"] = file["/"]
        file["run/gone"] = h5py.SoftLink("/nowhere")
        file["calibration/table"] = np.ones((4, 2))
        file["calibration/values"] = np.arange(4.0)
        file["calibration/words"] = "text"
    (record,) = read_records(tmp_path / "rig.h5")
    assert record.label == "run"


def test_names_of_the_description(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "rig.h5", "w") as file:
        file["run/ai0"], file["run/ai1"] = FORCE, VELOCITY
    spec = ChannelsSpec(force="ai0", motion="ai1", motion_kind="velocity", sampling_rate=1000.0)
    (record,) = read_records(tmp_path / "rig.h5", spec)
    assert record.force.tolist() == FORCE.tolist()


@pytest.mark.parametrize(
    ("names", "attributes", "parts"),
    [
        (["force", "velocity"], {}, ["group /run", "sampling rate is not told", "attribute sampling_rate_hz"]),
        (["ai0", "ai1"], {"fs": 1.0}, ["group /run", "no force", "no motion", "'ai0', 'ai1'"]),
        (["force", "velocity", "acceleration"], {"fs": 1.0}, ["2 channels may be the motion", "'acceleration'"]),
        (["velocity"], {"fs": 1.0}, ["group /run", "no force channel"]),
        (["force", "velocity"], {"fs": -1.0}, ["'fs' is -1.0; it must be finite and > 0"]),
        (["force", "velocity"], {"fs": "fast"}, ["group /run", "'fs' is 'fast'", "no number"]),
        ([], {}, ["holds no signals"]),
    ],
)
def test_mistakes_are_named(tmp_path: Path, names: list[str], attributes: dict[str, Any], parts: list[str]) -> None:
    with h5py.File(tmp_path / "rig.h5", "w") as file:
        run = file.create_group("run")
        run.attrs.update(attributes)
        for name in names:
            run[name] = FORCE
    with pytest.raises(InputError) as caught:
        read_records(tmp_path / "rig.h5")
    assert all(part in str(caught.value) for part in ["rig.h5", *parts])


def test_damaged_files(tmp_path: Path) -> None:
    path = tmp_path / "rig.h5"
    with h5py.File(path, "w") as file:
        file.create_dataset("force", data=np.random.default_rng(1).normal(size=4000), compression="gzip")
        file["velocity"], file.attrs["fs"] = np.ones(4000), 1000.0
    whole = path.read_bytes()
    path.write_bytes(whole[: len(whole) // 2])
    with pytest.raises(InputError, match=r"rig\.h5: not an HDF5 file, or damaged"):
        read_records(path)
    holed = bytearray(whole)
    holed[len(whole) // 4 : len(whole) // 4 + 200] = b"\xff" * 200
    path.write_bytes(bytes(holed))
    with pytest.raises(InputError, match=r"rig\.h5: not an HDF5 file, or damaged"):
        read_records(path)
