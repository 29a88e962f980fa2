"""Where a free decay begins and ends, and its peaks of both signs free of offset, drift and noise."""

from math import comb
from typing import NamedTuple

import numpy as np
import scipy.ndimage
from numpy.typing import NDArray

from graindamp.errors import InputError
from graindamp.signals import decay_local as local
from graindamp.signals.decay_noise import tail_error, white_noise
from graindamp.signals.decay_record import DecayRecord
from graindamp.spec.decay import DecayMethodSpec

Real = NDArray[np.float64]
Index = NDArray[np.int64]

HALF_CYCLE = (0.3, 0.75)
"""Time between two zeros that is taken for half a cycle, in cycles of the oscillation found [-]."""
PASSES = 3
"""Times the offset is found: from the end of the record, then from peaks, then from peaks about that."""
LEAST_PEAKS = 6
"""Fewest peaks of both signs together: two cycles of either sign."""
UNEVEN, LOPSIDED = 0.08, 0.15
"""Relative difference of the first two half cycles, and difference of the sides of the first peak a radian away over
its height, above which that peak is one of the release [-]."""
BINOMIAL = 5
"""Peaks are averaged with the binomial weights of this order to find the offset: a decay by the factor exp(-d) in half
a cycle leaves (1 - exp(-d))^5 / 32 of its amplitude in it."""


class Extremes(NamedTuple):
    """Successive peaks of a decay, of alternate sign."""

    time: Real
    """From the first sample [s]; shape (peak,)."""
    value: Real
    """With its sign, offset removed, in the unit of the record; shape (peak,)."""
    error: Real
    """Standard error from noise, same unit; shape (peak,)."""
    crossing: Real
    """Time of the zero before each peak and of that after the last [s], NaN where the record begins or ends; shape
    (peak + 1,)."""
    crossing_error: Real
    """Standard error of those [s]; shape (peak + 1,)."""


class Located(NamedTuple):
    """The decay in a record."""

    extremes: Extremes
    motion: Real
    """The record without its offset, filtered where that is asked for; shape (sample,)."""
    offset: tuple[float, float]
    """Offset at time zero [unit of the record], and its drift [unit per s]."""
    sample_noise: float
    """Standard deviation of the noise of a sample, from its high-frequency part."""
    peak_noise: float
    """Standard error of a peak."""
    ends_in_noise: bool
    """True where the amplitude falls to the given multiple of `peak_noise`, or the oscillation becomes irregular, more
    than a cycle before the record ends."""


class _Segments(NamedTuple):
    """Stretches between zeros of the smoothed signal."""

    begin: Index
    end: Index
    is_long: NDArray[np.bool_]
    """At least about half a cycle."""
    is_short: NDArray[np.bool_]
    """At most about half a cycle."""


def locate(
    record: DecayRecord,
    frequency: float,
    method: DecayMethodSpec,
    filtered: Real | None = None,
    kernel: Real | None = None,
) -> Located:
    """The decay in a record: from its largest peak to where it drowns in noise or the record ends.

    Offset and drift come from the peaks themselves, weighted so that small amplitudes, for which they matter, decide;
    a mean over the record would keep a part of the first cycles.

    Args:
        record: checked.
        frequency: of the oscillation, good to some per cent [Hz].
        method: how peaks are found.
        filtered: the motion behind a filter, which is then looked at; shape (sample,).
        kernel: impulse response of that filter, of odd length, for the noise that passes it.

    Raises:
        InputError: fewer than :data:`LEAST_PEAKS` peaks.
    """
    rate = record.sampling_rate
    duration = len(record.motion) / rate
    if method.start is not None and method.start >= duration:
        raise InputError(f"{record.source}: start is {method.start:g} s, but the record has {duration:.4g} s")
    looked_at = record.motion if filtered is None else filtered
    per_cycle = rate / frequency
    window = local.window_of(method.peaks, per_cycle)
    time = np.arange(len(looked_at)) / rate
    # Half of the filter's length at each end of the record, and after the release, is the filter's own answer.
    blind = 0 if kernel is None else len(kernel) // 2
    after = 0.0 if kernel is None else _after_filter(record, frequency, method, blind)
    offset = (0.0 if method.baseline == "none" else _rough_offset(looked_at, per_cycle), 0.0)
    change = (0.0, 0.0)
    for _ in range(1 if method.baseline == "none" else PASSES):
        offset = (offset[0] + change[0], offset[1] + change[1])
        motion = looked_at - offset[0] - offset[1] * time
        extremes = _follow(motion, rate, frequency, window, method, after, blind)
        _check_number(extremes, record, frequency, 0.0)
        extremes, noise, error = _above_noise(extremes, record, motion, window, kernel, method.noise_factor)
        _check_number(extremes, record, frequency, method.noise_factor * error)
        change = _offset_of(extremes, error, 1 if method.baseline == "linear" else 0)
    # Noise that is not white blurs zeros as much more than white noise as it does peaks.
    colour = error / max(noise * float(np.linalg.norm(local.middle_weights(window))), 1e-300)
    last_time = min((len(looked_at) - blind) / rate, method.end if method.end is not None else np.inf)
    return Located(
        extremes._replace(
            error=np.full(len(extremes.time), error), crossing_error=extremes.crossing_error * noise * colour
        ),
        motion,
        offset,
        noise,
        error,
        bool(extremes.time[-1] < last_time - 1.0 / frequency),
    )


def _above_noise(
    extremes: Extremes,
    record: DecayRecord,
    motion: Real,
    window: local.Window,
    kernel: Real | None,
    noise_factor: float,
) -> tuple[Extremes, float, float]:
    """The peaks above the noise, standard deviation of the noise of a sample, and standard error of a peak."""
    rate, time = record.sampling_rate, extremes.time
    per_cycle = rate * 2.0 * float(time[-1] - time[0]) / (len(time) - 1)
    noise = white_noise(record.motion[int(time[0] * rate) : int(time[-1] * rate) + 1], per_cycle)
    weights = local.middle_weights(window)
    gain = float(np.linalg.norm(weights if kernel is None else np.convolve(weights, kernel)))
    error = max(noise * gain, 1e-15 * float(np.ptp(motion)))
    extremes = _above(extremes, noise_factor * error)
    if len(extremes.time):  # the tail knows noise of any colour, but only what is left after the decay has drowned
        error = max(error, tail_error(motion, int(extremes.time[-1] * rate) + 1, weights, per_cycle))
        extremes = _above(extremes, noise_factor * error)
    return extremes, noise, error


def _rough_offset(motion: Real, per_cycle: float) -> float:
    """Mean of the last quarter of a record, at least two cycles, faded at both ends so that cycles cancel."""
    n = min(len(motion), max(round(2 * per_cycle), len(motion) // 4))
    return float(np.average(motion[-n:], weights=np.hanning(n + 2)[1:-1]))


def _segments(motion: Real, per_cycle: float) -> _Segments:
    length = max(round(per_cycle / 4) | 1, 3)
    smooth = scipy.ndimage.uniform_filter1d(scipy.ndimage.uniform_filter1d(motion, length), length)
    positive = smooth >= 0.0
    change = np.flatnonzero(positive[1:] != positive[:-1]) + 1
    begin, end = np.concatenate([[0], change]), np.concatenate([change, [len(motion)]])
    cycles = (end - begin) / per_cycle
    half = round(per_cycle / 2)
    begin = np.where(cycles >= HALF_CYCLE[1], end - half, begin)  # the last half cycle of a rest before the release
    return _Segments(begin, end, cycles > HALF_CYCLE[0], cycles < HALF_CYCLE[1])


def _follow(
    motion: Real,
    rate: float,
    frequency: float,
    window: local.Window,
    method: DecayMethodSpec,
    after: float = 0.0,
    blind: int = 0,
) -> Extremes:
    """Peaks from the largest on, as long as zeros follow each other at about half a cycle.

    Those earlier than `after` [s], or in the last `blind` samples, do not count.
    """
    segments = _segments(motion, rate / frequency)
    found = _highest(motion, segments, window)
    at, size = found.position / rate, np.abs(found.value)
    last_time = (len(motion) - 1 - blind) / rate if method.end is None else method.end
    usable = segments.is_long & (at <= last_time) & np.isfinite(size)
    usable &= (found.position >= segments.begin - 1) & (found.position <= segments.end)
    start = _largest(size, usable, at, max(method.start or 0.0, after))
    if start is None:
        return Extremes(np.empty(0), np.empty(0), np.empty(0), np.empty(1), np.empty(1))
    goes_on = usable & segments.is_short
    stop = start + 1 + int(np.argmin(np.append(goes_on[start + 1 :], False)))
    if stop - start > LEAST_PEAKS and _is_of_release(motion, found.position[start : start + 3], rate / frequency):
        start += 1
    edges = np.append(segments.begin[start:stop], segments.end[stop - 1])
    crossing = local.zeros(motion, edges, local.window_of("polynomial", rate / frequency))
    zero = crossing.position / rate
    zero[0] = np.nan  # it may be that of the release, where the motion has a kink
    return Extremes(at[start:stop], found.value[start:stop], found.gain[start:stop], zero, crossing.gain / rate)


def _after_filter(record: DecayRecord, frequency: float, method: DecayMethodSpec, blind: int) -> float:
    """When the filter has forgotten the release: half its length after a quarter of a cycle before the largest peak."""
    rate = record.sampling_rate
    motion = record.motion - _rough_offset(record.motion, rate / frequency)
    whole = _follow(motion, rate, frequency, local.window_of("polynomial", rate / frequency), method)
    release = float(whole.time[0]) - 0.25 / frequency if len(whole.time) >= LEAST_PEAKS else 0.0
    return max(release, 0.0) + blind / rate


def _highest(motion: Real, segments: _Segments, window: local.Window) -> local.Found:
    """The peak of each segment long enough; NaN in others."""
    size = np.abs(motion)
    guess = np.full(len(segments.begin), -1, np.int64)  # no window reaches there
    for i in np.flatnonzero(segments.is_long):
        begin, end = segments.begin[i], segments.end[i]
        guess[i] = begin + int(np.argmax(size[begin:end]))
    return local.peaks(motion, guess, window)


def _is_of_release(motion: Real, position: Real, per_cycle: float) -> bool:
    """Whether the first of three peaks is one of the release and not of the decay.

    A displacement that was held has a plateau before it, an acceleration begins with a step: the peak stands at the
    wrong time, or its sides differ by more than the decay explains.
    """
    if abs((position[1] - position[0]) / (position[2] - position[1]) - 1.0) > UNEVEN:
        return True
    reach = per_cycle / (2.0 * np.pi)
    if position[0] < reach:
        return False
    left, first, right, second = np.interp(
        [position[0] - reach, position[0], position[0] + reach, position[1]], np.arange(len(motion)), motion
    )
    growth = abs(first / second) ** (2.0 / np.pi)  # over two radians, from one side to the other
    return bool(abs(left / first - growth * right / first) > LOPSIDED)


def _largest(size: Real, usable: NDArray[np.bool_], at: Real, after: float) -> int | None:
    """Index of the largest peak after a time; None where there is none."""
    candidates = np.flatnonzero(usable & (at >= after))
    return int(candidates[np.argmax(size[candidates])]) if len(candidates) else None


def _part(extremes: Extremes, last: int) -> Extremes:
    """The first `last` peaks."""
    return Extremes(
        extremes.time[:last],
        extremes.value[:last],
        extremes.error[:last],
        extremes.crossing[: last + 1],
        extremes.crossing_error[: last + 1],
    )


def _above(extremes: Extremes, threshold: float) -> Extremes:
    """The peaks before the amplitude, half the distance between neighbours, first falls below a threshold."""
    amplitude = np.abs(np.diff(extremes.value)) / 2
    below = np.flatnonzero(amplitude < threshold)
    return _part(extremes, int(below[0])) if len(below) else extremes


def _check_number(extremes: Extremes, record: DecayRecord, frequency: float, threshold: float) -> None:
    n = len(extremes.time)
    if n >= LEAST_PEAKS:
        return
    duration = len(record.motion) / record.sampling_rate
    text = f"{record.source}: {n} peaks in a row of an oscillation of {frequency:.4g} Hz, {LEAST_PEAKS} are needed"
    if n:
        text += f"; the largest at {extremes.time[0]:.4g} s of {duration:.4g} s"
        if extremes.time[0] > 0.75 * duration:
            text += ", where a decay would have died away: is the channel right, and the oscillation free?"
        elif threshold > 0.2 * abs(extremes.value[0]):
            text += f", it is no more than noise: a decay must stay above {threshold:.3g} in the unit of the record"
        else:
            text += "; record longer, or say where it is with start, end and frequency"
    raise InputError(text)


def _offset_of(extremes: Extremes, error: float, degree: int) -> tuple[float, float]:
    """Offset at time zero and drift that the peaks tell, by weighted least squares; `error` is that of a peak."""
    value, n = extremes.value, len(extremes.value)
    order = min(BINOMIAL, n - 1)
    weights = np.array([comb(order, k) for k in range(order + 1)]) / 2.0**order
    middle = np.convolve(value, weights, mode="valid")
    time = np.convolve(extremes.time, weights, mode="valid")
    size = np.convolve(np.abs(value), weights, mode="valid")
    # What a decay leaves in the average falls with its amplitude, and what noise leaves does not.
    large = slice(max(len(middle) // 3, 1))
    leak = float(np.median(np.abs(middle[large]) / size[large]))
    uncertainty = np.hypot(error * float(np.linalg.norm(weights)), leak * size) + 1e-15 * size[0]
    # The alternating column takes what an exponential decay leaves; the line is what remains.
    columns = [np.ones_like(time), size * (-1.0) ** np.arange(len(size))]
    if degree and n >= 2 * LEAST_PEAKS:
        columns.append(time - time.mean())
    design = np.column_stack(columns) / uncertainty[:, None]
    terms = np.linalg.lstsq(design, middle / uncertainty, rcond=None)[0]
    drift = float(terms[2]) if len(columns) > 2 else 0.0
    return float(terms[0]) - drift * float(time.mean()), drift
