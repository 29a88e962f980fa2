"""Eight impacts of Chung & Ooi (2011), Granular Matter 13, 643-656: rigid-body results and digitised curves.

Impacts that do not depend on each other share one world, far apart.
"""

from math import atan, degrees, sqrt

import numpy as np
import pytest

from dem_made import RIGID, damper_of, hertz, hertz_time, made, mass_of, state_of
from graindamp.dem.engine import run
from graindamp.dem.restitution import gonthier_damping, max_overlap_hertz

GLASS = {"name": "glass", "youngs_modulus": 48e9, "poisson_ratio": 0.20, "density": 2800.0}
LIMESTONE = {"name": "limestone", "youngs_modulus": 20e9, "poisson_ratio": 0.25, "density": 2500.0}
ALUMINIUM = {"name": "aluminium alloy", "youngs_modulus": 70e9, "poisson_ratio": 0.30, "density": 2699.0}
MAGNESIUM = {"name": "magnesium alloy", "youngs_modulus": 40e9, "poisson_ratio": 0.35, "density": 1800.0}
OXIDE = {"name": "aluminium oxide", "youngs_modulus": 380e9, "poisson_ratio": 0.23, "density": 4000.0}
IRON = {"name": "cast iron", "youngs_modulus": 100e9, "poisson_ratio": 0.25, "density": 7000.0}
ALLOY = {"name": "aluminium alloy", "youngs_modulus": 70e9, "poisson_ratio": 0.33, "density": 2700.0}
STEEL = {"name": "steel", "youngs_modulus": 208e9, "poisson_ratio": 0.30, "density": 7850.0}
POLYETHYLENE = {"name": "polyethylene", "youngs_modulus": 1e9, "poisson_ratio": 0.40, "density": 1400.0}
NYLON = {"name": "nylon", "youngs_modulus": 2.5e9, "poisson_ratio": 0.40, "density": 1000.0}
COPPER = {"name": "copper", "youngs_modulus": 120e9, "poisson_ratio": 0.35, "density": 8900.0}
"""Moduli and densities of the last four are not printed beside the curves, and their results do not depend on them."""

GAP = 1e-3
"""Way to the impact over the radius [-]."""


def impact(particle, radius, velocity, spin=(0.0, 0.0, 0.0), n_step=400, **contact):
    """Velocities [m/s] and spins [rad/s] of spheres after their impacts on a rigid floor, and the world.

    `velocity` (sphere, 3) and `spin` (sphere, 3); all spheres have the same radius; `n_step` steps per elastic contact
    at the largest speed.
    """
    velocity = np.atleast_2d(np.asarray(velocity, dtype=float))
    n = len(velocity)
    slow, fast = -velocity[:, 2].max(), -velocity[:, 2].min()
    stiffness, mass = hertz(radius, particle, RIGID), mass_of(radius, particle["density"])
    time_step = hertz_time(stiffness, mass, fast) / n_step
    # Every sphere stands off as far as its speed carries it in the same time.
    height = radius * (1.0 + GAP * -velocity[:, 2] / fast)
    position = np.column_stack([5.0 * radius * np.arange(n), np.zeros(n), height])
    worlds = made(damper_of(particle, RIGID, **contact), time_step, position, radius, velocity, spin)
    duration = GAP * radius / fast + 1.6 * hertz_time(stiffness, mass, slow)
    worlds = run(worlds, int(duration / time_step))
    _, velocity, spin = state_of(worlds)
    assert (velocity[:, 2] > 0.0).all()
    return velocity, spin, worlds


def overlap(material, radius, speed):
    """Largest overlap of an elastic impact on a rigid plane over the radius [-]."""
    return max_overlap_hertz(hertz(radius, material, RIGID), mass_of(radius, material["density"]), speed) / radius


def watched(worlds, n_step):
    """Largest overlap [m], largest force [N] and duration [s] of the contact of the first particle, step by step."""
    overlap, force, n_touching = 0.0, 0.0, 0
    for _ in range(n_step):
        worlds = run(worlds, 1)
        place = worlds.particles.position[0]
        reach = place[:, 3].sum() - np.hypot(*np.diff(place[:, :3], axis=0)[0, ::2]) if len(place) > 1 else None
        overlap = max(overlap, place[0, 3] - place[0, 2] if reach is None else reach)
        now = np.sqrt(np.sum(worlds.particles.force[0, 0] ** 2))
        force, n_touching = max(force, now), n_touching + (now > 0.0)
    return overlap, force, n_touching * worlds.rules.time_step[0]


PEAK = 3e-5
"""Half a step off the peak of a parabola, (pi / 800)^2 / 2 = 8e-6 at 400 steps per contact, and printed digits."""


@pytest.mark.parametrize(
    ("material", "overlap", "force", "time"),
    [(GLASS, 274.11e-6, 10696.9, 40.34e-6), (LIMESTONE, 368.30e-6, 7108.2, 54.20e-6)],
)
def test_1_two_equal_spheres(material, overlap, force, time):
    radius, n_step = 0.01, 400
    worlds = made(
        damper_of(material, material, friction=0.35, tangential="mindlin"),
        time / n_step,
        [[-1.01 * radius, 0, 1], [1.01 * radius, 0, 1]],
        radius,
        [[10, 0, 0], [-10, 0, 0]],
    )
    assert watched(worlds, 2 * n_step) == pytest.approx((overlap, force, time), rel=PEAK, abs=time / n_step)
    _, velocity, spin = state_of(worlds)
    assert np.sort(velocity[:, 0]) == pytest.approx([-10.0, 10.0], rel=1e-5)  # second order: 1 / 400^2, times pi^2 / 4
    assert not spin.any()


@pytest.mark.parametrize(
    ("material", "overlap", "force", "time"),
    [(ALUMINIUM, 49.717e-6, 11369.9, 731.7e-6), (MAGNESIUM, 52.123e-6, 7232.7, 767.1e-6)],
)
def test_2_sphere_on_rigid_plane(material, overlap, force, time):
    worlds = made(damper_of(material, RIGID), time / 400, [[0, 0, 0.1]], 0.1, [[0, 0, -0.2]])
    assert watched(worlds, 450) == pytest.approx((overlap, force, time), rel=PEAK, abs=1.1 * time / 400)  # whole steps
    # Conservative: the error of both halves cancels but for where the contact ends within a step; measured 4e-8. A
    # loss of the second order would be 1 / 400^2, times pi^2 / 4, and fail.
    assert state_of(worlds)[1][0] == pytest.approx([0, 0, 0.2], rel=1e-6)


@pytest.mark.parametrize(
    ("material", "overlap", "force", "time"),
    [(OXIDE, 8.089e-6, 615.35, 6.10e-6), (IRON, 17.189e-6, 506.76, 12.97e-6)],
)
def test_3_restitution(material, overlap, force, time):
    for restitution in (0.2, 0.4, 0.6, 0.8, 1.0):
        velocity, _, _ = impact(material, 2.5e-3, [[0, 0, -3.9]], restitution=restitution)
        # Second order: at 400 steps measured 3e-6 to 5e-5, most at 0.2, where the dashpot of onset is five times as
        # strong.
        assert velocity[0, 2] / 3.9 == pytest.approx(restitution, rel=1e-4)
    worlds = made(damper_of(material, RIGID), time / 400, [[0, 0, 2.5e-3]], 2.5e-3, [[0, 0, -3.9]])
    # 5e-3 of the time is what three printed digits leave.
    assert watched(worlds, 450) == pytest.approx((overlap, force, time), rel=2 * PEAK, abs=5e-3 * time)


ANGLE = np.array([5, 10, 15, 20, 25, 30, 35, 40, 50, 60, 70, 80, 85])
TANGENTIAL_RESTITUTION = [0.948, 0.687, 0.624, 0.616, 0.634, 0.684, 0.737, 0.781, 0.845, 0.893, 0.932, 0.966, 0.983]
SPIN = [19, 213, 378, 511, 599, 617, 582, 545, 457, 357, 246, 126, 63]
"""Digitised curves of aluminium oxide, Kratos reference files."""


def oblique(material, n_step, tangential="mindlin"):
    """Tangential restitution [-] and spin [rad/s] after impacts at 3.9 m/s, under ANGLE from the normal."""
    angle = np.radians(ANGLE)
    velocity = 3.9 * np.column_stack([np.sin(angle), 0 * angle, -np.cos(angle)])
    after, spin, _ = impact(
        material, 2.5e-3, velocity, n_step=n_step, restitution=0.98, friction=0.092, tangential=tangential
    )
    return after[:, 0] / velocity[:, 0], spin[:, 1]


@pytest.mark.parametrize("material", [OXIDE, ALLOY])
@pytest.mark.parametrize("tangential", ["mindlin", "tanh"])
def test_4_oblique_impact_in_gross_sliding(material, tangential):
    """Beyond 32.5 degrees the contact slides throughout: impulses follow from the normal one."""
    ratio, spin = oblique(material, 400, tangential)
    assert degrees(atan(3.5 * 0.092 * 1.98)) == pytest.approx(32.5, abs=0.05)
    sliding = ANGLE > 36
    angle = np.radians(ANGLE[sliding])
    # 2e-3: the arm is the radius less the overlap, 0.3 to 0.7 %, of a share of 0.22 of the tangential speed.
    np.testing.assert_allclose(ratio[sliding], 1 - 0.092 * 1.98 / np.tan(angle), atol=2e-3)
    np.testing.assert_allclose(spin[sliding], 2.5 * 0.092 * 1.98 * 3.9 * np.cos(angle) / 2.5e-3, rtol=8e-3)


def test_4_oblique_impact_against_the_curve():
    """Below gross sliding the spring without micro-slip follows the digitised curve of the full Mindlin theory."""
    ratio, spin = oblique(OXIDE, 1600)
    # At 5 degrees nothing slips as a whole and the curve is all micro-slip, which the law leaves out.
    follows = ANGLE > 8
    np.testing.assert_allclose(ratio[follows], np.array(TANGENTIAL_RESTITUTION)[follows], atol=0.03)
    np.testing.assert_allclose(spin[follows], np.array(SPIN)[follows], atol=0.03 * max(SPIN))


FIRST_ERROR = 2e-3
"""Of the tangential restitution at 40 steps per contact [-]; second order, measured 4e-4."""


def test_4_tangential_springs_converge():
    """Spring forces grow by the slip times the step: what the step adds falls with it."""
    fine, _ = oblique(OXIDE, 2560)
    error = [abs(oblique(OXIDE, n)[0] - fine).max() for n in (40, 160, 640)]
    assert error[0] < FIRST_ERROR
    assert error[2] < error[1] < error[0]


def spring_impacts(material, n_step):
    """As :func:`oblique`, from the equations of motion of one sphere, written from the law, by other means."""
    radius, restitution, friction = 2.5e-3, 0.98, 0.092
    mass, k = mass_of(radius, material["density"]), hertz(radius, material)
    nu = material["poisson_ratio"]
    shear = 8 * material["youngs_modulus"] / (2 * (1 + nu)) / (2 - nu) * sqrt(radius)
    damping = float(gonthier_damping(restitution)) / restitution
    angle = np.radians(ANGLE)
    onset = 3.9 * np.cos(angle)
    depth, rate, along, turn, spring = 0 * angle, onset.copy(), 3.9 * np.sin(angle), 0 * angle, 0 * angle
    before = 0 * angle
    step = hertz_time(k, mass, onset.max()) / n_step
    # Semi-implicit Euler, first order: the steps are so many that its error is below that of the engine.
    for _ in range(int(3 * n_step)):
        depth = depth + step * rate
        touching = depth > 0.0
        press = np.where(touching, k * np.maximum(depth, 0.0) ** 1.5 * (1 + damping * rate / onset), 0.0)
        stiffness = shear * np.sqrt(np.maximum(depth, 0.0))
        drop = np.where(stiffness < before, stiffness / np.where(before > 0, before, 1.0), 1.0)
        spring = drop * spring - stiffness * (along - (radius - depth) * turn) * step
        spring = np.clip(spring, -friction * press, friction * press)
        before = stiffness
        rate = rate - step * press / mass
        along = along + step * spring / mass
        turn = turn - step * (radius - depth) * spring / (0.4 * mass * radius**2)
    return along / (3.9 * np.sin(angle)), turn


@pytest.mark.parametrize("material", [OXIDE, ALLOY])
def test_4_oblique_impact_is_what_its_equations_say(material):
    ratio, spin = oblique(material, 1600)
    expected_ratio, expected_spin = spring_impacts(material, 4000)
    np.testing.assert_allclose(ratio, expected_ratio, atol=3e-3)  # both first order in the step at most
    np.testing.assert_allclose(spin, expected_spin, atol=3e-3 * max(SPIN))


@pytest.mark.parametrize("material", [STEEL, POLYETHYLENE])
def test_5_oblique_impact_at_fixed_normal_speed(material):
    """Sliding throughout: slip over mu v_n drops by 7, spin by 5. Between sticking and sliding: a minimum.

    The figure of this test has three curves that differ there. Finite elements turn at -1.72, between 4.0 and 4.8. The
    spring codes of the paper go down to -2.79 (steel) and -2.95 (polyethylene) at 4.0, where sliding in one direction
    throughout would give 4 - 7 = -3: no spring of Mindlin's stiffness does that, -1.66 and -1.79 is the least even if
    its force is not lowered as the contact unloads. Test 4, digitised and put into the same numbers (slip changes by
    3.5 times the centre's speed), runs through -0.92, -1.36, -1.43, -0.67 at 2.9, 4.0, 5.1, 6.3, as here. The finite
    elements and test 4 are what is held, not the codes.
    """
    radius, speed, friction = 1e-5, 5.0, 0.3
    slip = np.array([1, 2, 3, 3.5, 4, 4.5, 5, 6, 9, 12, 15, 20])
    velocity = np.column_stack([slip * friction * speed, 0 * slip, 0 * slip - speed])
    after, spin, _ = impact(material, radius, velocity, n_step=1600, friction=friction, tangential="mindlin")
    turn = radius * spin[:, 1] / (friction * speed)
    rebound = after[:, 0] / (friction * speed) - turn
    sliding = slip > 8
    share = overlap(material, radius, speed)  # by which the arm is shorter than the radius at most
    np.testing.assert_allclose(turn[sliding], 5.0, rtol=share)
    np.testing.assert_allclose(rebound[sliding], slip[sliding] - 7.0, atol=5.0 * share)
    least = np.argmin(rebound)
    assert 4.0 <= slip[least] <= 5.0
    # Measured -1.49 and -1.64: the law leaves out micro-slip, and the curve spreads by Poisson's ratio.
    assert rebound[least] == pytest.approx(-1.72, abs=0.25)


SPINS = np.array([0.5, 1.0, 2.0, 3.0, 4.5, 6.0, 8.0, 12.0, 18.0])
"""Initial spins [rad/s] of tests 6 and 8."""


@pytest.mark.parametrize("material", [ALUMINIUM, NYLON])
def test_6_spinning_sphere_on_plane(material):
    radius, speed, friction, restitution = 0.1, 0.2, 0.4, 0.5
    spin = np.column_stack([0 * SPINS, SPINS, 0 * SPINS])
    velocity = np.tile([0, 0, -speed], (len(SPINS), 1))
    after, turn, _ = impact(
        material, radius, velocity, spin, n_step=800, friction=friction, restitution=restitution, tangential="mindlin"
    )
    slip = -radius * SPINS
    x = 3.5 * friction * (1 + restitution) * speed / abs(slip)
    rebound = (after[:, 0] - radius * turn[:, 1]) / slip
    share = overlap(material, radius, speed)
    sliding = x < 0.95
    assert sliding.sum() >= 4
    # -rebound = beta = x - 1; the shorter arm costs 2.5 of the 3.5 shares twice its shortening, the steps 1e-3 more.
    np.testing.assert_allclose(-rebound[sliding], x[sliding] - 1, atol=2 * share + 1e-3)
    recoil = (after[:, 0] - radius * turn[:, 1])[sliding] / after[sliding, 2]
    incidence = (slip / speed)[sliding]
    expected = np.sign(incidence) * (abs(incidence) - 3.5 * friction * (1 + restitution)) / restitution
    np.testing.assert_allclose(recoil, expected, atol=4.2 * (2 * share + 2e-3))
    sticking = x > 2.0
    assert (abs(rebound[sticking]) < 1.0).all()  # a passive contact slips slower after than before


@pytest.mark.parametrize("material", [ALUMINIUM, COPPER])
@pytest.mark.parametrize("tangential", ["mindlin", "tanh"])
def test_7_opposite_spins_roll_off_each_other(material, tangential):
    """Surfaces of two equal spheres with opposite spins do not slip: nothing tangential happens."""
    radius, speed = 0.1, 0.2
    for spin in (1.0, 5.0, 20.0):
        stiffness = hertz(radius / 2, material, material)
        time = hertz_time(stiffness, mass_of(radius, material["density"]) / 2, 2 * speed)
        worlds = made(
            damper_of(material, material, friction=0.4, restitution=0.5, tangential=tangential),
            time / 200,
            [[-1.0005 * radius, 0, 1], [1.0005 * radius, 0, 1]],
            radius,
            [[speed, 0, 0], [-speed, 0, 0]],
            [[0, spin, 0], [0, -spin, 0]],
        )
        worlds = run(worlds, int((0.0005 * radius / speed + 2 * time) / (time / 200)))
        _, velocity, turn = state_of(worlds)
        np.testing.assert_allclose(turn[:, 1], [spin, -spin], rtol=1e-13)  # rounding
        np.testing.assert_allclose(velocity[:, 1:], 0.0, atol=1e-15)
        assert velocity[1, 0] == pytest.approx(0.5 * speed, rel=1e-3)  # second order at 200 steps


def test_8_unequal_spheres_tend_to_sphere_on_plane():
    """A small spinning sphere on ever larger ones: what is left to the plane of test 6 is the ratio of masses."""
    radius, speed, spin, n_step = 0.1, 0.2, 3.0, 800
    contact = {"friction": 0.4, "restitution": 0.5, "tangential": "mindlin"}
    time = hertz_time(hertz(radius, ALUMINIUM, ALUMINIUM), mass_of(radius, ALUMINIUM["density"]), speed)

    def rebound(ratio):
        """Velocities of the small sphere after it met one `ratio` times as large, or a plane for 0."""
        floor = {"kind": "walls", "planes": [{"name": "floor", "point": [0, 0, -1e3 if ratio else 0], "normal": "z"}]}
        position, size = [[0, 0, radius * 1.0001], [0, 0, -ratio * radius]], [radius, ratio * radius]
        velocity, turn = [[0, 0, -speed], [0, 0, 0]], [[0, spin, 0], [0, 0, 0]]
        n = 2 if ratio else 1
        damper = damper_of(ALUMINIUM, ALUMINIUM, floor, **contact)
        worlds = made(damper, time / n_step, position[:n], size[:n], velocity[:n], turn[:n], skin=0.05 * radius)
        worlds = run(worlds, int((1e-4 * radius / speed + 2.5 * time) / (time / n_step)))
        _, velocity, turn = state_of(worlds)
        return np.array([velocity[0, 0], velocity[0, 2], turn[0, 1] * radius])

    plane = rebound(0)
    error = [abs(rebound(ratio) - plane).max() / speed for ratio in (2.0, 4.0, 8.0)]
    # Momentum taken from the small sphere is less by 1 / (1 + ratio^3): 1/9, 1/65, 1/513 of at most 1.5 of its speed.
    assert error[0] / error[1] == pytest.approx(65 / 9, rel=0.1)  # what overlap and steps leave, 1e-3, over 1.5/65
    assert error[2] < 1.5 / 513 + 1e-3
