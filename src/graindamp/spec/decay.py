"""Description of a free decay: files, masses, and how peaks are found."""

from typing import Literal

from pydantic import Field, model_validator

from graindamp.spec.measurement import ChannelsSpec
from graindamp.spec.model import Spec
from graindamp.spec.quantity import DurationOrZero, Fraction, Frequency, Length, Mass

PeakMethod = Literal["polynomial", "parabola", "samples"]
BaselineKind = Literal["none", "constant", "linear"]


class DecayMethodSpec(Spec):
    """How a record of a free decay is turned into peaks."""

    peaks: PeakMethod = "polynomial"
    """Peaks by a polynomial of degree 6 over a third of a cycle, a parabola through three samples, or bare samples."""
    baseline: BaselineKind = "linear"
    """What is removed as offset: a straight line over time, a constant, or nothing."""
    moving_average: int = Field(default=3, ge=1, le=99)
    """Values of Psi averaged, odd, 1 for none; default 3, as in Witt (2011)."""
    noise_factor: float = Field(default=10.0, gt=1)
    """The decay ends where its amplitude is this many standard errors of a peak [-], > 1; default 10."""
    filter_cycles: int = Field(default=0, ge=0, le=100)
    """Length of a band-pass about the oscillation in cycles, >= 2; takes half of them at each end; default 0, none."""
    frequency: Frequency | None = None
    """Frequency of the oscillation [Hz], > 0, where it is not the strongest; default: found."""
    start: DurationOrZero | None = None
    """Time after which the decay begins, from the first sample [s], >= 0; default: the largest peak."""
    end: DurationOrZero | None = None
    """Time at which it ends at the latest, from the first sample [s]; default: the last sample."""

    @model_validator(mode="after")
    def _check_counts(self) -> "DecayMethodSpec":
        if self.moving_average % 2 == 0:
            raise ValueError(f"moving_average is {self.moving_average}, but must be odd, 1, 3, 5, ...")
        if self.filter_cycles == 1:
            raise ValueError("filter_cycles is 1, but must be 0 for no filter, or 2 or more")
        if self.start is not None and self.end is not None and self.end <= self.start:
            raise ValueError(f"end is {self.end:g} s, but must be later than start, {self.start:g} s")
        return self


class DecaySpec(Spec):
    """Free decays of one structure with one damper, one or more of the same test."""

    files: tuple[str, ...] = Field(min_length=1)
    """Signal files (.csv .txt .h5 .hdf5 .mat .uff .unv), relative to this description; each record is a repeat."""
    name: str = "free decay"
    """Name of the test in tables and figures."""
    clearance: Length | None = None
    """Free travel d of the particles [m], > 0; amplitudes are then given over it too, alpha = U / d."""
    particle_mass: Mass | None = None
    """Mass of all particles [kg], > 0; with structure_mass, for the mass-normalised Psi_m."""
    structure_mass: Mass | None = None
    """Mass of the structure reduced to the point that is measured [kg], > 0."""
    intrinsic: Fraction = 0.0
    """Specific damping capacity without particles Psi_0 [-], 0 to 1, such as "0.3 %"; taken from Psi; default 0."""
    bins: int = Field(default=20, ge=1, le=1000)
    """Bins of the common amplitude grid in a factor of ten of amplitude; default 20."""
    method: DecayMethodSpec = DecayMethodSpec()
    """How peaks are found."""
    channels: ChannelsSpec = ChannelsSpec()
    """Name, kind and unit of the motion channel, and the sampling rate."""

    @model_validator(mode="after")
    def _check_masses(self) -> "DecaySpec":
        if (self.particle_mass is None) != (self.structure_mass is None):
            missing = "particle_mass" if self.particle_mass is None else "structure_mass"
            raise ValueError(f"{missing} is missing; the mass-normalised Psi_m needs both masses")
        return self

    @property
    def mass_ratio(self) -> float | None:
        """Mass of all particles over that of the structure, mu [-]; None where they are not given."""
        if self.particle_mass is None or self.structure_mass is None:
            return None
        return self.particle_mass / self.structure_mass
