"""Radii of the particles: how they are drawn, and the mean volume of a particle."""

import numpy as np
from numpy.typing import NDArray

from graindamp.errors import InputError
from graindamp.spec.particles import (
    BedComponent,
    DiscreteRadius,
    ListRadius,
    LognormalRadius,
    NormalRadius,
    RadiusSpec,
    UniformRadius,
)

_GAUSS_NODES = 64
"""Nodes of the quadrature of the truncated normal weight; over the widest range in use, 6 standard deviations,
rounding remains."""


def draw(radius: RadiusSpec, n: int, rng: np.random.Generator) -> NDArray[np.float64]:
    """`n` radii [m], all positive, in random order.

    Normal and lognormal radii are drawn from the distribution cut off at its limits, by inversion; a discrete
    distribution is met as closely as whole numbers allow, not sampled. A list gives its own radii in its own order.

    Raises:
        InputError: a list of another length than `n`.
    """
    if isinstance(radius, float):
        return np.full(n, radius)
    if isinstance(radius, UniformRadius):
        return rng.uniform(radius.low, radius.high, n)
    if isinstance(radius, DiscreteRadius):
        counts = apportion(radius.share, n)
        return rng.permutation(np.repeat(np.asarray(radius.radius, np.float64), counts))
    if isinstance(radius, ListRadius):
        if n != len(radius.radius):
            raise InputError(f"the list of radii has {len(radius.radius)} values, but {n} particles are wanted")
        return np.asarray(radius.radius, np.float64)
    low, high = _standard_limits(radius)
    from scipy.special import ndtr, ndtri

    standard = ndtri(rng.uniform(ndtr(low), ndtr(high), n))
    return np.clip(_radius_at(radius, standard), *radius.limits)  # inversion rounds: keep the limits exactly


def mean_volume(radius: RadiusSpec) -> float:
    """Mean volume of a particle, (4/3) pi E[r^3] [m^3]; of the cut-off distribution, as :func:`draw` gives it."""
    return 4.0 / 3.0 * np.pi * _mean_cube(radius)


def _mean_cube(radius: RadiusSpec) -> float:
    if isinstance(radius, float):
        return radius**3
    if isinstance(radius, UniformRadius):
        return (radius.low + radius.high) * (radius.low**2 + radius.high**2) / 4.0
    if isinstance(radius, DiscreteRadius):
        return float(np.average(np.asarray(radius.radius) ** 3, weights=radius.share))
    if isinstance(radius, ListRadius):
        return float(np.mean(np.asarray(radius.radius) ** 3))
    low, high = _standard_limits(radius)
    node, weight = np.polynomial.legendre.leggauss(_GAUSS_NODES)
    standard = low + (high - low) * (node + 1.0) / 2.0
    weight = weight * np.exp(-(standard**2) / 2.0)
    return float(np.sum(weight * _radius_at(radius, standard) ** 3) / np.sum(weight))


def _standard_limits(radius: NormalRadius | LognormalRadius) -> tuple[float, float]:
    """Limits as multiples of the standard deviation from the centre [-]."""
    low, high = radius.limits
    if isinstance(radius, NormalRadius):
        return (low - radius.mean) / radius.std, (high - radius.mean) / radius.std
    return float(np.log(low / radius.median)) / radius.spread, float(np.log(high / radius.median)) / radius.spread


def _radius_at(radius: NormalRadius | LognormalRadius, standard: NDArray[np.float64]) -> NDArray[np.float64]:
    """Radius [m] that lies `standard` standard deviations from the centre."""
    if isinstance(radius, NormalRadius):
        return radius.mean + radius.std * standard
    return radius.median * np.exp(radius.spread * standard)


def apportion(share: tuple[float, ...], n: int) -> NDArray[np.int64]:
    """Whole numbers that sum to `n` and are proportional to `share` to within one (largest remainders)."""
    exact = np.asarray(share, np.float64) / np.sum(share) * n
    counts: NDArray[np.int64] = np.floor(exact).astype(np.int64)
    rest = np.argsort(-(exact - counts), kind="stable")[: n - int(counts.sum())]
    counts[rest] += 1
    return counts


def draw_bed(
    components: tuple[BedComponent, ...], n: int | None, rng: np.random.Generator
) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
    """Radius [m] and number of the component of every particle of a bed.

    Components share the particles by number, in random order, so that they are poured well mixed. Where the radii are
    lists, every list is taken whole and in its order, and `n` must be None or their common length.

    Raises:
        InputError: no `n` where it is needed, or one that contradicts the lists.
    """
    lists = [component.radius for component in components if isinstance(component.radius, ListRadius)]
    if lists:
        listed = sum(len(radius.radius) for radius in lists)
        if n is not None and n != listed:
            raise InputError(f"the lists of radii have {listed} values, but {n} particles are wanted")
        counts = np.array([len(radius.radius) for radius in lists])
    else:
        if n is None:
            raise InputError("the number of particles is missing")
        counts = apportion(tuple(component.share for component in components), n)
    radii = [draw(component.radius, int(count), rng) for component, count in zip(components, counts, strict=True)]
    radius = np.concatenate(radii)
    component = np.repeat(np.arange(len(components), dtype=np.int32), counts)
    if lists:
        return radius, component
    order = rng.permutation(len(radius))
    return radius[order], component[order]


def mean_particle(components: tuple[BedComponent, ...]) -> tuple[float, float]:
    """Mean volume [m^3] and mean mass [kg] of a particle of the whole bed, by the components' shares."""
    share = np.array(
        [
            len(component.radius.radius) if isinstance(component.radius, ListRadius) else component.share
            for component in components
        ],
        np.float64,
    )
    share /= share.sum()
    volume = np.array([mean_volume(component.radius) for component in components])
    density = np.array([component.density for component in components])
    return float(share @ volume), float(share @ (volume * density))


def count_for(components: tuple[BedComponent, ...], mass: float | None = None, volume: float | None = None) -> int:
    """Number of particles whose expected mass [kg], or else whose expected volume of solid [m^3], is nearest to the
    given one.

    Raises:
        InputError: less than half a particle.
    """
    mean_size, mean_mass = mean_particle(components)
    if mass is not None:
        exact, given = mass / mean_mass, f"{mass:g} kg"
    else:
        assert volume is not None
        exact, given = volume / mean_size, f"{volume:g} m^3"
    if exact < 0.5:
        raise InputError(f"{given} is less than half a particle (mean {mean_mass:g} kg, {mean_size:g} m^3); give more")
    return round(exact)
