"""Description of a field to simulate: a damper, the operating points, and how well each is to be known."""

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import Annotated, Any, Literal, Self

from pydantic import BeforeValidator, Field, model_validator

from graindamp.errors import InputError
from graindamp.spec.contact import LARGEST_SOFTENING
from graindamp.spec.model import Spec
from graindamp.spec.motion import HarmonicMotion
from graindamp.spec.quantity import Direction, Frequency, Intensity, Number
from graindamp.spec.simulation import DamperSpec, RunSpec, SimulationSpec

MOST_POINTS = 100_000
"""Operating points are refused above this number [-]: a plan of so many is a slip of the pen."""


class FrequencyAxis(Spec):
    """Frequencies spread evenly over their logarithm."""

    start: Frequency
    """Lowest frequency [Hz], > 0."""
    stop: Frequency
    """Highest frequency [Hz], above start."""
    count: int = Field(ge=2, le=1000)
    """Number of frequencies, 2 to 1000."""


class IntensityAxis(Spec):
    """Intensities spread evenly over their logarithm."""

    start: Intensity
    """Lowest intensity Gamma [-], > 0, or an acceleration such as "1 g"."""
    stop: Intensity
    """Highest intensity [-], above start."""
    count: int = Field(ge=2, le=1000)
    """Number of intensities, 2 to 1000."""


def _values(axis: FrequencyAxis | IntensityAxis | tuple[float, ...]) -> tuple[float, ...]:
    """Values of an axis in ascending order."""
    if isinstance(axis, tuple):
        return axis
    ratio = axis.stop / axis.start
    last = axis.count - 1
    return tuple(axis.stop if k == last else axis.start * ratio ** (k / last) for k in range(axis.count))


def _check_axis(axis: FrequencyAxis | IntensityAxis | tuple[float, ...], name: str) -> None:
    if isinstance(axis, tuple):
        if any(b <= a for a, b in pairwise(axis)):
            raise InputError(f"{name} must ascend without repeats, given {', '.join(f'{value:g}' for value in axis)}")
    elif axis.start >= axis.stop:
        raise InputError(f"{name} must ascend, given {axis.start:g} to {axis.stop:g}")


class GridPlan(Spec):
    """Every frequency with every intensity."""

    kind: Literal["grid"] = "grid"
    """Kind of plan: "grid"."""
    frequency: FrequencyAxis | Annotated[tuple[Frequency, ...], Field(min_length=1)]
    """Frequencies [Hz]: a list, or { start, stop, count } spread evenly over the logarithm."""
    intensity: IntensityAxis | Annotated[tuple[Intensity, ...], Field(min_length=1)]
    """Intensities Gamma [-], likewise."""

    @property
    def frequencies(self) -> tuple[float, ...]:
        """Frequencies in ascending order [Hz]."""
        return _values(self.frequency)

    @property
    def intensities(self) -> tuple[float, ...]:
        """Intensities in ascending order [-]."""
        return _values(self.intensity)

    @property
    def points(self) -> tuple[tuple[float, float], ...]:
        """Frequency [Hz] and intensity [-] of every point, intensity running fastest."""
        return tuple((f, gamma) for f in self.frequencies for gamma in self.intensities)

    @model_validator(mode="after")
    def _sensible(self) -> Self:
        _check_axis(self.frequency, "frequency")
        _check_axis(self.intensity, "intensity")
        count = len(self.frequencies) * len(self.intensities)
        if count > MOST_POINTS:
            raise InputError(f"the plan has {count} points; at most {MOST_POINTS} are allowed")
        return self


class ListPlan(Spec):
    """Operating points one by one."""

    kind: Literal["list"]
    """Kind of plan: "list"."""
    points: tuple[tuple[Frequency, Intensity], ...] = Field(min_length=1, max_length=MOST_POINTS)
    """Frequency and intensity of each point, such as [["100 Hz", 20], ["100 Hz", "40 g"]]."""

    @model_validator(mode="after")
    def _differ(self) -> Self:
        _check_differ(self.points)
        return self


class AdaptivePlan(Spec):
    """Points chosen one after another where the field is least certain."""

    kind: Literal["adaptive"]
    """Kind of plan: "adaptive"."""
    frequency_range: tuple[Frequency, Frequency]
    """Lowest and highest frequency [Hz], > 0, ascending."""
    intensity_range: tuple[Intensity, Intensity]
    """Lowest and highest intensity [-], > 0, ascending."""
    accuracy: Number = Field(default=0.05, gt=0, lt=1)
    """Predicted standard error of eta and m' to reach everywhere, over the larger of eta and stop.floor [-], above 0
    and below 1."""
    start_frequencies: int = Field(default=5, ge=2, le=50)
    """Frequencies of the coarse staggered grid it starts from, 2 to 50."""
    start_intensities: int = Field(default=4, ge=2, le=50)
    """Intensities at the first and every second frequency of the coarse grid, one fewer between them, 2 to 50."""
    max_points: int = Field(default=150, ge=4, le=MOST_POINTS)
    """Points after which it ends although the accuracy is not reached, >= 4."""
    max_cost: Annotated[Number, Field(gt=0)] | None = None
    """Cost in particle-steps after which it ends, over that of a grid of 28 frequencies and 15 intensities, as the
    points so far let expect it [-], > 0; default: no limit."""
    max_seconds: Annotated[Number, Field(gt=0)] | None = None
    """Time after which no further points are begun [s], > 0; default: no limit."""

    @model_validator(mode="after")
    def _ascends(self) -> Self:
        for name in ("frequency_range", "intensity_range"):
            low, high = getattr(self, name)
            if low >= high:
                raise InputError(f"{name} must ascend, given {low:g} to {high:g}")
        if self.start_frequencies * self.start_intensities > self.max_points:
            raise InputError(
                f"the coarse grid has {self.start_frequencies * self.start_intensities} points, "
                f"more than max_points, {self.max_points}"
            )
        return self


class StopSpec(Spec):
    """When an operating point has been simulated long enough."""

    tolerance: Number = Field(default=0.02, gt=0, lt=1)
    """Standard error of eta and m' to reach, over the larger of eta and floor [-], above 0 and below 1."""
    floor: Number = Field(default=0.05, gt=0)
    """Size of eta below which its error is held to that of this value [-], > 0."""
    min_cycles: int = Field(default=12, ge=8)
    """Cycles before a run may end, >= 8."""
    max_cycles: int = Field(default=40, ge=8)
    """Cycles after which a run ends although the tolerance is not reached, >= 8; its status then says so."""

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if self.min_cycles > self.max_cycles:
            raise InputError(f"min_cycles is {self.min_cycles}, more than max_cycles, {self.max_cycles}")
        return self


class SofteningSpec(Spec):
    """A few points at several stiffnesses, which say what the chosen softening of the contacts does to the field."""

    points: tuple[tuple[Frequency, Intensity], ...] = Field(min_length=1, max_length=100)
    """Frequency and intensity of each point, such as [["100 Hz", 20], ["500 Hz", 3]]; choose one for each kind of
    motion."""
    factors: tuple[Annotated[Number, Field(ge=1, le=LARGEST_SOFTENING)], ...] = Field(min_length=2, max_length=20)
    """Softenings to compare, ascending, 1 to 10000, at least two; the smallest should be a tenth of the chosen one or
    less. Each costs time steps in proportion to its power -0.4 (linear law: -0.5)."""

    @model_validator(mode="after")
    def _sensible(self) -> Self:
        _check_differ(self.points)
        if any(b <= a for a, b in pairwise(self.factors)):
            raise InputError(f"factors must ascend without repeats, given {', '.join(f'{v:g}' for v in self.factors)}")
        return self


class BedSpec(Spec):
    """A few points with several beds, which say how much the field would differ with another bed."""

    points: tuple[tuple[Frequency, Intensity], ...] = Field(min_length=1, max_length=100)
    """Frequency and intensity of each point, such as [["100 Hz", 20], ["500 Hz", 3]]; choose one for each kind of
    motion, away from where a bounce may be lost."""
    seeds: int = Field(default=3, ge=2, le=100)
    """Beds of the same description that every point is simulated with, 2 to 100."""

    @model_validator(mode="after")
    def _differ(self) -> Self:
        _check_differ(self.points)
        return self


def _check_differ(points: Sequence[tuple[float, float]]) -> None:
    for k, (f, gamma) in enumerate(points):
        if (f, gamma) in points[:k]:
            raise InputError(f"the point {f:g} Hz, {gamma:g} is there twice; keep one")


def _plan(value: Any) -> Any:
    """A plan without a kind is a grid."""
    return {"kind": "grid"} | value if isinstance(value, dict) and "kind" not in value else value


class FieldSpec(Spec):
    """An effective field to simulate."""

    title: str = "Effective field of a particle damper"
    """Heading of the report."""
    damper: DamperSpec
    """Container, particles and contacts."""
    plan: Annotated[
        Annotated[GridPlan | ListPlan | AdaptivePlan, Field(discriminator="kind")],
        BeforeValidator(_plan),
    ]
    """Operating points: kind = "grid", "list" or "adaptive"."""
    direction: Direction = (1.0, 0.0, 0.0)
    """Direction of the motion: "x", "-z" and the like, or a vector; default "x"."""
    stop: StopSpec = StopSpec()
    """When a point has been simulated long enough."""
    seeds: int = Field(default=1, ge=1, le=1000)
    """Beds of the same description that every point is simulated with, 1 to 1000; their scatter enters the error."""
    hysteresis: Literal["none", "intensity", "all"] = "none"
    """Whether every point is also started from the end of its neighbours' runs: of those in intensity, or in frequency
    as well; points that answer differently are marked and keep both values. For plans of kind = "grid"."""
    softening_study: SofteningSpec | None = None
    """What damper.contact.softening does to the field: a few points at several stiffnesses; default: not studied."""
    bed_study: BedSpec | None = None
    """How much other beds of the same description would differ, which enters the errors of the field: a few points with
    several beds; default: not studied."""
    steps_per_contact: int = Field(default=40, ge=10, le=1000)
    """Time steps per shortest contact, 10 to 1000."""

    @model_validator(mode="after")
    def _neighbours_exist(self) -> Self:
        if self.hysteresis != "none" and self.plan.kind != "grid":
            raise InputError(f'hysteresis needs neighbours, a plan of kind = "grid", given "{self.plan.kind}"')
        return self

    def at(self, frequency: float, intensity: float, seed: int = 0) -> SimulationSpec:
        """Description of the simulation of one operating point.

        Args:
            frequency: [Hz].
            intensity: Gamma [-].
            seed: number of the bed, 0 to seeds - 1; added to the seed of the packing.
        """
        packing = self.damper.packing.model_copy(update={"seed": self.damper.packing.seed + seed})
        return SimulationSpec(
            title=f"{self.title}, {frequency:g} Hz, {intensity:g} g",
            damper=self.damper.model_copy(update={"packing": packing}),
            motion=HarmonicMotion(frequency=frequency, intensity=intensity, direction=self.direction),
            run=RunSpec(
                cycles=float(self.stop.max_cycles),
                steps_per_contact=self.steps_per_contact,
                samples_per_cycle=SAMPLES_PER_CYCLE,
            ),
        )


SAMPLES_PER_CYCLE = 40
"""Samples per cycle of the recorded forces in a field [-]: enough for pictures; eta and m' come from every step."""


def logarithmic(low: float, high: float, count: int) -> tuple[float, ...]:
    """Values spread evenly over their logarithm, both ends included."""
    if count == 1:
        return (math.sqrt(low * high),)
    return _values(FrequencyAxis(start=low, stop=high, count=count))
