"""Forces between particles: each inner pair is one thread's, which writes them down for both members to gather.

Differences of positions are double, all that follows is of working precision. The overlap comes from the difference of
two squares, so that no digits are lost: (r^2 - d^2) / (r + d)."""

from math import sqrt

from numba import cuda

from graindamp.dem.columns import (
    DAMPING,
    GRIP_FRICTION,
    GRIP_STIFFNESS,
    GRIP_TANGENTIAL,
    LEAST,
    LOSS_FRICTION,
    LOSS_NORMAL,
    LOSS_ROLLING,
    MASS,
    ONSET,
    ROLLING,
    TANGENTIAL_DASHPOT,
)
from graindamp.dem.gpu.columns import (
    ARMS,
    FORCE,
    LEDGER,
    N_INNER,
    NORMAL,
    PAIR_CONTACTS,
    ROLLING_CODE,
    SIDE,
    TANGENTIAL,
    TENSION,
    TIME_STEP,
    TORQUE,
    WIDEST_PAIR,
)
from graindamp.dem.gpu.device import REAL, WITH_ROLLING, WITH_SPRINGS, working
from graindamp.dem.grip import begin_between, renew_between, speed_bin
from graindamp.dem.laws import (
    DASHPOT_SHARE,
    FRICTION_SHARE,
    SLIP_MASS,
    TangentialLaw,
    dashpot_of,
    friction_smoothed,
    normal_force,
)
from graindamp.dem.springs import rolling_torque, spring_force


@working
def smooth_contact(
    law, rubs, tension, overlap, rate, u, v, s, stiffness, damping, least, friction, smoothing, mass, inverse_step
):
    """Normal force, its elastic part, tangential force (3) [N] and power of friction [W] of a contact without springs.

    Args:
        law: normal law.
        rubs: whether there is friction.
        tension: whether viscous laws may attract.
        overlap: [m].
        rate: of approach [m/s].
        u, v, s: slip of the first body on the second [m/s].
        stiffness, damping, least, friction, smoothing, mass: what the contact remembers.
        inverse_step: 1 / time step [1/s].
    """
    limit = DASHPOT_SHARE * mass * inverse_step
    normal, elastic = normal_force(law, overlap, rate, stiffness, damping, least, limit, tension)
    slip = u * u + v * v + s * s
    drag = REAL(0.0)
    if rubs:
        bound = FRICTION_SHARE * SLIP_MASS * mass * inverse_step
        drag = friction_smoothed(max(normal, REAL(0.0)), friction, slip, smoothing, bound)
    return normal, elastic, -drag * u, -drag * v, -drag * s, drag * slip


@working
def pair_forces(w, step, thread, width, batch):
    """Write the records of all touching pairs of world w, and add what they dissipate to the thread's sums."""
    bed, pairs, slots = batch.bed, batch.pairs, batch.slots
    side = slots.counts[w, SIDE]
    law, tangential = slots.codes[w, NORMAL], slots.codes[w, TANGENTIAL]
    tension, rolling = slots.codes[w, TENSION] != 0, slots.codes[w, ROLLING_CODE] != 0
    px, py, pz, radius = bed.position[w, 0], bed.position[w, 1], bed.position[w, 2], bed.radius[w]
    vx, vy, vz = bed.velocity_next[w, 0], bed.velocity_next[w, 1], bed.velocity_next[w, 2]
    wx, wy, wz = bed.spin_next[w, 0], bed.spin_next[w, 1], bed.spin_next[w, 2]
    firsts, seconds, inner = pairs.inner_first[w], pairs.inner_second[w], pairs.inner[w]
    touched, grips, stamp, record = pairs.touched[w, side], pairs.grip[w, side], pairs.stamp[w], pairs.record[w]
    time_step, sums = slots.numbers[w, TIME_STEP], slots.sums[w]
    inverse_step = REAL(1.0 / time_step)
    loss_normal, loss_friction, loss_rolling, widest, count = 0.0, 0.0, 0.0, REAL(0.0), 0
    for k in range(thread, slots.counts[w, N_INNER], width):
        i, j = firsts[k], seconds[k]
        dx, dy, dz = px[j] - px[i], py[j] - py[i], pz[j] - pz[i]
        reach = radius[i] + radius[j]
        square = dx * dx + dy * dy + dz * dz
        if square < reach * reach:
            p = inner[k]
            short = REAL(square)
            inverse = REAL(1.0) / sqrt(short)
            overlap = REAL(reach * reach - square) / (REAL(reach) + short * inverse)
            x, y, z = REAL(dx) * inverse, REAL(dy) * inverse, REAL(dz) * inverse
            # The arms of the two bodies end at the middle of the overlap; their spins act through arm x normal.
            half = REAL(0.5) * overlap
            arm, other = REAL(radius[i]) - half, REAL(radius[j]) - half
            u, v, s = vx[i] - vx[j], vy[i] - vy[j], vz[i] - vz[j]
            rate = u * x + v * y + s * z
            a, b, c = arm * wx[i] + other * wx[j], arm * wy[i] + other * wy[j], arm * wz[i] + other * wz[j]
            u, v, s = u + b * z - c * y - rate * x, v + c * x - a * z - rate * y, s + a * y - b * x - rate * z
            grip = grips[p]
            take_hold(w, step, i, j, p, rate, law, side, tangential, touched, grip, batch)
            touched[p] = step
            stamp[k] = step
            normal, elastic, fu, fv, fs, rub = smooth_contact(
                law,
                tangential == TangentialLaw.TANH,
                tension,
                overlap,
                rate,
                u,
                v,
                s,
                grip[GRIP_STIFFNESS],
                grip[DAMPING],
                grip[LEAST],
                grip[GRIP_FRICTION],
                grip[GRIP_TANGENTIAL],
                grip[MASS],
                inverse_step,
            )
            if WITH_SPRINGS:
                if tangential >= TangentialLaw.MINDLIN:
                    fu, fv, fs, rub = pair_spring(
                        w, i, j, p, side, law, tangential, x, y, z, u, v, s, arm, other, overlap, normal, elastic,
                        time_step, grip, batch,
                    )  # fmt: skip
            row = record[k]
            row[FORCE], row[FORCE + 1], row[FORCE + 2] = fu - normal * x, fv - normal * y, fs - normal * z
            row[TORQUE], row[TORQUE + 1], row[TORQUE + 2] = y * fs - z * fv, z * fu - x * fs, x * fv - y * fu
            row[ARMS], row[ARMS + 1] = arm, other
            if WITH_ROLLING:
                if rolling:
                    loss_rolling += pair_rolling(w, k, i, j, x, y, z, normal, inverse_step, batch)
            loss_normal += (normal - elastic) * rate
            loss_friction += rub
            widest = max(widest, overlap)
            count += 1
    sums[LEDGER + LOSS_NORMAL, thread] += loss_normal * time_step
    sums[LEDGER + LOSS_FRICTION, thread] += loss_friction * time_step
    if WITH_ROLLING:
        sums[LEDGER + LOSS_ROLLING, thread] += loss_rolling * time_step
    if count > 0:
        sums[PAIR_CONTACTS, thread] += count
        sums[WIDEST_PAIR, thread] = max(sums[WIDEST_PAIR, thread], widest)


def take_hold(w, step, i, j, p, rate, law, side, tangential, touched, grip, batch):
    """Let a contact that begins, or is hit harder, find out what it needs to know."""
    bed, tables = batch.bed, batch.tables
    if touched[p] != step - 1:
        begin_between(
            bed.material[w, i],
            bed.material[w, j],
            bed.radius[w, i],
            bed.radius[w, j],
            1.0 / bed.inverse[w, 0, i],
            1.0 / bed.inverse[w, 0, j],
            law,
            tangential,
            tables.pair[w],
            tables.loss[w],
            rate,
            grip,
        )
        cuda.atomic.add(batch.slots.impact, (w, 0, speed_bin(rate)), 1)
        if WITH_SPRINGS:
            if tangential >= TangentialLaw.MINDLIN:
                for c in range(4):
                    batch.pairs.stretch[w, side, p, c] = 0.0
    elif rate > grip[ONSET]:
        renew_between(bed.material[w, i], bed.material[w, j], law, tables.pair[w], tables.loss[w], rate, grip)


@working
def pair_spring(
    w, i, j, p, side, law, tangential, x, y, z, u, v, s, arm, other, overlap, normal, elastic, time_step, grip,
    batch,
):  # fmt: skip
    """Tangential force of the pair's spring on the first body (3) [N], and the power it dissipates [W]."""
    bed, memory = batch.bed, batch.pairs.stretch[w, side, p]
    step = REAL(time_step)
    shear = grip[GRIP_TANGENTIAL] * sqrt(overlap) if tangential == TangentialLaw.MINDLIN else grip[GRIP_TANGENTIAL]
    share = REAL(batch.tables.pair[w, bed.material[w, i], bed.material[w, j], TANGENTIAL_DASHPOT])
    dashpot = share * dashpot_of(law, overlap, elastic, grip[DAMPING], DASHPOT_SHARE * grip[MASS] / step)
    # The slip in the middle of the step, which the spring grows by.
    velocity, spin = bed.velocity[w], bed.spin[w]
    du = REAL(velocity[0, i] - velocity[0, j])
    dv = REAL(velocity[1, i] - velocity[1, j])
    ds = REAL(velocity[2, i] - velocity[2, j])
    a = arm * spin[0, i] + other * spin[0, j]
    b = arm * spin[1, i] + other * spin[1, j]
    c = arm * spin[2, i] + other * spin[2, j]
    rate = du * x + dv * y + ds * z
    du, dv, ds = du + b * z - c * y - rate * x, dv + c * x - a * z - rate * y, ds + a * y - b * x - rate * z
    bound = grip[GRIP_FRICTION] * abs(normal)
    fu, fv, fs, kx, ky, kz, lost = spring_force(
        memory[0], memory[1], memory[2], memory[3], x, y, z, u, v, s, du, dv, ds, shear, dashpot, bound, step
    )
    memory[0], memory[1], memory[2], memory[3] = kx, ky, kz, shear
    return fu, fv, fs, lost


@working
def pair_rolling(w, k, i, j, x, y, z, normal, inverse_step, batch):
    """Write the torque of rolling resistance on the first body of inner pair k; the power it dissipates [W]."""
    bed, spin = batch.bed, batch.bed.spin_next[w]
    ri, rj = REAL(bed.radius[w, i]), REAL(bed.radius[w, j])
    inertia = FRICTION_SHARE * inverse_step / (bed.inverse[w, 1, i] + bed.inverse[w, 1, j])
    coefficient = REAL(batch.tables.pair[w, bed.material[w, i], bed.material[w, j], ROLLING])
    tx, ty, tz, lost = rolling_torque(
        x,
        y,
        z,
        spin[0, i] - spin[0, j],
        spin[1, i] - spin[1, j],
        spin[2, i] - spin[2, j],
        max(normal, REAL(0.0)),
        coefficient,
        ri * rj / (ri + rj),
        inertia,
    )
    row = batch.pairs.roll[w, k]
    row[0], row[1], row[2] = tx, ty, tz
    return lost
