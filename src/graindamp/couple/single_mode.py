"""One mode at its resonance, carrying any number of dampers: two equations in two unknowns.

With modal acceleration amplitude a = omega^2 Q, a damper d moves with intensity Gamma_d = |phi_d| a / g, and

    resonance:  omega^2 (1 + sum phi_d^2 Re M_d(omega, Gamma_d)) = omega_k^2
    energy:     (D_k / omega - sum phi_d^2 Im M_d(omega, Gamma_d)) a = |phi_drive| F

The unknowns are x = log f and y = log(a / g): shifting y by log |phi_d| gives log Gamma_d, so rectangles in (x, y) are
rectangles in every field. Source: Meyer & Seifried (2021), Eqs 11-17, for several dampers and without their modulus.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from graindamp.couple.balance import Attached
from graindamp.errors import InputError
from graindamp.structure.modal import ModalModel, point_index
from graindamp.units import STANDARD_GRAVITY

Real = NDArray[np.float64]

NODE = 1e-6
"""A point at less than this share of the largest shape value of all modes is a node: a damper there takes no part, a
force there does not drive. Modes of another direction, solved to rounding, are all nodes."""


class LoadedMode(NamedTuple):
    """One elastic mode, the dampers that it moves, and the force that drives it."""

    number: int
    """1 for the first elastic mode."""
    omega: float
    """Eigenfrequency without beds [rad/s]."""
    damping: float
    """Structural damping D_k = 2 zeta_k omega_k [1/s]."""
    shape: Real
    """Modulus of the mass-normalised shape at each damper that takes part [kg^-1/2], shape (damper,)."""
    drive_shape: float
    """Modulus of the shape at the driven point [kg^-1/2], 0 on a node."""
    force: float
    """Force amplitude [N]."""
    dampers: tuple[Attached, ...]
    """Dampers that take part, in the order of `shape`. Their fields answer everywhere; `confined` tells where they
    should not be asked."""
    confined: tuple[bool, ...]
    """True for dampers whose field refuses to be used outside its points."""
    indices: tuple[int, ...]
    """Their places among all dampers."""

    @property
    def static_damping_ratio(self) -> float:
        """Structural damping ratio zeta_k [-]."""
        return self.damping / (2 * self.omega)

    @property
    def offset(self) -> Real:
        """log |phi_d|, what lies between y and log Gamma_d."""
        offset: Real = np.log(self.shape)
        return offset


def load_mode(model: ModalModel, mode: int, drive: str, force: float, dampers: Sequence[Attached]) -> LoadedMode:
    """Mode `mode` (index into the modal model) with its dampers and drive.

    Raises:
        InputError: a rigid-body mode, a force not above 0, or a point the model does not have.
    """
    if model.omega[mode] <= 0:
        raise InputError(f"mode {mode + 1} is a rigid-body mode; only elastic modes have a resonance")
    if not force > 0:
        raise InputError(f"force is {force!r} N; an amplitude above 0 is needed")
    shape = np.abs([model.shape[point_index(model, damper.point), mode] for damper in dampers])
    largest = float(np.abs(model.shape).max())
    drive_shape = float(abs(model.shape[point_index(model, drive), mode]))
    taking_part = [i for i in range(len(dampers)) if shape[i] > NODE * largest]
    n_rigid = int(np.sum(model.omega <= 0))
    return LoadedMode(
        mode - n_rigid + 1,
        float(model.omega[mode]),
        float(model.damping[mode]),
        shape[taking_part],
        drive_shape if drive_shape > NODE * largest else 0.0,
        force,
        tuple(_everywhere(dampers[i]) for i in taking_part),
        tuple(dampers[i].field.outside == "refuse" for i in taking_part),
        tuple(taking_part),
    )


def _everywhere(damper: Attached) -> Attached:
    """The damper with a field that answers a hair's breadth outside its points, as derivatives at an edge ask for."""
    return damper._replace(field=damper.field.beyond("linear")) if damper.field.outside == "refuse" else damper


class Loads(NamedTuple):
    """What the dampers do to the mode at some (x, y); all arrays shaped like x and y."""

    mass: Real
    """sum phi_d^2 Re M_d [-], containers included."""
    loss: Real
    """-sum phi_d^2 Im M_d [-]."""
    extrapolated: NDArray[np.bool_]


def loads(mode: LoadedMode, x: Real, y: Real, shift: tuple[Real, Real] | None = None) -> Loads:
    """Modal mass and loss that the dampers add at x = log f, y = log(a / g).

    Args:
        mode: the mode.
        x: log of the frequency [Hz].
        y: log of the modal acceleration over g [kg^1/2].
        shift: added to eta and m' of each damper, each of shape (damper,); for derivatives.
    """
    mass, loss = np.zeros(np.shape(x)), np.zeros(np.shape(x))
    extrapolated = np.zeros(np.shape(x), bool)
    for d, damper in enumerate(mode.dampers):
        values = damper.field(np.exp(x), mode.shape[d] * np.exp(y))
        eta, ratio = values.loss_factor, values.effective_mass_ratio
        if shift is not None:
            eta, ratio = eta + shift[0][d], ratio + shift[1][d]
        mass += mode.shape[d] ** 2 * (damper.container_mass + damper.bed_mass * ratio)
        loss += mode.shape[d] ** 2 * damper.bed_mass * eta
        extrapolated |= values.extrapolated
    return Loads(mass, loss, extrapolated)


def imbalance(mode: LoadedMode, x: Real, y: Real, added: Loads) -> tuple[Real, Real]:
    """Resonance and energy equation as logarithms of left over right side [-]; both zero at an equilibrium.

    +inf and -inf stand where a side has no logarithm (no inertia left, nothing dissipated): far from balance.
    """
    omega = 2 * np.pi * np.exp(x)
    with np.errstate(divide="ignore", invalid="ignore"):
        resonance = np.where(added.mass > -1, np.log(omega**2 * (1 + added.mass)), -np.inf) - 2 * np.log(mode.omega)
        resisting = mode.damping / omega + added.loss
        held = np.where(resisting > 0, np.log(resisting), -np.inf) + y + np.log(STANDARD_GRAVITY)
    return resonance, held - np.log(mode.drive_shape * mode.force)


def held_force(mode: LoadedMode, x: Real, y: Real, added: Loads) -> Real:
    """Force amplitude at the driven point that keeps the mode at this resonant amplitude [N]."""
    omega = 2 * np.pi * np.exp(x)
    force: Real = (mode.damping / omega + added.loss) * np.exp(y) * STANDARD_GRAVITY / mode.drive_shape
    return force


def damping_ratio(mode: LoadedMode, x: Real, added: Loads) -> Real:
    """Total damping ratio of the loaded mode at its resonance [-], Meyer & Seifried (2021), Eq. 16."""
    ratio: Real = (mode.damping / (2 * np.pi * np.exp(x)) + added.loss) / (2 * (1 + added.mass))
    return ratio


class Box(NamedTuple):
    """Where x and y are searched, and where the fields bend in between."""

    x: Real
    """Ascending breaks of log f; first and last are the limits."""
    y: Real
    """Ascending breaks of log(a / g) likewise."""


def search_box(mode: LoadedMode, reach: float = np.log(1e4)) -> Box | str:
    """The region to search for equilibria, or why there is none.

    Where fields refuse to extrapolate it is what all of them cover; otherwise it goes on by a factor exp(`reach`) in
    amplitude, and by a factor 4 about the mode in frequency.
    """
    xs, ys = [], []
    x_low, x_high = np.log(mode.omega / (2 * np.pi)) + np.array([-np.log(4.0), np.log(4.0)])
    y_low, y_high = -np.inf, np.inf
    for damper, offset, is_confined in zip(mode.dampers, mode.offset, mode.confined, strict=True):
        x, y = damper.field.breaks()
        xs.append(x)
        ys.append(y - offset)
        if is_confined:
            x_low, x_high = max(x_low, x[0]), min(x_high, x[-1])
            y_low, y_high = max(y_low, y[0] - offset), min(y_high, y[-1] - offset)
    known = np.concatenate(ys)
    y_low = max(y_low, known.min() - reach) if np.isinf(y_low) else y_low
    y_high = min(y_high, known.max() + reach) if np.isinf(y_high) else y_high
    if x_low > x_high:
        low, high = mode.dampers[0].field.frequency_range
        return f"the mode at {mode.omega / (2 * np.pi):.4g} Hz lies outside the field, {low:g} to {high:g} Hz"
    if y_low > y_high:
        return "the fields of the dampers have no amplitude of this mode in common"
    return Box(_between(np.concatenate(xs), x_low, x_high), _between(known, y_low, y_high))


def _between(breaks: Real, low: float, high: float) -> Real:
    inner = breaks[(breaks > low) & (breaks < high)]
    return np.unique(np.concatenate([[low], inner, [high]]))
