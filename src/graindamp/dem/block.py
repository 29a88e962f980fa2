"""Arithmetic of a block: up to LANE contacts side by side, between particles or with walls.

Who gathers a block writes what it knows of each contact as rows of four numbers, one row a contact (`BRANCH` to
`TURN`), as the particles have them; the arithmetic runs along lines of LANE numbers, one line a quantity, so that the
compiler can use vector instructions; forces leave as rows of four again (`FORCE`, `TORQUE`). Idle lanes compute with
what an earlier block left there, and are never used.

The second body of a contact is another particle or a wall. A wall stands still and is never turned, so that only
gathering, scattering and what looks at the second body's numbers tell the two apart."""

from math import sqrt

from graindamp.dem.columns import (
    DAMPING,
    GRIP_FRICTION,
    GRIP_STIFFNESS,
    GRIP_TANGENTIAL,
    LANE,
    LEAST,
    LOSS_FRICTION,
    LOSS_FRICTION_WALL,
    LOSS_NORMAL,
    LOSS_NORMAL_WALL,
    LOSS_ROLLING,
    MASS,
    ONSET,
    ROLLING,
    TANGENTIAL_DASHPOT,
    TOUCHED,
)
from graindamp.dem.compile import inner, merged
from graindamp.dem.grip import begin, renew, speed_bin
from graindamp.dem.laws import (
    DASHPOT_SHARE,
    SLIP_MASS,
    NormalLaw,
    TangentialLaw,
    dashpot_of,
    elastic_hertz,
    friction_smoothed,
    normal_gonthier,
    normal_viscous,
)
from graindamp.dem.springs import rolling_torque, spring_force

# First places of the buffer's rows of four numbers per contact.
BRANCH = 0 * LANE  # branch vector
SPEED = 4 * LANE  # velocity of i relative to j
SWEEP = 8 * LANE  # arm (pairs: radius) times spin, summed over both
TURN = 12 * LANE  # pairs: spin, summed over both; walls: 0
CONSTANTS = 16 * LANE  # first four numbers of the grip
FORCE = 20 * LANE  # on i
TORQUE = 24 * LANE  # normal x tangential force

# First places of its lines of one number per contact.
RADIUS, REACH = 28 * LANE, 29 * LANE  # radius of i, sum of the radii
NX, NY, NZ = 30 * LANE, 31 * LANE, 32 * LANE  # unit normal from i to j
OVERLAP, RATE = 33 * LANE, 34 * LANE
ARM, OTHER_ARM = 35 * LANE, 36 * LANE  # from the centres of i and of j to where the forces act
U, V, S = 37 * LANE, 38 * LANE, 39 * LANE  # slip, then tangential force
MU, TANGENTIAL, HEFT = 40 * LANE, 41 * LANE, 42 * LANE  # from the grip
ELASTIC, NORMAL = 43 * LANE, 44 * LANE  # forces
LOSS, RUB = 45 * LANE, 46 * LANE  # powers lost
ALL_LOSS, ALL_RUB = 47 * LANE, 48 * LANE  # summed over the blocks
SHEAR, DASH = 49 * LANE, 50 * LANE  # of a spring
PX, PY, PZ, BEFORE = 51 * LANE, 52 * LANE, 53 * LANE, 54 * LANE  # its force and stiffness in the last step
DU, DV, DS = 55 * LANE, 56 * LANE, 57 * LANE  # slip that it grows by


@merged
def clear_losses(b):
    """Begin the sums of what all blocks of a step lose."""
    for m in range(LANE):
        b[ALL_LOSS + m] = b[ALL_RUB + m] = 0.0


@merged
def add_losses(w, wall, time_step, record, b):
    """Add the sums over the blocks to the ledger."""
    normal, friction = 0.0, 0.0
    for m in range(LANE):
        normal += b[ALL_LOSS + m]
        friction += b[ALL_RUB + m]
    record.ledger[w, LOSS_NORMAL_WALL if wall else LOSS_NORMAL] += normal * time_step
    record.ledger[w, LOSS_FRICTION_WALL if wall else LOSS_FRICTION] += friction * time_step


@merged
def block_forces(w, step, k, n, wall, contacts, particles, material, rules, record, b):
    """Forces of the `n` contacts from place k of the active list on, whose normals and arms are known.

    Args:
        wall: whether the second bodies are elements of walls.
        material: of the second bodies, particles or elements.
    """
    time_step, tangential = rules.time_step[w], rules.tangential[w]
    slips(b)
    recall(w, step, k, n, wall, contacts, particles, material, rules, record, b)
    normal_forces(rules.normal[w], rules.tension[w], DASHPOT_SHARE / time_step, b)
    if tangential == TangentialLaw.TANH:
        smoothed_friction(rules.friction_share[w] * SLIP_MASS / time_step, b)
    elif tangential == TangentialLaw.NONE:
        no_friction(b)
    else:
        spring_friction(w, k, n, wall, contacts, particles, material, rules, b)
    resultants(b)
    for m in range(n):
        b[ALL_LOSS + m] += b[LOSS + m]
        b[ALL_RUB + m] += b[RUB + m]
    if rules.rolling[w] != 0:
        roll(w, k, n, wall, contacts, particles, material, rules, record, b)


@merged
def slips(b):
    """Rate of approach and slip of a block."""
    for m in range(LANE):
        q = 4 * m
        x, y, z, half = b[NX + m], b[NY + m], b[NZ + m], 0.5 * b[OVERLAP + m]
        # The arms of two particles are half the overlap shorter than their radii; spins act through arm x normal.
        wx = b[SWEEP + q] - half * b[TURN + q]
        wy = b[SWEEP + q + 1] - half * b[TURN + q + 1]
        wz = b[SWEEP + q + 2] - half * b[TURN + q + 2]
        u, v, s = b[SPEED + q], b[SPEED + q + 1], b[SPEED + q + 2]
        # The compiler transposes whole rows only: the fourth numbers, which are 0, must have a use.
        rate = u * x + v * y + s * z + (b[SPEED + q + 3] + b[SWEEP + q + 3] + b[TURN + q + 3])
        b[U + m] = u + wy * z - wz * y - rate * x
        b[V + m] = v + wz * x - wx * z - rate * y
        b[S + m] = s + wx * y - wy * x - rate * z
        b[RATE + m] = rate


@merged
def recall(w, step, k, n, wall, contacts, particles, material, rules, record, b):
    """What each contact of a block remembers; contacts that begin or are hit harder find it out."""
    first, second, active, grip = (
        contacts.active_first[w],
        contacts.active_second[w],
        contacts.active[w],
        contacts.grip[w],
    )
    for m in range(n):
        p = active[k + m]
        rate = b[RATE + m]
        if grip[p, TOUCHED] != step - 1:
            begin(w, first[k + m], second[k + m], wall, particles, material, rules, rate, grip[p])
            record.impact[w, 1 if wall else 0, speed_bin(rate)] += 1
            if rules.tangential[w] >= TangentialLaw.MINDLIN:
                for c in range(4):
                    contacts.stretch[w, p, c] = 0.0
        elif rate > grip[p, ONSET]:
            renew(particles.material[w, first[k + m]], material[second[k + m]], w, rules, rate, grip[p])
        grip[p, TOUCHED] = step
        q = 4 * m
        c0, c1, c2, c3 = grip[p, 0], grip[p, 1], grip[p, 2], grip[p, 3]
        b[CONSTANTS + q], b[CONSTANTS + q + 1], b[CONSTANTS + q + 2], b[CONSTANTS + q + 3] = c0, c1, c2, c3
        b[MU + m], b[TANGENTIAL + m] = grip[p, GRIP_FRICTION], grip[p, GRIP_TANGENTIAL]
    widest = record.extreme[w, 1 if wall else 0]
    for m in range(n):
        widest = max(widest, b[OVERLAP + m])
    record.extreme[w, 1 if wall else 0] = widest


@merged
def normal_forces(law, tension, dashpot_share, b):
    """Normal forces of a block, and what their damping takes."""
    if law == NormalLaw.HERTZ_GONTHIER:
        for m in range(LANE):
            g = CONSTANTS + 4 * m
            elastic = elastic_hertz(b[OVERLAP + m], b[g + GRIP_STIFFNESS])
            normal = normal_gonthier(elastic, b[RATE + m], b[g + DAMPING], b[g + LEAST], dashpot_share * b[g + MASS])
            b[ELASTIC + m], b[NORMAL + m], b[HEFT + m] = elastic, normal, b[g + MASS]
    elif law == NormalLaw.HERTZ_VISCOELASTIC:
        for m in range(LANE):
            g = CONSTANTS + 4 * m
            elastic = elastic_hertz(b[OVERLAP + m], b[g + GRIP_STIFFNESS])
            dashpot = b[g + DAMPING] * sqrt(sqrt(b[OVERLAP + m]))
            normal = normal_viscous(elastic, dashpot, b[RATE + m], dashpot_share * b[g + MASS], tension)
            b[ELASTIC + m], b[NORMAL + m], b[HEFT + m] = elastic, normal, b[g + MASS]
    else:
        for m in range(LANE):
            g = CONSTANTS + 4 * m
            elastic = b[g + GRIP_STIFFNESS] * b[OVERLAP + m]
            normal = normal_viscous(elastic, b[g + DAMPING], b[RATE + m], dashpot_share * b[g + MASS], tension)
            b[ELASTIC + m], b[NORMAL + m], b[HEFT + m] = elastic, normal, b[g + MASS]
    for m in range(LANE):
        b[LOSS + m] = (b[NORMAL + m] - b[ELASTIC + m]) * b[RATE + m]


@merged
def smoothed_friction(friction_share, b):
    """Turn the slips of a block into the tangential forces of tanh friction."""
    for m in range(LANE):
        u, v, s = b[U + m], b[V + m], b[S + m]
        slip = u * u + v * v + s * s
        force = max(b[NORMAL + m], 0.0)
        drag = friction_smoothed(force, b[MU + m], slip, b[TANGENTIAL + m], friction_share * b[HEFT + m])
        b[RUB + m] = drag * slip
        b[U + m], b[V + m], b[S + m] = -drag * u, -drag * v, -drag * s


@merged
def no_friction(b):
    """Tangential forces of a block without friction."""
    for m in range(LANE):
        b[RUB + m] = b[U + m] = b[V + m] = b[S + m] = 0.0


@inner
def spring_friction(w, k, n, wall, contacts, particles, material, rules, b):
    """Turn the slips of a block into the tangential forces of springs, which remember."""
    stretch, active, time_step = contacts.stretch[w], contacts.active[w], rules.time_step[w]
    spring_slips(w, k, n, wall, contacts, particles, b)
    for m in range(n):
        p = active[k + m]
        i, j = contacts.active_first[w, k + m], contacts.active_second[w, k + m]
        b[PX + m], b[PY + m], b[PZ + m], b[BEFORE + m] = stretch[p, 0], stretch[p, 1], stretch[p, 2], stretch[p, 3]
        b[SHEAR + m] = b[TANGENTIAL + m]
        b[DASH + m] = rules.pair[w, particles.material[w, i], material[j], TANGENTIAL_DASHPOT]
    if rules.tangential[w] == TangentialLaw.MINDLIN:
        for m in range(LANE):
            b[SHEAR + m] *= sqrt(b[OVERLAP + m])
    law, limit = rules.normal[w], DASHPOT_SHARE / time_step
    for m in range(LANE):
        damping = b[CONSTANTS + 4 * m + DAMPING]
        b[DASH + m] *= dashpot_of(law, b[OVERLAP + m], b[ELASTIC + m], damping, limit * b[HEFT + m])
    for m in range(LANE):
        u, v, s, x, y, z, lost = spring_force(
            b[PX + m],
            b[PY + m],
            b[PZ + m],
            b[BEFORE + m],
            b[NX + m],
            b[NY + m],
            b[NZ + m],
            b[U + m],
            b[V + m],
            b[S + m],
            b[DU + m],
            b[DV + m],
            b[DS + m],
            b[SHEAR + m],
            b[DASH + m],
            b[MU + m] * abs(b[NORMAL + m]),
            time_step,
        )
        b[U + m], b[V + m], b[S + m], b[RUB + m] = u, v, s, lost
        b[PX + m], b[PY + m], b[PZ + m] = x, y, z
    for m in range(n):
        p = active[k + m]
        stretch[p, 0], stretch[p, 1], stretch[p, 2], stretch[p, 3] = b[PX + m], b[PY + m], b[PZ + m], b[SHEAR + m]


@merged
def spring_slips(w, k, n, wall, contacts, particles, b):
    """Slips in the middle of the step, which springs grow by."""
    velocity, spin = particles.velocity[w], particles.spin[w]
    for m in range(n):
        i, j = contacts.active_first[w, k + m], contacts.active_second[w, k + m]
        x, y, z, arm, other = b[NX + m], b[NY + m], b[NZ + m], b[ARM + m], b[OTHER_ARM + m]
        u, v, s = velocity[i, 0], velocity[i, 1], velocity[i, 2]
        wx, wy, wz = arm * spin[i, 0], arm * spin[i, 1], arm * spin[i, 2]
        if not wall:
            u, v, s = u - velocity[j, 0], v - velocity[j, 1], s - velocity[j, 2]
            wx, wy, wz = wx + other * spin[j, 0], wy + other * spin[j, 1], wz + other * spin[j, 2]
        rate = u * x + v * y + s * z
        b[DU + m] = u + wy * z - wz * y - rate * x
        b[DV + m] = v + wz * x - wx * z - rate * y
        b[DS + m] = s + wx * y - wy * x - rate * z


@merged
def resultants(b):
    """Force on the first body of each contact, and normal x tangential force."""
    for m in range(LANE):
        q = 4 * m
        x, y, z, normal = b[NX + m], b[NY + m], b[NZ + m], b[NORMAL + m]
        u, v, s = b[U + m], b[V + m], b[S + m]
        b[FORCE + q], b[FORCE + q + 1], b[FORCE + q + 2] = u - normal * x, v - normal * y, s - normal * z
        b[FORCE + q + 3] = 0.0
        b[TORQUE + q], b[TORQUE + q + 1], b[TORQUE + q + 2] = y * s - z * v, z * u - x * s, x * v - y * u
        b[TORQUE + q + 3] = 0.0


@inner
def roll(w, k, n, wall, contacts, particles, material, rules, record, b):
    """Add the torques of rolling resistance of a block, and what they dissipate to the ledger."""
    seen, load, inverse = particles.seen[w], particles.load[w], particles.inverse_mass[w]
    time_step = rules.time_step[w]
    lost = 0.0
    for m in range(n):
        i, j = contacts.active_first[w, k + m], contacts.active_second[w, k + m]
        x, y, z, radius, inertia = seen[i, 4], seen[i, 5], seen[i, 6], b[RADIUS + m], inverse[i, 1]
        if not wall:
            x, y, z = x - seen[j, 4], y - seen[j, 5], z - seen[j, 6]
            radius, inertia = radius * (b[REACH + m] - radius) / b[REACH + m], inertia + inverse[j, 1]
        x, y, z, power = rolling_torque(
            b[NX + m],
            b[NY + m],
            b[NZ + m],
            x,
            y,
            z,
            max(b[NORMAL + m], 0.0),
            rules.pair[w, particles.material[w, i], material[j], ROLLING],
            radius,
            rules.friction_share[w] / (time_step * inertia),
        )
        load[i, 4] += x
        load[i, 5] += y
        load[i, 6] += z
        if not wall:
            load[j, 4] -= x
            load[j, 5] -= y
            load[j, 6] -= z
        lost += power
    record.ledger[w, LOSS_ROLLING] += lost * time_step
