"""Repeats of one decay on a common grid of amplitudes, with standard errors from noise and from their scatter."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import scipy.sparse
from numpy.typing import NDArray

from graindamp.signals.decay import Decay
from graindamp.signals.decay_errors import cycle_sensitivity, spread

Real = NDArray[np.float64]

LEAST_REPEATS = 2
"""Fewest records whose scatter gives a standard error."""


class Curve(NamedTuple):
    """Damping and frequency over displacement amplitude; all shapes (bin,), small amplitudes first.

    Each value is the mean over records of the mean over their cycles in the bin. Standard errors are the larger of what
    noise explains and what the records scatter; the scatter of n records is itself uncertain by 1 / sqrt(2 (n - 1)).
    """

    displacement: Real
    """Geometric mean of the displacement amplitudes U at the beginning of the cycles in the bin [m]."""
    velocity: Real
    """Likewise of the velocity amplitude V [m/s]."""
    intensity: Real
    """Likewise of the acceleration amplitude over gravity Gamma [-]."""
    psi: Real
    """Specific damping capacity Psi [-]."""
    psi_error: Real
    """Its standard error [-]."""
    psi_noise: Real
    """The part of it that noise explains [-]."""
    psi_scatter: Real
    """Standard error from the scatter of the records [-], NaN for one record."""
    damping_ratio: Real
    """zeta [-]."""
    damping_ratio_error: Real
    """Its standard error [-]."""
    frequency: Real
    """[Hz]."""
    frequency_error: Real
    """Its standard error [Hz]."""
    n_record: NDArray[np.int64]
    """Records with cycles in the bin."""
    n_cycle: NDArray[np.int64]
    """Cycles of all records in it, of both signs: they overlap by half."""


def combine(decays: Sequence[Decay], bins_per_decade: int = 20) -> Curve:
    """Mean over repeats, on bins of equal ratio of the displacement amplitude.

    Args:
        decays: of the same test, at least one.
        bins_per_decade: bins in a factor of ten of amplitude.
    """
    places = [np.floor(np.log10(decay.cycles.displacement) * bins_per_decade).astype(np.int64) for decay in decays]
    grid = np.unique(np.concatenate(places))
    means = [_means(decay, place, grid) for decay, place in zip(decays, places, strict=True)]
    count = np.array([mean.n_cycle for mean in means])
    here = count > 0

    def over_records(values: Sequence[Real]) -> Real:
        return np.asarray(np.where(here, np.array(values), 0.0).sum(axis=0) / here.sum(axis=0), float)

    def errors(values: Sequence[Real], noise: Sequence[Real]) -> tuple[Real, Real, Real]:
        explained = np.sqrt(np.where(here, np.array(noise) ** 2, 0.0).sum(axis=0)) / here.sum(axis=0)
        scatter = _scatter(np.array(values), here)
        return np.fmax(explained, scatter), explained, scatter

    psi = [mean.psi for mean in means]
    zeta, frequency = [mean.damping_ratio for mean in means], [mean.frequency for mean in means]
    psi_error, psi_noise, psi_scatter = errors(psi, [mean.psi_noise for mean in means])
    return Curve(
        displacement=np.exp(over_records([mean.log_displacement for mean in means])),
        velocity=np.exp(over_records([mean.log_velocity for mean in means])),
        intensity=np.exp(over_records([mean.log_intensity for mean in means])),
        psi=over_records(psi),
        psi_error=psi_error,
        psi_noise=psi_noise,
        psi_scatter=psi_scatter,
        damping_ratio=over_records(zeta),
        damping_ratio_error=errors(zeta, [mean.damping_ratio_noise for mean in means])[0],
        frequency=over_records(frequency),
        frequency_error=errors(frequency, [mean.frequency_noise for mean in means])[0],
        n_record=here.sum(axis=0),
        n_cycle=count.sum(axis=0),
    )


class _Means(NamedTuple):
    """One record on the grid; NaN where it has no cycle."""

    n_cycle: NDArray[np.int64]
    log_displacement: Real
    log_velocity: Real
    log_intensity: Real
    psi: Real
    psi_noise: Real
    damping_ratio: Real
    damping_ratio_noise: Real
    frequency: Real
    frequency_noise: Real


def _means(decay: Decay, place: NDArray[np.int64], grid: NDArray[np.int64]) -> _Means:
    cycles, extremes = decay.cycles, decay.located.extremes
    row = np.searchsorted(grid, place)
    count = np.bincount(row, minlength=len(grid))
    weight = 1.0 / count[row]
    average = scipy.sparse.csr_array((weight, (row, np.arange(len(row)))), shape=(len(grid), len(row)))
    none = np.where(count > 0, 0.0, np.nan)
    relative = extremes.error / np.abs(extremes.value)
    steepness = 4.0 * np.pi**2 / (4.0 * np.pi**2 + cycles.log_decrement**2) ** 1.5
    timing = np.where(np.isfinite(cycles.frequency_error), cycles.frequency_error, 0.0)
    return _Means(
        n_cycle=count,
        log_displacement=average @ np.log(cycles.displacement) + none,
        log_velocity=average @ np.log(cycles.velocity) + none,
        log_intensity=average @ np.log(cycles.intensity) + none,
        psi=average @ cycles.psi + none,
        psi_noise=spread(average @ cycle_sensitivity(2.0 * (1.0 - cycles.psi)), relative) + none,
        damping_ratio=average @ cycles.damping_ratio + none,
        damping_ratio_noise=spread(average @ cycle_sensitivity(steepness), relative) + none,
        frequency=average @ cycles.frequency + none,
        frequency_noise=spread(average, timing) + none,
    )


def _scatter(values: Real, here: NDArray[np.bool_]) -> Real:
    """Standard error of the mean over records from their scatter; NaN for fewer than two."""
    n = here.sum(axis=0)
    mean = np.where(here, values, 0.0).sum(axis=0) / n
    squares = np.where(here, (values - mean) ** 2, 0.0).sum(axis=0)
    return np.asarray(np.where(n >= LEAST_REPEATS, np.sqrt(squares / np.maximum(n - 1, 1) / n), np.nan), float)
