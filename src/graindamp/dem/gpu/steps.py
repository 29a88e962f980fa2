"""What happens to the particles of a world in a step, besides contacts: forces gathered, velocities and positions moved
on, the container moved, sums written down."""

from math import cos, sin, sqrt

from graindamp.dem.columns import GRIP_STIFFNESS
from graindamp.dem.energy import elastic_energy, spring_energy
from graindamp.dem.gpu.block import largest, most_of, sum_of, total
from graindamp.dem.gpu.columns import (
    ARMS,
    BED_MASS,
    BEYOND,
    CARRIED,
    CARRIED_SPEED,
    ELASTIC,
    ELEMENT,
    FORCE,
    GIVEN,
    GRAVITY,
    KINETIC,
    MOMENT,
    N_INNER,
    N_PARTICLE,
    N_SETTLE,
    N_SUM,
    N_TOTAL,
    N_TOUCH,
    NEW,
    NORMAL,
    OVERLAP,
    PER_ROW,
    POTENTIAL,
    REACH,
    REFRESHES,
    ROLLING_CODE,
    ROTATIONAL,
    ROW,
    ROW_STEPS,
    ROW_TIME,
    SIDE,
    SKIN,
    SPEED_COS,
    SPEED_SIN,
    STATUS,
    TANGENTIAL,
    TIME_STEP,
    TORQUE,
    UNTIL,
    UNTIL_END,
    WAY_INNER,
    WAY_LAST,
    WAY_OUTER,
    WAY_WALL,
)
from graindamp.dem.gpu.device import REAL, WITH_ROLLING, WITH_SPRINGS, working
from graindamp.dem.gpu.lists import narrow_pairs, refresh_pairs
from graindamp.dem.gpu.touches import refresh_touches
from graindamp.dem.gpu.verdict import judge
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
def drift(w, step, now, thread, width, batch):
    """Kick by the forces of the last positions, those of `step`, and move. Returns whether the thread's particles may
    have moved as far as a list reaches."""
    bed, numbers, side, sums = batch.bed, batch.slots.numbers[w], batch.slots.counts[w, SIDE], batch.slots.sums[w]
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


def renew(w, step, buffer, thread, width, batch):
    """Renew the lists whose reach the particles may have moved. Returns a status bit, which stops the world, or 0."""
    slots = batch.slots
    numbers, counts, sums = slots.numbers[w], slots.counts[w], slots.sums[w]
    skin, reach, old = numbers[SKIN], numbers[REACH], counts[SIDE]
    inner = largest(most_of(sums[WAY_INNER], thread, width), buffer, thread, width)
    outer = largest(most_of(sums[WAY_OUTER], thread, width), buffer, thread, width)
    wall = largest(most_of(sums[WAY_WALL], thread, width), buffer, thread, width)
    last = largest(most_of(sums[WAY_LAST], thread, width), buffer, thread, width)
    if 2.0 * outer >= skin or wall >= skin:
        status = refresh_touches(w, step, old, buffer, thread, width, batch)
        if status == 0:
            status = refresh_pairs(w, step, buffer, thread, width, batch)
        if status != 0:
            if thread == 0:
                counts[STATUS] |= status
            return status
        carry(w, buffer, thread, width, batch)
        for k in range(thread, sums.shape[1], width):
            sums[WAY_OUTER, k] = sums[WAY_WALL, k] = 0.0
        outer = reach = 0.0
        if thread == 0:
            counts[REFRESHES] += 1
    if 2.0 * inner >= reach:
        for k in range(thread, sums.shape[1], width):
            sums[WAY_INNER, k] = 0.0
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


def occasion(w, step, stage, now, writes, buffer, thread, width, batch):
    """What is not done in every step: begin, let the container set off, write a row, show velocities, end."""
    collect(w, step, thread, width, batch)
    if stage == NEW:
        take_back(w, thread, width, batch)
    if step == batch.slots.codes[w, N_SETTLE]:
        set_off(w, now, thread, width, batch)
    show(w, now, thread, width, batch)
    if writes:
        write_row(w, step, now, buffer, thread, width, batch)
        slots = batch.slots
        if thread == 0 and slots.codes[w, UNTIL] != UNTIL_END:
            omega = batch.motion.timing[w, FUNDAMENTAL]
            judge(slots.counts[w], slots.codes[w], slots.numbers[w], slots.rows[w], slots.series[w], omega)


def collect(w, step, thread, width, batch):
    """Write down the forces and torques on all particles."""
    load, side = batch.bed.load[w], batch.slots.counts[w, SIDE]
    for i in range(thread, batch.slots.codes[w, N_PARTICLE], width):
        load[0, i], load[1, i], load[2, i], load[3, i], load[4, i], load[5, i] = gathered(w, i, step, side, batch)


def take_back(w, thread, width, batch):
    """Take velocities given at the first positions back to mid-step, with the container at rest."""
    bed, numbers = batch.bed, batch.slots.numbers[w]
    half = 0.5 * numbers[TIME_STEP]
    for i in range(thread, batch.slots.codes[w, N_PARTICLE], width):
        inverse, turn = bed.inverse[w, 0, i], half * bed.inverse[w, 1, i]
        for c in range(3):
            bed.velocity[w, c, i] -= half * (bed.load[w, c, i] * inverse + numbers[GRAVITY + c])
            bed.spin[w, c, i] -= turn * bed.load[w, 3 + c, i]


def set_off(w, now, thread, width, batch):
    """Let the container begin to move.

    One that starts with a speed leaves a resting bed behind: in its frame the particles start with the opposite one. A
    bed whose velocities are given goes on with these."""
    bed, slots = batch.bed, batch.slots
    numbers, sums, given = slots.numbers[w], slots.sums[w], slots.codes[w, GIVEN] != 0
    half = 0.5 * numbers[TIME_STEP]
    for i in range(thread, slots.codes[w, N_PARTICLE], width):
        inverse, turn = bed.inverse[w, 0, i], half * bed.inverse[w, 1, i]
        for c in range(3):
            pull = bed.load[w, c, i] * inverse + numbers[GRAVITY + c]
            speed = bed.velocity[w, c, i] + half * pull - now[3 + c]
            if given:
                speed = bed.velocity_shown[w, c, i]
                bed.spin[w, c, i] = bed.spin_shown[w, c, i] - turn * bed.load[w, 3 + c, i]
            bed.velocity[w, c, i] = speed - half * (pull - now[c])
    for t in range(thread, sums.shape[1], width):
        for k in range(N_SUM):
            sums[k, t] = 0.0
        sums[WAY_OUTER, t] = BEYOND
    for k in range(thread, slots.impact.shape[2], width):
        slots.impact[w, 0, k] = slots.impact[w, 1, k] = 0


def show(w, now, thread, width, batch):
    """Write down velocities and spins at the time of the positions, in the container's frame."""
    bed, numbers = batch.bed, batch.slots.numbers[w]
    half = 0.5 * numbers[TIME_STEP]
    for i in range(thread, batch.slots.codes[w, N_PARTICLE], width):
        inverse, turn = bed.inverse[w, 0, i], half * bed.inverse[w, 1, i]
        for c in range(3):
            pull = bed.load[w, c, i] * inverse + numbers[GRAVITY + c] - now[c]
            bed.velocity_shown[w, c, i] = bed.velocity[w, c, i] + half * pull
            bed.spin_shown[w, c, i] = bed.spin[w, c, i] + turn * bed.load[w, 3 + c, i]


def write_row(w, step, now, buffer, thread, width, batch):
    """Write down the sums of a cycle and the energies at its end, and begin the next cycle."""
    slots = batch.slots
    row, sums, since = slots.counts[w, ROW], slots.sums[w], step - slots.codes[w, N_SETTLE]
    stored(w, now, thread, width, batch)
    sums[ELASTIC, thread] = elastic_pairs(w, step, thread, width, batch) + elastic_walls(w, step, thread, width, batch)
    for k in range(N_TOTAL):
        value = total(sum_of(sums[k], thread, width), buffer, thread, width)
        if thread == 0 and row < slots.rows.shape[1]:
            slots.rows[w, row, k] = value
    if thread == 0 and row < slots.rows.shape[1]:
        rest = since % slots.codes[w, PER_ROW]
        slots.rows[w, row, ROW_STEPS] = rest if rest > 0 else slots.codes[w, PER_ROW]
        slots.rows[w, row, ROW_TIME] = since * slots.numbers[w, TIME_STEP]
        slots.counts[w, ROW] = row + 1
    for t in range(thread, sums.shape[1], width):
        for k in range(4):
            sums[k, t] = 0.0


def stored(w, now, thread, width, batch):
    """Kinetic and potential energy of the thread's particles in the frame at rest [J], and their centre."""
    bed, numbers, sums, moved = batch.bed, batch.slots.numbers[w], batch.slots.sums[w], batch.motion.displacement[w]
    kinetic, rotational, potential, heavy, mx, my, mz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(thread, batch.slots.codes[w, N_PARTICLE], width):
        mass, turn = 1.0 / bed.inverse[w, 0, i], bed.inverse[w, 1, i]
        for c in range(3):
            speed, spin = bed.velocity_shown[w, c, i] + now[3 + c], bed.spin_shown[w, c, i]
            kinetic += 0.5 * mass * speed * speed
            if turn > 0.0:
                rotational += 0.5 / turn * spin * spin
            potential -= mass * numbers[GRAVITY + c] * (bed.position[w, c, i] + moved[c])
        heavy += mass
        mx += mass * bed.position[w, 0, i]
        my += mass * bed.position[w, 1, i]
        mz += mass * bed.position[w, 2, i]
    sums[KINETIC, thread], sums[ROTATIONAL, thread], sums[POTENTIAL, thread] = kinetic, rotational, potential
    sums[MOMENT, thread], sums[MOMENT + 1, thread], sums[MOMENT + 2, thread] = mx, my, mz
    sums[BED_MASS, thread] = heavy


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


def speeds(w, now, thread, batch):
    """Add the container's velocity along its motion to the sums over the cycle."""
    timing, sums = batch.motion.timing[w], batch.slots.sums[w]
    quick = now[3] * timing[DIRECTION] + now[4] * timing[DIRECTION + 1] + now[5] * timing[DIRECTION + 2]
    sums[SPEED_COS, thread] += quick * now[6]
    sums[SPEED_SIN, thread] += quick * now[7]
