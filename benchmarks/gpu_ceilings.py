"""The two ceilings of docs/gpu.md: what a card's memory and arithmetic allow at most, in particle-steps per second."""

from typing import Any, NamedTuple

BYTES = 364.0
"""Bytes that one particle needs in a step, mixed precision; derived in docs/gpu.md."""
DOUBLE_OPERATIONS, SINGLE_OPERATIONS = 50.0, 120.0
"""Operations of one particle in a step, by precision; likewise."""

LANES = {
    (7, 0): (64, 32),
    (8, 0): (64, 32),
    (8, 6): (128, 2),
    (8, 9): (128, 2),
    (9, 0): (128, 64),
    (10, 0): (128, 64),
    (12, 0): (128, 2),
}
"""Single and double operations that a multiprocessor begins in a clock, by compute capability: CUDA C++ Programming
Guide, table of arithmetic throughput."""


class Card(NamedTuple):
    """What a card can do at most."""

    bandwidth: float
    """Of its memory [bytes/s]."""
    single: float
    """Operations in single precision, multiply-add counted as two [1/s]."""
    double: float
    """Likewise in double precision."""
    source: str
    """Where the numbers come from."""


DATASHEETS = {
    "H200 NVL": Card(4.8e12, 60e12, 30e12, "datasheet of the H200 NVL"),
    "H200": Card(4.8e12, 67e12, 34e12, "datasheet of the H200 SXM"),
}
"""Cards by a part of their name, for drivers that do not tell clocks."""


def card_of(device: Any, name: str) -> Card | None:
    """Numbers of a card as CUDA tells them, else from its datasheet; None if neither knows it.

    Args:
        device: of numba.cuda; None: there is none.
        name: what CUDA calls the card.
    """
    try:
        memory, width = 1e3 * device.MEMORY_CLOCK_RATE, device.GLOBAL_MEMORY_BUS_WIDTH / 8.0
        clock, single_lanes, double_lanes = 1e3 * device.CLOCK_RATE, *LANES[tuple(device.compute_capability)]
        rate = 2.0 * device.MULTIPROCESSOR_COUNT * clock
        told = Card(2.0 * memory * width, rate * single_lanes, rate * double_lanes, "CUDA: clocks, bus, lanes")
        if min(told[:3]) > 0.0:
            return told
    except Exception:  # attributes that a driver or a version of numba-cuda does not have end in errors of many types
        pass
    return next((card for key, card in DATASHEETS.items() if key in name), None)


def ceilings(card: Card) -> dict[str, float]:
    """Particle-steps per second that memory and arithmetic allow, each for itself."""
    return {
        "bytes": card.bandwidth / BYTES,
        "operations": 1.0 / (DOUBLE_OPERATIONS / card.double + SINGLE_OPERATIONS / card.single),
    }
