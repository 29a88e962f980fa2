"""Forces of the contacts between particles: each touching pair once, scattered to both.

Two passes over the inner list. The first only compares distances and writes down, without a branch, who touches; the
second works on touching pairs alone, in blocks (see :mod:`graindamp.dem.block`)."""

from math import sqrt

from graindamp.dem.block import (
    ARM,
    BRANCH,
    FORCE,
    NX,
    NY,
    NZ,
    OTHER_ARM,
    OVERLAP,
    RADIUS,
    REACH,
    SPEED,
    SWEEP,
    TORQUE,
    TURN,
    add_losses,
    block_forces,
    clear_losses,
)
from graindamp.dem.columns import LANE
from graindamp.dem.compile import merged
from graindamp.dem.grip import OF_PARTICLES


@merged
def find_touching(w, particles, pairs):
    """Write the pairs of world w that overlap to the active list."""
    position = particles.position[w]
    first, second, inner = pairs.inner_first[w], pairs.inner_second[w], pairs.inner[w]
    active, active_first, active_second = pairs.active[w], pairs.active_first[w], pairs.active_second[w]
    n_active = 0
    for k in range(pairs.n_inner[w]):
        i, j = first[k], second[k]
        x = position[j, 0] - position[i, 0]
        y = position[j, 1] - position[i, 1]
        z = position[j, 2] - position[i, 2]
        reach = position[i, 3] + position[j, 3]
        active[n_active], active_first[n_active], active_second[n_active] = inner[k], i, j
        n_active += x * x + y * y + z * z < reach * reach
    pairs.n_active[w] = n_active


@merged
def pair_forces(w, step, particles, pairs, rules, record, scratch):
    """Add the forces and torques of all touching pairs of world w, and what they dissipate to the ledger."""
    b = scratch.buffer[w]
    clear_losses(b)
    for k in range(0, pairs.n_active[w], LANE):
        n = min(LANE, pairs.n_active[w] - k)
        gather_pairs(w, k, n, particles, pairs, b)
        pair_normals(b)
        block_forces(w, step, k, n, OF_PARTICLES, pairs, particles, particles.material[w], rules, record, b)
        scatter_pairs(w, k, n, particles, pairs, b)
    add_losses(w, OF_PARTICLES, rules.time_step[w], record, b)


@merged
def gather_pairs(w, k, n, particles, pairs, b):
    """Relative position, velocity and spin of `n` touching pairs from place k on, into the rows of the buffer."""
    position, seen = particles.position[w], particles.seen[w]
    first, second = pairs.active_first[w], pairs.active_second[w]
    for m in range(n):
        i, j = first[k + m], second[k + m]
        ri, rj = position[i, 3], position[j, 3]
        b[RADIUS + m] = ri
        # Whole rows of four, so that the compiler can use one vector instruction for each line. The fourth number of
        # the first row is the difference of the radii, those of the others are idle.
        x0 = position[j, 0] - position[i, 0]
        x1 = position[j, 1] - position[i, 1]
        x2 = position[j, 2] - position[i, 2]
        x3 = position[j, 3] - position[i, 3]
        q = BRANCH + 4 * m
        b[q], b[q + 1], b[q + 2], b[q + 3] = x0, x1, x2, x3
        x0 = seen[i, 0] - seen[j, 0]
        x1 = seen[i, 1] - seen[j, 1]
        x2 = seen[i, 2] - seen[j, 2]
        x3 = seen[i, 3] - seen[j, 3]
        q = SPEED + 4 * m
        b[q], b[q + 1], b[q + 2], b[q + 3] = x0, x1, x2, x3
        x0 = ri * seen[i, 4] + rj * seen[j, 4]
        x1 = ri * seen[i, 5] + rj * seen[j, 5]
        x2 = ri * seen[i, 6] + rj * seen[j, 6]
        x3 = ri * seen[i, 7] + rj * seen[j, 7]
        y0 = seen[i, 4] + seen[j, 4]
        y1 = seen[i, 5] + seen[j, 5]
        y2 = seen[i, 6] + seen[j, 6]
        y3 = seen[i, 7] + seen[j, 7]
        q = SWEEP + 4 * m
        b[q], b[q + 1], b[q + 2], b[q + 3] = x0, x1, x2, x3
        q = TURN + 4 * m
        b[q], b[q + 1], b[q + 2], b[q + 3] = y0, y1, y2, y3


@merged
def pair_normals(b):
    """Normals, overlaps and arms of a block; the arms of both particles end at the middle of the overlap."""
    for m in range(LANE):
        q = BRANCH + 4 * m
        x, y, z = b[q], b[q + 1], b[q + 2]
        square = x * x + y * y + z * z
        inverse = 1.0 / sqrt(square)
        reach = b[q + 3] + 2.0 * b[RADIUS + m]
        overlap = reach - square * inverse
        b[NX + m], b[NY + m], b[NZ + m] = x * inverse, y * inverse, z * inverse
        arm = b[RADIUS + m] - 0.5 * overlap
        b[REACH + m], b[OVERLAP + m], b[ARM + m], b[OTHER_ARM + m] = reach, overlap, arm, reach - overlap - arm


@merged
def scatter_pairs(w, k, n, particles, pairs, b):
    """Add forces and torques of a block to both bodies of each pair, in the order of the pairs."""
    load, first, second = particles.load[w], pairs.active_first[w], pairs.active_second[w]
    for m in range(n):
        i, j = first[k + m], second[k + m]
        arm, other = b[ARM + m], b[OTHER_ARM + m]
        q = FORCE + 4 * m
        f0, f1, f2, f3 = b[q], b[q + 1], b[q + 2], b[q + 3]
        q = TORQUE + 4 * m
        t0, t1, t2, t3 = b[q], b[q + 1], b[q + 2], b[q + 3]
        x0, x1, x2, x3 = load[i, 0] + f0, load[i, 1] + f1, load[i, 2] + f2, load[i, 3] + f3
        y0, y1, y2, y3 = load[i, 4] + arm * t0, load[i, 5] + arm * t1, load[i, 6] + arm * t2, load[i, 7] + arm * t3
        load[i, 0], load[i, 1], load[i, 2], load[i, 3] = x0, x1, x2, x3
        load[i, 4], load[i, 5], load[i, 6], load[i, 7] = y0, y1, y2, y3
        x0, x1, x2, x3 = load[j, 0] - f0, load[j, 1] - f1, load[j, 2] - f2, load[j, 3] - f3
        y0, y1 = load[j, 4] + other * t0, load[j, 5] + other * t1
        y2, y3 = load[j, 6] + other * t2, load[j, 7] + other * t3
        load[j, 0], load[j, 1], load[j, 2], load[j, 3] = x0, x1, x2, x3
        load[j, 4], load[j, 5], load[j, 6], load[j, 7] = y0, y1, y2, y3
