"""One impact of a ball on a wall, and how damping per cycle is counted."""

from math import cos, expm1, isfinite, pi, sin, sqrt
from typing import NamedTuple

from scipy.optimize import brentq

from graindamp.errors import InputError


class Velocities(NamedTuple):
    """Velocities after an impact and what it cost."""

    structure: float
    """Velocity of the structure [m/s]."""
    ball: float
    """Velocity of the ball [m/s]."""
    loss: float
    """Loss of kinetic energy over the mass of the structure [J/kg]."""


class FirstImpact(NamedTuple):
    """First impact of a ball that leaves its wall as the structure passes equilibrium, and what it takes."""

    phase: float
    """Phase omega t of the impact, counted from the greatest displacement [rad]; the ball leaves at pi / 2."""
    approach: float
    """Approach speed over the velocity amplitude of the structure [-], 0 to 2."""
    specific_damping: float
    """Energy that the structure loses over its energy before, mass-normalised, Psi_m [-]; may be negative."""
    dissipated: float
    """Energy that the impact dissipates over the energy of the structure before, mass-normalised [-]."""


def velocities_after(structure: float, ball: float, mass_ratio: float, restitution: float) -> Velocities:
    """Velocities after a central impact of ball and structure [m/s].

    Args:
        structure: velocity V of the structure before [m/s].
        ball: velocity v of the ball before [m/s].
        mass_ratio: mu, mass of the ball over (modal) mass of the structure at the cavity [-], > 0.
        restitution: coefficient of restitution R [-], 0 to 1.

    Raises:
        InputError: an argument outside its range.

    Source: Witt (2011), Texas A&M University, Eqs 2.21 to 2.24.
    """
    _check_impact(mass_ratio, restitution)
    after = (structure * (1.0 - mass_ratio * restitution) + ball * mass_ratio * (1.0 + restitution)) / (
        1.0 + mass_ratio
    )
    ball_after = (structure * (1.0 + restitution) + ball * (mass_ratio - restitution)) / (1.0 + mass_ratio)
    loss = 0.5 * mass_ratio * (1.0 - restitution**2) / (1.0 + mass_ratio) * (structure - ball) ** 2
    return Velocities(after, ball_after, loss)


def head_on_specific_damping(mass_ratio: float, restitution: float) -> float:
    """Mass-normalised specific damping Psi_m of one head-on impact at equal and opposite speeds [-].

    4 (1 + R) (1 - mu R), of one half-cycle: the most that one impact can take at alpha = 1 / pi. The energies are those
    of the structure alone just before and after; exact for any mass ratio.

    Args:
        mass_ratio: mu, mass of the ball over (modal) mass of the structure at the cavity [-], > 0.
        restitution: coefficient of restitution R [-], 0 to 1.

    Raises:
        InputError: an argument outside its range.

    Source: Witt (2011), Eqs 2.22, 2.28 and 2.29 with v = -V.
    """
    _check_impact(mass_ratio, restitution)
    return 4.0 * (1.0 + restitution) * (1.0 - mass_ratio * restitution)


def impact_phase(alpha: float) -> float:
    """Phase omega t at which a ball reaches the far wall, counted from the greatest displacement [rad].

    The ball leaves at pi / 2 with the greatest speed of the structure: (tau - pi / 2) + cos(tau) = 1 / alpha, which has
    one root. 3 pi / 2, head-on, at alpha = 1 / pi; 5 pi / 2, without impact, at alpha = 1 / (2 pi).

    Args:
        alpha: displacement amplitude of the structure after the ball has left over clearance U / d [-], > 0.

    Raises:
        InputError: alpha is not a finite number > 0.

    Source: Witt (2011), Eqs 2.14 to 2.20 and 2.30.
    """
    _check("alpha", alpha, alpha > 0, "> 0")
    phase: float = brentq(
        lambda tau: tau - pi / 2 + cos(tau) - 1.0 / alpha, pi / 2, pi / 2 + 1.0 / alpha + 1.0, xtol=1e-15, rtol=1e-15
    )
    return phase


def first_impact(alpha: float, mass_ratio: float, restitution: float) -> FirstImpact:
    """What the first impact takes from a structure that is let go with the ball on the wall that pushes it.

    Exact for one undamped mode: the structure, without the ball once it has left, moves with amplitude U until then.

    Args:
        alpha: displacement amplitude of the structure after the ball has left over clearance U / d [-], > 0.
        mass_ratio: mu, mass of the ball over (modal) mass of the structure at the cavity [-], > 0.
        restitution: coefficient of restitution R [-], 0 to 1.

    Raises:
        InputError: an argument outside its range.

    Source: Witt (2011), chapter 2.3, with Eqs 2.22 to 2.29.
    """
    _check_impact(mass_ratio, restitution)
    phase = impact_phase(alpha)
    before = -sin(phase)  # velocities over the amplitude; the ball has -1
    after, _, loss = velocities_after(before, -1.0, mass_ratio, restitution)
    unit = (1.0 + mass_ratio) ** 2 / mass_ratio
    return FirstImpact(phase, 1.0 + before, unit * (before**2 - after**2), unit * 2.0 * loss)


def mass_normalised(specific_damping: float, mass_ratio: float) -> float:
    """Mass-normalised specific damping Psi_m = Psi (1 + mu)^2 / mu [-].

    Args:
        specific_damping: Psi, energy lost per cycle over the largest kinetic energy of the cycle [-], at most 1.
        mass_ratio: mu, mass of the ball or bed over (modal) mass of the structure [-], > 0.

    Raises:
        InputError: an argument outside its range.

    Source: Witt (2011), Eq. 2.29, after Friend & Kinra (2000), J. Sound Vib. 233, 93-118.
    """
    _check("specific_damping", specific_damping, specific_damping <= 1, "<= 1")
    _check_impact(mass_ratio, 0.0)
    return specific_damping * (1.0 + mass_ratio) ** 2 / mass_ratio


def specific_damping_of(loss_factor: float, mass_ratio: float, effective_mass_ratio: float = 1.0) -> float:
    """Specific damping Psi of a structure whose only damping is a bed of given loss factor [-].

    The linear mode with zeta = mu eta / (2 (1 + mu m')) loses Psi = 1 - exp(-4 pi zeta / sqrt(1 - zeta^2)) of its
    energy per cycle; for small mu, Psi_m = 2 pi eta. :func:`graindamp.design.rules.loss_factor_from_decay` is the
    inverse.

    Args:
        loss_factor: loss factor eta of the bed [-], >= 0.
        mass_ratio: mu, mass of the bed over (modal) mass of the structure [-], > 0.
        effective_mass_ratio: in-phase effective mass over bed mass m' [-], any sign; above -1 / mu.

    Raises:
        InputError: an argument outside its range, or a damping ratio of 1 or more, with no cycles left.

    Source: logarithmic decrement of a linear oscillator, and Meyer & Seifried (2021), Granular Matter 23, Eq. 18.
    """
    _check("loss_factor", loss_factor, loss_factor >= 0, ">= 0")
    _check_impact(mass_ratio, 0.0)
    loaded = 1.0 + mass_ratio * effective_mass_ratio
    _check("effective_mass_ratio", effective_mass_ratio, loaded > 0, f"above {-1.0 / mass_ratio:g}")
    ratio = mass_ratio * loss_factor / (2.0 * loaded)
    _check("loss_factor", loss_factor, ratio < 1, f"below {2.0 * loaded / mass_ratio:g}, where no cycle is left")
    return -expm1(-4.0 * pi * ratio / sqrt(1.0 - ratio**2))


def _check_impact(mass_ratio: float, restitution: float) -> None:
    _check("mass_ratio", mass_ratio, mass_ratio > 0, "> 0")
    _check("restitution", restitution, 0.0 <= restitution <= 1.0, ">= 0 and <= 1")


def _check(name: str, value: float, allowed: bool, text: str) -> None:
    if not (isfinite(value) and allowed):
        raise InputError(f"{name} is {value}, but must be a finite number {text}")
