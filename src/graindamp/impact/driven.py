"""One ball in a container of prescribed harmonic motion: its motions with two impacts per cycle, and their stability.

The field theory has loss factor and effective mass of the stronger of these motions; here stand all of them, with their
Floquet multipliers, and a check of each by the event-driven solver.
"""

from math import acos, atan2, cos, pi, sin, tan
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from graindamp.field.theory import TheoryPoint, collect_and_collide, stroke_ratio_min
from graindamp.impact.simulate import Start, at_rest, simulate
from graindamp.impact.state import System
from graindamp.impact.system import Ball, PrescribedMotion, in_driven_container

EVENT_TIME = 1e-7
"""Part of a half-cycle within which the event solver must find the impact that the formula predicts [-]."""


class DrivenMotion(NamedTuple):
    """A motion with one impact per wall and cycle."""

    branch: str
    """"plastic": the ball rests between impacts; "upper" or "lower": it rebounds at once, larger or smaller speed."""
    field: TheoryPoint
    """Loss factor and in-phase effective mass ratio [-]; formulas only where `possible` is False."""
    impact_angle: float
    """psi: the struck wall is displaced by X sin(psi) outwards and moves inwards at V cos(psi) [rad]; for "plastic" the
    phase from release to impact less pi."""
    multipliers: NDArray[np.complex128]
    """Floquet multipliers of a half-cycle, mirrored, largest modulus first."""
    possible: bool
    """True where no wall is touched between these impacts."""
    stable: bool
    """True where all multipliers lie inside the unit circle; 1 at the fold."""


def driven_motions(stroke_ratio: float, restitution: float = 0.0) -> tuple[DrivenMotion, ...]:
    """All motions with one impact per wall and cycle, without gravity and friction.

    "plastic" for R = 0 and X >= X_opt; its ball forgets at rest, both multipliers are 0. Otherwise both roots of
    pi K |c| = h / X + 2 s, K = (1 + R) / (1 - R): with tan(psi) = s / |c|, the map from impact to impact, mirrored, has
    trace 2 R - (pi / 2) (1 - R^2) tan(psi) and determinant R^2. The lower root is a saddle from the fold on.

    Args:
        stroke_ratio: X / X_opt with X_opt = h / pi, h the clearance [-], > 0.
        restitution: coefficient of restitution R of ball and wall [-], 0 <= R < 1.

    Raises:
        InputError: an argument outside its range.

    Source: :func:`graindamp.field.theory.collect_and_collide` for the motions; the map is derived here.
    """
    strong = collect_and_collide(stroke_ratio, restitution)
    motions = []
    if strong.branch == "plastic":
        # eta = (1 - cos phi)^2 / pi, phi being the phase from release to impact.
        flight = acos(1.0 - (pi * strong.loss_factor) ** 0.5)
        motions.append(DrivenMotion("plastic", strong, flight - pi, np.zeros(2, dtype=complex), True, True))
    fold = stroke_ratio_min(restitution)
    if stroke_ratio < fold:
        return ()
    gain = (1.0 + restitution) / (1.0 - restitution)
    for branch, sign in (("upper", 1.0), ("lower", -1.0)):
        psi = sign * acos(fold / stroke_ratio) - atan2(2.0, pi * gain)
        if cos(psi) <= 0.0:
            continue
        possible = _possible(stroke_ratio, restitution, psi)
        scale = 4.0 * gain / pi * cos(psi)
        point = TheoryPoint(scale * cos(psi), scale * sin(psi), possible, "symmetric-two-impact")
        trace = 2.0 * restitution - pi / 2.0 * (1.0 - restitution**2) * tan(psi)
        values = np.roots([1.0, -trace, restitution**2]).astype(complex)
        values = values[np.argsort(-abs(values))]
        motions.append(DrivenMotion(branch, point, psi, values, possible, bool(abs(values[0]) < 1.0)))
    return tuple(motions)


def driven_start(stroke_ratio: float, restitution: float, impact_angle: float) -> tuple[System, Start]:
    """Container and ball just after the impact on the upper wall of a two-impact motion, with X = 1 and Omega = 1.

    Args:
        stroke_ratio: X / X_opt [-], > 0.
        restitution: coefficient of restitution R [-], 0 <= R < 1.
        impact_angle: psi of the motion [rad].
    """
    # Upper wall at impact: displacement sin(psi), velocity -cos(psi), against the ball.
    motion = PrescribedMotion(1.0, 0.5 / pi, atan2(cos(impact_angle), sin(impact_angle)))
    system = in_driven_container([Ball(1.0, pi / stroke_ratio, restitution)], [motion])
    speed = (1.0 + restitution) / (1.0 - restitution) * cos(impact_angle)
    return system, at_rest(system)._replace(offset=system.clearance.copy(), u=np.array([-speed]))


def _possible(stroke_ratio: float, restitution: float, psi: float) -> bool:
    """Whether the ball flies from wall to wall without touching one in between."""
    system, start = driven_start(stroke_ratio, restitution, psi)
    events = simulate(system, pi * (1.0 + EVENT_TIME), start).events
    return len(events) == 1 and events[0, 3] == 1 and bool(abs(events[0, 0] / pi - 1.0) < EVENT_TIME)
