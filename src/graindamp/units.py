"""Units at the edge: what a person types becomes an SI number here, and nowhere else.

Inside graindamp every number is SI. pint is imported only when a string with a unit has to be read.
"""

import math
import re
from functools import lru_cache
from typing import Any

STANDARD_GRAVITY = 9.80665
"""Standard acceleration of free fall g_n [m/s^2] (ISO 80000-3), the unit of excitation intensity."""

_EXAMPLE = {
    "m": "1.25 mm",
    "kg": "350 g",
    "s": "20 ms",
    "Hz": "100 Hz",
    "N": "26 N",
    "m/s": "50 mm/s",
    "m/s^2": "40 g",
    "Pa": "0.72 MPa",
    "kg/m^3": "7850 kg/m^3",
    "kg/m": "2.89 kg/m",
    "N/m": "2.2 N/mm",
    "N m/rad": "12 N m/rad",
    "N m^2": "9930 N m^2",
    "kg m^2": "12 kg cm^2",
    "kg^-0.5": "0.6 kg^-0.5",
    "rad": "1 deg",
    "1/s": "3 1/s",
    "": "2 %",
}


@lru_cache(maxsize=1)
def _registry() -> Any:
    import pint

    return pint.UnitRegistry(autoconvert_offset_to_baseunit=True)


def _spelled_for_pint(text: str, unit: str) -> str:
    """`text` with the readings of this field: a lone g is gravity in an acceleration; a frequency counts cycles."""
    text = text.replace("·", " ").replace("²", "^2").replace("³", "^3")
    if unit == "m/s^2":
        text = re.sub(r"(?<![A-Za-z/])g(_n|n)?(?![A-Za-z])", "standard_gravity", text)
    if unit == "Hz":  # pint drops the radian and would read 60 rpm as 6.28 Hz
        text = re.sub(r"(?<![A-Za-z])rpm(?![A-Za-z])", "1/minute", text)
        text = re.sub(r"(?<![A-Za-z])rad\s*/\s*s(?![A-Za-z])", f"1/s/{2 * math.pi!r}", text)
    return text


def to_si(value: float | int | str, unit: str) -> float:
    """Number in the SI unit `unit` of `value`, a number already in SI or a string with a unit.

    Args:
        value: 0.00125 or "1.25 mm". In an acceleration "g" is standard gravity, elsewhere the gram.
        unit: SI unit to give, such as "m", "N m^2", "" for a dimensionless number.

    Raises:
        ValueError: not a number, unknown unit, or a unit of another kind; the message names an accepted form.
    """
    example = f"a number in {f'[{unit}]' if unit else 'plain form'} or text such as '{_EXAMPLE.get(unit, f'1 {unit}')}'"
    if isinstance(value, bool) or not isinstance(value, (int, float, str)):
        raise ValueError(f"expected {example}")
    if isinstance(value, str):
        si = _parse(value, unit, example)
    else:
        si = float(value)
    if not math.isfinite(si):
        raise ValueError(f"expected a finite value, {example}")
    return si


def _parse(text: str, unit: str, example: str) -> float:
    stripped = text.strip()
    try:
        return float(stripped)
    except ValueError:
        pass
    if re.match(r"^[+-]?\d+,\d+\s*[^\d,]*$", stripped):
        raise ValueError(f"write a decimal point, not a comma; expected {example}")
    if not re.match(r"^[+-]?(\d|\.\d)", stripped):
        raise ValueError(f"expected {example}")
    import pint

    registry = _registry()
    try:
        quantity = registry.Quantity(_spelled_for_pint(stripped, unit))
        return float(quantity.to(unit or "dimensionless").magnitude)
    except pint.DimensionalityError:
        raise ValueError(
            f"this is {_kind(registry, quantity)}, not {_kind(registry, registry.Quantity(1, unit))}; "
            f"expected {example}"
        ) from None
    except Exception as error:  # pint raises many kinds for unreadable text, from its own to tokenizer errors
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise ValueError(f"unit not understood ({reason}); expected {example}") from None


def _kind(registry: Any, quantity: Any) -> str:
    dimension = str(quantity.dimensionality)
    return "a plain number" if dimension == "dimensionless" else f"a quantity of dimension {dimension}"


def intensity(acceleration: float) -> float:
    """Dimensionless excitation intensity Gamma [-] of an acceleration amplitude [m/s^2]."""
    return acceleration / STANDARD_GRAVITY
