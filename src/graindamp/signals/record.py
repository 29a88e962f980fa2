"""What every reader gives and every analysis takes: force and motion of a container at one operating point."""

from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

MotionKind = Literal["velocity", "acceleration", "displacement"]

MOTION_UNIT: dict[MotionKind, str] = {"velocity": "m/s", "acceleration": "m/s^2", "displacement": "m"}


class Record(NamedTuple):
    """One run at one frequency and amplitude, already in SI."""

    force: NDArray[np.float64]
    """Force exerted ON the container by what drives it [N], container inertia included, positive along the motion's
    positive direction. Shape (sample,); (0,) where the motion alone was read."""
    motion: NDArray[np.float64]
    """Velocity [m/s], acceleration [m/s^2] or displacement [m] of the container. Shape (sample,)."""
    motion_kind: MotionKind
    """Which of the three `motion` is."""
    sampling_rate: float
    """Samples per second of the force [Hz]."""
    motion_rate: float
    """Samples per second of the motion [Hz]; anything but `sampling_rate` is reported as an error of the record."""
    frequency: float | None = None
    """Driving frequency [Hz]; None: find it from the motion."""
    nominal_intensity: float | None = None
    """Intensity the rig was set to [-], a label for grids; the measured one is always computed."""
    label: str = ""
    """Name of the run: group, file stem."""
    source: str = ""
    """Where it came from, as a person would find it: 'signals.h5:f100_G16'."""
    container_mass: float | None = None
    """Mass of the empty container [kg], if the file tells."""
    bed_mass: float | None = None
    """Mass of all particles [kg], if the file tells."""
    is_empty: bool = False
    """True for a run of the empty container."""
