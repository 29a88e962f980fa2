"""Single contacts on the GPU against the processor: a ball and a wall, two balls, sliding and rolling with friction."""

import math
from typing import Any, NamedTuple

import numpy as np

from graindamp.dem.packing_store import Packing
from graindamp.dem.run import BedState
from graindamp.dem.simulate import simulate
from graindamp.spec.model import parse_spec
from graindamp.spec.simulation import SimulationSpec

SIDE, RADIUS = 0.01, 1e-3
"""Of the box and of the balls [m]."""
GAP = 2e-5
"""Between bodies before they meet [m]."""
TOLERANCE = {"double": 1e-9, "mixed": 1e-5}
"""Largest difference from the processor's velocities and spins over the largest of them [-]. One contact of some 40
steps magnifies rounding, 1e-16 and 6e-8, by less than a hundred."""


class Contact(NamedTuple):
    """One impact: the balls of a bed, and how they move when it begins."""

    name: str
    spec: SimulationSpec
    position: list[list[float]]
    """[m]"""
    velocity: list[list[float]]
    """[m/s]"""
    spin: list[list[float]]
    """[rad/s]"""


def balls(position: list[list[float]]) -> Packing:
    """A bed of balls of one size."""
    n, nan = len(position), math.nan
    return Packing(
        np.array(position), np.full(n, RADIUS), np.zeros(n, np.int32), nan, nan, nan, nan, None, None, 0, 0.0
    )


def box(count: int, frequency: float, intensity: float, **contact: Any) -> SimulationSpec:
    """A box of steel that is shaken for one cycle, without gravity."""
    told = {
        "damper": {
            "gravity": [0.0, 0.0, 0.0],
            "particles": [{"material": "steel", "radius": RADIUS}],
            "fill": {"count": count},
            "container": {"kind": "box", "size": [SIDE, SIDE, SIDE], "material": "steel"},
            "contact": {"friction": 0.0, "softening": 1e4, **contact},
        },
        "motion": {"kind": "harmonic", "frequency": frequency, "intensity": intensity, "direction": "x"},
        "run": {"cycles": 1, "settle": 1e-5},
    }
    return parse_spec(told, SimulationSpec, "contact")


def contacts(springs: bool) -> list[Contact]:
    """Impacts; `springs`: with Mindlin's spring and rolling resistance, which another variant of the kernel is for."""
    law = {"tangential": "mindlin", "rolling_friction": 0.02} if springs else {"tangential": "tanh"}
    rough: dict[str, Any] = {"friction": 0.2, **law}
    # A container that hardly moves, for one long cycle: the speeds are those that the balls begin with.
    middle, touch = 0.5 * SIDE, RADIUS + GAP
    wall = [[touch, middle, middle]]
    pair = [[middle - touch, middle, middle], [middle + touch, middle, middle]]
    aside = [[middle - touch, middle, middle], [middle + touch, middle + 0.4 * RADIUS, middle]]
    still = [[0.0] * 3]
    found = []
    for e in (0.3, 0.6, 0.9):
        name = f"ball and wall, restitution {e}"
        found.append(Contact(name, box(1, 500.0, 1e-3, restitution=e, **rough | {"friction": 0.0}), wall,
                             [[-0.1, 0.0, 0.0]], still))  # fmt: skip
    smooth = box(2, 500.0, 1e-3, restitution=0.6, **rough | {"friction": 0.0})
    found.append(Contact("two balls, head on", smooth, pair, [[0.1, 0.0, 0.0], [-0.1, 0.0, 0.0]], still * 2))
    spec = box(1, 500.0, 1e-3, restitution=0.6, **rough)
    found.append(Contact("ball slides along a wall", spec, wall, [[-0.1, 0.15, 0.05]], still))
    found.append(Contact("spinning ball on a wall", spec, wall, [[-0.1, 0.02, 0.0]], [[30.0, -40.0, 60.0]]))
    spec = box(2, 500.0, 1e-3, restitution=0.6, **rough)
    spins = [[20.0, -10.0, 50.0], [0.0, 30.0, 40.0]]
    found.append(Contact("two balls, aside, with spin", spec, aside, [[0.15, 0.02, 0.0], [-0.15, 0.0, 0.03]], spins))
    return found


def start_of(contact: Contact) -> BedState:
    """How the bed begins, in units of the container's speed."""
    motion: Any = contact.spec.motion
    speed = motion.acceleration_amplitude(motion.frequency) / (2.0 * math.pi * motion.frequency)
    return BedState(
        np.array(contact.position), np.array(contact.velocity) / speed, np.array(contact.spin) * RADIUS / speed
    )


def worst_of(precision: str, springs: bool) -> dict[str, dict[str, float]]:
    """For every contact: the largest difference from the processor's velocities and spins after it, over the largest of
    them, and the largest change of velocity [m/s], which says that there was an impact."""
    from graindamp.dem.gpu.batch import Task, simulate_batch

    made = contacts(springs)
    tasks = [Task(one.spec, balls(one.position), start_of(one)) for one in made]
    found = {}
    for number, run in simulate_batch(tasks, precision=precision):
        cpu = simulate(tasks[number].spec, packing=tasks[number].packing, start=tasks[number].start)
        first = tasks[number].start
        assert cpu.end is not None
        assert run.end is not None
        assert first is not None
        off = [
            float(np.abs(own - other).max() / max(np.abs(other).max(), np.abs(begin).max()))
            for own, other, begin in (
                (run.end.velocity, cpu.end.velocity, first.velocity),
                (run.end.spin, cpu.end.spin, first.velocity),
            )
        ]
        change = np.abs(run.end.velocity - first.velocity).max() * np.abs(made[number].velocity).max()
        found[made[number].name] = {"off": max(off), "change": float(change / np.abs(first.velocity).max())}
    return found
