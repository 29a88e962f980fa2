"""Several cavities whose balls are tuned to different amplitudes of one range, judged by event-driven free decays."""

from collections.abc import Sequence
from math import isfinite, pi
from typing import NamedTuple

import numpy as np

from graindamp.errors import InputError
from graindamp.impact.decay import free_decay
from graindamp.impact.system import Ball, on_structure
from graindamp.structure.modal import ModalModel

START_SPREAD = (1.0, 0.93, 0.86)
"""Start amplitudes over the upper end of the range, over which a decay is averaged: single decays are erratic."""


class TunedCavities(NamedTuple):
    """Clearances of several cavities for a range of amplitudes, and what they achieve."""

    clearances: tuple[float, ...]
    """Free travel of each ball [m], ascending."""
    decay_cycles: float
    """Cycles of the mode from the upper to the lower end of the range [-], mean over starts."""
    equal_clearance: float
    """Best clearance if all cavities have the same [m]."""
    equal_decay_cycles: float
    """Cycles with it [-]."""
    n_decay: int
    """Decays simulated."""


def decay_cycles(
    model: ModalModel, balls: Sequence[Ball], high: float, low: float, cycles_max: float = 2000.0
) -> float:
    """Cycles of the first mode in which free vibration falls from one amplitude to another [-], mean over starts.

    Ended when two displacement peaks in a row lie below `low`. Where a decay has not ended after `cycles_max`, the
    cycles left are estimated from its mean rate.

    Args:
        model: modes of the structure; the first is released.
        balls: the balls.
        high: upper displacement amplitude of the first ball's cavity [m].
        low: lower displacement amplitude [m], > 0 and below 0.86 of `high`.
        cycles_max: cycles to follow at most.

    Raises:
        InputError: an argument outside its range.
    """
    _check_range(high, low)
    system = on_structure(model, balls)
    period = 2.0 * pi / float(model.omega[0])
    counts = []
    for share in START_SPREAD:
        run = free_decay(system, share * high, until_below=low, cycles_max=cycles_max)
        count = run.end.time / period
        if not run.ended_small:
            reached = float(np.abs(run.peaks[-4:, 1]).max())
            count *= np.log(share * high / low) / max(np.log(share * high / reached), 1e-3)
        counts.append(count)
    return float(np.mean(counts))


def tune_cavities(
    model: ModalModel, ball: Ball, count: int, high: float, low: float, *, n_grid: int = 7, rounds: int = 2
) -> TunedCavities:
    """Clearances of several cavities with equal balls that let free vibration decay fastest over a range of amplitudes.

    A grid of equal clearances, one of geometric series of clearances between pi `low` / 2 and 2 pi `high`, and from the
    better of the two a search one clearance at a time, each decay by the event-driven solver. Decays are erratic in the
    clearances, so that the result is a good choice rather than the optimum.

    Args:
        model: modes of the structure; the first is released.
        ball: mass, restitution and point of every ball; its clearance plays no part.
        count: number of cavities, 1 to 12.
        high: upper displacement amplitude of the cavity [m].
        low: lower displacement amplitude [m], > 0 and below 0.86 of `high`.
        n_grid: clearances tried along each axis of the grid, >= 3.
        rounds: rounds of the search one clearance at a time, >= 0.

    Raises:
        InputError: an argument outside its range.

    Source: Witt (2011), chapter 5, proposes cavities tuned to different amplitudes; the search is graindamp's.
    """
    _check_range(high, low)
    if not (1 <= count <= 12 and n_grid >= 3 and rounds >= 0):
        raise InputError(f"count, n_grid, rounds are {count}, {n_grid}, {rounds}; allowed: 1 to 12, >= 3, >= 0")
    known: dict[tuple[float, ...], float] = {}

    def cycles(clearances: Sequence[float]) -> float:
        key = tuple(sorted(float(value) for value in clearances))
        if key not in known:
            known[key] = decay_cycles(model, [ball._replace(clearance=value) for value in key], high, low)
        return known[key]

    grid: list[float] = np.geomspace(pi * low / 2.0, 2.0 * pi * high, n_grid).tolist()
    equal = min(grid, key=lambda value: cycles([value] * count))
    candidates = [np.geomspace(small, large, count).tolist() for small in grid for large in grid if small <= large]
    best: list[float] = min(candidates if count > 1 else [[equal]], key=cycles)
    step = (grid[1] / grid[0]) ** 0.5
    for _ in range(rounds):
        for place in range(count):
            trials = [[*best[:place], best[place] * factor, *best[place + 1 :]] for factor in (1.0, step, 1.0 / step)]
            best = min(trials, key=cycles)
        equal = min((equal, equal * step, equal / step), key=lambda value: cycles([value] * count))
        step **= 0.5
    best = min((best, [equal] * count), key=cycles)
    together, alone = cycles(best), cycles([equal] * count)
    return TunedCavities(
        tuple(sorted(float(value) for value in best)), together, float(equal), alone, len(known) * len(START_SPREAD)
    )


def _check_range(high: float, low: float) -> None:
    if not (isfinite(high) and 0 < low < START_SPREAD[-1] * high):
        raise InputError(f"low and high are {low} m and {high} m; allowed: 0 < low < {START_SPREAD[-1]} high, finite")
