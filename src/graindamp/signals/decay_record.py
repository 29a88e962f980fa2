"""Records of free decays: the motion alone, from any signal file."""

from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from graindamp.errors import InputError
from graindamp.signals.readers.read import read_records
from graindamp.signals.record import MOTION_UNIT, MotionKind
from graindamp.spec.measurement import ChannelsSpec

Real = NDArray[np.float64]

LEAST_SAMPLES = 40
"""Fewest samples of a record."""


class DecayRecord(NamedTuple):
    """One free decay, already in SI."""

    motion: Real
    """Velocity [m/s], acceleration [m/s^2] or displacement [m] of one point; shape (sample,)."""
    quantity: MotionKind
    """Which of the three `motion` is."""
    sampling_rate: float
    """Samples per second [Hz]."""
    label: str = "decay"
    """Name of the run."""
    source: str = "record"
    """Where it came from, to open messages."""


def read_decays(path: str | Path, channels: ChannelsSpec | None = None) -> list[DecayRecord]:
    """Motion of every run in a signal file, in SI.

    Args:
        path: as for :func:`graindamp.signals.readers.read.read_records`; no force is needed, and a text table may have
            a single column.
        channels: which channel is the motion, its kind, unit and sampling rate, where the file does not tell.

    Raises:
        InputError: the file cannot be opened or is damaged, or does not tell motion and sampling rate.
    """
    spec = (channels or ChannelsSpec()).model_copy(update={"with_force": False})
    return [
        DecayRecord(record.motion, record.motion_kind, record.motion_rate, record.label, record.source)
        for record in read_records(path, spec)
    ]


def check_decay(record: DecayRecord) -> None:
    """Refuse what no decay can be found in.

    Raises:
        InputError: another shape than (sample,), too few samples, a rate that is no rate, NaN, or nothing moves.
    """
    motion, n = record.motion, np.size(record.motion)
    if record.quantity not in MOTION_UNIT:
        raise InputError(f"{record.source}: quantity is '{record.quantity}'; allowed are {', '.join(MOTION_UNIT)}")
    if np.ndim(motion) != 1 or n < LEAST_SAMPLES:
        shape = "x".join(map(str, np.shape(motion)))
        raise InputError(f"{record.source}: {shape} samples; a decay needs one signal of at least {LEAST_SAMPLES}")
    if not (np.isfinite(record.sampling_rate) and record.sampling_rate > 0):
        raise InputError(f"{record.source}: the sampling rate is {record.sampling_rate} Hz, but must be positive")
    bad = np.flatnonzero(~np.isfinite(motion))
    if len(bad):
        raise InputError(
            f"{record.source}: {len(bad)} of {n} {record.quantity} samples are NaN or infinite, the first at sample "
            f"{bad[0] + 1}; cut them out or export the record again"
        )
    if np.ptp(motion) == 0.0:
        raise InputError(
            f"{record.source}: the {record.quantity} is constant ({motion[0]:g} {MOTION_UNIT[record.quantity]}); "
            "check the channel"
        )
