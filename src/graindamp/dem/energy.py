"""Energies of a world, so that what the container put in can be told from what was lost and what is still there."""

from math import sqrt
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from graindamp.dem.columns import (
    GRIP_STIFFNESS,
    LOSS_FRICTION,
    LOSS_FRICTION_WALL,
    LOSS_LID,
    LOSS_NORMAL,
    LOSS_NORMAL_WALL,
    LOSS_ROLLING,
    WORK_CONTAINER,
)
from graindamp.dem.compile import compiled, inner
from graindamp.dem.laws import NormalLaw, TangentialLaw
from graindamp.dem.state import Worlds
from graindamp.dem.walls import FOAM_FIRST, nearest


class Energies(NamedTuple):
    """Energies of a world [J]; kinetic ones and work in the frame at rest, losses and work since the start."""

    kinetic: float
    rotational: float
    potential: float
    """In gravity, from the origin of the frame at rest."""
    elastic: float
    """Stored in contacts, springs and foam."""
    work: float
    """Done by the container on the particles."""
    loss_normal: float
    """Lost in normal contact between particles."""
    loss_friction: float
    """Lost in friction between particles."""
    loss_normal_wall: float
    loss_friction_wall: float
    loss_lid: float
    """Lost in foam."""
    loss_rolling: float

    @property
    def stored(self) -> float:
        """Kinetic, potential and elastic energy [J]."""
        return self.kinetic + self.rotational + self.potential + self.elastic

    @property
    def lost(self) -> float:
        """All that was dissipated [J]."""
        return (
            self.loss_normal
            + self.loss_friction
            + self.loss_normal_wall
            + self.loss_friction_wall
            + self.loss_lid
            + self.loss_rolling
        )


def velocity_now(worlds: Worlds, w: int = 0) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Velocities [m/s] and spins [rad/s] at the time of the positions, in the container's frame; each (particle, 3)."""
    n = int(worlds.particles.n_particle[w])
    half = 0.5 * worlds.rules.time_step[w]
    inverse = worlds.particles.inverse_mass[w, :n]
    body = worlds.rules.gravity[w] - worlds.motion.acceleration[w]
    force, torque = worlds.particles.force[w, :n], worlds.particles.torque[w, :n]
    velocity = worlds.particles.velocity[w, :n, :3] + half * (force * inverse[:, :1] + body)
    spin = worlds.particles.spin[w, :n, :3] + half * torque * inverse[:, 1:]
    return velocity, spin


def energies(worlds: Worlds, w: int = 0) -> Energies:
    """Energies of world w now."""
    n = int(worlds.particles.n_particle[w])
    velocity, spin = velocity_now(worlds, w)
    velocity = velocity + worlds.motion.velocity[w]
    mass = 1.0 / worlds.particles.inverse_mass[w, :n, 0]
    inertia = 1.0 / worlds.particles.inverse_mass[w, :n, 1]
    position = worlds.particles.position[w, :n, :3] + worlds.motion.displacement[w]
    elastic = elastic_pairs(w, worlds.particles, worlds.pairs, worlds.rules)
    elastic += elastic_walls(w, worlds.particles, worlds.touches, worlds.walls, worlds.rules)
    ledger = worlds.record.ledger[w]
    return Energies(
        kinetic=float(0.5 * np.sum(mass * np.sum(velocity**2, axis=1))),
        rotational=float(0.5 * np.sum(inertia * np.sum(spin**2, axis=1))),
        potential=float(-np.sum(mass * (position @ worlds.rules.gravity[w]))),
        elastic=float(elastic),
        work=float(ledger[WORK_CONTAINER]),
        loss_normal=float(ledger[LOSS_NORMAL]),
        loss_friction=float(ledger[LOSS_FRICTION]),
        loss_normal_wall=float(ledger[LOSS_NORMAL_WALL]),
        loss_friction_wall=float(ledger[LOSS_FRICTION_WALL]),
        loss_lid=float(ledger[LOSS_LID]),
        loss_rolling=float(ledger[LOSS_ROLLING]),
    )


@inner
def elastic_energy(law, stiffness, overlap):
    """Energy stored by a normal law [J]."""
    if law == NormalLaw.LINEAR:
        return 0.5 * stiffness * overlap * overlap
    return 0.4 * stiffness * overlap * overlap * sqrt(overlap)


@inner
def spring_energy(stretch):
    """Energy stored by a tangential spring [J]."""
    if stretch[3] <= 0.0:
        return 0.0
    return 0.5 * (stretch[0] * stretch[0] + stretch[1] * stretch[1] + stretch[2] * stretch[2]) / stretch[3]


@compiled
def elastic_pairs(w, particles, pairs, rules):
    """Energy stored in contacts between particles of world w [J]."""
    position = particles.position[w]
    total = 0.0
    for k in range(pairs.n_active[w]):
        p = pairs.active[w, k]
        i, j = pairs.first[w, p], pairs.second[w, p]
        x = position[j, 0] - position[i, 0]
        y = position[j, 1] - position[i, 1]
        z = position[j, 2] - position[i, 2]
        overlap = position[i, 3] + position[j, 3] - sqrt(x * x + y * y + z * z)
        total += elastic_energy(rules.normal[w], pairs.grip[w, p, GRIP_STIFFNESS], overlap)
        if rules.tangential[w] >= TangentialLaw.MINDLIN:
            total += spring_energy(pairs.stretch[w, p])
    return total


@compiled
def elastic_walls(w, particles, touches, walls, rules):
    """Energy stored in contacts with walls and in foam of world w [J]."""
    total = 0.0
    for k in range(touches.n_active[w]):
        p = touches.active[w, k]
        overlap = wall_overlap(w, touches.active_first[w, k], touches.active_second[w, k], particles, walls)
        total += elastic_energy(rules.normal[w], touches.grip[w, p, GRIP_STIFFNESS], overlap)
        if rules.tangential[w] >= TangentialLaw.MINDLIN:
            total += spring_energy(touches.stretch[w, p])
    if touches.n_soft[w] > 0:
        for k in range(touches.n_inner[w]):
            i, e = touches.inner_first[w, k], touches.inner_second[w, k]
            if walls.law[w, e] == NormalLaw.FOAM:
                x, shape = max(wall_overlap(w, i, e, particles, walls), 0.0), walls.shape[w, e]
                a, b, c = shape[FOAM_FIRST], shape[FOAM_FIRST + 1], shape[FOAM_FIRST + 2]
                total += x * x * (a / 2.0 + x * (b / 3.0 + x * c / 4.0))
    return total


@inner
def wall_overlap(w, i, e, particles, walls):
    """Overlap of particle i with element e [m]."""
    position = particles.position[w]
    x, y, z, radius = position[i, 0], position[i, 1], position[i, 2], position[i, 3]
    return radius - nearest(walls.kind[w, e], walls.shape[w], e, walls.edges[w], x, y, z, radius)[0]
