"""Motion of the container: a step of the loop, state in, particle force in, motion out.

Displacement, velocity and acceleration always belong together: a soft start multiplies the displacement, and the
product rule gives the other two."""

from enum import IntEnum
from math import cos, floor, log, sin

from graindamp.dem.compile import compiled


class MotionKind(IntEnum):
    """How the container moves."""

    REST = 0
    HARMONICS = 1
    """Sum of sines with a soft start."""
    SWEEP = 2
    """Sine whose frequency rises or falls, and whose amplitude follows."""
    SERIES = 3
    """Samples of displacement, velocity and acceleration, joined by quintics."""


START = 0
"""Places in Motion.timing: time at which the motion starts [s]."""
RAMP = 1
"""Duration of the soft start [s]."""
DIRECTION = 2
"""Unit direction (2-4), for series and sweeps, and for the Fourier sums."""
INTERVAL = 5
"""Sampling interval of a series, or duration of a sweep [s]."""
SHAPE = 6
"""Sweep: 0 linear, 1 logarithmic. Series: intervals after which it repeats [-]; 0: it ends."""
FUNDAMENTAL = 7
"""Angular frequency of the Fourier sums [rad/s]; 0: none."""

OMEGA = 0
"""Places in a row of Motion.wave."""
PHASE = 1
AMPLITUDE = 2
"""Displacement amplitude in x, y, z (2-4) [m]. A sweep has its first angular frequency in row 0 and its last in row
1, and at this place the factor and the power of its amplitude over angular frequency."""


@compiled
def ramp(time, duration):
    """Soft start 0 to 1 with two continuous derivatives, and those derivatives."""
    if time >= duration or duration <= 0.0:
        return 1.0, 0.0, 0.0
    s = time / duration
    return (
        s * s * s * (10.0 + s * (6.0 * s - 15.0)),
        30.0 * s * s * (1.0 - s) * (1.0 - s) / duration,
        60.0 * s * (1.0 - s) * (1.0 - 2.0 * s) / (duration * duration),
    )


@compiled
def move(w, time, motion):
    """Write displacement, velocity and acceleration of the container of world w at `time` [s]."""
    place, speed, change = motion.displacement[w], motion.velocity[w], motion.acceleration[w]
    for c in range(3):
        place[c] = speed[c] = change[c] = 0.0
    timing, kind = motion.timing[w], motion.kind[w]
    t = time - timing[START]
    if kind == MotionKind.REST or t < 0.0:
        return
    gain, gain_rate, gain_change = ramp(t, timing[RAMP])
    if kind == MotionKind.HARMONICS:
        wave = motion.wave[w]
        for k in range(wave.shape[0]):
            omega = wave[k, OMEGA]
            a, b = sin(omega * t + wave[k, PHASE]), cos(omega * t + wave[k, PHASE])
            for c in range(3):
                x = wave[k, AMPLITUDE + c]
                place[c] += x * gain * a
                speed[c] += x * (gain * omega * b + gain_rate * a)
                change[c] += x * (gain_change * a + 2.0 * gain_rate * omega * b - gain * omega * omega * a)
        return
    if kind == MotionKind.SWEEP:
        x, v, a = sweep(t, timing[INTERVAL], motion.wave[w], timing[SHAPE] > 0.5)
    else:
        step = t / timing[INTERVAL]
        if timing[SHAPE] > 0.0:
            step -= timing[SHAPE] * floor(step / timing[SHAPE])
        x, v, a = between(step, timing[INTERVAL], motion.series[w])
    a = gain_change * x + 2.0 * gain_rate * v + gain * a
    v = gain_rate * x + gain * v
    x = gain * x
    for c in range(3):
        place[c] = x * timing[DIRECTION + c]
        speed[c] = v * timing[DIRECTION + c]
        change[c] = a * timing[DIRECTION + c]


@compiled
def sweep(t, duration, wave, logarithmic):
    """Displacement, velocity, acceleration of a sweep whose displacement is A omega^-p sin(phase).

    Acceleration amplitude is constant for p = 2, velocity amplitude for 1, displacement amplitude for 0, up to terms
    of the sweep's rate over its frequency. The amplitude follows the frequency, so velocity and acceleration carry
    its derivatives."""
    first, last, peak, power = wave[0, OMEGA], wave[1, OMEGA], wave[0, AMPLITUDE], wave[1, AMPLITUDE]
    t = min(t, duration)
    if logarithmic:
        rate = log(last / first) / duration
        omega = first * (last / first) ** (t / duration)
        phase = (omega - first) / rate
        turn = rate * omega
        turn_rate = rate * turn
    else:
        turn = (last - first) / duration
        omega = first + turn * t
        phase = (first + 0.5 * turn * t) * t
        turn_rate = 0.0
    x = peak / omega**power
    x_rate = -power * x * turn / omega
    x_change = power * x * ((power + 1.0) * turn * turn / omega - turn_rate) / omega
    a, b = sin(phase), cos(phase)
    return (
        x * a,
        x_rate * a + x * omega * b,
        x_change * a + 2.0 * x_rate * omega * b + x * (turn * b - omega * omega * a),
    )


@compiled
def between(place, interval, series):
    """Value and two derivatives of the quintic that meets displacement, velocity and acceleration of both samples.

    Outside the series the container rests where the series left it.
    """
    k = min(int(place), series.shape[0] - 2)
    s = min(place - k, 1.0)
    h = interval
    x0, v0, a0 = series[k, 0], series[k, 1] * h, series[k, 2] * h * h
    x1, v1, a1 = series[k + 1, 0], series[k + 1, 1] * h, series[k + 1, 2] * h * h
    if place >= series.shape[0] - 1:
        return x1, 0.0, 0.0
    d = x1 - x0
    c3 = 10.0 * d - 6.0 * v0 - 4.0 * v1 - 1.5 * a0 + 0.5 * a1
    c4 = -15.0 * d + 8.0 * v0 + 7.0 * v1 + 1.5 * a0 - a1
    c5 = 6.0 * d - 3.0 * v0 - 3.0 * v1 - 0.5 * a0 + 0.5 * a1
    return (
        x0 + s * (v0 + s * (0.5 * a0 + s * (c3 + s * (c4 + s * c5)))),
        (v0 + s * (a0 + s * (3.0 * c3 + s * (4.0 * c4 + s * 5.0 * c5)))) / h,
        (a0 + s * (6.0 * c3 + s * (12.0 * c4 + s * 20.0 * c5))) / (h * h),
    )
