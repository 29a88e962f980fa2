"""Impact dampers on a structure, or in a container of prescribed motion, as arrays for the solver."""

from collections.abc import Sequence
from math import isfinite, pi
from typing import NamedTuple

import numpy as np

from graindamp.errors import InputError
from graindamp.impact.state import System
from graindamp.structure.modal import ModalModel, point_index


class Ball(NamedTuple):
    """A ball that moves freely along a line between two walls of a cavity, without friction and gravity."""

    mass: float
    """Mass [kg], > 0."""
    clearance: float
    """Free travel from wall to wall [m], > 0."""
    restitution: float
    """Coefficient of restitution of ball and wall [-], 0 to 1; 1 loses nothing."""
    point: str = ""
    """Point of the structure that its cavity is fixed to; default: the first."""


class PointForce(NamedTuple):
    """A harmonic force amplitude cos(2 pi frequency t + phase) on a point of the structure."""

    amplitude: float
    """Amplitude [N]; negative turns the phase by pi."""
    frequency: float
    """Frequency [Hz], >= 0; 0 is a constant force."""
    phase: float = 0.0
    """Phase at t = 0 [rad]."""
    point: str = ""
    """Point that it acts on; default: the first."""


class PrescribedMotion(NamedTuple):
    """A harmonic motion amplitude cos(2 pi frequency t + phase) of the container."""

    amplitude: float
    """Displacement amplitude [m]."""
    frequency: float
    """Frequency [Hz], > 0."""
    phase: float = 0.0
    """Phase at t = 0 [rad]."""


def oscillator(mass: float, frequency: float, damping_ratio: float = 0.0) -> ModalModel:
    """A mass on spring and dashpot, as a structure with one mode and one point, "mass".

    Args:
        mass: mass [kg], > 0.
        frequency: natural frequency without damping [Hz], >= 0; 0 is a free mass.
        damping_ratio: damping ratio zeta [-], >= 0.

    Raises:
        InputError: an argument outside its range.
    """
    _check("mass", mass, mass > 0, "> 0")
    _check("frequency", frequency, frequency >= 0, ">= 0")
    _check("damping_ratio", damping_ratio, damping_ratio >= 0, ">= 0")
    omega = np.array([2.0 * pi * frequency])
    shape = np.array([[mass**-0.5]])
    return ModalModel(omega, 2.0 * damping_ratio * omega, shape, np.full((1, 1), np.nan), ("mass",))


def on_structure(model: ModalModel, balls: Sequence[Ball], forces: Sequence[PointForce] = ()) -> System:
    """Balls in cavities fixed to points of a structure, with harmonic forces.

    Args:
        model: modes of the structure, the masses of the empty containers included.
        balls: one per cavity, at least one; several may share a point.
        forces: harmonic forces.

    Raises:
        InputError: no ball, a value outside its range, or a point that the structure does not have.
    """
    _check_balls(balls)
    for number, force in enumerate(forces, 1):
        _check(f"forces[{number}].frequency", force.frequency, force.frequency >= 0, ">= 0")
        _check(f"forces[{number}].amplitude", force.amplitude, True, "")
    at = [point_index(model, ball.point) if ball.point else 0 for ball in balls]
    drive = np.zeros((model.omega.size, len(forces)))
    for j, force in enumerate(forces):
        drive[:, j] = force.amplitude * model.shape[point_index(model, force.point) if force.point else 0]
    return System(
        np.array(model.omega**2, dtype=float),
        np.array(model.damping, dtype=float),
        np.ascontiguousarray(model.shape[at], dtype=float),
        np.array([ball.mass for ball in balls], dtype=float),
        np.array([ball.clearance for ball in balls], dtype=float),
        np.array([ball.restitution for ball in balls], dtype=float),
        np.array([2.0 * pi * force.frequency for force in forces]),
        np.array([force.phase for force in forces], dtype=float),
        drive,
        np.zeros((len(balls), len(forces))),
    )


def in_driven_container(balls: Sequence[Ball], motions: Sequence[PrescribedMotion]) -> System:
    """Balls in a container that moves as prescribed, whatever they do.

    Args:
        balls: one per cavity, at least one.
        motions: harmonic motions, which add up.

    Raises:
        InputError: no ball, no motion, or a value outside its range.
    """
    _check_balls(balls)
    if not motions:
        raise InputError("motions is empty, but a driven container needs at least one harmonic motion")
    for number, motion in enumerate(motions, 1):
        _check(f"motions[{number}].frequency", motion.frequency, motion.frequency > 0, "> 0")
        _check(f"motions[{number}].amplitude", motion.amplitude, True, "")
    n, nd = len(balls), len(motions)
    return System(
        np.zeros(0),
        np.zeros(0),
        np.zeros((n, 0)),
        np.array([ball.mass for ball in balls], dtype=float),
        np.array([ball.clearance for ball in balls], dtype=float),
        np.array([ball.restitution for ball in balls], dtype=float),
        np.array([2.0 * pi * motion.frequency for motion in motions]),
        np.array([motion.phase for motion in motions], dtype=float),
        np.zeros((0, nd)),
        np.tile([motion.amplitude for motion in motions], (n, 1)).astype(float),
    )


def fastest_rate(system: System) -> float:
    """Bound on the rates of all motions of the system [1/s], with balls in flight or at rest on walls."""
    rates = [*np.sqrt(system.omega_squared), *system.damping, *system.drive_omega, 0.0]
    return float(max(rates))


def _check_balls(balls: Sequence[Ball]) -> None:
    if not balls:
        raise InputError("balls is empty, but at least one is needed")
    for number, ball in enumerate(balls, 1):
        _check(f"balls[{number}].mass", ball.mass, ball.mass > 0, "> 0")
        _check(f"balls[{number}].clearance", ball.clearance, ball.clearance > 0, "> 0")
        _check(f"balls[{number}].restitution", ball.restitution, 0 <= ball.restitution <= 1, ">= 0 and <= 1")


def _check(name: str, value: float, allowed: bool, text: str) -> None:
    if not (isfinite(value) and allowed):
        raise InputError(f"{name} is {value}, but must be a finite number {text}".rstrip())
