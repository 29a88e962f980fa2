"""Description of structure and particles simulated together: structure, dampers, how it starts, forces."""

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from graindamp.spec.model import Spec
from graindamp.spec.project import Point
from graindamp.spec.quantity import (
    Coordinate,
    Direction,
    Duration,
    DurationOrZero,
    Force,
    Frequency,
    MassOrZero,
    Phase,
    Point3,
)
from graindamp.spec.simulation import DamperSpec
from graindamp.spec.structure import StructureSpec


class CarriedSpec(Spec):
    """A damper on the structure, its particles simulated."""

    name: str = "damper"
    """Name of the damper in tables and figures; each damper needs its own."""
    point: Point
    """Where it is fixed: a position on a beam such as "244 mm", or the name of a point of the modes."""
    damper: DamperSpec | None = None
    """Container and particles. Give damper or file."""
    file: str | None = None
    """File with a table [damper], such as that of `graindamp simulate`, relative to this description."""
    direction: Direction = (1.0, 0.0, 0.0)
    """Direction in which the point moves, in the damper's axes: "x", "-z" and the like, or a vector; default "x"."""
    along: Direction | None = None
    """Direction of the beam in the damper's axes, across `direction`: the container then turns with the slope of the
    beam. Default: it only moves to and fro."""
    pivot: Point3 = (0.0, 0.0, 0.0)
    """Place of the beam's point in the damper's axes [m], about which the container turns; default: their origin."""
    container_mass: MassOrZero = 0.0
    """Mass of the empty container [kg], >= 0, as far as the structure does not include it yet."""

    @model_validator(mode="after")
    def _one_source(self) -> Self:
        if (self.damper is None) == (self.file is None):
            raise ValueError(f"damper '{self.name}' needs either damper (a table) or file, and not both")
        return self


class ReleaseSpec(Spec):
    """A structure held displaced and let go at time 0."""

    point: Point
    """Where it is held."""
    displacement: Coordinate
    """Displacement of that point from its equilibrium [m]."""
    mode: int | None = Field(default=None, ge=1)
    """Number of the only elastic mode in the shape, from 1; default: the shape that a force at the point bends it to,
    which only a structure that cannot move as a whole has."""


class HarmonicForceSpec(Spec):
    """A sine."""

    kind: Literal["harmonic"] = "harmonic"
    """Kind of force: "harmonic"."""
    point: Point
    """Where it acts."""
    amplitude: Force
    """Amplitude (peak) [N], > 0."""
    frequency: Frequency
    """Frequency [Hz], > 0."""
    phase: Phase = 0.0
    """Phase [rad]."""
    soft_start: DurationOrZero = 0.0
    """Time over which it rises [s], >= 0."""


class SweptForceSpec(Spec):
    """A sine of running frequency."""

    kind: Literal["sweep"]
    """Kind of force: "sweep"."""
    point: Point
    """Where it acts."""
    amplitude: Force
    """Amplitude (peak) [N], > 0."""
    start: Frequency
    """First frequency [Hz], > 0."""
    stop: Frequency
    """Last frequency [Hz], > 0; may be below the first."""
    duration: Duration
    """Time from the first to the last [s], > 0; no force after it."""
    law: Literal["linear", "log"] = "linear"
    """How frequency runs over time: "linear" or "log"."""
    soft_start: DurationOrZero = 0.0
    """Time over which it rises [s], >= 0."""


class SampledForceSpec(Spec):
    """A force from a file, joined by straight lines; none after its last sample."""

    kind: Literal["series"]
    """Kind of force: "series"."""
    point: Point
    """Where it acts."""
    file: str = Field(min_length=1, pattern=r"\.([cC][sS][vV]|[nN][pP][zZ])$")
    """File (.csv or .npz) with a column of evenly spaced times [s] and one of values, relative to this description. The
    first sample acts at the start, whatever its time."""
    unit: str | None = None
    """Unit of the values, such as "kN"; default: N."""
    time_column: str = "time"
    """Name of the column, or array, of times."""
    value_column: str | None = None
    """Name of the column, or array, of values; default: the one beside the times."""


ForceSpec = Annotated[HarmonicForceSpec | SweptForceSpec | SampledForceSpec, Field(discriminator="kind")]


class TogetherRunSpec(Spec):
    """How long, and what is written down."""

    duration: Duration
    """Time to follow [s], > 0."""
    sample_rate: Frequency | None = None
    """Samples per second of motion and force [Hz]; default: 40 per period of the highest mode, 1 kHz at least."""
    steps_per_contact: int = Field(default=40, ge=10, le=1000)
    """Time steps in the shortest contact, 10 to 1000."""
    time_step: Duration | None = None
    """Largest time step [s]; default: by steps_per_contact."""
    snapshots: int = Field(default=1, ge=1, le=400)
    """Times at which all particles are written down, evenly spread, the last at the end, 1 to 400."""


class CosimulationSpec(Spec):
    """Structure and particles simulated together."""

    title: str = "Structure and particles together"
    """Heading of the report."""
    structure: StructureSpec
    """What vibrates: kind = "beam", "modal" or "uff"."""
    dampers: tuple[CarriedSpec, ...] = Field(min_length=1)
    """Dampers on it, at least one ([[dampers]] in the file)."""
    release: ReleaseSpec | None = None
    """How it is let go; default: it starts from rest."""
    forces: tuple[ForceSpec, ...] = ()
    """Forces on it ([[forces]] in the file)."""
    outputs: tuple[Point, ...] = ()
    """Points whose motion is written down besides those of the dampers."""
    run: TogetherRunSpec
    """How long, and what is written down."""

    @model_validator(mode="after")
    def _moves(self) -> Self:
        names = [damper.name for damper in self.dampers]
        double = {name for name in names if names.count(name) > 1}
        if double:
            raise ValueError(f"two dampers are called '{sorted(double)[0]}'; give each its own name")
        if self.release is None and not self.forces:
            raise ValueError("nothing moves the structure; give [release], or [[forces]]")
        return self
