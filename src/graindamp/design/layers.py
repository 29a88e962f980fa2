"""Beds of several layers on the floor of a cavity: how many, when the top one slides, and on what damping collapses.

"Witt (2011)" is Particle impact damping in the horizontal plane, Texas A&M University.
"""

from math import isfinite, pi, radians, sqrt, tan
from typing import Literal, NamedTuple

from graindamp.errors import InputError
from graindamp.units import STANDARD_GRAVITY

Stacking = Literal["planar", "close-packed"]
SPACING: dict[Stacking, float] = {"planar": sqrt(3.0) / 2.0, "close-packed": sqrt(2.0 / 3.0)}
"""Height from layer to layer over the diameter [-]: rows of circles in a plane, and spheres in closest packing."""


class LayerRule(NamedTuple):
    """Layers of equal spheres in a bed."""

    layers: float
    """Number of layers that the height of the bed amounts to [-], not rounded."""
    rounded: int
    """The same, to the nearest whole number."""
    spacing: float
    """Height from layer to layer [m]."""
    stacking: Stacking
    """Arrangement assumed."""


class BetaRule(NamedTuple):
    """Dimensionless acceleration of a bed of several layers."""

    beta: float
    """beta = D h_e U omega^2 / (g h_p^2) [-]."""
    intensity: float
    """Gamma = U omega^2 / g [-]."""
    diameter_ratio: float
    """delta, particle diameter over height of the bed [-]."""
    fill_ratio: float
    """H, height of the bed over height of the cavity [-]."""
    sliding: bool
    """True where Gamma exceeds that at which the top layer begins to move, :func:`critical_intensity`."""


def layers(bed_height: float, diameter: float, stacking: Stacking = "planar") -> LayerRule:
    """Number of layers of equal spheres in a bed [-]: n = (h_p - D) / (spacing D) + 1.

    Two readings: the source prints a spacing of cos(30 deg) = 0.866, that of rows in a plane ("planar"), and calls the
    arrangement hexagonal close packed, whose layers are sqrt(2/3) = 0.816 apart ("close-packed"). They differ by up to
    6 %: its deepest bed has 15 layers by the one, 16 by the other. Limits: poured beds are looser than either (solid
    fraction 0.52 to 0.64 against 0.74 of the closest packing), so both are names for a height, not counts.

    Args:
        bed_height: height h_p of the bed in the direction of gravity [m], >= diameter.
        diameter: particle diameter D [m], > 0.
        stacking: "planar" or "close-packed".

    Raises:
        InputError: an argument outside its range.

    Source: Witt (2011), Eq. 4.1.
    """
    _check("diameter", diameter, "m", diameter > 0, "> 0")
    _check("bed_height", bed_height, "m", bed_height >= diameter, f">= {diameter:g} m, one particle")
    if stacking not in SPACING:
        raise InputError(f"stacking is '{stacking}', but must be one of: {', '.join(SPACING)}")
    spacing = SPACING[stacking] * diameter
    number = (bed_height - diameter) / spacing + 1.0
    return LayerRule(number, round(number), spacing, stacking)


def critical_intensity(angle: float = 60.0) -> float:
    """Intensity Gamma at which a particle begins to roll over its neighbour in the layer below [-]: 1 / tan(angle).

    0.577 for the 60 deg of rows in a plane, whatever the diameter. Limits: balance of a frictionless particle
    between two neighbours, in the plane of gravity and motion; measured damping begins gradually.

    Args:
        angle: angle of the line between the centres against the horizontal [deg], above 0 and below 90.

    Raises:
        InputError: angle outside its range.

    Source: Witt (2011), Eq. 4.3.
    """
    _check("angle", angle, "deg", 0 < angle < 90, "above 0 and below 90")
    return 1.0 / tan(radians(angle))


def beta(amplitude: float, frequency: float, diameter: float, bed_height: float, cavity_height: float) -> BetaRule:
    """Dimensionless acceleration on which damping by beds of several layers collapses [-]: beta = (delta / H) Gamma.

    Limits: found for lead spheres of 1.27 mm at 20 Hz, beds of 4 to 15 layers, fill ratios of 0.12 to 0.48, Gamma up to
    8; the cavity's height was never varied. The data do not tell h_p^2 from other powers beyond their scatter.

    Args:
        amplitude: displacement amplitude U of the cavity [m], >= 0.
        frequency: frequency [Hz], > 0.
        diameter: particle diameter D [m], > 0.
        bed_height: height h_p of the bed in the direction of gravity [m], >= diameter and <= cavity_height.
        cavity_height: height h_e of the cavity in the direction of gravity [m], > 0.

    Raises:
        InputError: an argument outside its range.

    Source: Witt (2011), Eq. 4.4; its nomenclature omits the diameter.
    """
    _check("amplitude", amplitude, "m", amplitude >= 0, ">= 0")
    _check("frequency", frequency, "Hz", frequency > 0, "> 0")
    _check("diameter", diameter, "m", diameter > 0, "> 0")
    _check("cavity_height", cavity_height, "m", cavity_height > 0, "> 0")
    inside = diameter <= bed_height <= cavity_height
    allowed = f"from {diameter:g} m, the diameter, to {cavity_height:g} m, the cavity's height"
    _check("bed_height", bed_height, "m", inside, allowed)
    intensity = amplitude * (2.0 * pi * frequency) ** 2 / STANDARD_GRAVITY
    diameter_ratio, fill_ratio = diameter / bed_height, bed_height / cavity_height
    return BetaRule(
        diameter_ratio / fill_ratio * intensity, intensity, diameter_ratio, fill_ratio, intensity > critical_intensity()
    )


def _check(name: str, value: float, unit: str, allowed: bool, text: str) -> None:
    if not (isfinite(value) and allowed):
        raise InputError(f"{name} is {value} {unit}, but must be a finite number {text}")
