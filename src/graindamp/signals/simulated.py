"""From a simulated run to a record like that of any rig, and to its operating point.

The engine knows the forces of the particles on the walls alone, without the container's own mass. A container without
mass passes on what it gets, so that the force exerted ON it by what drives it is minus the force of the particles on
it. A bed that clings to the container then weighs m' = 1, and one that dissipates has eta > 0.
"""

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from graindamp.signals.checks import clipped_share
from graindamp.signals.power import OperatingPoint, analyze
from graindamp.signals.record import Record
from graindamp.spec.motion import HarmonicMotion
from graindamp.spec.simulation import SimulationSpec
from graindamp.status import Status
from graindamp.units import intensity

if TYPE_CHECKING:
    from graindamp.dem.simulate import Run

Real = NDArray[np.float64]

RIPPLE = 1e-12
"""Share of the largest force that is added where the force stays at one value [-], see :func:`record_of`."""


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

    Force and velocity are block means over the same steps, so that the phase between them has no error of its own.

    Args:
        run: a simulated run.
        skip_cycles: cycles to drop at the start; None: detect the transient.
    """
    return analyze(record_of(run), bed_mass_of(run), 0.0, phase_uncertainty=0.0, skip_cycles=skip_cycles)


def status_of(run: "Run", point: OperatingPoint) -> Status:
    """What is wrong with a run: the bits of its engine and those of its signals."""
    return Status(run.status) | point.status


def cycle_values(run: "Run") -> CycleValues:
    """Loss factor and effective mass ratio cycle by cycle, from the engine's own sums over all steps.

    With F the amplitude of the force ON the container by its drive and V that of its velocity, M = F / (i Omega V) =
    m_bed (m' - i eta).

    Args:
        run: a simulated run; empty without a frequency.
    """
    if run.frequency is None or not len(run.cycle_force):
        return CycleValues(np.empty(0), np.empty(0))
    omega = 2.0 * np.pi * run.frequency
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = -np.asarray(run.cycle_force) / (1j * omega * np.asarray(run.cycle_velocity)) / bed_mass_of(run)
    return CycleValues(np.ascontiguousarray(-ratio.imag), np.ascontiguousarray(ratio.real))
