"""Head-on impacts by simulation against the restitution that was asked for, and the order at which they converge."""

from itertools import pairwise

import numpy as np
import pytest

from dem_made import RIGID, STEEL, damper_of, hertz, hertz_time, made, mass_of, state_of
from graindamp.dem.engine import run
from graindamp.dem.restitution import contact_time_linear

RADIUS = 2e-3
MASS = mass_of(RADIUS, STEEL["density"])
LAWS = {
    "gonthier": {"law": "hertz-gonthier"},
    "viscoelastic": {"law": "hertz-viscoelastic"},
    "viscoelastic-tension": {"law": "hertz-viscoelastic", "tension": True},
    "linear": {"law": "linear"},
    "linear-tension": {"law": "linear", "tension": True},
}

STEP_ERROR = {"hertz-gonthier": 1e-4, "hertz-viscoelastic": 1e-3, "linear": 4e-3}
"""What the restitution may be off by at 200 steps per contact [-]: twice the errors whose orders are tested below."""


def rebound(law, restitution, speed, stiff=1.0, n_step=200, phase=0.0, pair=False):
    """Rebound over impact speed [-] of a sphere on a plane, or of two equal spheres.

    `stiff` softens Hertz contacts by its inverse and multiplies 1e6 N/m of linear ones; `phase` [steps] is the time
    left to the impact when the world starts, beyond some whole steps.
    """
    contact = dict(LAWS[law], restitution=restitution)
    if contact["law"] == "linear":
        contact["stiffness"] = 1e6 * stiff
        time = contact_time_linear(contact["stiffness"], MASS)
    else:
        contact["softening"] = 1.0 / stiff
        time = hertz_time(hertz(RADIUS, STEEL, RIGID) * stiff, MASS, speed)
    time_step = time / n_step
    gap = speed * (3 + phase) * time_step
    damper = damper_of(STEEL, STEEL if pair else RIGID, **contact)
    if pair:
        position, velocity = [[-RADIUS - gap, 0, 1], [RADIUS, 0, 1]], [[speed, 0, 0], [0, 0, 0]]
    else:
        position, velocity = [[0, 0, RADIUS + gap]], [[0, 0, -speed]]
    worlds = made(damper, time_step, position, RADIUS, velocity)
    # An overdamped contact leaves in its own time; four elastic contact times see most of them off.
    for _ in range(60):
        worlds = run(worlds, 4 * n_step)
        if worlds.clock.counts[0, 2] + worlds.clock.counts[0, 3] and not worlds.particles.force[0].any():
            break
    _, velocity, _ = state_of(worlds)
    return (velocity[1, 0] - velocity[0, 0]) / speed if pair else velocity[0, 2] / speed


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("restitution", [0.1, 0.3, 0.5, 0.7, 0.9, 0.98])
def test_restitution_is_what_was_asked_for(law, restitution):
    """Stiffness, speed and partner do not matter to a law of constant restitution."""
    for stiff, speed, pair in ((1.0, 1.0, False), (1.0, 0.01, True), (1e-3, 10.0, False)):
        returned = rebound(law, restitution, speed, stiff, pair=pair)
        assert returned == pytest.approx(restitution, abs=STEP_ERROR[LAWS[law]["law"]])


def errors(law, restitution, counts):
    """Mean and spread over the phase of the impact within a step, of what the restitution is off by."""
    phases = (np.arange(8) + 0.5) / 8
    off = np.array([[rebound(law, restitution, 1.0, n_step=n, phase=p) - restitution for p in phases] for n in counts])
    return np.sqrt(np.mean(off**2, axis=1))


STEPS = (50, 100, 200, 400)


@pytest.mark.parametrize("restitution", [0.3, 0.6, 0.9])
def test_second_order_where_the_force_begins_smoothly(restitution):
    error = errors("gonthier", restitution, STEPS)
    assert error[0] < 6e-4
    for a, b in pairwise(error):
        assert a / b == pytest.approx(4, rel=0.08)  # next-order term, measured 4.00 to 4.22


@pytest.mark.parametrize("restitution", [0.3, 0.6, 0.9])
def test_order_of_a_dashpot_that_begins_as_a_root(restitution):
    """Force begins as the fourth root of the overlap, so that the first step leaves an error of order 5/4."""
    error = errors("viscoelastic", restitution, STEPS)
    for a, b in pairwise(error):
        assert a / b == pytest.approx(2**1.25, rel=0.15)  # second-order part, measured 2.38 to 2.65


@pytest.mark.parametrize("restitution", [0.1, 0.3, 0.6])
def test_first_order_where_the_force_jumps(restitution):
    """A linear dashpot acts in full in the first step of contact, which begins anywhere within a step."""
    error = errors("linear", restitution, STEPS)
    for a, b in pairwise(error):
        assert a / b == pytest.approx(2, rel=0.02)  # second-order part, measured 1.995 to 2.01


@pytest.mark.parametrize("restitution", [0.1, 0.3, 0.6, 0.9])
@pytest.mark.parametrize("law", ["viscoelastic-tension", "linear-tension"])
def test_contacts_under_tension_end_anywhere_within_a_step(law, restitution):
    """A pull that ends at zero overlap is cut off up to a step late: bounded by a first order, without being one."""
    assert (errors(law, restitution, STEPS) * STEPS < 0.35).all()  # 0.30 measured, at half of the largest pull


@pytest.mark.parametrize("law", LAWS)
def test_elastic_impacts_return_all_speed(law):
    """Leapfrog of a conservative force that is entered and left at other phases of a step: second order."""
    for n_step in (50, 200):
        assert rebound(law, 1.0, 1.0, n_step=n_step) == pytest.approx(1.0, abs=1.0 / n_step**2)


@pytest.mark.parametrize("law", ["gonthier", "viscoelastic", "linear"])
def test_restitution_follows_its_curve_over_speed(law):
    """A plateau curve, from far below to far above its reference speed."""
    for speed in (1e-3, 1e-2, 0.03, 0.1, 1.0, 10.0):
        curve = {"plateau": 0.6, "reference_speed": 0.03, "exponent": 1.0}
        expected = 0.6 + 0.4 / (1 + speed / 0.03)
        assert rebound(law, curve, speed) == pytest.approx(expected, abs=STEP_ERROR[LAWS[law]["law"]])


def test_restitution_follows_a_table_over_speed():
    table = {"speed": [0.01, 0.1, 1.0], "restitution": [0.95, 0.8, 0.6]}
    for speed, expected in (
        (1e-3, 0.95),
        (0.01, 0.95),
        (np.sqrt(1e-3), 0.875),
        (0.1, 0.8),
        (np.sqrt(0.1), 0.7),
        (5, 0.6),
    ):
        # Between nodes of the loss table, and at its kinks, 1e-4 beside the steps.
        assert rebound("gonthier", table, speed) == pytest.approx(expected, abs=4e-4)


def test_slow_contacts_lose_little():
    """Below the least speed that damping is set for, a contact is nearly elastic, not ever more strongly damped."""
    returned = [rebound("gonthier", 0.5, speed) for speed in (1e-4, 1e-5, 1e-6, 1e-7)]
    assert returned[0] == pytest.approx(0.5, abs=1e-3)
    assert returned[1] == pytest.approx(0.5, abs=1e-3)
    # At a tenth of that speed the dashpot is a tenth of its own: 1 - e falls by about ten.
    assert 0.9 < returned[2] < returned[3] < 1.0
