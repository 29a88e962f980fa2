"""MATLAB files of all versions: plain variables, structs, struct arrays; v7.3 as MATLAB lays it out in HDF5."""

from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
import scipy.io

from graindamp.errors import InputError
from graindamp.signals.readers.mat5 import read_mat5
from graindamp.signals.readers.read import read_records

FORCE, VELOCITY = np.array([1.0, -2.0, 3.0, 4.0]), np.array([0.5, 0.25, -0.5, 0.0])


def _v73(path: Path) -> h5py.File:
    """A new HDF5 file with the 512-byte block by which MATLAB 7.3 files begin."""
    file = h5py.File(path, "w", userblock_size=512)
    file.flush()
    return file


def _stamp(path: Path) -> None:
    text = b"MATLAB 7.3 MAT-file, Platform: GLNXA64, Created on: Mon Jan  5 10:00:00 2026 HDF5 schema 1.00 ."
    with open(path, "r+b") as file:
        file.write(text.ljust(116) + b"\0" * 8 + b"\0\2IM")


def _put(group: Any, name: str, value: Any) -> Any:
    """A dataset as MATLAB writes it: two-dimensional, transposed, with its class."""
    if isinstance(value, str):
        dataset = group.create_dataset(name, data=np.array([[ord(c)] for c in value], dtype=np.uint16))
        dataset.attrs["MATLAB_class"] = np.bytes_("char")
    else:
        dataset = group.create_dataset(name, data=np.atleast_2d(value).T)
        dataset.attrs["MATLAB_class"] = np.bytes_("double")
    return dataset


@pytest.mark.parametrize("form", ["4", "5"])
def test_plain_variables(tmp_path: Path, form: str) -> None:
    variables = {"Force": FORCE, "vel": VELOCITY[:, None], "Fs": 1000.0, "container_mass": 0.085, "frequency": 63.0}
    scipy.io.savemat(tmp_path / "run.mat", variables, format=form)
    (record,) = read_records(tmp_path / "run.mat")
    assert record.force.tolist() == FORCE.tolist()
    assert record.motion.tolist() == VELOCITY.tolist()
    assert (record.motion_kind, record.sampling_rate, record.motion_rate) == ("velocity", 1000.0, 1000.0)
    assert (record.frequency, record.container_mass, record.bed_mass) == (63.0, 0.085, None)
    assert (record.label, record.source) == ("run", "run.mat")


def test_units_in_variables_of_text(tmp_path: Path) -> None:
    variables = {"F": FORCE, "F_unit": "kN", "a": VELOCITY, "a_units": "g", "t": np.arange(4) / 1000, "f": "63 Hz"}
    scipy.io.savemat(tmp_path / "run.mat", variables)
    (record,) = read_records(tmp_path / "run.mat")
    assert record.force.tolist() == (1e3 * FORCE).tolist()
    assert record.motion.tolist() == (9.80665 * VELOCITY).tolist()
    assert (record.sampling_rate, record.frequency) == (pytest.approx(1000), 63.0)


def test_struct_and_struct_array(tmp_path: Path) -> None:
    runs = np.zeros(2, dtype=[("force", object), ("velocity", object), ("frequency", object)])
    for i, frequency in enumerate((63.0, 100.0)):
        runs[i] = (FORCE * (i + 1), VELOCITY, frequency)
    single = {"force": FORCE, "velocity": VELOCITY, "fs": 2000.0}
    scipy.io.savemat(tmp_path / "rig.mat", {"runs": runs, "single": single, "fs": 1000.0, "bed_mass": 0.132})
    records = {record.label: record for record in read_records(tmp_path / "rig.mat")}
    assert list(records) == ["runs(1)", "runs(2)", "single"]
    assert records["runs(2)"].force.tolist() == (2 * FORCE).tolist()
    assert records["runs(2)"].source == "rig.mat:runs(2)"
    assert [record.frequency for record in records.values()] == [63.0, 100.0, None]
    assert [record.sampling_rate for record in records.values()] == [1000.0, 1000.0, 2000.0]
    assert {record.bed_mass for record in records.values()} == {0.132}


def test_version_73(tmp_path: Path) -> None:
    path = tmp_path / "run.mat"
    with _v73(path) as file:
        for name, value in {"force": FORCE, "velocity": VELOCITY, "velocity_unit": "mm/s", "fs": 1000.0}.items():
            _put(file, name, value)
        empty = file.create_dataset("comment", data=np.zeros(2, dtype=np.uint64))
        empty.attrs["MATLAB_empty"], empty.attrs["MATLAB_class"] = np.uint8(1), np.bytes_("char")
    _stamp(path)
    (record,) = read_records(path)
    assert record.force.tolist() == FORCE.tolist()
    assert record.motion == pytest.approx(1e-3 * VELOCITY)
    assert record.sampling_rate == 1000.0


def test_struct_array_in_version_73(tmp_path: Path) -> None:
    """MATLAB keeps a struct array as one dataset of references per field, and the elements apart."""
    path = tmp_path / "rig.mat"
    with _v73(path) as file:
        _put(file, "fs", 1000.0)
        runs = file.create_group("runs")
        runs.attrs["MATLAB_class"] = np.bytes_("struct")
        for field, value in {"force": FORCE, "velocity": VELOCITY, "frequency": 63.0, "name": "abc"}.items():
            elements = [_put(file, f"#refs#/{field}{i}", value) for i in range(2)]
            runs.create_dataset(field, data=np.array([[e.ref] for e in elements], dtype=h5py.ref_dtype))
        single = file.create_group("single")
        single.attrs["MATLAB_class"] = np.bytes_("struct")
        _put(single, "force", 2 * FORCE)
        _put(single, "velocity", VELOCITY)
    _stamp(path)
    records = read_records(path)
    assert [record.label for record in records] == ["runs(1)", "runs(2)", "single"]
    assert records[1].frequency == 63.0
    assert records[2].force.tolist() == (2 * FORCE).tolist()


@pytest.mark.parametrize(
    ("variables", "parts"),
    [
        ({"force": FORCE, "velocity": VELOCITY}, ["sampling rate is not told", "variable fs", "sampling_rate ="]),
        ({"a1": FORCE, "b1": VELOCITY, "fs": 1.0}, ["no force channel", "'a1', 'b1'", "[channels] force ="]),
        ({"force": FORCE, "velocity": VELOCITY, "fs": -5.0}, ["'fs' is -5", "> 0"]),
        ({"data": np.ones((4, 3)), "fs": 1.0}, ["no arrays of samples", "data (4x3)", "save("]),
        ({"run": {"force": FORCE, "fs": 1.0}}, ["run.mat: run", "no motion channel"]),
        ({"force": FORCE * 1j, "velocity": VELOCITY, "fs": 1.0}, ["no force channel"]),
    ],
)
def test_mistakes_are_named(tmp_path: Path, variables: dict[str, Any], parts: list[str]) -> None:
    scipy.io.savemat(tmp_path / "run.mat", variables)
    with pytest.raises(InputError) as caught:
        read_records(tmp_path / "run.mat")
    assert all(part in str(caught.value) for part in ["run.mat", *parts])


@pytest.mark.parametrize("share", [0.1, 0.3, 0.5, 0.9])
def test_damaged_files(tmp_path: Path, share: float) -> None:
    path = tmp_path / "run.mat"
    noise = np.random.default_rng(1).normal(size=4000)
    scipy.io.savemat(path, {"force": noise, "velocity": noise, "fs": 1000.0}, do_compression=True)
    whole = path.read_bytes()
    path.write_bytes(whole[: int(share * len(whole))])
    with pytest.raises(InputError, match=r"run\.mat: not a MATLAB file, or damaged .*save it again"):
        read_records(path)


def test_damaged_version_73(tmp_path: Path) -> None:
    path = tmp_path / "run.mat"
    with _v73(path) as file:
        _put(file, "force", FORCE)
    _stamp(path)
    path.write_bytes(path.read_bytes()[:700])
    with pytest.raises(InputError, match=r"run\.mat: not a MATLAB file, or damaged"):
        read_records(path)


@pytest.mark.parametrize("do_compression", [False, True])
def test_variables_are_those_of_scipy(tmp_path: Path, do_compression: bool) -> None:
    rng = np.random.default_rng(1)
    variables = {
        "double": rng.normal(size=(3, 4)),
        "single": rng.normal(size=(1, 5)).astype(np.float32),
        "int16": rng.integers(-99, 99, size=(2, 2, 2)).astype(np.int16),
        "complex": rng.normal(size=(1, 3)) + 1j,
        "logical": np.array([[True, False]]),
        "empty": np.zeros((0, 3)),
        "scalar": np.array([[51200.0]]),
    }
    scipy.io.savemat(tmp_path / "run.mat", variables | {"text": "Kräfte", "u": "kN"}, do_compression=do_compression)
    found = read_mat5((tmp_path / "run.mat").read_bytes())
    assert (found.pop("text"), found.pop("u")) == ("Kräfte", "kN")
    expected = scipy.io.loadmat(tmp_path / "run.mat")
    assert set(found) == set(variables)
    for name, value in found.items():
        np.testing.assert_array_equal(value, expected[name])


def test_big_endian_file(tmp_path: Path) -> None:
    def element(kind: int, body: bytes) -> bytes:
        return kind.to_bytes(4, "big") + len(body).to_bytes(4, "big") + body + b"\0" * (-len(body) % 8)

    def matrix(name: str, values: np.ndarray) -> bytes:
        flags, shape = (6).to_bytes(4, "big") + bytes(4), np.array([1, values.size], dtype=">i4").tobytes()
        parts = [(6, flags), (5, shape), (1, name.encode()), (9, values.astype(">f8").tobytes())]
        return element(14, b"".join(element(*part) for part in parts))

    header = b"MATLAB 5.0 MAT-file".ljust(124) + b"\1\0MI"
    signals = {"force": FORCE, "velocity": VELOCITY, "fs": np.array([1000.0])}
    (tmp_path / "run.mat").write_bytes(header + b"".join(matrix(*item) for item in signals.items()))
    (record,) = read_records(tmp_path / "run.mat")
    assert record.force.tolist() == FORCE.tolist()


def test_no_damaged_byte_ends_in_anything_but_an_input_error(tmp_path: Path) -> None:
    path = tmp_path / "run.mat"
    run = {"force": FORCE, "velocity": VELOCITY, "unit": "N"}
    scipy.io.savemat(path, {"run": run, "fs": 1000.0, "cell": np.array([FORCE, "text"], dtype=object)})
    whole = path.read_bytes()
    n_refused = 0
    for position in range(124, len(whole)):
        value = (0, 5, 14, 255)[position % 4]
        path.write_bytes(whole[:position] + bytes([value]) + whole[position + 1 :])
        try:
            read_records(path)
        except InputError:
            n_refused += 1
    assert n_refused > 50
