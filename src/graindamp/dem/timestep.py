"""The time step: a stated number of steps in the shortest contact that the run can see."""

import math

import numpy as np
from numpy.typing import NDArray

from graindamp.dem.columns import RULE, STIFFNESS
from graindamp.dem.interactions import Interactions
from graindamp.dem.laws import NormalLaw
from graindamp.dem.restitution import contact_time_hertz, contact_time_linear
from graindamp.dem.state import Motion

Real = NDArray[np.float64]


def shortest_contact(interactions: Interactions, radius: Real, material: NDArray[np.int32], speed: float) -> float:
    """Duration of the shortest undamped contact at impact speed `speed` [m/s], in [s].

    The smallest particle of each material against the smallest of every other, and against every wall. A Hertz
    contact lasts 2.94 overlaps over speed and so gets shorter with speed to the power 1/5; a linear one does not
    depend on it."""
    smallest = {int(a): float(radius[material == a].min()) for a in np.unique(material)}
    shortest = math.inf
    for a, r in smallest.items():
        mass = interactions.density[a] * 4.0 / 3.0 * math.pi * r**3
        for b in range(len(interactions.names)):
            if b < interactions.n_particle_material:
                if b not in smallest:
                    continue
                other = smallest[b]
                other_mass = interactions.density[b] * 4.0 / 3.0 * math.pi * other**3
                reduced, curvature = mass * other_mass / (mass + other_mass), r * other / (r + other)
            else:
                other, reduced, curvature = r, mass, r
            factor = interactions.pair[a, b, STIFFNESS]
            if factor <= 0.0:
                continue
            if interactions.normal == NormalLaw.LINEAR:
                stiffness = factor
                if interactions.pair[a, b, RULE] > 0.5:
                    stiffness = 1.0 / (1.0 / (factor * r) + 1.0 / (interactions.pair[b, a, STIFFNESS] * other))
                shortest = min(shortest, float(contact_time_linear(stiffness, reduced)))
            else:
                shortest = min(shortest, float(contact_time_hertz(factor * math.sqrt(curvature), reduced, speed)))
    return shortest


def expected_speed(motion: Motion, gravity: float, radius: float) -> float:
    """Impact speed that a run is prepared for [m/s].

    A particle that keeps the container's greatest velocity may meet a wall that comes at it with the same: twice the
    greatest velocity of the container, and the speed of a fall of two diameters. What the run really saw is reported
    after it."""
    wave = motion.wave[0]
    greatest = 0.0
    if motion.kind[0] == 1:
        greatest = float(np.sum(wave[:, 0] * np.linalg.norm(wave[:, 2:], axis=1)))
    elif motion.kind[0] == 2:
        greatest = float(max(wave[0, 2] / omega ** wave[1, 2] * omega for omega in wave[:, 0]))
    elif motion.kind[0] == 3:
        greatest = float(np.abs(motion.series[0, :, 1]).max())
    return 2.0 * greatest + math.sqrt(8.0 * gravity * radius) + 0.02
