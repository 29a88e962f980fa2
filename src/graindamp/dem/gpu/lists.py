"""Who may touch whom, made by the threads of one block: linked cells, an outer list within a skin, an inner list.

As on the processor the lists are exact and sorted by their members; the order in which threads come to the cells never
shows. A particle's thread finds its neighbours with greater numbers, which are its pairs, and those with smaller
numbers, whose pairs it will look up when it gathers forces."""

from numba import cuda

from graindamp.dem.columns import N_GRIP
from graindamp.dem.gpu.block import largest, running
from graindamp.dem.gpu.columns import (
    LARGEST,
    N_INNER,
    N_PAIR,
    N_PARTICLE,
    NARROWINGS,
    SIDE,
    SKIN,
    WANTED_PAIRS,
)
from graindamp.dem.gpu.device import WITH_SPRINGS
from graindamp.dem.neighbours import FARTHEST, LISTS_FULL, PARTICLE_LOST

FREE = -9
"""Step of a pair that never touched."""


def refresh_pairs(w, step, buffer, thread, width, batch):
    """Make the outer list of world w in the copy that is not in use; contacts that touched in the step before
    `step` keep their memory. Returns a status bit or 0; the copy in use is left as it was."""
    bed, pairs, slots = batch.bed, batch.pairs, batch.slots
    n, skin = slots.codes[w, N_PARTICLE], slots.numbers[w, SKIN]
    old = slots.counts[w, SIDE]
    new = 1 - old
    px, py, pz = bed.position[w, 0], bed.position[w, 1], bed.position[w, 2]
    start, cell, member = batch.scratch.cell_start[w], batch.scratch.cell[w], batch.scratch.member[w]

    # Bounds of the bed, as the largest of x, -x, y, -y, z, -z.
    high_x = high_y = high_z = less_x = less_y = less_z = -FARTHEST
    lost = 0
    for i in range(thread, n, width):
        x, y, z = px[i], py[i], pz[i]
        if abs(x) < FARTHEST and abs(y) < FARTHEST and abs(z) < FARTHEST:
            high_x, less_x = max(high_x, x), max(less_x, -x)
            high_y, less_y = max(high_y, y), max(less_y, -y)
            high_z, less_z = max(high_z, z), max(less_z, -z)
        else:
            lost = 1
    if cuda.syncthreads_or(lost):
        return PARTICLE_LOST
    high_x, low_x = largest(high_x, buffer, thread, width), -largest(less_x, buffer, thread, width)
    high_y, low_y = largest(high_y, buffer, thread, width), -largest(less_y, buffer, thread, width)
    high_z, low_z = largest(high_z, buffer, thread, width), -largest(less_z, buffer, thread, width)

    size = 2.0 * slots.numbers[w, LARGEST] + skin
    nx = int((high_x - low_x) / size) + 1
    ny = int((high_y - low_y) / size) + 1
    nz = int((high_z - low_z) / size) + 1
    # A few runaway particles must not ask for more cells than there is room for.
    while float(nx) * float(ny) * float(nz) >= start.shape[0]:
        size *= 1.5
        nx = int((high_x - low_x) / size) + 1
        ny = int((high_y - low_y) / size) + 1
        nz = int((high_z - low_z) / size) + 1
    n_cell = nx * ny * nz
    for c in range(thread, n_cell, width):
        start[c] = 0
    cuda.syncthreads()
    for i in range(thread, n, width):
        a, b, c = int((px[i] - low_x) / size), int((py[i] - low_y) / size), int((pz[i] - low_z) / size)
        place = (a * ny + b) * nz + c
        cell[i] = place
        cuda.atomic.add(start, place, 1)
    running(start, n_cell, buffer, thread, width)
    # Each cell's number counts up from its own begin to that of the next cell.
    for i in range(thread, n, width):
        member[cuda.atomic.add(start, cell[i], 1)] = i
    cuda.syncthreads()

    forward, backward, n_pair = pairs.start[w, new], pairs.back_start[w], 0
    for fill in range(2):  # first count, then write
        for i in range(thread, n, width):
            first, back = -1, -1
            if fill > 0:
                first, back = forward[i], backward[i]
            after, before = neighbours(w, i, nx, ny, nz, bed, start, cell, member, skin, pairs, new, first, back)
            if fill == 0:
                forward[i], backward[i] = after, before
        if fill == 0:
            n_pair = running(forward, n, buffer, thread, width)
            running(backward, n, buffer, thread, width)
            if n_pair > pairs.back.shape[1]:
                if thread == 0:
                    slots.counts[w, WANTED_PAIRS] = n_pair
                return LISTS_FULL
    cuda.syncthreads()
    for i in range(thread, n, width):
        remember(w, i, n, old, new, step, pairs)
    cuda.syncthreads()
    if thread == 0:
        slots.counts[w, SIDE] = new
        slots.counts[w, N_PAIR] = n_pair
    cuda.syncthreads()
    return 0


def neighbours(w, i, nx, ny, nz, bed, start, cell, member, skin, pairs, new, first, back):
    """Numbers of neighbours of particle i greater and smaller than i; written sorted to the new list from place `first`
    and to `back` from place `back`, unless these are negative."""
    px, py, pz, radius = bed.position[w, 0], bed.position[w, 1], bed.position[w, 2], bed.radius[w]
    x, y, z, reach = px[i], py[i], pz[i], radius[i] + skin
    second, before = pairs.second[w, new], pairs.back[w]
    own = cell[i]
    a, b, c = own // (ny * nz), own // nz % ny, own % nz
    n_first, n_back = 0, 0
    for ca in range(max(a - 1, 0), min(a + 2, nx)):
        for cb in range(max(b - 1, 0), min(b + 2, ny)):
            row = (ca * ny + cb) * nz
            begin, end = row + max(c - 1, 0), row + min(c + 1, nz - 1)
            low = start[begin - 1] if begin > 0 else 0
            for m in range(low, start[end]):
                j = int(member[m])
                dx, dy, dz = px[j] - x, py[j] - y, pz[j] - z
                limit = reach + radius[j]
                if j != i and dx * dx + dy * dy + dz * dz < limit * limit:
                    if j > i:
                        if first >= 0:
                            k = first + n_first
                            while k > first and second[k - 1] > j:
                                second[k] = second[k - 1]
                                k -= 1
                            second[k] = j
                        n_first += 1
                    else:
                        if back >= 0:
                            k = back + n_back
                            while k > back and before[k - 1] > j:
                                before[k] = before[k - 1]
                                k -= 1
                            before[k] = j
                        n_back += 1
    return n_first, n_back


def remember(w, i, n, old, new, step, pairs):
    """Finish the new list for particle i: first members, memory of contacts that touched in the last step, and places
    of the pairs in which it is the second member."""
    start, second, touched = pairs.start[w, new], pairs.second[w, new], pairs.touched[w, new]
    old_start, old_second, old_touched = pairs.start[w, old], pairs.second[w, old], pairs.touched[w, old]
    q, last = old_start[i], old_start[i + 1]
    for p in range(start[i], start[i + 1]):
        pairs.first[w, new, p] = i
        touched[p] = FREE
        while q < last and old_second[q] < second[p]:
            q += 1
        if q < last and old_second[q] == second[p] and old_touched[q] == step - 1:
            touched[p] = step - 1
            for k in range(N_GRIP):
                pairs.grip[w, new, p, k] = pairs.grip[w, old, q, k]
            if WITH_SPRINGS:
                for k in range(4):
                    pairs.stretch[w, new, p, k] = pairs.stretch[w, old, q, k]
    back = pairs.back[w]
    for m in range(pairs.back_start[w, i], pairs.back_start[w, i + 1]):
        j = int(back[m])
        p = start[j]
        while second[p] != i:
            p += 1
        back[m] = p


def narrow_pairs(w, reach, buffer, thread, width, batch):
    """Make the inner list of world w: pairs of the outer list that are nearer than `reach` to touching."""
    bed, pairs, slots = batch.bed, batch.pairs, batch.slots
    n, side = slots.codes[w, N_PARTICLE], slots.counts[w, SIDE]
    px, py, pz, radius = bed.position[w, 0], bed.position[w, 1], bed.position[w, 2], bed.radius[w]
    start, second, back_start, back = pairs.start[w, side], pairs.second[w, side], pairs.back_start[w], pairs.back[w]
    place, inner_start, inner_back_start = pairs.place[w], pairs.inner_start[w], pairs.inner_back_start[w]
    for i in range(thread, n, width):
        x, y, z, own, count = px[i], py[i], pz[i], radius[i] + reach, 0
        for p in range(start[i], start[i + 1]):
            j = second[p]
            dx, dy, dz = px[j] - x, py[j] - y, pz[j] - z
            limit = own + radius[j]
            near = dx * dx + dy * dy + dz * dz < limit * limit
            place[p] = 0 if near else -1
            count += 1 if near else 0
        inner_start[i] = count
    cuda.syncthreads()
    for i in range(thread, n, width):
        count = 0
        for m in range(back_start[i], back_start[i + 1]):
            count += 1 if place[back[m]] >= 0 else 0
        inner_back_start[i] = count
    n_inner = running(inner_start, n, buffer, thread, width)
    running(inner_back_start, n, buffer, thread, width)
    for i in range(thread, n, width):
        k = inner_start[i]
        for p in range(start[i], start[i + 1]):
            if place[p] >= 0:
                pairs.inner[w, k], pairs.inner_first[w, k], pairs.inner_second[w, k] = p, i, second[p]
                place[p] = k
                k += 1
    cuda.syncthreads()
    for i in range(thread, n, width):
        k = inner_back_start[i]
        for m in range(back_start[i], back_start[i + 1]):
            if place[back[m]] >= 0:
                pairs.inner_back[w, k] = place[back[m]]
                k += 1
    cuda.syncthreads()
    if thread == 0:
        slots.counts[w, N_INNER] = n_inner
        slots.counts[w, NARROWINGS] += 1
    cuda.syncthreads()
