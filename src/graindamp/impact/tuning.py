"""Clearance of an impact damper for an amplitude, and amplitudes for a clearance, in closed form."""

from math import isfinite, pi
from typing import NamedTuple

from scipy.optimize import brentq

from graindamp.errors import InputError
from graindamp.field.theory import collect_and_collide, stroke_ratio_best, stroke_ratio_min, stroke_ratio_stable_max

ALPHA_BEST, ALPHA_WORST = 1.0 / pi, 0.5 / pi
"""U / d at which a ball that rested on a wall meets the far one head-on, and at which it is caught without impact."""


FOLD_MARGIN = 1.02
"""Least amplitude of a range over that of the fold [-]."""


class TunedClearance(NamedTuple):
    """A clearance, and the amplitudes at which one ball works with two impacts per cycle."""

    clearance: float
    """Free travel d [m]."""
    amplitude: float
    """Displacement amplitude of the largest loss factor [m]."""
    amplitude_min: float
    """Amplitude below which two impacts per cycle are impossible [m]."""
    amplitude_stable_max: float
    """Amplitude above which they are unstable [m]; inf for R = 0, whose ball rests on the walls."""


def tuned_clearance(amplitude: float, restitution: float = 0.0) -> TunedClearance:
    """Clearance that makes a displacement amplitude the best one [m].

    For R = 0, or a ball that leaves its wall from rest, d = pi U (the alpha-criterion, U / d = 1 / pi). A ball that
    rebounds with R returns faster, and in steady motion d = pi U (1 + R) / (1 - R) is best. Limits: as for
    :func:`graindamp.field.theory.collect_and_collide`; small mass ratio.

    Args:
        amplitude: displacement amplitude U of the cavity [m], > 0.
        restitution: coefficient of restitution R of the steady motion [-], 0 <= R < 1.

    Raises:
        InputError: an argument outside its range.

    Source: Witt (2011), Texas A&M University, Eq. 2.31, for R = 0.
    """
    _check("amplitude", amplitude)
    return working_range(pi * amplitude / stroke_ratio_best(restitution), restitution)


def working_range(clearance: float, restitution: float = 0.0) -> TunedClearance:
    """Amplitudes at which one ball with this clearance works with two impacts per cycle [m].

    Args:
        clearance: free travel d [m], > 0.
        restitution: coefficient of restitution R [-], 0 <= R < 1.

    Raises:
        InputError: an argument outside its range.
    """
    _check("clearance", clearance)
    unit = clearance / pi
    limits = stroke_ratio_best(restitution), stroke_ratio_min(restitution), stroke_ratio_stable_max(restitution)
    return TunedClearance(clearance, *(limit * unit for limit in limits))


def range_clearance(low: float, high: float, restitution: float = 0.0) -> TunedClearance:
    """Clearance whose least loss factor over a range of amplitudes is largest [m].

    The loss factor rises steeply from the fold to its peak and falls slowly beyond: it is equal at both ends of a
    narrow range; for a wide one the lower end is put :data:`FOLD_MARGIN` above the fold, below which the ball cannot
    cross. For decay through a wide range see :func:`graindamp.impact.cavities.tune_cavities`. Limits: as for
    :func:`tuned_clearance`; where `high` exceeds `amplitude_stable_max` of the answer, the motion there is unstable.

    Args:
        low: lower displacement amplitude [m], > 0.
        high: upper displacement amplitude [m], >= low.
        restitution: coefficient of restitution R of the steady motion [-], 0 <= R < 1.

    Raises:
        InputError: an argument outside its range, or a range so wide that no clearance works at both ends.
    """
    _check("low", low)
    _check("high", high)
    first, best = stroke_ratio_min(restitution) * FOLD_MARGIN, stroke_ratio_best(restitution)
    if high < low:
        raise InputError(f"high is {high} m, but must be at least low, {low} m")
    if not collect_and_collide(first * high / low, restitution).exists:
        raise InputError(
            f"high is {high / low:.3g} times low, but at R = {restitution:g} two impacts per cycle do not exist over "
            "such a range; narrow it, or use several cavities"
        )

    def excess(ratio: float) -> float:
        upper = collect_and_collide(ratio * high / low, restitution)
        return collect_and_collide(ratio, restitution).loss_factor - (upper.loss_factor if upper.exists else 0.0)

    best = max(best, first)
    ratio = first if excess(first) >= 0 else brentq(excess, first, best, xtol=1e-12)
    return working_range(pi * low / ratio, restitution)


def _check(name: str, value: float) -> None:
    if not (isfinite(value) and value > 0):
        raise InputError(f"{name} is {value} m, but must be a finite number > 0")
