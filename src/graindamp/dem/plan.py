"""When a run writes down what: whole steps in a sample, whole samples in a cycle."""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from graindamp.dem.motion import INTERVAL
from graindamp.dem.state import Motion
from graindamp.spec.motion import SeriesMotion
from graindamp.spec.simulation import SimulationSpec

ENERGIES_PER_CYCLE = 20
"""Samples of the energies per cycle [-]."""

CHUNKS = 500
"""Pieces of a run without cycles, between which it can be interrupted [-]."""


class Plan(NamedTuple):
    """Time step, numbers of steps, and the steps at which something is written down, from the start of the motion."""

    time_step: float
    """[s]"""
    n_settle: int
    """Steps at rest before the motion [-]."""
    n_step: int
    """Steps of the motion [-]."""
    stride: int
    """Steps per sample of the recorded forces [-]."""
    n_cycle: int
    """Cycles begun, 1 for motions without cycles [-]."""
    per_cycle: int
    """Steps per cycle, 0 for motions without cycles [-]."""
    energy: frozenset[int]
    """Steps at which energies are written down."""
    snapshot: frozenset[int]
    """Steps at which all particles are written down."""
    field: frozenset[int]
    """Steps at which velocities are added to the velocity field."""

    @property
    def stops(self) -> list[int]:
        """All those steps in order, and the last one."""
        return sorted(self.energy | self.snapshot | self.field | {self.n_step})


def plan_of(spec: SimulationSpec, motion: Motion, time_step: float) -> Plan:
    """Plan of a run with steps of at most `time_step` [s]."""
    duration = spec.duration
    if duration is None:
        assert isinstance(spec.motion, SeriesMotion)
        duration = float(motion.timing[0, INTERVAL] * (motion.series.shape[1] - 1))
    frequency = spec.base_frequency
    if frequency is not None:
        # Whole samples in a cycle and whole steps in a sample keep every cycle alike.
        samples = max(round(spec.sample_rate / frequency), 1)
        stride = max(math.ceil(1.0 / frequency / samples / time_step - 1e-9), 1)
        per_cycle = samples * stride
        time_step = 1.0 / frequency / per_cycle
        n_step = max(round(duration / time_step), 1)
        n_cycle = math.ceil(n_step / per_cycle - 1e-9)
        energy = _at(np.arange(1, n_cycle * ENERGIES_PER_CYCLE + 1) / ENERGIES_PER_CYCLE, per_cycle, n_step)
        snapshots = spec.run.snapshots_per_cycle
        snapshot = _at(np.arange(n_cycle * snapshots) / max(snapshots, 1), per_cycle, n_step)
        field: frozenset[int] = frozenset()
        if spec.run.velocity_field is not None:
            turn = spec.run.velocity_field.phase / (2.0 * math.pi) % 1.0
            field = _at(np.arange(n_cycle) + turn, per_cycle, n_step)
    else:
        stride = max(math.ceil(1.0 / spec.sample_rate / time_step - 1e-9), 1)
        time_step = 1.0 / spec.sample_rate / stride
        n_step = max(round(duration / time_step), 1)
        n_cycle, per_cycle = 1, 0
        energy = _at(np.arange(1, CHUNKS + 1) / CHUNKS, n_step, n_step)
        snapshot = field = frozenset()
    n_settle = math.ceil((spec.run.settle or 0.0) / time_step)
    return Plan(time_step, n_settle, n_step, stride, n_cycle, per_cycle, energy, snapshot, field)


def _at(place: NDArray[np.floating[Any]], per_unit: int, n_step: int) -> frozenset[int]:
    """Steps of places given in units of `per_unit` steps, those within the run."""
    return frozenset(int(step) for step in np.rint(place * per_unit) if 0 < step <= n_step)
