"""Equivalent dashpot and mass of a damper as Wong, Spencer & Rongong (2009) define them, for comparison with theirs."""

from typing import NamedTuple

import numpy as np

from graindamp.signals.power import steady_part
from graindamp.signals.record import Record
from graindamp.status import FATAL


class Equivalent(NamedTuple):
    """Equivalent viscous coefficient and mass from sliding windows of half a cycle."""

    viscous_coefficient: float
    """c_eq [N s/m]; agrees with eta m_bed Omega of the complex power."""
    mass: float
    """m_eq [kg], biased: a root mean square of the power counts the noise of impacts as stored energy, so that it comes
    out larger than the bed by any factor. Use m' of the complex power instead."""
    is_mass_biased: bool = True
    """Always True; there so that tables that print the mass print the warning."""


def equivalent(record: Record, container_mass: float, phase: float = 0.0) -> Equivalent | None:
    """Sliding-window equivalents of a record, or None where :func:`graindamp.signals.power.analyze` refuses it.

    Args:
        record: force and motion of the filled container.
        container_mass: mass removed from the force [kg].
        phase: angle of the empty container's apparent mass [rad], as of :class:`PhaseCalibration`.

    Source: Wong, Spencer & Rongong (2009), 50th AIAA SDM conference, Eqs 10-18, velocity amplitude in place of their
    A_amp / (2 pi f).
    """
    steady = steady_part(record)
    if isinstance(steady, list) or any(problem.status & FATAL for problem in steady.problems):
        return None
    omega = 2 * np.pi * steady.frequency
    amplitude = steady.velocity[1] * np.exp(1j * phase)  # a late force is met by an equally late motion
    angle = omega * np.arange(steady.first, steady.last) / record.sampling_rate
    turning = amplitude * np.exp(1j * angle)
    velocity, acceleration = turning.real, (1j * omega * turning).real
    power = (record.force[steady.first : steady.last] - steady.force[0].real - container_mass * acceleration) * velocity
    width = max(round(record.sampling_rate / steady.frequency / 2), 1)
    size = abs(amplitude)
    coefficient = 2 * float(_sliding(power, width).mean()) / size**2
    stored = power - coefficient * velocity**2
    mass = float(np.sqrt(8 * _sliding(stored**2, width).mean()) / (omega * size**2))
    return Equivalent(coefficient, mass)


def _sliding(
    values: np.ndarray[tuple[int], np.dtype[np.float64]], width: int
) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    """Means of all windows of `width` neighbouring values."""
    total = np.concatenate([[0.0], np.cumsum(values)])
    means: np.ndarray[tuple[int], np.dtype[np.float64]] = (total[width:] - total[:-width]) / width
    return means
