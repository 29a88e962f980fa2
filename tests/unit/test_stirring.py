"""Statistics of the bed's motion per cycle: from an engine run, and kept in its file."""

import numpy as np
import pytest

from graindamp.dem.simulate import simulate
from graindamp.dem.stirring import LAYERS, MOVING, Stirring
from graindamp.report.run_file import load_run, save_run
from graindamp.signals.motion_modes import MotionMode, classify
from graindamp.spec.model import parse_spec
from graindamp.spec.simulation import SimulationSpec
from graindamp.units import STANDARD_GRAVITY
from runs_made import made_run, stirred_run


def still(turn):
    return np.zeros(3), 0.0


def test_moving_begins_at_the_stated_speed():
    """Constant speeds a hair below and above MOVING: half of the particles count."""

    def bed(turn):
        speed = MOVING * np.where(np.arange(90) % 2, 1.001, 0.999)
        return np.outer(speed, [0.0, 1.0, 0.0]), 0.0

    stirring = stirred_run(bed).stirring
    assert np.all(stirring.moving == 0.5)
    assert stirring.drift == pytest.approx(MOVING**2, rel=1e-5)
    assert stirring.kinetic == pytest.approx(stirring.drift, rel=1e-12)
    assert np.all(stirring.block == pytest.approx(0.0, abs=1e-12))


def test_layers_know_common_motion_from_disorder():
    """A layer that moves as one has speed and no disorder; one whose halves part has both."""

    def common(turn):
        return 0.5 * np.array([0.0, 1.0, 0.0]), 0.0

    def parting(turn):
        return np.outer(np.where(np.arange(90) % 2, 0.5, -0.5), [0.0, 1.0, 0.0]), 0.0

    one, two = stirred_run(common).stirring, stirred_run(parting).stirring
    assert one.layer_speed.shape == (6, LAYERS)
    assert np.allclose(one.layer_speed, 0.5)
    assert np.allclose(one.layer_disorder, 0.0, atol=1e-9)
    assert np.allclose(two.layer_speed, 0.5)
    assert np.all(two.layer_disorder > 0.45)  # 0.5 where exactly half of a layer moves each way


def test_a_steady_push_is_no_impact():
    stirring = stirred_run(still, lambda turn: (1.0, 0.0)).stirring
    assert np.all(stirring.end_contact == [1.0, 0.0])
    assert np.all(stirring.end_episodes.sum(axis=0) == [1.0, 0.0])  # it begins once in the whole run
    assert np.allclose(stirring.end_concentration[:, 0], 0.0, atol=1e-9)
    assert np.isnan(stirring.end_concentration[:, 1]).all()


def test_a_run_keeps_it_in_its_file(tmp_path):
    run = stirred_run(still, lambda turn: (1.0, 0.0))
    again = load_run(save_run(run, tmp_path / "run.h5"))
    assert isinstance(again.stirring, Stirring)
    for name in Stirring._fields:
        np.testing.assert_array_equal(getattr(again.stirring, name), getattr(run.stirring, name))
    assert load_run(save_run(made_run(n_snapshot=0), tmp_path / "without.h5")).stirring is None


def _ball(snapshots, cycles=3.0):
    """A single ball on the floor of a box, away from its walls, without friction: it stays where it is."""
    return parse_spec(
        {
            "damper": {
                "particles": [{"material": "steel-s235", "radius": 1e-3}],
                "fill": {"count": 1},
                "container": {"kind": "box", "size": [0.02, 0.02, 0.02], "material": "aluminium-6060"},
                "contact": {"restitution": 0.5, "friction": 0.0, "softening": 1000},
            },
            "motion": {"kind": "harmonic", "frequency": 200.0, "intensity": 2.0},
            "run": {"cycles": cycles, "snapshots_per_cycle": snapshots, "settle": 0.05},
        },
        SimulationSpec,
        "test",
    )


@pytest.mark.slow
def test_the_engine_agrees_with_its_own_snapshots(tmp_path):
    """A frictionless ball does not follow: relative energy 1/2; snapshots at the same times give the same numbers."""
    run = simulate(_ball(20), cache=tmp_path)
    stirring = run.stirring
    assert len(stirring.kinetic) == 3
    speed = 2.0 * STANDARD_GRAVITY / (2.0 * np.pi * 200.0)
    assert stirring.kinetic[1:] == pytest.approx(0.5, rel=0.02)  # the floor still lets it rattle a little
    assert stirring.travel[1:] == pytest.approx(2.0 * speed / (2.0 * np.pi * 200.0), rel=0.02)
    assert np.isnan(stirring.layer_speed).all()  # one particle has no layers
    times = np.array([shot.time for shot in run.snapshots]) * 200.0
    second = [shot for shot, t in zip(run.snapshots, times, strict=True) if 1.0 + 1e-6 < t < 2.0 + 1e-6]
    assert len(second) == 20
    kinetic = np.mean([np.sum(shot.velocity**2) for shot in second]) / speed**2
    assert stirring.kinetic[1] == pytest.approx(kinetic, rel=1e-12)
    assert classify(run).mode == MotionMode.DECOUPLED


@pytest.mark.slow
def test_less_than_a_cycle_leaves_nothing(tmp_path):
    assert simulate(_ball(0, cycles=0.98), cache=tmp_path).stirring is None
