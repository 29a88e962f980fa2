"""Types of a described value: each takes a number in SI or a string with a unit, and knows its unit and range."""

from typing import Annotated, Any

from pydantic import BeforeValidator, Field

from graindamp.units import STANDARD_GRAVITY, to_si


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
