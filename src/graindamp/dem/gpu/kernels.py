"""The kernel: one thread block is one world, and does many steps of it in a launch.

A step has two barriers. Before the first every thread gathers the forces of its particles and moves them; after it
every thread computes the forces of its pairs and wall contacts and writes them down. A thread writes rows of its own
only, and sums are kept per thread and added up in a fixed order, so that results do not depend on timing."""

from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numba import cuda

from graindamp.dem.gpu.block import any_due, meet
from graindamp.dem.gpu.columns import (
    BEYOND,
    END,
    ENOUGH,
    HALTED,
    IDLE,
    MOVING,
    N_ROW,
    N_SETTLE,
    N_SUM,
    NEW,
    PER_ROW,
    RUNNING,
    STAGE,
    STATUS,
    STEP,
    WAY_OUTER,
)
from graindamp.dem.gpu.device import TEAMS, THREADS, Builder, Variant
from graindamp.dem.gpu.forces import pair_forces
from graindamp.dem.gpu.lists import FREE
from graindamp.dem.gpu.steps import container, drift, occasion, renew, speeds
from graindamp.dem.gpu.touches import wall_forces


def advance(batch, limit):
    """Advance the world of this block by at most `limit` steps, until its end, until the cycle with which it is known
    well enough, or until a status bit stops it.

    A team of blocks shares out particles and contacts of its world; lists and what else is done rarely are the work of
    its first block."""
    buffer = cuda.shared.array(THREADS, np.float64)
    moving = cuda.shared.array((2, 8), np.float64)
    # The slot is read from shared memory anew after each barrier, so that the compiler keeps no addresses of one part
    # of a step in registers during the other.
    here = cuda.shared.array(1, np.int64)
    thread, width, team = cuda.threadIdx.x, cuda.blockDim.x, 1
    if TEAMS:
        team = cuda.gridDim.x // batch.slots.counts.shape[0]
    w = cuda.blockIdx.x // team
    first = cuda.blockIdx.x % team == 0
    own, every = (cuda.blockIdx.x % team) * width + thread, team * width
    counts, codes = batch.slots.counts[w], batch.slots.codes[w]
    stage, step, status, done = counts[STAGE], counts[STEP], counts[STATUS], 0
    n_settle, per_row, end = codes[N_SETTLE], codes[PER_ROW], codes[END]
    if stage == IDLE or status != 0 or counts[ENOUGH] != 0 or (stage == RUNNING and step >= end):
        return
    if thread == 0:
        here[0] = w
        for c in range(8):
            moving[step % 2, c] = batch.slots.numbers[w, MOVING + c]
    meet(counts, team)
    while stage != RUNNING or (step < end and done < limit):
        due = 1
        if stage == RUNNING:
            w = here[0]
            # The last thread, which may have a particle less than the others, moves the container on.
            if first and thread == width - 1:
                container(w, step + 1, batch, moving[(step + 1) % 2])
                if TEAMS:
                    for c in range(8):
                        batch.slots.numbers[w, MOVING + c] = moving[(step + 1) % 2, c]
            due = drift(w, step, moving[step % 2], own, every, batch)
            step += 1
            done += 1
        due = any_due(step, due, batch.slots.counts[here[0]], team)
        if TEAMS:
            if thread == 0:
                for c in range(8):
                    moving[step % 2, c] = batch.slots.numbers[here[0], MOVING + c]
            cuda.syncthreads()
        if due:
            if first:
                renew(here[0], step, buffer, thread, width, batch)
            meet(batch.slots.counts[here[0]], team)
            status = batch.slots.counts[here[0], STATUS]
            if status != 0:
                if stage == RUNNING:
                    stage = HALTED
                break
        w = here[0]
        now = moving[step % 2]
        pair_forces(w, step, own, every, batch)
        wall_forces(w, step, now, own, every, batch)
        if own == 0:
            speeds(w, now, own, batch)
        meet(batch.slots.counts[here[0]], team)
        writes = step >= n_settle and ((step - n_settle) % per_row == 0 or step == end)
        if writes or stage == NEW or step == n_settle or done == limit:
            if first:
                occasion(here[0], step, stage, now, writes, buffer, thread, width, batch)
            meet(batch.slots.counts[here[0]], team)
            if batch.slots.counts[here[0], ENOUGH] != 0:
                limit = done
        stage = RUNNING
    if own == 0:
        w = here[0]
        batch.slots.counts[w, STAGE], batch.slots.counts[w, STEP] = stage, step
        for c in range(8):
            batch.slots.numbers[w, MOVING + c] = moving[step % 2, c]


def clear(batch, w):
    """Make slot w ready for a new world: nothing touches, all sums are zero."""
    thread, width = cuda.threadIdx.x, cuda.blockDim.x
    bed, pairs, touches, slots = batch.bed, batch.pairs, batch.touches, batch.slots
    for i in range(thread, bed.radius.shape[1] + 1, width):
        for side in range(2):
            pairs.start[w, side, i] = touches.start[w, side, i] = 0
        pairs.back_start[w, i] = pairs.inner_start[w, i] = pairs.inner_back_start[w, i] = 0
    for p in range(thread, pairs.stamp.shape[1], width):
        pairs.stamp[w, p] = pairs.touched[w, 0, p] = pairs.touched[w, 1, p] = FREE
    for t in range(thread, touches.stamp.shape[1], width):
        touches.stamp[w, t] = touches.touched[w, 0, t] = touches.touched[w, 1, t] = FREE
    for t in range(thread, slots.sums.shape[2], width):
        for k in range(N_SUM):
            slots.sums[w, k, t] = 0.0
        slots.sums[w, WAY_OUTER, t] = BEYOND
    for k in range(thread, slots.impact.shape[2], width):
        slots.impact[w, 0, k] = slots.impact[w, 1, k] = 0
    for r in range(thread, slots.rows.shape[1], width):
        for k in range(N_ROW):
            slots.rows[w, r, k] = 0.0


class Kernels(NamedTuple):
    """What is launched, compiled when it is first needed."""

    advance: Any
    clear: Any


@cache
def kernels_of(variant: Variant) -> Kernels:
    """The kernels of a variant; compilation takes a minute, so they are kept for the process."""
    builder = Builder(variant)
    return Kernels(builder.kernel(advance), builder.kernel(clear))
