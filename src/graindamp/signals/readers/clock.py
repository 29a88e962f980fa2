"""The sampling rate that a time channel tells, and whether its steps are uniform."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from graindamp.errors import InputError

AGREEMENT = 1e-3
"""Relative difference of two statements of the sampling rate that is still the same rate [-]. The effective mass
inherits it: acceleration is the rate times a velocity difference."""

REMEDY = 'or write the rate in the description: [channels] sampling_rate = "51200 Hz"'


def rate_of_time(
    time: NDArray[np.float64], resolution: NDArray[np.float64], place: str, where: Callable[[int], str]
) -> float:
    """Samples per second of a time channel [Hz], the mean over its whole length.

    Args:
        time: time of each sample [s], shape (sample,).
        resolution: last digit written or stored of each time [s], shape (sample,).
        place: file and channel, to open messages.
        where: how a person finds sample i, counted from 0: "line 12".

    Raises:
        InputError: no times, not increasing, steps uneven beyond the resolution, or too few digits to tell a rate.
    """
    if time.size < 2 or not np.isfinite(time).all():
        missing = int(np.argmin(np.isfinite(time))) if time.size else 0
        raise InputError(f"{place}: no time at {where(missing)}; complete it, {REMEDY}")
    step = (time[-1] - time[0]) / (time.size - 1)
    if step <= 0:
        raise InputError(f"{place}: time does not increase ({time[0]:.6g} s to {time[-1]:.6g} s); correct it, {REMEDY}")
    deviation = np.abs(np.diff(time) - step)
    # Each end of a step is rounded by half its last digit; a thousandth of a step is below any phase of interest.
    allowed = 1.01 * (resolution[:-1] + resolution[1:]) / 2 + 1e-3 * step
    worst = int(np.argmax(deviation - allowed))
    if deviation[worst] > allowed[worst]:
        raise InputError(
            f"{place}: time steps are not uniform: {time[worst + 1] - time[worst]:.6g} s before "
            f"{where(worst + 1)}, {step:.6g} s on average; export without gaps, {REMEDY}"
        )
    uncertainty = resolution[-1] / (time[-1] - time[0])
    if uncertainty > AGREEMENT and deviation.max() > 1e-6 * step:  # equal steps are meant as they are written
        raise InputError(
            f"{place}: written with {resolution[-1]:.0e} s resolution over {time[-1] - time[0]:.3g} s, too coarse for "
            f"a sampling rate to {AGREEMENT:.1%}; export more digits, {REMEDY}"
        )
    return float(1 / step)


def stored_resolution(time: NDArray[np.float64]) -> NDArray[np.float64]:
    """Spacing of the floating-point numbers that hold `time`, single precision where all of them fit in it."""
    single = time.astype(np.float32)
    if np.array_equal(single.astype(np.float64), time, equal_nan=True):
        return np.spacing(np.abs(single)).astype(np.float64)
    return np.spacing(np.abs(time))


def printed_resolution(cells: list[str], time: NDArray[np.float64]) -> NDArray[np.float64]:
    """Value of the last digit written of each time, for fixed decimals (0.000123) as for fixed digits (1.23e-4).

    Trailing zeros may have been dropped, so neither one cell nor its neighbour tells alone: the finest decimal place of
    the column bounds it from below, and the most significant digits of any cell tell the place in each cell.
    """
    ends = cells if len(cells) < 2000 else cells[:1000] + cells[-1000:]
    mantissas = [cell.lower().replace(",", ".").partition("e") for cell in ends]
    decimals = max(
        len(mantissa.partition(".")[2]) - (int(exponent) if exponent else 0) for mantissa, _, exponent in mantissas
    )
    digits = max(
        len(mantissa.replace(".", "").lstrip("+-0")) or len(mantissa.strip("+-0.")) for mantissa, _, _ in mantissas
    )
    magnitude = np.floor(np.log10(np.where(time == 0, 1e-300, np.abs(time))))
    places: NDArray[np.float64] = np.maximum(10.0**-decimals, 10.0 ** np.maximum(magnitude + 1 - digits, -300))
    return places
