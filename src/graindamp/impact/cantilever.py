"""Exact bending modes of a uniform cantilever with a point mass at its free end, normalised to one at the tip."""

from collections.abc import Mapping
from math import cos, cosh, exp, inf, isfinite, pi, sin, sqrt, tanh
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import brentq

from graindamp.errors import InputError
from graindamp.spec.structure import BeamSpec
from graindamp.structure.modal import ModalModel, modal_damping

MODES_MAX = 200
"""Modes that can be asked for: beyond, hyperbolic functions overflow."""


class CantileverMode(NamedTuple):
    """One bending mode; as one degree of freedom at the tip it has `mass` and `stiffness`."""

    theta: float
    """Root theta of the frequency equation [-]: the wave number times the length."""
    omega: float
    """Natural angular frequency [rad/s]."""
    mass: float
    """Mass reduced to the tip: beam with its shape squared, and tip mass [kg]."""
    stiffness: float
    """Stiffness reduced to the tip, from the strain energy of the shape [N/m]."""
    length: float
    """Length of the beam [m]."""

    @property
    def frequency(self) -> float:
        """Natural frequency [Hz]."""
        return self.omega / (2.0 * pi)

    def shape(self, position: ArrayLike) -> NDArray[np.float64]:
        """Deflection at positions along the beam [m] over that of the tip [-]."""
        return _shape(self.theta, _places(position, self.length), 0) / _shape(self.theta, 1.0, 0)

    def slope(self, position: ArrayLike) -> NDArray[np.float64]:
        """Rotation at positions along the beam [m] per deflection of the tip [1/m]."""
        return _shape(self.theta, _places(position, self.length), 1) / _shape(self.theta, 1.0, 0) / self.length

    def mass_at(self, position: float) -> float:
        """Mass reduced to a point of the beam [m] instead of the tip [kg]: mass / shape^2, inf in a node."""
        share = float(self.shape(position)) ** 2
        return self.mass / share if share > 0 else inf

    def stiffness_at(self, position: float) -> float:
        """Stiffness reduced to a point of the beam [m] instead of the tip [N/m]: stiffness / shape^2, inf in a node."""
        share = float(self.shape(position)) ** 2
        return self.stiffness / share if share > 0 else inf


def cantilever_modes(beam: BeamSpec, tip_mass: float, n_mode: int = 1) -> tuple[CantileverMode, ...]:
    """Lowest modes of a cantilever, clamped at 0, with a point mass at its free end.

    Roots theta of Omega (cos sinh - sin cosh) + cos cosh = -1 with Omega = m_e theta / (gamma L). Shear, rotary inertia
    and the size of the mass are neglected.

    Args:
        beam: the beam; ends ("clamped", "free"), without masses and springs of its own.
        tip_mass: mass m_e at the free end, of the empty container [kg], >= 0.
        n_mode: number of modes, 1 to 200.

    Raises:
        InputError: another kind of beam, or an argument outside its range.

    Source: Witt (2011), Texas A&M University, Eqs 2.7 to 2.13, with the shape normalised to one at the tip, which the
    printed Eq. 2.11 is not.
    """
    if beam.ends != ("clamped", "free") or beam.masses or beam.springs:
        raise InputError(
            f"beam has ends {beam.ends}, {len(beam.masses)} masses and {len(beam.springs)} springs; allowed here: ends "
            "('clamped', 'free') and none; take graindamp.structure.modal.beam_modal_model for other beams"
        )
    if not (isfinite(tip_mass) and tip_mass >= 0):
        raise InputError(f"tip_mass is {tip_mass} kg, but must be a finite number >= 0")
    if not 1 <= n_mode <= MODES_MAX:
        raise InputError(f"n_mode is {n_mode}, but must be 1 to {MODES_MAX}")
    return tuple(_mode(beam, tip_mass, number) for number in range(n_mode))


def cantilever_model(beam: BeamSpec, tip_mass: float, points: Mapping[str, float], n_mode: int = 1) -> ModalModel:
    """The same modes as a modal model, for couplings and for :func:`graindamp.impact.system.on_structure`.

    Args:
        beam: the beam, with its damping.
        tip_mass: mass at the free end [kg], >= 0.
        points: position of each named point [m], 0 to the length.
        n_mode: number of modes, 1 to 200.

    Raises:
        InputError: as for :func:`cantilever_modes`, or a point off the beam.
    """
    for name, place in points.items():
        beam.check_position(f"point '{name}'", place)
    modes = cantilever_modes(beam, tip_mass, n_mode)
    along = np.array(list(points.values()), dtype=float)
    omega = np.array([mode.omega for mode in modes])
    shape = np.stack([mode.shape(along) / sqrt(mode.mass) for mode in modes], axis=1)
    slope = np.stack([mode.slope(along) / sqrt(mode.mass) for mode in modes], axis=1)
    return ModalModel(omega, modal_damping(beam.damping, omega), shape, slope, tuple(points))


def _mode(beam: BeamSpec, tip_mass: float, number: int) -> CantileverMode:
    beam_mass = beam.linear_density * beam.length

    def characteristic(theta: float) -> float:
        ratio = tip_mass * theta / beam_mass
        return ratio * (cos(theta) * tanh(theta) - sin(theta)) + cos(theta) + 1.0 / cosh(theta)

    # The root lies between that of a pinned tip, about (number + 1/4) pi, and that without a mass, (number + 1/2) pi.
    low = number * pi + 0.5 if number else 1e-6
    theta = brentq(characteristic, low, (number + 0.5) * pi + 0.4, xtol=1e-15, rtol=1e-15)
    omega = theta**2 * sqrt(beam.flexural_rigidity / beam.linear_density) / beam.length**2
    node, width = np.polynomial.legendre.leggauss(24 + 4 * number)
    xi, weight = (node + 1.0) / 2.0, width / 2.0
    tip = float(_shape(theta, 1.0, 0))
    mass = beam_mass * float(weight @ (_shape(theta, xi, 0) / tip) ** 2) + tip_mass
    bending = float(weight @ (_shape(theta, xi, 2) / tip) ** 2)
    return CantileverMode(theta, omega, mass, beam.flexural_rigidity / beam.length**3 * bending, beam.length)


def _places(position: ArrayLike, length: float) -> NDArray[np.float64]:
    xi = np.asarray(position, dtype=float) / length
    if not ((xi >= 0) & (xi <= 1 + 1e-9)).all():
        raise InputError(f"position is {xi * length} m, but the beam reaches from 0 to {length:g} m")
    return xi


def _shape(theta: float, xi: ArrayLike, order: int) -> NDArray[np.float64]:
    """Derivative `order` with respect to xi of sin - sinh + A (cosh - cos), A = (sin + sinh) / (cos + cosh) at the tip.

    A cosh - sinh is written as (A - 1) cosh + exp(-), which keeps its digits for high modes.
    """
    z = theta * np.asarray(xi, dtype=float)
    below_one = (sin(theta) - cos(theta) - exp(-theta)) / (cos(theta) + cosh(theta))
    ratio = 1.0 + below_one
    circular = (np.sin(z) - ratio * np.cos(z), np.cos(z) + ratio * np.sin(z), -np.sin(z) + ratio * np.cos(z))[order]
    odd = order % 2 == 1
    hyperbolic = below_one * (np.sinh(z) if odd else np.cosh(z)) + (-np.exp(-z) if odd else np.exp(-z))
    return np.asarray(theta**order * (circular + hyperbolic))
