"""How robust a damper is: where over frequency and intensity its field stays good, and how fast it falls off."""

import math
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from graindamp.errors import InputError
from graindamp.field.interpolate import Interpolant
from graindamp.field.schema import damper_of, places_of
from graindamp.units import STANDARD_GRAVITY

Real = NDArray[np.float64]

N_PLACE = 101
"""Values of ln f and of ln Gamma that the range is sampled at [-]: a smooth border then lies right to 0.5 % of
the range."""

N_DRAW = 100
"""Fields drawn for the errors [-]; they are then known to 7 %, 1 / sqrt(2 N_DRAW)."""

SEED = 20230116
"""Seed of those draws: the same field gives the same errors."""

BELOW = 2.0
"""Steepness is looked for from X_opt down to X_opt over this [-]: the octave in which the bounce is lost."""

FLOOR = 0.02
"""Loss factor below which a field counts as this [-]: the logarithm of what is as good as nothing says nothing."""


class Measured(NamedTuple):
    """A number and its standard error."""

    value: float
    error: float
    """NaN where the field's own errors are unknown."""


class Robustness(NamedTuple):
    """What one field is worth over a range of frequency and intensity."""

    share: Measured
    """Share of the range, by area over ln f and ln Gamma, with eta of at least the level [-]."""
    worst: Measured
    """Least eta in the range [-]."""
    steepest: Measured
    """Largest |d ln eta / d ln X| at fixed frequency in the octave of stroke below X_opt [-]; NaN without a clearance
    and where the range does not meet that octave."""
    steepness: Measured
    """Mean of the same over ln f and ln X there [-]."""
    level: float
    """Loss factor that counts as good [-]."""
    covered: float
    """Share of the range that the field knows about [-]; the rest is left out of everything above."""
    frequency_range: tuple[float, float]
    """[Hz]"""
    intensity_range: tuple[float, float]
    """[-]"""


def robustness(
    field: xr.Dataset,
    level: float,
    frequency_range: tuple[float, float] | None = None,
    intensity_range: tuple[float, float] | None = None,
    *,
    clearance: float | None = None,
    seed: int = SEED,
) -> Robustness:
    """Robustness of a field.

    Errors come from fields drawn at random, each point's eta by its own standard error, independently of the others.
    The least of noisy values is low: `worst` is that of the field as it is, and its error the scatter of the draws.

    Args:
        field: an effective field.
        level: loss factor that counts as good [-], > 0.
        frequency_range: lowest and highest frequency [Hz]; None: those of the field.
        intensity_range: lowest and highest intensity [-]; None: those of the field.
        clearance: free travel h [m], for X_opt = h / pi; None: that in the description of the damper, if it is there.
        seed: of the draws.

    Raises:
        InputError: not a field, a level not above 0, a range that is empty or reaches beyond the field.
    """
    if not level > 0.0:
        raise InputError(f"level is {level:g}, a loss factor above 0 is needed")
    at = Interpolant(field, "constant")
    f_range = _within("frequency_range", frequency_range, at.frequency_range, "Hz")
    g_range = _within("intensity_range", intensity_range, at.intensity_range, "-")
    told = damper_of(field).get("clearance") if clearance is None else clearance
    optimum = float(told) / math.pi if isinstance(told, (int, float)) and told > 0 else math.nan
    place = _Places(f_range, g_range, optimum)
    known = ~at(place.frequency[:, None], place.intensity[None, :]).extrapolated
    if not known.any():
        raise InputError("the field has no usable point in the range asked for; ask for another range")
    values = place.measures(at, known, level)
    errors = _scatter(field, place, known, level, seed)
    share, worst, steepest, steepness = (Measured(*pair) for pair in zip(values, errors, strict=True))
    covered = float(np.sum(place.weight * known))
    return Robustness(share, worst, steepest, steepness, level, covered, f_range, g_range)


def _within(name: str, asked: tuple[float, float] | None, known: tuple[float, float], unit: str) -> tuple[float, float]:
    low, high = known if asked is None else asked
    if not low < high:
        raise InputError(f"{name} is {low:g} to {high:g} {unit}, but must ascend")
    if low < known[0] * (1 - 1e-9) or high > known[1] * (1 + 1e-9):
        raise InputError(
            f"{name} is {low:g} to {high:g} {unit}, the field holds {known[0]:g} to {known[1]:g} {unit}; ask for less"
        )
    return max(low, known[0]), min(high, known[1])


class _Places:
    """Where a field is sampled, and with what weight."""

    def __init__(self, f_range: tuple[float, float], g_range: tuple[float, float], optimum: float) -> None:
        self.frequency, self.intensity = np.geomspace(*f_range, N_PLACE), np.geomspace(*g_range, N_PLACE)
        side = np.ones(N_PLACE)
        side[[0, -1]] = 0.5
        side /= side.sum()
        self.weight = side[:, None] * side[None, :]
        middle = np.sqrt(self.intensity[1:] * self.intensity[:-1])
        stroke = middle[None, :] * STANDARD_GRAVITY / (2.0 * np.pi * self.frequency[:, None]) ** 2
        with np.errstate(invalid="ignore"):
            self.below = (stroke <= optimum) & (stroke >= optimum / BELOW)
        self.step = math.log(g_range[1] / g_range[0]) / (N_PLACE - 1)

    def measures(self, at: Interpolant, known: NDArray[np.bool_], level: float) -> tuple[float, float, float, float]:
        """Share, worst, steepest and mean steepness of one field."""
        eta = at(self.frequency[:, None], self.intensity[None, :]).loss_factor
        share = float(np.sum(self.weight * known * (eta >= level)) / np.sum(self.weight * known))
        worst = float(eta[known].min())
        seen = self.below & known[:, 1:] & known[:, :-1]
        if not seen.any():
            return share, worst, math.nan, math.nan
        slope = np.abs(np.diff(np.log(np.maximum(eta, FLOOR)), axis=1)[seen]) / self.step
        return share, worst, float(slope.max()), float(slope.mean())


def _scatter(field: xr.Dataset, place: _Places, known: NDArray[np.bool_], level: float, seed: int) -> list[float]:
    """Standard deviation of the four measures over drawn fields; NaN where no point's error is known."""
    error = field["loss_factor_se"].to_numpy()
    usable = np.isfinite(field["loss_factor"].to_numpy())
    if not np.any(np.isfinite(error) & usable):
        return [math.nan] * 4
    error = np.where(np.isfinite(error), error, 0.0)
    draws = np.random.default_rng(seed)
    found = []
    for _ in range(N_DRAW):
        drawn = _with_loss_factor(field, field["loss_factor"].to_numpy() + error * draws.standard_normal(error.shape))
        found.append(place.measures(Interpolant(drawn, "constant"), known, level))
    return [float(value) for value in np.std(np.array(found), axis=0, ddof=1)]


def _with_loss_factor(field: xr.Dataset, eta: Real) -> xr.Dataset:
    """The field with other loss factors, and the energies that follow from them."""
    f, gamma = places_of(field)
    speed = gamma * STANDARD_GRAVITY / (2.0 * np.pi * f)
    energy = np.pi * eta * float(field.attrs["bed_mass"]) * speed**2
    changed: dict[str, Any] = {
        name: field[name].copy(data=value)
        for name, value in (("loss_factor", eta), ("dissipated_energy", energy), ("power", energy * f))
    }
    return field.assign(changed)
