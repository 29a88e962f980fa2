"""Description of the particles of a damper: materials, radii and how many there are."""

import math
from collections.abc import Mapping
from typing import Annotated, Any, Literal, Self

from pydantic import Discriminator, Field, Tag, model_validator

from graindamp.errors import InputError
from graindamp.spec.contact import ContactMaterial
from graindamp.spec.model import Spec
from graindamp.spec.quantity import Length, Mass, Number

DENSEST_PACKING = math.pi / math.sqrt(18.0)
"""Largest solid fraction of equal spheres [-] (Hales 2005, Annals of Mathematics 162); beds poured at random end near
0.64."""

DEFAULT_REACH = 3.0
"""Normal and lognormal radii are drawn within this many standard deviations [-]: 997 of 1000 radii lie there anyhow,
and a single outlier would set the time step (smallest) or the reach of every neighbour list (largest)."""


class NormalRadius(Spec):
    """Normally distributed radii, cut off at both ends."""

    kind: Literal["normal"] = "normal"
    """Kind of distribution: "normal"."""
    mean: Length
    """Mean radius before the ends are cut off [m], > 0."""
    std: Length
    """Standard deviation before the ends are cut off [m], > 0; by number of particles, not by mass."""
    min: Length | None = None
    """Smallest radius [m], > 0; default: mean - 3 std, which must then be positive."""
    max: Length | None = None
    """Largest radius [m], above min; default: mean + 3 std."""

    @property
    def limits(self) -> tuple[float, float]:
        """Smallest and largest radius [m]."""
        low = self.mean - DEFAULT_REACH * self.std if self.min is None else self.min
        high = self.mean + DEFAULT_REACH * self.std if self.max is None else self.max
        return low, high

    @model_validator(mode="after")
    def _positive(self) -> Self:
        low, high = self.limits
        if low <= 0:
            raise InputError(
                f'mean - 3 std is {low:g} m, and radii must be positive; give min, a smaller std, or kind = "lognormal"'
            )
        _ascending(low, self.mean, high)
        return self


class UniformRadius(Spec):
    """Radii spread evenly between two bounds."""

    kind: Literal["uniform"] = "uniform"
    """Kind of distribution: "uniform"."""
    low: Length
    """Smallest radius [m], > 0."""
    high: Length
    """Largest radius [m], above low."""

    @property
    def limits(self) -> tuple[float, float]:
        """Smallest and largest radius [m]."""
        return self.low, self.high

    @model_validator(mode="after")
    def _ascends(self) -> Self:
        if self.low >= self.high:
            raise InputError(
                f"high must lie above low, given {self.low:g} to {self.high:g} m; for one size write a length"
            )
        return self


class LognormalRadius(Spec):
    """Radii whose logarithm is normally distributed, cut off at both ends."""

    kind: Literal["lognormal"] = "lognormal"
    """Kind of distribution: "lognormal"."""
    median: Length
    """Median radius [m], > 0."""
    spread: Number = Field(gt=0, le=1)
    """Standard deviation of ln(radius) [-], above 0 to 1, by number; at 1 the default limits already span a factor of
    400."""
    min: Length | None = None
    """Smallest radius [m], > 0; default: median / exp(3 spread)."""
    max: Length | None = None
    """Largest radius [m], above min; default: median exp(3 spread)."""

    @property
    def limits(self) -> tuple[float, float]:
        """Smallest and largest radius [m]."""
        factor = math.exp(DEFAULT_REACH * self.spread)
        low = self.median / factor if self.min is None else self.min
        high = self.median * factor if self.max is None else self.max
        return low, high

    @model_validator(mode="after")
    def _ascends(self) -> Self:
        low, high = self.limits
        _ascending(low, self.median, high)
        return self


class DiscreteRadius(Spec):
    """A few radii, each with its share by number."""

    kind: Literal["discrete"] = "discrete"
    """Kind of distribution: "discrete"."""
    radius: tuple[Length, ...] = Field(min_length=1)
    """Radii [m], > 0."""
    share: tuple[Annotated[Number, Field(gt=0)], ...] = Field(min_length=1)
    """Share of each radius by number of particles [-], > 0; only their ratios count."""

    @property
    def limits(self) -> tuple[float, float]:
        """Smallest and largest radius [m]."""
        return min(self.radius), max(self.radius)

    @model_validator(mode="after")
    def _as_many(self) -> Self:
        if len(self.radius) != len(self.share):
            raise InputError(f"radius has {len(self.radius)} and share {len(self.share)} values; give as many")
        return self


class ListRadius(Spec):
    """The radius of every single particle."""

    kind: Literal["list"] = "list"
    """Kind of distribution: "list"."""
    radius: tuple[Length, ...] = Field(min_length=1)
    """Radii [m], > 0, one per particle; they say how many there are, so that fill is left out."""

    @property
    def limits(self) -> tuple[float, float]:
        """Smallest and largest radius [m]."""
        return min(self.radius), max(self.radius)


def _ascending(low: float, middle: float, high: float) -> None:
    if not low < middle < high:
        raise InputError(f"min, middle and max of the radii must ascend, given {low:g}, {middle:g}, {high:g} m")


_KINDS = ("normal", "uniform", "lognormal", "discrete", "list")


def _radius_kind(value: Any) -> str | None:
    if isinstance(value, Mapping):
        kind = value.get("kind")
        return kind if kind in _KINDS else None
    return str(value.kind) if isinstance(value, Spec) and hasattr(value, "kind") else "length"


RadiusSpec = Annotated[
    Annotated[Length, Tag("length")]
    | Annotated[NormalRadius, Tag("normal")]
    | Annotated[UniformRadius, Tag("uniform")]
    | Annotated[LognormalRadius, Tag("lognormal")]
    | Annotated[DiscreteRadius, Tag("discrete")]
    | Annotated[ListRadius, Tag("list")],
    Discriminator(
        _radius_kind,
        custom_error_type="radius",
        custom_error_message=f"give a length, or a table with kind, one of {', '.join(_KINDS)}",
    ),
]
"""Radius of the particles of one component: one length [m], or a distribution."""


class BedComponent(Spec):
    """Particles of one material and one distribution of radii."""

    material: ContactMaterial
    """Name of a material such as "steel-s235", or a table with youngs_modulus, poisson_ratio and density."""
    radius: RadiusSpec
    """Radius, not diameter [m], > 0: a length such as "1.25 mm", or a table with kind = "normal", "uniform",
    "lognormal", "discrete" or "list"."""
    share: Number = Field(default=1.0, gt=0)
    """Share by number of particles [-], > 0, where there are several components; only ratios count."""

    @property
    def limits(self) -> tuple[float, float]:
        """Smallest and largest radius [m]."""
        return (self.radius, self.radius) if isinstance(self.radius, float) else self.radius.limits

    @model_validator(mode="after")
    def _has_density(self) -> Self:
        if self.material.density is None:
            raise InputError(f"the particles' material '{self.material.name}' needs a density [kg/m^3]")
        return self

    @property
    def density(self) -> float:
        """Density of the particles [kg/m^3]."""
        assert self.material.density is not None
        return self.material.density


class FillSpec(Spec):
    """How many particles: exactly one of the four."""

    count: int | None = Field(default=None, ge=1)
    """Number of particles, >= 1."""
    mass: Mass | None = None
    """Mass of all particles [kg], > 0; met as closely as whole particles allow."""
    height: Length | None = None
    """Height of the poured bed, before it is shaken, above the lowest point of the container [m], > 0."""
    solid_fraction: Annotated[Number, Field(gt=0, lt=DENSEST_PACKING)] | None = None
    """Volume of all particles over the container's inner volume less its inserts [-], above 0 and below 0.7405, the
    densest packing of equal spheres."""

    @model_validator(mode="after")
    def _exactly_one(self) -> Self:
        given = [name for name in type(self).model_fields if getattr(self, name) is not None]
        if len(given) != 1:
            raise InputError(
                "give exactly one of count, mass, height and solid_fraction; "
                f"given: {', '.join(given) or 'none of them'}"
            )
        return self
