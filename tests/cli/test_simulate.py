"""Commands about particles: what they print and write, whose files they overwrite, and how they end."""

import json
import os
import subprocess
import sys

import numpy as np
import pytest
from typer.testing import CliRunner

from graindamp.cli.main import app
from graindamp.errors import InputError
from graindamp.report.run_file import load_run, save_packing, save_run
from graindamp.report.simulation import examine
from graindamp.status import Status
from runs_made import made_run

PROJECT = """
title = "A small damper"
[damper]
name = "test damper"
[[damper.particles]]
material = "steel-s235"
radius = "2 mm"
[damper.fill]
count = {count}
[damper.container]
kind = "cylinder"
axis = "x"
radius = "10 mm"
length = "40 mm"
material = "aluminium-6060"
[damper.lid]
kind = "rigid"
clearance = "3 mm"
[damper.contact]
restitution = 0.6
friction = 0.2
[motion]
kind = "harmonic"
frequency = "100 Hz"
intensity = "10 g"
[run]
cycles = {cycles}
snapshots_per_cycle = {snapshots}
"""


def project(folder, count=100, cycles=30, snapshots=8):
    path = folder / "damper.toml"
    path.write_text(PROJECT.format(count=count, cycles=cycles, snapshots=snapshots))
    return path


def call(*words):
    """Result of `graindamp words` in this process."""
    return CliRunner().invoke(app, [str(word) for word in words])


def error(*words):
    """The message of a user's mistake."""
    result = call(*words)
    assert isinstance(result.exception, InputError), (result.exception, result.output)
    return str(result.exception)


@pytest.fixture
def drawn_made(monkeypatch):
    """The engine replaced by a run with known loss factor; the dictionary tells what it was asked for."""
    asked = {"run": made_run(n_snapshot=4), "calls": 0}

    def instead(spec, *, folder=None, cache=None, progress=None):
        asked.update(spec=spec, folder=folder, cache=cache, calls=asked["calls"] + 1)
        progress("shaking", 0.5, 61.0)
        return asked["run"]._replace(spec=spec)

    def packed(damper, *, folder=None, cache=None, progress=None):
        asked.update(damper=damper, folder=folder, cache=cache)
        return asked["run"].packing

    monkeypatch.setattr("graindamp.dem.simulate.simulate", instead)
    monkeypatch.setattr("graindamp.dem.packing.pack", packed)
    return asked


@pytest.fixture
def made(drawn_made, monkeypatch):
    """Likewise, without the time that figures take."""
    monkeypatch.setattr("graindamp.report.simulation.draw_all", lambda *words: ((), []))
    return drawn_made


@pytest.mark.slow
def test_one_operating_point_as_json(drawn_made, tmp_path):
    result = call("simulate", project(tmp_path), "--json")
    assert result.exit_code == 0, result.exception
    document = json.loads(result.stdout)
    assert document["eta"] == pytest.approx(0.4, abs=4 * document["eta_se"])
    assert document["m_prime"] == pytest.approx(0.3, abs=4 * document["m_prime_se"])
    assert document["status_names"] == []
    assert document["partial"] is False
    assert document["packing"]["count"] == 100
    assert document["packing"]["clearance"] == pytest.approx(3e-3)
    assert document["energies"]["work"] == pytest.approx(document["energies"]["loss_total"], rel=1e-9)
    assert abs(document["energies"]["closure_share"]) < 1e-9
    assert document["timing"]["particle_steps_per_second"] == pytest.approx(100 * 300_000 / 12.0)
    folder = tmp_path / "damper-run"
    pictures = {"bed", "snapshot", "signals", "cycles", "energy", "energy-path", "velocity-field", "impacts"}
    names = {"result.json", "run.h5", "signals.h5", "report.html"} | {f"{name}.png" for name in pictures}
    assert {path.name for path in folder.iterdir()} == names
    assert set(document.pop("files")) == {str(folder / name) for name in names}
    assert json.loads((folder / "result.json").read_text()) == document
    page = (folder / "report.html").read_text()
    assert page.count("data:image/png;base64,") == len(pictures)
    assert "http" not in page
    assert drawn_made["folder"] == tmp_path


def test_tables_and_files_on_request(made, tmp_path):
    out = tmp_path / "deep" / "out"
    options = ("--uff", "--vtk", "--animation", "gif", "--cache", tmp_path / "beds", "--seed", 7)
    result = call("simulate", project(tmp_path), "--out", out, *options)
    assert result.exit_code == 0, result.exception
    for text in ("η [-]", "friction with walls", "closure", "particle-steps per second", "clearance h", "f100_G10"):
        assert text in result.stdout
    assert "shaking: 50 %, 1:01 left" in result.stderr
    assert (out / "motion.gif").stat().st_size > 10_000
    assert len(list((out / "vtk").glob("particles-*.vtp"))) == 4
    assert (out / "vtk" / "walls.pvd").exists()
    assert (out / "vtk" / "velocity-field.vti").exists()
    assert made["cache"] == tmp_path / "beds"
    assert made["spec"].damper.packing.seed == 7


@pytest.mark.parametrize("suffix", ["h5", "uff"])
def test_signals_are_read_like_those_of_a_rig(made, tmp_path, suffix):
    document = json.loads(call("simulate", project(tmp_path), "--uff", "--json").stdout)
    extra = () if suffix == "h5" else ("--bed-mass", str(document["bed_mass"]), "--container-mass", "0")
    result = call("analyze", tmp_path / "damper-run" / f"signals.{suffix}", "--json", *extra)
    assert result.exit_code == 0, result.exception
    (point,) = json.loads(result.stdout)["points"]
    assert point["frequency"] == pytest.approx(100.0)
    assert point["loss_factor"] == pytest.approx(document["eta"], rel=1e-6)
    assert point["effective_mass_ratio"] == pytest.approx(document["m_prime"], rel=1e-6)


def test_a_run_that_was_stopped_says_so(made, tmp_path):
    run = made["run"]
    n = 900
    made["run"] = run._replace(
        status=int(Status.INTERRUPTED),
        time=run.time[:n],
        force=run.force[:n],
        velocity=run.velocity[:n],
        cycle_force=run.cycle_force[:4],
        cycle_velocity=run.cycle_velocity[:4],
        energy_time=run.energy_time[:5],
        energy=run.energy[:5],
        n_step=45_000,
        velocity_field=None,
    )
    result = call("simulate", project(tmp_path), "--json")
    assert result.exit_code == 130
    document = json.loads(result.stdout)
    assert document["partial"] is True
    assert "INTERRUPTED" in document["status_names"]
    assert "PARTIAL RESULT: the run was stopped after 4.5 cycles of 30" in result.stderr
    assert "PARTIAL RESULT" in (tmp_path / "damper-run" / "report.html").read_text()
    assert load_run(tmp_path / "damper-run" / "run.h5").status == Status.INTERRUPTED


def test_a_run_stopped_at_once(drawn_made, tmp_path):
    run = drawn_made["run"]
    drawn_made["run"] = run._replace(
        status=int(Status.INTERRUPTED), time=run.time[:0], force=run.force[:0], velocity=run.velocity[:0],
        cycle_force=run.cycle_force[:0], cycle_velocity=run.cycle_velocity[:0], energy_time=run.energy_time[:1],
        energy=run.energy[:1], centre=run.centre[:1], snapshots=(), velocity_field=None, n_step=0, seconds=0.0,
        impact_counts=0 * run.impact_counts,
    )  # fmt: skip
    result = call("simulate", project(tmp_path), "--json")
    assert result.exit_code == 130, result.exception
    assert json.loads(result.stdout)["eta"] is None


@pytest.mark.slow
def test_a_motion_without_cycles(drawn_made, tmp_path):
    path = project(tmp_path)
    text = path.read_text()
    path.write_text(text[: text.index("[motion]")] + '[motion]\nkind = "rest"\n[run]\nduration = "20 ms"\n')
    none = np.empty(0, complex)
    drawn_made["run"] = drawn_made["run"]._replace(
        frequency=None, cycle_force=none, cycle_velocity=none, snapshots=(), velocity_field=None
    )
    result = call("simulate", path)
    assert result.exit_code == 0, result.exception
    assert "a motion without cycles" in result.stdout


def test_only_files_of_ours_are_overwritten(made, tmp_path):
    path = project(tmp_path)
    assert call("simulate", path, "--json").exit_code == 0
    assert call("simulate", path, "--json").exit_code == 0
    other = tmp_path / "other"
    other.mkdir()
    (other / "run.h5").write_text("precious")
    calls = made["calls"]
    assert "run.h5" in error("simulate", path, "--out", other)
    assert (other / "run.h5").read_text() == "precious"
    assert made["calls"] == calls  # told before the time is spent
    (other / "file").write_text("")
    assert "cannot be written" in error("simulate", path, "--out", other / "file")


def test_mistakes_in_projects_and_options(made, tmp_path):
    assert "cannot be opened" in error("simulate", tmp_path / "none.toml")
    path = project(tmp_path, snapshots=0)
    assert "snapshots_per_cycle" in error("simulate", path, "--animation", "gif")
    assert "snapshots_per_cycle" in error("simulate", path, "--vtk")
    assert "allowed are gif and mp4" in error("simulate", path, "--animation", "avi")
    text = path.read_text()
    path.write_text(text.replace('frequency = "100 Hz"', 'frequency = "100 mm"'))
    assert "motion.frequency" in error("simulate", path)
    path.write_text(text[: text.index("[motion]")])
    assert "motion: is missing" in error("simulate", path)
    assert not made["calls"]


def test_film_needs_ffmpeg_for_mp4(made, tmp_path, monkeypatch):
    monkeypatch.setattr("matplotlib.animation.FFMpegWriter.isAvailable", classmethod(lambda cls: False))
    message = error("simulate", project(tmp_path), "--animation", "mp4")
    assert "ffmpeg" in message
    assert "gif" in message


def test_pack(made, tmp_path):
    path = project(tmp_path)
    result = call("pack", path, "--json", "--seed", 3)
    document = json.loads(result.stdout)
    assert document["count"] == 100
    assert document["mass"] == pytest.approx(made["run"].mass.sum())
    assert document["tap_cycles"] == 40
    assert made["damper"].packing.seed == 3
    out = tmp_path / "bed.npz"
    result = call("pack", path, "--out", out, "--picture")
    assert result.exit_code == 0, result.exception
    assert "solid fraction" in result.stdout
    assert (tmp_path / "damper-bed.png").stat().st_size > 10_000
    assert call("pack", path, "--out", out).exit_code == 0
    out.write_text("precious")
    assert "no packing" in error("pack", path, "--out", out)
    assert ".npz" in error("pack", path, "--out", tmp_path / "bed.h5")


@pytest.mark.slow
def test_view(tmp_path):
    run = made_run(n_snapshot=3)
    source = save_run(run, tmp_path / "run.h5")
    result = call("view", source, "--out", tmp_path / "p", "--animation", "gif", "--vtk", tmp_path / "v", "--json")
    assert result.exit_code == 0, result.exception
    files = json.loads(result.stdout)["files"]
    assert str(tmp_path / "p" / "motion.gif") in files
    assert len(list((tmp_path / "v").glob("walls-*.vtp"))) == 3
    bare = save_run(run._replace(snapshots=()), tmp_path / "bare.h5")
    assert "snapshots_per_cycle" in error("view", bare, "--animation", "gif")
    bed = save_packing(run.packing, run.spec, tmp_path / "bed.npz")
    result = call("view", bed, "--vtk", tmp_path / "b")
    assert result.exit_code == 0, result.exception
    assert (tmp_path / "bed.png").exists()
    assert (tmp_path / "b" / "packing.vtp").exists()
    assert "does not move" in error("view", bed, "--animation", "gif")
    assert "give a run" in error("view", tmp_path / "run.txt")


def test_help_names_the_commands():
    out = call("--help").stdout
    for command in ("simulate", "pack", "view"):
        assert command in out


def test_start_is_light():
    """The engine and its compiler are loaded by a run, not by the command line."""
    code = "import sys, graindamp.cli.main; print(' '.join(sys.modules))"
    loaded = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout.split()
    assert not {"numba", "numpy", "matplotlib", "h5py", "pydantic", "graindamp.dem.simulate"} & set(loaded)


@pytest.mark.slow
def test_a_real_run(tmp_path):
    """Twenty spheres for six cycles: a passive damper has eta > 0, and the ledger closes."""
    path = project(tmp_path, count=20, cycles=6)
    words = [sys.executable, "-m", "graindamp", "simulate", str(path), "--cache", str(tmp_path / "beds"), "--json"]
    done = subprocess.run(words, capture_output=True, text=True, env=os.environ)
    assert done.returncode == 0, done.stderr
    document = json.loads(done.stdout)
    assert document["eta"] > 0
    assert abs(document["energies"]["closure_share"]) < 0.02  # step error of the default resolution
    again = load_run(tmp_path / "damper-run" / "run.h5")
    assert len(again.mass) == 20
    assert len(again.snapshots) > 40


def test_a_bed_that_still_settles_is_told():
    """Nine tenths of what was dissipated came out of the bed itself."""
    run = made_run()
    assert not any("still settles" in line for line in examine(run).warnings)
    whole = run.energy[-1].lost
    settling = tuple(
        one._replace(work=0.1 * one.lost, potential=one.potential + 0.9 * (whole - one.lost)) for one in run.energy
    )
    (told,) = [line for line in examine(run._replace(energy=settling)).warnings if "still settles" in line]
    assert "90 % of what was dissipated was stored in it before" in told
