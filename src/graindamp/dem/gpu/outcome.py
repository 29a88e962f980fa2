"""From what the device wrote down to the result of a run."""

import numpy as np
from numpy.typing import NDArray

from graindamp.dem.columns import LOWEST_SPEED, N_LEDGER, N_SPEED_BIN
from graindamp.dem.energy import Energies
from graindamp.dem.gpu.columns import (
    BED_MASS,
    ELASTIC,
    FORCE_COS,
    FORCE_SIN,
    KINETIC,
    LEDGER,
    MOMENT,
    N_ROW,
    PAIR_CONTACTS,
    POTENTIAL,
    ROTATIONAL,
    ROW_STEPS,
    ROW_TIME,
    SPEED_COS,
    SPEED_SIN,
    WALL_CONTACTS,
    WIDEST_PAIR,
    WIDEST_TOUCH,
)
from graindamp.dem.gpu.load import Described
from graindamp.dem.gpu.memory import Memory
from graindamp.dem.notes import FEW_STEPS, LARGE_OVERLAP, Cycles
from graindamp.dem.plan import Plan
from graindamp.dem.run import BedState, Run
from graindamp.status import Status

Real = NDArray[np.float64]


def cycles_of(rows: Real, plan: Plan) -> Cycles:
    """Force and speed of the whole cycles in the rows; (row, N_ROW)."""
    whole = rows[1:][np.abs(rows[1:, ROW_STEPS] - plan.per_cycle) < 0.5] if plan.per_cycle else rows[:0]
    scale = 2.0 / max(plan.per_cycle, 1)
    force = np.asarray(scale * (whole[:, FORCE_COS] - 1j * whole[:, FORCE_SIN]), np.complex128)
    velocity = np.asarray(scale * (whole[:, SPEED_COS] - 1j * whole[:, SPEED_SIN]), np.complex128)
    return Cycles(force, velocity)


def energies_of(row: Real) -> Energies:
    """Energies of one row."""
    ledger = [float(value) for value in row[LEDGER : LEDGER + N_LEDGER]]
    stored = (float(row[k]) for k in (KINETIC, ROTATIONAL, POTENTIAL, ELASTIC))
    return Energies(*stored, *ledger)


def bed_of(world: Described, memory: Memory, slot: int) -> tuple[Real, Real, Real]:
    """Positions, velocities and spins at the same time, in the order of the description; each (particle, 3)."""
    n = len(world.mass)
    place = np.argsort(world.loaded.order)
    found = (memory.read("bed", name, slot)[:, :n].T[place] for name in ("position", "velocity_shown", "spin_shown"))
    position, velocity, spin = (np.ascontiguousarray(one, np.float64) for one in found)
    return position, velocity, spin


def run_of(world: Described, rows: Real, step: int, seconds: float, status: int, memory: Memory, slot: int) -> Run:
    """Result of the world in a slot, after `step` steps in all, that took `seconds` of the device's time."""
    plan, n = world.plan, len(world.mass)
    n_step = max(step - world.loaded.n_settle, 0)
    position, velocity, spin = bed_of(world, memory, slot)
    if not status and (_lost(world, position) or not np.all(np.isfinite(rows))):
        status |= int(Status.PARTICLE_LOST)
    cycles = cycles_of(rows, plan)
    sums, impacts = memory.read("slots", "sums", slot), memory.read("slots", "impact", slot)
    edges = LOWEST_SPEED * 2.0 ** (np.arange(N_SPEED_BIN + 1) / 4.0)
    struck = np.flatnonzero(impacts.sum(axis=0))
    fastest = float(edges[struck[-1] + 1]) if len(struck) else 0.0
    steps = world.contact / plan.time_step
    if fastest > 0.0 and world.spec.damper.contact.law != "linear":
        steps *= fastest**-0.2  # a Hertz contact shortens with speed to the power 1/5
    overlap = np.array([sums[WIDEST_PAIR].max(), sums[WIDEST_TOUCH].max()]) / float(world.packing.radius.min())
    if overlap.max() > LARGE_OVERLAP:
        status |= int(Status.LARGE_OVERLAP)
    if fastest > 0.0 and steps < FEW_STEPS:
        status |= int(Status.FEW_STEPS)
    last = rows[-1] if len(rows) else np.zeros(N_ROW)
    end = None
    if world.speed > 0.0 and plan.per_cycle and n_step % plan.per_cycle == 0 and not status & int(Status.PARTICLE_LOST):
        end = BedState(position, velocity / world.speed, spin * world.packing.radius[:, None] / world.speed)
    return Run(
        spec=world.spec,
        packing=world.packing,
        enclosure=world.enclosure,
        names=world.enclosure.names,
        radius=world.packing.radius,
        mass=world.mass,
        component=world.packing.component,
        time=np.zeros(0),
        force=np.zeros((0, len(world.enclosure.names), 3)),
        velocity=np.zeros((0, 3)),
        cycle_force=cycles.force,
        cycle_velocity=cycles.velocity,
        direction=world.direction,
        frequency=world.spec.base_frequency,
        energy_time=rows[:, ROW_TIME].copy(),
        energy=tuple(energies_of(row) for row in rows),
        centre=rows[:, MOMENT : MOMENT + 3] / rows[:, BED_MASS, None],
        snapshots=(),
        velocity_field=None,
        impact_edges=edges,
        impact_counts=impacts,
        contacts_per_particle=float(last[PAIR_CONTACTS]) / max(n_step, 1) / n,
        wall_contacts=float(last[WALL_CONTACTS]) / max(n_step, 1),
        largest_overlap=overlap,
        largest_speed=fastest,
        time_step=plan.time_step,
        n_step=n_step,
        seconds=seconds,
        steps_per_contact=steps,
        status=status,
        end=end,
    )


def _lost(world: Described, position: Real) -> bool:
    """Whether a particle is no number, has left the bounds of a mesh, or is a kilometre away."""
    if not np.all(np.isfinite(position)):
        return True
    if world.enclosure.mesh is None:
        return bool(np.abs(position).max() > 1e3)
    from graindamp.dem.mesh import bounds

    low, high = bounds(world.enclosure.mesh)
    return bool(np.any(position < low) or np.any(position > high))
