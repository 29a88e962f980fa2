"""What the threads of a block do together: sums, extremes and running sums in a fixed order.

`buffer` is shared memory of one double per thread. All threads of the block must call these together."""

from numba import cuda

from graindamp.dem.gpu.columns import DUE, MEETINGS
from graindamp.dem.gpu.device import TEAMS


def total(value, buffer, thread, width):
    """Sum of `value` over the threads, in the same order every time."""
    buffer[thread] = value
    cuda.syncthreads()
    half = width // 2
    while half > 0:
        if thread < half:
            buffer[thread] += buffer[thread + half]
        cuda.syncthreads()
        half //= 2
    result = buffer[0]
    cuda.syncthreads()
    return result


def largest(value, buffer, thread, width):
    """Largest `value` of all threads."""
    buffer[thread] = value
    cuda.syncthreads()
    half = width // 2
    while half > 0:
        if thread < half:
            buffer[thread] = max(buffer[thread], buffer[thread + half])
        cuda.syncthreads()
        half //= 2
    result = buffer[0]
    cuda.syncthreads()
    return result


def running(counts, n, buffer, thread, width):
    """Replace the first `n` of `counts` by the sums of those before them, and number n by the sum of all, which is
    returned."""
    cuda.syncthreads()
    share = (n + width - 1) // width
    low, high = min(thread * share, n), min(thread * share + share, n)
    own = 0
    for k in range(low, high):
        own += counts[k]
    buffer[thread] = own
    cuda.syncthreads()
    stride = 1
    while stride < width:
        other = 0.0
        if thread >= stride:
            other = buffer[thread - stride]
        cuda.syncthreads()
        buffer[thread] += other
        cuda.syncthreads()
        stride *= 2
    before = int(buffer[thread]) - own
    whole = int(buffer[width - 1])
    for k in range(low, high):
        count = counts[k]
        counts[k] = before
        before += count
    if thread == 0:
        counts[n] = whole
    cuda.syncthreads()
    return whole


def sum_of(row, thread, width):
    """The thread's share of the sum of a row of numbers, one of every thread of the team."""
    value = 0.0
    for k in range(thread, row.shape[0], width):
        value += row[k]
    return value


def most_of(row, thread, width):
    """The thread's share of the largest of a row of numbers that are not negative."""
    value = 0.0
    for k in range(thread, row.shape[0], width):
        value = max(value, row[k])
    return value


def meet(counts, team):
    """Wait until all `team` blocks of the world have come here, and see what they wrote. All must be running."""
    cuda.syncthreads()
    if TEAMS:
        if cuda.threadIdx.x == 0:
            cuda.threadfence()
            arrived = cuda.atomic.add(counts, MEETINGS, 1)
            wanted = (arrived // team + 1) * team
            while cuda.atomic.add(counts, MEETINGS, 0) < wanted:
                pass
            cuda.threadfence()
        cuda.syncthreads()


def any_due(step, due, counts, team):
    """1 if `due` holds for any thread of the team, else 0; a meeting."""
    if TEAMS:
        if due:
            counts[DUE] = step
        meet(counts, team)
        return 1 if counts[DUE] == step else 0
    return cuda.syncthreads_or(due)
