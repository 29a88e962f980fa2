"""`graindamp decay` as a person or a script meets it: files of all formats, output, messages, exit codes."""

import csv
import json

import h5py
import numpy as np
import pytest
import pyuff
import scipy.io
import typer
from typer.testing import CliRunner

from graindamp.cli.decay import decay
from graindamp.errors import InputError

RATE, FREQUENCY, ZETA = 1000.0, 20.0, 0.01
PSI = 1 - np.exp(-4 * np.pi * ZETA / np.sqrt(1 - ZETA**2))


@pytest.fixture(scope="module")
def app():
    made = typer.Typer()
    made.command()(decay)
    return made


def velocity(seed=0, zeta=ZETA):
    """A decay that begins with 0.5 m/s, in m/s, with a little noise."""
    time = np.arange(4000) / RATE
    noise = 1e-5 * np.random.default_rng(seed).normal(size=len(time))
    return time, 0.5 * np.exp(-zeta * 2 * np.pi * FREQUENCY * time) * np.sin(2 * np.pi * FREQUENCY * time) + noise


@pytest.fixture
def repeats(tmp_path):
    """Three repeats as text tables in mm/s."""
    paths = []
    for seed in range(3):
        time, motion = velocity(seed)
        path = tmp_path / f"run{seed + 1}.csv"
        table = np.column_stack([time, 1e3 * motion])
        np.savetxt(path, table, delimiter=";", header="Time [s];Velocity [mm/s]", comments="", fmt="%.8g")
        paths.append(path)
    return paths


def run(app, *words):
    result = CliRunner().invoke(app, [str(word) for word in words])
    assert result.exit_code == 0, result.exception
    return result


def document(app, *words):
    return json.loads(run(app, *words, "--json").stdout)


def message(app, *words):
    result = CliRunner().invoke(app, [str(word) for word in words])
    assert isinstance(result.exception, InputError), result.output
    return str(result.exception)


@pytest.mark.slow
def test_intrinsic_damping_above_what_was_measured_is_told(app, repeats):
    result = run(app, *repeats, "--intrinsic", "90 %", "--json")
    assert "intrinsic is 90 %, but Ψ is smaller at " in result.stderr
    assert not run(app, *repeats, "--intrinsic", "0.3 %", "--json").stderr


@pytest.mark.slow
def test_repeats_to_a_report(app, repeats, tmp_path):
    out = tmp_path / "out"
    options = ["--clearance", "4.95 mm", "--particle-mass", "3.52 g", "--structure-mass", "131 g"]
    printed = run(app, *repeats, *options, "--intrinsic", "0.3%", "--out", out).stdout
    assert "Damping over amplitude" in printed
    assert "Ψ_m [-]" in printed
    made = {path.name for path in out.iterdir()}
    assert made == {
        "report.html", "result.json", "curve.csv", "cycles.csv", "decay.png", "damping.png", "frequency.png",
    }  # fmt: skip
    page = (out / "report.html").read_text(encoding="utf-8")
    assert page.count("<img") == 3
    assert "intrinsic = 0.003" in page
    with open(out / "curve.csv", newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    mu = 3.52 / 131
    for row in rows[len(rows) // 2 :]:  # the larger amplitudes
        assert float(row["psi [-]"]) == pytest.approx(PSI, abs=1e-3)
        assert float(row["psi_mass_normalised [-]"]) == pytest.approx((PSI - 0.003) * (1 + mu) ** 2 / mu, abs=0.05)
        assert float(row["alpha [-]"]) == pytest.approx(float(row["displacement [m]"]) / 4.95e-3, rel=1e-6)
    assert sum(int(row["n_cycle"]) for row in rows) == len((out / "cycles.csv").read_text().splitlines()) - 1


def test_json_alone_writes_nothing(app, repeats, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    before = set(tmp_path.iterdir())
    data = document(app, repeats[0])
    assert set(tmp_path.iterdir()) == before
    assert data["kind"] == "decay"
    assert data["files"] == []
    (record,) = data["records"]
    assert record["frequency"] == pytest.approx(FREQUENCY, rel=1e-3)
    assert record["damping_ratio"] == pytest.approx(ZETA, rel=1e-3)
    assert record["cycles"]["displacement"][0] == pytest.approx(0.5 / (2 * np.pi * FREQUENCY), rel=0.02)
    assert data["units"]["psi"] == "1"


def test_loss_factor_is_that_of_the_rule(app, repeats):
    """eta = 2 zeta (1 + mu) / mu of a damper that moves with the mode."""
    data = document(app, repeats[0], "--particle-mass", "10 g", "--structure-mass", "100 g")
    assert data["curve"]["loss_factor"][-1] == pytest.approx(2 * ZETA * 1.1 / 0.1, rel=1e-3)


@pytest.mark.parametrize("kind", ["csv", "one column", "mat", "mat struct", "h5", "uff", "uff with force"])
def test_files_of_all_formats(app, tmp_path, kind):
    time, motion = velocity()
    options = []
    if kind == "csv":
        path = tmp_path / "a.txt"
        np.savetxt(path, np.column_stack([time, motion]), header="t v")
    elif kind == "one column":
        path = tmp_path / "a.csv"
        np.savetxt(path, motion)
        options = ["--rate", "1 kHz", "--quantity", "velocity"]
    elif kind == "mat":
        path = tmp_path / "a.mat"
        scipy.io.savemat(path, {"velocity": 1e3 * motion, "velocity_unit": "mm/s", "fs": RATE})
    elif kind == "mat struct":
        path = tmp_path / "a.mat"
        scipy.io.savemat(path, {"run": {"v": motion, "t": time}})
    elif kind == "h5":
        path = tmp_path / "a.h5"
        with h5py.File(path, "w") as file:
            file["run/velocity"] = motion
            file["run/force"] = motion
            file["run"].attrs["sampling_rate_hz"] = RATE
    else:
        path = tmp_path / "a.uff"
        for name, code, unit in [("velocity", 11, "m/s"), ("force", 13, "N")][: 2 if "force" in kind else 1]:
            dataset = {
                "type": 58, "binary": 0, "func_type": 1, "id1": name, "id2": "", "id3": "", "id4": "", "id5": "",
                "rsp_node": 1, "rsp_dir": 1, "ref_node": 0, "ref_dir": 0, "ord_data_type": 4, "data": motion, "x": time,
                "abscissa_spacing": 1, "abscissa_min": 0.0, "abscissa_inc": 1 / RATE, "abscissa_spec_data_type": 17,
                "abscissa_axis_units_lab": "s", "ordinate_spec_data_type": code, "ordinate_axis_units_lab": unit,
                "rsp_ent_name": "BEAM", "orddenom_spec_data_type": 0,
            }  # fmt: skip
            pyuff.UFF(str(path)).write_sets(dataset, "add")
    data = document(app, path, *options)
    (record,) = data["records"]
    assert record["quantity"] == "velocity"
    assert record["sampling_rate"] == pytest.approx(RATE)
    assert record["damping_ratio"] == pytest.approx(ZETA, rel=1e-3)
    assert record["cycles"]["velocity"][0] == pytest.approx(0.5, rel=0.02)


def test_options_choose_channel_and_unit(app, tmp_path):
    time, motion = velocity()
    path = tmp_path / "a.csv"
    np.savetxt(path, np.column_stack([time, motion, 2 * motion]), delimiter=",", header="t,one,two", comments="")
    said = message(app, path)
    assert "no motion channel is recognised" in said
    assert "'one', 'two'" in said
    data = document(app, path, "--channel", "two", "--quantity", "velocity", "--unit", "mm/s")
    assert data["records"][0]["cycles"]["velocity"][0] == pytest.approx(1e-3, rel=0.02)
    assert "which is no unit of velocity" in message(
        app, path, "--channel", "two", "--quantity", "velocity", "--unit", "N"
    )


def test_a_description_in_place_of_options(app, repeats, tmp_path):
    path = tmp_path / "test.toml"
    path.write_text(
        'files = ["run1.csv", "run2.csv"]\nname = "config 1"\nclearance = "4.95 mm"\nintrinsic = "0.3 %"\n'
        '[method]\npeaks = "parabola"\nmoving_average = 1\n[channels]\nmotion_unit = "m/s"\n'
    )
    data = document(app, path)
    assert data["name"] == "config 1"
    assert data["method"]["peaks"] == "parabola"
    assert len(data["records"]) == 2
    assert data["records"][0]["cycles"]["velocity"][0] == pytest.approx(500.0, rel=0.02)
    assert any("is the unit of the velocity right?" in line for line in data["warnings"])
    assert document(app, path, "--peaks", "samples")["method"]["peaks"] == "samples"
    assert "alone, or signal files" in message(app, path, repeats[0])


def test_a_record_without_a_decay_is_left_out_and_named(app, repeats, tmp_path):
    dead = tmp_path / "dead.csv"
    np.savetxt(dead, np.column_stack([np.arange(4000) / RATE, np.zeros(4000)]), delimiter=";", header="Time [s];Velocity [m/s]", comments="")  # fmt: skip  # noqa: E501
    data = document(app, repeats[0], dead)
    assert len(data["records"]) == 1
    assert data["warnings"] == ["left out: dead.csv: the velocity is constant (0 m/s); check the channel"]
    assert "the velocity is constant" in message(app, dead)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--intrinsic", "3 mm"], "intrinsic"),
        (["--particle-mass", "3 g"], "structure_mass is missing"),
        (["--rate", "5 m"], "sampling_rate"),
        (["--peaks", "spline"], "'polynomial', 'parabola' or 'samples'"),
        (["--moving-average", "2"], "must be odd"),
        (["--quantity", "speed"], "'velocity', 'acceleration' or 'displacement'"),
        (["--quantity", "acceleration"], "acceleration"),
        (["--frequency", "200 Hz"], "samples per cycle"),
    ],
)
def test_mistakes_are_named(app, repeats, words, said):
    assert said in message(app, repeats[0], *words)


def test_missing_file_and_missing_rate(app, tmp_path):
    assert "cannot be opened" in message(app, tmp_path / "none.csv")
    path = tmp_path / "a.csv"
    np.savetxt(path, velocity()[1])
    assert "the sampling rate is not told" in message(app, path, "--quantity", "velocity")
    assert "no motion channel is recognised" in message(app, path)
