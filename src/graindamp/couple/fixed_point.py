"""The fixed-point scheme of Meyer & Seifried (2021), Fig. 5, with its history.

Effective mass and damping are read from the field at the last amplitude, which gives the next one. It finds one
equilibrium where it converges; :mod:`graindamp.couple.equilibrium` finds all of them.
"""

from typing import NamedTuple

import numpy as np

from graindamp.couple.single_mode import LoadedMode, loads
from graindamp.units import STANDARD_GRAVITY

NAN = float("nan")


class Iteration(NamedTuple):
    """One turn of the scheme."""

    frequency: float
    """Effective eigenfrequency [Hz], Eq. 15."""
    damping_ratio: float
    """[-], Eq. 16."""
    modal_amplitude: float
    """Q [kg^1/2 m], Eq. 17."""
    intensity: float
    """Largest intensity among the dampers [-]."""
    extrapolated: bool
    """True where any field was used outside its points to get here."""


class FixedPoint(NamedTuple):
    """Where the scheme ended."""

    history: tuple[Iteration, ...]
    converged: bool
    n_iter: int
    residual: float
    """Last relative change of the amplitude [-]."""
    reason: str
    """Why it did not converge; empty where it did."""

    @property
    def last(self) -> Iteration:
        """The state it ended in."""
        return self.history[-1]


def solve_fixed_point(mode: LoadedMode, tolerance: float = 1e-6, max_iter: int = 100) -> FixedPoint:
    """Iterate from dampers of eta = 1 and m' = 1 until the amplitude changes by less than `tolerance`.

    Fields that refuse to extrapolate end the iteration where it leaves them; the paper extrapolates linearly.

    Args:
        mode: the mode with its drive and dampers.
        tolerance: relative change of the amplitude that counts as converged [-].
        max_iter: turns at most; the paper's limit.
    """
    bed = float(sum(d.bed_mass * phi**2 for d, phi in zip(mode.dampers, mode.shape, strict=True)))
    container = float(sum(d.container_mass * phi**2 for d, phi in zip(mode.dampers, mode.shape, strict=True)))
    history = [_iterate(mode, bed + container, bed, mode.omega, False)]
    change, reason = NAN, f"no convergence within {max_iter} iterations"
    for _ in range(max_iter):
        state = history[-1]
        if not np.isfinite(state.modal_amplitude) or state.intensity <= 0:
            reason = "the dampers give no damping at this amplitude; it grows without limit"
            break
        x = np.array(np.log(state.frequency))
        y = np.array(np.log(state.modal_amplitude * (2 * np.pi * state.frequency) ** 2 / STANDARD_GRAVITY))
        added = loads(mode, x, y)
        if added.extrapolated and any(mode.confined):
            reason = f"the iteration leaves the field at {state.frequency:.4g} Hz, intensity {state.intensity:.3g}"
            break
        history.append(
            _iterate(mode, float(added.mass), float(added.loss), 2 * np.pi * state.frequency, bool(added.extrapolated))
        )
        change = abs(history[-1].modal_amplitude / state.modal_amplitude - 1)
        if change < tolerance:
            return FixedPoint(tuple(history), True, len(history) - 1, change, "")
    return FixedPoint(tuple(history), False, len(history) - 1, change, reason)


def _iterate(mode: LoadedMode, mass: float, loss: float, omega: float, extrapolated: bool) -> Iteration:
    """Eqs 15 to 17 with the dampers' modal mass and loss; `omega` is where the loss was read [rad/s]."""
    if mass <= -1:
        return Iteration(NAN, NAN, NAN, NAN, extrapolated)
    resonance = mode.omega / np.sqrt(1 + mass)
    damping = mode.damping + loss * omega
    amplitude = mode.drive_shape * mode.force / (damping * resonance) if damping > 0 else float("inf")
    largest = float(mode.shape.max()) if len(mode.shape) else 0.0
    return Iteration(
        float(resonance / (2 * np.pi)),
        float(damping / (2 * (1 + mass) * resonance)),
        float(amplitude),
        float(largest * amplitude * resonance**2 / STANDARD_GRAVITY),
        extrapolated,
    )
