"""Description of what vibrates: a beam in one plane, modes typed in, or modes in a UFF file."""

import math
from typing import Annotated, Any, Literal, Self

from pydantic import BeforeValidator, Discriminator, Field, Tag, model_validator

from graindamp.errors import InputError
from graindamp.materials import material_named
from graindamp.spec.model import Spec
from graindamp.spec.quantity import (
    BendingStiffness,
    DampingRatio,
    Density,
    Length,
    MassOrZero,
    MassPerLength,
    Position,
    Rate,
    RotaryInertia,
    SpringStiffness,
    TorsionStiffness,
    YoungsModulus,
)
from graindamp.units import to_si

FrequencyOrZero = Annotated[
    float, BeforeValidator(lambda value: to_si(value, "Hz")), Field(ge=0, json_schema_extra={"unit": "Hz"})
]
ModeShapeValue = Annotated[
    float, BeforeValidator(lambda value: to_si(value, "kg^-0.5")), Field(json_schema_extra={"unit": "kg^-0.5"})
]
DurationOrZero = Annotated[
    float, BeforeValidator(lambda value: to_si(value, "s")), Field(ge=0, json_schema_extra={"unit": "s"})
]

POSITION_SLACK = 1e-9
"""A position may exceed the length by this part of it [-]: "1800 mm" and 1.8 need not be the same number."""


class MaterialSpec(Spec):
    """Linear elastic material of a beam."""

    youngs_modulus: YoungsModulus
    """Young's modulus [Pa], > 0."""
    density: Density
    """Density [kg/m^3], > 0."""
    name: str = ""
    """Name of the material in tables."""


def _material(value: Any) -> Any:
    if not isinstance(value, str):
        return value
    found = material_named(value)
    return MaterialSpec(youngs_modulus=found.youngs_modulus, density=found.density, name=found.name)


class RectangleSection(Spec):
    """Solid or hollow rectangular cross-section, bending in the direction of its height."""

    shape: Literal["rectangle"] = "rectangle"
    """Shape of the cross-section: "rectangle"."""
    width: Length
    """Outer width b, across the bending direction [m], > 0."""
    height: Length
    """Outer height h, along the bending direction [m], > 0."""
    wall: Length | None = None
    """Wall thickness of a hollow section [m], > 0 and below half of width and height; default: solid."""

    @model_validator(mode="after")
    def _wall_fits(self) -> Self:
        _check_wall(self.wall, min(self.width, self.height))
        return self

    @property
    def area(self) -> float:
        """Area of the cross-section [m^2]."""
        inner_width, inner_height = self._inner()
        return self.width * self.height - inner_width * inner_height

    @property
    def second_moment(self) -> float:
        """Second moment of area for bending in the direction of the height, I = b h^3 / 12 [m^4]."""
        inner_width, inner_height = self._inner()
        return (self.width * self.height**3 - inner_width * inner_height**3) / 12

    def _inner(self) -> tuple[float, float]:
        if self.wall is None:
            return 0.0, 0.0
        return self.width - 2 * self.wall, self.height - 2 * self.wall


class TubeSection(Spec):
    """Solid or hollow circular cross-section."""

    shape: Literal["tube"] = "tube"
    """Shape of the cross-section: "tube"."""
    diameter: Length
    """Outer diameter d [m], > 0."""
    wall: Length | None = None
    """Wall thickness [m], > 0 and below half of the diameter; default: solid."""

    @model_validator(mode="after")
    def _wall_fits(self) -> Self:
        _check_wall(self.wall, self.diameter)
        return self

    @property
    def area(self) -> float:
        """Area of the cross-section [m^2]."""
        return math.pi / 4 * (self.diameter**2 - self._inner() ** 2)

    @property
    def second_moment(self) -> float:
        """Second moment of area, I = pi d^4 / 64 when solid [m^4]."""
        return math.pi / 64 * (self.diameter**4 - self._inner() ** 4)

    def _inner(self) -> float:
        return 0.0 if self.wall is None else self.diameter - 2 * self.wall


def _check_wall(wall: float | None, outer: float) -> None:
    if wall is not None and wall >= outer / 2:
        raise InputError(
            f"wall is {wall:g} m, but the section is only {outer:g} m thick; "
            f"allowed below {outer / 2:g} m, or leave wall out for a solid section"
        )


Section = Annotated[RectangleSection | TubeSection, Field(discriminator="shape")]


class PointMassSpec(Spec):
    """A small rigid body fixed to the beam."""

    position: Position
    """Where along the beam [m], 0 to its length."""
    mass: MassOrZero
    """Mass [kg], >= 0."""
    rotary_inertia: RotaryInertia = 0.0
    """Moment of inertia about the bending axis through the beam's axis [kg m^2], >= 0."""
    name: str = ""
    """Name of the mass in tables."""


class SpringSpec(Spec):
    """A massless spring between the beam and the ground."""

    position: Position
    """Where along the beam [m], 0 to its length."""
    stiffness: SpringStiffness = 0.0
    """Stiffness against deflection [N/m], >= 0."""
    torsion_stiffness: TorsionStiffness = 0.0
    """Stiffness against rotation of the beam's axis [N m/rad], >= 0."""


def _one_or_list(value: Any) -> str:
    return "list" if isinstance(value, (list, tuple)) else "one"


DampingRatios = Annotated[
    Annotated[DampingRatio, Tag("one")] | Annotated[tuple[DampingRatio, ...], Tag("list")], Discriminator(_one_or_list)
]


class ModalDampingSpec(Spec):
    """Damping ratio of each elastic mode; rigid-body modes stay undamped."""

    kind: Literal["modal"] = "modal"
    """Kind of damping: "modal"."""
    ratio: DampingRatios = 0.0
    """Damping ratio zeta [-], 0 <= zeta < 1: one for all elastic modes, or a list in ascending order of frequency."""


class RayleighDampingSpec(Spec):
    """Damping proportional to mass and stiffness, C = alpha M + beta K, so that D_k = alpha + beta omega_k^2."""

    kind: Literal["rayleigh"] = "rayleigh"
    """Kind of damping: "rayleigh"."""
    alpha: Rate = 0.0
    """Part proportional to mass [1/s], >= 0."""
    beta: DurationOrZero = 0.0
    """Part proportional to stiffness [s], >= 0."""


DampingSpec = Annotated[ModalDampingSpec | RayleighDampingSpec, Field(discriminator="kind")]

End = Literal["free", "clamped", "pinned"]


class BeamSpec(Spec):
    """A straight, uniform, slender beam bending in one plane."""

    kind: Literal["beam"] = "beam"
    """Kind of structure: "beam"."""
    length: Length
    """Length of the beam [m], > 0."""
    bending_stiffness: BendingStiffness | None = None
    """Bending stiffness E I [N m^2], > 0; give it with mass_per_length, or give section and material."""
    mass_per_length: MassPerLength | None = None
    """Mass per length [kg/m], > 0; give it with bending_stiffness, or give section and material."""
    section: Section | None = None
    """Cross-section, with shape = "rectangle" or "tube"; needs material."""
    material: Annotated[MaterialSpec, BeforeValidator(_material)] | None = None
    """Name of a material such as "steel" or "aluminium", or a table with youngs_modulus and density; needs section."""
    n_element: int = Field(default=90, ge=1, le=2000)
    """Number of elements along the beam, 1 to 2000; masses, springs and points may add some."""
    ends: tuple[End, End] = ("free", "free")
    """Support of the ends at position 0 and at the length: "free", "clamped" or "pinned"."""
    masses: tuple[PointMassSpec, ...] = ()
    """Small rigid bodies fixed to the beam."""
    springs: tuple[SpringSpec, ...] = ()
    """Springs between the beam and the ground."""
    damping: DampingSpec = ModalDampingSpec()
    """Damping of the beam without dampers, kind = "modal" or "rayleigh"; default: none."""
    n_mode: int = Field(default=4, ge=1)
    """Number of elastic modes kept, >= 1; rigid-body modes are kept in addition."""

    @model_validator(mode="after")
    def _one_way_to_describe(self) -> Self:
        names = ("bending_stiffness", "mass_per_length", "section", "material")
        given = [name for name in names if getattr(self, name) is not None]
        if given not in (["bending_stiffness", "mass_per_length"], ["section", "material"]):
            raise InputError(
                "give either bending_stiffness and mass_per_length, or section and material; "
                f"given: {', '.join(given) or 'none of them'}"
            )
        return self

    @model_validator(mode="after")
    def _positions_on_beam(self) -> Self:
        positions = {f"masses[{i}].position": mass.position for i, mass in enumerate(self.masses, 1)}
        positions |= {f"springs[{i}].position": spring.position for i, spring in enumerate(self.springs, 1)}
        for name, position in positions.items():
            self.check_position(name, position)
        return self

    def check_position(self, name: str, position: float) -> None:
        """Complain unless `position` [m] lies on the beam.

        Raises:
            InputError: outside; the message calls the position `name` and gives the allowed range.
        """
        if not 0 <= position <= self.length * (1 + POSITION_SLACK):
            raise InputError(
                f"{name} is {position:g} m, but the beam ends at {self.length:g} m; allowed 0 to {self.length:g} m"
            )

    @property
    def flexural_rigidity(self) -> float:
        """Bending stiffness E I [N m^2], as given or of section and material."""
        if self.section is not None and self.material is not None:
            return self.material.youngs_modulus * self.section.second_moment
        assert self.bending_stiffness is not None
        return self.bending_stiffness

    @property
    def linear_density(self) -> float:
        """Mass per length [kg/m], as given or of section and material."""
        if self.section is not None and self.material is not None:
            return self.material.density * self.section.area
        assert self.mass_per_length is not None
        return self.mass_per_length


class ModalSpec(Spec):
    """Modes typed in: frequencies and mass-normalised shapes at named points."""

    kind: Literal["modal"] = "modal"
    """Kind of structure: "modal"."""
    frequencies: tuple[FrequencyOrZero, ...] = Field(min_length=1)
    """Natural frequencies of the undamped structure [Hz], ascending, >= 0; 0 is a rigid-body mode."""
    shapes: dict[str, tuple[ModeShapeValue, ...]] = Field(min_length=1)
    """Mass-normalised mode shapes [kg^-1/2]: for each named point one value per mode, in the order of frequencies."""
    damping: DampingSpec = ModalDampingSpec()
    """Damping of the structure without dampers, kind = "modal" or "rayleigh"; default: none."""

    @model_validator(mode="after")
    def _shapes_fit(self) -> Self:
        n_mode = len(self.frequencies)
        for number, (lower, upper) in enumerate(zip(self.frequencies, self.frequencies[1:], strict=False), 2):
            if upper < lower:
                raise InputError(
                    f"frequencies[{number}] is {upper:g} Hz after {lower:g} Hz; give them in ascending order"
                )
        for point, values in self.shapes.items():
            if len(values) != n_mode:
                raise InputError(
                    f"shapes.{point} has {len(values)} values; allowed is one per frequency, that is {n_mode}"
                )
        return self


class UffSpec(Spec):
    """Modes read from a universal file: real normal modes of dataset 55."""

    kind: Literal["uff"] = "uff"
    """Kind of structure: "uff"."""
    file: str = Field(min_length=1)
    """Universal file (.uff .unv), relative to this description."""
    damping: DampingSpec | None = None
    """Damping in place of the file's, kind = "modal" or "rayleigh"; default: the damping ratios in the file."""


StructureSpec = Annotated[BeamSpec | ModalSpec | UffSpec, Field(discriminator="kind")]
