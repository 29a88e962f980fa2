"""What is wrong with a record, named before anything is computed from it."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from graindamp.signals import fit
from graindamp.signals.record import MotionKind, Record
from graindamp.signals.steady import MIN_CYCLES
from graindamp.status import FATAL, Status

Real = NDArray[np.float64]

PHASE_WANDER = 0.1
"""Largest departure of the motion's phase from a steady sine [rad]; 0.1 changes the amplitude of a fit by 0.5 %."""
FREQUENCY_TOLERANCE = 0.005
"""A given frequency may differ by this share from that of the motion; clocks of generator and recorder never agree."""
ORDER: dict[MotionKind, int] = {"velocity": 0, "acceleration": 1, "displacement": -1}
"""The power of i omega that makes the motion from the velocity."""
LARGEST_INTENSITY, LARGEST_STROKE = 1000.0, 0.5
"""Intensity [-] and displacement [m] above which the unit of a record is doubted."""
DISTORTED, NOT_SINUSOIDAL = 0.05, 0.30
"""Share of the motion's velocity outside its fundamental above which it is flagged, or refused [-]."""


class Problem(NamedTuple):
    """One thing wrong with a record: the bit, and what was found, with its number."""

    status: Status
    text: str

    @property
    def is_fatal(self) -> bool:
        """True where no value can be given."""
        return bool(self.status & FATAL)


def check_samples(record: Record) -> list[Problem]:
    """Problems that show before any frequency is known: lengths, rates, missing and clipped samples."""
    problems = []
    n_force, n_motion = len(record.force), len(record.motion)
    if abs(record.motion_rate / record.sampling_rate - 1) > 1e-6:
        problems.append(
            Problem(
                Status.RATE_MISMATCH,
                f"force is sampled at {record.sampling_rate:g} Hz, {record.motion_kind} at {record.motion_rate:g} Hz",
            )
        )
    elif n_force != n_motion:
        problems.append(
            Problem(Status.LENGTH_MISMATCH, f"force has {n_force} samples, {record.motion_kind} {n_motion}")
        )
    for name, samples in (("force", record.force), (record.motion_kind, record.motion)):
        bad = np.flatnonzero(~np.isfinite(samples))
        if len(bad):
            text = f"{len(bad)} of {len(samples)} {name} samples are NaN or infinite, the first at sample {bad[0] + 1}"
            problems.append(Problem(Status.NOT_FINITE, text))
        elif len(samples) and (share := clipped_share(samples)) > 0:
            text = f"{100 * share:.2g} % of the {name} samples stick at an extreme value: the channel is clipped"
            problems.append(Problem(Status.CLIPPED, text))
    if not problems and (n_motion < 16 or np.ptp(record.motion) == 0.0):
        text = f"{n_motion} samples" if n_motion < 16 else f"the {record.motion_kind} is constant"
        problems.append(Problem(Status.TOO_SHORT if n_motion < 16 else Status.NO_MOTION, text))
    elif not problems and np.ptp(record.force) == 0.0:
        problems.append(Problem(Status.NO_FORCE, "the force is constant"))
    return problems


def clipped_share(samples: Real) -> float:
    """Share of samples stuck at the highest or lowest value [-], 0 where that is no more than a quantised peak.

    The top level of a quantised sine holds at most 2.4 times the samples of the next level, (sqrt 2 - 1)^-1; clipping
    piles up many times more, in runs. A signal that has only two levels is a square wave, not a clipped one.
    """
    levels = np.unique(samples)
    if len(levels) <= 2:
        return 0.0
    share = 0.0
    for extreme, beyond in ((levels[-1], levels[-2]), (levels[0], levels[1])):
        at = samples == extreme
        n_at, n_next = int(at.sum()), int((samples == beyond).sum())
        run = int((at[2:] & at[1:-1] & at[:-2]).sum())
        if n_at >= 6 and run >= 1 and n_at >= 5 * n_next:
            share += n_at / len(samples)
    return share if share < 0.8 else 0.0


def find_frequency(record: Record) -> tuple[float, list[Problem]]:
    """Driving frequency of a record [Hz] from its motion, near the given one if any, and what is wrong with it.

    NaN where none can be given; then the problem is fatal.
    """
    rate, nan = record.sampling_rate, float("nan")
    duration = len(record.motion) / rate
    strongest = fit.coarse_frequency(record.motion, rate, ORDER[record.motion_kind])
    start = record.frequency or strongest
    if not np.isfinite(start):
        return nan, [Problem(Status.NO_MOTION, f"no frequency stands out in the {record.motion_kind}")]
    if duration * start < MIN_CYCLES:
        text = f"{duration * start:.2g} cycles of {start:.4g} Hz in {duration:.3g} s, at least {MIN_CYCLES} are needed"
        return nan, [Problem(Status.TOO_SHORT, text)]
    if rate < fit.MIN_SAMPLES_PER_CYCLE * start:
        text = f"{rate:g} Hz sampling for a drive of {start:.4g} Hz, at least {fit.MIN_SAMPLES_PER_CYCLE} per cycle"
        return nan, [Problem(Status.UNDERSAMPLED, text)]
    found = fit.refine_frequency(record.motion, rate, start)
    wanders = found.phase_wander > PHASE_WANDER
    if record.frequency is not None and (
        abs(found.frequency / start - 1) > FREQUENCY_TOLERANCE or (wanders and abs(strongest / start - 1) > 0.02)
    ):
        text = f"{start:g} Hz is given, the {record.motion_kind} oscillates at {strongest:.5g} Hz"
        return nan, [Problem(Status.FREQUENCY_MISMATCH, text)]
    if wanders:
        text = (
            f"the phase of the {record.motion_kind} wanders by {found.phase_wander:.2g} rad from a steady "
            f"{found.frequency:.4g} Hz, {PHASE_WANDER} is allowed"
        )
        return nan, [Problem(Status.FREQUENCY_DRIFT, text)]
    return found.frequency, []


def check_shape(record: Record, frequency: float, first: int, last: int) -> list[Problem]:
    """Whether samples first..last of the motion, whole cycles, are a sine of `frequency` [Hz].

    Everything else is weighed as velocity, so that the noise of an accelerometer counts no more than it moves.
    """
    motion = record.motion[first:last]
    time = np.arange(len(motion)) / record.sampling_rate
    offset, fundamental = fit.harmonics(motion, time, frequency, 1)
    rest = motion - offset.real - (fundamental * np.exp(2j * np.pi * frequency * time)).real
    bins = np.fft.rfftfreq(len(rest), 1 / record.sampling_rate)
    weight = np.zeros_like(bins)
    weight[1:] = (frequency / np.maximum(bins[1:], frequency / 2)) ** ORDER[record.motion_kind]
    spectrum = np.abs(np.fft.rfft(rest)) * weight
    share = float(np.sqrt(2 * np.sum(spectrum**2)) / len(rest) / max(abs(fundamental) / np.sqrt(2), 1e-300))
    if share < DISTORTED:
        return []
    text = f"{100 * share:.2g} % of the velocity (rms) is outside the sine of {frequency:.4g} Hz"
    return [Problem(Status.NOT_SINUSOIDAL if share > NOT_SINUSOIDAL else Status.DISTORTED, text)]
