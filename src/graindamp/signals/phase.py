"""Phase error between the force and the motion channel, from runs of the empty container.

An empty container is a rigid mass: its force over its acceleration is real. What angle the channels show instead is
theirs, and is taken from every run with particles at that frequency (Wong & Rongong 2009, section II.B).
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Real = NDArray[np.float64]

SAME_FREQUENCY = 0.005
"""Calibrations within this share of a frequency are taken for that frequency."""


class EmptyRun(NamedTuple):
    """Apparent mass of the empty container in one run."""

    frequency: float
    """[Hz]."""
    apparent_mass: complex
    """Force over acceleration at the driving frequency [kg]."""
    phase_error: float
    """Standard error of its angle [rad]."""


class PhaseCalibration(NamedTuple):
    """Angle of the empty container's apparent mass over frequency; one entry per calibrated frequency, ascending."""

    frequency: Real
    """[Hz]."""
    phase: Real
    """[rad]; negative when the force channel comes late."""
    standard_error: Real
    """[rad]; from the scatter between and within the runs of a frequency, whichever is larger."""
    mass: Real
    """Modulus of the apparent mass [kg]."""

    def at(self, frequency: float) -> tuple[float, float]:
        """Angle to take from the force and its standard error [rad] at a frequency [Hz].

        Between calibrated frequencies it is interpolated linearly, outside it grows with frequency like that of a time
        delay; the error then includes a tenth of the angle assumed.
        """
        nearest = int(np.argmin(np.abs(self.frequency / frequency - 1)))
        if abs(self.frequency[nearest] / frequency - 1) < SAME_FREQUENCY:
            return float(self.phase[nearest]), float(self.standard_error[nearest])
        if self.frequency[0] < frequency < self.frequency[-1]:
            phase = float(np.interp(frequency, self.frequency, self.phase))
            error = float(np.interp(frequency, self.frequency, self.standard_error))
            delay = self.phase / self.frequency
            neighbours = np.searchsorted(self.frequency, frequency) + np.array([-1, 0])
            return phase, float(np.hypot(error, np.ptp(delay[neighbours]) * frequency / 2))
        stretch = frequency / self.frequency[nearest]
        phase = float(self.phase[nearest] * stretch)
        return phase, float(np.hypot(self.standard_error[nearest] * stretch, 0.1 * phase))


def calibrate(runs: Sequence[EmptyRun]) -> PhaseCalibration:
    """Phase calibration from any number of empty-container runs, at least one."""
    frequency = np.array([run.frequency for run in runs])
    order = np.argsort(frequency, kind="stable")
    groups = np.split(order, 1 + np.flatnonzero(np.diff(frequency[order]) > SAME_FREQUENCY * frequency[order][:-1]))
    rows = []
    for group in groups:
        mass = np.array([runs[i].apparent_mass for i in group])
        error = np.maximum([runs[i].phase_error for i in group], 1e-9)
        weight = error**-2 / np.sum(error**-2)
        direction = np.sum(weight * mass / np.abs(mass))
        scatter = np.angle(mass / direction)
        within = float(np.sqrt(1 / np.sum(error**-2)))
        n = len(group)
        between = float(np.sqrt(np.sum(weight * scatter**2) / (n - 1))) if n > 1 else 0.0
        rows.append(
            (np.dot(weight, frequency[group]), np.angle(direction), max(within, between), np.abs(mass) @ weight)
        )
    return PhaseCalibration(*np.array(rows).T)
