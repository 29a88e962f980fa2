"""What a contact finds out when it begins, and keeps until it ends.

Stiffness with the radii in it, reduced mass, friction, and the damping constants that belong to the speed of the
impact. A contact that is hit again while it lasts takes the greater speed, because damping set for a slow onset would
grow without bound under a fast one. Restitution may depend on speed for every law: the constants come from a table
over speed."""

from math import log2, sqrt

import numpy as np

from graindamp.dem.columns import (
    DAMPING,
    FRICTION,
    GRIP_FRICTION,
    GRIP_STIFFNESS,
    GRIP_TANGENTIAL,
    LEAST,
    LOWEST_SPEED,
    MASS,
    N_NODE,
    N_SPEED_BIN,
    ONSET,
    RULE,
    SHEAR,
    SMOOTHING,
    SPEED_SCALE,
    STIFFNESS,
)
from graindamp.dem.compile import inner
from graindamp.dem.laws import NormalLaw, TangentialLaw

OF_PARTICLES, OF_WALLS = np.bool_(False), np.bool_(True)
"""What the second bodies of a list are. Not plain False and True, for each of which numba would compile every function
that is given one apart."""

SLOWEST = 1e-5
"""Least speed at onset that damping is set for [m/s]; slower contacts, such as those of a settling bed, lose little
either way, and d / (e onset) must stay finite."""


@inner
def begin(w, i, j, wall, particles, material, rules, rate, grip):
    """Fill `grip` for a contact of particle i that begins at approach speed `rate`.

    The second body j is a particle, or, with `wall`, an element. `material` is that of the second bodies.
    """
    radius, mass = 0.0, 0.0
    if not wall:
        radius, mass = particles.position[w, j, 3], 1.0 / particles.inverse_mass[w, j, 0]
    begin_between(
        particles.material[w, i],
        material[j],
        particles.position[w, i, 3],
        radius,
        1.0 / particles.inverse_mass[w, i, 0],
        mass,
        rules.normal[w],
        rules.tangential[w],
        rules.pair[w],
        rules.loss[w],
        rate,
        grip,
    )


@inner
def renew(a, b, w, rules, rate, grip):
    """Set the damping constants in `grip` for materials a and b and the approach speed `rate` [m/s]."""
    renew_between(a, b, rules.normal[w], rules.pair[w], rules.loss[w], rate, grip)


@inner
def begin_between(a, b, radius_a, radius_b, mass_a, mass_b, law, tangential, pair, loss, rate, grip):
    """Fill `grip` for a contact of materials a and b that begins at approach speed `rate`.

    A wall has no radius and no mass of its own: give `radius_b` <= 0, and R* = radius_a, m* = mass_a.
    """
    wall = radius_b <= 0.0
    radius = radius_a if wall else radius_a * radius_b / (radius_a + radius_b)
    mass = mass_a if wall else mass_a * mass_b / (mass_a + mass_b)
    if law == NormalLaw.LINEAR:
        stiffness = pair[a, b, STIFFNESS]
        shear = stiffness * pair[a, b, SHEAR]
        if pair[a, b, RULE] > 0.5:
            other = radius_a if wall else radius_b
            stiffness = 1.0 / (1.0 / (pair[a, b, STIFFNESS] * radius_a) + 1.0 / (pair[b, a, STIFFNESS] * other))
            shear = 1.0 / (1.0 / (pair[a, b, SHEAR] * radius_a) + 1.0 / (pair[b, a, SHEAR] * other))
    else:
        stiffness = pair[a, b, STIFFNESS] * sqrt(radius)
        shear = pair[a, b, SHEAR] * sqrt(radius)
    grip[GRIP_STIFFNESS] = stiffness
    grip[GRIP_FRICTION] = pair[a, b, FRICTION]
    grip[GRIP_TANGENTIAL] = shear if tangential >= TangentialLaw.MINDLIN else pair[a, b, SMOOTHING]
    grip[MASS] = mass
    renew_between(a, b, law, pair, loss, rate, grip)


@inner
def renew_between(a, b, law, pair, loss, rate, grip):
    """As :func:`renew`, from the tables of one world."""
    speed = max(rate, SLOWEST)
    place = speed / (speed + pair[a, b, SPEED_SCALE]) * (N_NODE - 1)
    node = min(int(place), N_NODE - 2)
    share = place - node
    first = loss[a, b, node, 0] + share * (loss[a, b, node + 1, 0] - loss[a, b, node, 0])
    second = loss[a, b, node, 1] + share * (loss[a, b, node + 1, 1] - loss[a, b, node, 1])
    grip[ONSET] = speed
    grip[LEAST] = second
    if law == NormalLaw.HERTZ_GONTHIER:
        grip[DAMPING] = first / speed
    else:
        grip[DAMPING] = first * sqrt(grip[MASS] * grip[GRIP_STIFFNESS])


@inner
def speed_bin(speed):
    """Bin of the impact speed histogram [-]."""
    if speed <= LOWEST_SPEED:
        return 0
    return min(int(4.0 * log2(speed / LOWEST_SPEED)), N_SPEED_BIN - 1)
