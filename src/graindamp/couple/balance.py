"""The one balance behind every coupling: structure's receptance times damper force is the motion that causes it.

A damper exerts on the structure the force -M a, with M = m_container + m_bed (m' - i eta) taken from its field at the
amplitude of its own motion; time convention exp(+i omega t). How the balance is solved lives in the modules beside.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graindamp.field.interpolate import FieldValues, Interpolant
from graindamp.units import STANDARD_GRAVITY

Real = NDArray[np.float64]
Complex = NDArray[np.complex128]

NO_MOTION = 1e-9
"""Intensity below which a damper counts as at rest [-]; there its field is taken at this intensity."""


class Attached(NamedTuple):
    """A damper at a point of a structure."""

    name: str
    """Name of the damper in results."""
    point: str
    """Name of the point of the modal model it is fixed to."""
    field: Interpolant
    bed_mass: float
    """Mass of all particles [kg]; the field is in shares of it."""
    container_mass: float = 0.0
    """Mass of the container as far as the structure's model does not hold it [kg]."""


def intensity_of(displacement: ArrayLike, frequency: ArrayLike) -> Real:
    """Excitation intensity Gamma [-] of displacement amplitudes [m] at frequencies [Hz]."""
    intensity: Real = np.abs(displacement) * (2 * np.pi * np.asarray(frequency, float)) ** 2 / STANDARD_GRAVITY
    return intensity


def damper_mass(damper: Attached, frequency: ArrayLike, intensity: ArrayLike) -> tuple[Complex, FieldValues]:
    """Complex effective mass M of a damper [kg], container included, and the field values it was made of."""
    values = damper.field(frequency, np.maximum(intensity, NO_MOTION))
    ratio = np.asarray(values.effective_mass_ratio - 1j * values.loss_factor, complex)
    return np.asarray(damper.container_mass + damper.bed_mass * ratio, complex), values


def residual(
    displacement: Complex, frequency: float, receptance: Complex, free: Complex, dampers: Sequence[Attached]
) -> Complex:
    """What is missing to balance [m]: motion of each damper less the structure's answer to drive and damper forces.

    Args:
        displacement: complex displacement amplitude at each damper [m], shape (damper,).
        frequency: driving frequency [Hz].
        receptance: of the structure without beds between the dampers [m/N], shape (damper, damper).
        free: motion that the driving force alone causes at each damper [m], shape (damper,).
        dampers: any number, each with its own field and bed.
    """
    intensity = intensity_of(displacement, frequency)
    mass = np.array([complex(damper_mass(d, frequency, gamma)[0]) for d, gamma in zip(dampers, intensity, strict=True)])
    reaction = (2 * np.pi * frequency) ** 2 * mass * displacement
    return displacement - free - receptance @ reaction


def damping_ratio_of(
    shape_squared: ArrayLike, bed_mass: ArrayLike, loss_factor: ArrayLike = 1.0, effective_mass_ratio: ArrayLike = 1.0
) -> Real:
    """Damping ratio zeta [-] that a bed gives to one mode at its resonance, structural damping left out.

    With the defaults this is the efficiency bound zeta_eta1 of Meyer & Seifried (2021), Eq. 18: what a damper of loss
    factor one that carries its bed along would give.

    Args:
        shape_squared: squared mass-normalised mode shape at the damper [1/kg].
        bed_mass: mass of all particles [kg].
        loss_factor: eta [-].
        effective_mass_ratio: m' [-].
    """
    mobile = np.asarray(shape_squared, float) * np.asarray(bed_mass, float)
    ratio: Real = mobile * np.asarray(loss_factor) / (2 * (1 + mobile * np.asarray(effective_mass_ratio)))
    return ratio
