"""What the threads of a block do together: sums, extremes and running sums in a fixed order.

`buffer` is shared memory of one double per thread. All threads of the block must call these together."""

from numba import cuda


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
