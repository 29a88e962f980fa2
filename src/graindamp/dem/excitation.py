"""From a described motion of the container to the arrays that the engine moves it by."""

import math
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from graindamp.dem.motion import AMPLITUDE, DIRECTION, FUNDAMENTAL, INTERVAL, RAMP, SHAPE, START, MotionKind
from graindamp.dem.state import Motion
from graindamp.errors import InputError
from graindamp.spec.motion import (
    HarmonicMotion,
    HarmonicsMotion,
    MotionSpec,
    RandomMotion,
    SeriesMotion,
    SweepMotion,
)

Real = NDArray[np.float64]

SAMPLES_PER_PERIOD = 32
"""Samples of a random motion per period of its highest frequency [-]; the quintics between them are then right to
1e-7."""


def motion_of(motion: MotionSpec, start: float = 0.0, folder: Path | None = None) -> Motion:
    """Arrays of a motion that begins at `start` [s]; files are relative to `folder`.

    Raises:
        InputError: the file of a series cannot be used.
    """
    kind, wave, series, timing = MotionKind.REST, np.zeros((1, 5)), np.zeros((2, 3)), np.zeros(8)
    timing[START] = start
    direction = np.asarray(getattr(motion, "direction", (1.0, 0.0, 0.0)))
    timing[DIRECTION : DIRECTION + 3] = direction
    if isinstance(motion, HarmonicMotion):
        kind = MotionKind.HARMONICS
        wave = _wave(motion.frequency, motion.phase, motion.acceleration_amplitude(motion.frequency), direction)[None]
        timing[RAMP] = motion.soft_start / motion.frequency
        timing[FUNDAMENTAL] = 2.0 * math.pi * motion.frequency
    elif isinstance(motion, HarmonicsMotion):
        kind = MotionKind.HARMONICS
        wave = np.array(
            [
                _wave(
                    part.frequency,
                    part.phase,
                    part.acceleration_amplitude(part.frequency),
                    direction if part.direction is None else np.asarray(part.direction),
                )
                for part in motion.components
            ]
        )
        timing[RAMP] = motion.soft_start / motion.base_frequency
        timing[FUNDAMENTAL] = 2.0 * math.pi * motion.base_frequency
    elif isinstance(motion, SweepMotion):
        kind = MotionKind.SWEEP
        power = 2.0 if motion.intensity is not None else 1.0 if motion.speed is not None else 0.0
        omega = 2.0 * math.pi * motion.start
        wave = np.zeros((2, 5))
        wave[0, 0], wave[1, 0] = omega, 2.0 * math.pi * motion.stop
        wave[0, AMPLITUDE] = motion.acceleration_amplitude(motion.start) / omega**2 * omega**power
        wave[1, AMPLITUDE] = power
        timing[INTERVAL], timing[SHAPE] = motion.duration, motion.law == "log"
    elif isinstance(motion, RandomMotion):
        kind = MotionKind.SERIES
        series, timing[INTERVAL] = random_series(motion)
        timing[SHAPE] = len(series) - 1
    elif isinstance(motion, SeriesMotion):
        kind = MotionKind.SERIES
        series, timing[INTERVAL] = measured_series(motion, folder)
    return Motion(
        kind=np.array([kind], np.int32),
        wave=np.ascontiguousarray(wave[None]),
        series=np.ascontiguousarray(series[None]),
        timing=timing[None],
        displacement=np.zeros((1, 3)),
        velocity=np.zeros((1, 3)),
        acceleration=np.zeros((1, 3)),
    )


def _wave(frequency: float, phase: float, acceleration: float, direction: Real) -> Real:
    omega = 2.0 * math.pi * frequency
    return np.array([omega, phase, *(acceleration / omega**2 * direction)])


def random_series(motion: RandomMotion) -> tuple[Real, float]:
    """Displacement, velocity and acceleration of one sample of a random motion, and their interval [s].

    Spectral lines 1/duration apart with the amplitude that the density gives and random phases; the three quantities
    are exact derivatives of each other. Source: Shinozuka & Deodatis (1991), Appl. Mech. Rev. 44, 191-204."""
    spacing = 1.0 / motion.duration
    first = math.ceil(motion.frequencies[0] / spacing - 1e-9)
    last = math.floor(motion.frequencies[-1] / spacing + 1e-9)
    line = np.arange(max(first, 1), last + 1)
    frequency = line * spacing
    with np.errstate(divide="ignore"):
        density = np.exp(
            np.interp(np.log(frequency), np.log(motion.frequencies), np.log(np.asarray(motion.psd, np.float64)))
        )
    phase = np.random.default_rng(motion.seed).uniform(0.0, 2.0 * math.pi, len(line))
    amplitude = np.sqrt(2.0 * density * spacing) * np.exp(1j * phase)
    n = max(int(2 ** math.ceil(math.log2(SAMPLES_PER_PERIOD * last))), 16)
    omega = 2.0 * math.pi * frequency
    series = np.empty((n + 1, 3))
    for column, factor in enumerate((-1.0 / omega**2, -1j / omega, np.ones_like(omega))):
        spectrum = np.zeros(n // 2 + 1, np.complex128)
        spectrum[line] = 0.5 * n * amplitude * factor
        series[:n, column] = np.fft.irfft(spectrum, n)
    series[n] = series[0]
    return series, motion.duration / n


def measured_series(motion: SeriesMotion, folder: Path | None) -> tuple[Real, float]:
    """Displacement, velocity and acceleration from a file, and their interval [s].

    A cubic spline is laid through accelerations or velocities, a quintic one through displacements, and integrated or
    differentiated. The mean velocity over the record is taken out of what acceleration leaves open, so that the
    container does not drift away.

    Raises:
        InputError: no such file or column, too few samples, times that do not ascend, values that are no numbers.
    """
    from scipy.interpolate import CubicSpline, make_interp_spline

    path = Path(motion.file) if folder is None else folder / motion.file
    unit = {"acceleration": "m/s^2", "velocity": "m/s", "displacement": "m"}[motion.quantity]
    time, value = read_series(path, motion.time_column, motion.value_column, motion.unit, unit)
    if len(time) < 8:
        raise InputError(f"{path}: {len(time)} samples of the motion; at least 8 are needed")
    if not (np.all(np.isfinite(time)) and np.all(np.isfinite(value))):
        raise InputError(f"{path}: the motion holds values that are not numbers; cut them out")
    if np.any(np.diff(time) <= 0.0):
        place = int(np.argmax(np.diff(time) <= 0.0))
        raise InputError(f"{path}: times must ascend; sample {place + 2} is not after the one before it")
    interval = float(np.min(np.diff(time)))
    n = math.ceil((time[-1] - time[0]) / interval - 1e-6)
    grid = np.linspace(time[0], time[-1], n + 1)
    if motion.quantity == "displacement":
        spline = make_interp_spline(time, value, k=5)
        x, v, a = spline(grid), spline.derivative()(grid), spline.derivative(2)(grid)
    elif motion.quantity == "velocity":
        spline = CubicSpline(time, value)
        x, v, a = spline.antiderivative()(grid), spline(grid), spline.derivative()(grid)
    else:
        spline = CubicSpline(time, value)
        x, v, a = spline.antiderivative(2)(grid), spline.antiderivative()(grid), spline(grid)
        drift = (x[-1] - x[0]) / (grid[-1] - grid[0])
        x, v = x - drift * (grid - grid[0]), v - drift
    return np.column_stack([x, v, a]), float(grid[1] - grid[0])


def read_series(
    path: Path, time_column: str, value_column: str | None, unit: str | None, si_unit: str
) -> tuple[Real, Real]:
    """Times [s] and values of a file (.csv or .npz).

    Args:
        path: the file.
        time_column: name of the column, or array, of times.
        value_column: that of the values; None: the one beside the times.
        unit: of the values; None: `si_unit`.
        si_unit: unit that the values come back in.

    Raises:
        InputError: no such file or column, or not a table of numbers.
    """
    from graindamp.units import to_si

    table = _table(path)
    if time_column not in table:
        raise InputError(f"{path}: no column '{time_column}'; it has {', '.join(table)}; name it in time_column")
    others = [name for name in table if name != time_column]
    if value_column is None and len(others) != 1:
        raise InputError(
            f"{path}: which of {', '.join(others) or 'no columns'} holds the values? name it in value_column"
        )
    value = others[0] if value_column is None else value_column
    if value not in table:
        raise InputError(f"{path}: no column '{value}'; it has {', '.join(others)}; name another in value_column")
    if table[value].shape != table[time_column].shape:
        raise InputError(f"{path}: '{time_column}' and '{value}' differ in length")
    try:
        factor = 1.0 if unit is None else to_si(f"1 {unit}", si_unit)
    except ValueError as error:
        raise InputError(f"{path}: unit: given '{unit}'; {error}") from None
    return table[time_column], factor * table[value]


def _table(path: Path) -> dict[str, Real]:
    """Columns of a file by name."""
    try:
        if path.suffix.lower() == ".npz":
            with np.load(path) as file:
                return {name: np.atleast_1d(np.asarray(file[name], np.float64)) for name in file.files}
        with open(path, encoding="utf-8-sig") as text:
            names = [name.strip().strip('"') for name in text.readline().split(",")]
            lines = [line for line in text if line.strip()]
        if not lines:
            raise ValueError("it has no numbers")
        numbers = np.loadtxt(lines, delimiter=",", ndmin=2)
        if numbers.shape[1] != len(names):
            raise ValueError(f"{len(names)} names over {numbers.shape[1]} columns")
        return {name: numbers[:, k] for k, name in enumerate(names)}
    except OSError as error:
        raise InputError(f"{path}: cannot be opened ({error.strerror or error})") from None
    except ValueError as error:
        raise InputError(
            f"{path}: not a table of numbers under one line of names, separated by commas ({error})"
        ) from None
