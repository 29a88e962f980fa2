"""The time step: a stated number of steps in the shortest contact that the run can see."""

import math
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from graindamp.dem.columns import RULE, STIFFNESS
from graindamp.dem.interactions import Interactions
from graindamp.dem.laws import NormalLaw
from graindamp.dem.motion import MotionKind
from graindamp.dem.restitution import contact_time_hertz, contact_time_linear
from graindamp.dem.state import Motion

Real = NDArray[np.float64]


class Contact(NamedTuple):
    """One kind of contact: stiffness k of F = k overlap^power, and reduced mass [kg]."""

    stiffness: float
    mass: float
    power: float


def contacts_between(
    interactions: Interactions, a: int, b: int, first: Iterable[float], second: Iterable[float]
) -> list[Contact]:
    """Contacts of particle material a with material b, of every radius in `first` [m] with every one in `second` [m].

    A wall has no radius: where b belongs to walls, `second` is not used.
    """
    wall = b >= interactions.n_particle_material
    found = []
    for radius in first:
        for other in (radius,) if wall else second:
            mass = interactions.density[a] * 4.0 / 3.0 * math.pi * radius**3
            curvature = radius
            if not wall:
                partner = interactions.density[b] * 4.0 / 3.0 * math.pi * other**3
                mass, curvature = mass * partner / (mass + partner), radius * other / (radius + other)
            row, back = interactions.pair[a, b], interactions.pair[b, a]
            if interactions.normal != NormalLaw.LINEAR:
                found.append(Contact(row[STIFFNESS] * math.sqrt(curvature), mass, 1.5))
            elif row[RULE] > 0.5:
                series = 1.0 / (1.0 / (row[STIFFNESS] * radius) + 1.0 / (back[STIFFNESS] * other))
                found.append(Contact(series, mass, 1.0))
            else:
                found.append(Contact(row[STIFFNESS], mass, 1.0))
    return found


def shortest_contact(interactions: Interactions, radius: Real, material: NDArray[np.int32], speed: float) -> float:
    """Duration of the shortest undamped contact at impact speed `speed` [m/s], in [s].

    The smallest particle of each material against the smallest of every other, and against every wall. A Hertz
    contact lasts 2.94 overlaps over speed and so gets shorter with speed to the power 1/5; a linear one does not
    depend on it.
    """
    smallest = {int(a): float(radius[material == a].min()) for a in np.unique(material)}
    walls = range(interactions.n_particle_material, len(interactions.names))
    return min(
        float(
            contact_time_linear(contact.stiffness, contact.mass)
            if contact.power == 1.0
            else contact_time_hertz(contact.stiffness, contact.mass, speed)
        )
        for a, r in smallest.items()
        for b in (*smallest, *walls)
        for contact in contacts_between(interactions, a, b, (r,), (smallest.get(b, r),))
    )


def expected_speed(motion: Motion, gravity: float, radius: float) -> float:
    """Impact speed that a run is prepared for [m/s].

    A particle that keeps the container's greatest velocity may meet a wall that comes at it with the same: twice the
    greatest velocity of the container, and the speed of a fall of two diameters. What the run really saw is reported
    after it."""
    wave = motion.wave[0]
    greatest = 0.0
    if motion.kind[0] == MotionKind.HARMONICS:
        greatest = float(np.sum(wave[:, 0] * np.linalg.norm(wave[:, 2:], axis=1)))
    elif motion.kind[0] == MotionKind.SWEEP:
        greatest = float(max(wave[0, 2] / omega ** wave[1, 2] * omega for omega in wave[:, 0]))
    elif motion.kind[0] == MotionKind.SERIES:
        greatest = float(np.abs(motion.series[0, :, 1]).max())
    return 2.0 * greatest + math.sqrt(8.0 * gravity * radius) + 0.02
