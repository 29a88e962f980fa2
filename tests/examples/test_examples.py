"""Every script in examples/ runs, writes its picture, and ends in the number it should."""

import importlib.util
from pathlib import Path

import pytest

import graindamp.dem.compile  # noqa: F401 - before the cache is moved: only beds go elsewhere, not compiled code

EXAMPLES = Path(__file__).parents[2] / "examples"


@pytest.fixture(autouse=True)
def _own_beds(tmp_path, monkeypatch):
    monkeypatch.setenv("GRAINDAMP_CACHE", str(tmp_path / "cache"))


def main_of(name):
    """The script's function `main`."""
    source = importlib.util.spec_from_file_location(name, EXAMPLES / f"{name}.py")
    module = importlib.util.module_from_spec(source)
    source.loader.exec_module(module)
    return module.main


def is_picture(path):
    return path.read_bytes().startswith(b"\x89PNG")


def test_all_are_here():
    here = Path(__file__).read_text(encoding="utf-8")
    assert [path.name for path in EXAMPLES.glob("*.py") if f'main_of("{path.stem}")' not in here] == []


@pytest.mark.slow
def test_measure_field(tmp_path):
    # The demo's best record, 63 Hz and 40 g; docs/howto/demo.md says 0.92.
    assert main_of("measure_field")(tmp_path) == pytest.approx(0.92, abs=0.005)
    assert is_picture(tmp_path / "field.png")


@pytest.mark.slow
def test_predict_beam(tmp_path):
    # The dip of mode 1 between two good regions of the field: the demo has 0.93 % at 5 N, and on both sides of it more
    # than 1.3 %; forces between 2 and 5 N find a little less than that, by two of its standard errors of 0.014 %.
    assert main_of("predict_beam")(tmp_path) == pytest.approx(0.0089, abs=3e-4)
    assert is_picture(tmp_path / "beam.png")


@pytest.mark.slow
def test_single_ball(tmp_path):
    # What is left is the time in contact, and the plastic bed's restitution: tests/verification/test_dem_shaken.py.
    assert main_of("single_ball")(tmp_path, 8, {0.01: (1.5,), 0.2: (1.0,)}) < 5e-3
    assert is_picture(tmp_path / "single-ball.png")


@pytest.mark.slow
def test_baseline_damper(tmp_path):
    # At X = X_opt a bed thrown from wall to wall has 4/pi if plastic, 1.0 on the rig; one that floats has < 0.3. Three
    # seeds give 0.87 to 1.13 here, and rounding alone makes as much of a difference.
    main = main_of("baseline_damper")
    assert main(tmp_path, count=150, cycles=10, softening=10) == pytest.approx(1.0, abs=0.3)
    assert is_picture(tmp_path / "baseline-damper.png")


@pytest.mark.slow
def test_foam_damper(tmp_path):
    # 0.83 W over 40 cycles; power of the plastic bed 4 m V^2 f = 0.81 W.
    assert main_of("foam_damper")(tmp_path, cycles=8) == pytest.approx(0.83, abs=0.03)
    assert is_picture(tmp_path / "foam-damper.png")


@pytest.mark.slow
def test_mesh_container(tmp_path):
    # The error of the time step alone: second order, 1e-3 at 40 steps per contact.
    assert abs(main_of("mesh_container")(tmp_path, count=60, cycles=8)) < 3e-3
    assert is_picture(tmp_path / "mesh-container.png")
