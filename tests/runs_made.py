"""A simulated run without a simulation: a bed of known loss factor and effective mass, with snapshots to draw, or one
whose every particle moves as told."""

from types import SimpleNamespace

import numpy as np

from graindamp.dem.container import enclosure_of
from graindamp.dem.energy import Energies
from graindamp.dem.interactions import interactions_of
from graindamp.dem.packing_store import Packing
from graindamp.dem.plan import Plan
from graindamp.dem.run import Run, Snapshot, VelocityField
from graindamp.dem.stirring import Stirred
from graindamp.spec.model import parse_spec
from graindamp.spec.simulation import SimulationSpec
from graindamp.units import STANDARD_GRAVITY
from signals_made import linear_bed

RADIUS, BORE, LENGTH, CLEARANCE = 2e-3, 10e-3, 40e-3, 3e-3


def description(n_particle=100, **changes):
    """A lying cylinder of 20 mm with steel spheres of 2 mm radius, shaken along its axis; tables may be replaced."""
    tables = {
        "title": "A bed that was made up",
        "damper": {
            "name": "test damper",
            "particles": [{"material": "steel-s235", "radius": RADIUS}],
            "fill": {"count": n_particle},
            "container": {
                "kind": "cylinder",
                "axis": "x",
                "radius": BORE,
                "length": LENGTH,
                "material": "aluminium-6060",
            },
            "lid": {"kind": "rigid", "clearance": CLEARANCE},
            "contact": {"restitution": 0.6, "friction": 0.2},
        },
        "motion": {"kind": "harmonic", "frequency": 100.0, "intensity": 10.0},
        "run": {"cycles": 30, "snapshots_per_cycle": 8},
    }
    return parse_spec(tables | changes, SimulationSpec, "test")


def places(n_particle, length):
    """Centres of spheres on a cubic lattice inside the cylinder, from its start and its floor."""
    step = 2.0 * RADIUS
    across = step * np.arange(-2, 3)
    x = RADIUS + step * np.arange(int(length / step))
    y, z, x = np.meshgrid(across, across, x, indexing="ij")
    at = np.column_stack([x.ravel(), y.ravel(), z.ravel()])
    at = at[np.hypot(at[:, 1], at[:, 2]) <= BORE - RADIUS]
    return at[np.lexsort((at[:, 1], at[:, 2], at[:, 0]))][:n_particle]


def made_run(loss_factor=0.4, mass_ratio=0.3, n_particle=100, n_cycle=30, n_snapshot=16, status=0, spec=None):
    """A run whose bed has the complex effective mass m_bed (m' - i eta)."""
    spec = description(n_particle) if spec is None else spec
    damper, frequency, per_cycle = spec.damper, 100.0, 200
    interactions = interactions_of(damper)
    position = places(n_particle, LENGTH)
    height = float(position[:, 0].max() + RADIUS)
    enclosure = enclosure_of(damper, interactions, height + CLEARANCE)
    mass = np.full(n_particle, damper.particles[0].density * 4.0 / 3.0 * np.pi * RADIUS**3)
    omega, speed = 2.0 * np.pi * frequency, 10.0 * STANDARD_GRAVITY / (2.0 * np.pi * frequency)
    time = (np.arange(n_cycle * per_cycle) + 0.5) / (frequency * per_cycle)
    drive = linear_bed(loss_factor, mass_ratio, mass.sum(), frequency, speed)(omega * time)
    wobble = 1.0 + 0.01 * np.random.default_rng(5).normal(size=n_cycle)  # scatter over cycles
    drive = drive * np.repeat(wobble, per_cycle)
    force = np.zeros((len(time), len(enclosure.names), 3))
    force[:, 1:3, 0] = -0.5 * drive[:, None]
    force[:, 0, 2] = -mass.sum() * STANDARD_GRAVITY
    velocity = np.zeros((len(time), 3))
    velocity[:, 0] = speed * np.cos(omega * time)
    phasor = np.exp(-1j * omega * time).reshape(n_cycle, per_cycle)
    work = np.pi * loss_factor * mass.sum() * speed**2
    energy_time = np.arange(n_cycle + 1) / frequency
    ledger = tuple(
        Energies(1e-3, 1e-4, 2e-3, 1e-6, k * work, 0.5 * k * work, 0.2 * k * work, 0.2 * k * work, 0.09 * k * work, 0.0,
                 0.01 * k * work)
        for k in range(n_cycle + 1)
    )  # fmt: skip
    centre = position.mean(axis=0) + np.zeros((n_cycle + 1, 3))
    snapshots = tuple(_snapshot(k, position, frequency, speed) for k in range(n_snapshot))
    count = (10, 5, 5)
    field = np.random.default_rng(2).normal(scale=0.2 * speed, size=(*count, 3))
    field[..., 0] += speed * np.linspace(-1, 1, count[0])[:, None, None]
    field[8:, :, 3:] = np.nan
    met = np.where(np.isfinite(field[..., 0]), 3 * n_cycle, 0)
    edges = 1e-6 * 2.0 ** (0.25 * np.arange(129))
    counts = np.rint(1e5 * np.exp(-(((np.arange(128) - 60) / 8.0) ** 2)) * np.array([[1.0], [0.3]])).astype(np.int64)
    packing = Packing(
        position=position,
        radius=np.full(n_particle, RADIUS),
        component=np.zeros(n_particle, np.int32),
        height=height,
        poured_height=height + 1e-3,
        top=height,
        solid_fraction=0.55,
        lid_height=height + CLEARANCE,
        clearance=CLEARANCE,
        tap_cycles=40,
        seconds=1.5,
    )
    return Run(
        spec=spec,
        packing=packing,
        names=enclosure.names,
        radius=packing.radius,
        mass=mass,
        component=packing.component,
        time=time,
        force=force,
        velocity=velocity,
        cycle_force=2.0 * np.mean(-drive.reshape(n_cycle, per_cycle) * phasor, axis=1),
        cycle_velocity=2.0 * np.mean(velocity[:, 0].reshape(n_cycle, per_cycle) * phasor, axis=1),
        direction=np.array([1.0, 0.0, 0.0]),
        frequency=frequency,
        energy_time=energy_time,
        energy=ledger,
        centre=centre,
        snapshots=snapshots,
        velocity_field=VelocityField(np.array([0.0, -BORE, -BORE]), 4e-3, met, field, 0.5 * np.pi, n_cycle),
        impact_edges=edges,
        impact_counts=counts,
        contacts_per_particle=1.7,
        wall_contacts=31.0,
        largest_overlap=np.array([0.011, 0.009]),
        largest_speed=0.8,
        time_step=1e-6,
        n_step=300_000,
        seconds=12.0,
        steps_per_contact=33.0,
        status=status,
        enclosure=enclosure,
    )


def _snapshot(k, position, frequency, speed):
    """Snapshot k of eight a cycle: the bed slides along the axis, and shears a little over its height."""
    phase = 2.0 * np.pi * k / 8
    moved = position.copy()
    moved[:, 0] += 0.5 * CLEARANCE * (1.0 - np.cos(phase))
    velocity = np.zeros_like(position)
    velocity[:, 0] = -speed * np.cos(phase) * (1.0 - 0.3 * position[:, 2] / BORE)
    displacement = np.array([speed / (2.0 * np.pi * frequency) * np.sin(phase), 0.0, 0.0])
    container = np.array([speed * np.cos(phase), 0.0, 0.0])
    return Snapshot(k / (8.0 * frequency), phase, moved, velocity, np.zeros_like(position), displacement, container)


def stirred_run(bed, push=lambda turn: (0.0, 0.0), n_particle=90, n_cycle=6, spec=None, lead=0.0):
    """A run whose particles move as told; its clearance is pi X, so that X = X_opt.

    Args:
        bed: gives, for a turn of the cycle (0 to 1, the container fastest at 0), velocities over V in the container's
            frame, (particle, 3) or what broadcasts to it, and the place along the motion over X, (particle,) likewise.
        push: gives the force on either end over m_bed A at a turn of the cycle.
        spec: description.
        lead: part of a cycle by which the container is ahead when the run begins [-].
    """
    run = made_run(n_particle=n_particle, n_cycle=n_cycle, n_snapshot=0, spec=spec)
    omega, mass = 2.0 * np.pi * run.frequency, run.mass.sum()
    speed = float(np.abs(run.cycle_velocity).mean())
    stroke, per_cycle, blocks = speed / omega, 400, 40
    samples = per_cycle // 20 * np.arange(1, 20 * n_cycle + 1)
    plan = Plan(1.0 / run.frequency / per_cycle, 0, n_cycle * per_cycle, per_cycle // blocks, n_cycle, per_cycle,
                frozenset(samples.tolist()), frozenset(), frozenset())  # fmt: skip
    worlds = _world(run, np.zeros((n_particle, 3)), run.packing.position, 0.0)
    stirred = Stirred(run.spec.damper, run.enclosure, plan, worlds, speed, omega)
    for step in samples:
        # a sample at the end of a cycle belongs to the cycle it ends
        turn = ((step / per_cycle + lead) * (1.0 - 1e-12)) % 1.0
        velocity, place = bed(turn)
        position = run.packing.position + stroke * np.outer(np.broadcast_to(place, n_particle), [1.0, 0.0, 0.0])
        velocity = speed * np.broadcast_to(velocity, (n_particle, 3))
        stirred.sample(_world(run, velocity, position, speed * np.cos(2.0 * np.pi * turn)), int(step))
    turns = ((np.arange(n_cycle * blocks) + 0.5) / blocks + lead) % 1.0
    series = np.zeros((1, len(turns), len(run.names) + 1, 3))
    names = {"start": 0, "end": 1}
    for name, end in names.items():
        series[0, :, run.names.index(name), 0] = [
            (2 * end - 1) * push(turn)[end] * mass * omega * speed for turn in turns
        ]
    series[0, :, -1, 0] = speed * np.cos(2.0 * np.pi * turns)
    stirring = stirred.result(SimpleNamespace(series=series))
    return run._replace(stirring=stirring, packing=run.packing._replace(clearance=np.pi * stroke))


def _world(run, velocity, position, container):
    """As much of a world as `Stirred` looks at, with particles and container moving at the speeds given."""
    n = len(run.mass)
    particles = SimpleNamespace(
        n_particle=np.array([n]),
        inverse_mass=np.column_stack([1.0 / run.mass, np.ones(n)])[None],
        position=np.column_stack([position, run.radius])[None],
        velocity=np.column_stack([velocity, np.zeros(n)])[None],
        spin=np.zeros((1, n, 4)),
        force=np.zeros((1, n, 3)),
        torque=np.zeros((1, n, 3)),
    )
    motion = SimpleNamespace(
        timing=np.array([[0.0, 0.0, *run.direction, 0.0, 0.0, 0.0]]),
        velocity=container * run.direction[None],
        acceleration=np.zeros((1, 3)),
    )
    rules = SimpleNamespace(gravity=np.array([[0.0, 0.0, -STANDARD_GRAVITY]]), time_step=np.zeros(1))
    return SimpleNamespace(particles=particles, motion=motion, rules=rules)
