"""Who may touch whom: linked cells, an outer list within a skin, and an inner list for the next dozen steps.

Both lists are exact: a bound on how far particles have moved relative to each other since a list was made is kept
from the fastest one of every step, and a list is renewed before that bound reaches half its reach. The bound is taken
relative to the bed's mean velocity at the last outer refresh, because a bed that flies across its container as one
block does not change its neighbours. Pairs are sorted by their two members, so that forces are summed in the same
order whatever the reach."""

import numpy as np

from graindamp.dem.columns import ONSET, TOUCHED
from graindamp.dem.compile import checked, inner
from graindamp.dem.grip import OF_PARTICLES, begin
from graindamp.dem.laws import TangentialLaw
from graindamp.status import Status

INNER_STEPS = 12.0
"""Steps that an inner list shall last at the present speed of the fastest particle [-]."""

FARTHEST = 1e6
"""A coordinate beyond this, or no number at all, means that a particle is lost [m]."""

LISTS_FULL = int(Status.LISTS_FULL)
PARTICLE_LOST = int(Status.PARTICLE_LOST)


@checked
def refresh_pairs(w, step, particles, pairs, rules, scratch):
    """Make the outer list of pairs of world w; contacts that touched at `step` keep their memory. Returns a status
    bit or 0."""
    position, n, skin = particles.position[w], particles.n_particle[w], rules.skin[w]
    first, second, grip = pairs.first[w], pairs.second[w], pairs.grip[w]
    start, place, member, near = scratch.start[w], scratch.place[w], scratch.member[w], scratch.near[w]
    material, capacity = particles.material[w], first.shape[0]

    low_x = high_x = position[0, 0]
    low_y = high_y = position[0, 1]
    low_z = high_z = position[0, 2]
    largest = 0.0
    for i in range(n):
        x, y, z = position[i, 0], position[i, 1], position[i, 2]
        if not (abs(x) < FARTHEST and abs(y) < FARTHEST and abs(z) < FARTHEST):
            return PARTICLE_LOST
        largest = max(largest, position[i, 3])
        low_x, high_x = min(low_x, x), max(high_x, x)
        low_y, high_y = min(low_y, y), max(high_y, y)
        low_z, high_z = min(low_z, z), max(high_z, z)
    cell = 2.0 * largest + skin
    # A few runaway particles must not ask for more cells than there is room for.
    while True:
        nx = int((high_x - low_x) / cell) + 1
        ny = int((high_y - low_y) / cell) + 1
        nz = int((high_z - low_z) / cell) + 1
        if float(nx) * float(ny) * float(nz) < start.shape[0]:
            break
        cell *= 1.5
    for c in range(nx * ny * nz + 1):
        start[c] = 0
    for i in range(n):
        a = int((position[i, 0] - low_x) / cell)
        b = int((position[i, 1] - low_y) / cell)
        c = int((position[i, 2] - low_z) / cell)
        place[i] = (a * ny + b) * nz + c
        start[place[i]] += 1
    for c in range(nx * ny * nz):
        start[c + 1] += start[c]
    for i in range(n - 1, -1, -1):
        start[place[i]] -= 1
        member[start[place[i]]] = i

    kept = keep(w, step, pairs, rules)
    n_pair, n_active = np.int64(0), 0
    for i in range(n):
        x, y, z, reach = position[i, 0], position[i, 1], position[i, 2], position[i, 3] + skin
        a = place[i] // (ny * nz)
        b = place[i] // nz % ny
        c = place[i] % nz
        n_near = 0
        for ca in range(max(a - 1, 0), min(a + 2, nx)):
            for cb in range(max(b - 1, 0), min(b + 2, ny)):
                row = (ca * ny + cb) * nz
                for m in range(start[row + max(c - 1, 0)], start[row + min(c + 2, nz)]):
                    j = member[m]
                    if j > i:
                        dx, dy, dz = position[j, 0] - x, position[j, 1] - y, position[j, 2] - z
                        limit = reach + position[j, 3]
                        if dx * dx + dy * dy + dz * dz < limit * limit:
                            k = n_near
                            while k > 0 and near[k - 1] > j:
                                near[k] = near[k - 1]
                                k -= 1
                            near[k] = j
                            n_near += 1
        if n_pair + n_near > kept:
            put_back(w, step, n_active, kept, OF_PARTICLES, pairs, particles, material, rules)
            return LISTS_FULL
        for k in range(n_near):
            j = near[k]
            first[n_pair], second[n_pair], grip[n_pair, TOUCHED] = i, j, -9.0
            while kept < capacity and (first[kept] < i or (first[kept] == i and second[kept] < j)):
                kept += 1
            if kept < capacity and first[kept] == i and second[kept] == j:
                remember(w, step, kept, n_pair, OF_PARTICLES, pairs, particles, material, rules)
                pairs.active[w, n_active] = n_pair
                n_active += 1
                kept += 1
            n_pair += 1
    pairs.n_active[w] = n_active
    pairs.n_outer[w] = n_pair
    return 0


@checked
def keep(w, step, contacts, rules):
    """Move the contacts that touch to the end of the outer list: who, and at which speed it began, from which all else
    that a contact knows follows, but for its spring.

    Returns the place of the first of them. A new list grows from the front, as long as it is shorter than that; each
    contact that it takes over makes room for one."""
    active, grip = contacts.active[w], contacts.grip[w]
    kept = np.int64(grip.shape[0])
    for k in range(contacts.n_active[w] - 1, -1, -1):
        p = active[k]
        if grip[p, TOUCHED] == step:
            kept -= 1
            contacts.first[w, kept], contacts.second[w, kept] = contacts.first[w, p], contacts.second[w, p]
            grip[kept, ONSET] = grip[p, ONSET]
            if rules.tangential[w] >= TangentialLaw.MINDLIN:
                for c in range(4):
                    contacts.stretch[w, kept, c] = contacts.stretch[w, p, c]
    return kept


@checked
def remember(w, step, k, p, wall, contacts, particles, material, rules):
    """Give what the contact at place k knows to place p of the list; `material` is that of the second bodies."""
    i, j = contacts.first[w, p], contacts.second[w, p]
    begin(w, i, j, wall, particles, material, rules, contacts.grip[w, k, ONSET], contacts.grip[w, p])
    contacts.grip[w, p, TOUCHED] = step
    if rules.tangential[w] >= TangentialLaw.MINDLIN:
        for c in range(4):
            contacts.stretch[w, p, c] = contacts.stretch[w, k, c]


@checked
def put_back(w, step, n_active, kept, wall, contacts, particles, material, rules):
    """Make the `n_active` contacts that a new list had taken over, and those at its end from place `kept` on, the whole
    list, so that a longer list can take them over."""
    capacity = contacts.grip.shape[1]
    n = n_active + capacity - kept
    for k in range(n):
        p = np.int64(contacts.active[w, k]) if k < n_active else kept + k - n_active
        contacts.first[w, k], contacts.second[w, k] = contacts.first[w, p], contacts.second[w, p]
        remember(w, step, p, k, wall, contacts, particles, material, rules)
        contacts.active[w, k] = k
    contacts.n_active[w] = n
    contacts.n_outer[w] = n


@inner
def narrow_pairs(w, particles, pairs, reach):
    """Make the inner list: pairs of the outer list that are nearer than `reach` to touching."""
    position = particles.position[w]
    first, second, inner = pairs.first[w], pairs.second[w], pairs.inner[w]
    inner_first, inner_second = pairs.inner_first[w], pairs.inner_second[w]
    n_inner = 0
    for p in range(pairs.n_outer[w]):
        i, j = first[p], second[p]
        x = position[j, 0] - position[i, 0]
        y = position[j, 1] - position[i, 1]
        z = position[j, 2] - position[i, 2]
        limit = position[i, 3] + position[j, 3] + reach
        inner[n_inner], inner_first[n_inner], inner_second[n_inner] = p, i, j
        n_inner += x * x + y * y + z * z < limit * limit
    pairs.n_inner[w] = n_inner
