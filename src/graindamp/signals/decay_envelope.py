"""Envelope of a decay by the Hilbert transform, its frequency, and what else is in the record."""

from typing import NamedTuple

import numpy as np
import scipy.fft
import scipy.interpolate
from numpy.typing import NDArray

from graindamp.signals.decay_peaks import Extremes

Real = NDArray[np.float64]

FADE = 8
"""Cycles by which the oscillation is continued at either end, fading."""
BLOCK = 8
"""Cycles over which other lines are looked for."""
NEAR = 0.3
"""Part of the frequency on either side that belongs to the oscillation itself, its change with amplitude included."""


class Envelope(NamedTuple):
    """Amplitude and frequency sample by sample, from the first to the last peak."""

    time: Real
    """From the first sample of the record [s]; shape (sample,)."""
    amplitude: Real
    """In the unit of the record; shape (sample,)."""
    frequency: Real
    """Mean of the instantaneous frequency over a cycle [Hz]; shape (sample,)."""


class Line(NamedTuple):
    """The strongest oscillation beside the decaying one."""

    frequency: float
    """[Hz]."""
    share: float
    """Its amplitude over that of the decaying oscillation, both relative to the envelope, at its strongest [-]."""


class Flat(NamedTuple):
    """A decay over the curve through its peaks: an oscillation of amplitude near one."""

    values: Real
    """From the first to the last peak [-]; shape (sample,)."""
    reference: Real
    """The curve, in the unit of the record; shape (sample,)."""
    first: int
    """Sample of the record at which it begins."""


def flatten(motion: Real, extremes: Extremes, sampling_rate: float) -> Flat:
    """A decay over the monotone cubic curve through the logarithms of its peaks."""
    first, last = int(extremes.time[0] * sampling_rate), int(np.ceil(extremes.time[-1] * sampling_rate))
    time = np.arange(first, last + 1) / sampling_rate
    curve = scipy.interpolate.PchipInterpolator(extremes.time, np.log(np.abs(extremes.value)))
    reference = np.exp(curve(time))
    return Flat(motion[first : last + 1] / reference, reference, first)


def hilbert_envelope(flat: Flat, sampling_rate: float, frequency: tuple[float, float]) -> Envelope:
    """Envelope and instantaneous frequency of a decay, means over one cycle.

    The transform of a decay as it stands rings at both ends, because the signal starts and stops there. Here its
    amplitude is made one first, and the oscillation continued at both ends by the sine of the first and the last cycle,
    fading over :data:`FADE` cycles; the curve taken off is put back afterwards. The mean over a cycle removes harmonics
    and most of the noise.

    Args:
        flat: the decay of amplitude one.
        sampling_rate: [Hz].
        frequency: at the first and at the last peak [Hz].

    Source: Feldman (2011), Hilbert Transform Applications in Mechanical Vibration, ch. 2 to 4, on the envelope.
    """
    before = _continued(flat.values[::-1], sampling_rate, frequency[0])[::-1]
    after = _continued(flat.values, sampling_rate, frequency[1])
    whole = np.concatenate([before, flat.values, after])
    length = scipy.fft.next_fast_len(len(whole))
    weight = np.zeros(length)
    weight[0], weight[1 : (length + 1) // 2] = 1.0, 2.0
    if length % 2 == 0:
        weight[length // 2] = 1.0
    analytic = scipy.fft.ifft(scipy.fft.fft(whole, length) * weight)[: len(whole)]
    part = slice(len(before), len(before) + len(flat.values))
    per_cycle = 2.0 * sampling_rate / (frequency[0] + frequency[1])
    size = _mean_over_cycle(np.log(np.maximum(np.abs(analytic), 1e-12)), per_cycle)
    turning = np.gradient(_mean_over_cycle(np.unwrap(np.angle(analytic)), per_cycle)) * sampling_rate / (2 * np.pi)
    time = (flat.first + np.arange(len(flat.values))) / sampling_rate
    return Envelope(time, np.exp(size[part]) * flat.reference, turning[part])


def _continued(values: Real, sampling_rate: float, frequency: float) -> Real:
    """The sine of the last cycle, continued and fading."""
    n = min(round(sampling_rate / frequency), len(values))
    angle = 2 * np.pi * frequency / sampling_rate * np.arange(-n, 0)
    cosine, sine = np.linalg.lstsq(np.column_stack([np.cos(angle), np.sin(angle)]), values[-n:], rcond=None)[0]
    ahead = np.arange(round(FADE * sampling_rate / frequency))
    angle = 2 * np.pi * frequency / sampling_rate * ahead
    fade = np.clip(2.0 * (1.0 - ahead / len(ahead)), 0.0, 1.0)  # full for the half that a mean over a cycle reaches
    fade = 0.5 - 0.5 * np.cos(np.pi * fade)
    return np.asarray(fade * (cosine * np.cos(angle) + sine * np.sin(angle)), float)


def _mean_over_cycle(values: Real, per_cycle: float) -> Real:
    """Mean over one cycle about each sample, the outermost samples weighted so that its length is exact."""
    half = int(np.ceil(per_cycle / 2 - 0.5))
    outermost = (per_cycle - (2 * half - 1)) / 2
    padded = np.pad(values, half, mode="edge")
    total = np.concatenate([[0.0], np.cumsum(padded)])
    n = len(values)
    inner = total[2 * half : 2 * half + n] - total[1 : n + 1]
    return np.asarray((inner + outermost * (padded[:n] + padded[2 * half :])) / per_cycle, float)


def strongest_line(flat: Flat, sampling_rate: float, frequency: float, noise: float) -> Line:
    """The strongest line of a decay of amplitude one outside its own frequency, over what noise would leave there.

    Looked for in blocks of :data:`BLOCK` cycles, since another mode may die before the decay does, down to a tenth of
    the largest amplitude. Lines below a quarter of the frequency are not seen.

    Args:
        flat: the decay of amplitude one.
        sampling_rate: [Hz].
        frequency: of the decay [Hz].
        noise: standard deviation of the noise of a sample, in the unit of the record.
    """
    large = int(np.sum(flat.reference > 0.1 * flat.reference.max()))
    n = min(round(BLOCK * sampling_rate / frequency), len(flat.values))
    lines = [
        _line_of(flat.values[i : i + n], sampling_rate, frequency, noise / float(flat.reference[i : i + n].min()))
        for i in range(0, max(large - n, 0) + 1, max(n // 2, 1))
    ]
    return max(lines, key=lambda line: line.share)


def _line_of(values: Real, sampling_rate: float, frequency: float, noise: float) -> Line:
    n = len(values)
    window = np.hanning(n + 2)[1:-1]
    spectrum = np.abs(np.fft.rfft((values - np.average(values, weights=window)) * window, 2 * n))
    bins = np.fft.rfftfreq(2 * n, 1.0 / sampling_rate)
    own = np.abs(bins - frequency) < max(NEAR * frequency, 3.0 * sampling_rate / n)
    outside = ~own & (bins > 2.0 * sampling_rate / n)
    if not own.any() or not outside.any():
        return Line(float("nan"), 0.0)
    best = int(np.argmax(np.where(outside, spectrum, 0.0)))
    of_noise = noise * (6.0 / n * np.log(n)) ** 0.5  # the largest of n bins of noise through a Hann window
    return Line(float(bins[best]), max(float(spectrum[best] / spectrum[own].max()) - of_noise, 0.0))
