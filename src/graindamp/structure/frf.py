"""Frequency responses of a linear structure, summed over its modes; x(t) = Re[X exp(i omega t)].

Names follow ISO 7626-1: receptance x / F, mobility v / F, accelerance a / F. Modes that the model does not keep are
missing from the sum; near and below the highest kept mode their share is a small, nearly constant receptance.
"""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graindamp.errors import InputError
from graindamp.structure.modal import ModalModel, point_index


def receptance(model: ModalModel, frequency: ArrayLike, output: str, input: str) -> NDArray[np.complex128]:
    """Displacement of point `output` per force on point `input` [m/N], complex, (frequency,).

    Rigid-body modes contribute with omega_k = 0. Equals its own transpose: output and input may change places.

    Args:
        model: the structure.
        frequency: frequencies [Hz] (frequency,) or one number, >= 0; above 0 when there are undamped rigid-body modes.
        output: name of the point that is observed.
        input: name of the point that the force acts on.

    Raises:
        InputError: unknown point, a frequency that is negative or not finite, or one at which the response is infinite.

    Source: Ewins (2000), Modal Testing, 2nd ed., section 2.4.
    """
    driven = np.asarray(frequency, dtype=float)
    if not np.isfinite(driven).all() or (driven < 0).any():
        raise InputError("frequencies must be finite and not negative [Hz]")
    omega = 2 * np.pi * driven[..., None]
    residue = model.shape[point_index(model, output)] * model.shape[point_index(model, input)]
    stiffness = model.omega**2 - omega**2 + 1j * omega * model.damping
    infinite = (stiffness == 0) & (residue != 0)
    if infinite.any():
        where = float(driven[infinite.any(axis=-1)].min())
        if where == 0:
            raise InputError(
                "the receptance is infinite at 0 Hz: the structure has rigid-body modes and floats away under a static "
                "force; start above 0 Hz"
            )
        raise InputError(f"the receptance is infinite at {where:g} Hz, where an undamped mode lies; give it damping")
    stiffness[stiffness == 0] = 1.0  # such a mode does not take part
    return np.asarray((residue / stiffness).sum(axis=-1))


def mobility(model: ModalModel, frequency: ArrayLike, output: str, input: str) -> NDArray[np.complex128]:
    """Velocity of point `output` per force on point `input` [m/(N s)], complex, (frequency,).

    Its real part is not negative at the driven point, where output and input are one.

    Args, raises and source: as :func:`receptance`.
    """
    return 2j * np.pi * np.asarray(frequency, dtype=float) * receptance(model, frequency, output, input)


def accelerance(model: ModalModel, frequency: ArrayLike, output: str, input: str) -> NDArray[np.complex128]:
    """Acceleration of point `output` per force on point `input` [1/kg], complex, (frequency,).

    The inverse at the driven point is the apparent mass, the quantity an effective mass of a damper adds to.

    Args, raises and source: as :func:`receptance`.
    """
    return -((2 * np.pi * np.asarray(frequency, dtype=float)) ** 2) * receptance(model, frequency, output, input)
