"""Description of a prediction: structure, dampers on it, force, and what to compute."""

from typing import Literal, Self

from pydantic import Field, model_validator

from graindamp.spec.model import Spec
from graindamp.spec.quantity import (
    Force,
    Frequency,
    FrictionCoefficient,
    Intensity,
    Length,
    Mass,
    MassOrZero,
    Position,
    Restitution,
)
from graindamp.spec.structure import StructureSpec

Point = str | float
"""A place on the structure: a position on a beam ("1.765 m" or 1.765), or the name of a point of the modes."""


class IdealFieldSpec(Spec):
    """A field from closed-form theory in place of a measured or simulated one."""

    motion: Literal["bouncing", "sliding", "bouncing-vertical", "frozen"]
    """How the bed moves: bouncing, sliding, bouncing-vertical or frozen."""
    clearance: Length | None = None
    """Free travel h of the bed [m], > 0; needed for bouncing."""
    restitution: Restitution = 0.0
    """Coefficient of restitution of bed and end wall [-], 0 to below 1; for bouncing."""
    friction: FrictionCoefficient | None = None
    """Coefficient of friction of bed and floor [-], > 0; needed for sliding."""
    frequency_range: tuple[Frequency, Frequency] = (10.0, 1000.0)
    """Lowest and highest frequency [Hz], > 0."""
    intensity_range: tuple[Intensity, Intensity] = (0.1, 100.0)
    """Lowest and highest intensity [-], > 0."""
    n_point: int = Field(default=40, ge=2, le=400)
    """Points along each axis, 2 to 400."""

    @model_validator(mode="after")
    def _complete(self) -> Self:
        needed = {"bouncing": "clearance", "sliding": "friction"}.get(self.motion)
        if needed and getattr(self, needed) is None:
            raise ValueError(f"motion '{self.motion}' needs {needed}")
        for name in ("frequency_range", "intensity_range"):
            low, high = getattr(self, name)
            if low >= high:
                raise ValueError(f"{name} must ascend, given {low:g} to {high:g}")
        return self


class AttachedSpec(Spec):
    """A damper fixed to the structure."""

    name: str = "damper"
    """Name of the damper in tables and figures; each damper needs its own."""
    point: Point
    """Where it is fixed: a position on a beam such as "1.765 m", or the name of a point of the modes."""
    field: str | None = None
    """File of its effective field (.nc or .csv), relative to the project file. Give field or ideal."""
    ideal: IdealFieldSpec | None = None
    """A field from closed-form theory. Give field or ideal."""
    bed_mass: Mass | None = None
    """Mass of all particles [kg], > 0; default: that of the field. Another one assumes that loss factor and effective
    mass ratio do not change with the size of the bed."""
    container_mass: MassOrZero = 0.0
    """Mass of the empty container [kg], >= 0, as far as the structure does not include it yet."""

    @model_validator(mode="after")
    def _one_source(self) -> Self:
        if (self.field is None) == (self.ideal is None):
            raise ValueError(f"damper '{self.name}' needs either field or ideal, and not both")
        if self.ideal is not None and self.bed_mass is None:
            raise ValueError(f"damper '{self.name}' has an ideal field and needs bed_mass")
        return self


class DriveSpec(Spec):
    """Harmonic force on the structure."""

    point: Point
    """Where it acts: a position on a beam such as "0.05 m", or the name of a point of the modes."""
    force: Force | tuple[Force, ...]
    """Force amplitude (peak) [N], > 0, or a list of them."""

    @model_validator(mode="after")
    def _has_a_force(self) -> Self:
        if self.force == ():
            raise ValueError("force is an empty list; at least one force is needed, such as '1 N'")
        return self

    @property
    def forces(self) -> tuple[float, ...]:
        """Force amplitudes in ascending order [N]."""
        return tuple(sorted(self.force)) if isinstance(self.force, tuple) else (self.force,)


class ResponseSpec(Spec):
    """A frequency response at fixed force."""

    band: tuple[Frequency, Frequency]
    """Lowest and highest frequency [Hz], > 0, ascending."""
    output: Point | None = None
    """Observed point; default: that of the first damper."""
    n_frequency: int = Field(default=300, ge=2, le=20000)
    """Frequencies spread evenly over the band, 2 to 20000; more are added about each resonance."""

    @model_validator(mode="after")
    def _ascends(self) -> Self:
        if self.band[0] >= self.band[1]:
            raise ValueError(f"band must ascend, given {self.band[0]:g} to {self.band[1]:g} Hz")
        return self


class PositionStudySpec(Spec):
    """The first damper moved along a beam, its container with it."""

    start: Position
    """First position [m], >= 0."""
    stop: Position
    """Last position [m], above start."""
    n_position: int = Field(default=37, ge=2, le=2000)
    """Number of positions, 2 to 2000."""

    @model_validator(mode="after")
    def _ascends(self) -> Self:
        if self.start >= self.stop:
            raise ValueError(f"stop must lie above start, given {self.start:g} m to {self.stop:g} m")
        return self


class ProjectSpec(Spec):
    """What to predict."""

    title: str = "Damping prediction"
    """Heading of the report."""
    structure: StructureSpec
    """What vibrates: a beam, modes typed in, or modes in a UFF file."""
    dampers: tuple[AttachedSpec, ...] = Field(min_length=1)
    """Dampers fixed to it, at least one ([[dampers]] in the file)."""
    drive: DriveSpec
    """The harmonic force."""
    outside: Literal["refuse", "constant", "linear"] = "refuse"
    """What to do outside the points of a field: refuse, hold its edge constant, or continue linearly; marked either
    way."""
    response: ResponseSpec | None = None
    """A frequency response to compute; default: none."""
    force_study: tuple[Force, ...] = ()
    """Force amplitudes of a force study [N], > 0; default: none."""
    position_study: PositionStudySpec | None = None
    """Positions of a position study on a beam; default: none."""

    @model_validator(mode="after")
    def _names_differ(self) -> Self:
        names = [damper.name for damper in self.dampers]
        if len(set(names)) < len(names):
            raise ValueError(f"every damper needs a name of its own, given {', '.join(names)}")
        if self.position_study is not None and self.structure.kind != "beam":
            raise ValueError(f"a position study needs a structure of kind 'beam', given '{self.structure.kind}'")
        return self
