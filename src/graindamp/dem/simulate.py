"""One operating point: pack, settle, shake, write down."""

import time as clock_of_the_wall
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np

from graindamp.dem import backend, engine
from graindamp.dem.container import Enclosure, enclosure_of
from graindamp.dem.energy import velocity_now
from graindamp.dem.excitation import motion_of
from graindamp.dem.interactions import interactions_of
from graindamp.dem.motion import START, move
from graindamp.dem.notes import Cycles, Notes, speed_amplitude
from graindamp.dem.packing import PHYSICS, pack
from graindamp.dem.packing_store import Packing, Progress
from graindamp.dem.plan import Plan, plan_of
from graindamp.dem.run import BedState, Run
from graindamp.dem.state import Motion, Worlds, empty_record
from graindamp.dem.timestep import expected_speed, shortest_contact
from graindamp.dem.turned import turned
from graindamp.dem.world import Bed, world_of
from graindamp.errors import InputError
from graindamp.interrupt import Interruption, deferred
from graindamp.spec.simulation import SimulationSpec
from graindamp.status import Status

SKIN_STEPS = 250.0
"""Steps of the fastest particle that the outer neighbour lists shall last [-]."""


Enough = Callable[[Cycles], bool]
"""Told the amplitudes of all whole cycles so far after each of them; True ends the run."""


def simulate(
    spec: SimulationSpec,
    *,
    folder: Path | None = None,
    cache: Path | None = None,
    packing: Packing | None = None,
    start: BedState | None = None,
    enough: Enough | None = None,
    progress: Progress | None = None,
) -> Run:
    """Simulate one operating point.

    Ctrl-C ends the run early: what there is so far comes back with `Status.INTERRUPTED`. A second one
    interrupts at once.

    Args:
        spec: what to simulate.
        folder: what files in the description are relative to; None: the working folder.
        cache: folder of stored packings; None: that of the user.
        packing: the bed to start from; None: pack, or take the stored one.
        start: where the particles are and how they move when the motion begins, as a run of the same bed left them;
            None: at rest, as packed. Speeds are in units of the container's, so that a bed that bounces keeps doing so
            at a neighbouring frequency or intensity.
        enough: called after every whole cycle; a run ends when it returns True, at the latest after the cycles that
            the description asks for. Only for motions with cycles.
        progress: called with stage, fraction done and seconds left, or None where these are not known yet.

    Raises:
        InputError: the bed does not fit, a file cannot be used, a particle starts outside, `start` is of another bed.
    """
    damper = spec.damper
    if packing is None:
        packing = pack(damper, folder=folder, cache=cache, progress=progress)
    if start is None and spec.run.settle is None:
        packing = turned(damper, packing, physics=PHYSICS, folder=folder, cache=cache, progress=progress)
    if start is not None and len(start.position) != len(packing.radius):
        raise InputError(
            f"start holds {len(start.position)} particles, the bed {len(packing.radius)}; start from a run of this bed"
        )
    scene = _scene(spec, packing, folder, start)
    worlds = engine.start(scene.worlds)
    with deferred() as interruption:
        if start is None:
            worlds = _settle(worlds, scene.plan, interruption, progress)
        worlds = _set_off(worlds, scene.motion, scene.plan, len(scene.enclosure.names), start, packing)
        notes = Notes(spec, worlds, packing, scene.enclosure, scene.plan, scene.contact_at_one)
        return _shake(worlds, notes, interruption, enough, progress)


def _shake(
    worlds: Worlds, notes: Notes, interruption: Interruption, enough: Enough | None, progress: Progress | None
) -> Run:
    """Move the container, until the end of the plan or an earlier one, and write down what happens."""
    spec, plan = notes.spec, notes.plan
    integrate = engine.run if spec.run.integrator == "verlet" else _gear(spec, notes.packing)
    start_clock = clock_of_the_wall.perf_counter()
    notes.energy(worlds)
    done, status = 0, 0
    try:
        for stop in plan.stops:
            if interruption.asked:
                break
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
            if enough is not None and plan.per_cycle and not stop % plan.per_cycle and enough(notes.cycles(worlds)):
                break
    except KeyboardInterrupt:
        interruption.asked = True
    seconds = clock_of_the_wall.perf_counter() - start_clock
    if interruption.asked and done < plan.n_step:
        status |= int(Status.INTERRUPTED)
    return notes.run(worlds, done, seconds, status)


class _Scene(NamedTuple):
    """A world about to be started, and what it follows from."""

    worlds: Worlds
    enclosure: Enclosure
    motion: Motion
    plan: Plan
    contact_at_one: float
    """Shortest contact at a speed of 1 m/s [s]."""


def _scene(spec: SimulationSpec, packing: Packing, folder: Path | None, start: BedState | None) -> _Scene:
    damper = spec.damper
    interactions = interactions_of(damper)
    enclosure = enclosure_of(damper, interactions, lid_height=packing.lid_height, folder=folder)
    material = np.asarray(interactions.component, np.int32)[packing.component]
    motion = motion_of(spec.motion, folder=folder)
    speed = expected_speed(motion, float(np.linalg.norm(damper.gravity)), float(packing.radius.max()))
    contact = shortest_contact(interactions, packing.radius, material, speed)
    plan = plan_of(spec, motion, spec.run.time_step or contact / spec.run.steps_per_contact)
    smallest = float(packing.radius.min())
    position = packing.position if start is None else np.ascontiguousarray(start.position)
    worlds = world_of(
        Bed.at_rest(position, packing.radius, material),
        enclosure,
        interactions,
        damper.gravity,
        plan.time_step,
        skin=min(max(SKIN_STEPS * speed * plan.time_step, 0.04 * smallest), 0.25 * smallest),
    )
    at_one = shortest_contact(interactions, packing.radius, material, 1.0)
    return _Scene(worlds, enclosure, motion, plan, at_one)


def _settle(worlds: Worlds, plan: Plan, interruption: Interruption, progress: Progress | None) -> Worlds:
    pieces = 20
    for piece in range(pieces):
        if interruption.asked:
            break
        worlds = engine.run(worlds, plan.n_settle * (piece + 1) // pieces - plan.n_settle * piece // pieces)
        if worlds.clock.status[0]:
            break
        if progress is not None:
            progress("settling", (piece + 1) / pieces, None)
    return worlds


def _set_off(
    worlds: Worlds, motion: Motion, plan: Plan, n_wall: int, start: BedState | None, packing: Packing
) -> Worlds:
    """The world with its container about to move.

    A container that starts with a speed leaves a resting bed behind: in its frame the particles start with the opposite
    one. A bed that another run left in motion goes on relative to the container as it was.
    """
    velocity, spin = velocity_now(worlds)
    motion.timing[0, START] = worlds.clock.time[0]
    move(0, worlds.clock.time[0], motion)
    n_sample = plan.n_step // plan.stride + 1
    record = empty_record(1, n_wall, n_sample, plan.stride, plan.n_cycle)
    worlds = worlds._replace(motion=motion, record=record)
    if start is None:
        velocity = velocity - motion.velocity[0]
    else:
        order, scale = worlds.particles.identity[0], speed_amplitude(worlds)
        velocity = scale * start.velocity[order]
        spin = scale * start.spin[order] / packing.radius[order, None]
    worlds.particles.velocity[0, :, :3] = velocity
    worlds.particles.spin[0, :, :3] = spin
    backend.shift(0, -0.5 * plan.time_step, worlds.particles, worlds.rules, worlds.motion)
    worlds.clock.drift[0, 3:7] = backend.BEYOND
    return worlds


def _gear(spec: SimulationSpec, packing: Packing) -> Callable[[Worlds, int], Worlds]:
    from graindamp.dem.gear import Gear

    return Gear(tolerance=(spec.run.tolerance or 1e-6) * float(packing.radius.min())).run
