"""Description of how the container moves: prescribed translation, the same for all its walls."""

import math
from collections.abc import Sequence
from typing import Annotated, Any, Literal, Self

from pydantic import BeforeValidator, Field, model_validator

from graindamp.errors import InputError
from graindamp.spec.model import Spec
from graindamp.spec.quantity import (
    Direction,
    Duration,
    Frequency,
    Intensity,
    Length,
    Number,
    Phase,
    SpectralDensity,
    Speed,
)
from graindamp.units import STANDARD_GRAVITY

MOST_WAVES = 1000
"""Harmonics and spectral lines are refused above this number [-]: the engine adds them all up in every time step."""


class _Strength(Spec):
    """How strong a harmonic motion is: exactly one of three. Abstract; harmonics and sweeps share it."""

    intensity: Intensity | None = None
    """Intensity Gamma, acceleration amplitude over standard gravity [-], > 0, or an acceleration such as "40 g"."""
    amplitude: Length | None = None
    """Displacement amplitude X [m], > 0."""
    speed: Speed | None = None
    """Velocity amplitude V [m/s], > 0."""

    @model_validator(mode="after")
    def _exactly_one(self) -> Self:
        names = ("intensity", "amplitude", "speed")
        given = [name for name in names if getattr(self, name) is not None]
        if len(given) != 1:
            raise InputError(
                f"give exactly one of intensity, amplitude and speed; given: {', '.join(given) or 'none of them'}"
            )
        return self

    def acceleration_amplitude(self, frequency: float) -> float:
        """Acceleration amplitude at `frequency` [Hz], in [m/s^2]."""
        omega = 2.0 * math.pi * frequency
        if self.intensity is not None:
            return self.intensity * STANDARD_GRAVITY
        if self.amplitude is not None:
            return self.amplitude * omega**2
        assert self.speed is not None
        return self.speed * omega


class HarmonicMotion(_Strength):
    """One sine: displacement X sin(2 pi f t + phase) along the direction."""

    kind: Literal["harmonic"] = "harmonic"
    """Kind of motion: "harmonic"."""
    frequency: Frequency
    """Frequency f [Hz], > 0."""
    direction: Direction = (1.0, 0.0, 0.0)
    """Direction of the motion: "x", "-z" and the like, or a vector; default "x"."""
    phase: Phase = 0.0
    """Phase of the displacement at the start [rad]."""
    soft_start: Number = Field(default=0.0, ge=0)
    """Cycles over which the motion grows smoothly to its strength [-], >= 0; 0 starts at full speed."""

    @property
    def base_frequency(self) -> float:
        """Frequency that cycles are counted by [Hz]."""
        return self.frequency


class HarmonicComponent(_Strength):
    """One sine of several."""

    frequency: Frequency
    """Frequency [Hz], > 0."""
    phase: Phase = 0.0
    """Phase of the displacement at the start [rad]."""
    direction: Direction | None = None
    """Direction of this component; default: that of the motion. Two directions make circles and ellipses."""


class HarmonicsMotion(Spec):
    """Several sines at once, in one direction or in several."""

    kind: Literal["harmonics"] = "harmonics"
    """Kind of motion: "harmonics"."""
    components: tuple[HarmonicComponent, ...] = Field(min_length=1, max_length=MOST_WAVES)
    """The sines, 1 to 1000 ([[motion.components]] in the file); cycles are counted by the lowest frequency."""
    direction: Direction = (1.0, 0.0, 0.0)
    """Direction of the components that give none: "x", "-z" and the like, or a vector; default "x"."""
    soft_start: Number = Field(default=0.0, ge=0)
    """Cycles of the lowest frequency over which the motion grows smoothly to its strength [-], >= 0."""

    @property
    def base_frequency(self) -> float:
        """Frequency that cycles are counted by, the lowest [Hz]."""
        return min(component.frequency for component in self.components)


class SweepMotion(_Strength):
    """A sine whose frequency runs from start to stop, at constant intensity, amplitude or speed."""

    kind: Literal["sweep"] = "sweep"
    """Kind of motion: "sweep"."""
    start: Frequency
    """First frequency [Hz], > 0."""
    stop: Frequency
    """Last frequency [Hz], > 0; below start for a sweep downwards."""
    duration: Duration
    """Duration of the sweep [s], > 0."""
    law: Literal["linear", "log"] = "linear"
    """How the frequency runs: "linear" in time, or "log" with equal times per octave."""
    direction: Direction = (1.0, 0.0, 0.0)
    """Direction of the motion: "x", "-z" and the like, or a vector; default "x"."""

    @model_validator(mode="after")
    def _moves(self) -> Self:
        if self.start == self.stop:
            raise InputError(f'start and stop are both {self.start:g} Hz; for one frequency choose kind = "harmonic"')
        return self


class SeriesMotion(Spec):
    """A measured or computed motion from a file."""

    kind: Literal["series"] = "series"
    """Kind of motion: "series"."""
    file: str = Field(min_length=1, pattern=r"\.([cC][sS][vV]|[nN][pP][zZ])$")
    """File (.csv or .npz) with a column of times [s] and one of values, relative to this description."""
    quantity: Literal["acceleration", "velocity", "displacement"] = "acceleration"
    """What the values are: "acceleration", "velocity" or "displacement". Displacements are differentiated twice and
    should be smooth."""
    unit: str | None = None
    """Unit of the values, such as "g" or "mm/s"; default: SI."""
    time_column: str = "time"
    """Name of the column, or array, of times."""
    value_column: str | None = None
    """Name of the column, or array, of values; default: the one beside the times."""
    direction: Direction = (1.0, 0.0, 0.0)
    """Direction of the motion: "x", "-z" and the like, or a vector; default "x"."""


def _two_or_more(value: Any) -> Any:
    if isinstance(value, Sequence) and not isinstance(value, str) and len(value) < 2:
        raise ValueError("expected at least two values, the ends of the band")
    return value


class RandomMotion(Spec):
    """Stationary Gaussian acceleration of given spectral density: a sum of sines of random phase on a fine grid of
    frequencies."""

    kind: Literal["random"] = "random"
    """Kind of motion: "random"."""
    frequencies: Annotated[tuple[Frequency, ...], BeforeValidator(_two_or_more)]
    """Corner frequencies of the spectrum [Hz], > 0, ascending; nothing moves beyond the first and the last."""
    psd: Annotated[tuple[SpectralDensity, ...], BeforeValidator(_two_or_more)]
    """One-sided spectral density of acceleration at each corner [(m/s^2)^2/Hz], > 0, or with a unit, "0.04 g^2/Hz";
    linear between corners on two logarithmic axes."""
    duration: Duration
    """Duration [s], > 0; the motion repeats after it, so that its spectrum has lines 1/duration apart."""
    seed: int = Field(default=0, ge=0)
    """Seed of the phases, >= 0; another seed gives another sample of the same process."""
    direction: Direction = (1.0, 0.0, 0.0)
    """Direction of the motion: "x", "-z" and the like, or a vector; default "x"."""

    @model_validator(mode="after")
    def _fits(self) -> Self:
        if len(self.frequencies) != len(self.psd):
            raise InputError(f"frequencies has {len(self.frequencies)} and psd {len(self.psd)} values; give as many")
        if any(b <= a for a, b in zip(self.frequencies, self.frequencies[1:], strict=False)):
            raise InputError(f"frequencies must ascend, given {', '.join(f'{f:g}' for f in self.frequencies)} Hz")
        if not any(self.psd):
            raise InputError('psd is 0 everywhere; for a container at rest choose kind = "rest"')
        for f, density in zip(self.frequencies, self.psd, strict=True):
            if density == 0:
                raise InputError(
                    f"psd is 0 at {f:g} Hz, which has no place on a logarithmic axis; let frequencies end before it, "
                    "or give a small value"
                )
        if self.duration * (self.frequencies[-1] - self.frequencies[0]) < 1:
            raise InputError(
                f"spectral lines 1/{self.duration:g} Hz apart leave none between {self.frequencies[0]:g} and "
                f"{self.frequencies[-1]:g} Hz; give a longer duration"
            )
        return self


class RestMotion(Spec):
    """A container that stands still, for settling, packing and free cooling."""

    kind: Literal["rest"] = "rest"
    """Kind of motion: "rest"."""


MotionSpec = Annotated[
    HarmonicMotion | HarmonicsMotion | SweepMotion | SeriesMotion | RandomMotion | RestMotion,
    Field(discriminator="kind"),
]
