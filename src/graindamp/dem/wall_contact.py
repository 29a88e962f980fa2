"""Contacts with the walls: who is near which element, and the forces of those that touch."""

from math import sqrt

from graindamp.dem.columns import (
    DAMPING,
    GRIP_FRICTION,
    GRIP_SHEAR,
    GRIP_SMOOTHING,
    GRIP_STIFFNESS,
    LEAST,
    LOSS_FRICTION_WALL,
    LOSS_LID,
    LOSS_NORMAL_WALL,
    LOSS_ROLLING,
    MASS,
    ONSET,
    ROLLING,
    TANGENTIAL_DASHPOT,
)
from graindamp.dem.compile import checked, inner
from graindamp.dem.grip import begin, renew, speed_bin
from graindamp.dem.laws import (
    DASHPOT_SHARE,
    FRICTION_SHARE,
    SLIP_MASS,
    NormalLaw,
    TangentialLaw,
    dashpot_of,
    foam_force,
    friction_smoothed,
    normal_force,
)
from graindamp.dem.springs import rolling_torque, spring_force
from graindamp.dem.walls import FOAM_FIRST, nearest
from graindamp.status import Status

LISTS_FULL = int(Status.LISTS_FULL)


@checked
def refresh_touches(w, step, particles, touches, walls, rules, scratch):
    """Make the outer list of wall contacts of world w; those that touched at `step` keep their memory. Returns a
    status bit or 0.

    Entries are sorted by particle, patch and element; the first entry of a patch holds the memory of all of them.
    """
    position, skin = particles.position[w], rules.skin[w]
    first, second, touched, home = touches.first[w], touches.second[w], touches.touched[w], touches.active[w]
    kind, shapes, patch, edges = walls.kind[w], walls.shape[w], walls.patch[w], walls.edges[w]
    grid, cell_start, cell_element = walls.grid[w], walls.cell_start[w], walls.cell_element[w]
    near, kept_first, kept_second = scratch.near[w], scratch.kept_first[w], scratch.kept_second[w]
    n_plain, capacity = walls.n_plain[w], first.shape[0]

    n_kept = 0
    for p in range(touches.n_outer[w]):
        if home[p] == p and touched[p] == step:
            kept_first[n_kept], kept_second[n_kept] = first[p], second[p]
            scratch.kept_onset[w, n_kept] = touches.grip[w, p, ONSET]
            if rules.tangential[w] >= TangentialLaw.MINDLIN:
                for c in range(4):
                    scratch.kept_stretch[w, n_kept, c] = touches.stretch[w, p, c]
            n_kept += 1

    n_touch, n_found = 0, 0
    for i in range(particles.n_particle[w]):
        x, y, z, radius = position[i, 0], position[i, 1], position[i, 2], position[i, 3]
        n_near, n_cell, cell = 0, 0, 0
        if grid[3] > 0.0:
            a, b, c = int((x - grid[0]) / grid[3]), int((y - grid[1]) / grid[3]), int((z - grid[2]) / grid[3])
            if 0 <= a < grid[4] and 0 <= b < grid[5] and 0 <= c < grid[6]:
                cell = (a * int(grid[5]) + b) * int(grid[6]) + c
                n_cell = cell_start[cell + 1] - cell_start[cell]
        for m in range(n_plain + n_cell):
            e = m if m < n_plain else cell_element[cell_start[cell] + m - n_plain]
            # Elements of meshes see a sphere only from their own region, which it may enter before the next refresh.
            if m >= n_plain or nearest(kind[e], shapes, e, edges, x, y, z, radius)[0] < radius + skin:
                if n_near == near.shape[0]:
                    return LISTS_FULL
                k = n_near
                while k > 0 and (patch[near[k - 1]] > patch[e] or (patch[near[k - 1]] == patch[e] and near[k - 1] > e)):
                    near[k] = near[k - 1]
                    k -= 1
                near[k] = e
                n_near += 1
        if n_touch + n_near > capacity:
            # What touches becomes the whole list, so that a longer list can take it over.
            for k in range(n_kept):
                first[k], second[k], home[k] = kept_first[k], kept_second[k], k
                remember_touch(w, step, k, k, particles, touches, walls, rules, scratch)
            touches.n_outer[w] = n_kept
            return LISTS_FULL
        for k in range(n_near):
            e = near[k]
            first[n_touch], second[n_touch], touched[n_touch] = i, e, -9
            if k > 0 and patch[near[k - 1]] == patch[e]:
                home[n_touch] = home[n_touch - 1]
            else:
                home[n_touch] = n_touch
                while n_found < n_kept and (
                    kept_first[n_found] < i or (kept_first[n_found] == i and patch[kept_second[n_found]] < patch[e])
                ):
                    n_found += 1
                if n_found < n_kept and kept_first[n_found] == i and patch[kept_second[n_found]] == patch[e]:
                    remember_touch(w, step, n_found, n_touch, particles, touches, walls, rules, scratch)
            n_touch += 1
    touches.n_outer[w] = n_touch
    return 0


@checked
def remember_touch(w, step, k, p, particles, touches, walls, rules, scratch):
    """Give the contact set aside as number k to place p of the list."""
    i, e = touches.first[w, p], touches.second[w, p]
    touches.touched[w, p] = step
    begin(
        particles.material[w, i],
        walls.material[w, e],
        particles.position[w, i, 3],
        0.0,
        1.0 / particles.inverse_mass[w, i, 0],
        0.0,
        walls.law[w, e],
        rules.pair[w],
        rules.loss[w],
        scratch.kept_onset[w, k],
        touches.grip[w, p],
    )
    if rules.tangential[w] >= TangentialLaw.MINDLIN:
        for c in range(4):
            touches.stretch[w, p, c] = scratch.kept_stretch[w, k, c]


@inner
def narrow_touches(w, particles, touches, walls, reach):
    """Make the inner list of wall contacts: plain elements nearer than `reach` to touching, and all elements of
    meshes."""
    position = particles.position[w]
    first, second, inner = touches.first[w], touches.second[w], touches.inner[w]
    kind, shapes, edges = walls.kind[w], walls.shape[w], walls.edges[w]
    n_inner = 0
    for p in range(touches.n_outer[w]):
        i, e = first[p], second[p]
        radius = position[i, 3]
        inner[n_inner] = p
        n_inner += (
            e >= walls.n_plain[w]
            or nearest(kind[e], shapes, e, edges, position[i, 0], position[i, 1], position[i, 2], radius)[0]
            < radius + reach
        )
    touches.n_inner[w] = n_inner


@inner
def wall_forces(w, step, particles, touches, walls, rules, record):
    """Add the forces and torques of the walls of world w on the particles, and sum up the forces on each wall."""
    position, velocity, spin = particles.position[w], particles.velocity_next[w], particles.spin_next[w]
    force, torque = particles.force[w], particles.torque[w]
    inverse_mass, material = particles.inverse_mass[w], particles.material[w]
    first, second, inner, home = touches.first[w], touches.second[w], touches.inner[w], touches.active[w]
    touched, grips = touches.touched[w], touches.grip[w]
    kind, shapes, edges, stuff = walls.kind[w], walls.shape[w], walls.edges[w], walls.material[w]
    pair, loss, tangential, tension = rules.pair[w], rules.loss[w], rules.tangential[w], rules.tension[w]
    time_step = rules.time_step[w]
    wall_force = record.wall_force[w]
    for g in range(walls.n_group[w]):
        for c in range(3):
            wall_force[g, c] = 0.0
    loss_normal, loss_friction, loss_lid, loss_rolling = 0.0, 0.0, 0.0, 0.0
    n_touching = 0
    done_particle, done_patch = -1, -1
    for k in range(touches.n_inner[w]):
        p = inner[k]
        i, e = first[p], second[p]
        patch = walls.patch[w, e]
        if i == done_particle and patch == done_patch:
            continue
        radius = position[i, 3]
        distance, x, y, z = nearest(kind[e], shapes, e, edges, position[i, 0], position[i, 1], position[i, 2], radius)
        overlap = radius - distance
        if overlap <= 0.0:
            continue
        done_particle, done_patch = i, patch
        n_touching += 1
        group = walls.group[w, e]
        # The normal points to the particle: the rate of approach is minus the velocity along it.
        rate = -(velocity[i, 0] * x + velocity[i, 1] * y + velocity[i, 2] * z)
        p = home[p]
        grip = grips[p]
        law = walls.law[w, e]
        if law == NormalLaw.FOAM:
            shape = shapes[e]
            a = FOAM_FIRST
            normal, elastic = foam_force(
                overlap, rate, shape[a], shape[a + 1], shape[a + 2], shape[a + 3], shape[a + 4]
            )
            loss_lid += (normal - elastic) * rate
            force[i, 0] += normal * x
            force[i, 1] += normal * y
            force[i, 2] += normal * z
            wall_force[group, 0] -= normal * x
            wall_force[group, 1] -= normal * y
            wall_force[group, 2] -= normal * z
            continue
        a, b = material[i], stuff[e]
        arm = radius - overlap
        u = velocity[i, 0] + rate * x - arm * (spin[i, 1] * z - spin[i, 2] * y)
        v = velocity[i, 1] + rate * y - arm * (spin[i, 2] * x - spin[i, 0] * z)
        s = velocity[i, 2] + rate * z - arm * (spin[i, 0] * y - spin[i, 1] * x)
        if touched[p] != step - 1:
            begin(a, b, radius, 0.0, 1.0 / inverse_mass[i, 0], 0.0, law, pair, loss, rate, grip)
            record.impact[w, 1, speed_bin(rate)] += 1
            if tangential >= TangentialLaw.MINDLIN:
                for c in range(4):
                    touches.stretch[w, p, c] = 0.0
        elif rate > grip[ONSET]:
            renew(a, b, law, pair, loss, rate, grip)
        touched[p] = step
        record.extreme[w, 1] = max(record.extreme[w, 1], overlap)
        limit = DASHPOT_SHARE * grip[MASS] / time_step
        normal, elastic = normal_force(
            law, overlap, rate, grip[GRIP_STIFFNESS], grip[DAMPING], grip[LEAST], limit, tension
        )
        loss_normal += (normal - elastic) * rate
        if tangential == TangentialLaw.TANH:
            slip = u * u + v * v + s * s
            drag = friction_smoothed(
                max(normal, 0.0),
                grip[GRIP_FRICTION],
                slip,
                grip[GRIP_SMOOTHING],
                FRICTION_SHARE * SLIP_MASS * grip[MASS] / time_step,
            )
            loss_friction += drag * slip
            u, v, s = -drag * u, -drag * v, -drag * s
        elif tangential == TangentialLaw.NONE:
            u, v, s = 0.0, 0.0, 0.0
        else:
            shear = grip[GRIP_SHEAR] * sqrt(overlap) if tangential == TangentialLaw.MINDLIN else grip[GRIP_SHEAR]
            dashpot = pair[a, b, TANGENTIAL_DASHPOT] * dashpot_of(law, overlap, elastic, grip[DAMPING], limit)
            bound = grip[GRIP_FRICTION] * abs(normal)
            # The slip in the middle of the step, which the spring grows by.
            speed, turn = particles.velocity[w, i], particles.spin[w, i]
            along = speed[0] * x + speed[1] * y + speed[2] * z
            du = speed[0] - along * x - arm * (turn[1] * z - turn[2] * y)
            dv = speed[1] - along * y - arm * (turn[2] * x - turn[0] * z)
            ds = speed[2] - along * z - arm * (turn[0] * y - turn[1] * x)
            memory = touches.stretch[w, p]
            u, v, s, memory[0], memory[1], memory[2], lost = spring_force(
                memory[0],
                memory[1],
                memory[2],
                memory[3],
                x,
                y,
                z,
                u,
                v,
                s,
                du,
                dv,
                ds,
                shear,
                dashpot,
                bound,
                time_step,
            )
            memory[3] = shear
            loss_friction += lost
        fx, fy, fz = normal * x + u, normal * y + v, normal * z + s
        force[i, 0] += fx
        force[i, 1] += fy
        force[i, 2] += fz
        wall_force[group, 0] -= fx
        wall_force[group, 1] -= fy
        wall_force[group, 2] -= fz
        torque[i, 0] -= arm * (y * s - z * v)
        torque[i, 1] -= arm * (z * u - x * s)
        torque[i, 2] -= arm * (x * v - y * u)
        if rules.rolling[w] != 0:
            inertia = FRICTION_SHARE / (time_step * inverse_mass[i, 1])
            tx, ty, tz, lost = rolling_torque(
                x,
                y,
                z,
                spin[i, 0],
                spin[i, 1],
                spin[i, 2],
                max(normal, 0.0),
                pair[a, b, ROLLING],
                radius,
                inertia,
            )
            torque[i, 0] += tx
            torque[i, 1] += ty
            torque[i, 2] += tz
            loss_rolling += lost
    touches.n_active[w] = n_touching
    ledger = record.ledger[w]
    ledger[LOSS_NORMAL_WALL] += loss_normal * time_step
    ledger[LOSS_FRICTION_WALL] += loss_friction * time_step
    ledger[LOSS_LID] += loss_lid * time_step
    ledger[LOSS_ROLLING] += loss_rolling * time_step
