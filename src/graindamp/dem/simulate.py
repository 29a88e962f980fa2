"""One operating point: pack, settle, shake, write down."""

import time as clock_of_the_wall
from collections.abc import Callable
from pathlib import Path

import numpy as np

from graindamp.dem import backend, engine
from graindamp.dem.container import enclosure_of
from graindamp.dem.energy import velocity_now
from graindamp.dem.excitation import motion_of
from graindamp.dem.interactions import interactions_of
from graindamp.dem.motion import START, move
from graindamp.dem.notes import Notes
from graindamp.dem.packing import Progress, pack
from graindamp.dem.packing_store import Packing
from graindamp.dem.plan import Plan, plan_of
from graindamp.dem.run import Run
from graindamp.dem.state import Motion, Worlds, empty_record
from graindamp.dem.timestep import expected_speed, shortest_contact
from graindamp.dem.world import Bed, world_of
from graindamp.spec.simulation import SimulationSpec
from graindamp.status import Status

SKIN_STEPS = 250.0
"""Steps of the fastest particle that the outer neighbour lists shall last [-]."""


def simulate(
    spec: SimulationSpec,
    *,
    folder: Path | None = None,
    cache: Path | None = None,
    packing: Packing | None = None,
    progress: Progress | None = None,
) -> Run:
    """Simulate one operating point.

    Ctrl-C ends the run early: what there is so far comes back with `Status.INTERRUPTED`.

    Args:
        spec: what to simulate.
        folder: what files in the description are relative to; None: the working folder.
        cache: folder of stored packings; None: that of the user.
        packing: the bed to start from; None: pack, or take the stored one.
        progress: called with stage, fraction done and seconds left, or None where these are not known yet.

    Raises:
        InputError: the bed does not fit, a file cannot be used, a particle starts outside.
    """
    damper = spec.damper
    if packing is None:
        packing = pack(damper, folder=folder, cache=cache, progress=progress)
    interactions = interactions_of(damper)
    enclosure = enclosure_of(damper, interactions, lid_height=packing.lid_height, folder=folder)
    material = np.asarray(interactions.component, np.int32)[packing.component]
    motion = motion_of(spec.motion, folder=folder)
    speed = expected_speed(motion, float(np.linalg.norm(damper.gravity)), float(packing.radius.max()))
    contact = shortest_contact(interactions, packing.radius, material, speed)
    plan = plan_of(spec, motion, spec.run.time_step or contact / spec.run.steps_per_contact)
    smallest = float(packing.radius.min())
    worlds = world_of(
        Bed.at_rest(packing.position, packing.radius, material),
        enclosure,
        interactions,
        damper.gravity,
        plan.time_step,
        skin=min(max(SKIN_STEPS * speed * plan.time_step, 0.04 * smallest), 0.25 * smallest),
    )
    status, stopped = 0, False
    worlds = engine.start(worlds)
    try:
        worlds = _settle(worlds, plan, progress)
    except KeyboardInterrupt:
        stopped = True
    worlds = _set_off(worlds, motion, plan, len(enclosure.names))
    contact_at_one = shortest_contact(interactions, packing.radius, material, 1.0)
    notes = Notes(spec, worlds, packing, enclosure, plan, contact_at_one)
    start_clock = clock_of_the_wall.perf_counter()
    integrate = engine.run if spec.run.integrator == "verlet" else _gear(spec, packing)
    notes.energy(worlds)
    done = 0
    try:
        for stop in [] if stopped else plan.stops:
            worlds, done = integrate(worlds, stop - done), stop
            status |= int(worlds.clock.status[0])
            if status or notes.lost(worlds):
                status |= 0 if status else int(Status.PARTICLE_LOST)
                break
            if stop in plan.energy or stop == plan.n_step:
                notes.energy(worlds)
            if stop in plan.snapshot:
                notes.snapshot(worlds)
            if stop in plan.field:
                notes.field(worlds)
            if progress is not None:
                spent = clock_of_the_wall.perf_counter() - start_clock
                progress("shaking", done / plan.n_step, spent * (plan.n_step / done - 1.0))
    except KeyboardInterrupt:
        stopped = True
    seconds = clock_of_the_wall.perf_counter() - start_clock
    if stopped:
        status |= int(Status.INTERRUPTED)
    return notes.run(worlds, done, seconds, status)


def _settle(worlds: Worlds, plan: Plan, progress: Progress | None) -> Worlds:
    pieces = 20
    for piece in range(pieces):
        worlds = engine.run(worlds, plan.n_settle * (piece + 1) // pieces - plan.n_settle * piece // pieces)
        if worlds.clock.status[0]:
            break
        if progress is not None:
            progress("settling", (piece + 1) / pieces, None)
    return worlds


def _set_off(worlds: Worlds, motion: Motion, plan: Plan, n_wall: int) -> Worlds:
    """The settled world with its container about to move.

    A container that starts with a speed leaves the particles behind: in its frame they start with the opposite one.
    """
    velocity, spin = velocity_now(worlds)
    motion.timing[0, START] = worlds.clock.time[0]
    move(0, worlds.clock.time[0], motion)
    n_sample = plan.n_step // plan.stride + 1
    record = empty_record(1, n_wall, n_sample, plan.stride, plan.n_cycle)
    worlds = worlds._replace(motion=motion, record=record)
    worlds.particles.velocity[0, :, :3] = velocity - motion.velocity[0]
    worlds.particles.spin[0, :, :3] = spin
    backend.shift(0, -0.5 * plan.time_step, worlds.particles, worlds.rules, worlds.motion)
    worlds.clock.drift[0, 3:7] = backend.BEYOND
    return worlds


def _gear(spec: SimulationSpec, packing: Packing) -> Callable[[Worlds, int], Worlds]:
    from graindamp.dem.gear import Gear

    return Gear(tolerance=(spec.run.tolerance or 1e-6) * float(packing.radius.min())).run
