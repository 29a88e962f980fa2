"""Free decay of a structure: from a record of its motion to damping and frequency over amplitude.

The specific damping capacity of a cycle is the share of its energy that it loses, Psi = 1 - (V_next / V)^2, with the
amplitudes V of two successive peaks of one sign. Source: Witt (2011), "Particle impact damping in the horizontal
plane", MSc thesis, Texas A&M University, Eqs 2.25 to 2.29 and section 3.
"""

from typing import NamedTuple

import numpy as np
import scipy.signal
from numpy.typing import NDArray

from graindamp.errors import InputError
from graindamp.signals.checks import LARGEST_INTENSITY, LARGEST_STROKE, ORDER, clipped_share
from graindamp.signals.decay_envelope import Envelope, Flat, flatten, hilbert_envelope, strongest_line
from graindamp.signals.decay_errors import cycle_sensitivity, moving_average, spread
from graindamp.signals.decay_peaks import Extremes, Located, locate
from graindamp.signals.decay_record import DecayRecord, check_decay
from graindamp.signals.record import MOTION_UNIT
from graindamp.spec.decay import DecayMethodSpec
from graindamp.units import STANDARD_GRAVITY

Real = NDArray[np.float64]

LEAST_PER_CYCLE, FEW_PER_CYCLE = 8.0, 12.0
"""Samples per cycle below which a record is refused, and below which it is flagged."""
CONTAMINATED = 0.03
"""Amplitude of another line over that of the decay above which a record is flagged [-]."""
FREQUENCY_AVERAGE = 5
"""Cycles over which the frequency is averaged that turns one amplitude into another."""


class Cycles(NamedTuple):
    """Cycle i runs from peak i to peak i + 2, the next of the same sign; all shapes (cycle,)."""

    time: Real
    """Of its first peak, from the first sample [s]."""
    sign: Real
    """Of its peaks, +1 or -1."""
    displacement: Real
    """Displacement amplitude U at its first peak [m]."""
    velocity: Real
    """Velocity amplitude V there [m/s]."""
    intensity: Real
    """Acceleration amplitude over gravity Gamma there [-]."""
    psi: Real
    """Specific damping capacity [-], cleared of the bias that noise gives a ratio of squares."""
    psi_error: Real
    """Its standard error from noise [-]."""
    psi_average: Real
    """Moving average of `psi` over neighbouring cycles of both signs [-]."""
    psi_average_error: Real
    """Its standard error from noise [-]."""
    psi_envelope: Real
    """Psi of the Hilbert envelope between the same instants [-]."""
    log_decrement: Real
    """ln(V / V_next) [-]."""
    damping_ratio: Real
    """zeta of a viscous decay of that decrement [-]."""
    damping_ratio_error: Real
    """Its standard error from noise [-]."""
    frequency: Real
    """One over the time of the cycle, from zeros [Hz]; the first value stands half a cycle late."""
    frequency_error: Real
    """Its standard error from noise [Hz]."""


class Decay(NamedTuple):
    """What one record of a free decay says."""

    record: DecayRecord
    located: Located
    """Peaks, offset and noise."""
    cycles: Cycles
    envelope: Envelope
    frequency: float
    """Median over the cycles [Hz]."""
    damping_ratio: float
    """zeta of the straight line through the logarithms of all peaks [-]; a mean where damping depends on amplitude."""
    warnings: tuple[str, ...]
    """What to know before the numbers are used, a line each."""


def analyze_decay(record: DecayRecord, method: DecayMethodSpec | None = None) -> Decay:
    """Psi, damping ratio and frequency of every cycle of a free decay, with standard errors.

    The decay begins with the largest peak and ends where its amplitude falls to `noise_factor` standard errors of a
    peak. A band-pass, where asked for, leaves Psi of an exponential decay unchanged, averages changes over half its
    length, and takes half its length after the release and before the end.

    Args:
        record: displacement, velocity or acceleration of one point.
        method: how peaks are found; default as :class:`graindamp.spec.decay.DecayMethodSpec` says.

    Raises:
        InputError: no decay is found in the record, with the reason.
    """
    method = method or DecayMethodSpec()
    check_decay(record)
    frequency = method.frequency or coarse_frequency(record)
    _check_sampling(record, frequency)
    kernel = band_pass(record.sampling_rate, frequency, method.filter_cycles) if method.filter_cycles else None
    if kernel is not None and len(kernel) >= len(record.motion):
        raise InputError(
            f"{record.source}: filter_cycles = {method.filter_cycles} is longer than the record, "
            f"{len(record.motion) * frequency / record.sampling_rate:.3g} cycles; lower it"
        )
    filtered = None if kernel is None else _filtered(record.motion, kernel)
    located = locate(record, frequency, method, filtered, kernel)
    located, clipped = _without_clipped(record, located)
    _check_falls(record, located.extremes)
    cycles = _cycles(record, located.extremes, method.moving_average)
    flat = flatten(located.motion, located.extremes, record.sampling_rate)
    envelope = hilbert_envelope(flat, record.sampling_rate, (float(cycles.frequency[0]), float(cycles.frequency[-1])))
    cycles = cycles._replace(psi_envelope=_psi_of_envelope(envelope, located.extremes))
    mean = float(np.median(cycles.frequency))
    return Decay(
        record,
        located,
        cycles,
        envelope,
        mean,
        _damping_of_line(located.extremes),
        (*clipped, *_warnings(record, located, cycles, flat, mean)),
    )


def mass_normalised(psi: Real, mass_ratio: float) -> Real:
    """Mass-normalised specific damping capacity Psi_m = Psi (1 + mu)^2 / mu [-].

    Args:
        psi: specific damping capacity due to the particles, intrinsic damping taken off [-].
        mass_ratio: mu, mass of all particles over that of the structure [-], > 0.

    Source: Friend & Kinra (2000), J. Sound Vib. 233, 93-118, as quoted by Witt (2011), Eq. 2.29.
    """
    return np.asarray(psi) * (1.0 + mass_ratio) ** 2 / mass_ratio


def coarse_frequency(record: DecayRecord) -> float:
    """Frequency of the strongest line of the velocity [Hz], good to a fraction of the width of the line.

    Only the end of the record is faded out: a decay is strongest where it begins.

    Raises:
        InputError: nothing oscillates.
    """
    n = len(record.motion)
    fade = np.cos(0.5 * np.pi * np.arange(n) / n) ** 2
    spectrum = np.abs(np.fft.rfft((record.motion - np.average(record.motion, weights=fade)) * fade, 4 * n))
    bins = np.fft.rfftfreq(4 * n, 1.0 / record.sampling_rate)
    spectrum[:12] = 0.0  # fewer than three cycles in the record are no oscillation
    spectrum[12:] *= bins[12:] ** -ORDER[record.quantity]
    best = int(np.argmax(spectrum))
    if not spectrum[best] > 0.0:
        raise InputError(f"{record.source}: nothing oscillates in the {record.quantity}; check the channel")
    return float(bins[best])


def band_pass(sampling_rate: float, frequency: float, n_cycle: int) -> Real:
    """Symmetric impulse response of a band-pass of gain one at `frequency`: a Hann window of `n_cycle` cycles.

    It takes out offset and harmonics, and leaves less than 3 % of what is farther from the frequency than 2 / n_cycle
    of it. Shape (sample,), odd.
    """
    half = max(round(0.5 * n_cycle * sampling_rate / frequency), 1)
    angle = 2.0 * np.pi * frequency / sampling_rate * np.arange(-half, half + 1)
    kernel = np.hanning(2 * half + 3)[1:-1] * np.cos(angle)
    return np.asarray(kernel / np.sum(kernel * np.cos(angle)), float)


def _filtered(motion: Real, kernel: Real) -> Real:
    return np.asarray(scipy.signal.oaconvolve(motion - motion[-1], kernel, mode="same"), float)


def _check_sampling(record: DecayRecord, frequency: float) -> None:
    per_cycle = record.sampling_rate / frequency
    if per_cycle < LEAST_PER_CYCLE:
        raise InputError(
            f"{record.source}: {per_cycle:.3g} samples per cycle of {frequency:.4g} Hz at {record.sampling_rate:g} Hz, "
            f"at least {LEAST_PER_CYCLE:g} are needed; sample faster, or give the frequency if this is not the mode"
        )


def _without_clipped(record: DecayRecord, located: Located) -> tuple[Located, tuple[str, ...]]:
    """The decay from after the last peak that sticks at the end of the recorder's range."""
    extremes = located.extremes
    begin = max(int((extremes.time[0] - 0.25 / _frequency_near(extremes)) * record.sampling_rate), 0)
    part = record.motion[begin : int(extremes.time[-1] * record.sampling_rate) + 1]
    if clipped_share(part) == 0.0:
        return located, ()
    offset = located.offset[0] + located.offset[1] * extremes.time
    limit = min(part.max(), -part.min()) * (1.0 - 1e-3)
    bad = np.flatnonzero(np.abs(extremes.value + offset) >= limit)
    first = int(bad[-1]) + 1 if len(bad) else 0
    if not first:
        return located, ()
    if len(extremes.time) - first < 6:
        raise InputError(
            f"{record.source}: {len(bad)} of {len(extremes.time)} peaks stick at the end of the range; widen the input "
            "range of the channel and measure again"
        )
    kept = Extremes(*(values[first:] for values in extremes))
    until = extremes.time[first - 1]
    text = f"{record.label}: peaks up to {until:.4g} s are clipped and left out; widen the input range of the channel"
    return located._replace(extremes=kept), (text,)


def _frequency_near(extremes: Extremes) -> float:
    return float((len(extremes.time) - 1) / 2 / (extremes.time[-1] - extremes.time[0]))


def _check_falls(record: DecayRecord, extremes: Extremes) -> None:
    size = np.abs(extremes.value)
    drop = float(np.log(size[:3].mean() / size[-3:].mean()))
    if drop < max(3.0 * float(extremes.error[-1] / size[-3:].mean()), 1e-7):
        unit = MOTION_UNIT[record.quantity]
        raise InputError(
            f"{record.source}: the oscillation of {_frequency_near(extremes):.4g} Hz does not decay: {size[0]:.4g} "
            f"{unit} at {extremes.time[0]:.4g} s, {size[-1]:.4g} {unit} at {extremes.time[-1]:.4g} s; is it still "
            "driven, or the wrong channel?"
        )


def _cycles(record: DecayRecord, extremes: Extremes, width: int) -> Cycles:
    size = np.abs(extremes.value)
    relative = extremes.error / size
    n = len(size) - 2
    squared = (size[2:] / size[:-2]) ** 2 / ((1.0 + relative[2:] ** 2) * (1.0 + 3.0 * relative[:-2] ** 2))
    decrement = np.log(size[:-2] / size[2:])
    damping_ratio = decrement / np.hypot(2.0 * np.pi, decrement)
    sensitivity = cycle_sensitivity(2.0 * squared)
    average = moving_average(n, width)
    steepness = 4.0 * np.pi**2 / (4.0 * np.pi**2 + decrement**2) ** 1.5
    frequency, frequency_error = _frequencies(extremes)
    smooth = moving_average(n, FREQUENCY_AVERAGE)
    zeta = smooth @ damping_ratio
    omega = 2.0 * np.pi * (smooth @ frequency) / np.sqrt(1.0 - zeta**2)
    velocity = size[:n] * omega ** -ORDER[record.quantity]
    return Cycles(
        time=extremes.time[:n],
        sign=np.sign(extremes.value[:n]),
        displacement=velocity / omega,
        velocity=velocity,
        intensity=velocity * omega / STANDARD_GRAVITY,
        psi=1.0 - squared,
        psi_error=spread(sensitivity, relative),
        psi_average=average @ (1.0 - squared),
        psi_average_error=spread(average @ sensitivity, relative),
        psi_envelope=np.full(n, np.nan),
        log_decrement=decrement,
        damping_ratio=damping_ratio,
        damping_ratio_error=spread(cycle_sensitivity(steepness), relative),
        frequency=frequency,
        frequency_error=frequency_error,
    )


def _frequencies(extremes: Extremes) -> tuple[Real, Real]:
    """Frequency of every cycle from its zeros, two rising and two falling, so that an offset cancels."""
    zero, error = extremes.crossing, extremes.crossing_error
    period = zero[2:] - zero[:-2]
    variance = error[2:] ** 2 + error[:-2] ** 2
    both = np.stack([period[:-1], period[1:]])
    known = np.isfinite(both)
    count = known.sum(axis=0)
    total = np.where(known, both, 0.0).sum(axis=0)
    spread_squared = np.where(known, np.stack([variance[:-1], variance[1:]]), 0.0).sum(axis=0)
    with np.errstate(divide="ignore", invalid="ignore"):
        mean = np.where(count > 0, total / count, extremes.time[2:] - extremes.time[:-2])
        deviation = np.where(count > 0, np.sqrt(spread_squared) / count, np.nan)
    return 1.0 / mean, deviation / mean**2


def _psi_of_envelope(envelope: Envelope, extremes: Extremes) -> Real:
    size = np.interp(extremes.time, envelope.time, np.log(envelope.amplitude))
    return np.asarray(1.0 - np.exp(2.0 * (size[2:] - size[:-2])), float)


def _damping_of_line(extremes: Extremes) -> float:
    size = np.abs(extremes.value)
    number = np.arange(len(size)) / 2.0
    weight = 1.0 / np.hypot(extremes.error / size, 0.01)
    decrement = -float(np.polynomial.polynomial.polyfit(number, np.log(size), 1, w=weight)[1])
    return float(decrement / np.hypot(2.0 * np.pi, decrement))


def _warnings(record: DecayRecord, located: Located, cycles: Cycles, flat: Flat, frequency: float) -> tuple[str, ...]:
    lines = []
    per_cycle = record.sampling_rate / frequency
    if per_cycle < FEW_PER_CYCLE:
        lines.append(f"{per_cycle:.3g} samples per cycle: peaks are good to 5e-4 of the amplitude only; sample faster")
    line = strongest_line(flat, record.sampling_rate, frequency, located.sample_noise)
    if line.share > CONTAMINATED:
        times = line.frequency / frequency
        lines.append(
            f"an oscillation of {line.frequency:.3g} Hz, {times:.3g} times that of the decay, has up to "
            f"{100 * line.share:.2g} % of its amplitude and shifts single peaks by as much; a band-pass takes it out "
            "(filter_cycles = 4)"
        )
    rises = np.flatnonzero(cycles.log_decrement < -np.maximum(4.0 * cycles.psi_error / 2.0, 0.01))
    if len(rises):
        lines.append(
            f"the amplitude rises in {len(rises)} of {len(cycles.time)} cycles, first at {cycles.time[rises[0]]:.4g} "
            "s: particles that give energy back, a second mode near by, or a disturbance"
        )
    if cycles.intensity[0] > LARGEST_INTENSITY or cycles.displacement[0] > LARGEST_STROKE:
        lines.append(
            f"the amplitude is {cycles.displacement[0]:.3g} m or {cycles.intensity[0]:.3g} times gravity at "
            f"{frequency:.4g} Hz; is the unit of the {record.quantity} right?"
        )
    return tuple(f"{record.label}: {text}" for text in lines)
