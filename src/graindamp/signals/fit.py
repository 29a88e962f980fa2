"""Harmonics of a periodic signal by least squares: no window, no whole number of samples per cycle needed.

Amplitudes are peak values of y(t) = Re[sum_n Y_n exp(i n Omega t)].
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Complex = NDArray[np.complex128]
Real = NDArray[np.float64]

MIN_SAMPLES_PER_CYCLE = 4
"""Below this a fundamental and its offset cannot be told apart from one cycle."""


def _design(time: Real, frequency: float, n_harmonic: int) -> Real:
    angle = 2 * np.pi * frequency * np.outer(time, np.arange(1, n_harmonic + 1))
    return np.hstack([np.ones((len(time), 1)), np.cos(angle), np.sin(angle)])


def harmonics(signals: Real, time: Real, frequency: float, n_harmonic: int) -> Complex:
    """Complex amplitudes of the offset and the first `n_harmonic` harmonics of each signal, in its own unit.

    Args:
        signals: samples, shape (sample,) or (sample, channel).
        time: sampling instants [s], shape (sample,).
        frequency: fundamental frequency [Hz].
        n_harmonic: number of harmonics fitted together, so that none leaks into another.

    Returns:
        shape (1 + n_harmonic,) or (1 + n_harmonic, channel); row n is n times the fundamental, row 0 the mean.
    """
    solution = _solve(_design(time, frequency, n_harmonic), signals)
    cosine, sine = solution[1 : 1 + n_harmonic], solution[1 + n_harmonic :]
    result: Complex = np.concatenate([solution[:1].astype(complex), cosine - 1j * sine])
    return result


def n_harmonic_of(sampling_rate: float, frequency: float, at_most: int) -> int:
    """Number of harmonics a sampling rate carries safely below its Nyquist frequency, from 1 to `at_most`."""
    return int(np.clip(0.45 * sampling_rate / frequency, 1, at_most))


def _solve(design: Real, signals: Real) -> Real:
    """Least squares by the normal equations: sines over whole cycles are nearly orthogonal, so nothing is lost."""
    return np.asarray(np.linalg.solve(design.T @ design, design.T @ signals), float)


class Cycles(NamedTuple):
    """Fundamental of each whole cycle of a record."""

    start: NDArray[np.int64]
    """First sample of each cycle, and one past the last; shape (cycle + 1,)."""
    amplitude: Complex
    """Complex amplitude of the fundamental about the record's time zero; shape (cycle, channel)."""


def fit_cycles(signals: Real, sampling_rate: float, frequency: float) -> Cycles:
    """Fundamental of every whole cycle of the record, each fitted on its own samples with two further harmonics.

    A last cycle that lacks no more than one sample counts as whole.

    Args:
        signals: samples, shape (sample, channel).
        sampling_rate: [Hz].
        frequency: [Hz].
    """
    n_cycle = int((len(signals) + 1) * frequency / sampling_rate)
    start = np.ceil(np.arange(n_cycle + 1) * sampling_rate / frequency - 1e-6).astype(np.int64)
    start[-1] = min(start[-1], len(signals))
    n_harmonic = int(np.clip((sampling_rate / frequency - 2) // 2, 1, 3))  # fewer unknowns than samples in a cycle
    design = _design(np.arange(len(signals)) / sampling_rate, frequency, n_harmonic)
    amplitude = np.empty((n_cycle, signals.shape[1]), complex)
    for k in range(n_cycle):
        part = slice(start[k], start[k + 1])
        solution = _solve(design[part], signals[part])
        amplitude[k] = solution[1] - 1j * solution[1 + n_harmonic]
    return Cycles(start, amplitude)


def coarse_frequency(motion: Real, sampling_rate: float, order: int = 0) -> float:
    """Frequency of the strongest line of the velocity [Hz], good to a fraction of its resolution; NaN if nothing moves.

    Hann window, parabola through the logarithms of the three highest bins; lines of fewer than two cycles do not count.

    Args:
        motion: samples, shape (sample,).
        sampling_rate: [Hz].
        order: 0 for a velocity, 1 for an acceleration, -1 for a displacement: the power of i omega that made it.
    """
    centred = motion - motion.mean()
    spectrum = np.abs(np.fft.rfft(centred * np.hanning(len(centred))))
    spectrum[:2] = 0.0
    spectrum[2:] *= np.arange(2.0, len(spectrum)) ** -order
    peak = int(np.argmax(spectrum))
    if spectrum[peak] == 0.0 or peak + 1 >= len(spectrum):
        return float("nan")
    low, mid, high = np.log(np.maximum(spectrum[peak - 1 : peak + 2], 1e-300))
    curvature = low - 2 * mid + high
    shift = 0.5 * (low - high) / curvature if curvature < 0 else 0.0
    return float((peak + np.clip(shift, -0.5, 0.5)) * sampling_rate / len(motion))


class FrequencyFit(NamedTuple):
    """Driving frequency found from the phase of the motion, cycle by cycle."""

    frequency: float
    """[Hz]."""
    phase_wander: float
    """Largest departure of the phase from that of a steady sine, over cycles of at least half the median amplitude
    [rad]."""


def refine_frequency(motion: Real, sampling_rate: float, frequency: float, n_pass: int = 3) -> FrequencyFit:
    """Frequency that makes the phase of the motion constant from cycle to cycle, starting near `frequency` [Hz].

    The record must hold at least three whole cycles.
    """
    wander = 0.0
    for _ in range(n_pass):
        cycles = fit_cycles(motion[:, None], sampling_rate, frequency)
        amplitude = cycles.amplitude[:, 0]
        size = np.abs(amplitude)
        moving = size > 0.5 * np.median(size[size > 0.1 * size.max()])  # a record may start or end at rest
        middle = ((cycles.start[:-1] + cycles.start[1:]) / 2 / sampling_rate)[moving]
        phase = np.unwrap(np.angle(amplitude[moving]))
        if len(middle) < 2:
            break  # one cycle has no slope: the frequency stays as it is
        slope, offset = np.polyfit(middle, phase, 1)
        wander = float(np.abs(phase - slope * middle - offset).max())
        frequency += float(slope) / (2 * np.pi)
    return FrequencyFit(frequency, wander)
