"""Contacts with the walls: who is near which element, and the forces of those that touch.

Elements of one patch share the memory of a contact, which lies at the place of the first of them in the outer list;
the first element of the patch that touches acts for all. Foam remembers nothing."""

import numpy as np

from graindamp.dem.block import (
    ARM,
    FORCE,
    NX,
    NY,
    NZ,
    OTHER_ARM,
    OVERLAP,
    RADIUS,
    SPEED,
    SWEEP,
    TORQUE,
    TURN,
    add_losses,
    block_forces,
    clear_losses,
)
from graindamp.dem.columns import LANE, LOSS_LID, TOUCHED
from graindamp.dem.compile import checked, inner, merged
from graindamp.dem.grip import OF_WALLS
from graindamp.dem.laws import NormalLaw, foam_force
from graindamp.dem.neighbours import keep, put_back, remember
from graindamp.dem.walls import FOAM_FIRST, nearest
from graindamp.status import Status

LISTS_FULL = int(Status.LISTS_FULL)


@checked
def refresh_touches(w, step, particles, touches, walls, rules, scratch):
    """Make the outer list of wall contacts of world w; those that touched at `step` keep their memory. Returns a
    status bit or 0.

    Entries are sorted by particle, patch and element.
    """
    position, skin = particles.position[w], rules.skin[w]
    first, second, grip = touches.first[w], touches.second[w], touches.grip[w]
    kind, shapes, patch, edges = walls.kind[w], walls.shape[w], walls.patch[w], walls.edges[w]
    grid, cell_start, cell_element = walls.grid[w], walls.cell_start[w], walls.cell_element[w]
    near, material, n_plain, capacity = scratch.near[w], walls.material[w], walls.n_plain[w], first.shape[0]

    kept = keep(w, step, touches, rules)
    n_touch, n_active = np.int64(0), 0
    for i in range(particles.n_particle[w]):
        x, y, z, radius = position[i, 0], position[i, 1], position[i, 2], position[i, 3]
        n_near, n_cell, cell = 0, 0, 0
        if grid[3] > 0.0:
            a, b, c = int((x - grid[0]) / grid[3]), int((y - grid[1]) / grid[3]), int((z - grid[2]) / grid[3])
            if 0 <= a < grid[4] and 0 <= b < grid[5] and 0 <= c < grid[6]:
                cell = (a * int(grid[5]) + b) * int(grid[6]) + c
                n_cell = cell_start[cell + 1] - cell_start[cell]
        for m in range(n_plain + n_cell):
            e = np.uint32(m if m < n_plain else cell_element[cell_start[cell] + m - n_plain])
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
        if n_touch + n_near > kept:
            put_back(w, step, n_active, kept, OF_WALLS, touches, particles, material, rules)
            return LISTS_FULL
        for k in range(n_near):
            e = near[k]
            first[n_touch], second[n_touch], grip[n_touch, TOUCHED] = i, e, -9.0
            if k == 0 or patch[near[k - 1]] != patch[e]:
                while kept < capacity and (first[kept] < i or (first[kept] == i and patch[second[kept]] < patch[e])):
                    kept += 1
                if kept < capacity and first[kept] == i and patch[second[kept]] == patch[e]:
                    remember(w, step, kept, n_touch, OF_WALLS, touches, particles, material, rules)
                    touches.active[w, n_active] = n_touch
                    n_active += 1
                    kept += 1
            n_touch += 1
    touches.n_active[w] = n_active
    touches.n_outer[w] = n_touch
    return 0


@merged
def narrow_touches(w, particles, touches, walls, reach):
    """Make the inner list of wall contacts: plain elements nearer than `reach` to touching, and all elements of
    meshes. Its places are those of the memories."""
    position = particles.position[w]
    first, second, inner = touches.first[w], touches.second[w], touches.inner[w]
    inner_first, inner_second = touches.inner_first[w], touches.inner_second[w]
    kind, shapes, edges, patch = walls.kind[w], walls.shape[w], walls.edges[w], walls.patch[w]
    n_inner, memory = 0, 0
    for p in range(touches.n_outer[w]):
        i, e = first[p], second[p]
        if p > 0 and not (first[p - 1] == i and patch[second[p - 1]] == patch[e]):
            memory = p
        radius = position[i, 3]
        inner[n_inner], inner_first[n_inner], inner_second[n_inner] = memory, i, e
        n_inner += (
            e >= walls.n_plain[w]
            or nearest(kind[e], shapes, e, edges, position[i, 0], position[i, 1], position[i, 2], radius)[0]
            < radius + reach
        )
    touches.n_inner[w] = n_inner


@merged
def wall_forces(w, step, particles, touches, walls, rules, record, scratch):
    """Add the forces and torques of the walls of world w on the particles, and sum up the forces on each wall."""
    b = scratch.buffer[w]
    wall_force = record.wall_force[w]
    for g in range(walls.n_group[w]):
        for c in range(3):
            wall_force[g, c] = 0.0
    touches.n_active[w] = 0
    touches.n_soft[w] = 0
    clear_losses(b)
    k = np.int64(0)  # a plain 0 would have the loop's body compiled once more, for a constant
    while k < touches.n_inner[w]:
        start = np.int64(touches.n_active[w])
        k = gather_touches(w, k, particles, touches, walls, rules, record, b)
        n = touches.n_active[w] - start
        if n > 0:
            block_forces(w, step, start, n, OF_WALLS, touches, particles, walls.material[w], rules, record, b)
            scatter_touches(w, start, n, particles, touches, walls, record, b)
    add_losses(w, OF_WALLS, rules.time_step[w], record, b)


@merged
def gather_touches(w, k, particles, touches, walls, rules, record, b):
    """Append the touching entries of the inner list from place k on to the active list and write them into the
    buffer, until it is full. Returns the place to go on from. Foam acts at once."""
    position, seen = particles.position[w], particles.seen[w]
    first, second, inner = touches.inner_first[w], touches.inner_second[w], touches.inner[w]
    kind, shapes, edges, law = walls.kind[w], walls.shape[w], walls.edges[w], walls.law[w]
    start = n_active = touches.n_active[w]
    while k < touches.n_inner[w] and n_active < start + LANE:
        i, e, p = first[k], second[k], inner[k]
        k += 1
        radius = position[i, 3]
        distance, x, y, z = nearest(kind[e], shapes, e, edges, position[i, 0], position[i, 1], position[i, 2], radius)
        overlap = radius - distance
        if overlap <= 0.0 or (n_active > 0 and touches.active[w, n_active - 1] == p):
            continue
        if law[e] == NormalLaw.FOAM:
            press_foam(w, i, e, overlap, x, y, z, particles, walls, rules, record)
            touches.n_soft[w] += 1
            continue
        m = n_active - start
        q = 4 * m
        touches.active[w, n_active], touches.active_first[w, n_active], touches.active_second[w, n_active] = p, i, e
        b[RADIUS + m], b[OVERLAP + m], b[ARM + m], b[OTHER_ARM + m] = radius, overlap, distance, 0.0
        # The normal of a wall points to the particle, that of a contact to the second body.
        b[NX + m], b[NY + m], b[NZ + m] = -x, -y, -z
        for c in range(4):
            b[SPEED + q + c], b[SWEEP + q + c], b[TURN + q + c] = seen[i, c], distance * seen[i, 4 + c], 0.0
        n_active += 1
    touches.n_active[w] = n_active
    return k


@merged
def scatter_touches(w, k, n, particles, touches, walls, record, b):
    """Add forces and torques of a block to the particles, and the forces to those of the walls."""
    load, wall_force, group = particles.load[w], record.wall_force[w], walls.group[w]
    for m in range(n):
        i, g = touches.active_first[w, k + m], group[touches.active_second[w, k + m]]
        for c in range(3):
            load[i, c] += b[FORCE + 4 * m + c]
            load[i, 4 + c] += b[ARM + m] * b[TORQUE + 4 * m + c]
            wall_force[g, c] -= b[FORCE + 4 * m + c]


@inner
def press_foam(w, i, e, overlap, x, y, z, particles, walls, rules, record):
    """Add the force of foam on particle i, along the foam's normal (x, y, z), and what it dissipates to the ledger."""
    seen, load, shape, a = particles.seen[w], particles.load[w], walls.shape[w, e], FOAM_FIRST
    wall_force = record.wall_force[w, walls.group[w, e]]
    rate = -(seen[i, 0] * x + seen[i, 1] * y + seen[i, 2] * z)
    normal, elastic = foam_force(overlap, rate, shape[a], shape[a + 1], shape[a + 2], shape[a + 3], shape[a + 4])
    load[i, 0] += normal * x
    load[i, 1] += normal * y
    load[i, 2] += normal * z
    wall_force[0] -= normal * x
    wall_force[1] -= normal * y
    wall_force[2] -= normal * z
    record.ledger[w, LOSS_LID] += (normal - elastic) * rate * rules.time_step[w]
