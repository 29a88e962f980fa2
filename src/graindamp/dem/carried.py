"""The loop over steps of worlds whose containers a structure carries: force and motion are exchanged every step."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
from numpy.typing import NDArray

from graindamp.dem.backend import BEYOND, HALTED, NEW, RUNNING, drift, fall_due, narrow, observe, renew_lists, shift
from graindamp.dem.columns import WORK_CONTAINER
from graindamp.dem.compile import compiled, merged
from graindamp.dem.contact import find_touching, pair_forces
from graindamp.dem.engine import with_room
from graindamp.dem.oscillators import (
    TURN_RATE,
    Oscillators,
    answer,
    carry_container,
    gather,
    moment_of,
    sample,
    swing,
    swirl,
)
from graindamp.dem.precompile import first_compilation
from graindamp.dem.state import Worlds
from graindamp.dem.wall_contact import wall_forces
from graindamp.status import Status


@compiled
def advance_carried(first, last, target, oscillators, worlds):
    """Step structures `first` to `last` - 1 with the worlds they carry until each has done its `target` steps, or a
    status bit stops one of its worlds.

    A step of a structure that was stopped in the middle is taken up where it stopped: worlds that have moved but lack
    their forces are marked as halted.
    """
    clock, rules = worlds.clock, worlds.rules
    for s in range(first, last):
        begin = oscillators.first[s]
        end = begin + oscillators.n_world[s]
        dt = rules.time_step[begin]
        while oscillators.step[s] < target[s] and is_sound(begin, end, clock):
            if oscillators.step[s] == clock.step[begin]:
                swing(s, dt, oscillators)
                for w in range(begin, end):
                    depart(w, worlds)
            if not touch(begin, end, worlds):
                break
            for w in range(begin, end):
                gather(s, w, oscillators, worlds.particles, worlds.record, worlds.walls.n_group[w])
            is_new = oscillators.step[s] < 0
            answer(s, clock.step[begin] * dt, dt, is_new, oscillators)
            for w in range(begin, end):
                follow(s, w, dt, is_new, oscillators, worlds)
            oscillators.step[s] = clock.step[begin]
            sample(s, dt, worlds.record.stride[begin], oscillators)


@merged
def is_sound(begin, end, clock):
    """Whether no status bit stops a world of those of a structure."""
    status = 0
    for w in range(begin, end):
        status |= clock.status[w]
    return status == 0


@merged
def depart(w, worlds):
    """Move the particles of world w by a step."""
    clock, dt = worlds.clock, worlds.rules.time_step[w]
    fastest = drift(w, worlds.particles, worlds.rules, worlds.motion, clock)
    clock.step[w] += 1
    clock.time[w] = clock.step[w] * dt
    clock.stage[w] = HALTED
    fall_due(w, fastest, dt, clock)


@merged
def touch(begin, end, worlds):
    """Forces in all worlds of a structure that lack them. False: a status bit stops one of them."""
    particles, pairs, touches, walls = worlds.particles, worlds.pairs, worlds.touches, worlds.walls
    rules, clock, record, scratch = worlds.rules, worlds.clock, worlds.record, worlds.scratch
    for w in range(begin, end):
        if clock.stage[w] == RUNNING:
            continue
        now = clock.step[w]
        if clock.stage[w] == NEW:
            for k in range(3, 7):
                clock.drift[w, k] = BEYOND
        if not renew_lists(w, particles, pairs, touches, walls, rules, clock, scratch):
            return False
        narrow(w, particles, pairs, touches, walls, rules, clock)
        find_touching(w, particles, pairs)
        pair_forces(w, now, particles, pairs, rules, record, scratch)
        wall_forces(w, now, particles, touches, walls, rules, record, scratch)
        clock.stage[w] = RUNNING
    return True


@merged
def follow(s, w, time_step, is_new, oscillators, worlds):
    """Let container and particles of world w feel the acceleration of structure s, and write the step down."""
    particles, clock, record = worlds.particles, worlds.clock, worlds.record
    carry_container(s, w, time_step, oscillators, worlds.rules, worlds.motion)
    if oscillators.turns[w] > 0:
        power = oscillators.turn[w, TURN_RATE] * moment_of(w, oscillators, particles)
        if not is_new:
            record.ledger[w, WORK_CONTAINER] -= power * time_step
        swirl(w, oscillators, particles)
    if is_new:
        shift(w, -0.5 * time_step, particles, worlds.rules, worlds.motion)
    else:
        clock.counts[w, 2] += worlds.pairs.n_active[w]
        clock.counts[w, 3] += worlds.touches.n_active[w] + worlds.touches.n_soft[w]
        observe(w, worlds.motion, worlds.rules, clock, worlds.walls.n_group[w], record)


def run_carried(oscillators: Oscillators, worlds: Worlds, target: NDArray[np.int64], n_thread: int = 1) -> Worlds:
    """Structures and worlds at a later step; arrays are changed in place, and renewed only where lists had to grow.

    Args:
        oscillators: the structures, which are changed in place.
        worlds: all that they carry, new from :func:`graindamp.dem.world.world_of` or as this function left them.
        target: step that each structure shall have done [-]; 0 finds the forces at the first positions; (structure,).
        n_thread: processor cores to use; each takes the next structure.
    """
    first_compilation(advance_carried, 0, 1, target, oscillators, worlds)
    full = int(Status.LISTS_FULL)
    while True:
        _advance_all(target, oscillators, worlds, n_thread)
        if not np.any(worlds.clock.status & full):
            return worlds
        worlds = with_room(worlds)
        worlds.clock.status[:] &= ~full


def _advance_all(target: NDArray[np.int64], oscillators: Oscillators, worlds: Worlds, n_thread: int) -> None:
    n_structure = len(oscillators.step)
    if n_thread == 1 or n_structure == 1:
        advance_carried(0, n_structure, target, oscillators, worlds)
        return
    with ThreadPoolExecutor(n_thread) as pool:
        jobs = [pool.submit(advance_carried, s, s + 1, target, oscillators, worlds) for s in range(n_structure)]
        for job in jobs:
            job.result()
