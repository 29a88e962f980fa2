"""From a simulated run to a record like that of any rig, and to its operating point.

The engine knows the forces of the particles on the walls alone, without the container's own mass. A container without
mass passes on what it gets, so that the force exerted ON it by what drives it is minus the force of the particles on
it. A bed that clings to the container then weighs m' = 1, and one that dissipates has eta > 0.
"""

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from graindamp.signals.checks import Problem, clipped_share
from graindamp.signals.power import OperatingPoint, analyze
from graindamp.signals.record import Record
from graindamp.spec.motion import HarmonicMotion
from graindamp.spec.simulation import SimulationSpec
from graindamp.status import Status
from graindamp.units import intensity

if TYPE_CHECKING:
    from graindamp.dem.run import Run

Real = NDArray[np.float64]

RIPPLE = 1e-12
"""Share of the largest force that is added where the force stays at one value [-], see :func:`record_of`."""


CHANGE = 0.3
"""Change of eta from the first to the last third of the cycles used, over its mean, that is called a change of motion
[-]: three times what the noise of single cycles, 20 %, leaves in means of five."""


class CycleValues(NamedTuple):
    """Loss factor and effective mass ratio of every whole cycle of a run, transient included; each (cycle,)."""

    loss_factor: Real
    """eta of each cycle [-]."""
    effective_mass_ratio: Real
    """m' of each cycle [-]."""


def bed_mass_of(run: "Run") -> float:
    """Mass of all particles [kg]."""
    return float(np.sum(run.mass))


def nominal_intensity_of(spec: SimulationSpec) -> float | None:
    """Intensity Gamma that a harmonic motion is described with [-]; None for other motions."""
    if not isinstance(spec.motion, HarmonicMotion):
        return None
    return intensity(spec.motion.acceleration_amplitude(spec.motion.frequency))


def label_of(spec: SimulationSpec) -> str:
    """Name of a run in files and tables, such as f100_G40; of other than harmonic motions their kind."""
    gamma = nominal_intensity_of(spec)
    return spec.motion.kind if gamma is None else f"f{spec.base_frequency:.6g}_G{gamma:.4g}"


def record_of(run: "Run") -> Record:
    """Force that drives the container, without the container's own mass, and the container's velocity.

    Both along the motion; samples before it starts are left out. A bed in flight leaves the force at 0 for many
    samples, which in a measured record would be the mark of a clipped channel where that is the force's extreme value.
    There a ripple of 1e-12 of the largest force tells them apart.

    Args:
        run: a simulated run.
    """
    direction = np.asarray(run.direction, dtype=np.float64)
    moving = np.asarray(run.time) > 0.0
    force = -np.sum(run.force[moving], axis=1) @ direction
    if len(force) and clipped_share(force) > 0.0:
        force = force + RIPPLE * np.max(np.abs(force)) * np.sin(np.arange(len(force)))
    rate = (len(run.time) - 1) / float(run.time[-1] - run.time[0]) if len(run.time) > 1 else 1.0
    label = label_of(run.spec)
    return Record(
        force=np.ascontiguousarray(force),
        motion=np.ascontiguousarray(run.velocity[moving] @ direction),
        motion_kind="velocity",
        sampling_rate=rate,
        motion_rate=rate,
        frequency=run.frequency,
        nominal_intensity=nominal_intensity_of(run.spec),
        label=label,
        source=f"simulation:{label}",
        container_mass=0.0,
        bed_mass=bed_mass_of(run),
    )


def point_of(run: "Run", skip_cycles: int | None = None) -> OperatingPoint:
    """Loss factor and effective mass ratio of a run with their standard errors; problems are named, not raised.

    The transient and the errors are found as in a measured record; the values themselves are means over the same cycles
    of the engine's own sums over all steps. Block means alone would place a short impact in the middle of its block,
    which is wrong by up to half a sample and, where every cycle repeats the same impact, does not average out.

    Args:
        run: a simulated run.
        skip_cycles: cycles to drop at the start; None: detect the transient.
    """
    mass = bed_mass_of(run)
    point = analyze(record_of(run), mass, 0.0, phase_uncertainty=0.0, skip_cycles=skip_cycles)
    used = slice(point.n_skipped, point.n_skipped + point.n_cycle)
    loss, inertia = (values[used] for values in cycle_values(run))
    if not len(loss) or len(loss) < point.n_cycle or not np.isfinite(point.loss_factor):
        return point
    eta, ratio = float(loss.mean()), float(inertia.mean())
    omega = 2.0 * np.pi * point.frequency
    power = 0.5 * eta * omega * mass * point.velocity_amplitude**2
    problems = point.problems
    third = max(len(loss) // 3, 1)
    before, after = float(loss[:third].mean()), float(loss[-third:].mean())
    changes = abs(after - before) > CHANGE * max(abs(eta), 0.1)
    if changes and Status.NOT_STEADY not in point.status:
        text = f"eta changes from {before:.2f} to {after:.2f} over the {len(loss)} cycles used: the motion has changed"
        problems = (*problems, Problem(Status.NOT_STEADY, text))
    return point._replace(
        power=power,
        dissipated_energy=power / point.frequency,
        loss_factor=eta,
        effective_mass_ratio=ratio,
        modulus_ratio=abs(complex(ratio, eta)),
        viscous_coefficient=eta * mass * omega,
        cycle_loss_factor=loss,
        cycle_mass_ratio=inertia,
        problems=problems,
    )


def status_of(run: "Run", point: OperatingPoint) -> Status:
    """What is wrong with a run: the bits of its engine and those of its signals."""
    return Status(run.status) | point.status


def cycle_values(run: "Run") -> CycleValues:
    """Loss factor and effective mass ratio cycle by cycle, from the engine's own sums over all steps.

    Args:
        run: a simulated run; empty without a frequency.
    """
    if run.frequency is None or not len(run.cycle_force):
        return CycleValues(np.empty(0), np.empty(0))
    return ratios_of(run.cycle_force, run.cycle_velocity, 2.0 * np.pi * run.frequency, bed_mass_of(run))


def ratios_of(
    force: NDArray[np.complex128], velocity: NDArray[np.complex128], omega: float, mass: float
) -> CycleValues:
    """Loss factor and effective mass ratio from amplitudes of single cycles.

    With F the amplitude of the force ON the container by its drive and V that of its velocity, M = F / (i Omega V) =
    m_bed (m' - i eta).

    Args:
        force: amplitudes of the force of the particles on the container [N]; (cycle,).
        velocity: amplitudes of the container's velocity [m/s]; (cycle,).
        omega: angular frequency of the motion [rad/s].
        mass: mass of all particles [kg].
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = -np.asarray(force) / (1j * omega * np.asarray(velocity)) / mass
    return CycleValues(np.ascontiguousarray(-ratio.imag), np.ascontiguousarray(ratio.real))
