"""Universal files: ASCII and binary, units, signs, pairing, and the stray bytes of front ends."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import pyuff

from graindamp.errors import InputError
from graindamp.signals.readers.read import read_records
from graindamp.signals.record import Record
from graindamp.spec.measurement import ChannelsSpec

# pyuff's writer of binary datasets leaves its text handle to the garbage collector.
pytestmark = pytest.mark.filterwarnings("ignore:.*run.uff:pytest.PytestUnraisableExceptionWarning")

FORCE = np.array([1.0, -2.0, 3.0, 4.5, 0.25])
VELOCITY = np.array([0.5, 0.25, -0.5, 0.125, 1.0])
FORCE_TYPE, VELOCITY_TYPE, ACCELERATION_TYPE, DISPLACEMENT_TYPE = 13, 11, 12, 8


def _dataset(kind: int, data: np.ndarray, **changes: Any) -> dict[str, Any]:
    times = np.arange(len(data)) / 1000.0
    return {
        "type": 58,
        "binary": 0,
        "func_type": 1,
        "id1": "Container",
        "rsp_node": 1,
        "rsp_dir": 1,
        "ref_node": 1,
        "ref_dir": 1,
        "data": data,
        "x": times,
        "abscissa_spacing": 1,
        "abscissa_spec_data_type": 17,
        "ordinate_spec_data_type": kind,
        "orddenom_spec_data_type": 0,
    } | changes


def _write(tmp_path: Path, *datasets: dict[str, Any]) -> Path:
    path = tmp_path / "run.uff"
    path.unlink(missing_ok=True)
    for dataset in datasets:
        pyuff.UFF(str(path)).write_sets(dict(dataset), "add")
    return path


def _read(path: Path, **options: object) -> Record:
    (record,) = read_records(path, ChannelsSpec.model_validate(options))
    return record


@pytest.mark.parametrize("binary", [0, 1])
def test_a_pair(tmp_path: Path, binary: int) -> None:
    path = _write(
        tmp_path, _dataset(VELOCITY_TYPE, VELOCITY, binary=binary), _dataset(FORCE_TYPE, FORCE, binary=binary)
    )
    record = _read(path)
    assert record.force.tolist() == FORCE.tolist()
    assert record.motion.tolist() == VELOCITY.tolist()
    assert (record.motion_kind, record.sampling_rate, record.motion_rate) == ("velocity", 1000.0, 1000.0)
    assert (record.label, record.source) == ("run", "run.uff:records 2 and 1")


def test_uneven_spacing_and_single_precision(tmp_path: Path) -> None:
    force = _dataset(FORCE_TYPE, FORCE, abscissa_spacing=0)
    path = _write(tmp_path, force, _dataset(VELOCITY_TYPE, VELOCITY))
    assert _read(path).sampling_rate == pytest.approx(1000)
    pyuff.UFF(str(path)).write_sets(_dataset(FORCE_TYPE, FORCE, ord_data_type=2), "overwrite", force_double=False)
    pyuff.UFF(str(path)).write_sets(_dataset(VELOCITY_TYPE, VELOCITY), "add")
    assert _read(path).force.tolist() == FORCE.tolist()


def test_rates_differ(tmp_path: Path) -> None:
    slow = _dataset(VELOCITY_TYPE, VELOCITY, x=np.arange(5) / 500.0)
    record = _read(_write(tmp_path, _dataset(FORCE_TYPE, FORCE), slow))
    assert (record.sampling_rate, record.motion_rate) == (1000.0, 500.0)


def test_negative_direction_is_turned(tmp_path: Path) -> None:
    path = _write(tmp_path, _dataset(FORCE_TYPE, FORCE, rsp_dir=-3), _dataset(VELOCITY_TYPE, VELOCITY, rsp_dir=3))
    record = _read(path)
    assert record.force.tolist() == (-FORCE).tolist()
    assert record.motion.tolist() == VELOCITY.tolist()
    assert _read(path, force_sign=-1).force.tolist() == FORCE.tolist()


UNITS_MM = {
    "type": 164,
    "units_code": 5,
    "units_description": "mm (milli newton)",
    "temp_mode": 1,
    "length": 1000.0,
    "force": 1000.0,
    "temp": 1.0,
    "temp_offset": 0.0,
}


@pytest.mark.parametrize(
    ("label", "has_units_dataset", "factor"),
    [("NONE", False, 1), ("g", False, 9.80665), ("EU", False, 1), ("NONE", True, 1e-3), ("m/s2", True, 1)],
)
def test_label_before_units_dataset_before_si(
    tmp_path: Path, label: str, has_units_dataset: bool, factor: float
) -> None:
    motion = _dataset(ACCELERATION_TYPE, VELOCITY, ordinate_axis_units_lab=label)
    path = _write(tmp_path, *[UNITS_MM] * has_units_dataset, _dataset(FORCE_TYPE, FORCE), motion)
    record = _read(path)
    assert record.motion == pytest.approx(factor * VELOCITY)
    assert record.force == pytest.approx(FORCE * (1e-3 if has_units_dataset else 1))


def test_label_of_another_kind_is_named(tmp_path: Path) -> None:
    force = _dataset(FORCE_TYPE, FORCE, ordinate_axis_units_lab="V")
    path = _write(tmp_path, force, _dataset(VELOCITY_TYPE, VELOCITY))
    with pytest.raises(InputError, match=r"records 1 and 2: channel 'Container' is in 'V'.*force_unit"):
        read_records(path)
    assert _read(path, force_unit="kN").force.tolist() == (1e3 * FORCE).tolist()


def test_type_unknown_but_label_and_unit_tell(tmp_path: Path) -> None:
    force = _dataset(0, FORCE, id1="NONE", ordinate_axis_lab="Kraft", ordinate_axis_units_lab="N")
    motion = _dataset(1, VELOCITY, id1="Channel 2", ordinate_axis_units_lab="mm/s")
    record = _read(_write(tmp_path, force, motion))
    assert record.motion == pytest.approx(1e-3 * VELOCITY)


def _pair(scale: float, **changes: Any) -> list[dict[str, Any]]:
    return [
        _dataset(FORCE_TYPE, scale * FORCE, **changes),
        _dataset(DISPLACEMENT_TYPE, scale * VELOCITY, **changes),
    ]


@pytest.mark.parametrize("order", [[0, 1, 2, 3], [0, 2, 1, 3], [0, 2, 3, 1], [3, 0, 1, 2]])
def test_pairs_by_id_lines_in_any_order(tmp_path: Path, order: list[int]) -> None:
    datasets = [*_pair(1, id2="63 Hz"), *_pair(2, id2="100 Hz")]
    records = read_records(_write(tmp_path, *(datasets[i] for i in order)))
    for record in records:
        np.testing.assert_allclose(record.motion / VELOCITY, (record.force / FORCE))
    assert [record.label for record in records] == ["run:1", "run:2"]


def test_pairs_by_node_and_by_order(tmp_path: Path) -> None:
    one, two = _pair(1, rsp_node=1), _pair(2, rsp_node=2)
    for record in read_records(_write(tmp_path, one[0], two[0], two[1], one[1])):
        np.testing.assert_allclose(record.motion / VELOCITY, record.force / FORCE)
    one, two = _pair(1), _pair(2)
    for record in read_records(_write(tmp_path, one[0], two[0], one[1], two[1])):
        np.testing.assert_allclose(record.motion / VELOCITY, record.force / FORCE)


def test_the_motion_at_the_node_of_the_force(tmp_path: Path) -> None:
    other = _dataset(VELOCITY_TYPE, 9 * VELOCITY, rsp_node=7)
    path = _write(tmp_path, other, _dataset(FORCE_TYPE, FORCE), _dataset(VELOCITY_TYPE, VELOCITY))
    assert _read(path).motion.tolist() == VELOCITY.tolist()


def test_motion_of_two_kinds(tmp_path: Path) -> None:
    path = _write(
        tmp_path,
        _dataset(FORCE_TYPE, FORCE, id1="Load cell"),
        _dataset(VELOCITY_TYPE, VELOCITY, id1="Laser"),
        _dataset(ACCELERATION_TYPE, 2 * VELOCITY, id1="Sensor"),
    )
    with pytest.raises(InputError, match=r"1 force and 2 motion records do not pair.*3 'Sensor'.*motion_kind"):
        read_records(path)
    assert _read(path, motion_kind="acceleration").motion.tolist() == (2 * VELOCITY).tolist()
    assert _read(path, motion="Laser").motion.tolist() == VELOCITY.tolist()


def test_different_axes_pair_only_when_named(tmp_path: Path) -> None:
    path = _write(
        tmp_path,
        _dataset(FORCE_TYPE, FORCE, id1="Load cell", rsp_dir=1),
        _dataset(VELOCITY_TYPE, VELOCITY, id1="Laser", rsp_dir=3),
    )
    with pytest.raises(InputError, match=r"different axes: 1 'Load cell' \(force, node 1, axis 1\), 2 'Laser'"):
        read_records(path)
    assert _read(path, force="Load cell", motion="Laser").force.tolist() == FORCE.tolist()


@pytest.mark.parametrize(
    ("old", "new"),
    [
        (b"\n", b"\r\n"),
        (b"\n", b"\0\n"),
        (b"\n", b"   \n"),
        (b"    -1\n    58", b"\0\0    -1\n    58"),
        (b"    -1\n    58", b"\n    -1" + b" " * 74 + b"\n    58"),
    ],
)
def test_stray_bytes_in_text(tmp_path: Path, old: bytes, new: bytes) -> None:
    path = _write(tmp_path, _dataset(FORCE_TYPE, FORCE), _dataset(VELOCITY_TYPE, VELOCITY))
    path.write_bytes(path.read_bytes().replace(old, new))
    record = _read(path)
    assert record.force.tolist() == FORCE.tolist()
    assert record.motion.tolist() == VELOCITY.tolist()


@pytest.mark.parametrize("stray", [b"\n", b"\r\n", b"\0" * 16, b"\0\0\0\r\n"])
def test_stray_bytes_after_binary_numbers(tmp_path: Path, stray: bytes) -> None:
    datasets = [_dataset(FORCE_TYPE, FORCE, binary=1), _dataset(VELOCITY_TYPE, VELOCITY, binary=1)]
    path = _write(tmp_path, *datasets)
    whole = path.read_bytes()
    end = FORCE.tobytes() + b"    -1"
    assert end in whole
    path.write_bytes(whole.replace(end, FORCE.tobytes() + stray + b"    -1"))
    assert _read(path).force.tolist() == FORCE.tolist()


def test_other_datasets_are_passed_over(tmp_path: Path) -> None:
    """A dataset line that ends in -1 is no delimiter, and functions of frequency are no time records."""
    path = _write(
        tmp_path,
        _dataset(4, FORCE + 0j, func_type=4, abscissa_spec_data_type=18),
        _dataset(FORCE_TYPE, FORCE),
        _dataset(VELOCITY_TYPE, VELOCITY),
    )
    nodes = b"    -1\n  2411\n         1         0         0        -1\n   0.0   0.0   0.0\n    -1\n"
    path.write_bytes(nodes + path.read_bytes())
    assert _read(path).source == "run.uff:records 2 and 3"


def test_missing_partners_and_rates(tmp_path: Path) -> None:
    path = _write(tmp_path, _dataset(FORCE_TYPE, FORCE))
    with pytest.raises(InputError, match=r"run\.uff: no motion channel is recognised.*'Container'"):
        read_records(path)
    frf = _dataset(4, FORCE + 0j, func_type=4, abscissa_spec_data_type=18)
    with pytest.raises(InputError, match=r"no time records .*frequency response functions"):
        read_records(_write(tmp_path, frf))
    still = np.zeros(5)
    path = _write(tmp_path, _dataset(FORCE_TYPE, FORCE, x=still), _dataset(VELOCITY_TYPE, VELOCITY, x=still))
    with pytest.raises(InputError, match=r"sampling rate is not told.*abscissa increment.*sampling_rate ="):
        read_records(path)
    assert _read(path, sampling_rate=1000.0).motion_rate == 1000.0


def test_damaged_files(tmp_path: Path) -> None:
    path = _write(tmp_path, _dataset(FORCE_TYPE, FORCE), _dataset(VELOCITY_TYPE, VELOCITY))
    whole = path.read_bytes()
    path.write_bytes(whole[:-40])
    with pytest.raises(InputError, match=r"dataset 58 at byte \d+: has no end.*cut off"):
        read_records(path)
    path.write_bytes(whole.replace(b"         4         5         1", b"         4        50         1"))
    with pytest.raises(InputError, match=r"record 1 'Container': announces 50 values, holds 5"):
        read_records(path)
    path.write_bytes(whole.replace(b"4.50000", b"x.50000"))
    with pytest.raises(InputError, match=r"dataset 58, record 1: its header or numbers do not follow the format"):
        read_records(path)
    path = _write(tmp_path, _dataset(FORCE_TYPE, FORCE, binary=1), _dataset(VELOCITY_TYPE, VELOCITY, binary=1))
    path.write_bytes(path.read_bytes()[:-20])
    with pytest.raises(InputError, match=r"no end after 40 bytes of numbers"):
        read_records(path)
