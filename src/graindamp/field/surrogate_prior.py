"""What a surrogate presumes: coordinates, covariances, hyperparameters and mean functions of the two regimes."""

from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from graindamp.field.theory import collect_and_collide, stroke_ratio_best, stroke_ratio_max
from graindamp.units import STANDARD_GRAVITY

Real = NDArray[np.float64]

FADE = 3.0
"""Gamma at which the presumed size of m' below the edge has fallen to half [-]."""


class Form(NamedTuple):
    """What kind of surrogate; the defaults won the comparison in docs/surrogate.md."""

    offset: float = 0.05
    """The process describes ln(eta + offset), which has about constant error where that of eta is relative to
    max(eta, offset); inf describes eta itself."""
    smoothness: float = 2.5
    """nu of the Matern covariances: 1.5 or 2.5."""
    has_edge: bool = True
    """Two regimes with an edge between them; False leaves one process over all points."""
    has_theory: bool = True
    """Let the marginal likelihood choose between a constant mean and collect-and-collide theory above the edge."""
    has_stretch: bool = True
    """Let the marginal likelihood choose whether the axis ln Gamma is stretched threefold around Gamma = 1.1, where a
    bed held by gravity comes loose."""
    has_fade: bool = True
    """Below the edge m' is presumed to become small with growing Gamma, its scatter with it."""


class Places(NamedTuple):
    """Operating points in the coordinates of both regimes."""

    below: Real  # ln(f / 100 Hz), ln Gamma (stretched); (point, 2)
    above: Real  # ln(X / X_opt), ln(f / 100 Hz);        (point, 2)
    intensity: Real  # ln Gamma; (point,)

    @property
    def stroke(self) -> Real:
        """ln(X / X_opt); (point,)."""
        return self.above[:, 0]

    @property
    def frequency(self) -> Real:
        """ln(f / 100 Hz); (point,)."""
        return self.above[:, 1]


class Quantity(NamedTuple):
    """What is presumed of eta (transformed) or m' before any point is known."""

    amplitude: float  # standard deviation of either process
    level_below: float
    level_above: float
    level_sd: float  # of the level and, halved, of the slope over ln Gamma below the edge
    row: int  # of the theory's table


def presumed(form: Form) -> tuple[Quantity, Quantity]:
    """Typical eta and m': 0.25 and 0.3 below the edge, 0.7 and 0.6 above; loosely held."""
    if np.isfinite(form.offset):
        below, above = np.log(np.array([0.25, 0.7]) + form.offset)
        return Quantity(0.4, float(below), float(above), 1.0, 1), Quantity(0.2, 0.3, 0.6, 0.5, 2)
    return Quantity(0.2, 0.25, 0.7, 0.5, 1), Quantity(0.2, 0.3, 0.6, 0.5, 2)


def prior(quantity: Quantity) -> tuple[Real, Real]:
    """Centre and spread of the normal prior of the hyperparameters.

    These are logarithms of: variance and two lengths (in ln f, ln Gamma) below the edge, variance and two lengths (in
    ln X, ln f) above, standard deviation of the nugget.
    """
    variance = 2.0 * np.log(quantity.amplitude)
    centre = [variance, np.log(1.5), np.log(0.8), variance, np.log(0.8), np.log(2.0), np.log(0.01)]
    return np.array(centre), np.array([1.5, 0.7, 0.7, 1.5, 0.7, 0.7, 1.0])


def kernels(theta: Real, smoothness: float) -> tuple[Any, Any]:
    """Covariance functions below and above the edge."""
    from sklearn.gaussian_process.kernels import ConstantKernel, Matern

    below = ConstantKernel(np.exp(theta[0])) * Matern(np.exp(theta[1:3]), nu=smoothness)
    return below, ConstantKernel(np.exp(theta[3])) * Matern(np.exp(theta[4:6]), nu=smoothness)


def stroke_of(frequency: Real, intensity: Real) -> Real:
    """Displacement amplitude X [m]."""
    return np.asarray(intensity * STANDARD_GRAVITY / (2 * np.pi * frequency) ** 2)


@lru_cache(maxsize=8)
def theory_table(restitution: float) -> Real:
    """ln(X / X_opt), eta and m' of collect and collide; (3, 600). Below the best stroke its values hold.

    Above the range of the symmetric motion the plastic bed stands in, as theory.collect_and_collide says.
    """
    strokes = np.geomspace(stroke_ratio_best(restitution), 300.0, 600)
    last = stroke_ratio_max(restitution)
    points = [collect_and_collide(float(r), restitution if r <= last else 0.0) for r in strokes]
    values = [[point.loss_factor, point.effective_mass_ratio] for point in points]
    return np.asarray(np.vstack([np.log(strokes), np.array(values).T]))
