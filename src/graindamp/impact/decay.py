"""Free decay of a structure with impact dampers, and its damping cycle by cycle."""

from math import pi
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from graindamp.errors import InputError
from graindamp.impact.simulate import ImpactRun, released, simulate
from graindamp.impact.state import System


class CycleDamping(NamedTuple):
    """Damping of every cycle of a decay, a new one beginning every half-cycle; shapes (cycle,)."""

    amplitude: NDArray[np.float64]
    """Displacement amplitude V / omega of the cavity at the start of the cycle [m]."""
    specific_damping: NDArray[np.float64]
    """Psi = 1 - (V_next / V)^2 of greatest speeds one cycle apart, structural damping taken off [-]."""
    mass_normalised: NDArray[np.float64]
    """Psi_m = Psi (1 + mu)^2 / mu, mu the mass of all balls over the modal mass at the cavity [-]."""
    alpha: NDArray[np.float64]
    """Amplitude over the clearance of the first ball U / d [-]."""


def free_decay(
    system: System,
    amplitude: float,
    *,
    until_below: float = 0.0,
    cycles_max: float = 1000.0,
    sample_rate: float = 0.0,
    mode: int = 0,
    ball: int = 0,
) -> ImpactRun:
    """Decay of a structure bent along one mode and let go, each ball on the wall that will push it.

    Args:
        system: balls on a structure.
        amplitude: displacement of the cavity of ball `ball` at the start [m], not 0.
        until_below: displacement amplitude at which to stop [m]; 0 for never.
        cycles_max: cycles of the mode after which to stop in any case, > 0.
        sample_rate: samples per second [Hz], 0 for none.
        mode: number of the mode, from 0; elastic.
        ball: number of the ball, from 0, whose cavity is displaced and observed.

    Raises:
        InputError: an argument outside its range.
    """
    start = released(system, amplitude, mode, ball)
    omega = float(np.sqrt(system.omega_squared[mode]))
    if omega == 0:
        raise InputError(f"mode is {mode}, a rigid-body mode, which does not vibrate; release an elastic one")
    if not cycles_max > 0:
        raise InputError(f"cycles_max is {cycles_max}, but must be > 0")
    duration = cycles_max * 2.0 * pi / omega
    observed = system.shape[ball]
    return simulate(system, duration, start, sample_rate=sample_rate, observed=observed, until_below=until_below)


def damping_per_cycle(system: System, run: ImpactRun, mode: int = 0, ball: int = 0) -> CycleDamping:
    """Specific damping of every cycle of a decay, by greatest speeds of both signs.

    Args:
        system: balls on a structure, whose response is dominated by one mode.
        run: the decay.
        mode: number of that mode, from 0.
        ball: number of the ball, from 0, whose cavity was observed.

    Source: Witt (2011), Texas A&M University, Eqs 2.28 and 2.29, and chapter 3 for intrinsic damping.
    """
    omega = float(np.sqrt(system.omega_squared[mode]))
    speed = run.peaks[:, 2]
    first, after = speed[:-2], speed[2:]
    good = first > 0
    ratio = float(system.damping[mode]) / (2.0 * omega)
    intrinsic = -np.expm1(-4.0 * pi * ratio / np.sqrt(1.0 - ratio**2)) if ratio < 1 else 1.0
    damping = 1.0 - (after[good] / first[good]) ** 2 - intrinsic
    mass_ratio = float(system.mass @ system.shape[:, mode] ** 2)
    amplitude = first[good] / omega
    unit = (1.0 + mass_ratio) ** 2 / mass_ratio
    return CycleDamping(amplitude, damping, unit * damping, amplitude / float(system.clearance[ball]))
