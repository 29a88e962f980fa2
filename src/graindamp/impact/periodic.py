"""Exact symmetric two-impact motions of a forced structure with one ball, and their stability.

The ball strikes each wall once per cycle, half a cycle apart, and the second half-cycle mirrors the first. With the
half period T = pi / Omega, the exact propagator Phi of the structure over T and G the response from rest to the force
cos(Omega t) or sin(Omega t), the state just before the impact s- and just after it s+ obey, for a ball of speed u,

    s- = -(Phi s+ + G (a, b)),   s+ = s- + (0, 2 m u phi),
    phi q = (u T - h) / 2,   phi q'- = -u (1 - R + 2 mu) / (1 + R),   mu = m |phi|^2,

linear in s-, a = cos(phase), b = -sin(phase), so that a and b are affine in u, and a^2 + b^2 = 1 is one quadratic in u.
Source: Masri & Caughey (1966), J. Appl. Mech. 33, 586-592, for one mode; the quadratic and any number of modes here.
"""

from math import atan2, cos, pi, sin, sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

from graindamp.errors import InputError
from graindamp.impact.simulate import Start, simulate
from graindamp.impact.state import System
from graindamp.impact.system import Ball, PointForce, on_structure
from graindamp.structure.modal import ModalModel

EVENT_TIME = 1e-7
"""Part of a half-cycle within which the event solver must find the impact that the formula predicts [-]."""


class PeriodicMotion(NamedTuple):
    """A symmetric motion with one impact per wall and cycle."""

    ball_speed: float
    """Speed of the ball u [m/s]."""
    force_phase: float
    """Phase of the force cos(Omega t + phase) at the impact on the upper wall [rad]."""
    peak: float
    """Largest displacement of the cavity [m]."""
    approach_speed: float
    """Approach speed of ball and wall [m/s]."""
    energy_per_cycle: float
    """Energy that the two impacts dissipate per cycle [J]."""
    possible: bool
    """True where no wall is touched between these impacts."""
    multipliers: NDArray[np.complex128]
    """Floquet multipliers of a half-cycle, mirrored, largest modulus first; their squares are those of a cycle."""
    stable: bool
    """True where all multipliers lie inside the unit circle."""
    start: Start
    """State just after the impact on the upper wall at time 0, for :func:`graindamp.impact.simulate.simulate`."""
    system: System
    """The system with the phase of the force set such that the impact is at time 0."""


def symmetric_two_impact(model: ModalModel, ball: Ball, force: PointForce) -> tuple[PeriodicMotion, ...]:
    """All symmetric two-impact motions of a structure with one ball under a harmonic force, larger ball speed first.

    Roots with further wall contacts are kept and marked as not possible.

    Args:
        model: modes of the structure, the mass of the empty container included.
        ball: the ball; restitution 0 to 1.
        force: the force; its phase plays no part.

    Raises:
        InputError: a value outside its range, or a force without amplitude or frequency.
    """
    system = on_structure(model, [ball], [force])
    if force.frequency <= 0 or force.amplitude == 0:
        raise InputError(
            f"force has amplitude {force.amplitude} N and frequency {force.frequency} Hz; allowed: not 0, and > 0"
        )
    motions = [_motion(system, u, a, b, s) for u, a, b, s in _roots(system)]
    return tuple(sorted(motions, key=lambda motion: -motion.ball_speed))


def half_cycle_matrices(system: System) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Propagator of the structure over half a cycle, and its response from rest to cos and sin of the forcing.

    Returns:
        Phi (state, state) and G (state, 2), the state being modal coordinates, then modal velocities.
    """
    n, omega = system.omega_squared.size, float(system.drive_omega[0])
    rate = np.zeros((2 * n + 2, 2 * n + 2))
    rate[:n, n : 2 * n] = np.eye(n)
    rate[n : 2 * n, :n] = -np.diag(system.omega_squared)
    rate[n : 2 * n, n : 2 * n] = -np.diag(system.damping)
    rate[n : 2 * n, 2 * n] = system.force[:, 0]
    rate[2 * n, 2 * n + 1], rate[2 * n + 1, 2 * n] = -omega, omega  # cos' = -omega sin, sin' = omega cos
    whole = expm(rate * (pi / omega))
    return whole[: 2 * n, : 2 * n], whole[: 2 * n, 2 * n :]


def _roots(system: System) -> list[tuple[float, float, float, NDArray[np.float64]]]:
    """Ball speed, cosine and sine of the phase, and state before the impact, of every root with u > 0."""
    n = system.omega_squared.size
    phi, mass, restitution = system.shape[0], float(system.mass[0]), float(system.restitution[0])
    mu, half = mass * float(phi @ phi), pi / float(system.drive_omega[0])
    propagator, forced = half_cycle_matrices(system)
    kick = np.concatenate([np.zeros(n), 2.0 * mass * phi])
    # Unknowns: s-, cos, sin. Columns of the right-hand side: constant part, part proportional to u.
    matrix, right = np.zeros((2 * n + 2, 2 * n + 2)), np.zeros((2 * n + 2, 2))
    matrix[: 2 * n, : 2 * n] = np.eye(2 * n) + propagator
    matrix[: 2 * n, 2 * n :] = forced
    right[: 2 * n, 1] = -propagator @ kick
    matrix[2 * n, :n], matrix[2 * n + 1, n : 2 * n] = phi, phi
    right[2 * n] = -float(system.clearance[0]) / 2.0, half / 2.0
    right[2 * n + 1, 1] = -(1.0 - restitution + 2.0 * mu) / (1.0 + restitution)
    row = np.abs(matrix).max(axis=1)
    column = np.abs(matrix / row[:, None]).max(axis=0)
    scaled = matrix / row[:, None] / column
    if np.linalg.cond(scaled) > 1e13:
        return []
    solution = np.linalg.solve(scaled, right / row[:, None]) / column[:, None]
    constant, linear = solution[2 * n :, 0], solution[2 * n :, 1]
    a, b, c = float(linear @ linear), float(constant @ linear), float(constant @ constant) - 1.0
    square = b * b - a * c
    if square < 0:
        return []
    # The larger root in modulus without cancellation, the other from the product of roots.
    large = -(b + (sqrt(square) if b >= 0 else -sqrt(square)))
    speeds = {large / a} | ({c / large} if large != 0 else set())
    found = []
    for speed in speeds:
        if speed > 0:
            whole = solution @ np.array([1.0, speed])
            found.append((speed, float(whole[2 * n]), float(whole[2 * n + 1]), whole[: 2 * n]))
    return found


def _motion(system: System, speed: float, cosine: float, sine: float, before: NDArray[np.float64]) -> PeriodicMotion:
    n, phi = system.omega_squared.size, system.shape[0]
    mass, restitution = float(system.mass[0]), float(system.restitution[0])
    half = pi / float(system.drive_omega[0])
    # cos(Omega t + phase) = cos(phase) cos(Omega t) - sin(phase) sin(Omega t): the oscillator's state is (cos, sin).
    phase = atan2(sine, cosine)
    after = before + np.concatenate([np.zeros(n), 2.0 * mass * speed * phi])
    start = Start(0.0, after[:n], after[n:], system.clearance.copy(), np.array([-speed]))
    turned = system._replace(drive_phase=np.array([phase]))
    approach = speed - float(phi @ before[n:])
    mu = mass * float(phi @ phi)
    loss = mass * (1.0 - restitution**2) / (1.0 + mu) * approach**2
    multipliers = _multipliers(turned, speed, before, after)
    peak, possible = _half_cycle(turned, start, half)
    stable = bool(abs(multipliers[0]) < 1.0)
    return PeriodicMotion(speed, phase, peak, approach, loss, possible, multipliers, stable, start, turned)


def _half_cycle(system: System, start: Start, half: float) -> tuple[float, bool]:
    """Largest displacement of the cavity in a half-cycle, and whether its first contact is that on the lower wall."""
    run = simulate(system, half * (1.0 + EVENT_TIME), start)
    # The walls stand at y and y + h: the middle of the cavity is what moves symmetrically, and its motion is y itself.
    ends = [float(system.shape[0] @ start.q)]
    peak = max(abs(value) for value in [*ends, *run.peaks[:, 1]])
    contacts = run.events
    alone = len(contacts) == 1 and contacts[0, 3] == 1 and abs(contacts[0, 0] - half) < EVENT_TIME * half
    return peak, bool(alone)


def half_cycle_jacobian(
    system: System, speed: float, before: NDArray[np.float64], after: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Derivative of the mirrored map from just after one impact to just after the next, at a symmetric motion.

    Variables: modal coordinates, modal velocities, velocity of the ball, phase of the force (2 modes + 2). The position
    of the ball follows from that of the wall. A change of the flight time, which closes the gap later, carries the
    motion before the impact with it.

    Args:
        system: one ball on a structure under one force, whose phase is that at the impact on the upper wall.
        speed: speed of the ball [m/s].
        before: state just before an impact on the upper wall (2 modes,).
        after: state just after it (2 modes,).
    """
    n, phi = system.omega_squared.size, system.shape[0]
    mass, restitution = float(system.mass[0]), float(system.restitution[0])
    omega, phase = float(system.drive_omega[0]), float(system.drive_phase[0])
    half, mu = pi / omega, mass * float(phi @ phi)
    propagator, forced = half_cycle_matrices(system)
    end = -before  # just before the impact on the lower wall
    ball = 2 * n
    flight = np.zeros((2 * n + 2, 2 * n + 2))
    flight[: 2 * n, : 2 * n] = propagator
    flight[: 2 * n, ball + 1] = forced @ np.array([-sin(phase), cos(phase)])
    flight[ball, ball] = flight[ball + 1, ball + 1] = 1.0
    rate = np.zeros(2 * n + 2)
    rate[:n] = end[n:]
    rate[n : 2 * n] = -system.omega_squared * end[:n] - system.damping * end[n:] - system.force[:, 0] * cos(phase)
    rate[ball + 1] = omega
    # gap = ball - wall: the ball starts at phi q + h and ends at phi q.
    gap = -phi @ flight[:n]
    gap[:n] += phi
    gap[ball] += half
    closing = -speed - float(phi @ end[n:])
    flight -= np.outer(rate, gap / closing)
    # impulse on the ball: J = -m (1 + R) / (1 + mu) (velocity of the ball - phi q').
    impact = np.eye(2 * n + 2)
    factor = mass * (1.0 + restitution) / (1.0 + mu)
    impact[n : 2 * n, n : 2 * n] -= factor * np.outer(phi, phi)
    impact[n : 2 * n, ball] += factor * phi
    impact[ball, n : 2 * n] += factor / mass * phi
    impact[ball, ball] -= factor / mass
    mirror = -np.eye(2 * n + 2)
    mirror[ball + 1, ball + 1] = 1.0
    return np.asarray(mirror @ impact @ flight)


def _multipliers(
    system: System, speed: float, before: NDArray[np.float64], after: NDArray[np.float64]
) -> NDArray[np.complex128]:
    values = np.linalg.eigvals(half_cycle_jacobian(system, speed, before, after)).astype(complex)
    return np.asarray(values[np.argsort(-abs(values))])
