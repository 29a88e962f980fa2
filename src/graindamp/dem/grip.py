"""What a contact finds out when it begins, and keeps until it ends.

Stiffness with the radii in it, reduced mass, friction, and the damping constants that belong to the speed of the
impact. A contact that is hit again while it lasts takes the greater speed, because damping set for a slow onset would
grow without bound under a fast one. Restitution may depend on speed for every law: the constants come from a table
over speed."""

from math import log2, sqrt

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

SLOWEST = 1e-5
"""Least speed at onset that damping is set for [m/s]; slower contacts, such as those of a settling bed, lose little
either way, and d / (e onset) must stay finite."""


@inner
def begin(w, i, j, wall, particles, material, rules, rate, grip):
    """Fill `grip` for a contact of particle i that begins at approach speed `rate`.

    The second body j is a particle, or, with `wall`, an element without radius and mass of its own: R* and m* are
    then those of the particle. `material` is that of the second bodies.
    """
    a, b, pair, law = particles.material[w, i], material[j], rules.pair[w], rules.normal[w]
    radius_a, mass = particles.position[w, i, 3], 1.0 / particles.inverse_mass[w, i, 0]
    radius, other = radius_a, radius_a
    if not wall:
        other = particles.position[w, j, 3]
        radius = radius_a * other / (radius_a + other)
        mass = 1.0 / (particles.inverse_mass[w, i, 0] + particles.inverse_mass[w, j, 0])
    if law == NormalLaw.LINEAR:
        stiffness = pair[a, b, STIFFNESS]
        shear = stiffness * pair[a, b, SHEAR]
        if pair[a, b, RULE] > 0.5:
            stiffness = 1.0 / (1.0 / (pair[a, b, STIFFNESS] * radius_a) + 1.0 / (pair[b, a, STIFFNESS] * other))
            shear = 1.0 / (1.0 / (pair[a, b, SHEAR] * radius_a) + 1.0 / (pair[b, a, SHEAR] * other))
    else:
        stiffness = pair[a, b, STIFFNESS] * sqrt(radius)
        shear = pair[a, b, SHEAR] * sqrt(radius)
    grip[GRIP_STIFFNESS] = stiffness
    grip[GRIP_FRICTION] = pair[a, b, FRICTION]
    grip[GRIP_TANGENTIAL] = shear if rules.tangential[w] >= TangentialLaw.MINDLIN else pair[a, b, SMOOTHING]
    grip[MASS] = mass
    renew(a, b, w, rules, rate, grip)


@inner
def renew(a, b, w, rules, rate, grip):
    """Set the damping constants in `grip` for materials a and b and the approach speed `rate` [m/s]."""
    law, pair, loss = rules.normal[w], rules.pair[w], rules.loss[w]
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
