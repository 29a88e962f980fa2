"""What happens at a wall: impulses, rest and release, for all balls that touch one at the same moment."""

from math import cos, sin

import numpy as np
from numpy.typing import NDArray

from graindamp.impact.compile import inner
from graindamp.impact.state import BASE_WORK, IMPACT, IMPACTS, RELEASE, STICK, Log, Motion, Scratch, System

Array = NDArray[np.float64]

TOUCHING = 2e-15
"""A ball nearer to a wall than this part of clearance plus displacements touches it [-]: rounding of positions."""
AT_REST = 1e-14
"""A ball slower against its wall than this part of their speeds does not move against it [-]: rounding of speeds."""
CAPTURED = 1e-16
"""Bounces lower than this part of the clearance end at once [-]: positions cannot tell."""
LEAST_LOSS = 1e-3
"""Least 1 - R with which the time left to bounces is estimated [-]: balls without loss would bounce for ever."""
AHEAD = 1e-9
"""Part of a panel by which the jerk decides where the acceleration at a wall is zero [-]."""
VANISHING = 1e-11
"""Contact forces below this part of the terms of accelerations vanish with that of a ball just released [-]."""
SEPARATION, RESTITUTION, OFFSET, SOLUTION, RIGHT = 0, 1, 2, 3, 4
SIDE, MEMBER, ACTIVE, FRESH = 0, 1, 2, 3


@inner
def settle(
    system: System, motion: Motion, log: Log, scratch: Scratch, panel: float, struck: int, released: int
) -> None:
    """Exchange impulses of all balls that touch a wall, then find which of them stay on it.

    Impulses J >= 0 make every separation speed w of touching balls at least -R times its value before, exactly that
    where J > 0: Newton's rule for one ball, and energy never grows for several. A ball that no longer moves against its
    wall stays where the wall pushes.

    Args:
        system: what stays.
        motion: what moves; changed in place.
        log: where events are written.
        scratch: room for intermediate results.
        panel: length of a panel [s].
        struck: number of the ball whose gap has just closed, -1 for none.
        released: number of the ball whose contact force has just vanished, -1 for none.

    Source: Moreau (1988), in Nonsmooth Mechanics and Applications, CISM 302, 1-82, without friction.
    """
    cavity_states(system, motion, scratch)
    side = scratch.number[SIDE]
    for b in range(motion.x.size):
        y, clearance = scratch.cavity[0, b], system.clearance[b]
        below = motion.x[b] - y
        above = clearance - below
        near = TOUCHING * (clearance + scratch.cavity[4, b])
        side[b] = motion.wall[b]
        if side[b] != 0:
            motion.u[b] = scratch.cavity[1, b]
        elif b == struck or below <= near or above <= near:
            side[b] = 1 if below < above else -1
        if side[b] != 0:
            motion.x[b] = y if side[b] > 0 else y + clearance
    if exchange(system, motion, log, scratch):
        cavity_states(system, motion, scratch)
    if catch(system, motion, scratch):
        cavity_states(system, motion, scratch)
    rest(system, motion, log, scratch, panel, released)


@inner
def cavity_states(system: System, motion: Motion, scratch: Scratch) -> None:
    """Displacement to jerk of each cavity, as if no ball rested on its wall, to scratch.

    Rows 4 to 6 are the sums of the moduli of all terms of displacement, velocity and acceleration, the ball's own
    included: rounding is a part of them, not of what is left where terms cancel.
    """
    z, pull, state, t = scratch.drive, scratch.modal, scratch.cavity, motion.clock[0]
    for j in range(z.shape[1]):
        w = system.drive_omega[j]
        c, s = cos(w * t + system.drive_phase[j]), sin(w * t + system.drive_phase[j])
        z[0, j], z[1, j], z[2, j], z[3, j] = c, -w * s, -w * w * c, w * w * w * s
    for i in range(motion.q.size):
        acceleration = -system.damping[i] * motion.v[i] - system.omega_squared[i] * motion.q[i]
        change = -system.omega_squared[i] * motion.v[i]
        for j in range(z.shape[1]):
            acceleration += system.force[i, j] * z[0, j]
            change += system.force[i, j] * z[1, j]
        pull[0, i] = acceleration
        pull[1, i] = change - system.damping[i] * acceleration
    for b in range(motion.x.size):
        for order in range(4):
            total = 0.0
            for j in range(z.shape[1]):
                total += system.base[b, j] * z[order, j]
            state[order, b] = total
        state[4, b], state[5, b], state[6, b] = abs(motion.x[b]), abs(motion.u[b]), 0.0
        for j in range(z.shape[1]):
            state[4, b] += abs(system.base[b, j] * z[0, j])
            state[5, b] += abs(system.base[b, j] * z[1, j])
            state[6, b] += abs(system.base[b, j] * z[2, j])
        for i in range(motion.q.size):
            state[0, b] += system.shape[b, i] * motion.q[i]
            state[1, b] += system.shape[b, i] * motion.v[i]
            state[2, b] += system.shape[b, i] * pull[0, i]
            state[3, b] += system.shape[b, i] * pull[1, i]
            state[4, b] += abs(system.shape[b, i] * motion.q[i])
            state[5, b] += abs(system.shape[b, i] * motion.v[i])
            state[6, b] += abs(system.shape[b, i] * pull[0, i])


@inner
def exchange(system: System, motion: Motion, log: Log, scratch: Scratch) -> bool:
    """Impulses between walls and the balls that touch them and do not separate; whether there were any."""
    t, m, struck = motion.clock[0], 0, False
    state, number, contact = scratch.cavity, scratch.number, scratch.contact
    for b in range(motion.x.size):
        side = number[SIDE, b]
        separation = side * (motion.u[b] - state[1, b])
        slow = AT_REST * state[5, b]
        if side == 0 or separation > slow:
            continue
        number[MEMBER, m] = b
        contact[SEPARATION, m] = contact[RESTITUTION, m] = contact[OFFSET, m] = 0.0
        if separation < -slow:
            struck = True
            restitution = system.restitution[b]
            contact[SEPARATION, m] = separation
            contact[RESTITUTION, m] = restitution
            contact[OFFSET, m] = (1.0 + restitution) * separation
        m += 1
    if not struck:
        return False
    solve_contacts(system, scratch, m)
    for i in range(m):
        b, impulse = number[MEMBER, i], contact[SOLUTION, i]
        if impulse <= 0.0:
            continue
        side, before = number[SIDE, b], contact[SEPARATION, i]
        loss = -0.5 * impulse * (1.0 - contact[RESTITUTION, i]) * before
        push_ball(system, motion, scratch, b, impulse, loss)
        note(log, t, b, IMPACT, side, -before, impulse, loss)
    return True


@inner
def catch(system: System, motion: Motion, scratch: Scratch) -> bool:
    """End bounces lower than positions can tell, where the wall keeps pushing until they would have ended.

    The balls concerned, and those at rest beside them, take the velocity of their walls by impulses that conserve
    momentum; the loss is that of the bounces left out. Whether there were any.
    """
    m, caught = 0, False
    state, number, contact = scratch.cavity, scratch.number, scratch.contact
    for b in range(motion.x.size):
        side = number[SIDE, b]
        push, separation = side * state[2, b], side * (motion.u[b] - state[1, b])
        if side == 0 or push <= 0.0 or separation < 0.0:
            continue
        slow = AT_REST * state[5, b]
        left = max(1.0 - system.restitution[b], LEAST_LOSS)
        low = separation * separation <= 2.0 * push * CAPTURED * system.clearance[b] * left
        if separation <= slow or (low and 2.0 * separation * abs(state[3, b]) <= 0.1 * push * push * left):
            caught = caught or separation > slow
            number[MEMBER, m], number[ACTIVE, m] = b, 1
            contact[OFFSET, m] = separation
            m += 1
    if not caught:
        return False
    fill_matrix(system, scratch, m)
    solve_active(number, contact, scratch.matrix[0], scratch.matrix[1], m)
    for i in range(m):
        b, impulse = number[MEMBER, i], contact[SOLUTION, i]
        push_ball(system, motion, scratch, b, impulse, -0.5 * impulse * contact[OFFSET, i])
    return True


@inner
def push_ball(system: System, motion: Motion, scratch: Scratch, b: int, impulse: float, loss: float) -> None:
    """Apply the impulse of a wall on ball b and its reaction, and book loss and work."""
    side = scratch.number[SIDE, b]
    motion.u[b] += side * impulse / system.mass[b]
    for k in range(motion.v.size):
        motion.v[k] -= system.shape[b, k] * side * impulse
    motion.ledger[IMPACTS] += loss
    for j in range(scratch.drive.shape[1]):
        motion.ledger[BASE_WORK] += side * impulse * system.base[b, j] * scratch.drive[1, j]


@inner
def rest(system: System, motion: Motion, log: Log, scratch: Scratch, panel: float, released: int) -> None:
    """Which touching balls stay on their wall, and which leave it.

    When the contact force of one has just vanished, others whose force is zero but for rounding leave with it.
    """
    t, m = motion.clock[0], 0
    ahead = AHEAD * panel if released < 0 else 0.0
    state, number, contact = scratch.cavity, scratch.number, scratch.contact
    for b in range(motion.x.size):
        slow = 4.0 * AT_REST * state[5, b]
        motion.left[b] = 0
        if number[SIDE, b] != 0 and abs(motion.u[b] - state[1, b]) > slow:
            motion.left[b] = 2 * number[SIDE, b]
        elif number[SIDE, b] != 0 and b != released:
            number[MEMBER, m] = b
            contact[OFFSET, m] = -number[SIDE, b] * (state[2, b] + ahead * state[3, b])
            m += 1
    solve_contacts(system, scratch, m)
    i = 0
    for b in range(motion.x.size):
        side, was, stays, vanishing = number[SIDE, b], motion.wall[b], False, 0.0
        if i < m and number[MEMBER, i] == b:
            if released >= 0:
                vanishing = VANISHING * state[6, b] + AHEAD * panel * abs(state[3, b])
            stays = contact[SOLUTION, i] * scratch.matrix[0, i, i] > vanishing
            i += 1
        motion.wall[b] = side if stays else 0
        if motion.left[b] == 0 and not stays:
            motion.left[b] = side
        if side != 0 and motion.left[b] != 2 * side:
            motion.u[b] = state[1, b]
        if was == 0 and stays:
            note(log, t, b, STICK, side, 0.0, 0.0, 0.0)
        elif was != 0 and not stays:
            note(log, t, b, RELEASE, side, 0.0, 0.0, 0.0)


@inner
def solve_contacts(system: System, scratch: Scratch, m: int) -> None:
    """z >= 0 with w = A z + offset >= 0 and z w = 0 for the first m members, to scratch.

    A is that of :func:`fill_matrix`, symmetric positive definite.

    Source: least-index principal pivoting, Murty (1974), Opsearch 11, 123-135; finite for such matrices.
    """
    number, contact, a, work = scratch.number, scratch.contact, scratch.matrix[0], scratch.matrix[1]
    fill_matrix(system, scratch, m)
    largest = 0.0
    for i in range(m):
        number[ACTIVE, i] = 0
        contact[SOLUTION, i] = 0.0
        largest = max(largest, abs(contact[OFFSET, i]))
    for _ in range(1 << min(m + 4, 40)):
        wrong = -1
        for i in range(m):
            gap = contact[OFFSET, i]
            for j in range(m):
                gap += a[i, j] * contact[SOLUTION, j]
            test = contact[SOLUTION, i] * a[i, i] if number[ACTIVE, i] == 1 else gap
            if test < -1e-14 * largest:
                wrong = i
                break
        if wrong < 0:
            break
        number[ACTIVE, wrong] = 1 - number[ACTIVE, wrong]
        solve_active(number, contact, a, work, m)


@inner
def fill_matrix(system: System, scratch: Scratch, m: int) -> None:
    """Change of the separation rate of member i per impulse on member j [1/kg], to scratch."""
    number, a = scratch.number, scratch.matrix[0]
    for i in range(m):
        bi = number[MEMBER, i]
        for j in range(m):
            bj = number[MEMBER, j]
            total = 1.0 / system.mass[bi] if i == j else 0.0
            for k in range(system.shape.shape[1]):
                total += number[SIDE, bi] * number[SIDE, bj] * system.shape[bi, k] * system.shape[bj, k]
            a[i, j] = total


@inner
def solve_active(number: NDArray[np.int64], contact: Array, a: Array, work: Array, m: int) -> None:
    """Solve A z = -offset for the active members, z = 0 for the others, by elimination."""
    for i in range(m):
        active = number[ACTIVE, i] == 1
        contact[RIGHT, i] = -contact[OFFSET, i] if active else 0.0
        for j in range(m):
            work[i, j] = a[i, j] if active and number[ACTIVE, j] == 1 else (1.0 if i == j else 0.0)
    for i in range(m):
        for k in range(i + 1, m):
            factor = work[k, i] / work[i, i]
            for j in range(i, m):
                work[k, j] -= factor * work[i, j]
            contact[RIGHT, k] -= factor * contact[RIGHT, i]
    for i in range(m - 1, -1, -1):
        total = contact[RIGHT, i]
        for j in range(i + 1, m):
            total -= work[i, j] * contact[SOLUTION, j]
        contact[SOLUTION, i] = total / work[i, i]


@inner
def load_mass(system: System, motion: Motion, scratch: Scratch) -> None:
    """Inverse of the modal mass matrix with the balls at rest on walls, by rank-one updates of the unit matrix."""
    inverse, row = scratch.inverse_mass, scratch.modal[0]
    n = inverse.shape[0]
    for i in range(n):
        for j in range(n):
            inverse[i, j] = 1.0 if i == j else 0.0
    for b in range(motion.wall.size):
        if motion.wall[b] == 0:
            continue
        loaded = 1.0
        for i in range(n):
            total = 0.0
            for j in range(n):
                total += inverse[i, j] * system.shape[b, j]
            row[i] = total
            loaded += system.mass[b] * system.shape[b, i] * total
        for i in range(n):
            for j in range(n):
                inverse[i, j] -= system.mass[b] / loaded * row[i] * row[j]


@inner
def note(log: Log, t: float, ball: int, kind: int, side: int, speed: float, impulse: float, loss: float) -> None:
    """Write an event down."""
    row = log.events[log.tally[0]]
    row[0], row[1], row[2], row[3], row[4], row[5], row[6] = t, ball, kind, side, speed, impulse, loss
    log.tally[0] += 1
