"""Complex power of a shaken damper: from force and motion to loss factor and effective mass with standard errors.

Amplitudes are peak values, time convention exp(+i Omega t), force exerted ON the container. With the container's own
mass removed the apparent mass F/A of the bed is m_bed (m' - i eta): its imaginary part is what the bed dissipates, its
real part what it weighs. Source: Meyer & Seifried (2021), Granular Matter 23, 64, Eqs 1-5, with m' in place
of their modulus.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from graindamp.errors import InputError
from graindamp.signals import fit
from graindamp.signals.checks import (
    LARGEST_INTENSITY,
    LARGEST_STROKE,
    ORDER,
    Problem,
    check_samples,
    check_shape,
    find_frequency,
)
from graindamp.signals.phase import EmptyRun, PhaseCalibration, calibrate
from graindamp.signals.record import Record
from graindamp.signals.steady import MIN_CYCLES, steady_mean, transient_length
from graindamp.status import Status
from graindamp.units import intensity

Real = NDArray[np.float64]
NAN = float("nan")

AMPLITUDE_SPREAD = 0.1
"""Range of the motion's amplitude over the cycles used, over its mean, above which it is flagged [-]."""


LEAST_FORCE = 0.1
"""Force over that of the empty container's inertia below which a unit is doubted [-]: a bed that takes away so much of
it is not to be expected."""


class Steady(NamedTuple):
    """The part of a record that is used, and its harmonics."""

    frequency: float
    """Driving frequency [Hz]."""
    first: int
    """First sample used."""
    last: int
    """One past the last sample used."""
    n_skipped: int
    """Cycles dropped at the start."""
    force: NDArray[np.complex128]
    """Amplitudes of the force [N], offset first, about the first sample of the record; shape (1 + harmonic,)."""
    velocity: NDArray[np.complex128]
    """Amplitudes of the velocity [m/s], likewise."""
    cycle_mass: NDArray[np.complex128]
    """Apparent mass of container and bed, cycle by cycle [kg]; shape (cycle,)."""
    problems: tuple[Problem, ...]


class OperatingPoint(NamedTuple):
    """What one record says. NaN where a fatal problem leaves no value."""

    label: str
    """Name of the run."""
    frequency: float
    """Driving frequency [Hz]."""
    intensity: float = NAN
    """Acceleration amplitude over standard gravity, Gamma [-]."""
    nominal_intensity: float | None = None
    """Intensity the rig was set to [-], if the record tells."""
    velocity_amplitude: float = NAN
    """Peak velocity V of the fundamental [m/s]."""
    power: float = NAN
    """Mean dissipated power Re P = 1/2 Re(F conj V) of the fundamental [W]."""
    dissipated_energy: float = NAN
    """Per cycle, power / f = pi eta m_bed V^2 [J]."""
    loss_factor: float = NAN
    """eta = power / Omega over m_bed V^2 / 2 [-]; energy dissipated per radian over kinetic energy of the bed."""
    loss_factor_error: float = NAN
    """Standard error of eta [-]: scatter over cycles with their correlation, drift, and phase error."""
    effective_mass_ratio: float = NAN
    """In-phase part of the bed's apparent mass over m_bed, m' [-]; may be negative."""
    effective_mass_ratio_error: float = NAN
    """Standard error of m' [-]."""
    modulus_ratio: float = NAN
    """Modulus of the bed's apparent mass over m_bed, the effective mass of Meyer & Seifried (2021) [-]."""
    viscous_coefficient: float = NAN
    """Equivalent viscous coefficient d_eff = eta m_bed Omega [N s/m]."""
    harmonic_power: Real = np.empty(0)
    """Mean power of each harmonic of the drive [W], fundamental first; their sum is the whole power of a periodic
    motion (Wong & Rongong 2009, Eqs 1-2)."""
    cycle_loss_factor: Real = np.empty(0)
    """Eta of each cycle used [-]."""
    cycle_mass_ratio: Real = np.empty(0)
    """m' of each cycle used [-]."""
    n_cycle: int = 0
    """Cycles used."""
    n_skipped: int = 0
    """Cycles dropped as transient."""
    phase_correction: float = 0.0
    """Angle taken from the force [rad]."""
    phase_error: float = NAN
    """Standard error of that angle, or the one assumed without an empty-container run [rad]."""
    problems: tuple[Problem, ...] = ()

    @property
    def status(self) -> Status:
        """All bits of :attr:`problems` together."""
        status = Status.OK
        for problem in self.problems:
            status |= problem.status
        return status

    @property
    def energy_per_radian(self) -> float:
        """Dissipated energy per radian, power / Omega [J], the E_diss of Meyer & Seifried (2021)."""
        return self.dissipated_energy / (2 * np.pi)


def steady_part(record: Record, skip_cycles: int | None = None) -> Steady | list[Problem]:
    """Frequency, transient and harmonics of a record, or the fatal problems that forbid them.

    Args:
        record: force and motion, any of the three motion kinds.
        skip_cycles: cycles to drop at the start; None: detect the transient.
    """
    problems = check_samples(record)
    if any(problem.is_fatal for problem in problems):
        return problems
    frequency, found = find_frequency(record)
    problems += found
    if np.isnan(frequency):
        return problems
    signals = np.column_stack([record.force, record.motion])
    to_velocity = (2j * np.pi * frequency) ** -ORDER[record.motion_kind]
    cycles = fit.fit_cycles(signals, record.sampling_rate, frequency)
    mass = cycles.amplitude[:, 0] / (2j * np.pi * frequency * to_velocity * cycles.amplitude[:, 1])
    size = np.abs(cycles.amplitude[:, 1])
    moving = np.flatnonzero(size > 0.5 * np.median(size[size > 0.1 * size.max()]))
    begin, end = int(moving[0]), int(moving[-1]) + 1  # a record may start and end at rest
    n_skipped = begin + transient_length(mass[begin:end]) if skip_cycles is None else skip_cycles
    if end - n_skipped < MIN_CYCLES:
        text = f"{end} whole cycles of {frequency:.4g} Hz less {n_skipped} skipped, {MIN_CYCLES} are needed"
        return [*problems, Problem(Status.TOO_SHORT, text)]
    n_skipped += (end - n_skipped) % 2  # a bed that answers with half the driving frequency repeats after two cycles
    first, last = int(cycles.start[n_skipped]), int(cycles.start[end])
    problems += check_shape(record, frequency, first, last)
    mass, size = mass[n_skipped:end], size[n_skipped:end]
    if np.ptp(size) > AMPLITUDE_SPREAD * size.mean():
        text = f"the amplitude of the motion varies by {100 * np.ptp(size) / size.mean():.2g} % over the cycles used"
        problems.append(Problem(Status.AMPLITUDE_DRIFT, text))
    if any(problem.is_fatal for problem in problems):
        return problems
    time = np.arange(first, last) / record.sampling_rate
    n_harmonic = fit.n_harmonic_of(record.sampling_rate, frequency, 10)
    amplitude = fit.harmonics(signals[first:last], time, frequency, n_harmonic)
    order = np.maximum(np.arange(1 + n_harmonic), 1)
    velocity = amplitude[:, 1] * (2j * np.pi * frequency * order) ** -ORDER[record.motion_kind]
    return Steady(frequency, first, last, n_skipped, amplitude[:, 0], velocity, mass, tuple(problems))


def analyze(
    record: Record,
    bed_mass: float,
    container_mass: float,
    calibration: PhaseCalibration | None = None,
    phase_uncertainty: float = np.deg2rad(1.0),
    skip_cycles: int | None = None,
) -> OperatingPoint:
    """Loss factor, effective mass and all that goes with them from one record; problems are named, not raised.

    Args:
        record: force and motion of the filled container.
        bed_mass: mass of all particles [kg].
        container_mass: mass of the empty container beyond the force sensor [kg], removed from the result.
        calibration: phase of the channels from empty-container runs.
        phase_uncertainty: phase error assumed without calibration [rad]; it is part of the standard errors.
        skip_cycles: cycles to drop at the start; None: detect the transient.
    """
    steady = steady_part(record, skip_cycles)
    if isinstance(steady, list):
        frequency = record.frequency or NAN
        return OperatingPoint(
            record.label, frequency, nominal_intensity=record.nominal_intensity, problems=tuple(steady)
        )
    omega = 2 * np.pi * steady.frequency
    phase, phase_error = calibration.at(steady.frequency) if calibration else (0.0, phase_uncertainty)
    order = np.arange(len(steady.force))
    power = 0.5 * (steady.force * np.exp(-1j * order * phase) * steady.velocity.conj()).real[1:]
    total = steady.force[1] * np.exp(-1j * phase) / (1j * omega * steady.velocity[1])
    mass = (total - container_mass) / bed_mass
    per_cycle = (steady.cycle_mass * np.exp(-1j * phase) - container_mass) / bed_mass
    loss, inertia = steady_mean(-per_cycle.imag), steady_mean(per_cycle.real)
    size = abs(steady.velocity[1])
    phase_effect = phase_error * abs(total.real) / bed_mass
    loss_error = float(np.hypot(loss.standard_error, phase_effect))
    inertia_error = float(np.hypot(inertia.standard_error, phase_error * abs(total.imag) / bed_mass))
    eta = -float(mass.imag)
    problems = list(steady.problems)
    if not (loss.is_steady and inertia.is_steady):
        text = f"eta or m' still changes over the {len(per_cycle)} cycles used; the errors include the drift"
        problems.append(Problem(Status.NOT_STEADY, text))
    if phase_effect > 0.05 * abs(eta):
        origin = "left after calibration" if calibration else "assumed, as there is no empty-container run,"
        text = (
            f"a phase error of {np.rad2deg(phase_error):.2g} deg {origin} changes eta = {eta:.3g} by "
            f"{phase_effect:.2g} ({100 * phase_effect / max(abs(eta), 1e-12):.0f} %, more than 5 %)"
        )
        problems.append(Problem(Status.PHASE_UNCERTAIN, text))
    gamma, stroke = intensity(omega * size), size / omega
    if gamma > LARGEST_INTENSITY or stroke > LARGEST_STROKE:
        text = f"the container moves with Gamma = {gamma:.3g} and a stroke of {stroke:.3g} m"
        problems.append(Problem(Status.IMPLAUSIBLE, f"{text}; is its unit right?"))
    if abs(total) < LEAST_FORCE * container_mass:
        text = (
            f"the force is that of a mass of {abs(total):.3g} kg, nothing beside a container of {container_mass:.3g} kg"
        )
        problems.append(Problem(Status.IMPLAUSIBLE, f"{text}; are units and mass right?"))
    if eta < -3 * loss_error:
        problems.append(Problem(Status.NOT_PASSIVE, f"eta = {eta:.3g} +- {loss_error:.2g} is negative"))
    return OperatingPoint(
        label=record.label,
        frequency=record.frequency or steady.frequency,
        intensity=gamma,
        nominal_intensity=record.nominal_intensity,
        velocity_amplitude=size,
        power=float(power[0]),
        dissipated_energy=float(power[0] / steady.frequency),
        loss_factor=eta,
        loss_factor_error=loss_error,
        effective_mass_ratio=float(mass.real),
        effective_mass_ratio_error=inertia_error,
        modulus_ratio=abs(mass),
        viscous_coefficient=eta * bed_mass * omega,
        harmonic_power=power,
        cycle_loss_factor=-per_cycle.imag,
        cycle_mass_ratio=per_cycle.real,
        n_cycle=len(per_cycle),
        n_skipped=steady.n_skipped,
        phase_correction=phase,
        phase_error=phase_error,
        problems=tuple(problems),
    )


def calibration_from(records: Sequence[Record], container_mass: float | None) -> tuple[PhaseCalibration, list[Problem]]:
    """Phase calibration from records of the empty container, and what is suspicious about them.

    Args:
        records: empty-container runs, at least one.
        container_mass: mass they should show [kg]; None where the runs themselves are to tell it.

    Raises:
        InputError: a record cannot be used, with the reason.
    """
    runs = []
    for record in records:
        steady = steady_part(record, skip_cycles=None)
        if isinstance(steady, list):
            raise InputError(f"{record.source}: empty-container run cannot be used: {steady[0].text}")
        total = steady.force[1] / (2j * np.pi * steady.frequency * steady.velocity[1])
        angle = steady_mean(np.angle(steady.cycle_mass / total), floor=1.0)
        runs.append(EmptyRun(steady.frequency, complex(total), angle.standard_error))
    calibration = calibrate(runs)
    problems = []
    if container_mass:
        deviation = calibration.mass / container_mass - 1
        worst = int(np.argmax(np.abs(deviation)))
        if abs(deviation[worst]) > 0.02:
            text = (
                f"the empty container weighs {1e3 * calibration.mass[worst]:.4g} g at {calibration.frequency[worst]:g}"
                f" Hz, {1e3 * container_mass:.4g} g is given ({100 * deviation[worst]:+.1f} %); the given mass is used"
            )
            problems.append(Problem(Status.MASS_MISMATCH, text))
    return calibration, problems
