"""What a channel measures, told by its name and unit as people and front ends write them."""

import re
from functools import lru_cache
from typing import Literal

from graindamp.signals.record import MOTION_UNIT
from graindamp.units import to_si

Kind = Literal["force", "velocity", "acceleration", "displacement", "time"]

SI_UNIT: dict[Kind, str] = {
    "force": "N",
    "velocity": MOTION_UNIT["velocity"],
    "acceleration": MOTION_UNIT["acceleration"],
    "displacement": MOTION_UNIT["displacement"],
    "time": "s",
}

WORDS: dict[Kind, tuple[str, ...]] = {
    "force": ("force", "kraft", "load", "loadcell", "fx", "fy", "fz"),
    "velocity": ("velocity", "geschwindigkeit", "schnelle", "speed", "velo", "vel", "vx", "vy", "vz"),
    "acceleration": ("acceleration", "beschleunigung", "accelerometer", "accel", "acc", "ax", "ay", "az"),
    "displacement": ("displacement", "verschiebung", "auslenkung", "position", "disp", "pos", "weg"),
    "time": ("time", "zeit", "timestamp", "zeitstempel"),
}
"""Words of a channel's name. From five letters on they count inside longer words too: Kraftsignal."""

LETTERS: dict[str, Kind] = {"f": "force", "v": "velocity", "a": "acceleration", "x": "displacement", "t": "time"}
"""Symbols that are a whole name, or begin one before an axis, a number or an underscore: F, a_x, v1, F_sensor."""

_SPELLING = {
    "newton": "N",
    "n": "N",
    "kn": "kN",
    "kp": "kgf",
    "lb": "lbf",
    "lbs": "lbf",
    "pound": "lbf",
    "ips": "in/s",
    "mps": "m/s",
    "mil": "thou",
    "hz": "Hz",
    "khz": "kHz",
    "sek": "s",
    "s/s": "Hz",
    "ks/s": "kHz",
    "rpm": "1/min",
    "u/min": "1/min",
}
_CAPITALS = {"M", "MM", "CM", "UM", "IN", "S", "MS", "SEC", "G"}
"""Units in capitals that old front ends write for small letters: MM/S, G. Others stay what they are: A, H, T."""
_SIGNS = str.maketrans({"·": "*", "⁻": "-", "¹": "1", "²": "2"})
_TERM = r"[A-Za-zµμ_]+(?:\^-?[1-4])?"
_PRODUCT = re.compile(rf"(?:1|{_TERM})(?:[ */]\(?{_TERM}\)?)*")


@lru_cache(maxsize=256)
def unit_factor(unit: str, si: str) -> float | None:
    """SI units in one `unit`: 0.001 for ("mm/s", "m/s"); None where `unit` is unknown or measures something else.

    Args:
        unit: as written in a file: "mm/s", "[m/s²]", "m s-2", "µm", "kN"; a lone g is gravity in an acceleration.
        si: SI unit to give.
    """
    text = unit.strip().strip("[]").strip()
    text = text[1:-1] if re.fullmatch(r"\([^()]*\)", text) else text
    text = text.replace("**", "^").replace(" / ", "/").translate(_SIGNS)
    text = re.sub(r"(?<=[A-Za-z])(-?[1-4])(?![\d.])", r"^\1", text)  # m/s2, m s-2
    factor = _factor(text, si)
    if factor is None and set(re.findall("[A-Za-z]+", text)) <= _CAPITALS:
        factor = _factor(text.lower(), si)
    return factor


def _factor(text: str, si: str) -> float | None:
    spelled = text if si == "kg" else _SPELLING.get(text.lower(), text)
    if spelled == si:
        return 1.0
    if len(spelled) > 30 or not _PRODUCT.fullmatch(spelled):  # only products of units reach the parser
        return None
    if si == "Hz" and "rad" in spelled:  # an angular frequency is not a frequency, though dimensions agree
        return None
    try:
        return to_si(spelled if spelled.startswith("1") else f"1 {spelled}", si)
    except ValueError:
        return None


def kind_of_unit(unit: str | None) -> Kind | None:
    """What a channel in `unit` measures; None without a unit or for one of another kind."""
    if unit is None:
        return None
    return next((kind for kind, si in SI_UNIT.items() if unit_factor(unit, si) is not None), None)


def kind_of_name(name: str) -> tuple[Kind | None, bool]:
    """What a channel so named measures, and whether a word says so and not only a letter."""
    plain = name.strip().replace("(t)", "").strip()
    tokens = {token.lower() for token in re.findall(r"[A-ZÄÖÜ]?[a-zäöüß]+|[A-ZÄÖÜ]+(?![a-z])", plain)}
    tokens |= {token.lower() for token in re.findall(r"[^\W\d_]+", plain)}
    kinds: list[Kind] = [
        kind
        for kind, words in WORDS.items()
        if any(word in tokens or (len(word) >= 5 and any(word in token for token in tokens)) for word in words)
    ]
    if kinds:
        return (kinds[0], True) if len(kinds) == 1 else (None, False)
    letter = re.fullmatch(r"([FfAaVvXxt])(?:[XYZxyz]?[ _]?\d*|_.*)", plain)  # T is a temperature
    return (LETTERS[letter[1].lower()], False) if letter else (None, False)


def split_unit(name: str) -> tuple[str, str | None]:
    """Name without its unit, and the unit: "Force [N]", "Force (N)", "Force / N", "Force in N"."""
    square = re.fullmatch(r"(.*?)\s*\[([^\[\]]*)\]([^\[\]]*)", name.strip())
    if square:
        return (square[1] + square[3]).strip(), told_unit(square[2])
    for pattern in (r"(.*\S)\s*\(([^()]*)\)([^()]*)", r"([^/]*[^/\s])\s*/\s*(.+)()", r"(.*\S)\s+in\s+(\S+)()"):
        match = re.fullmatch(pattern, name.strip())
        if match and match[2] != "t" and is_unit(match[2]):  # F(t) is a function of time, not in tonnes
            return (match[1] + match[3]).strip(), match[2].strip()
    return name.strip(), None


def split_suffix(name: str) -> tuple[str, str] | None:
    """Name and unit of the style container_mass_kg, velocity_mm_s, Velocity mm/s; None where nothing looks like it."""
    match = re.fullmatch(r"(.+?)[_ ]([A-Za-zµμ]+(?:[_/]s(?:\^?2|²)?)?)", name.strip())
    return (match[1], match[2].replace("_", "/")) if match else None


def told_unit(text: str | None) -> str | None:
    """Unit as written, None where the place for it is left open: "", "-", "1"."""
    stripped = (text or "").strip("[]() ")
    return None if stripped in ("", "-", "1") else stripped


def is_unit(text: str) -> bool:
    """Whether `text` is a unit that a channel of a rig may have, or a fact about it."""
    return any(unit_factor(text, si) is not None for si in (*SI_UNIT.values(), "Hz", "kg", "V", "C", "Pa"))
