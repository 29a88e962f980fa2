"""What happens to the particles of a world in a step, besides contacts: forces gathered, velocities and positions moved
on, the container moved, sums written down."""

from math import cos, sin, sqrt

from graindamp.dem.columns import (
    GRIP_STIFFNESS,
    N_LEDGER,
    N_STEP,
)
from graindamp.dem.energy import elastic_energy, spring_energy
from graindamp.dem.gpu.block import largest, total
from graindamp.dem.gpu.columns import (
    ARMS,
    BEYOND,
    CARRIED,
    CARRIED_SPEED,
    ELEMENT,
    FORCE,
    GIVEN,
    GRAVITY,
    N_INNER,
    N_PARTICLE,
    N_SETTLE,
    N_SUM,
    N_TOUCH,
    NORMAL,
    OVERLAP,
    PER_ROW,
    REACH,
    REFRESHES,
    ROLLING_CODE,
    ROW,
    ROW_CENTRE,
    ROW_ELASTIC,
    ROW_FOURIER,
    ROW_KINETIC,
    ROW_LEDGER,
    ROW_PAIRS,
    ROW_POTENTIAL,
    ROW_ROTATIONAL,
    ROW_TIME,
    ROW_TOUCHES,
    SIDE,
    SKIN,
    STATUS,
    SUM_FORCE_COS,
    SUM_PAIRS,
    SUM_SPEED_COS,
    SUM_SPEED_SIN,
    SUM_TOUCHES,
    TANGENTIAL,
    TIME_STEP,
    TORQUE,
    WAY_INNER,
    WAY_LAST,
    WAY_OUTER,
    WAY_WALL,
)
from graindamp.dem.gpu.device import REAL, WITH_ROLLING, WITH_SPRINGS, working
from graindamp.dem.gpu.lists import narrow_pairs, refresh_pairs
from graindamp.dem.gpu.touches import refresh_touches
from graindamp.dem.laws import NormalLaw, TangentialLaw
from graindamp.dem.motion import DIRECTION, FUNDAMENTAL, move
from graindamp.dem.neighbours import INNER_STEPS
from graindamp.dem.walls import FOAM_FIRST


def container(w, step, batch, now):
    """Write the container's acceleration (0-2) [m/s^2] and velocity (3-5) [m/s] at a step to `now`, and the weights of
    the Fourier sums, cosine and sine (6, 7). It rests while the bed settles."""
    motion, n_settle = batch.motion, batch.slots.codes[w, N_SETTLE]
    for c in range(8):
        now[c] = 0.0
    if step >= n_settle:
        time = (step - n_settle) * batch.slots.numbers[w, TIME_STEP]
        move(w, time, motion)
        for c in range(3):
            now[c], now[3 + c] = motion.acceleration[w, c], motion.velocity[w, c]
        phase = motion.timing[w, FUNDAMENTAL] * time
        now[6], now[7] = cos(phase), sin(phase)


@working
def gathered(w, i, step, side, batch):
    """Force (3) [N] and torque (3) [N m] of all contacts of particle i, in the order of its neighbours, walls last."""
    pairs, touches = batch.pairs, batch.touches
    stamp, record = pairs.stamp[w], pairs.record[w]
    fx, fy, fz, tx, ty, tz = REAL(0.0), REAL(0.0), REAL(0.0), REAL(0.0), REAL(0.0), REAL(0.0)
    rolls = WITH_ROLLING and batch.slots.codes[w, ROLLING_CODE] != 0
    for m in range(pairs.inner_back_start[w, i], pairs.inner_back_start[w, i + 1]):
        k = pairs.inner_back[w, m]
        if stamp[k] == step:
            row = record[k]
            arm = row[ARMS + 1]
            fx, fy, fz = fx - row[FORCE], fy - row[FORCE + 1], fz - row[FORCE + 2]
            tx, ty, tz = tx + arm * row[TORQUE], ty + arm * row[TORQUE + 1], tz + arm * row[TORQUE + 2]
            if rolls:
                tx, ty, tz = tx - pairs.roll[w, k, 0], ty - pairs.roll[w, k, 1], tz - pairs.roll[w, k, 2]
    for k in range(pairs.inner_start[w, i], pairs.inner_start[w, i + 1]):
        if stamp[k] == step:
            row = record[k]
            arm = row[ARMS]
            fx, fy, fz = fx + row[FORCE], fy + row[FORCE + 1], fz + row[FORCE + 2]
            tx, ty, tz = tx + arm * row[TORQUE], ty + arm * row[TORQUE + 1], tz + arm * row[TORQUE + 2]
            if rolls:
                tx, ty, tz = tx + pairs.roll[w, k, 0], ty + pairs.roll[w, k, 1], tz + pairs.roll[w, k, 2]
    for t in range(touches.start[w, side, i], touches.start[w, side, i + 1]):
        if touches.stamp[w, t] == step:
            row = touches.record[w, t]
            fx, fy, fz = fx + row[FORCE], fy + row[FORCE + 1], fz + row[FORCE + 2]
            tx, ty, tz = tx + row[TORQUE], ty + row[TORQUE + 1], tz + row[TORQUE + 2]
    return fx, fy, fz, tx, ty, tz


@working
def drift(w, step, now, thread, width, batch, sums):
    """Kick by the forces of the last positions, those of `step`, and move. Returns whether the thread's particles may
    have moved as far as a list reaches."""
    bed, numbers, side = batch.bed, batch.slots.numbers[w], batch.slots.counts[w, SIDE]
    position, velocity, following = bed.position[w], bed.velocity[w], bed.velocity_next[w]
    spin, spin_following = bed.spin[w], bed.spin_next[w]
    dt = numbers[TIME_STEP]
    half, short, short_half = 0.5 * dt, REAL(dt), REAL(0.5 * dt)
    # The container's acceleration is felt as a body force in its frame.
    bx, by, bz = numbers[GRAVITY] - now[0], numbers[GRAVITY + 1] - now[1], numbers[GRAVITY + 2] - now[2]
    cx, cy, cz = numbers[CARRIED], numbers[CARRIED + 1], numbers[CARRIED + 2]
    fastest = 0.0 * dt
    for i in range(thread, batch.slots.codes[w, N_PARTICLE], width):
        fx, fy, fz, tx, ty, tz = gathered(w, i, step, side, batch)
        inverse, inverse_inertia = bed.inverse[w, 0, i], bed.inverse[w, 1, i]
        ax, ay, az = fx * inverse + bx, fy * inverse + by, fz * inverse + bz
        vx, vy, vz = velocity[0, i] + dt * ax, velocity[1, i] + dt * ay, velocity[2, i] + dt * az
        velocity[0, i], velocity[1, i], velocity[2, i] = vx, vy, vz
        position[0, i] += dt * vx
        position[1, i] += dt * vy
        position[2, i] += dt * vz
        following[0, i], following[1, i], following[2, i] = vx + half * ax, vy + half * ay, vz + half * az
        ux, uy, uz = vx - cx, vy - cy, vz - cz
        fastest = max(fastest, ux * ux + uy * uy + uz * uz)
        tx, ty, tz = tx * inverse_inertia, ty * inverse_inertia, tz * inverse_inertia
        wx, wy, wz = spin[0, i] + short * tx, spin[1, i] + short * ty, spin[2, i] + short * tz
        spin[0, i], spin[1, i], spin[2, i] = wx, wy, wz
        spin_following[0, i], spin_following[1, i], spin_following[2, i] = (
            wx + short_half * tx,
            wy + short_half * ty,
            wz + short_half * tz,
        )
    way = sqrt(fastest) * dt
    inner, outer = sums[WAY_INNER, thread] + way, sums[WAY_OUTER, thread] + way
    wall = sums[WAY_WALL, thread] + way + numbers[CARRIED_SPEED] * dt
    sums[WAY_INNER, thread], sums[WAY_OUTER, thread], sums[WAY_WALL, thread] = inner, outer, wall
    sums[WAY_LAST, thread] = way
    skin = numbers[SKIN]
    return 1 if inner + inner >= numbers[REACH] or outer + outer >= skin or wall >= skin else 0


def renew(w, step, buffer, thread, width, batch, sums):
    """Renew the lists whose reach the particles may have moved. Returns a status bit, which stops the world, or 0."""
    slots = batch.slots
    numbers, counts = slots.numbers[w], slots.counts[w]
    skin, reach, old = numbers[SKIN], numbers[REACH], counts[SIDE]
    inner = largest(sums[WAY_INNER, thread], buffer, thread, width)
    outer = largest(sums[WAY_OUTER, thread], buffer, thread, width)
    wall = largest(sums[WAY_WALL, thread], buffer, thread, width)
    last = largest(sums[WAY_LAST, thread], buffer, thread, width)
    if 2.0 * outer >= skin or wall >= skin:
        status = refresh_touches(w, step, old, buffer, thread, width, batch)
        if status == 0:
            status = refresh_pairs(w, step, buffer, thread, width, batch)
        if status != 0:
            if thread == 0:
                counts[STATUS] |= status
            return status
        carry(w, buffer, thread, width, batch)
        sums[WAY_OUTER, thread] = sums[WAY_WALL, thread] = 0.0
        outer = reach = 0.0
        if thread == 0:
            counts[REFRESHES] += 1
    if 2.0 * inner >= reach:
        sums[WAY_INNER, thread] = 0.0
        reach = min(2.0 * INNER_STEPS * last, skin - 2.0 * outer)
        if thread == 0:
            numbers[REACH] = reach
        narrow_pairs(w, reach, buffer, thread, width, batch)
    return 0


def carry(w, buffer, thread, width, batch):
    """Mean velocity of the bed, which the bounds are relative to from now on."""
    velocity, numbers, n = batch.bed.velocity[w], batch.slots.numbers[w], batch.slots.codes[w, N_PARTICLE]
    x, y, z = 0.0, 0.0, 0.0
    for i in range(thread, n, width):
        x += velocity[0, i]
        y += velocity[1, i]
        z += velocity[2, i]
    x = total(x, buffer, thread, width) / n
    y = total(y, buffer, thread, width) / n
    z = total(z, buffer, thread, width) / n
    if thread == 0:
        numbers[CARRIED], numbers[CARRIED + 1], numbers[CARRIED + 2] = x, y, z
        numbers[CARRIED_SPEED] = sqrt(x * x + y * y + z * z)


def take_back(w, step, thread, width, batch):
    """Take velocities given at the first positions back to mid-step, with the container at rest."""
    bed, numbers, side = batch.bed, batch.slots.numbers[w], batch.slots.counts[w, SIDE]
    half = 0.5 * numbers[TIME_STEP]
    for i in range(thread, batch.slots.codes[w, N_PARTICLE], width):
        fx, fy, fz, tx, ty, tz = gathered(w, i, step, side, batch)
        inverse, inverse_inertia = bed.inverse[w, 0, i], bed.inverse[w, 1, i]
        bed.velocity[w, 0, i] -= half * (fx * inverse + numbers[GRAVITY])
        bed.velocity[w, 1, i] -= half * (fy * inverse + numbers[GRAVITY + 1])
        bed.velocity[w, 2, i] -= half * (fz * inverse + numbers[GRAVITY + 2])
        bed.spin[w, 0, i] -= half * tx * inverse_inertia
        bed.spin[w, 1, i] -= half * ty * inverse_inertia
        bed.spin[w, 2, i] -= half * tz * inverse_inertia


def set_off(w, step, now, thread, width, batch, sums):
    """Let the container begin to move.

    One that starts with a speed leaves a resting bed behind: in its frame the particles start with the opposite one. A
    bed whose velocities are given goes on with these."""
    bed, slots = batch.bed, batch.slots
    numbers, side, given = slots.numbers[w], slots.counts[w, SIDE], slots.codes[w, GIVEN] != 0
    half = 0.5 * numbers[TIME_STEP]
    for i in range(thread, slots.codes[w, N_PARTICLE], width):
        fx, fy, fz, tx, ty, tz = gathered(w, i, step, side, batch)
        inverse, turn = bed.inverse[w, 0, i], half * bed.inverse[w, 1, i]
        gx, gy, gz = (
            fx * inverse + numbers[GRAVITY],
            fy * inverse + numbers[GRAVITY + 1],
            fz * inverse + numbers[GRAVITY + 2],
        )
        if given:
            vx, vy, vz = bed.velocity_shown[w, 0, i], bed.velocity_shown[w, 1, i], bed.velocity_shown[w, 2, i]
            bed.spin[w, 0, i] = bed.spin_shown[w, 0, i] - turn * tx
            bed.spin[w, 1, i] = bed.spin_shown[w, 1, i] - turn * ty
            bed.spin[w, 2, i] = bed.spin_shown[w, 2, i] - turn * tz
        else:
            vx = bed.velocity[w, 0, i] + half * gx - now[3]
            vy = bed.velocity[w, 1, i] + half * gy - now[4]
            vz = bed.velocity[w, 2, i] + half * gz - now[5]
        bed.velocity[w, 0, i] = vx - half * (gx - now[0])
        bed.velocity[w, 1, i] = vy - half * (gy - now[1])
        bed.velocity[w, 2, i] = vz - half * (gz - now[2])
    for k in range(N_SUM):
        sums[k, thread] = 0.0
    sums[WAY_OUTER, thread] = BEYOND
    for k in range(thread, slots.impact.shape[2], width):
        slots.impact[w, 0, k] = slots.impact[w, 1, k] = 0


def show(w, step, now, thread, width, batch):
    """Write down velocities and spins at the time of the positions, in the container's frame."""
    bed, numbers, side = batch.bed, batch.slots.numbers[w], batch.slots.counts[w, SIDE]
    half = 0.5 * numbers[TIME_STEP]
    for i in range(thread, batch.slots.codes[w, N_PARTICLE], width):
        fx, fy, fz, tx, ty, tz = gathered(w, i, step, side, batch)
        inverse, turn = bed.inverse[w, 0, i], half * bed.inverse[w, 1, i]
        bed.velocity_shown[w, 0, i] = bed.velocity[w, 0, i] + half * (fx * inverse + numbers[GRAVITY] - now[0])
        bed.velocity_shown[w, 1, i] = bed.velocity[w, 1, i] + half * (fy * inverse + numbers[GRAVITY + 1] - now[1])
        bed.velocity_shown[w, 2, i] = bed.velocity[w, 2, i] + half * (fz * inverse + numbers[GRAVITY + 2] - now[2])
        bed.spin_shown[w, 0, i] = bed.spin[w, 0, i] + turn * tx
        bed.spin_shown[w, 1, i] = bed.spin[w, 1, i] + turn * ty
        bed.spin_shown[w, 2, i] = bed.spin[w, 2, i] + turn * tz


def write_row(w, step, now, buffer, thread, width, batch, sums):
    """Write down the sums of a cycle and the energies at its end, and begin the next cycle."""
    bed, slots = batch.bed, batch.slots
    numbers, row = slots.numbers[w], slots.counts[w, ROW]
    show(w, step, now, thread, width, batch)
    moved = batch.motion.displacement[w]
    kinetic, rotational, potential, heavy, mx, my, mz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(thread, slots.codes[w, N_PARTICLE], width):
        mass, inertia = 1.0 / bed.inverse[w, 0, i], bed.inverse[w, 1, i]
        x, y, z = bed.position[w, 0, i], bed.position[w, 1, i], bed.position[w, 2, i]
        vx, vy, vz = bed.velocity_shown[w, 0, i], bed.velocity_shown[w, 1, i], bed.velocity_shown[w, 2, i]
        wx, wy, wz = bed.spin_shown[w, 0, i], bed.spin_shown[w, 1, i], bed.spin_shown[w, 2, i]
        vx, vy, vz = vx + now[3], vy + now[4], vz + now[5]
        kinetic += 0.5 * mass * (vx * vx + vy * vy + vz * vz)
        if inertia > 0.0:
            rotational += 0.5 / inertia * (wx * wx + wy * wy + wz * wz)
        potential -= mass * (
            (x + moved[0]) * numbers[GRAVITY]
            + (y + moved[1]) * numbers[GRAVITY + 1]
            + (z + moved[2]) * numbers[GRAVITY + 2]
        )
        heavy, mx, my, mz = heavy + mass, mx + mass * x, my + mass * y, mz + mass * z
    elastic = elastic_pairs(w, step, thread, width, batch) + elastic_walls(w, step, thread, width, batch)
    kinetic, rotational = total(kinetic, buffer, thread, width), total(rotational, buffer, thread, width)
    potential, elastic = total(potential, buffer, thread, width), total(elastic, buffer, thread, width)
    heavy, mx = total(heavy, buffer, thread, width), total(mx, buffer, thread, width)
    my, mz = total(my, buffer, thread, width), total(mz, buffer, thread, width)
    fits = row < slots.rows.shape[1]
    out = slots.rows[w, row if fits else 0]
    for k in range(4 + N_LEDGER):
        value = total(sums[SUM_FORCE_COS + k, thread], buffer, thread, width)
        if fits and thread == 0:
            out[ROW_FOURIER + k if k < 4 else ROW_LEDGER + k - 4] = value
    touching, at_walls = (
        total(sums[SUM_PAIRS, thread], buffer, thread, width),
        total(sums[SUM_TOUCHES, thread], buffer, thread, width),
    )
    if fits and thread == 0:
        rest = (step - slots.codes[w, N_SETTLE]) % slots.codes[w, PER_ROW]
        out[ROW_FOURIER + N_STEP] = rest if rest > 0 else slots.codes[w, PER_ROW]
        out[ROW_KINETIC], out[ROW_ROTATIONAL], out[ROW_POTENTIAL], out[ROW_ELASTIC] = (
            kinetic,
            rotational,
            potential,
            elastic,
        )
        out[ROW_CENTRE], out[ROW_CENTRE + 1], out[ROW_CENTRE + 2] = mx / heavy, my / heavy, mz / heavy
        out[ROW_TIME] = (step - slots.codes[w, N_SETTLE]) * numbers[TIME_STEP]
        out[ROW_PAIRS], out[ROW_TOUCHES] = touching, at_walls
        slots.counts[w, ROW] = row + 1
    for k in range(4):
        sums[SUM_FORCE_COS + k, thread] = 0.0


def elastic_pairs(w, step, thread, width, batch):
    """Energy stored in the thread's contacts between particles [J]."""
    bed, pairs, slots = batch.bed, batch.pairs, batch.slots
    side, stored = slots.counts[w, SIDE], 0.0
    for k in range(thread, slots.counts[w, N_INNER], width):
        if pairs.stamp[w, k] == step:
            i, j, p = pairs.inner_first[w, k], pairs.inner_second[w, k], pairs.inner[w, k]
            x = bed.position[w, 0, j] - bed.position[w, 0, i]
            y = bed.position[w, 1, j] - bed.position[w, 1, i]
            z = bed.position[w, 2, j] - bed.position[w, 2, i]
            overlap = bed.radius[w, i] + bed.radius[w, j] - sqrt(x * x + y * y + z * z)
            stored += elastic_energy(slots.codes[w, NORMAL], pairs.grip[w, side, p, GRIP_STIFFNESS], overlap)
            if WITH_SPRINGS:
                if slots.codes[w, TANGENTIAL] >= TangentialLaw.MINDLIN:
                    stored += spring_energy(pairs.stretch[w, side, p])
    return stored


def elastic_walls(w, step, thread, width, batch):
    """Energy stored in the thread's contacts with walls and in foam [J]."""
    touches, slots, walls = batch.touches, batch.slots, batch.walls
    side, stored = slots.counts[w, SIDE], 0.0
    for t in range(thread, slots.counts[w, N_TOUCH], width):
        if touches.stamp[w, t] == step:
            overlap, e = touches.record[w, t, OVERLAP], int(touches.record[w, t, ELEMENT])
            if walls.law[w, e] == NormalLaw.FOAM:
                shape = walls.shape[w, e]
                a, b, c = shape[FOAM_FIRST], shape[FOAM_FIRST + 1], shape[FOAM_FIRST + 2]
                stored += overlap * overlap * (a / 2.0 + overlap * (b / 3.0 + overlap * c / 4.0))
            else:
                stored += elastic_energy(walls.law[w, e], touches.grip[w, side, t, GRIP_STIFFNESS], overlap)
                if WITH_SPRINGS:
                    if slots.codes[w, TANGENTIAL] >= TangentialLaw.MINDLIN:
                        stored += spring_energy(touches.stretch[w, side, t])
    return stored


def speeds(w, now, batch, sums, thread):
    """Add the container's velocity along its motion to the sums over the cycle."""
    timing = batch.motion.timing[w]
    quick = now[3] * timing[DIRECTION] + now[4] * timing[DIRECTION + 1] + now[5] * timing[DIRECTION + 2]
    sums[SUM_SPEED_COS, thread] += quick * now[6]
    sums[SUM_SPEED_SIN, thread] += quick * now[7]
