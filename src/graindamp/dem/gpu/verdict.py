"""When a world is known well enough: the rule of :mod:`graindamp.signals.stopping` as loops of one thread, with its
constants, in double precision.

What a cycle gave and the room to work in are rows of Slots.series; nothing is allocated."""

from math import ceil, nan, sqrt

from graindamp.dem.gpu.columns import (
    ENOUGH,
    ETA,
    FLOOR,
    FORCE_COS,
    FORCE_SIN,
    NEXT_LOOK,
    PAIRS,
    PER_ROW,
    RATIO,
    REST,
    ROW,
    ROW_STEPS,
    SPEED_COS,
    SPEED_SIN,
    TOLERANCE,
    UNTIL,
    UNTIL_CYCLE,
    WHOLE_MASS,
)
from graindamp.dem.gpu.device import stay_apart
from graindamp.signals.stopping import (
    BATCHES,
    DRIFT_ERRORS,
    DRIFT_SHARE,
    GROWTH,
    LEAST_CYCLES,
    LONGEST_TRANSIENT,
)


def judge(counts, codes, numbers, rows, series, omega):
    """Note the cycle whose row was written last, and whether the world may end with it.

    Args:
        counts, codes, numbers, rows, series: of the world's slot.
        omega: angular frequency of its cycles [rad/s].
    """
    stay_apart()
    n = counts[ROW] - 1  # the first row is the start of the motion
    if n < 1 or rows[n, ROW_STEPS] != codes[PER_ROW]:
        return
    series[ETA, n - 1], series[RATIO, n - 1] = ratios(rows[n], omega * numbers[WHOLE_MASS])
    if codes[UNTIL] == UNTIL_CYCLE:
        if n >= LEAST_CYCLES:
            counts[ENOUGH] = 1
    elif n >= counts[NEXT_LOOK]:
        counts[NEXT_LOOK] = ceil(GROWTH * n)
        if met(series, n, numbers[TOLERANCE], numbers[FLOOR]):
            counts[ENOUGH] = 1


def ratios(row, scale):
    """Loss factor eta and effective mass ratio m' of a cycle [-]: M = F / (i Omega V) = m_bed (m' - i eta), as in
    :func:`graindamp.signals.simulated.ratios_of`. No numbers where the container has no speed at this frequency.

    Args:
        row: sums of the cycle, a row of Slots.rows.
        scale: angular frequency times mass of the bed [kg rad/s].
    """
    speed_cos, speed_sin = row[SPEED_COS], row[SPEED_SIN]
    square = scale * (speed_cos * speed_cos + speed_sin * speed_sin)
    if square == 0.0:
        return nan, nan
    eta = -(row[FORCE_COS] * speed_cos + row[FORCE_SIN] * speed_sin) / square
    return eta, (row[FORCE_SIN] * speed_cos - row[FORCE_COS] * speed_sin) / square


def met(series, n, tolerance, floor):
    """Whether the first `n` cycles are steady after their transient and known as well as asked."""
    skipped = transient_length(series, n)
    eta, ratio = series[ETA][skipped:n], series[RATIO][skipped:n]
    size = max(abs(mean(eta)), floor)
    allowed = tolerance * size
    if not (standard_error(eta, series[PAIRS]) <= allowed and standard_error(ratio, series[PAIRS]) <= allowed):
        return False
    scale = DRIFT_SHARE * size
    return not (drifts(eta, scale, series) or drifts(ratio, scale, series))


def transient_length(series, n):
    """Cycles to drop at the start of `n`, like :func:`graindamp.signals.steady.transient_length` of m' + i eta."""
    one, other = series[PAIRS], series[REST]
    m = paired(series[ETA][:n], one)
    paired(series[RATIO][:n], other)
    longest = min(int(n * LONGEST_TRANSIENT + 1e-9), n - LEAST_CYCLES) // 2
    best, least = 0, 0.0
    for drop in range(max(longest, 0) + 1):
        left = m - drop
        statistic = (squares(one[drop:m]) + squares(other[drop:m])) / left / left
        if drop == 0 or statistic < least:
            best, least = drop, statistic
    return 2 * best + n % 2 if best > 0 else 0


def standard_error(value, pairs):
    """Standard error of the mean, like :func:`graindamp.signals.stopping.standard_error`; works in `pairs`."""
    n = value.shape[0]
    own = value
    if n >= LEAST_CYCLES:
        own = pairs[: paired(value, pairs)]
    m = own.shape[0]
    time = correlation_time(own)
    variance = squares(own) / (m - 1) / m * time / max(1.0 - time / m, 0.25)
    if n >= 2 * BATCHES:
        length = n // BATCHES
        first = n - BATCHES * length
        for b in range(BATCHES):
            pairs[b] = mean(value[first + b * length : first + (b + 1) * length])
        variance = max(variance, squares(pairs[:BATCHES]) / (BATCHES - 1) / BATCHES)
    return sqrt(variance)


def correlation_time(value):
    """Integrated autocorrelation time, like :func:`graindamp.signals.steady.correlation_time`."""
    n = value.shape[0]
    variance = squares(value)
    if n < 4 or variance == 0.0:
        return 1.0
    centre, total = mean(value), 1.0
    for lag in range(1, n // 2):
        product = 0.0
        for k in range(n - lag):
            product += (value[k] - centre) * (value[k + lag] - centre)
        correlation = product / variance + 1.0 / n
        if correlation <= 0.0:
            break
        total += 2.0 * (1.0 - lag / n) * correlation
    return total


def drifts(value, scale, series):
    """Whether the halves differ by more than `scale` and by more than chance, as the rule of the processor finds it."""
    n = value.shape[0]
    half = n // 2
    if half < 2:
        return False
    change = abs(mean(value[n - half :]) - mean(value[:half]))
    if not change > scale:
        return False
    along, square, rest = 0.0, 0.0, series[REST]
    for k in range(n):
        place = k - 0.5 * (n - 1)
        along += place * value[k]
        square += place * place
    for k in range(n):
        rest[k] = value[k] - (k - 0.5 * (n - 1)) * (along / square)
    first = standard_error(rest[:half], series[PAIRS])
    second = standard_error(rest[n - half : n], series[PAIRS])
    return change > DRIFT_ERRORS * sqrt(first * first + second * second)


def paired(value, pairs):
    """Write means of neighbouring values to `pairs`, of an odd number without the first; gives how many."""
    odd, m = value.shape[0] % 2, value.shape[0] // 2
    for k in range(m):
        pairs[k] = 0.5 * (value[odd + 2 * k] + value[odd + 2 * k + 1])
    return m


def mean(value):
    """Mean."""
    total = 0.0
    for k in range(value.shape[0]):
        total += value[k]
    return total / value.shape[0]


def squares(value):
    """Sum of the squares of the differences from the mean."""
    centre, total = mean(value), 0.0
    for k in range(value.shape[0]):
        off = value[k] - centre
        total += off * off
    return total
