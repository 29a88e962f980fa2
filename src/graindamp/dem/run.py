"""What a simulation gives."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from graindamp.dem.container import Enclosure
from graindamp.dem.energy import Energies
from graindamp.dem.packing_store import Packing
from graindamp.dem.stirring import Stirring
from graindamp.spec.simulation import SimulationSpec

Real = NDArray[np.float64]


class Snapshot(NamedTuple):
    """All particles at one time, in the order of the description."""

    time: float
    """Time since the motion began [s]."""
    phase: float
    """Phase of the motion, 0 to 2 pi [rad]; NaN where it has none."""
    position: Real
    """Centres in the container's frame [m]; (particle, 3)."""
    velocity: Real
    """Velocities in the container's frame [m/s]; (particle, 3)."""
    spin: Real
    """Angular velocities [rad/s]; (particle, 3)."""
    displacement: Real
    """Of the container [m]; (3,)."""
    container_velocity: Real
    """Of the container [m/s]; (3,)."""


class VelocityField(NamedTuple):
    """Mean velocity of the particles in cubic cells at one phase, over the cycles of a run."""

    origin: Real
    """Lowest corner [m]; (3,)."""
    cell: float
    """Side of a cell [m]."""
    met: NDArray[np.int64]
    """Particles met in each cell, all cycles together; (x, y, z)."""
    velocity: Real
    """Mean velocity in the container's frame [m/s], NaN where no particle was; (x, y, z, 3)."""
    phase: float
    """Phase of the motion [rad]."""
    n_cycle: int
    """Cycles averaged over [-]."""


class BedState(NamedTuple):
    """Where all particles are and how they move, in the order of the description: what another run can start from."""

    position: Real
    """Centres in the container's frame [m]; (particle, 3)."""
    velocity: Real
    """Velocities in the container's frame over the speed amplitude of the container [-]; (particle, 3)."""
    spin: Real
    """Angular velocities times radius over the same speed [-]; (particle, 3)."""


class Run(NamedTuple):
    """What a simulation gives. Time 0 is the start of the motion."""

    spec: SimulationSpec
    packing: Packing
    enclosure: Enclosure
    names: tuple[str, ...]
    """Names of the walls."""
    radius: Real
    """Radius of each particle [m]; (particle,)."""
    mass: Real
    """Mass of each particle [kg]; (particle,)."""
    component: NDArray[np.int32]
    """Number of the bed's component that each particle belongs to; (particle,)."""
    time: Real
    """Middle of each block mean [s]; (sample,)."""
    force: Real
    """Force of the particles ON each wall, block means [N]; (sample, wall, 3)."""
    velocity: Real
    """Velocity of the container, block means [m/s]; (sample, 3)."""
    cycle_force: NDArray[np.complex128]
    """Amplitude of the force of the particles ON the container along the motion, whole cycles, exp(+i Omega t) [N];
    (cycle,)."""
    cycle_velocity: NDArray[np.complex128]
    """Amplitude of the container's velocity likewise [m/s]; (cycle,)."""
    direction: Real
    """Direction of the motion; (3,)."""
    frequency: float | None
    """Frequency that cycles are counted by [Hz]."""
    energy_time: Real
    """Times of the energies [s]; (sample,)."""
    energy: tuple[Energies, ...]
    centre: Real
    """Centre of mass of the bed in the container's frame at those times [m]; (sample, 3)."""
    snapshots: tuple[Snapshot, ...]
    velocity_field: VelocityField | None
    impact_edges: Real
    """Edges of the bins of impact speed [m/s]; (bin + 1,)."""
    impact_counts: NDArray[np.int64]
    """Impacts between particles and with walls; (2, bin)."""
    contacts_per_particle: float
    """Mean number of touching pairs per particle [-]."""
    wall_contacts: float
    """Mean number of touching particles and walls [-]."""
    largest_overlap: Real
    """Over the smallest radius, between particles and with walls [-]; (2,)."""
    largest_speed: float
    """Speed of the fastest impact [m/s]."""
    time_step: float
    """[s]"""
    n_step: int
    """Steps of the motion, settling excluded [-]."""
    seconds: float
    """Time that the motion took to compute [s]."""
    steps_per_contact: float
    """Steps in a contact at the speed of the fastest impact [-]."""
    status: int
    """Status bits, see :class:`graindamp.status.Status`."""
    end: BedState | None = None
    """The bed at the end of a run of whole cycles; None for motions without cycles."""
    stirring: Stirring | None = None
    """Motion of the bed relative to the container, cycle by cycle; None for motions without cycles, and for runs
    shorter than one."""

    @property
    def bed_mass(self) -> float:
        """Mass of all particles [kg]."""
        return float(self.mass.sum())

    @property
    def particle_steps_per_second(self) -> float:
        """Particles times steps over seconds [1/s]."""
        return len(self.mass) * self.n_step / self.seconds if self.seconds > 0.0 else math.nan
