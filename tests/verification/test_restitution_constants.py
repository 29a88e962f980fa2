"""Contact constants against collisions integrated in time, published fits and the limits of their closed forms."""

from decimal import Decimal, localcontext
from math import exp, inf, pi, sqrt

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from graindamp.dem.restitution import (
    LAWS,
    constant,
    contact_time_hertz,
    contact_time_linear,
    damping_ratio,
    gonthier_damping,
    gonthier_restitution,
    linear_damping,
    loss_table,
    max_overlap_hertz,
    plateau,
    restitution_at,
    tabulated,
    viscoelastic_damping,
)
from graindamp.errors import InputError

RESTITUTIONS = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 0.9, 0.95, 0.98)
COLLISIONS = ((3.81e9, 3.23e-5, 0.5), (2.0e5, 0.04, 2.0))
"""Stiffness [N/m^1.5 or N/m], effective mass [kg], impact speed [m/s]: hard small steel balls, soft large ones."""


def force_of(law, constants, stiffness, mass, speed):
    """Contact force [N] as a function of overlap and its rate, written from its definition."""
    first, second = constants
    root = sqrt(mass * stiffness)
    if law == "hertz-gonthier":
        return lambda x, v: stiffness * max(x, 0.0) ** 1.5 * max(second, 1 + first * v / speed)
    if law == "hertz-viscoelastic":
        return lambda x, v: stiffness * max(x, 0.0) ** 1.5 + first * root * max(x, 0.0) ** 0.25 * v
    return lambda x, v: stiffness * x + first * root * v


def collide(law, constants, tension, stiffness, mass, speed):
    """Rebound speed over impact speed [-], and contact time [s], of a collision integrated in time."""
    force = force_of(law, constants, stiffness, mass, speed)
    if law == "linear":
        time = contact_time_linear(stiffness, mass)
        overlap = speed * time / pi
    else:
        time = contact_time_hertz(stiffness, mass, speed)
        overlap = max_overlap_hertz(stiffness, mass, speed)

    def ends(_, y):
        return y[0] if tension or law == "hertz-gonthier" else force(*y)

    ends.terminal, ends.direction = True, -1
    path = solve_ivp(
        lambda _, y: (y[1], -force(*y) / mass),
        (0, 100 * time),
        (0.0, speed),
        method="DOP853",
        events=ends,
        rtol=1e-10,
        atol=(1e-12 * overlap, 1e-12 * speed),
    )
    assert path.status == 1
    return -path.y_events[0][0, 1] / speed, path.t_events[0][0]


@pytest.mark.parametrize(("stiffness", "mass", "speed"), COLLISIONS)
@pytest.mark.parametrize(
    ("law", "tension"),
    [
        ("hertz-gonthier", False),
        ("hertz-viscoelastic", False),
        ("hertz-viscoelastic", True),
        ("linear", False),
        ("linear", True),
    ],
)
def test_collision_returns_its_restitution(law, tension, stiffness, mass, speed):
    """The constants depend on restitution alone; 1e-8 is the integrator's share, its local tolerance being 1e-10."""
    for e in RESTITUTIONS:
        constants = loss_table(law, constant(e), speed_scale=0.03, tension=tension, n_node=2)[1]
        returned, _ = collide(law, constants, tension, stiffness, mass, speed)
        assert returned == pytest.approx(e, abs=1e-8)


def test_overdamped_collisions():
    """Below e = exp(-2) a contact without tension is overdamped, on both elastic laws."""
    for e in (0.02, exp(-2)):
        for law in ("linear", "hertz-viscoelastic"):
            constants = loss_table(law, constant(e), 0.03, n_node=2)[1]
            assert constants[0] >= (2 if law == "linear" else sqrt(5)) * (1 - 1e-12)
            assert collide(law, constants, False, *COLLISIONS[1])[0] == pytest.approx(e, abs=1e-8)
    assert damping_ratio(exp(-2), False) == pytest.approx(1, abs=1e-15)


def test_gonthier_table():
    e = [0.1, 0.2, 0.3, 0.4, 0.5, 0.54, 0.6, 0.63, 0.7, 0.8, 0.9, 0.92, 0.95, 0.98]
    d = "0.999816 0.983833 0.926125 0.832999 0.716375 0.665198 0.584923 0.543512 0.444380 0.298517 0.149834 0.119917 "
    assert [f"{x:.6f}" for x in gonthier_damping(e)] == (d + "0.074980 0.029999").split()
    for e, returned in ((0.9, 0.876), (0.5, 0.488)):
        rate = np.array([(1 - e**2) / e])  # The shortcut d = 1 - e^2 gives too hard a dashpot.
        assert _damping_of_rate(rate) / rate == pytest.approx(returned, abs=5e-4)  # printed digits


@pytest.mark.parametrize("e", [0.03, 0.1, 0.39, 0.41, 0.63, 0.9, 0.999, 1 - 1e-7, 1 - 1e-12])
def test_gonthier_holds_its_digits(e):
    """d relative to 1 - e, and 1 - d relative to itself, against the equation solved with 60 digits."""
    with localcontext() as context:
        context.prec = 60
        exact = Decimal(e)
        low, high = (1 - exact), Decimal(1)  # The root exceeds 1 - e; d = 0 is left out.
        for _ in range(150):
            d = (low + high) / 2
            above = (1 + d / exact).ln() - (1 - d).ln() > d * (1 + 1 / exact)
            low, high = (low, d) if above else (d, high)
        rest = float(1 - d)
        d = float(d)
    assert gonthier_damping(e) == pytest.approx(d, rel=2e-14, abs=0)
    assert loss_table("hertz-gonthier", constant(e), 1.0)[0, 1] == pytest.approx(rest, rel=2e-14, abs=0)


def test_gonthier_limits_and_inverse():
    assert gonthier_damping([1.0, 0.0]).tolist() == [0.0, 1.0]
    assert gonthier_restitution([0.0, 1.0]).tolist() == [1.0, 0.0]
    e = np.linspace(0.1, 1, 901)
    # 1e-16 of rounding in d near 1 is 2e-4 times larger relative to 1 - d: 2e-12 of it is left in e.
    np.testing.assert_allclose(gonthier_restitution(gonthier_damping(e)), e, rtol=2e-12)
    assert gonthier_damping(0.9).shape == ()
    assert gonthier_damping(np.ones((2, 3))).shape == (2, 3)


def test_damping_ratio_and_inverse():
    e = np.concatenate(
        [np.geomspace(1e-12, 0.1, 200), np.linspace(0.1, 1, 1000), exp(-2) * (1 + 1e-7 * np.arange(-9, 9))]
    )
    np.testing.assert_allclose(restitution_at(damping_ratio(e, False), False), e, rtol=1e-13)
    np.testing.assert_allclose(restitution_at(damping_ratio(e, True), True), e, rtol=1e-12)  # zeta near 1 at 1e-12.
    for tension in (False, True):
        assert damping_ratio(1.0, tension) == 0
        assert damping_ratio(1 - 1e-12, tension) == pytest.approx((1 - (1 - 1e-12)) / pi, rel=1e-10)  # ln e = -(1 - e).
    assert np.isfinite(damping_ratio([5e-324, 1e-300], False)).all()
    assert restitution_at([1.0, 3.0], True).tolist() == [0, 0]


def test_constants_of_the_other_end_of_contact():
    """Constants made with tension, used without: the usual slip, with its size."""
    e = [0.3, 0.5, 0.6, 0.7, 0.8, 0.9]
    hertz = restitution_at(viscoelastic_damping(e, True) / sqrt(5), False)
    np.testing.assert_allclose(hertz, [0.397, 0.550, 0.632, 0.718, 0.808, 0.902], atol=5e-4)
    linear = restitution_at(linear_damping([0.2, 0.5, 0.8, 0.92], True) / 2, False)
    np.testing.assert_allclose(linear, [0.325, 0.550, 0.808, 0.921], atol=5e-4)
    constants = (float(viscoelastic_damping(0.5, True)), 0.0)
    assert collide("hertz-viscoelastic", constants, False, *COLLISIONS[0])[0] == pytest.approx(
        float(hertz[1]), abs=1e-8
    )


def test_fit_of_thornton_cummins_cleary():
    """Their polynomial, without tension, returns e within 0.002 up to 0.95, as stated, and falls short beyond."""
    h = (-6.918798, -16.41105, 146.8049, -796.4559, 2928.711, -7206.864, 11494.29, -11342.18, 6276.757, -1489.915)
    e = np.linspace(0.02, 0.95, 94)
    exponent = e * np.polynomial.polynomial.polyval(e, h)
    ratio = np.sqrt(1 / (1 - (1 + e) ** 2 * np.exp(exponent)) - 1)
    alpha = 2 * ratio * sqrt(1.5)  # Their dashpot is 2 ratio sqrt(m k_tangent), k_tangent = 1.5 k delta^0.5.
    returned = restitution_at(alpha / sqrt(5), False)
    np.testing.assert_allclose(returned, e, rtol=0, atol=0.002)
    np.testing.assert_allclose(returned[e < 0.92], e[e < 0.92], rtol=0, atol=3e-4)


def test_polynomial_of_tsuji_tanaka_ishida():
    """Their polynomial, with tension and the mass of one of two equal particles, is good to 0.001 in e from 0.1 on."""
    terms = (1.2728, -4.2783, 11.087, -22.348, 27.467, -18.022, 4.8218)
    e = np.linspace(0.1, 0.98, 89)
    alpha = np.polynomial.polynomial.polyval(e, terms) * sqrt(2)
    np.testing.assert_allclose(restitution_at(alpha / sqrt(5), True), e, rtol=0, atol=1.2e-3)
    assert restitution_at(alpha[40] / sqrt(10), True) == pytest.approx(0.616, abs=5e-4)  # e = 0.5 without the sqrt 2.


def test_elastic_collisions():
    """Duration and overlap of steel balls of radius 1.25 mm on each other and on an aluminium wall."""
    ball = 4 / 3 * pi * 1.25e-3**3 * 7900
    pair, wall = 4 / 3 * 114.3e9 * sqrt(1.25e-3 / 2), 4 / 3 * 58.46e9 * sqrt(1.25e-3)
    for stiffness, mass, speed, overlap, force, time in (
        (pair, ball / 2, 0.1, 0.408e-6, 0.991, 12.0e-6),
        (pair, ball / 2, 1.0, 2.571e-6, 15.71, 7.57e-6),
        (wall, ball, 1.0, 3.862e-6, 20.92, 11.4e-6),
    ):
        assert max_overlap_hertz(stiffness, mass, speed) == pytest.approx(overlap, rel=1.5e-3)  # Digits of the table.
        assert stiffness * max_overlap_hertz(stiffness, mass, speed) ** 1.5 == pytest.approx(force, rel=1e-3)
        assert contact_time_hertz(stiffness, mass, speed) == pytest.approx(time, rel=5e-3)
    assert contact_time_hertz(pair, ball, 0.0) == inf
    for law, time in (
        ("hertz-gonthier", contact_time_hertz(2e5, 0.04, 2.0)),
        ("linear", contact_time_linear(2e5, 0.04)),
    ):
        returned, duration = collide(law, loss_table(law, constant(1), 1.0)[0], True, 2e5, 0.04, 2.0)
        assert returned == pytest.approx(1, abs=1e-8)
        assert duration == pytest.approx(time, rel=1e-8)


def test_curves():
    speed = np.array([0.0, 1e-300, 0.03, 1e300, inf])
    np.testing.assert_allclose(plateau(0.6, 0.03, 2)(speed), [1, 1, 0.8, 0.6, 0.6], rtol=1e-15)
    assert constant(0.7)(speed).tolist() == [0.7] * 5
    v, e = [1e-3, 1e-2, 0.1, 1.0], [1.0, 0.9, 0.6, 0.6]
    curve = tabulated(v, e)
    np.testing.assert_allclose(curve(np.array(v)), e, rtol=1e-14)
    assert curve(np.array([0.0, 1e-4, 9.0, inf])).tolist() == [1.0, 1.0, 0.6, 0.6]
    assert curve(np.sqrt(1e-2 * 0.1)) == pytest.approx(0.75, rel=1e-14)
    assert tabulated([0.5], [0.8])(speed).tolist() == [0.8] * 5


@pytest.mark.parametrize("tension", [False, True])
@pytest.mark.parametrize("law", LAWS)
def test_loss_table(law, tension):
    """Node i is at v = v_ref u/(1 - u); elastic rows are conservative to the bit."""
    curve = plateau(0.6, 0.03, 2)
    table = loss_table(law, curve, 0.05, tension)
    assert table.shape == (513, 2)
    assert table[0].tolist() == ([0, 1] if law == "hertz-gonthier" else [0, 0])
    at = {0: 0.0, 128: 0.05 / 3, 256: 0.05, 384: 0.15, 512: inf}
    for node, speed in at.items():
        e = float(curve(np.array(speed)))
        expected = {
            "hertz-gonthier": (gonthier_damping(e) / e, 1 - gonthier_damping(e)),
            "hertz-viscoelastic": (viscoelastic_damping(e, tension), 0),
            "linear": (linear_damping(e, tension), 0),
        }[law]
        np.testing.assert_allclose(table[node], np.array(expected, dtype=float), rtol=1e-13)
    elastic = loss_table(law, constant(1.0), 0.05, tension)
    assert (elastic == ([0, 1] if law == "hertz-gonthier" else [0, 0])).all()


@pytest.mark.parametrize(("exponent", "bound"), [(1, 4e-7), (2, 2e-6)])
@pytest.mark.parametrize("law", LAWS)
def test_accuracy_between_nodes(law, exponent, bound):
    """The restitution half-way between nodes, as documented; halving the spacing quarters the error."""
    curve = plateau(0.54, 0.03, exponent)
    errors = []
    for n_node in (257, 513):
        table = loss_table(law, curve, 0.03, n_node=n_node)
        middle = (table[1:] + table[:-1]) / 2
        u = (np.arange(n_node - 1) + 0.5) / (n_node - 1)
        if law == "hertz-gonthier":
            rate = middle[:, 0]
            d = _damping_of_rate(rate)
            returned = d / rate  # The floor 1 - d of the force, also interpolated, is off by as little.
        else:
            returned = restitution_at(middle[:, 0] / (2 if law == "linear" else sqrt(5)), False)
        errors.append(np.max(np.abs(returned - curve(0.03 * u / (1 - u)))))
    assert errors[1] < bound
    assert errors[0] / errors[1] == pytest.approx(4, rel=0.05)  # 0.05: next-order term at the steepest interval.


def _damping_of_rate(rate):
    """Gonthier's d from d/e, by halving intervals of the work -d - ln(1 - d) = x - ln(1 + x)."""
    low, high = np.zeros_like(rate), np.ones_like(rate)
    for _ in range(60):
        d = (low + high) / 2
        above = -d - np.log1p(-d) > rate - np.log1p(rate)
        low, high = np.where(above, low, d), np.where(above, d, high)
    return d


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: gonthier_damping([0.5, 1.2]), "restitution is 1.2, but must be from 0 to 1"),
        (lambda: gonthier_restitution(-0.1), "damping d is -0.1"),
        (lambda: damping_ratio(0.0, True), "restitution is 0.0, but must be above 0 and at most 1"),
        (lambda: damping_ratio(np.nan, True), "restitution is nan"),
        (lambda: restitution_at(-1, False), "damping ratio is -1"),
        (lambda: constant(0), "restitution is 0.0"),
        (lambda: plateau(1.1, 0.03, 1), "restitution at high speed is 1.1"),
        (lambda: plateau(0.5, 0, 1), "speed of the restitution curve is 0 m/s"),
        (lambda: plateau(0.5, 0.03, -1), "exponent of the restitution curve is -1"),
        (lambda: tabulated([0, 1], [1, 0.5]), "leave out a speed of 0"),
        (lambda: tabulated([], []), "0 speeds and 0 restitutions"),
        (lambda: tabulated([1, 2], [1, 0.5, 0.4]), "2 speeds and 3 restitutions"),
        (lambda: loss_table("hertz", constant(1), 1.0), "contact law is 'hertz', but must be one of hertz-gonthier"),
        (lambda: loss_table("linear", constant(1), 0.0), "speed scale of the loss table is 0.0 m/s"),
        (lambda: loss_table("linear", lambda v: 1 - v / 0.5, 0.5), "e is 0 at an impact speed of 0.5 m/s"),
        (lambda: loss_table("linear", lambda v: np.full(v.shape, 1.5), 0.5), "e is 1.5 at an impact speed of 0 m/s"),
    ],
)
def test_mistakes_are_explained(call, message):
    with pytest.raises(InputError, match=message):
        call()
