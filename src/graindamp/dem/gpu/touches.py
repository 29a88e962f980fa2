"""Contacts with walls: who is near which element, and the forces of those that touch, written down for the particles
to gather. Where the nearest point of a wall lies is found in double precision."""

from math import sqrt

from numba import cuda

from graindamp.dem.columns import (
    DAMPING,
    GRIP_FRICTION,
    GRIP_STIFFNESS,
    GRIP_TANGENTIAL,
    LEAST,
    LOSS_FRICTION_WALL,
    LOSS_LID,
    LOSS_NORMAL_WALL,
    LOSS_ROLLING,
    MASS,
    N_GRIP,
    ONSET,
    ROLLING,
    TANGENTIAL_DASHPOT,
    WORK_CONTAINER,
)
from graindamp.dem.gpu.block import running
from graindamp.dem.gpu.columns import (
    ELEMENT,
    FORCE,
    FORCE_COS,
    FORCE_SIN,
    LEDGER,
    N_PARTICLE,
    N_TOUCH,
    OVERLAP,
    ROLLING_CODE,
    SIDE,
    SKIN,
    TANGENTIAL,
    TENSION,
    TIME_STEP,
    TORQUE,
    WALL_CONTACTS,
    WANTED_TOUCHES,
    WIDEST_TOUCH,
)
from graindamp.dem.gpu.device import REAL, WITH_ROLLING, WITH_SPRINGS, working
from graindamp.dem.gpu.forces import smooth_contact
from graindamp.dem.gpu.lists import FREE
from graindamp.dem.grip import begin_between, renew_between, speed_bin
from graindamp.dem.laws import (
    DASHPOT_SHARE,
    FRICTION_SHARE,
    NormalLaw,
    TangentialLaw,
    dashpot_of,
    foam_force,
)
from graindamp.dem.motion import DIRECTION
from graindamp.dem.neighbours import LISTS_FULL
from graindamp.dem.springs import rolling_torque, spring_force
from graindamp.dem.walls import FOAM_FIRST, nearest


def refresh_touches(w, step, old, buffer, thread, width, batch):
    """Make the outer list of wall contacts of world w in the copy other than `old`; contacts that touched in the step
    before `step` keep their memory. Returns a status bit or 0."""
    touches, slots = batch.touches, batch.slots
    n, new = slots.codes[w, N_PARTICLE], 1 - old
    start = touches.start[w, new]
    n_touch = 0
    for fill in range(2):  # first count, then write
        for i in range(thread, n, width):
            found = near_walls(w, i, new, start[i] if fill > 0 else -1, batch)
            if fill == 0:
                start[i] = found
            else:
                remember(w, i, old, new, step, batch)
        if fill == 0:
            n_touch = running(start, n, buffer, thread, width)
            if n_touch > touches.stamp.shape[1]:
                if thread == 0:
                    slots.counts[w, WANTED_TOUCHES] = n_touch
                return LISTS_FULL
    if thread == 0:
        slots.counts[w, N_TOUCH] = n_touch
    cuda.syncthreads()
    return 0


def near_walls(w, i, new, first, batch):
    """Number of wall elements within the skin of particle i, and all elements of meshes in its cell; written by patch
    and element to the new list from place `first`, unless that is negative."""
    bed, walls = batch.bed, batch.walls
    kind, shapes, patch, edges = walls.kind[w], walls.shape[w], walls.patch[w], walls.edges[w]
    grid, cell_start, cell_element = walls.grid[w], walls.cell_start[w], walls.cell_element[w]
    n_plain, element = walls.n_plain[w], batch.touches.element[w, new]
    x, y, z, radius = bed.position[w, 0, i], bed.position[w, 1, i], bed.position[w, 2, i], bed.radius[w, i]
    limit = radius + batch.slots.numbers[w, SKIN]
    n_cell, begin_cell = 0, 0
    if grid[3] > 0.0:
        a, b, c = int((x - grid[0]) / grid[3]), int((y - grid[1]) / grid[3]), int((z - grid[2]) / grid[3])
        if a >= 0 and a < grid[4] and b >= 0 and b < grid[5] and c >= 0 and c < grid[6]:
            cell = (a * int(grid[5]) + b) * int(grid[6]) + c
            begin_cell = int(cell_start[cell])
            n_cell = cell_start[cell + 1] - begin_cell
    count = 0
    for m in range(n_plain + n_cell):
        e = m
        if m >= n_plain:
            e = int(cell_element[begin_cell + m - n_plain])
        # Elements of meshes see a sphere only from their own region, which it may enter before the next refresh.
        if m >= n_plain or nearest(kind[e], shapes, e, edges, x, y, z, radius)[0] < limit:
            if first >= 0:
                k = first + count
                while k > first and follows(patch, element[k - 1], e):
                    element[k] = element[k - 1]
                    k -= 1
                element[k] = e
            count += 1
    return count


def follows(patch, one, other):
    """Whether element `one` stands after `other` in the order of patches and elements."""
    return patch[one] > patch[other] or (patch[one] == patch[other] and one > other)


def remember(w, i, old, new, step, batch):
    """Finish the new list for particle i: homes, and the memory of contacts that touched in the last step."""
    touches, patch = batch.touches, batch.walls.patch[w]
    element, home, touched = touches.element[w, new], touches.home[w, new], touches.touched[w, new]
    old_element, old_home, old_touched = touches.element[w, old], touches.home[w, old], touches.touched[w, old]
    q, last = touches.start[w, old, i], touches.start[w, old, i + 1]
    begin_own = touches.start[w, new, i]
    for t in range(begin_own, touches.start[w, new, i + 1]):
        touches.first[w, new, t], touched[t], home[t] = i, FREE, t
        own = patch[element[t]]
        if t > begin_own and patch[element[t - 1]] == own:
            home[t] = home[t - 1]
        else:
            while q < last and (old_home[q] != q or patch[old_element[q]] < own):
                q += 1
            if q < last and patch[old_element[q]] == own and old_touched[q] == step - 1:
                touched[t] = step - 1
                for k in range(N_GRIP):
                    touches.grip[w, new, t, k] = touches.grip[w, old, q, k]
                if WITH_SPRINGS:
                    for k in range(4):
                        touches.stretch[w, new, t, k] = touches.stretch[w, old, q, k]


@working
def wall_forces(w, step, now, thread, width, batch):
    """Write the records of all touching particles and walls of world w, and add work, losses and Fourier sums to the
    thread's sums. `now` is the row of the container's motion at this step, see :mod:`graindamp.dem.gpu.kernels`."""
    bed, touches, slots, walls = batch.bed, batch.touches, batch.slots, batch.walls
    side = slots.counts[w, SIDE]
    tangential = slots.codes[w, TANGENTIAL]
    kind, shapes, edges, laws = walls.kind[w], walls.shape[w], walls.edges[w], walls.law[w]
    firsts, element, home = touches.first[w, side], touches.element[w, side], touches.home[w, side]
    stamp, record, direction = touches.stamp[w], touches.record[w], batch.motion.timing[w]
    time_step, sums = slots.numbers[w, TIME_STEP], slots.sums[w]
    inverse_step = REAL(1.0 / time_step)
    n_touch = slots.counts[w, N_TOUCH]
    loss_normal, loss_friction, loss_lid, loss_rolling, along, power = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    widest, count = 0.0, 0
    for t in range(thread, n_touch, width):
        if home[t] == t:
            i = firsts[t]
            px, py, pz, radius = bed.position[w, 0, i], bed.position[w, 1, i], bed.position[w, 2, i], bed.radius[w, i]
            # Of the elements of a patch the first that touches counts.
            m, overlap, nx, ny, nz, e = t, 0.0, 0.0, 0.0, 0.0, int(element[t])
            while m < n_touch and home[m] == t and overlap <= 0.0:
                e = int(element[m])
                distance, nx, ny, nz = nearest(kind[e], shapes, e, edges, px, py, pz, radius)
                overlap = radius - distance
                m += 1
            if overlap > 0.0:
                stamp[t] = step
                row = record[t]
                x, y, z, depth = REAL(nx), REAL(ny), REAL(nz), REAL(overlap)
                u, v, s = bed.velocity_next[w, 0, i], bed.velocity_next[w, 1, i], bed.velocity_next[w, 2, i]
                # The normal points to the particle: the rate of approach is minus the velocity along it.
                rate = -(u * x + v * y + s * z)
                law = laws[e]
                if law == NormalLaw.FOAM:
                    normal, elastic = foam(shapes[e], depth, rate)
                    loss_lid += (normal - elastic) * rate
                    fx, fy, fz = normal * x, normal * y, normal * z
                    row[TORQUE] = row[TORQUE + 1] = row[TORQUE + 2] = REAL(0.0)
                else:
                    arm = REAL(radius - overlap)
                    wx, wy, wz = bed.spin_next[w, 0, i], bed.spin_next[w, 1, i], bed.spin_next[w, 2, i]
                    u = u + rate * x - arm * (wy * z - wz * y)
                    v = v + rate * y - arm * (wz * x - wx * z)
                    s = s + rate * z - arm * (wx * y - wy * x)
                    grip = touches.grip[w, side, t]
                    take_hold(w, step, i, e, t, rate, law, side, batch, grip)
                    normal, elastic, fu, fv, fs, rub = smooth_contact(
                        law,
                        tangential == TangentialLaw.TANH,
                        slots.codes[w, TENSION] != 0,
                        depth,
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
                            fu, fv, fs, rub = wall_spring(
                                w, i, e, t, side, law, tangential, x, y, z, u, v, s, arm, depth, normal, elastic,
                                time_step, grip, batch,
                            )  # fmt: skip
                    fx, fy, fz = normal * x + fu, normal * y + fv, normal * z + fs
                    tx, ty, tz = arm * (z * fv - y * fs), arm * (x * fs - z * fu), arm * (y * fu - x * fv)
                    if WITH_ROLLING:
                        if slots.codes[w, ROLLING_CODE] != 0:
                            ax, ay, az, lost = wall_rolling(w, i, e, x, y, z, normal, inverse_step, batch)
                            tx, ty, tz = tx + ax, ty + ay, tz + az
                            loss_rolling += lost
                    row[TORQUE], row[TORQUE + 1], row[TORQUE + 2] = tx, ty, tz
                    loss_normal += (normal - elastic) * rate
                    loss_friction += rub
                    widest = max(widest, overlap)
                row[FORCE], row[FORCE + 1], row[FORCE + 2] = fx, fy, fz
                row[OVERLAP], row[ELEMENT] = depth, e
                power -= fx * now[3] + fy * now[4] + fz * now[5]
                along -= fx * direction[DIRECTION] + fy * direction[DIRECTION + 1] + fz * direction[DIRECTION + 2]
                count += 1
    if count > 0:
        sums[FORCE_COS, thread] += along * now[6]
        sums[FORCE_SIN, thread] += along * now[7]
        sums[LEDGER + WORK_CONTAINER, thread] -= power * time_step
        sums[LEDGER + LOSS_NORMAL_WALL, thread] += loss_normal * time_step
        sums[LEDGER + LOSS_FRICTION_WALL, thread] += loss_friction * time_step
        sums[LEDGER + LOSS_LID, thread] += loss_lid * time_step
        if WITH_ROLLING:
            sums[LEDGER + LOSS_ROLLING, thread] += loss_rolling * time_step
        sums[WALL_CONTACTS, thread] += count
        sums[WIDEST_TOUCH, thread] = max(sums[WIDEST_TOUCH, thread], widest)


@working
def foam(shape, depth, rate):
    """Force of a foam plane on a particle and its elastic part [N]."""
    a = FOAM_FIRST
    return foam_force(
        depth, rate, REAL(shape[a]), REAL(shape[a + 1]), REAL(shape[a + 2]), REAL(shape[a + 3]), REAL(shape[a + 4])
    )


def take_hold(w, step, i, e, t, rate, law, side, batch, grip):
    """Let a contact that begins, or is hit harder, find out what it needs to know."""
    bed, touches, tables = batch.bed, batch.touches, batch.tables
    a, b = bed.material[w, i], batch.walls.material[w, e]
    if touches.touched[w, side, t] != step - 1:
        begin_between(
            a,
            b,
            bed.radius[w, i],
            0.0,
            1.0 / bed.inverse[w, 0, i],
            0.0,
            law,
            batch.slots.codes[w, TANGENTIAL],
            tables.pair[w],
            tables.loss[w],
            rate,
            grip,
        )
        cuda.atomic.add(batch.slots.impact, (w, 1, speed_bin(rate)), 1)
        if WITH_SPRINGS:
            if batch.slots.codes[w, TANGENTIAL] >= TangentialLaw.MINDLIN:
                for c in range(4):
                    touches.stretch[w, side, t, c] = 0.0
    elif rate > grip[ONSET]:
        renew_between(a, b, law, tables.pair[w], tables.loss[w], rate, grip)
    touches.touched[w, side, t] = step


@working
def wall_spring(
    w, i, e, t, side, law, tangential, x, y, z, u, v, s, arm, depth, normal, elastic, time_step, grip, batch
):
    """Tangential force of the wall's spring on the particle (3) [N], and the power it dissipates [W]."""
    bed, memory = batch.bed, batch.touches.stretch[w, side, t]
    step = REAL(time_step)
    shear = grip[GRIP_TANGENTIAL] * sqrt(depth) if tangential == TangentialLaw.MINDLIN else grip[GRIP_TANGENTIAL]
    share = REAL(batch.tables.pair[w, bed.material[w, i], batch.walls.material[w, e], TANGENTIAL_DASHPOT])
    dashpot = share * dashpot_of(law, depth, elastic, grip[DAMPING], DASHPOT_SHARE * grip[MASS] / step)
    # The slip in the middle of the step, which the spring grows by.
    du, dv, ds = REAL(bed.velocity[w, 0, i]), REAL(bed.velocity[w, 1, i]), REAL(bed.velocity[w, 2, i])
    wx, wy, wz = bed.spin[w, 0, i], bed.spin[w, 1, i], bed.spin[w, 2, i]
    along = du * x + dv * y + ds * z
    du = du - along * x - arm * (wy * z - wz * y)
    dv = dv - along * y - arm * (wz * x - wx * z)
    ds = ds - along * z - arm * (wx * y - wy * x)
    bound = grip[GRIP_FRICTION] * abs(normal)
    fu, fv, fs, kx, ky, kz, lost = spring_force(
        memory[0], memory[1], memory[2], memory[3], x, y, z, u, v, s, du, dv, ds, shear, dashpot, bound, step
    )
    memory[0], memory[1], memory[2], memory[3] = kx, ky, kz, shear
    return fu, fv, fs, lost


@working
def wall_rolling(w, i, e, x, y, z, normal, inverse_step, batch):
    """Torque of the wall's rolling resistance on the particle (3) [N m], and the power it dissipates [W]."""
    bed = batch.bed
    return rolling_torque(
        x,
        y,
        z,
        bed.spin_next[w, 0, i],
        bed.spin_next[w, 1, i],
        bed.spin_next[w, 2, i],
        max(normal, REAL(0.0)),
        REAL(batch.tables.pair[w, bed.material[w, i], batch.walls.material[w, e], ROLLING]),
        REAL(bed.radius[w, i]),
        FRICTION_SHARE * inverse_step / bed.inverse[w, 1, i],
    )
