"""The solver's loop: a panel of polynomials, the first event in it, what happens there."""

import numpy as np
from numpy.typing import NDArray

from graindamp.impact.compile import compiled, inner
from graindamp.impact.contacts import FRESH, load_mass, settle
from graindamp.impact.series import (
    DEGREE,
    NO_ROOT,
    crossing,
    drive_series,
    first_root,
    polynomial,
    structure_series,
)
from graindamp.impact.state import BASE_WORK, FORCE_WORK, VISCOUS, Log, Motion, Scratch, System

Array = NDArray[np.float64]

DONE, FULL, SMALL, STALLED = 0, 1, 2, 3
"""Why the loop ends: time is up, a table is full, the amplitude is small, events without advance in time."""
STALLED_EVENTS = 1000
"""Events without advance in time that cannot be right: no more than a few per ball occur."""
SAME = 1e-14
"""Coefficients below this part of their sum are rounding where a contact has just begun or ended [-]."""
ROUNDING = 1e-15
"""Rounding of the time, and a factor [-]."""
PATIENCE = 4
"""Events at one moment after which rounding is taken as larger."""

GAUSS_PLACE = (np.polynomial.legendre.leggauss(16)[0] + 1.0) / 2.0
GAUSS_WEIGHT = np.polynomial.legendre.leggauss(16)[1] / 2.0


@compiled
def advance(
    system: System,
    motion: Motion,
    log: Log,
    scratch: Scratch,
    t_end: float,
    panel: float,
    watch_shape: Array,
    watch_base: Array,
    small: float,
) -> int:
    """Follow the motion until `t_end` [s], a table is full, or two turning points in a row lie below `small` [m].

    Args:
        system: what stays.
        motion: what moves; changed in place.
        log: tables; filled in place.
        scratch: room for intermediate results.
        t_end: time to stop at [s].
        panel: longest panel [s].
        watch_shape: modes in the observed displacement (mode,).
        watch_base: drives in the observed displacement (drive,).
        small: displacement that ends the run [m]; 0 for none.
    """
    fresh, cw = scratch.number[FRESH], scratch.line[0]
    nb = motion.x.size
    ball, resting, touched, stalled = -1, False, True, 0
    while motion.clock[0] < t_end:
        if touched:
            settle(system, motion, log, scratch, panel, -1 if resting else ball, ball if resting else -1)
            load_mass(system, motion, scratch)
        for b in range(nb):
            fresh[b] = 1 if touched else 0
        touched = False
        if log.tally[0] + 3 * nb > log.events.shape[0] or log.tally[1] + 2 > log.peaks.shape[0]:
            return FULL
        t = motion.clock[0]
        last = t_end - t <= panel
        h = t_end - t if last else panel
        drive_series(system, t, h, scratch.cz)
        structure_series(system, motion, scratch, h)
        s, ball = 1.0, -1
        for b in range(nb):
            place = next_event(system, motion, b, scratch.cy[b], h, fresh[b] == 1, stalled, scratch.line[1])
            if place <= s:
                s, ball = place, b
        for k in range(DEGREE + 1):
            cw[k] = 0.0
            for i in range(watch_shape.size):
                cw[k] += watch_shape[i] * scratch.cq[i, k]
            for j in range(watch_base.size):
                cw[k] += watch_base[j] * scratch.cz[j, k]
        shrunk = watch(motion, log, cw, t, h, s, small)
        sample(motion, log, scratch, t, h, s)
        book(system, motion, scratch, h, s)
        move(motion, scratch, h, s)
        motion.clock[0] = t_end if last and s == 1.0 else t + s * h
        for b in range(nb):
            motion.left[b] = 0
        if ball >= 0:
            touched, resting = True, motion.wall[ball] != 0
            stalled = 0 if motion.clock[0] > t else stalled + 1
            if stalled > STALLED_EVENTS:
                return STALLED
        if shrunk:
            return SMALL
    return DONE


@inner
def next_event(
    system: System, motion: Motion, b: int, y: Array, h: float, fresh: bool, stalled: int, c: Array
) -> float:
    """Place in the panel where ball b meets a wall, or its contact force vanishes; NO_ROOT for neither.

    Where a contact has just begun or ended, the leading coefficients are zero but for rounding, that of the time
    included, and the root at the start is divided out. Rounding is taken as larger while time does not advance.
    """
    rounding = SAME + ROUNDING * abs(motion.clock[0]) / h
    if stalled > PATIENCE:
        rounding *= 10.0 ** min(stalled - PATIENCE, 6)
    spread = system.clearance[b]
    for k in range(DEGREE + 1):
        spread += abs(y[k])
    side = motion.wall[b]
    if side != 0:
        for k in range(DEGREE - 1):
            c[k] = side * (k + 1) * (k + 2) * y[k + 2]
        return divided_root(c, 0, DEGREE - 1, rounding * spread) if fresh else first_root(c, 0, DEGREE - 1)
    first = NO_ROOT
    for wall in (1, -1):
        c[0] = wall * (motion.x[b] - y[0]) + (0.0 if wall > 0 else system.clearance[b])
        c[1] = wall * (motion.u[b] * h - y[1])
        for k in range(2, DEGREE + 1):
            c[k] = -wall * y[k]
        if motion.left[b] == 2 * wall:
            first = min(first, first_root(c, 1, DEGREE + 1))
        elif motion.left[b] == wall:
            first = min(first, divided_root(c, 2, DEGREE + 1, rounding * spread))
        else:
            first = min(first, first_root(c, 0, DEGREE + 1))
    return first


@inner
def divided_root(c: Array, start: int, stop: int, rounding: float) -> float:
    """First zero in 0..1 of a polynomial divided by its root at 0; coefficients within rounding count as zero."""
    for k in range(start, min(start + 4, stop)):
        if abs(c[k]) > rounding:
            return first_root(c, k, stop)
    return NO_ROOT


@inner
def watch(motion: Motion, log: Log, cw: Array, t: float, h: float, s: float, small: float) -> bool:
    """Note turning points and largest speeds of the observed displacement; whether the last two points are small."""
    clock = motion.clock
    speed_start, speed_end = polynomial(cw, 0.0)[1] / h, polynomial(cw, s)[1] / h
    bend_start, bend_end = polynomial(cw, 0.0)[2], polynomial(cw, s)[2]
    fastest = crossing(cw, 2, 0.0, s) if bend_start * bend_end < 0.0 else -1.0
    turn = -1.0
    if clock[1] * speed_start < 0.0:
        turn = 0.0
    elif speed_start * speed_end < 0.0:
        turn = crossing(cw, 1, 0.0, s)
    small_before = log.tally[1] > 0 and abs(log.peaks[log.tally[1] - 1, 1]) < small
    if turn != 0.0:
        clock[2] = max(clock[2], abs(speed_start))
    if fastest >= 0.0 and (turn < 0.0 or fastest < turn):
        clock[2] = max(clock[2], abs(polynomial(cw, fastest)[1]) / h)
    if turn >= 0.0:
        row = log.tally[1]
        log.peaks[row, 0], log.peaks[row, 1], log.peaks[row, 2] = t + turn * h, polynomial(cw, turn)[0], clock[2]
        log.tally[1] += 1
        clock[2] = abs(speed_start) if turn == 0.0 else 0.0
        if fastest >= turn:
            clock[2] = max(clock[2], abs(polynomial(cw, fastest)[1]) / h)
    clock[2] = max(clock[2], abs(speed_end))
    if speed_end != 0.0:
        clock[1] = 1.0 if speed_end > 0.0 else -1.0
    return turn >= 0.0 and small_before and abs(log.peaks[log.tally[1] - 1, 1]) < small


@inner
def sample(motion: Motion, log: Log, scratch: Scratch, t: float, h: float, s: float) -> None:
    """Write the samples that fall into the panel up to s."""
    while log.tally[2] < log.sample_time.size:
        row = log.tally[2]
        place = (log.sample_time[row] - t) / h
        if place > s:
            break
        place = max(place, 0.0)
        for i in range(motion.q.size):
            log.sample_q[row, i], slope, _ = polynomial(scratch.cq[i], place)
            log.sample_v[row, i] = slope / h
        for b in range(motion.x.size):
            log.sample_x[row, b], log.sample_u[row, b] = ball_state(motion, b, scratch.cy[b], h, place)
        log.tally[2] += 1


@inner
def ball_state(motion: Motion, b: int, c: Array, h: float, place: float) -> tuple[float, float]:
    """Position [m] and velocity [m/s] of ball b within the panel."""
    if motion.wall[b] == 0:
        return motion.x[b] + motion.u[b] * h * place, motion.u[b]
    y, slope, _ = polynomial(c, place)
    return motion.x[b] + (y - c[0]), slope / h


@inner
def book(system: System, motion: Motion, scratch: Scratch, h: float, s: float) -> None:
    """Add viscous loss and the work of forces and prescribed motions up to s to the ledger, by Gauss's rule."""
    nd = scratch.cz.shape[0]
    viscous, force_work, base_work = 0.0, 0.0, 0.0
    for g in range(GAUSS_PLACE.size):
        place, weight = s * GAUSS_PLACE[g], s * h * GAUSS_WEIGHT[g]
        for i in range(motion.q.size):
            if system.damping[i] == 0.0 and nd == 0:
                continue
            velocity = polynomial(scratch.cq[i], place)[1] / h
            viscous += weight * system.damping[i] * velocity * velocity
            for j in range(nd):
                force_work += weight * velocity * system.force[i, j] * polynomial(scratch.cz[j], place)[0]
        for b in range(motion.x.size):
            if motion.wall[b] != 0 and nd > 0:
                contact_force = system.mass[b] * polynomial(scratch.cy[b], place)[2] / (h * h)
                for j in range(nd):
                    base_work += weight * contact_force * system.base[b, j] * polynomial(scratch.cz[j], place)[1] / h
    motion.ledger[VISCOUS] += viscous
    motion.ledger[FORCE_WORK] += force_work
    motion.ledger[BASE_WORK] += base_work


@inner
def move(motion: Motion, scratch: Scratch, h: float, s: float) -> None:
    """Bring modes and balls to place s of the panel."""
    for b in range(motion.x.size):
        motion.x[b], motion.u[b] = ball_state(motion, b, scratch.cy[b], h, s)
    for i in range(motion.q.size):
        value, slope, _ = polynomial(scratch.cq[i], s)
        motion.q[i] = value
        motion.v[i] = slope / h
