"""The loop over steps and worlds on the processor.

Velocity Verlet in leapfrog form: velocities live at mid-step, and the contacts see them extrapolated to the time of the
positions, v + a dt/2. With that the scheme stays of second order although the forces depend on velocity.
"""

from math import cos, sin, sqrt

from graindamp.dem.columns import (
    FORCE_COS,
    FORCE_SIN,
    N_STEP,
    SPEED_COS,
    SPEED_SIN,
    WORK_CONTAINER,
)
from graindamp.dem.compile import compiled, merged
from graindamp.dem.contact import find_touching, pair_forces
from graindamp.dem.motion import DIRECTION, FUNDAMENTAL, START, move
from graindamp.dem.neighbours import INNER_STEPS, narrow_pairs, refresh_pairs
from graindamp.dem.wall_contact import narrow_touches, refresh_touches, wall_forces

NEW, RUNNING, HALTED = 0, 1, 2
"""Stages of a world: not started, between two steps, in a step whose lists had no room."""

BEYOND = 1e9
"""A bound that no list meets [m]."""

TURN = 6.283185307179586


@compiled
def advance(first, last, target, worlds):
    """Step worlds `first` to `last` - 1 until each has done `target` steps, or until a status bit stops it.

    A world that has not started gets the forces at its first positions, and its velocities are taken back from there to
    mid-step. A world whose lists had no room takes its step up where it stopped.
    """
    particles, pairs, touches, walls = worlds.particles, worlds.pairs, worlds.touches, worlds.walls
    rules, clock, motion, record, scratch = worlds.rules, worlds.clock, worlds.motion, worlds.record, worlds.scratch
    for w in range(first, last):
        bounds, dt = clock.drift[w], rules.time_step[w]
        while clock.status[w] == 0 and (clock.step[w] < target or clock.stage[w] != RUNNING):
            if clock.stage[w] == RUNNING:
                fastest = drift(w, particles, rules, motion, clock)
                clock.step[w] += 1
                clock.time[w] = clock.step[w] * dt
                move(w, clock.time[w], motion)
                fall_due(w, fastest, dt, clock)
            elif clock.stage[w] == NEW:
                move(w, clock.time[w], motion)
                for k in range(3, 7):
                    bounds[k] = BEYOND
            now = clock.step[w]
            if not renew_lists(w, particles, pairs, touches, walls, rules, clock, scratch):
                break
            narrow(w, particles, pairs, touches, walls, rules, clock)
            find_touching(w, particles, pairs)
            pair_forces(w, now, particles, pairs, rules, record, scratch)
            wall_forces(w, now, particles, touches, walls, rules, record, scratch)
            if clock.stage[w] == NEW:
                shift(w, -0.5 * dt, particles, rules, motion)
            else:
                clock.counts[w, 2] += pairs.n_active[w]
                clock.counts[w, 3] += touches.n_active[w] + touches.n_soft[w]
                observe(w, motion, rules, clock, walls.n_group[w], record)
            clock.stage[w] = RUNNING


@merged
def renew_lists(w, particles, pairs, touches, walls, rules, clock, scratch):
    """Renew the outer lists of world w where their bounds are reached. False: a status bit stops the world."""
    bounds, now = clock.drift[w], clock.step[w]
    if 2.0 * bounds[4] < rules.skin[w] and bounds[6] < rules.skin[w]:
        return True
    status = refresh_pairs(w, now - 1, particles, pairs, rules, scratch)
    if status == 0:
        status = refresh_touches(w, now - 1, particles, touches, walls, rules, scratch)
    if status != 0:
        clock.status[w] |= status
        if clock.stage[w] == RUNNING:
            clock.stage[w] = HALTED
        return False
    carry(w, particles, bounds)
    for k in range(3, 9):
        bounds[k] = 0.0
    clock.counts[w, 0] += 1
    return True


@merged
def narrow(w, particles, pairs, touches, walls, rules, clock):
    """Renew the inner lists of world w where their bounds are reached."""
    bounds = clock.drift[w]
    if 2.0 * bounds[3] >= bounds[7]:
        bounds[7] = min(2.0 * INNER_STEPS * bounds[9], rules.skin[w] - 2.0 * bounds[4])
        bounds[3] = 0.0
        narrow_pairs(w, particles, pairs, bounds[7])
        clock.counts[w, 1] += 1
    if bounds[5] >= bounds[8]:
        bounds[8] = min(INNER_STEPS * (bounds[9] + bounds[10]), rules.skin[w] - bounds[6])
        bounds[5] = 0.0
        narrow_touches(w, particles, touches, walls, bounds[8])


@compiled
def shift(w, time, particles, rules, motion):
    """Let velocities and spins change by the present accelerations over `time` [s]; half a step brings them to
    mid-step."""
    for i in range(particles.n_particle[w]):
        inverse, inverse_inertia = particles.inverse_mass[w, i, 0], particles.inverse_mass[w, i, 1]
        for c in range(3):
            body = rules.gravity[w, c] - motion.acceleration[w, c]
            particles.velocity[w, i, c] += time * (particles.load[w, i, c] * inverse + body)
            particles.spin[w, i, c] += time * particles.load[w, i, 4 + c] * inverse_inertia


@merged
def drift(w, particles, rules, motion, clock):
    """Kick by the forces of the last positions, move, clear the forces. Returns the largest speed relative to the
    carried velocity [m/s]."""
    position, velocity, spin = particles.position[w], particles.velocity[w], particles.spin[w]
    seen, load, inverse_mass = particles.seen[w], particles.load[w], particles.inverse_mass[w]
    dt = rules.time_step[w]
    half = 0.5 * dt
    # The container's acceleration is felt as a body force in its frame.
    bx = rules.gravity[w, 0] - motion.acceleration[w, 0]
    by = rules.gravity[w, 1] - motion.acceleration[w, 1]
    bz = rules.gravity[w, 2] - motion.acceleration[w, 2]
    cx, cy, cz = clock.drift[w, 0], clock.drift[w, 1], clock.drift[w, 2]
    fastest = 0.0
    for i in range(particles.n_particle[w]):
        # Whole rows of four, the fourth number idle, so that the compiler can use one vector instruction for each line.
        inverse = inverse_mass[i, 0]
        a0 = load[i, 0] * inverse + bx
        a1 = load[i, 1] * inverse + by
        a2 = load[i, 2] * inverse + bz
        a3 = load[i, 3] * inverse
        v0 = velocity[i, 0] + dt * a0
        v1 = velocity[i, 1] + dt * a1
        v2 = velocity[i, 2] + dt * a2
        v3 = velocity[i, 3] + dt * a3
        x0 = position[i, 0] + dt * v0
        x1 = position[i, 1] + dt * v1
        x2 = position[i, 2] + dt * v2
        x3 = position[i, 3] + dt * v3
        velocity[i, 0], velocity[i, 1], velocity[i, 2], velocity[i, 3] = v0, v1, v2, v3
        position[i, 0], position[i, 1], position[i, 2], position[i, 3] = x0, x1, x2, x3
        seen[i, 0] = v0 + half * a0
        seen[i, 1] = v1 + half * a1
        seen[i, 2] = v2 + half * a2
        seen[i, 3] = v3 + half * a3
        load[i, 0], load[i, 1], load[i, 2], load[i, 3] = 0.0, 0.0, 0.0, 0.0
        fastest = max(fastest, (v0 - cx) * (v0 - cx) + (v1 - cy) * (v1 - cy) + (v2 - cz) * (v2 - cz))
        inverse = inverse_mass[i, 1]
        a0 = load[i, 4] * inverse
        a1 = load[i, 5] * inverse
        a2 = load[i, 6] * inverse
        a3 = load[i, 7] * inverse
        v0 = spin[i, 0] + dt * a0
        v1 = spin[i, 1] + dt * a1
        v2 = spin[i, 2] + dt * a2
        v3 = spin[i, 3] + dt * a3
        spin[i, 0], spin[i, 1], spin[i, 2], spin[i, 3] = v0, v1, v2, v3
        seen[i, 4] = v0 + half * a0
        seen[i, 5] = v1 + half * a1
        seen[i, 6] = v2 + half * a2
        seen[i, 7] = v3 + half * a3
        load[i, 4], load[i, 5], load[i, 6], load[i, 7] = 0.0, 0.0, 0.0, 0.0
    return sqrt(fastest)


@merged
def fall_due(w, fastest, time_step, clock):
    """Let the bounds on motion since the last refreshes grow by what the fastest particle moved in this step."""
    bounds = clock.drift[w]
    way = fastest * time_step
    carried = sqrt(bounds[0] * bounds[0] + bounds[1] * bounds[1] + bounds[2] * bounds[2]) * time_step
    bounds[3] += way
    bounds[4] += way
    bounds[5] += way + carried
    bounds[6] += way + carried
    bounds[9] = way
    bounds[10] = carried


@merged
def carry(w, particles, bounds):
    """Mean velocity of the bed, which the bounds are relative to from now on."""
    velocity, n = particles.velocity[w], particles.n_particle[w]
    x, y, z = 0.0, 0.0, 0.0
    for i in range(n):
        x += velocity[i, 0]
        y += velocity[i, 1]
        z += velocity[i, 2]
    bounds[0], bounds[1], bounds[2] = x / n, y / n, z / n


@merged
def observe(w, motion, rules, clock, n_group, record):
    """Write down a step: its sums, and a block mean where one is complete."""
    dt = rules.time_step[w]
    note(w, 1.0, dt, clock.time[w] - 0.5 * dt, motion, clock, n_group, record)
    record.n_pending[w] += 1
    if record.n_pending[w] == record.stride[w]:
        close_sample(w, n_group, record)


@merged
def note(w, weight, time_step, middle, motion, clock, n_group, record):
    """Add the present forces to the sums, with `weight` nominal time steps: work, block means, Fourier sums of a cycle.

    They are counted to the cycle that the time `middle` [s] lies in.
    """
    force, pending, speed = record.wall_force[w], record.pending[w], motion.velocity[w]
    power, along, quick = 0.0, 0.0, 0.0
    timing = motion.timing[w]
    for g in range(n_group):
        for c in range(3):
            pending[g, c] += weight * force[g, c]
            power += force[g, c] * speed[c]
            along += force[g, c] * timing[DIRECTION + c]
    for c in range(3):
        pending[n_group, c] += weight * speed[c]
        quick += speed[c] * timing[DIRECTION + c]
    record.ledger[w, WORK_CONTAINER] -= power * weight * time_step
    omega = timing[FUNDAMENTAL]
    if omega > 0.0:
        phase = omega * (clock.time[w] - timing[START])
        cycle = int(omega * (middle - timing[START]) / TURN)
        if middle > timing[START] and cycle < record.fourier.shape[1]:
            sums = record.fourier[w, cycle]
            a, b = weight * cos(phase), weight * sin(phase)
            sums[FORCE_COS] += along * a
            sums[FORCE_SIN] += along * b
            sums[SPEED_COS] += quick * a
            sums[SPEED_SIN] += quick * b
            sums[N_STEP] += weight


@compiled
def close_sample(w, n_group, record):
    """Write down the block mean under way and begin the next one."""
    sample = record.n_sample[w]
    if sample < record.series.shape[1]:
        for g in range(n_group + 1):
            for c in range(3):
                record.series[w, sample, g, c] = record.pending[w, g, c] / record.stride[w]
        record.n_sample[w] = sample + 1
    for g in range(n_group + 1):
        for c in range(3):
            record.pending[w, g, c] = 0.0
    record.n_pending[w] = 0
