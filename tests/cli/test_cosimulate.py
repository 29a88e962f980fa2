"""`graindamp cosimulate`, from a description to files."""

import json
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from graindamp.cli.main import app
from graindamp.couple import cosimulate as module
from graindamp.couple.described import case_of, output_points
from graindamp.errors import InputError
from graindamp.signals.decay_record import read_decays
from graindamp.spec.cosimulation import CosimulationSpec
from graindamp.spec.model import load_spec
from graindamp.status import Status

DAMPER = """
gravity = "none"
container = { kind = "box", size = ["6 mm", "5 mm", "5 mm"], material = "aluminium-6060" }
fill = { count = 8 }
contact = { restitution = 0.5, friction = 0.2, softening = 1000 }
packing = { tap = false, method = "grow" }
particles = [{ material = "steel-s235", radius = "1 mm" }]
"""

PROJECT = f"""
title = "Small"
[structure]
kind = "modal"
frequencies = [0, "60 Hz"]
shapes = {{ tip = [1, 8], root = [1, -3] }}
damping = {{ kind = "modal", ratio = 0.001 }}
[[dampers]]
name = "jar"
point = "tip"
[dampers.damper]
{DAMPER}
[run]
duration = "0.25 s"
sample_rate = "2 kHz"
"""
RELEASE = '[release]\npoint = "tip"\ndisplacement = "2 mm"\nmode = 1\n'


@pytest.fixture
def project(tmp_path):
    """A file with the description, more text at its end."""

    def written(more=RELEASE, head='outputs = ["root"]\n', name="small.toml"):
        path = tmp_path / name
        path.write_text(head + PROJECT + more, encoding="utf-8")
        return path

    return written


@pytest.fixture(scope="module")
def ran(tmp_path_factory):
    """The command's answer to a released structure, and its folder."""
    folder = tmp_path_factory.mktemp("cosimulate")
    path = folder / "small.toml"
    path.write_text('outputs = ["root"]\n' + PROJECT + RELEASE, encoding="utf-8")
    out, cache = folder / "out", folder / "cache"
    given = ["cosimulate", str(path), "--out", str(out), "--cache", str(cache), "--json"]
    result = CliRunner().invoke(app, given)
    assert result.exit_code == 0, result.output
    return json.loads(result.stdout), out


def test_the_answer_tells_of_the_decay(ran):
    document, out = ran
    assert document["status"] == 0
    assert document["decay"]["damping_ratio"] > 0.002
    # 8 balls of 33 mg on a modal mass of 1/64 kg: lower, by less than their whole mass.
    assert 60.0 * (1 + 64 * 8 * 3.3e-5) ** -0.5 - 0.2 < document["decay"]["frequency"] < 60.1
    # 5e-4 with the 40 steps per contact of the default, a quarter of it with 80.
    assert document["energy"]["residual"] < 1e-3
    assert document["points"]["root"]["largest_displacement"] == pytest.approx(2e-3 * 3 / 8, rel=0.02)
    names = {path.name for path in out.iterdir()}
    assert {"report.html", "result.json", "motion.csv", "energies.csv", "motion.png", "energies.png"} <= names


def test_the_motion_is_a_file_that_decay_reads(ran):
    _, out = ran
    with (out / "motion.csv").open(encoding="utf-8") as file:
        titles = file.readline().strip().split(",")
    assert titles[:3] == ["time [s]", "jar velocity [m/s]", "jar displacement [m]"]
    from graindamp.spec.measurement import ChannelsSpec

    records = read_decays(out / "motion.csv", ChannelsSpec(motion="jar velocity"))
    assert records[0].sampling_rate == pytest.approx(2000.0)


def test_the_example_is_a_cantilever_of_twenty_hertz():
    folder = Path(__file__).parents[2] / "examples"
    case = case_of(load_spec(folder / "free-decay.toml", CosimulationSpec), folder)
    # Closed form of the beam with 102.25 g at its tip: 20.78 Hz.
    assert case.model.omega[0] / (2 * np.pi) == pytest.approx(20.78, abs=0.01)
    assert case.model.shape[0] @ case.q == pytest.approx(5e-3)
    assert case.dampers[0].along == (0.0, 1.0, 0.0)


def test_forces_and_damper_files_are_read(project, tmp_path):
    (tmp_path / "jar.toml").write_text("[damper]\n" + DAMPER, encoding="utf-8")
    time = np.arange(50) / 1e3
    table = np.column_stack([time, np.hanning(50)])
    np.savetxt(tmp_path / "kick.csv", table, delimiter=",", header="time,f", comments="")
    swept = 'kind = "sweep"\namplitude = "1 N"\nstart = "10 Hz"\nstop = "90 Hz"\nduration = "1 s"\n'
    more = (
        '[[dampers]]\nname = "second"\npoint = "root"\nfile = "jar.toml"\n'
        '[[forces]]\npoint = "tip"\nkind = "harmonic"\namplitude = "2 N"\nfrequency = "50 Hz"\n'
        '[[forces]]\npoint = "root"\nkind = "series"\nfile = "kick.csv"\nunit = "kN"\n'
        f'[[forces]]\npoint = "tip"\n{swept}'
    )
    path = project(more)
    spec = load_spec(path, CosimulationSpec)
    case = case_of(spec, tmp_path)
    assert output_points(spec) == ("jar", "second", "root")
    assert case.dampers[1].damper.fill.count == 8
    assert [force.point for force in case.forces] == ["force 1", "force 2", "force 3"]
    assert case.forces[1].samples.max() == pytest.approx(1e3, rel=2e-3)
    assert case.forces[1].rate == pytest.approx(1e3)


@pytest.mark.parametrize(
    ("more", "words"),
    [
        ("", "nothing moves the structure"),
        ('[release]\npoint = "tip"\ndisplacement = "2 mm"\n', "give the mode to release"),
        ('[release]\npoint = "tip"\ndisplacement = "2 mm"\nmode = 4\n', "release.mode is 4, but the structure has 1"),
        ('[release]\npoint = "tap"\ndisplacement = "2 mm"\nmode = 1\n', "no point 'tap'; nearest is 'tip'"),
        (RELEASE + '[[dampers]]\nname = "jar"\npoint = "tip"\nfile = "a.toml"\n', "two dampers are called 'jar'"),
        (RELEASE + '[[dampers]]\nname = "b"\npoint = "tip"\n', "needs either damper (a table) or file"),
        (RELEASE + '[[dampers]]\nname = "b"\npoint = "tip"\nfile = "a.toml"\n', "a.toml"),
        ('[[forces]]\npoint = "tip"\nkind = "harmonic"\namplitude = "-2 N"\nfrequency = "9 Hz"\n', "amplitude"),
    ],
)
def test_mistakes_are_named(project, tmp_path, more, words):
    with pytest.raises(InputError) as error:
        case_of(load_spec(project(more), CosimulationSpec), tmp_path)
    assert words in str(error.value)


def test_ctrl_c_keeps_what_there_is(project, tmp_path, monkeypatch):
    calls = []

    def stopped(*given):
        calls.append(given)
        if len(calls) == 20:
            raise KeyboardInterrupt
        return run_carried(*given)

    run_carried = module.run_carried
    monkeypatch.setattr(module, "run_carried", stopped)
    case = case_of(load_spec(project(), CosimulationSpec), tmp_path)
    run = module.cosimulate(case, cache=tmp_path / "cache")
    assert run.status & Status.INTERRUPTED
    assert 0.0 < run.time[-1] < 0.24
    assert np.isfinite(run.q).all()
