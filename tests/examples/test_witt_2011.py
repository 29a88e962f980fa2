"""The dampers of examples/witt_2011: what the set-ups say, and that tiny decays run."""

from pathlib import Path

import numpy as np
import pytest

import graindamp.dem.compile  # noqa: F401 - before the cache is moved: only beds go elsewhere, not compiled code
from graindamp.couple.cosimulate import Carried, cosimulate
from graindamp.design.layers import layers as layers_rule

FOLDER = Path(__file__).parents[2] / "examples" / "witt_2011"


@pytest.fixture(autouse=True)
def _scripts(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(str(FOLDER))
    monkeypatch.setenv("GRAINDAMP_CACHE", str(tmp_path / "cache"))


@pytest.fixture
def setups():
    import witt_dampers

    return witt_dampers


@pytest.mark.parametrize(
    ("insert", "frequency", "mass"), [(0.0, 20.78, 130.15), (0.87e-3, 20.71, 131.02), (2.43e-3, 20.59, 132.58)]
)
def test_beam_has_the_frequency_and_mass_of_the_closed_form(setups, insert, frequency, mass):
    found = setups.structure(insert)
    assert found.mode.frequency == pytest.approx(frequency, abs=5e-3)  # digits given
    assert 1e3 * found.mass == pytest.approx(mass, abs=5e-3)
    # The model moves as the mode says: unit displacement of the tip is 1 / phi.
    assert found.model.shape[1, 0] ** -2 == pytest.approx(found.mass)
    assert found.model.shape[0, 0] < found.model.shape[1, 0] < found.model.shape[2, 0]


def test_masses_and_layers_are_those_stated(setups):
    # Table 4.2 lists bed masses to 10 mg; counts times the mass of a shot agree to one shot.
    for length, stated in ((34.77e-3, 95.69), (24.03e-3, 67.22), (19.63e-3, 49.17)):
        assert 1e3 * setups.COUNTS[length][3] * setups.SHOT_MASS == pytest.approx(stated, abs=0.0122)
    assert [layers_rule(h, setups.SHOT).rounded for h in setups.BED_HEIGHTS] == [4, 7, 11, 15]
    assert len(setups.LAYERS) == 36
    assert len(setups.SINGLE_BALL) == 16


def test_rows_fit_but_for_the_impossible_one(setups):
    from configuration_4 import possible

    damper, bed = setups.rows(3, 4.95e-3, seed=2)
    inside = np.asarray(damper.container.size) - setups.ROW_BALL / 2
    assert (bed.position <= inside + 1e-12).all()
    apart = np.linalg.norm(bed.position[:, None] - bed.position[None], axis=2) + np.eye(27)
    assert apart.min() >= setups.ROW_BALL * (1 - 1e-12)
    assert not possible(4, 19.74e-3)
    with pytest.raises(ValueError, match=r"35\.15"):
        setups.rows(4, 19.74e-3)


def test_beta_of_the_four_heights(setups):
    from configuration_5 import beta_over_intensity

    # REFERENCE: D h_e / h_p^2, three digits.
    assert [beta_over_intensity(k) for k in range(4)] == pytest.approx([2.306, 0.704, 0.320, 0.157], abs=5e-4)


def test_tiny_decays_run_and_are_kept(setups, tmp_path):
    from decays import RATE, curve, cycles_of, kept, peak, ring

    whole = setups.structure(setups.INSERT_MASS[4.95e-3])
    asked = []

    def make():
        asked.append(1)
        damper, bed = setups.channel(4.95e-3, 6e-3, seed=1, restitution=0.3, softening=1000.0)
        case = setups.decay_case(whole, (Carried(damper, "tip", packing=bed),), 6e-3, 0.4, RATE)
        return ring(case, 6e-3, whole.mass)

    run = kept(tmp_path, "one", make)
    again = kept(tmp_path, "one", make)
    assert len(asked) == 1
    assert np.array_equal(run.velocity, again.velocity)
    assert run._replace(velocity=None) == again._replace(velocity=None)
    assert run.residual < 1e-3
    displacement, intensity, damping = cycles_of(run)
    assert displacement[0] == pytest.approx(6e-3, rel=0.05)  # the ball that rides along, and V over a mean omega
    assert intensity[0] == pytest.approx(displacement[0] * (2 * np.pi * 20.7) ** 2 / 9.81, rel=0.05)  # 2 % of f
    assert (damping > 0).all()
    assert peak(curve("one", [run])).damping > 1.0


def test_bed_of_few_shot_damps(setups, monkeypatch):
    from decays import RATE, cycles_of, ring

    monkeypatch.setitem(setups.COUNTS, 19.63e-3, (60,))
    damper = setups.layers(19.63e-3, 0, softening=1000.0)
    bed = setups.poured(damper)
    whole = setups.structure()
    case = setups.decay_case(whole, (Carried(damper, "tip", packing=bed),), 2e-3, 0.3, RATE)
    run = ring(case, 2e-3, whole.mass)
    assert run.mass_ratio == pytest.approx(60 * setups.SHOT_MASS / whole.mass)
    assert cycles_of(run)[2].mean() > 0.0


@pytest.mark.slow
def test_cosimulated_ball_follows_the_event_driven_solver():
    from compare import both

    displacement, damping = both(0.3)
    # Contacts last 40 us of a cycle of 50 ms, about a thousandth, and the difference grows from impact to impact.
    assert np.abs(displacement[1] / displacement[0] - 1.0).max() < 1e-3
    assert np.abs(damping[1] - damping[0]).max() < 0.05


def test_snapshots_show_the_ball_in_its_channel(setups):
    damper, bed = setups.channel(4.95e-3, 6e-3, restitution=0.3, softening=1000.0)
    whole = setups.structure(setups.INSERT_MASS[4.95e-3])
    case = setups.decay_case(whole, (Carried(damper, "tip", packing=bed),), 6e-3, 0.05, 2000.0)
    run = cosimulate(case._replace(snapshots=20))
    places = np.array([shots[0].position[0] for shots in run.snapshots])
    assert places[:, 0].min() > setups.BALL / 2 * 0.9
    assert places[:, 0].max() < setups.BALL / 2 * 1.1 + 4.95e-3
    assert np.ptp(places[:, 0]) > 4e-3  # it crosses
