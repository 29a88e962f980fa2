"""Forces of the contacts between particles: each touching pair once, scattered to both.

Two passes over the inner list. The first only compares distances and writes down, without a branch, who touches; the
second works on touching pairs alone, in blocks of LANE: their numbers are gathered into rows of a small buffer, the
arithmetic runs along the rows so that the compiler can use vector instructions, and the forces are scattered at the
end."""

from math import sqrt

from graindamp.dem.columns import (
    DAMPING,
    GRIP_FRICTION,
    GRIP_SHEAR,
    GRIP_SMOOTHING,
    GRIP_STIFFNESS,
    LANE,
    LEAST,
    LOSS_FRICTION,
    LOSS_NORMAL,
    LOSS_ROLLING,
    MASS,
    ONSET,
    ROLLING,
    TANGENTIAL_DASHPOT,
)
from graindamp.dem.compile import inner
from graindamp.dem.grip import begin, renew, speed_bin
from graindamp.dem.laws import (
    DASHPOT_SHARE,
    FRICTION_SHARE,
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

# First places of the buffer's rows.
NX, NY, NZ = 0 * LANE, 1 * LANE, 2 * LANE  # branch vector, then unit normal from i to j
REACH = 3 * LANE  # sum of the radii
RADIUS = 4 * LANE  # radius of i
U, V, S = 5 * LANE, 6 * LANE, 7 * LANE  # velocity of i relative to j, then slip
PX, PY, PZ = 8 * LANE, 9 * LANE, 10 * LANE  # radius times spin, summed over both
QX, QY, QZ = 11 * LANE, 12 * LANE, 13 * LANE  # spin, summed over both
RATE, OVERLAP = 14 * LANE, 15 * LANE
STIFF, DAMP, FLOOR, MU, TAU, HEFT = 16 * LANE, 17 * LANE, 18 * LANE, 19 * LANE, 20 * LANE, 21 * LANE  # from the grip
ELASTIC, NORMAL = 22 * LANE, 23 * LANE  # forces
LOSS, RUB = 24 * LANE, 25 * LANE  # powers lost
FX, FY, FZ = 26 * LANE, 27 * LANE, 28 * LANE  # force on i
TX, TY, TZ = 29 * LANE, 30 * LANE, 31 * LANE  # normal x tangential force
KX, KY, KZ, KB = 32 * LANE, 33 * LANE, 34 * LANE, 35 * LANE  # force and stiffness of a spring in the last step
SHEAR, DASH = 36 * LANE, 37 * LANE  # of the spring


@inner
def find_touching(w, particles, pairs):
    """Write the pairs of world w that overlap to the active list."""
    position = particles.position[w]
    first, second, inner, active = pairs.inner_first[w], pairs.inner_second[w], pairs.inner[w], pairs.active[w]
    n_active = 0
    for k in range(pairs.n_inner[w]):
        i, j = first[k], second[k]
        x = position[j, 0] - position[i, 0]
        y = position[j, 1] - position[i, 1]
        z = position[j, 2] - position[i, 2]
        reach = position[i, 3] + position[j, 3]
        active[n_active] = inner[k]
        n_active += x * x + y * y + z * z < reach * reach
    pairs.n_active[w] = n_active


@inner
def pair_forces(w, step, particles, pairs, rules, record, scratch):
    """Add the forces and torques of all touching pairs of world w, and what they dissipate to the ledger."""
    b = scratch.buffer[w]
    time_step, tangential = rules.time_step[w], rules.tangential[w]
    loss_normal, loss_friction, loss_rolling = 0.0, 0.0, 0.0
    for k in range(0, pairs.n_active[w], LANE):
        n = min(LANE, pairs.n_active[w] - k)
        gather(w, k, n, particles, pairs, b)
        geometry(b)
        recall(w, step, k, n, particles, pairs, rules, record, b)
        normal_forces(rules.normal[w], rules.tension[w], DASHPOT_SHARE / time_step, b)
        if tangential == TangentialLaw.TANH:
            smoothed_friction(FRICTION_SHARE * SLIP_MASS / time_step, b)
        elif tangential == TangentialLaw.NONE:
            no_friction(b)
        else:
            spring_friction(w, k, n, particles, pairs, rules, b)
        resultants(b)
        scatter(w, k, n, particles, pairs, b)
        if rules.rolling[w] != 0:
            loss_rolling += roll(w, k, n, particles, pairs, rules, b)
        for m in range(n):
            loss_normal += b[LOSS + m]
            loss_friction += b[RUB + m]
    record.ledger[w, LOSS_NORMAL] += loss_normal * time_step
    record.ledger[w, LOSS_FRICTION] += loss_friction * time_step
    record.ledger[w, LOSS_ROLLING] += loss_rolling * time_step


@inner
def gather(w, k, n, particles, pairs, b):
    """Relative position, velocity and spin of `n` touching pairs from place k on, into the rows of the buffer."""
    position, velocity, spin = particles.position[w], particles.velocity_next[w], particles.spin_next[w]
    first, second, active = pairs.first[w], pairs.second[w], pairs.active[w]
    for m in range(n):
        p = active[k + m]
        i, j = first[p], second[p]
        ri, rj = position[i, 3], position[j, 3]
        b[NX + m] = position[j, 0] - position[i, 0]
        b[NY + m] = position[j, 1] - position[i, 1]
        b[NZ + m] = position[j, 2] - position[i, 2]
        b[REACH + m] = ri + rj
        b[RADIUS + m] = ri
        b[U + m] = velocity[i, 0] - velocity[j, 0]
        b[V + m] = velocity[i, 1] - velocity[j, 1]
        b[S + m] = velocity[i, 2] - velocity[j, 2]
        b[PX + m] = ri * spin[i, 0] + rj * spin[j, 0]
        b[PY + m] = ri * spin[i, 1] + rj * spin[j, 1]
        b[PZ + m] = ri * spin[i, 2] + rj * spin[j, 2]
        b[QX + m] = spin[i, 0] + spin[j, 0]
        b[QY + m] = spin[i, 1] + spin[j, 1]
        b[QZ + m] = spin[i, 2] + spin[j, 2]


@inner
def geometry(b):
    """Normal, overlap, rate of approach and slip of a block. Idle lanes keep what they had, and are never used."""
    for m in range(LANE):
        x, y, z = b[NX + m], b[NY + m], b[NZ + m]
        square = x * x + y * y + z * z
        inverse = 1.0 / sqrt(square)
        overlap = b[REACH + m] - square * inverse
        x, y, z = x * inverse, y * inverse, z * inverse
        # The arms of the two bodies end at the middle of the overlap; their spins act through arm x normal.
        half = 0.5 * overlap
        wx, wy, wz = b[PX + m] - half * b[QX + m], b[PY + m] - half * b[QY + m], b[PZ + m] - half * b[QZ + m]
        u, v, s = b[U + m], b[V + m], b[S + m]
        rate = u * x + v * y + s * z
        b[U + m] = u + wy * z - wz * y - rate * x
        b[V + m] = v + wz * x - wx * z - rate * y
        b[S + m] = s + wx * y - wy * x - rate * z
        b[NX + m], b[NY + m], b[NZ + m] = x, y, z
        b[RATE + m], b[OVERLAP + m] = rate, overlap


@inner
def recall(w, step, k, n, particles, pairs, rules, record, b):
    """What each contact of a block remembers; contacts that begin or are hit harder find it out."""
    position, inverse_mass, material = particles.position[w], particles.inverse_mass[w], particles.material[w]
    first, second, active = pairs.first[w], pairs.second[w], pairs.active[w]
    touched, grip = pairs.touched[w], pairs.grip[w]
    widest = record.extreme[w, 0]
    for m in range(n):
        p = active[k + m]
        rate = b[RATE + m]
        if touched[p] != step - 1:
            i, j = first[p], second[p]
            begin(
                material[i],
                material[j],
                position[i, 3],
                position[j, 3],
                1.0 / inverse_mass[i, 0],
                1.0 / inverse_mass[j, 0],
                rules.normal[w],
                rules.pair[w],
                rules.loss[w],
                rate,
                grip[p],
            )
            record.impact[w, 0, speed_bin(rate)] += 1
            if rules.tangential[w] >= TangentialLaw.MINDLIN:
                for c in range(4):
                    pairs.stretch[w, p, c] = 0.0
        elif rate > grip[p, ONSET]:
            i, j = first[p], second[p]
            renew(material[i], material[j], rules.normal[w], rules.pair[w], rules.loss[w], rate, grip[p])
        touched[p] = step
        b[STIFF + m] = grip[p, GRIP_STIFFNESS]
        b[DAMP + m] = grip[p, DAMPING]
        b[FLOOR + m] = grip[p, LEAST]
        b[MU + m] = grip[p, GRIP_FRICTION]
        b[TAU + m] = grip[p, GRIP_SMOOTHING]
        b[HEFT + m] = grip[p, MASS]
        widest = max(widest, b[OVERLAP + m])
    record.extreme[w, 0] = widest


@inner
def normal_forces(law, tension, dashpot_share, b):
    """Normal forces of a block, and what their damping takes."""
    if law == NormalLaw.HERTZ_GONTHIER:
        for m in range(LANE):
            elastic = elastic_hertz(b[OVERLAP + m], b[STIFF + m])
            b[ELASTIC + m] = elastic
            b[NORMAL + m] = normal_gonthier(
                elastic, b[RATE + m], b[DAMP + m], b[FLOOR + m], dashpot_share * b[HEFT + m]
            )
    elif law == NormalLaw.HERTZ_VISCOELASTIC:
        for m in range(LANE):
            elastic = elastic_hertz(b[OVERLAP + m], b[STIFF + m])
            dashpot = b[DAMP + m] * sqrt(sqrt(b[OVERLAP + m]))
            b[ELASTIC + m] = elastic
            b[NORMAL + m] = normal_viscous(elastic, dashpot, b[RATE + m], dashpot_share * b[HEFT + m], tension)
    else:
        for m in range(LANE):
            elastic = b[STIFF + m] * b[OVERLAP + m]
            b[ELASTIC + m] = elastic
            b[NORMAL + m] = normal_viscous(elastic, b[DAMP + m], b[RATE + m], dashpot_share * b[HEFT + m], tension)
    for m in range(LANE):
        b[LOSS + m] = (b[NORMAL + m] - b[ELASTIC + m]) * b[RATE + m]


@inner
def smoothed_friction(friction_share, b):
    """Turn the slips of a block into the tangential forces of tanh friction."""
    for m in range(LANE):
        u, v, s = b[U + m], b[V + m], b[S + m]
        slip = u * u + v * v + s * s
        force = max(b[NORMAL + m], 0.0)
        drag = friction_smoothed(force, b[MU + m], slip, b[TAU + m], friction_share * b[HEFT + m])
        b[RUB + m] = drag * slip
        b[U + m], b[V + m], b[S + m] = -drag * u, -drag * v, -drag * s


@inner
def no_friction(b):
    """Tangential forces of a block without friction."""
    for m in range(LANE):
        b[RUB + m] = b[U + m] = b[V + m] = b[S + m] = 0.0


@inner
def spring_friction(w, k, n, particles, pairs, rules, b):
    """Turn the slips of a block into the tangential forces of springs, which remember."""
    material, stretch, active = particles.material[w], pairs.stretch[w], pairs.active[w]
    velocity, spin = particles.velocity[w], particles.spin[w]
    law, time_step = rules.normal[w], rules.time_step[w]
    mindlin = rules.tangential[w] == TangentialLaw.MINDLIN
    limit = DASHPOT_SHARE / time_step
    for m in range(n):
        p = active[k + m]
        i, j = pairs.first[w, p], pairs.second[w, p]
        b[KX + m], b[KY + m], b[KZ + m], b[KB + m] = stretch[p, 0], stretch[p, 1], stretch[p, 2], stretch[p, 3]
        b[SHEAR + m] = pairs.grip[w, p, GRIP_SHEAR]
        b[DASH + m] = rules.pair[w, material[i], material[j], TANGENTIAL_DASHPOT]
        # Velocity and spin of the middle of the step, which the spring grows by, into rows that are free here.
        b[FX + m] = velocity[i, 0] - velocity[j, 0]
        b[FY + m] = velocity[i, 1] - velocity[j, 1]
        b[FZ + m] = velocity[i, 2] - velocity[j, 2]
        arm = b[RADIUS + m] - 0.5 * b[OVERLAP + m]
        other = b[REACH + m] - b[OVERLAP + m] - arm
        b[PX + m] = arm * spin[i, 0] + other * spin[j, 0]
        b[PY + m] = arm * spin[i, 1] + other * spin[j, 1]
        b[PZ + m] = arm * spin[i, 2] + other * spin[j, 2]
    if mindlin:
        for m in range(LANE):
            b[SHEAR + m] *= sqrt(b[OVERLAP + m])
    for m in range(LANE):
        b[DASH + m] *= dashpot_of(law, b[OVERLAP + m], b[ELASTIC + m], b[DAMP + m], limit * b[HEFT + m])
    for m in range(LANE):
        x, y, z = b[NX + m], b[NY + m], b[NZ + m]
        u, v, s = b[FX + m], b[FY + m], b[FZ + m]
        rate = u * x + v * y + s * z
        b[FX + m] = u + b[PY + m] * z - b[PZ + m] * y - rate * x
        b[FY + m] = v + b[PZ + m] * x - b[PX + m] * z - rate * y
        b[FZ + m] = s + b[PX + m] * y - b[PY + m] * x - rate * z
    for m in range(LANE):
        u, v, s, x, y, z, lost = spring_force(
            b[KX + m],
            b[KY + m],
            b[KZ + m],
            b[KB + m],
            b[NX + m],
            b[NY + m],
            b[NZ + m],
            b[U + m],
            b[V + m],
            b[S + m],
            b[FX + m],
            b[FY + m],
            b[FZ + m],
            b[SHEAR + m],
            b[DASH + m],
            b[MU + m] * abs(b[NORMAL + m]),
            time_step,
        )
        b[U + m], b[V + m], b[S + m], b[RUB + m] = u, v, s, lost
        b[KX + m], b[KY + m], b[KZ + m] = x, y, z
    for m in range(n):
        p = active[k + m]
        stretch[p, 0], stretch[p, 1], stretch[p, 2], stretch[p, 3] = b[KX + m], b[KY + m], b[KZ + m], b[SHEAR + m]


@inner
def resultants(b):
    """Force on the first body of each pair, and normal x tangential force."""
    for m in range(LANE):
        x, y, z, normal = b[NX + m], b[NY + m], b[NZ + m], b[NORMAL + m]
        u, v, s = b[U + m], b[V + m], b[S + m]
        b[FX + m], b[FY + m], b[FZ + m] = u - normal * x, v - normal * y, s - normal * z
        b[TX + m], b[TY + m], b[TZ + m] = y * s - z * v, z * u - x * s, x * v - y * u


@inner
def scatter(w, k, n, particles, pairs, b):
    """Add forces and torques of a block to both bodies of each pair, in the order of the pairs."""
    force, torque = particles.force[w], particles.torque[w]
    first, second, active = pairs.first[w], pairs.second[w], pairs.active[w]
    for m in range(n):
        p = active[k + m]
        i, j = first[p], second[p]
        x, y, z = b[FX + m], b[FY + m], b[FZ + m]
        force[i, 0] += x
        force[i, 1] += y
        force[i, 2] += z
        force[j, 0] -= x
        force[j, 1] -= y
        force[j, 2] -= z
        x, y, z = b[TX + m], b[TY + m], b[TZ + m]
        arm = b[RADIUS + m] - 0.5 * b[OVERLAP + m]
        torque[i, 0] += arm * x
        torque[i, 1] += arm * y
        torque[i, 2] += arm * z
        arm = b[REACH + m] - b[OVERLAP + m] - arm
        torque[j, 0] += arm * x
        torque[j, 1] += arm * y
        torque[j, 2] += arm * z


@inner
def roll(w, k, n, particles, pairs, rules, b):
    """Add the torques of rolling resistance of a block; returns the power they dissipate [W]."""
    spin, torque, inverse = particles.spin_next[w], particles.torque[w], particles.inverse_mass[w]
    material, time_step = particles.material[w], rules.time_step[w]
    lost = 0.0
    for m in range(n):
        p = pairs.active[w, k + m]
        i, j = pairs.first[w, p], pairs.second[w, p]
        x, y, z, power = rolling_torque(
            b[NX + m],
            b[NY + m],
            b[NZ + m],
            spin[i, 0] - spin[j, 0],
            spin[i, 1] - spin[j, 1],
            spin[i, 2] - spin[j, 2],
            max(b[NORMAL + m], 0.0),
            rules.pair[w, material[i], material[j], ROLLING],
            b[RADIUS + m] * (b[REACH + m] - b[RADIUS + m]) / b[REACH + m],
            FRICTION_SHARE / (time_step * (inverse[i, 1] + inverse[j, 1])),
        )
        torque[i, 0] += x
        torque[i, 1] += y
        torque[i, 2] += z
        torque[j, 0] -= x
        torque[j, 1] -= y
        torque[j, 2] -= z
        lost += power
    return lost
