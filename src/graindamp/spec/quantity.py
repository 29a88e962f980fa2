"""Types of a described value: each takes a number in SI or a string with a unit, and knows its unit and range."""

import math
import re
from typing import Annotated, Any

from pydantic import AfterValidator, BeforeValidator, Field

from graindamp.units import STANDARD_GRAVITY, to_si

LEAST_RESTITUTION = 0.01
"""Restitution is refused below this [-]: the Gonthier law starts an impact with (1 + d/e) times the elastic force,
more than a hundred times it, which no affordable time step resolves. Between 0.01 and 0 the rebound energy differs by
1e-4."""

WIDEST_POISSON_RATIO = 0.5
"""Poisson's ratio is refused above this [-]: a solid of a larger one would gain volume under pressure, and is
unstable."""


def _unit(unit: str) -> BeforeValidator:
    return BeforeValidator(lambda value: to_si(value, unit))


def _field(
    unit: str, gt: float | None = None, ge: float | None = None, lt: float | None = None, le: float | None = None
) -> Any:
    return Field(gt=gt, ge=ge, lt=lt, le=le, allow_inf_nan=False, json_schema_extra={"unit": unit or "-"})


def _intensity(value: float | int | str) -> float:
    """A plain number, or an acceleration in any unit."""
    if isinstance(value, str):
        try:
            return to_si(value, "")
        except ValueError:
            return to_si(value, "m/s^2") / STANDARD_GRAVITY
    return to_si(value, "")


def _spectral_density(value: float | int | str) -> float:
    """A number in (m/s^2)^2/Hz, or text such as "0.04 g^2/Hz", where g is standard gravity and not the gram."""
    if isinstance(value, str):
        value = re.sub(r"(?<![A-Za-z])g(_n|n)?(?![A-Za-z])", "standard_gravity", value)
    try:
        return to_si(value, "m^2/s^3")
    except ValueError as error:
        raise ValueError(
            f"{error}; a spectral density is a number in (m/s^2)^2/Hz or text such as '0.04 g^2/Hz'"
        ) from None


_AXES = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}


def _axis(value: Any) -> Any:
    """The vector along "x", "-z" and the like; anything else as it came."""
    if not isinstance(value, str):
        return value
    name = value.strip().lower()
    if name.lstrip("+-") not in _AXES or len(name) > 2:
        raise ValueError('expected "x", "y", "z", one of them with a minus sign, or a vector such as [0, 0, -1]')
    sign = -1.0 if name.startswith("-") else 1.0
    return tuple(sign * component for component in _AXES[name.lstrip("+-")])


def _unit_vector(value: tuple[float, float, float]) -> tuple[float, float, float]:
    length = math.hypot(*value)
    if length == 0:
        raise ValueError("a direction needs a component other than 0")
    return (value[0] / length, value[1] / length, value[2] / length)


def _gravity(value: Any) -> Any:
    """The vector of standard gravity along "-z" and the like, or of "none"; anything else as it came."""
    if not isinstance(value, str):
        return value
    if value.strip().lower() == "none":
        return (0.0, 0.0, 0.0)
    return tuple(STANDARD_GRAVITY * component for component in _axis(value))


Length = Annotated[float, _unit("m"), _field("m", gt=0)]
Position = Annotated[float, _unit("m"), _field("m", ge=0)]
Mass = Annotated[float, _unit("kg"), _field("kg", gt=0)]
MassOrZero = Annotated[float, _unit("kg"), _field("kg", ge=0)]
RotaryInertia = Annotated[float, _unit("kg m^2"), _field("kg m^2", ge=0)]
Duration = Annotated[float, _unit("s"), _field("s", gt=0)]
Frequency = Annotated[float, _unit("Hz"), _field("Hz", gt=0)]
Force = Annotated[float, _unit("N"), _field("N", gt=0)]
YoungsModulus = Annotated[float, _unit("Pa"), _field("Pa", gt=0)]
Density = Annotated[float, _unit("kg/m^3"), _field("kg/m^3", gt=0)]
MassPerLength = Annotated[float, _unit("kg/m"), _field("kg/m", gt=0)]
BendingStiffness = Annotated[float, _unit("N m^2"), _field("N m^2", gt=0)]
SpringStiffness = Annotated[float, _unit("N/m"), _field("N/m", ge=0)]
TorsionStiffness = Annotated[float, _unit("N m/rad"), _field("N m/rad", ge=0)]
Angle = Annotated[float, _unit("rad"), _field("rad", ge=0)]
Rate = Annotated[float, _unit("1/s"), _field("1/s", ge=0)]
DampingRatio = Annotated[float, _unit(""), _field("", ge=0, lt=1)]
Ratio = Annotated[float, _unit(""), _field("", ge=0)]
Fraction = Annotated[float, _unit(""), _field("", ge=0, le=1)]
Restitution = Annotated[float, _unit(""), _field("", ge=0, lt=1)]
FrictionCoefficient = Annotated[float, _unit(""), _field("", gt=0)]
Intensity = Annotated[float, BeforeValidator(_intensity), _field("", gt=0)]

Number = Annotated[float, _unit(""), _field("")]
"""A plain number [-], or text such as "58 %"; bounds are added where it is used."""
Coordinate = Annotated[float, _unit("m"), _field("m")]
Point3 = tuple[Coordinate, Coordinate, Coordinate]
Size3 = tuple[Length, Length, Length]
Direction = Annotated[tuple[float, float, float], BeforeValidator(_axis), AfterValidator(_unit_vector)]
"""A direction: "x", "-z" and the like, or a vector of any length but 0; kept as unit vector [-]."""
AccelerationComponent = Annotated[float, _unit("m/s^2"), _field("m/s^2")]
Gravity = Annotated[
    tuple[AccelerationComponent, AccelerationComponent, AccelerationComponent], BeforeValidator(_gravity)
]
"""Acceleration of free fall [m/s^2]: a vector, "-z" and the like for standard gravity, or "none"."""
Phase = Annotated[float, _unit("rad"), _field("rad")]
DurationOrZero = Annotated[float, _unit("s"), _field("s", ge=0)]
Speed = Annotated[float, _unit("m/s"), _field("m/s", gt=0)]
SpectralDensity = Annotated[float, BeforeValidator(_spectral_density), _field("(m/s^2)^2/Hz", ge=0)]
PoissonRatio = Annotated[float, _unit(""), _field("", ge=0, le=WIDEST_POISSON_RATIO)]
YieldStress = Annotated[float, _unit("Pa"), _field("Pa", gt=0)]
ContactStiffness = Annotated[float, _unit("N/m"), _field("N/m", gt=0)]
ContactRestitution = Annotated[float, _unit(""), _field("", ge=LEAST_RESTITUTION, le=1)]
FrictionOrZero = Annotated[float, _unit(""), _field("", ge=0)]
FrictionSlope = Annotated[float, _unit("s/m"), _field("s/m", gt=0)]
