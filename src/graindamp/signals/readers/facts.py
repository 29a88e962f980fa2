"""What a file tells beside its signals: sampling rate, frequency, intensity and masses, however it names them."""

import math
import re
from collections.abc import Mapping
from typing import Any

import numpy as np

from graindamp.errors import InputError
from graindamp.signals.readers.kinds import split_suffix, split_unit, unit_factor
from graindamp.units import STANDARD_GRAVITY

Facts = dict[str, float]
"""Values in SI by their name in :class:`~graindamp.signals.record.Record`."""

UNIT = {
    "sampling_rate": "Hz",
    "sampling_interval": "s",
    "frequency": "Hz",
    "nominal_intensity": "",
    "container_mass": "kg",
    "bed_mass": "kg",
}

_ALIASES = {
    "sampling_rate": "samplingrate samplerate samplingfrequency samplefrequency fs fsample abtastrate abtastfrequenz "
    "scanrate samplespersecond",
    "sampling_interval": "dt deltat samplinginterval sampleinterval samplingperiod sampleperiod sampletime timestep "
    "abtastintervall abtastzeit tinterval",
    "frequency": "frequency freq frequenz f f0 drivefrequency drivingfrequency excitationfrequency testfrequency "
    "shakerfrequency sinefrequency anregungsfrequenz erregerfrequenz fdrive",
    "nominal_intensity": "nominalintensity intensity excitationintensity gamma intensitaet anregungsintensitaet",
    "container_mass": "containermass masscontainer mcontainer emptycontainermass emptymass massofcontainer "
    "behaeltermasse massebehaelter leermasse",
    "bed_mass": "bedmass massbed mbed fillmass fillingmass totalparticlemass massofallparticles fuellmasse "
    "schuettmasse schuettungsmasse gesamtpartikelmasse",
}
_FACT_OF = {alias: fact for fact, aliases in _ALIASES.items() for alias in aliases.split()}
_NUMBER = re.compile(r"([+-]?(?:\d[\d.,]*|[.,]\d+)(?:[eE][+-]?\d+)?)\s*(.*)", re.DOTALL)


def fact_named(name: str) -> tuple[str, str | None] | None:
    """Which fact `name` means and the unit written in it: ("frequency", "Hz") for "Drive frequency [Hz]"."""
    bare, unit = split_unit(name)
    fact = _FACT_OF.get(_squash(bare))
    if fact:
        return fact, unit
    suffixed = split_suffix(bare)
    fact = _FACT_OF.get(_squash(suffixed[0])) if suffixed else None
    if fact and suffixed and _factor(suffixed[1], fact) is not None:
        return fact, suffixed[1]
    return None


def read_fact(name: str, value: Any, place: str, unit: str | None = None, decimal: str = ".") -> Facts:
    """The fact that `name` and `value` tell, in SI; empty where `name` means none or no value is filled in.

    Args:
        name: key as the file writes it.
        value: a number, an array of one number, or text with or without a unit and a decimal comma.
        place: file and place, to open messages.
        unit: unit written beside the value, in place of one in the name.
        decimal: decimal mark of the file; the other mark before three digits ("51,200") is refused as doubtful.

    Raises:
        InputError: a known key with a value that is no number, in a unit of another kind, or out of range.
    """
    named = fact_named(name)
    if named is None:
        return {}
    fact, unit_in_name = named
    if isinstance(value, (np.ndarray, np.generic)) and value.size == 1:
        value = value.item()
    given = f"{place}: '{name}' is {value!r}"
    number, unit_in_value = _number(value, given, fact, decimal)
    if math.isnan(number):
        return {}
    unit = unit_in_value or unit or unit_in_name
    factor = 1.0 if unit is None else _factor(unit, fact)
    if factor is None:
        raise InputError(
            f"{given} in '{unit}', which is no unit of {fact.replace('_', ' ')}; write it in [{UNIT[fact] or 'g'}]"
        )
    si = number * factor
    may_be_zero = fact in ("container_mass", "bed_mass", "nominal_intensity")
    if not math.isfinite(si) or si < 0 or (si == 0 and not may_be_zero):
        raise InputError(f"{given}; it must be finite and {'>= 0' if may_be_zero else '> 0'}; correct or remove it")
    return {"sampling_rate": 1 / si} if fact == "sampling_interval" else {fact: si}


def read_facts(values: Mapping[str, Any], place: str) -> Facts:
    """All facts among named values; what is not one of them is passed over."""
    facts: Facts = {}
    for name, value in values.items():
        facts |= read_fact(str(name), value, place)
    return facts


def parse_number(text: str) -> float:
    """Number with a decimal point or comma, and the other one between thousands.

    Raises:
        ValueError: no such number.
    """
    comma, point = text.rfind(","), text.rfind(".")
    if comma >= 0 and point >= 0:
        text = text.replace("." if comma > point else ",", "")
    return float(text.replace(",", "."))


def _number(value: Any, given: str, fact: str, decimal: str) -> tuple[float, str | None]:
    """Number of a fact and the unit written after it; NaN for a value left open."""
    if isinstance(value, str):
        text = value.strip().strip('"')
        if text.lower() in ("", "-", "n/a", "na", "nan", "none", "unknown", "unbekannt"):
            return math.nan, None
        match = _NUMBER.fullmatch(text)
        if match and re.fullmatch(r"[+-]?[1-9]\d{0,2}[.,]\d{3}", match[1]) and decimal not in match[1]:
            both = " or ".join(match[1].replace("," if decimal == "." else ".", mark) for mark in ("", decimal))
            raise InputError(f"{given}; is it {both}? Write it without a mark between thousands")
        try:
            if match:
                return parse_number(match[1]), match[2].strip("[] ") or None
        except ValueError:
            pass
    elif isinstance(value, (int, float)) and not isinstance(value, bool):
        return float(value), None
    raise InputError(f"{given}, which is no number; write one in [{UNIT[fact] or '-'}], or remove it")


def _factor(unit: str, fact: str) -> float | None:
    if fact != "nominal_intensity":
        return unit_factor(unit, UNIT[fact])
    acceleration = unit_factor(unit, "m/s^2")
    return None if acceleration is None else acceleration / STANDARD_GRAVITY


def _squash(name: str) -> str:
    folded = name.lower().replace("ä", "ae").replace("ö", "oe").replace("ü", "ue")
    return re.sub(r"[^a-z0-9]", "", folded)
