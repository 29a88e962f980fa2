"""Constants of the contact laws from the coefficient of restitution: dashpots, speed curves, contact times.

A contact law loses energy by a constant; a person knows a coefficient of restitution e [-], often as a curve over the
impact speed. Every relation here is the exact one of a head-on collision. `loss_table` tabulates the constants over the
impact speed for the machine.

The three laws, with overlap delta [m], its rate v [m/s], stiffness k and effective mass m [kg]:

- hertz-gonthier: F = k delta^1.5 max(1 - d, 1 + (d/e) v / v_onset);
- hertz-viscoelastic: F = k delta^1.5 + alpha sqrt(m k) delta^0.25 v;
- linear: F = k delta + 2 zeta sqrt(m k) v.

The last two pull at the end of a contact. Either tension is allowed and the contact ends at delta = 0, or it is cut off
and the contact ends at F = 0. A constant made for one end returns a wrong restitution with the other: 0.550 for 0.5.
"""

from collections.abc import Callable
from math import gamma, inf, isfinite, pi, sqrt

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graindamp.dem.columns import N_NODE
from graindamp.errors import InputError

Curve = Callable[[NDArray[np.float64]], NDArray[np.float64]]
"""Coefficient of restitution [-] over an array of impact speeds [m/s], v = 0 and v = infinity among them."""

LAWS = ("hertz-gonthier", "hertz-viscoelastic", "linear")
"""Names of the contact laws that :func:`loss_table` knows."""

HERTZ_DURATION = 0.8 * sqrt(pi) * gamma(0.4) / gamma(0.9)
"""Duration of an elastic Hertz contact over largest overlap/impact speed [-]: 2.9433, 2 int_0^1 dx/sqrt(1 - x^2.5)."""

_N_NEWTON = 8
"""Newton steps; every iteration below is quadratic from its start, and six reach rounding."""

_KAPPA_SERIES = 2 / (np.arange(50) + 3.0)
"""Coefficients of `_kappa` at small arguments; what they leave out at |x| = 0.5 is below 1e-16."""


def gonthier_damping(restitution: ArrayLike) -> NDArray[np.float64]:
    """Dimensionless damping d of the Gonthier law from the coefficient of restitution [-].

    d is the non-trivial root of (1 + d/e)/(1 - d) = exp[d (1 + 1/e)]. It depends on neither the exponent of the elastic
    force nor stiffness, mass or speed. It tends to 1.5 (1 - e) for e near 1 and holds its digits there, relative to
    1 - e; it is exactly 0 for e = 1 and rounds to 1 below e = 0.025. The shortcut d = 1 - e^2 is up to a third off.

    Args:
        restitution: coefficient of restitution e [-], any shape, from 0 to 1.

    Raises:
        InputError: a value outside 0 to 1.

    Source: Gonthier, McPhee, Lange & Piedboeuf (2004), Multibody System Dynamics 11, 209-233.
    """
    return _gonthier(_checked(restitution, "restitution", zero=True))[0]


def gonthier_restitution(damping: ArrayLike) -> NDArray[np.float64]:
    """Coefficient of restitution that a Gonthier contact of dimensionless damping d returns [-].

    The inverse of :func:`gonthier_damping`. With x = d/e, x - ln(1 + x) = -d - ln(1 - d), which has one positive root.
    It is x = -1 - W_-1(-(1 - d) exp(d - 1)) by Lambert's W, which loses half the digits at small d and is not used.

    Args:
        damping: d [-], any shape, from 0 to 1.

    Raises:
        InputError: a value outside 0 to 1.
    """
    given = _checked(damping, "damping d", zero=True)
    restitution = np.array(given == 0, dtype=np.float64)
    inside = (given > 0) & (given < 1)
    d = given[inside]
    work = np.where(d < 0.5, 0.5 * d * d * (1 + d * _kappa(-np.minimum(d, 0.5))), -d - np.log1p(-d))
    x = np.sqrt(2 * work) + work  # Above the root of a convex function, from where Newton's steps fall to it.
    for _ in range(_N_NEWTON):
        excess = np.where(x < 0.5, 0.5 * x * x * (1 - x * _kappa(np.minimum(x, 0.5))), x - np.log1p(x)) - work
        x -= excess * (1 + x) / x
    restitution[inside] = d / x
    return restitution


def damping_ratio(restitution: ArrayLike, tension: bool) -> NDArray[np.float64]:
    """Damping ratio zeta of a linear contact from the coefficient of restitution [-].

    With tension zeta = -ln e / sqrt(ln^2 e + pi^2), always below 1. Without, e = exp(-2 phi cot phi), zeta = cos phi,
    up to zeta = 1, where e = exp(-2) = 0.135, and e = exp(-2 psi coth psi), zeta = cosh psi, beyond: an overdamped
    contact still lets go, with e near 1/(4 zeta^2). So every e above 0 is reached, with or without tension, and e = 0
    is not.

    Args:
        restitution: coefficient of restitution e [-], any shape, above 0, at most 1; e = 1 gives exactly 0.
        tension: True if the contact may pull and ends at zero overlap, False if it ends at zero force.

    Raises:
        InputError: a value outside 0 < e <= 1.

    Source: Schwager & Poeschel (2007), Granular Matter 9, 465-469.
    """
    decrement = np.abs(np.log(_checked(restitution, "restitution")))
    if tension:
        return np.asarray(decrement / np.hypot(decrement, pi))
    zeta = np.zeros_like(decrement)
    inside = decrement > 0
    half = 0.5 * decrement[inside]
    root = (2 / pi) * np.sinh(half)  # Right for small decrements, within a factor 0.64 for large ones.
    for _ in range(_N_NEWTON):
        angle = _angle(root)
        above = root - 1
        near_one = np.abs(above) < 1e-6
        slope = np.where(near_one, 4 / 3, (root - angle) / np.where(near_one, 1.0, above)) * (root / (1 + root))
        root = root * np.exp((half - root * angle) / slope)  # Newton over ln zeta.
    zeta[inside] = root
    return zeta


def restitution_at(ratio: ArrayLike, tension: bool) -> NDArray[np.float64]:
    """Coefficient of restitution that a linear contact of damping ratio zeta returns [-].

    The inverse of :func:`damping_ratio`. With tension it is 0 from zeta = 1 on: the contact never lets go.

    Args:
        ratio: damping ratio zeta [-], any shape, 0 or more.
        tension: True if the contact may pull and ends at zero overlap, False if it ends at zero force.

    Raises:
        InputError: a negative or infinite value.
    """
    zeta = np.array(ratio, dtype=np.float64)
    bad = ~((zeta >= 0) & (zeta < inf))
    if bad.any():
        raise InputError(f"damping ratio is {zeta[bad][0]}, but must be a finite number, 0 or more")
    if not tension:
        return np.asarray(np.exp(-2 * zeta * _angle(zeta)))
    under = np.where(zeta < 1, zeta, 0.0)
    return np.where(zeta < 1, np.exp(-pi * under / np.sqrt((1 - under) * (1 + under))), 0.0)


def linear_damping(restitution: ArrayLike, tension: bool) -> NDArray[np.float64]:
    """Dashpot constant 2 zeta of F = k delta + 2 zeta sqrt(m k) v [-]; arguments as :func:`damping_ratio`."""
    return 2 * damping_ratio(restitution, tension)


def viscoelastic_damping(restitution: ArrayLike, tension: bool) -> NDArray[np.float64]:
    """Dashpot constant alpha of F = k delta^1.5 + alpha sqrt(m k) delta^0.25 v [-]; arguments as :func:`damping_ratio`.

    Seen over z = (2/sqrt 5) sqrt(k/m) delta^(5/4) instead of delta, the speed obeys v dv/dz = -z - (2 alpha/sqrt 5) v.
    That is the phase plane of a linear oscillator of damping ratio alpha/sqrt 5, and zero force lies on the same line
    z = -(2 alpha/sqrt 5) v as it does there. So alpha = sqrt(5) zeta is exact with tension and without, each with the
    zeta of its own end of contact. m is the effective mass; with the mass of one of two equal particles, as in the
    polynomial of Tsuji et al., alpha is smaller by sqrt 2. The fit of Thornton et al., without tension, agrees within
    3e-4 in e up to e = 0.92 and 0.002 up to 0.95; it returns 0.979 for 0.99.

    Source: Tsuji, Tanaka & Ishida (1992), Powder Technology 71, 239-250 (the law). Antypov & Elliott (2011),
    Europhysics Letters 94, 50004 (the change of variable). Thornton, Cummins & Cleary (2013), Powder Technology 233,
    30-46.
    """
    return sqrt(5) * damping_ratio(restitution, tension)


def constant(restitution: float) -> Curve:
    """Curve of a coefficient of restitution that is the same at every speed; raises InputError outside 0 < e <= 1."""
    value = float(_checked(restitution, "restitution"))

    def curve(speed: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.full(np.shape(speed), value)

    return curve


def tabulated(speed: ArrayLike, restitution: ArrayLike) -> Curve:
    """Curve through measured points, linear in ln v between neighbours and so monotone, constant beyond its ends.

    Args:
        speed: impact speeds [m/s], one or more, positive and increasing.
        restitution: coefficients of restitution [-] at these speeds, above 0, at most 1.

    Raises:
        InputError: points that cannot be used.
    """
    v = np.array(speed, dtype=np.float64)
    e = _checked(restitution, "restitution")
    if v.ndim != 1 or v.shape != e.shape or v.size == 0:
        raise InputError(
            f"restitution curve: {v.size} speeds and {e.size} restitutions, but it takes as many of one as of the "
            "other in plain lists, and at least one"
        )
    if not (np.isfinite(v).all() and v[0] > 0 and (np.diff(v) > 0).all()):
        raise InputError(
            f"restitution curve: speeds are {', '.join(f'{x:g}' for x in v)} m/s, but must be finite, above 0 and "
            "increasing; sort them, and leave out a speed of 0, as the curve is constant below its first speed"
        )
    log_speed = np.log(v)

    def curve(speed: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.asarray(np.interp(np.log(np.clip(speed, v[0], v[-1])), log_speed, e))

    return curve


def plateau(restitution_inf: float, speed: float, exponent: float) -> Curve:
    """Curve e = e_inf + (1 - e_inf)/(1 + (v/v_0)^p), elastic at v = 0, falling to a plateau.

    Args:
        restitution_inf: e_inf, coefficient of restitution at high speed [-], above 0, at most 1.
        speed: v_0, speed at half the fall [m/s].
        exponent: p, steepness of the fall [-], above 0.

    Raises:
        InputError: a value that cannot be used.
    """
    low = float(_checked(restitution_inf, "restitution at high speed"))
    _positive(speed, "speed of the restitution curve", "m/s")
    _positive(exponent, "exponent of the restitution curve", "-")

    def curve(v: NDArray[np.float64]) -> NDArray[np.float64]:
        with np.errstate(over="ignore"):
            fall = (np.asarray(v) / speed) ** exponent
        return np.minimum(low + (1 - low) / (1 + fall), 1.0)

    return curve


def loss_table(
    law: str, curve: Curve, speed_scale: float, tension: bool = False, n_node: int = N_NODE
) -> NDArray[np.float64]:
    """Constants of a contact law over the impact speed [-], shape (n_node, 2), to be interpolated linearly in u.

    Node i stands at u = i/(n_node - 1) with u = v/(v + speed_scale), so the first is v = 0 and the last v = infinity.
    The two columns are (d/e, 1 - d) for hertz-gonthier, (alpha, 0) for hertz-viscoelastic, (2 zeta, 0) for linear;
    e = 1 gives the conservative rows (0, 1) and (0, 0) exactly.

    Between 513 nodes the restitution of `plateau` (e_inf = 0.54, v_0 = 0.03 m/s) is off by at most 4e-7 for p = 1 and
    2e-6 for p = 2 if speed_scale = v_0, under any law; by at most 7e-5 if it is ten times larger or smaller. The error
    is of second order in the spacing, except where the slope of the curve jumps, and for p < 1, where it is infinite at
    v = 0: 5e-3 for p = 0.5, in the first interval.

    Args:
        law: one of :data:`LAWS`.
        curve: coefficient of restitution over speed.
        speed_scale: speed at the middle node [m/s]; best where the curve falls.
        tension: True if the contact may pull; hertz-gonthier never does and ignores it.
        n_node: number of nodes, at least 2.

    Raises:
        InputError: an unknown law, a speed scale that is not positive, a curve outside 0 < e <= 1.
    """
    if law not in LAWS:
        raise InputError(f"contact law is {law!r}, but must be one of {', '.join(LAWS)}")
    _positive(speed_scale, "speed scale of the loss table", "m/s")
    u = np.linspace(0, 1, n_node)
    speed = np.append(speed_scale * u[:-1] / (1 - u[:-1]), inf)
    e = np.broadcast_to(np.asarray(curve(speed), dtype=np.float64), speed.shape)
    bad = ~((e > 0) & (e <= 1))
    if bad.any():
        i = int(np.argmax(bad))
        raise InputError(
            f"restitution curve: e is {e[i]:.6g} at an impact speed of {speed[i]:.6g} m/s, but must be above 0 and at "
            "most 1 at every speed from 0 to infinity; correct the curve"
        )
    table = np.zeros((n_node, 2))
    if law == "hertz-gonthier":
        d, table[:, 1] = _gonthier(e)
        table[:, 0] = d / e
    elif law == "hertz-viscoelastic":
        table[:, 0] = viscoelastic_damping(e, tension)
    else:
        table[:, 0] = linear_damping(e, tension)
    return table


def max_overlap_hertz(stiffness: float, mass: float, speed: float) -> float:
    """Largest overlap of an elastic Hertz collision [m], (5 m v^2/(4 k))^(2/5).

    Args:
        stiffness: k of F = k delta^1.5 [N/m^1.5], (4/3) E* sqrt(R*).
        mass: effective mass m [kg], half of one particle's for two equal ones.
        speed: impact speed v [m/s].

    Source: Johnson (1985), Contact Mechanics, section 11.4.
    """
    return float((1.25 * mass * speed**2 / stiffness) ** 0.4)


def contact_time_hertz(stiffness: float, mass: float, speed: float) -> float:
    """Duration of an elastic Hertz collision [s], 2.9433 delta_max/v, infinite for v = 0.

    Arguments and source as :func:`max_overlap_hertz`.
    """
    return HERTZ_DURATION * max_overlap_hertz(stiffness, mass, speed) / speed if speed > 0 else inf


def contact_time_linear(stiffness: float, mass: float) -> float:
    """Duration of an elastic linear collision [s], pi sqrt(m/k), the same at every speed.

    Args:
        stiffness: k of F = k delta [N/m].
        mass: effective mass m [kg], half of one particle's for two equal ones.
    """
    return pi * sqrt(mass / stiffness)


def _gonthier(e: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Gonthier's d and 1 - d from the restitution, both to all digits, also where one of them is tiny.

    From e = 0.4 on the root solves d [kappa(d/e)/e + e^2 kappa(-d)] = (1 - e)(1 + e), with kappa as below: the trivial
    root d = 0 is divided out and no term cancels, so d is right relative to 1 - e. Below, the unknown is c = 1 - d in
    ln c = c - 1 - x + ln(1 + x) with x = d/e, which starts well at c = 0.
    """
    d = np.array(e < 1, dtype=np.float64)
    c = np.array(e == 1, dtype=np.float64)
    upper = (e >= 0.4) & (e < 1)
    lower = (e < 0.4) & (e > 1e-3)  # Further down, 1 - d = exp(-1/e)/e underflows to 0.

    eu = e[upper]
    q = 1 - eu
    root = q * (1.5 - 0.5 * q * q)
    for _ in range(_N_NEWTON):
        residual = root * (_kappa(root / eu) / eu + eu**2 * _kappa(-root)) - q * (1 + eu)
        slope = 2 * eu * (1 + eu) * (root - q) / (root * (1 - root) * (eu + root)) - 2 * residual / root
        root = root - residual / slope
    d[upper], c[upper] = root, 1 - root

    el = e[lower]
    log_c = np.log1p(1 / el) - 1 / el
    for _ in range(_N_NEWTON):
        rest = np.exp(log_c)
        x = (1 - rest) / el
        residual = log_c - rest + x + 1 - np.log1p(x)
        log_c = log_c - residual / (1 - rest * (1 + x / (el * (1 + x))))
    d[lower], c[lower] = -np.expm1(log_c), np.exp(log_c)
    return d, c


def _kappa(x: NDArray[np.float64]) -> NDArray[np.float64]:
    """kappa(x) = [x^2 - 2 x + 2 ln(1 + x)]/x^3 = 2/3 - 2 x/4 + 2 x^2/5 - ..., x > -1: the tail of the logarithm."""
    small = np.abs(x) <= 0.5
    far = np.where(small, 1.0, x)
    closed = (far * far - 2 * far + 2 * np.log1p(far)) / far**3
    return np.where(small, np.polynomial.polynomial.polyval(-np.where(small, x, 0.0), _KAPPA_SERIES), closed)


def _angle(zeta: NDArray[np.float64]) -> NDArray[np.float64]:
    """arccos(zeta)/sqrt(1 - zeta^2), continued by arccosh(zeta)/sqrt(zeta^2 - 1) above 1 and by 1 between."""
    under, over = np.minimum(zeta, 1.0), np.maximum(zeta, 1.0)
    angle = np.arccos(under) + np.arccosh(over)
    width = np.sqrt((1 - under) * (1 + under)) + np.sqrt(over - 1) * np.sqrt(over + 1)
    critical = width == 0
    return np.where(critical, 1.0, angle / np.where(critical, 1.0, width))


def _checked(value: ArrayLike, name: str, zero: bool = False) -> NDArray[np.float64]:
    """The values as an array if each is in 0 < e <= 1, or in 0 <= e <= 1 if `zero`, else an InputError."""
    array = np.array(value, dtype=np.float64)
    bad = ~(((array >= 0) if zero else (array > 0)) & (array <= 1))
    if bad.any():
        raise InputError(f"{name} is {array[bad][0]}, but must be {'from 0 to 1' if zero else 'above 0 and at most 1'}")
    return array


def _positive(value: float, name: str, unit: str) -> None:
    """Raise an InputError unless the value is a finite number above 0."""
    if not (isfinite(value) and value > 0):
        raise InputError(f"{name} is {value} {unit}, but must be a finite number above 0")
