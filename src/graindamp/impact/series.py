"""Taylor polynomials of the motion between events, and their first zero.

Between events the equations are linear with constant coefficients, so every motion equals its Taylor polynomial: over a
panel no longer than :data:`PANEL` over the fastest rate, the remainder after :data:`DEGREE` terms is below 1e-18 of the
motion. Coefficients are scaled: a motion is the sum of c[k] s^k with s from 0 to 1 over the panel.
"""

from math import cos, sin, sqrt

import numpy as np
from numpy.typing import NDArray

from graindamp.impact.compile import inner
from graindamp.impact.state import Motion, Scratch, System

Array = NDArray[np.float64]

DEGREE = 20
"""Degree of the polynomials of a panel."""
PANEL = 0.9
"""Length of a panel times the fastest rate of the system [-]."""
NO_ROOT = 2.0
"""Answer of :func:`first_root` where there is none."""


@inner
def first_root(c: Array, start: int, stop: int) -> float:
    """First zero in 0..1 of the sum of c[k] s^(k - start), start <= k < stop, or NO_ROOT; 0 if not positive at 0.

    With B the sum of the moduli of the second derivative's terms, a polynomial of value f and slope f' stays positive
    until (f' + sqrt(f'^2 + 2 B f)) / B later. Steps of this length converge quadratically to a crossing, linearly to a
    grazing zero, never past the first.
    """
    spread, bend = 0.0, 0.0
    for k in range(start + 1, stop):
        spread += abs(c[k])
        bend += (k - start) * (k - start - 1) * abs(c[k])
    if c[start] > spread:
        return NO_ROOT
    if c[start] <= 0.0:
        return 0.0
    s = 0.0
    for _ in range(1000):
        value, slope = 0.0, 0.0
        for k in range(stop - 1, start - 1, -1):
            slope = slope * s + value
            value = value * s + c[k]
        if value <= 0.0:
            return s
        root = sqrt(slope * slope + 2.0 * bend * value)
        if slope < 0.0:
            step = 2.0 * value / (root - slope)
        elif bend > 0.0:
            step = (slope + root) / bend
        else:
            return NO_ROOT
        if s + step > 1.0:
            return NO_ROOT
        if step <= 2e-16:
            return s
        s += step
    return s


@inner
def polynomial(c: Array, s: float) -> tuple[float, float, float]:
    """Value, first and second derivative at s of the polynomial with coefficients c."""
    value, slope, bend = 0.0, 0.0, 0.0
    for k in range(c.size - 1, -1, -1):
        bend = bend * s + slope
        slope = slope * s + value
        value = value * s + c[k]
    return value, slope, 2.0 * bend


@inner
def crossing(c: Array, order: int, low: float, high: float) -> float:
    """Place between low and high where derivative `order` (1 or 2) of the polynomial changes sign, by bisection."""
    below = polynomial(c, low)[order] > 0.0
    for _ in range(60):
        middle = 0.5 * (low + high)
        if middle in (low, high):
            break
        if (polynomial(c, middle)[order] > 0.0) == below:
            low = middle
        else:
            high = middle
    return 0.5 * (low + high)


@inner
def drive_series(system: System, t: float, h: float, cz: Array) -> None:
    """Coefficients of the drives over a panel of length h that starts at t."""
    for j in range(cz.shape[0]):
        angle, rate = system.drive_omega[j] * t + system.drive_phase[j], system.drive_omega[j] * h
        c, s = cos(angle), sin(angle)
        scale = 1.0
        for k in range(DEGREE + 1):
            cz[j, k] = scale * c
            scale *= rate / (k + 1)
            c, s = -s, c


@inner
def structure_series(system: System, motion: Motion, scratch: Scratch, h: float) -> None:
    """Coefficients of modes and cavities over a panel of length h, with the balls that rest on walls as added mass.

    With balls in S at rest on their walls, (I + sum of m phi phi^T) q'' = -D q' - omega^2 q + force z - sum of
    m phi (base z'').
    """
    cq, cz, cy, pull = scratch.cq, scratch.cz, scratch.cy, scratch.modal
    n, nd, nb = cq.shape[0], cz.shape[0], cy.shape[0]
    resting = False
    for b in range(nb):
        resting = resting or motion.wall[b] != 0
    for i in range(n):
        cq[i, 0] = motion.q[i]
        cq[i, 1] = motion.v[i] * h
    for k in range(DEGREE - 1):
        for i in range(n):
            value = -system.damping[i] * h * (k + 1) * cq[i, k + 1] - system.omega_squared[i] * h * h * cq[i, k]
            for j in range(nd):
                value += h * h * system.force[i, j] * cz[j, k]
            pull[0, i] = value
        if resting:
            for b in range(nb):
                if motion.wall[b] != 0:
                    prescribed = 0.0
                    for j in range(nd):
                        prescribed += system.base[b, j] * cz[j, k + 2] * (k + 1) * (k + 2)
                    for i in range(n):
                        pull[0, i] -= system.mass[b] * system.shape[b, i] * prescribed
        for i in range(n):
            value = pull[0, i]
            if resting:
                value = 0.0
                for j in range(n):
                    value += scratch.inverse_mass[i, j] * pull[0, j]
            cq[i, k + 2] = value / ((k + 1) * (k + 2))
    for b in range(nb):
        for k in range(DEGREE + 1):
            total = 0.0
            for i in range(n):
                total += system.shape[b, i] * cq[i, k]
            for j in range(nd):
                total += system.base[b, j] * cz[j, k]
            cy[b, k] = total
