"""What is written down while a run goes on, and the result made of it."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from graindamp.dem.columns import FORCE_COS, FORCE_SIN, LOWEST_SPEED, N_SPEED_BIN, N_STEP, SPEED_COS, SPEED_SIN
from graindamp.dem.container import Enclosure
from graindamp.dem.energy import Energies, energies, velocity_now
from graindamp.dem.motion import DIRECTION, FUNDAMENTAL
from graindamp.dem.packing_store import Packing
from graindamp.dem.plan import Plan
from graindamp.dem.run import BedState, Run, Snapshot, VelocityField
from graindamp.dem.state import Worlds
from graindamp.dem.stirring import Stirred
from graindamp.spec.simulation import SimulationSpec
from graindamp.status import Status

Real = NDArray[np.float64]

LARGE_OVERLAP = 0.05
"""Overlap over radius above which contacts are no longer small [-]; Hertz's law is then wrong by several per cent."""

FEW_STEPS = 20
"""Steps in the fastest impact below which its restitution is wrong by more than 0.1 % [-]."""


class Cycles(NamedTuple):
    """Amplitudes of every whole cycle of a run so far, along the motion; each (cycle,)."""

    force: NDArray[np.complex128]
    """Of the force of the particles on the container at the driving frequency [N]."""
    velocity: NDArray[np.complex128]
    """Of the container's velocity [m/s]."""


def speed_amplitude(worlds: Worlds, w: int = 0) -> float:
    """Amplitude of the container's first harmonic [m/s]; 0 for motions without cycles."""
    omega = float(worlds.motion.timing[w, FUNDAMENTAL])
    return omega * float(np.linalg.norm(worlds.motion.wave[w, 0, 2:5])) if omega > 0.0 else 0.0


class Notes:
    """What is written down while a run goes on."""

    def __init__(
        self, spec: SimulationSpec, worlds: Worlds, packing: Packing, enclosure: Enclosure, plan: Plan, contact: float
    ) -> None:
        """Notes of a run that sets off now; `contact` is the shortest contact at a speed of 1 m/s [s]."""
        self.spec, self.packing, self.enclosure, self.plan, self.contact = spec, packing, enclosure, plan, contact
        self.begin, self.first = float(worlds.clock.time[0]), int(worlds.clock.step[0])
        self.counts = worlds.clock.counts[0].copy()
        self.times: list[float] = []
        self.energies: list[Energies] = []
        self.centres: list[Real] = []
        self.snapshots: list[Snapshot] = []
        self.place = np.argsort(worlds.particles.identity[0])
        self.mass = 1.0 / worlds.particles.inverse_mass[0, :, 0]
        self.cells: dict[tuple[int, int, int], list[Real]] = {}
        self.n_field = 0
        speed, omega = speed_amplitude(worlds), float(worlds.motion.timing[0, FUNDAMENTAL])
        is_cyclic = plan.per_cycle > 0 and speed > 0.0
        self.stirred = Stirred(spec.damper, enclosure, plan, worlds, speed, omega) if is_cyclic else None

    def since(self, worlds: Worlds) -> float:
        """Time since the motion began [s]."""
        return float(worlds.clock.time[0]) - self.begin

    def energy(self, worlds: Worlds) -> None:
        """Write down energies, centre of mass, and how the bed moves."""
        if self.stirred is not None:
            self.stirred.sample(worlds, round(self.since(worlds) / self.plan.time_step))
        now, centre = energies(worlds), self.mass @ worlds.particles.position[0, :, :3] / self.mass.sum()
        self.times.append(self.since(worlds))
        self.energies.append(now)
        self.centres.append(centre)

    def snapshot(self, worlds: Worlds) -> None:
        """Write down all particles."""
        velocity, spin = velocity_now(worlds)
        time, omega = self.since(worlds), float(worlds.motion.timing[0, FUNDAMENTAL])
        self.snapshots.append(
            Snapshot(
                time=time,
                phase=omega * time % (2.0 * math.pi) if omega > 0.0 else math.nan,
                position=worlds.particles.position[0, self.place, :3].copy(),
                velocity=velocity[self.place],
                spin=spin[self.place],
                displacement=worlds.motion.displacement[0].copy(),
                container_velocity=worlds.motion.velocity[0].copy(),
            )
        )

    def field(self, worlds: Worlds) -> None:
        """Add the particles' velocities to the cells they are in."""
        assert self.spec.run.velocity_field is not None
        velocity, _ = velocity_now(worlds)
        cell = np.floor(worlds.particles.position[0, :, :3] / self.spec.run.velocity_field.cell).astype(int)
        for key, v in zip(map(tuple, cell.tolist()), velocity, strict=True):
            self.cells.setdefault(key, []).append(v)
        self.n_field += 1

    def lost(self, worlds: Worlds) -> bool:
        """Whether a particle is no number, has left the bounds of a mesh, or is a kilometre away.

        Other walls are endless or closed behind, and push a particle back from any depth.
        """
        n = int(worlds.particles.n_particle[0])
        position = worlds.particles.position[0, :n]
        if not np.all(np.isfinite(position)):
            return True
        if self.enclosure.mesh is None:
            return bool(np.abs(position[:, :3]).max() > 1e3)
        from graindamp.dem.mesh import bounds

        low, high = bounds(self.enclosure.mesh)
        return bool(np.any(position[:, :3] < low) or np.any(position[:, :3] > high))

    def velocity_field(self) -> VelocityField | None:
        """The cells as an array."""
        wanted = self.spec.run.velocity_field
        if wanted is None or not self.cells:
            return None
        keys = np.array(list(self.cells))
        low = keys.min(axis=0)
        shape = tuple(keys.max(axis=0) - low + 1)
        count = np.zeros(shape, np.int64)
        velocity = np.full((*shape, 3), np.nan)
        for key, values in self.cells.items():
            place = tuple(np.array(key) - low)
            count[place] = len(values)
            velocity[place] = np.mean(values, axis=0)
        return VelocityField(low * wanted.cell, wanted.cell, count, velocity, wanted.phase, self.n_field)

    def cycles(self, worlds: Worlds) -> Cycles:
        """Force and speed of the whole cycles so far."""
        sums, plan = worlds.record.fourier[0], self.plan
        whole = sums[np.abs(sums[:, N_STEP] - plan.per_cycle) < 0.5] if plan.per_cycle else sums[:0]
        scale = 2.0 / max(plan.per_cycle, 1)
        return Cycles(
            scale * (whole[:, FORCE_COS] - 1j * whole[:, FORCE_SIN]),
            scale * (whole[:, SPEED_COS] - 1j * whole[:, SPEED_SIN]),
        )

    def end(self, worlds: Worlds) -> BedState | None:
        """The bed now, if the container moves to and fro."""
        scale = speed_amplitude(worlds)
        if scale == 0.0:
            return None
        velocity, spin = velocity_now(worlds)
        return BedState(
            position=worlds.particles.position[0, self.place, :3].copy(),
            velocity=velocity[self.place] / scale,
            spin=spin[self.place] * self.packing.radius[:, None] / scale,
        )

    def run(self, worlds: Worlds, n_step: int, seconds: float, status: int) -> Run:
        """All of it together, after `n_step` nominal steps that took `seconds`."""
        record, plan, mass = worlds.record, self.plan, self.mass[self.place]
        n_sample = int(record.n_sample[0])
        series = record.series[0, :n_sample]
        cycles = self.cycles(worlds)
        edges = LOWEST_SPEED * 2.0 ** (np.arange(N_SPEED_BIN + 1) / 4.0)
        impacts = record.impact[0].copy()
        struck = np.flatnonzero(impacts.sum(axis=0))
        fastest = float(edges[struck[-1] + 1]) if len(struck) else 0.0
        steps = self.contact / plan.time_step
        if fastest > 0.0 and self.spec.damper.contact.law != "linear":
            steps *= fastest**-0.2  # a Hertz contact shortens with speed to the power 1/5
        overlap = record.extreme[0] / float(self.packing.radius.min())
        if overlap.max() > LARGE_OVERLAP:
            status |= int(Status.LARGE_OVERLAP)
        if fastest > 0.0 and steps < FEW_STEPS and self.spec.run.integrator == "verlet":
            status |= int(Status.FEW_STEPS)
        counts = (worlds.clock.counts[0] - self.counts) / max(int(worlds.clock.step[0]) - self.first, 1)
        return Run(
            spec=self.spec,
            packing=self.packing,
            enclosure=self.enclosure,
            names=self.enclosure.names,
            radius=self.packing.radius,
            mass=mass,
            component=self.packing.component,
            time=np.asarray(
                (np.arange(n_sample) + 0.5) * plan.stride * plan.time_step + 0.5 * plan.time_step, np.float64
            ),
            force=series[:, :-1].copy(),
            velocity=series[:, -1].copy(),
            cycle_force=cycles.force,
            cycle_velocity=cycles.velocity,
            direction=worlds.motion.timing[0, DIRECTION : DIRECTION + 3].copy(),
            frequency=self.spec.base_frequency,
            energy_time=np.array(self.times),
            energy=tuple(self.energies),
            centre=np.array(self.centres),
            snapshots=tuple(self.snapshots),
            velocity_field=self.velocity_field(),
            impact_edges=edges,
            impact_counts=impacts,
            contacts_per_particle=float(counts[2]) / len(mass),
            wall_contacts=float(counts[3]),
            largest_overlap=overlap,
            largest_speed=fastest,
            time_step=plan.time_step,
            n_step=n_step,
            seconds=seconds,
            steps_per_contact=steps,
            status=status,
            stirring=None if self.stirred is None else self.stirred.result(record),
            end=self.end(worlds) if plan.per_cycle and not n_step % plan.per_cycle else None,
        )
