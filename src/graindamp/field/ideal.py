"""Effective fields of idealised beds, from the closed forms, for comparison and for design before any measurement."""

from collections.abc import Callable
from typing import Literal

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from graindamp.errors import InputError
from graindamp.field.schema import make_field
from graindamp.field.theory import TheoryPoint, bouncing_bed_vertical, collect_and_collide, frozen_bed, sliding_bed
from graindamp.status import Status
from graindamp.units import STANDARD_GRAVITY

Motion = Literal["bouncing", "sliding", "bouncing-vertical", "frozen"]


def ideal_field(
    motion: Motion,
    frequency: ArrayLike,
    intensity: ArrayLike,
    bed_mass: float,
    *,
    clearance: float | None = None,
    restitution: float = 0.0,
    friction: float | None = None,
) -> xr.Dataset:
    """Field of an idealised bed on a grid; points at which the motion does not exist carry NaN and say so.

    Args:
        motion: "bouncing" (collect and collide between end walls, no gravity), "sliding" (Coulomb friction, walls out
            of reach), "bouncing-vertical" (plastic bed on a shaken floor, no lid), "frozen" (glued to the container).
        frequency: [Hz], ascending.
        intensity: Gamma [-], ascending.
        bed_mass: mass of all particles [kg].
        clearance: free travel h of the bed [m]; "bouncing" needs it.
        restitution: of bed and end wall [-], for "bouncing".
        friction: coefficient of friction of bed and floor [-]; "sliding" needs it.

    Raises:
        InputError: an unknown motion, or one without the parameter it needs.
    """
    at: Callable[[float, float], TheoryPoint]
    if motion == "bouncing":
        if clearance is None:
            raise InputError("an ideal field of motion 'bouncing' needs clearance, the free travel of the bed [m]")
        optimum = clearance / np.pi

        def at(f: float, gamma: float) -> TheoryPoint:
            return collect_and_collide(gamma * STANDARD_GRAVITY / (2 * np.pi * f) ** 2 / optimum, restitution)

    elif motion == "sliding":
        if friction is None:
            raise InputError("an ideal field of motion 'sliding' needs friction, the coefficient of bed and floor [-]")

        def at(f: float, gamma: float) -> TheoryPoint:
            return sliding_bed(gamma, friction)

    elif motion == "bouncing-vertical":

        def at(f: float, gamma: float) -> TheoryPoint:
            return bouncing_bed_vertical(gamma)

    elif motion == "frozen":

        def at(f: float, gamma: float) -> TheoryPoint:
            return frozen_bed()

    else:
        raise InputError(f"motion is {motion!r}; allowed are bouncing, sliding, bouncing-vertical, frozen")
    f_axis, g_axis = np.asarray(frequency, float), np.asarray(intensity, float)
    points = [[at(f, gamma) for gamma in g_axis] for f in f_axis]
    exists = np.array([[point.exists for point in row] for row in points])
    eta = np.array([[point.loss_factor for point in row] for row in points])
    mass = np.array([[point.effective_mass_ratio for point in row] for row in points])
    return make_field(
        f_axis,
        g_axis,
        np.where(exists, eta, np.nan),
        np.where(exists, mass, np.nan),
        bed_mass,
        source=f"theory: {motion}",
        variables={
            "loss_factor_se": np.zeros_like(eta),
            "effective_mass_ratio_se": np.zeros_like(eta),
            "status": np.where(exists, 0, int(Status.NO_SOLUTION)),
        },
        damper={"name": f"ideal {motion} bed", "bed_mass": bed_mass}
        | ({"clearance": clearance} if clearance is not None else {}),
    )
