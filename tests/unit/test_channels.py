"""Recognition of channels, their units and the options that correct them; the choice of the reader."""

import os
from pathlib import Path

import h5py
import numpy as np
import pytest
import pyuff
import scipy.io

from graindamp.errors import InputError
from graindamp.signals.readers.channels import Channel, choose, named_channel, si_values
from graindamp.signals.readers.facts import read_fact
from graindamp.signals.readers.kinds import split_unit, unit_factor
from graindamp.signals.readers.read import read_records
from graindamp.spec.measurement import ChannelsSpec


@pytest.mark.parametrize(
    ("name", "kind", "unit"),
    [
        ("Force [N]", "force", "N"),
        ("Force [kN] (filtered)", "force", "kN"),
        ("Kraftsignal (kN)", "force", "kN"),
        ("F / N", "force", "N"),
        ("F in N", "force", "N"),
        ("F(t) [N]", "force", "N"),
        ("force_z_n", "force", "n"),
        ("Force (Ch1)", "force", None),
        ("Fz", "force", None),
        ("Velocity mm/s", "velocity", "mm/s"),
        ("velocity_mm_s", "velocity", "mm/s"),
        ("Schwinggeschwindigkeit [mm/s]", "velocity", "mm/s"),
        ("VEL", "velocity", None),
        ("Behälterbeschleunigung [m/s²]", "acceleration", "m/s²"),
        ("a_x", "acceleration", None),
        ("a_g", "acceleration", "g"),
        ("Weg [µm]", "displacement", "µm"),
        ("Displacement", "displacement", None),
        ("Zeit [ms]", "time", "ms"),
        ("Time", "time", None),
        ("Ch1 [N]", "force", "N"),
        ("Ch2 [in/s]", "velocity", "in/s"),
        ("x [mm/s]", "velocity", "mm/s"),  # a unit is stronger than a letter
        ("T", None, None),
        ("t [°C]", None, "°C"),
        ("Current [A]", None, "A"),
        ("Channel A", None, None),
        ("Drive frequency", None, None),
    ],
)
def test_name_and_unit_tell_the_kind(name: str, kind: str | None, unit: str | None) -> None:
    channel = named_channel(name, [0.0])
    assert (channel.kind, channel.unit) == (kind, unit)


@pytest.mark.parametrize(
    ("unit", "si", "factor"),
    [
        ("mm/s", "m/s", 1e-3),
        ("[MM/S]", "m/s", 1e-3),
        ("in/s", "m/s", 0.0254),
        ("ips", "m/s", 0.0254),
        ("kN", "N", 1e3),
        ("lbf", "N", 4.4482216152605),
        ("kp", "N", 9.80665),
        ("g", "m/s^2", 9.80665),
        ("G", "m/s^2", 9.80665),
        ("g_n", "m/s^2", 9.80665),
        ("m/s2", "m/s^2", 1.0),
        ("m/s**2", "m/s^2", 1.0),
        ("m·s⁻²", "m/s^2", 1.0),
        ("mm s-2", "m/s^2", 1e-3),
        ("um", "m", 1e-6),
        ("μm", "m", 1e-6),
        ("g", "kg", 1e-3),
        ("ms", "s", 1e-3),
        ("kHz", "Hz", 1e3),
        ("rpm", "Hz", 1 / 60),
    ],
)
def test_unit_factor(unit: str, si: str, factor: float) -> None:
    assert unit_factor(unit, si) == pytest.approx(factor, rel=1e-14)  # the last place of a quotient may differ


@pytest.mark.parametrize(
    ("unit", "si"),
    [("V", "N"), ("kg", "N"), ("A", "s"), ("rad/s", "Hz"), ("m^9^9^9", "m"), ("furlong/foo", "m/s"), ("5 m", "m")],
)
def test_other_units_are_no_unit(unit: str, si: str) -> None:
    assert unit_factor(unit, si) is None


def test_brackets_without_a_unit_tell_none() -> None:
    assert split_unit("Gamma [-]") == ("Gamma", None)
    assert split_unit("Force/Velocity") == ("Force/Velocity", None)


@pytest.mark.parametrize(
    ("key", "value", "fact", "si"),
    [
        ("Sampling rate [Hz]", "39215,686", "sampling_rate", 39215.686),
        ("fs", "51.2 kHz", "sampling_rate", 51200.0),
        ("dt", "25 us", "sampling_rate", 40000.0),
        ("sampling_rate_hz", np.float64(1000), "sampling_rate", 1000.0),
        ("Anregungsfrequenz / Hz", "100", "frequency", 100.0),
        ("frequency_hz", "1.234,5", "frequency", 1234.5),
        ("container_mass_kg", np.array([[0.085]]), "container_mass", 0.085),
        ("Behältermasse [g]", "85", "container_mass", 0.085),
        ("Bed mass", "132.4 g", "bed_mass", 0.1324),
        ("Gamma", 2.5, "nominal_intensity", 2.5),
        ("Intensity", "24.516625 m/s^2", "nominal_intensity", 2.5),
    ],
)
def test_facts_under_their_many_names(key: str, value: object, fact: str, si: float) -> None:
    assert read_fact(key, value, "run.csv") == {fact: pytest.approx(si, rel=1e-14)}


def test_what_is_no_fact_or_left_open_tells_nothing() -> None:
    assert read_fact("Operator", "Miller", "run.csv") == {}
    assert read_fact("Frequency range", "20-200 Hz", "run.csv") == {}
    assert read_fact("Bed mass", " - ", "run.csv") == {}


@pytest.mark.parametrize(
    ("key", "value", "parts"),
    [
        ("fs", "fast", ["run.csv", "'fs'", "'fast'", "no number", "[Hz]"]),
        ("fs", 0.0, ["'fs' is 0", "> 0"]),
        ("Bed mass", -1, ["'Bed mass' is -1", ">= 0"]),
        ("Bed mass", "12 mm", ["'mm'", "no unit of bed mass", "[kg]"]),
        ("Intensity", "3 kg", ["no unit of nominal intensity"]),
        ("fs", "51,200", ["51200 or 51.200", "thousands"]),
        ("fs", [1.0, 2.0], ["no number"]),
    ],
)
def test_unusable_facts_are_named(key: str, value: object, parts: list[str]) -> None:
    with pytest.raises(InputError) as caught:
        read_fact(key, value, "run.csv")
    assert all(part in str(caught.value) for part in parts)


def _channels(*names: str) -> list[Channel]:
    return [named_channel(name, np.arange(3.0)) for name in names]


def test_a_name_counts_before_a_unit() -> None:
    force, motion, kind = choose(_channels("Time [s]", "Preload [V]", "Ch3 [N]", "Force [N]", "v [m/s]"), _spec(), "f")
    assert (force.name, motion.name, kind) == ("Force [N]", "v [m/s]", "velocity")


def _spec(**options: object) -> ChannelsSpec:
    return ChannelsSpec.model_validate(options)


@pytest.mark.parametrize(
    ("names", "options", "expected"),
    [
        (["Force 1", "Force 2", "v"], {"force": "Force 2"}, ("Force 2", "v", "velocity")),
        (["Force 1 [N]", "Force 2 [N]", "v"], {"force": "force 2"}, ("Force 2 [N]", "v", "velocity")),
        (["Force", "v", "a"], {"motion_kind": "acceleration"}, ("Force", "a", "acceleration")),
        (["Force", "v", "a"], {"motion": "v"}, ("Force", "v", "velocity")),
        (["F", "Ch2"], {"motion": "Ch2", "motion_kind": "displacement"}, ("F", "Ch2", "displacement")),
        (["F", "Ch2"], {"motion": "Ch2", "motion_unit": "mm/s"}, ("F", "Ch2", "velocity")),
        (["F", "Load cell"], {"motion": "Load cell", "motion_kind": "velocity"}, ("F", "Load cell", "velocity")),
    ],
)
def test_options_settle_what_names_do_not(
    names: list[str], options: dict[str, object], expected: tuple[str, str, str]
) -> None:
    force, motion, kind = choose(_channels(*names), _spec(**options), "run.csv")
    assert (force.name, motion.name, kind) == expected


@pytest.mark.parametrize(
    ("names", "options", "parts"),
    [
        (["F1 [N]", "F2 [N]", "v"], {}, ["2 channels may be the force", "'F1 [N]', 'F2 [N]'", "[channels] force ="]),
        (["Force", "v", "a"], {}, ["2 channels may be the motion", "'v', 'a'", "motion_kind"]),
        (["Ch1", "v"], {}, ["no force channel", "Channels found: 'Ch1', 'v'", "force ="]),
        (["Force", "Ch2 [V]"], {}, ["no motion channel", "'Ch2 [V]' in V", "motion ="]),
        (["Ch1", "Ch2"], {}, ["no force", "no motion"]),
        (["Force", "v"], {"force": "Forse"}, ["no channel is called 'Forse' (the force)", "nearest is 'Force'"]),
        (["F", "F", "v"], {"force": "F"}, ["2 channels are called 'F'"]),
        (["Force", "Ch2"], {"motion": "Ch2"}, ["what 'Ch2' measures is not told", "motion_kind"]),
        (["Force", "v"], {"motion_kind": "displacement"}, ["no displacement channel is recognised"]),
        (["Force", "v"], {"force": "v", "motion": "v"}, ["chosen for both"]),
    ],
)
def test_doubt_is_one_error_that_lists_the_channels(
    names: list[str], options: dict[str, object], parts: list[str]
) -> None:
    with pytest.raises(InputError) as caught:
        choose(_channels(*names), _spec(**options), "run.csv")
    assert all(part in str(caught.value) for part in ["run.csv: ", *parts])


def test_unit_of_another_kind_is_named_with_its_remedy() -> None:
    force = named_channel("Force [V]", np.ones(3))
    with pytest.raises(InputError, match=r"'Force \[V\]' is in 'V', which is no unit of force.*force_unit = \"N\""):
        si_values(force, "force", None, "force_unit", "run.csv")
    with pytest.raises(InputError, match="the description gives force_unit = 'mm'"):
        si_values(force, "force", "mm", "force_unit", "run.csv")
    assert si_values(force, "force", "kN", "force_unit", "run.csv").tolist() == [1e3] * 3


N_SAMPLE, RATE = 400, 8000.0


def _signals() -> tuple[np.ndarray, np.ndarray]:
    """Force [N] and velocity [m/s] of a run, each number exact in the digits that all formats keep."""
    phase = 2 * np.pi * 100 / RATE * np.arange(N_SAMPLE)
    return np.round(12 * np.cos(phase + 0.1) + np.cos(3 * phase), 6), np.round(0.25 * np.cos(phase), 8)


def test_all_formats_give_the_same_record(tmp_path: Path) -> None:
    force, velocity = _signals()
    rows = "".join(f"{f:.6f};{1000 * v:.5f}\n".replace(".", ",") for f, v in zip(force, velocity, strict=True))
    (tmp_path / "run.csv").write_text(f"Sampling rate [Hz];8000\nForce;Velocity\nN;mm/s\n{rows}")
    with h5py.File(tmp_path / "run.h5", "w") as file:
        file["force"], file["velocity"] = force, velocity
        file.attrs["sampling_rate_hz"] = RATE
    scipy.io.savemat(tmp_path / "run.mat", {"force": force, "velocity": velocity, "fs": RATE})
    common = {"type": 58, "binary": 0, "func_type": 1, "rsp_node": 1, "rsp_dir": 1, "ref_node": 1, "ref_dir": 1}
    common |= {"abscissa_spacing": 1, "abscissa_spec_data_type": 17, "orddenom_spec_data_type": 0}
    for kind, data in ((13, force), (11, velocity)):
        times = np.arange(N_SAMPLE) / RATE
        dataset = common | {"ordinate_spec_data_type": kind, "data": data, "x": times}
        pyuff.UFF(str(tmp_path / "run.uff")).write_sets(dataset, "add")
    for suffix in ("csv", "h5", "mat", "uff"):
        (record,) = read_records(tmp_path / f"run.{suffix}")
        np.testing.assert_allclose(record.force, force, rtol=1e-11, atol=1e-12)  # 12 digits in UFF, decimals in CSV
        np.testing.assert_allclose(record.motion, velocity, rtol=1e-11, atol=1e-14)
        assert (record.motion_kind, record.label) == ("velocity", "run")
        assert (record.sampling_rate, record.motion_rate) == (pytest.approx(RATE), pytest.approx(RATE))
        assert record.force.dtype == record.motion.dtype == np.float64


def test_sign_units_and_rate_of_the_description(tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    path.write_text("Sampling rate;1000\nForce;Velocity\n" + "1.5;2\n" * 4)
    spec = _spec(force_sign=-1, force_unit="kN", motion_unit="in/s", sampling_rate="2 kHz")
    (record,) = read_records(path, spec, is_empty=True)
    assert record.force.tolist() == [-1500.0] * 4
    assert record.motion == pytest.approx([0.0508] * 4)
    assert (record.sampling_rate, record.motion_rate, record.is_empty) == (2000.0, 2000.0, True)


def test_content_counts_where_the_suffix_lies(tmp_path: Path) -> None:
    force, velocity = _signals()
    scipy.io.savemat(tmp_path / "a.csv", {"force": force, "velocity": velocity, "fs": RATE}, appendmat=False)
    with h5py.File(tmp_path / "b.mat", "w") as file:
        file["force"], file["velocity"], file["fs"] = force, velocity, RATE
    for name in ("a.csv", "b.mat"):
        (record,) = read_records(tmp_path / name)
        assert record.force.tolist() == force.tolist()


def test_files_that_cannot_be_opened(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"run\.xlsx: files ending in '\.xlsx' are not read.*\.csv.*\.unv"):
        read_records(tmp_path / "run.xlsx")
    with pytest.raises(InputError, match=r"none\.csv: cannot be opened \(No such file"):
        read_records(tmp_path / "none.csv")
    with pytest.raises(InputError, match="is a folder"):
        read_records(tmp_path)
    (tmp_path / "empty.h5").touch()
    with pytest.raises(InputError, match=r"empty\.h5: is empty \(0 bytes\)"):
        read_records(tmp_path / "empty.h5")


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() == 0, reason="permissions do not bind this user")
def test_file_without_permission(tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    path.write_text("1;2\n")
    path.chmod(0)
    with pytest.raises(InputError, match="cannot be opened"):
        read_records(path)


@pytest.mark.parametrize("suffix", ["csv", "txt", "h5", "hdf5", "mat", "uff", "unv"])
@pytest.mark.parametrize(
    "content", [b"\0\1\2\3" * 50, b"hello\n", b"\x89HDF\r\n\x1a\n", b"MATLAB 5.0 MAT-file", b"    -1\n"]
)
def test_nonsense_under_any_suffix_is_an_input_error(tmp_path: Path, suffix: str, content: bytes) -> None:
    path = tmp_path / f"run.{suffix}"
    path.write_bytes(content)
    with pytest.raises(InputError, match=rf"run\.{suffix}"):
        read_records(path)
