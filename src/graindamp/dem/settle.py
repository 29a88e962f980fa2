"""Beds brought to rest: softened contacts that save time steps, and the way back to the described stiffness."""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from graindamp.dem.cavity import Cavity, overlapping
from graindamp.dem.columns import FRICTION, RULE, SHEAR, STIFFNESS
from graindamp.dem.container import Enclosure
from graindamp.dem.energy import velocity_now
from graindamp.dem.engine import run, start
from graindamp.dem.interactions import Interactions
from graindamp.dem.laws import NormalLaw
from graindamp.dem.state import Motion, Worlds
from graindamp.dem.timestep import contacts_between
from graindamp.dem.world import Bed, world_of
from graindamp.status import describe
from graindamp.units import STANDARD_GRAVITY

Real = NDArray[np.float64]

SOFT_OVERLAP = 0.03
"""Overlap over the smallest radius that softened contacts reach at the speed expected of them [-]."""

RESTING_OVERLAP = 0.015
"""Overlap over the smallest radius that the mean contact force at the bottom of the bed may press [-]."""

STEPS_PER_CONTACT = 20
"""Time steps of a contact while packing [-]; a run takes more, because its losses are counted."""

SKIN = 0.3
"""Reach of the neighbour lists over the smallest radius [-]: longer than a run's, as steps are longer too."""

REST = 1e-3
"""A bed rests when its mean kinetic energy is below that of a fall over this part of a radius [-]."""

STIFFENING = 4.0
"""Factor between two stiffnesses on the way to the described ones [-]: energy stored in contacts grows by as much."""

FORCE_CHAIN = 20.0
"""Largest over mean contact force in a bed at rest [-], generously; forces fall off exponentially beyond the mean."""

Watch = Callable[[float], None]
"""Told the fraction done of a stage."""


class PackingError(RuntimeError):
    """A packing that is not sound: particles outside, overlapping or lost. A defect, not a user's mistake."""


class Grains(NamedTuple):
    """The particles of a bed that is being packed, in the order of their numbers."""

    bed: Bed
    mass: Real
    """Mass of each [kg]."""

    @classmethod
    def at_rest(cls, position: Real, radius: Real, material: NDArray[np.int32], density: Real) -> "Grains":
        """Particles that do not move."""
        return cls(Bed.at_rest(position, radius, material), density[material] * 4.0 / 3.0 * np.pi * radius**3)

    def stopped(self) -> "Grains":
        """The same places, at rest."""
        return self._replace(bed=Bed.at_rest(self.bed.position, self.bed.radius, self.bed.material))

    def kept(self, chosen: NDArray[np.bool_]) -> "Grains":
        """Only the chosen particles."""
        position, radius, material, velocity, spin = self.bed
        bed = Bed(position[chosen], radius[chosen], material[chosen], velocity[chosen], spin[chosen])
        return Grains(bed, self.mass[chosen])

    @property
    def solid_volume(self) -> float:
        """Volume of all particles [m^3]."""
        return float(4.0 / 3.0 * np.pi * np.sum(self.bed.radius**3))

    @property
    def limit(self) -> float:
        """Kinetic energy below which the bed rests [J]."""
        return REST * STANDARD_GRAVITY * float(np.sum(self.mass * self.bed.radius))


def pressure_of(grains: Grains, area: float) -> float:
    """Pressure of the bed's weight on a floor of `area` [Pa]."""
    return STANDARD_GRAVITY * float(grains.mass.sum()) / area


def slow_speed(grains: Grains) -> float:
    """Speed of a fall over two radii [m/s], which a bed that comes to rest stays below."""
    return math.sqrt(4.0 * STANDARD_GRAVITY * float(grains.bed.radius.max()))


def _radii(radius: Real) -> tuple[float, float]:
    return float(radius.min()), float(radius.max())


def softening(interactions: Interactions, radius: Real, speed: float, pressure: float) -> Real:
    """Divisor of the stiffness of every pair of materials [-], >= 1; (material, material).

    Contacts are made so soft that an impact at `speed` [m/s] presses SOFT_OVERLAP, and the mean contact force under
    `pressure` [Pa] RESTING_OVERLAP of the smallest radius; those that are soft already stay.
    """
    radii = _radii(radius)
    divisor = np.ones(interactions.pair.shape[:2])
    for a in range(interactions.n_particle_material):
        for b in range(len(divisor)):
            factors = []
            for contact in contacts_between(interactions, a, b, radii, radii):
                power = contact.power
                overlap = SOFT_OVERLAP * radii[0]
                impact = 0.5 * (power + 1.0) * contact.mass * speed**2 / overlap ** (power + 1.0)
                rest = pressure * (2.0 * radii[1]) ** 2 / (RESTING_OVERLAP * radii[0]) ** power
                factors.append(contact.stiffness / max(impact, rest))
            divisor[a, b] = max(1.0, min(factors))
            divisor[b, a] = divisor[a, b]
    return divisor


def softened(interactions: Interactions, divisor: Real) -> Interactions:
    """Interactions with every stiffness divided."""
    pair = interactions.pair.copy()
    pair[:, :, STIFFNESS] /= divisor
    proportional = (interactions.normal != NormalLaw.LINEAR) | (pair[:, :, RULE] > 0.5)
    pair[:, :, SHEAR] /= np.where(proportional, divisor, 1.0)
    return interactions._replace(pair=pair)


def slippery(interactions: Interactions) -> Interactions:
    """The same contacts without friction."""
    pair = interactions.pair.copy()
    pair[:, :, FRICTION] = 0.0
    return interactions._replace(pair=pair)


def time_step(interactions: Interactions, radius: Real, overlap: float) -> float:
    """Time step that resolves contacts pressed by `overlap` times the smallest radius [s].

    A contact about that overlap swings with k' = dF/d overlap; half of its period stands for the contact time.
    """
    radii = _radii(radius)
    quickest = math.inf
    for a in range(interactions.n_particle_material):
        for b in range(len(interactions.pair)):
            for contact in contacts_between(interactions, a, b, radii, radii):
                slope = contact.power * contact.stiffness * (overlap * radii[0]) ** (contact.power - 1.0)
                quickest = min(quickest, math.pi * math.sqrt(contact.mass / slope))
    return float(1.25 * quickest / STEPS_PER_CONTACT)


def resting_overlap(interactions: Interactions, radius: Real, pressure: float) -> float:
    """Largest overlap over the smallest radius that a bed at rest may show [-]: what force chains press, but 1e-3 at
    least."""
    radii = _radii(radius)
    force = FORCE_CHAIN * pressure * (2.0 * radii[1]) ** 2
    softest = max(
        (force / contact.stiffness) ** (1.0 / contact.power)
        for a in range(interactions.n_particle_material)
        for b in range(len(interactions.pair))
        for contact in contacts_between(interactions, a, b, radii, radii)
    )
    return float(max(1e-3, softest / radii[0]))


class Scene(NamedTuple):
    """Where particles are brought to rest."""

    enclosure: Enclosure
    interactions: Interactions
    gravity: tuple[float, float, float]

    def worlds(self, grains: Grains, time_step: float, motion: Motion | None = None) -> Worlds:
        """A world of these particles, ready to run."""
        smallest = float(grains.bed.radius.min())
        return sound(
            start(
                world_of(
                    grains.bed, self.enclosure, self.interactions, self.gravity, time_step, motion, skin=SKIN * smallest
                )
            )
        )


def sound(worlds: Worlds) -> Worlds:
    """The same worlds, after a look at their status and positions.

    Raises:
        PackingError: a status bit is set, or a position is not finite.
    """
    if worlds.clock.status[0] != 0:
        raise PackingError("packing stopped: " + "; ".join(describe(int(worlds.clock.status[0]))))
    if not np.isfinite(worlds.particles.position).all():
        raise PackingError("packing stopped: positions are no longer finite; report this with the description")
    return worlds


def grains_of(worlds: Worlds, grains: Grains) -> Grains:
    """Particles of a world in the order of their numbers."""
    n = len(grains.mass)
    order = np.argsort(worlds.particles.identity[0, :n])
    velocity, spin = velocity_now(worlds)
    position = worlds.particles.position[0, :n, :3][order]
    bed = grains.bed._replace(position=np.ascontiguousarray(position), velocity=velocity[order], spin=spin[order])
    return grains._replace(bed=bed)


def kinetic_energy(worlds: Worlds) -> float:
    """Kinetic energy of the last half step, without rotation [J]."""
    velocity = worlds.particles.velocity[0, :, :3]
    return float(0.5 * np.sum(np.einsum("ij,ij->i", velocity, velocity) / worlds.particles.inverse_mass[0, :, 0]))


def run_to_rest(worlds: Worlds, grains: Grains, interval: float, longest: float, watch: Watch) -> Worlds:
    """Worlds run until the bed rests at two looks `interval` apart; after `longest` [s] it is quenched."""
    n_step = max(1, round(interval / float(worlds.rules.time_step[0])))
    n_look = max(2, math.ceil(longest / interval))
    quiet = 0
    for look in range(n_look):
        worlds = sound(run(worlds, n_step))
        quiet = quiet + 1 if kinetic_energy(worlds) < grains.limit else 0
        watch((look + 1) / n_look)
        if quiet == 2:
            return worlds
    return quench(worlds, grains, 20, 2000, lambda _: True)


def stop(worlds: Worlds) -> None:
    """Let all particles stand still, where they are."""
    worlds.particles.velocity[...] = 0.0
    worlds.particles.spin[...] = 0.0


def quench(worlds: Worlds, grains: Grains, n_chunk: int, longest: int, enough: Callable[[Worlds], bool]) -> Worlds:
    """Let a bed find its equilibrium overdamped: whenever its kinetic energy passes a peak, it is taken away.

    Ends when a peak stays below what counts as rest and `enough` holds, or after `longest` chunks of `n_chunk` steps.

    Source: Cundall (1976), Proc. 2nd Int. Conf. Num. Methods in Geomechanics, 132-150 (kinetic damping).
    """
    before = 0.0
    for _ in range(longest):
        worlds = sound(run(worlds, n_chunk))
        energy = kinetic_energy(worlds)
        if energy >= before:
            before = energy
            continue
        stop(worlds)
        if before < grains.limit and enough(worlds):
            break
        before = 0.0
    stop(worlds)
    return worlds


def largest_overlap(grains: Grains, cavity: Cavity) -> float:
    """Largest overlap with a neighbour, over the smaller radius, or with a wall, over the radius [-]."""
    position, radius = grains.bed.position, grains.bed.radius
    pairs, overlap = overlapping(position, radius)
    worst = float((overlap / radius[pairs].min(axis=1)).max()) if len(pairs) else 0.0
    return max(worst, float((-cavity.gaps(position, radius) / radius).max()))


def stiffened(scene: Scene, grains: Grains, cavity: Cavity, divisor: Real, allowed: float, watch: Watch) -> Grains:
    """Particles at rest under the described stiffness, from a rest under one divided by `divisor`.

    Overlaps that soft contacts hold would drive a stiff bed apart. The stiffness therefore rises by factors of
    STIFFENING, and after each the bed is quenched; at last it must rest by itself.
    """
    n_stage = max(1, math.ceil(math.log(float(divisor.max())) / math.log(STIFFENING)))
    grains = grains.stopped()
    for stage in range(1, n_stage + 1):
        last = stage == n_stage
        hard = softened(scene.interactions, divisor ** (1.0 - stage / n_stage))
        overlap = max(largest_overlap(grains, cavity), 1e-4)
        worlds = scene._replace(interactions=hard).worlds(grains, time_step(hard, grains.bed.radius, overlap))

        def enough(worlds: Worlds, last: bool = last, before: float = overlap, old: Grains = grains) -> bool:
            present = largest_overlap(grains_of(worlds, old), cavity)
            return present < (allowed if last else max(0.6 * before, allowed))

        grains = grains_of(quench(worlds, grains, 10, 600, enough), grains).stopped()
        if largest_overlap(grains, cavity) > (allowed if last else max(overlap, allowed)):
            # Friction can lock particles against each other with overlaps that only weight never presses.
            loose = scene._replace(interactions=slippery(hard))
            worlds = loose.worlds(grains, time_step(hard, grains.bed.radius, overlap))
            grains = grains_of(quench(worlds, grains, 10, 600, enough), grains).stopped()
        watch(stage / (n_stage + 1))
    step = time_step(scene.interactions, grains.bed.radius, max(largest_overlap(grains, cavity), 1e-4))
    for _ in range(10):
        worlds = scene.worlds(grains, step)
        free = sound(run(worlds, max(20, round(2e-3 / step))))
        if kinetic_energy(free) < grains.limit and largest_overlap(grains_of(free, grains), cavity) < allowed:
            grains = grains_of(free, grains).stopped()
            break
        stop(free)
        grains = grains_of(quench(free, grains, 10, 300, lambda _: True), grains).stopped()
    watch(1.0)
    return grains
