"""What a field knows of its softened contacts: the study of its campaign, and what a reader must be told."""

import json
import math
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from graindamp.errors import InputError
from graindamp.field.schema import is_asked_for, places_of

Real = NDArray[np.float64]

CROOKED = 3.0
"""Distance of a value from the straight line, in its standard errors, above which the line tells nothing, if the
distance is also above :data:`SIZEABLE`."""
SIZEABLE = 0.05
"""Share of the loss factor above which the distance of a value from the line counts [-]."""
PACKED = 4.0
"""Intensity up to which a bed may stay packed, and have a resonance that softening moves [-]."""
NEAR = 2.0
"""Factor of frequency and of intensity within which a point of a study counts as in the corner of a map [-]."""


class Extrapolation(NamedTuple):
    """A value over softening, and what the line through it says; same unit as the value."""

    value: Real
    """At each softening; (factor,)."""
    standard_error: Real
    """Of each; (factor,)."""
    described: float
    """At softening 1, by the line."""
    described_se: float
    """Its standard error, widened where the points scatter more about the line than their errors."""
    chosen: float
    """At the chosen softening, by the line."""
    error: float
    """Of the chosen softening, chosen - described."""
    error_se: float
    """Its standard error, widened likewise."""
    scatter: float
    """Root mean square of residual over standard error, 1 where the line fits; NaN with two softenings."""


class StudiedPoint(NamedTuple):
    """One operating point of a study."""

    frequency: float
    """[Hz]"""
    intensity: float
    """Gamma [-]."""
    loss_factor: Extrapolation
    effective_mass_ratio: Extrapolation


class SofteningStudy(NamedTuple):
    """What the chosen softening does to a field."""

    chosen: float
    """Softening of the field [-]."""
    factors: Real
    """Softenings compared [-]; (factor,)."""
    power: float
    """Power of the softening that values are linear in [-]."""
    points: tuple[StudiedPoint, ...]
    floor: float
    """Size of eta below which errors are held to that of this value [-]."""

    @property
    def relative_errors(self) -> Real:
        """Larger of the errors of eta and m' over the loss factor, at each point [-]; (point,).

        The loss factor is the larger of that by the line and that at the least softening, and at least the floor. Where
        no straight line fits, what the line says is worth nothing, and the largest difference between two softenings
        stands for it if that is larger.
        """

        def size_of(one: Extrapolation, fits: bool | None) -> float:
            spread = float(np.nanmax(one.value) - np.nanmin(one.value)) if fits is False else 0.0
            return max(abs(one.error), spread)

        return np.array([
            max(size_of(one.loss_factor, fits), size_of(one.effective_mass_ratio, fits)) / self._size(one)
            for one, fits in zip(self.points, self.are_straight, strict=True)
        ])  # fmt: skip

    def _size(self, one: StudiedPoint) -> float:
        """Loss factor that errors at a point are held to [-]."""
        known = one.loss_factor.value[np.isfinite(one.loss_factor.value)]
        return max(abs(one.loss_factor.described), abs(float(known[0])), self.floor)

    @property
    def are_straight(self) -> tuple[bool | None, ...]:
        """Whether a line in softening to the power fits what was found at each point; None where that cannot be told:
        two softenings, or a field that is not softened."""
        found = []
        for one in self.points:
            both = [self._fits(part, self._size(one)) for part in (one.loss_factor, one.effective_mass_ratio)]
            found.append(False if False in both else None if None in both else True)
        return tuple(found)

    def _fits(self, part: Extrapolation, size: float) -> bool | None:
        """Whether the line misses no value by more than its error allows and by more than a share of `size`."""
        if not (math.isfinite(part.scatter) and self.chosen > 1.0):
            return None
        known = np.isfinite(part.value)
        slope = part.error / (self.chosen**self.power - 1.0)
        residual = np.abs(part.value - part.described - slope * (self.factors**self.power - 1.0))[known]
        sigma = sigma_of(part.value, part.standard_error)[known]
        return not bool(np.any((residual > CROOKED * sigma) & (residual > SIZEABLE * size)))

    def dump(self) -> str:
        """The study as JSON, for the attributes of a field."""
        return json.dumps(
            {
                "chosen": self.chosen,
                "factors": self.factors.tolist(),
                "power": self.power,
                "floor": self.floor,
                "points": [
                    {
                        "frequency": one.frequency,
                        "intensity": one.intensity,
                        "loss_factor": _plain(one.loss_factor),
                        "effective_mass_ratio": _plain(one.effective_mass_ratio),
                    }
                    for one in self.points
                ],
            },
            sort_keys=True,
        )

    @classmethod
    def load(cls, text: str) -> "SofteningStudy":
        """The study that :meth:`dump` wrote.

        Raises:
            ValueError: the text is no such study.
        """

        def fit(values: dict[str, Any], factors: Real) -> Extrapolation:
            read: dict[str, Any] = {name: np.array(value, float)[()] for name, value in values.items()}
            found = Extrapolation(**read)
            if found.value.shape != factors.shape or found.standard_error.shape != factors.shape:
                raise ValueError("as many values as softenings are needed")
            if np.isfinite(found.value).sum() < 2 or not math.isfinite(found.described + found.error):
                raise ValueError("values at two softenings and a line through them are needed")
            return found

        try:
            told = json.loads(text)
            factors = np.array(told["factors"], float)
            points = tuple(
                StudiedPoint(
                    float(one["frequency"]),
                    float(one["intensity"]),
                    fit(one["loss_factor"], factors),
                    fit(one["effective_mass_ratio"], factors),
                )
                for one in told["points"]
            )
            study = cls(float(told["chosen"]), factors, float(told["power"]), points, float(told["floor"]))
        except (AttributeError, KeyError, TypeError) as error:
            raise ValueError(f"not a study ({error})") from None
        if not points:
            raise ValueError("a point at least is needed")
        return study


def sigma_of(value: Real, standard_error: Real) -> Real:
    """Errors that a line is fitted with: those given, but none so small that the line has no freedom at all.

    An error of 0 occurs where every cycle repeats the last.
    """
    least = 1e-3 * max(float(np.nanmax(np.abs(value))), 1e-9)
    return np.maximum(np.where(np.isfinite(standard_error), standard_error, 0.0), least)


def softening_of(field: xr.Dataset, where: str = "field") -> float:
    """Softening of the contacts that a field was simulated with [-]; 1 for one that was measured or typed in.

    Args:
        field: an effective field.
        where: opens the message.

    Raises:
        InputError: the field tells something else than a number from 1 on.
    """
    told = field.attrs.get("softening", 1.0)
    try:
        softening = float(told)
    except (TypeError, ValueError):
        softening = math.nan
    if not 1.0 <= softening < math.inf:
        raise InputError(f"{where}: softening is {told!r}, a number from 1 on is needed; correct it or take it out")
    return softening


def study_of(field: xr.Dataset, where: str = "field") -> SofteningStudy | None:
    """The study of its softening that a field keeps, if there is one.

    Args:
        field: an effective field.
        where: opens the message.

    Raises:
        InputError: what it keeps under that name is no study.
    """
    text = field.attrs.get("softening_study")
    try:
        return None if text is None else SofteningStudy.load(text)
    except (TypeError, ValueError) as error:
        raise InputError(f"{where}: softening_study is not what a campaign wrote ({error}); take it out") from None


def softening_remarks(field: xr.Dataset) -> tuple[str, ...]:
    """What a reader must be told of the softening of a field's contacts, a sentence each; none if they are stiff."""
    softening, study = softening_of(field), study_of(field)
    if softening <= 1.0:
        return ()
    told = f"contacts softened by {softening:g}"
    if study is None:
        if is_asked_for(field, "softening_study"):
            return (
                f"{told}, and the error of that is not known: its study has no point with values at two softenings",
            )
        return (
            f"{told}, and the error of that is not known: add [softening_study] to the project of the field, with a "
            "point for each kind of motion",
        )
    errors = study.relative_errors
    k = int(np.argmax(errors))
    worst = study.points[k]
    lines = [
        f"{told}: loss factor or effective mass wrong by up to {100 * errors[k]:.0f} % of the loss factor "
        f"(at {worst.frequency:g} Hz, {worst.intensity:g} g, of {len(study.points)} points studied)"
    ]
    crooked = [one for one, fits in zip(study.points, study.are_straight, strict=True) if fits is False]
    if crooked:
        at = "; ".join(f"{one.frequency:g} Hz, {one.intensity:g} g" for one in crooked)
        lines.append(
            f"{told}: the bed moves in other ways when softened (a bounce that is lost, a resonance) at {at}; no line "
            "over softening fits, the largest difference counts as error. Run such points with softening = 1"
        )
    f, gamma = (axis.ravel() for axis in places_of(field))
    corner = float(f.max()), float(gamma.min())
    near = any(one.frequency >= corner[0] / NEAR and one.intensity <= corner[1] * NEAR for one in study.points)
    if corner[1] <= PACKED and not near:
        # Sound in a bed of Hertz contacts under a given pressure goes with s^(-1/3), in one of linear springs s^(-1/2).
        times = softening ** (0.5 if study.power == 0.5 else 1.0 / 3.0)
        lines.append(
            f"{told} lowers the resonance of a packed bed by {times:.2g} times, and no point of the "
            f"study would show it: add one near {corner[0]:g} Hz, {corner[1]:g} g"
        )
    return tuple(lines)


def _plain(fit: Extrapolation) -> dict[str, Any]:
    """Fields of a fit as JSON knows them; None for what is no number."""

    def number(value: float) -> float | None:
        return value if math.isfinite(value) else None

    arrays = {name: [number(v) for v in getattr(fit, name).tolist()] for name in ("value", "standard_error")}
    others = {name: number(getattr(fit, name)) for name in Extrapolation._fields if name not in arrays}
    return arrays | others
