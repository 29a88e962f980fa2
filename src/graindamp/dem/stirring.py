"""How much the bed moves in its container, cycle by cycle: what motion modes are told apart by.

Everything is in the container's frame and of the particles' centres; spin is left out. Speeds are over V, the velocity
amplitude of the container, energies over m_bed V^2 / 2. A bed that clings to the container has the relative energy 0,
one that stays at rest while the container moves has 1/2 in the mean and 1 at most.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from graindamp.dem.container import Enclosure
from graindamp.dem.energy import velocity_now
from graindamp.dem.motion import DIRECTION
from graindamp.dem.plan import Plan
from graindamp.dem.state import Record, Worlds
from graindamp.dem.walls import WallKind
from graindamp.spec.simulation import DamperSpec

Real = NDArray[np.float64]

MOVING = 0.1
"""Root mean square speed over V above which a particle counts as moving [-]: its energy is then 1 % of that of a
particle that moves like the container."""

LAYERS = 3
"""Layers of equally many particles that the bed is divided into along gravity [-]."""

ALONG = 0.99
"""Cosine between a wall's normal and the motion above which it is an end wall [-], 8 degrees."""

TOUCH = 0.02
"""Mean force of a block over m_bed A above which the bed counts as touching an end wall [-]: that of one particle in
fifty that rests on the accelerated wall."""


class Stirring(NamedTuple):
    """Motion of the bed relative to the container in every whole cycle. End 0 is the one that the motion's direction
    points away from, end 1 the one it points to; layer 0 is the lowest."""

    kinetic: Real
    """Kinetic energy, mean over the cycle [-]; (cycle,)."""
    kinetic_peak: Real
    """Its largest sample [-]; (cycle,)."""
    block: Real
    """Kinetic energy of the bed's centre of mass along the motion, mean over the cycle [-]; (cycle,)."""
    drift: Real
    """Part of the kinetic energy in the particles' mean velocities over the cycle, that is in flow, slumping and long
    flights [-]; (cycle,)."""
    absolute: Real
    """Kinetic energy in the frame at rest, mean over the cycle [-]: 1/2 where the bed clings to the container;
    (cycle,)."""
    moving: Real
    """Share of the particles whose root mean square speed is above MOVING [-]; (cycle,)."""
    layer_moving: Real
    """That share in each layer [-], NaN without gravity or with fewer particles than layers; (cycle, LAYERS)."""
    layer_speed: Real
    """Root mean square speed in each layer [-]; likewise."""
    layer_disorder: Real
    """Root mean square speed of its particles relative to the layer's own mean velocity at the time [-]; likewise."""
    inertial: Real
    """Root mean square velocity of the bed's centre along the motion in the frame at rest, over that of the container
    [-]: 1 where it clings, 0 where it stays at rest; (cycle,)."""
    travel: Real
    """Distance between the extreme places of the bed's centre along the motion [m]; (cycle,)."""
    end_contact: Real
    """Share of the cycle in which the bed presses on each end [-]; (cycle, 2)."""
    end_episodes: Real
    """Separate times that it begins to [-]; (cycle, 2)."""
    end_impulse: Real
    """Impulse on each end over m_bed V [-]; (cycle, 2)."""
    end_concentration: Real
    """Length of the mean of exp(i phase) over that impulse [-]: 1 for one sharp impact, 0 for a steady push, NaN
    without impulse; (cycle, 2)."""
    end_phase: Real
    """Phase of that mean, 0 where the container is fastest along the motion [rad], -pi to pi; (cycle, 2)."""
    compression: Real
    """Deepest indentation of a coated end wall [m], 0 where none is touched, NaN where no end is coated; (cycle, 2)."""


class Stirred:
    """What is gathered for it while a run goes on."""

    def __init__(
        self, damper: DamperSpec, enclosure: Enclosure, plan: Plan, worlds: Worlds, speed: float, omega: float
    ) -> None:
        """Nothing gathered yet.

        Args:
            damper: the description.
            enclosure: its walls.
            plan: of the run, one with cycles.
            worlds: the world about to set off.
            speed: velocity amplitude of the container [m/s].
            omega: angular frequency of the motion [rad/s].
        """
        self.plan, self.speed, self.omega = plan, speed, omega
        self.mass = 1.0 / worlds.particles.inverse_mass[0, :, 0]
        self.along = worlds.motion.timing[0, DIRECTION : DIRECTION + 3].copy()
        gravity = worlds.rules.gravity[0]
        size = float(np.linalg.norm(gravity))
        self.up = -gravity / size if size > 0.0 and len(self.mass) >= LAYERS else None
        self.ends = _end_walls(enclosure, self.along)
        self.coated = _coated_ends(damper, enclosure, self.along)
        self.n_sample = sum(step <= plan.per_cycle for step in plan.energy)
        self.velocity: list[Real] = []
        self.position: list[Real] = []
        self.container: list[float] = []
        self.last = self._positions(worlds)
        self.rows: list[tuple[Real, ...]] = []

    def _positions(self, worlds: Worlds) -> Real:
        return worlds.particles.position[0, :, :3].copy()

    def sample(self, worlds: Worlds, step: int) -> None:
        """Take down the world at one of the planned energy samples, `step` steps after the motion began."""
        if step not in self.plan.energy:
            return
        self.velocity.append(velocity_now(worlds)[0])
        self.position.append(self._positions(worlds))
        self.container.append(float(worlds.motion.velocity[0] @ self.along))
        if step % self.plan.per_cycle == 0:
            if len(self.velocity) == self.n_sample:
                self.rows.append(self._cycle(worlds))
            self.last = self.position[-1]
            self.velocity, self.position, self.container = [], [], []

    def _cycle(self, worlds: Worlds) -> tuple[Real, ...]:
        """Numbers of the cycle just over, in the order of :class:`Stirring` up to `travel`, and `compression`."""
        velocity, share = np.stack(self.velocity) / self.speed, self.mass / self.mass.sum()
        square = np.einsum("spc,spc->sp", velocity, velocity)
        kinetic = square @ share
        centre = (share @ velocity) @ self.along
        rms = np.sqrt(square.mean(axis=0))
        container = np.array(self.container) / self.speed
        moves = float(np.sqrt(np.mean(container**2)))
        place = share @ np.stack([self.last, *self.position]) @ self.along
        layers = np.full((3, LAYERS), np.nan)
        if self.up is not None:
            height = np.mean([position @ self.up for position in self.position], axis=0)
            for k, members in enumerate(np.array_split(np.argsort(height), LAYERS)):
                part = velocity[:, members] - velocity[:, members].mean(axis=1, keepdims=True)
                layers[:, k] = (
                    np.mean(rms[members] > MOVING),
                    np.sqrt(np.mean(square[:, members])),
                    np.sqrt(np.mean(np.sum(part**2, axis=2))),
                )
        return (
            kinetic.mean(),
            kinetic.max(),
            np.mean(centre**2),
            np.sum(velocity.mean(axis=0) ** 2, axis=1) @ share,
            kinetic.mean() + np.mean(container**2 + 2.0 * centre * container),
            np.mean(rms > MOVING),
            *layers,
            np.sqrt(np.mean((centre + container) ** 2)) / max(moves, 1e-300),
            np.ptp(place),
            self._compression(worlds),
        )

    def _compression(self, worlds: Worlds) -> Real:
        """Deepest indentation of each coated end over the samples of the cycle [m]; (2,)."""
        radius, deepest = worlds.particles.position[0, :, 3], np.full(2, np.nan)
        for end, point, normal in self.coated:
            overlap = radius - (np.stack(self.position) - point) @ normal
            deepest[end] = np.fmax(deepest[end], max(float(overlap.max()), 0.0))
        return deepest

    def result(self, record: Record) -> Stirring | None:
        """All whole cycles; None where there is none."""
        if not self.rows:
            return None
        n = len(self.rows)
        columns = [np.array([row[k] for row in self.rows]) for k in range(len(self.rows[0]))]
        *motion, compression = columns
        return Stirring._make([*motion, *self._touches(record, n), compression])

    def _touches(self, record: Record, n_cycle: int) -> tuple[Real, ...]:
        """Contact with the ends from the block means of the wall forces, which miss no impact; each (cycle, 2)."""
        per_cycle = self.plan.per_cycle // self.plan.stride
        series = record.series[0, : n_cycle * per_cycle] @ self.along
        phase = 2.0 * np.pi * (np.arange(per_cycle) + 0.5) / per_cycle
        turn = np.exp(-1j * phase)
        lead = np.angle(series[:, -1].reshape(n_cycle, per_cycle) @ turn)
        mass = float(self.mass.sum())
        results: list[list[Real]] = [[], [], [], [], []]
        for end, sign in ((0, -1.0), (1, 1.0)):
            force = series[:, :-1] if self.ends is None else series[:, :-1][:, self.ends[end]]
            push = np.maximum(sign * force.sum(axis=1), 0.0)
            touching = push > TOUCH * mass * self.omega * self.speed
            begins = touching & ~np.concatenate([[False], touching[:-1]])
            push = push.reshape(n_cycle, per_cycle)
            total = push.sum(axis=1)
            with np.errstate(divide="ignore", invalid="ignore"):
                beat = push @ turn.conj() / total * np.exp(1j * lead)
            impulse = total * self.plan.stride * self.plan.time_step / (mass * self.speed)
            for row, value in zip(
                results,
                (
                    touching.reshape(n_cycle, per_cycle).mean(axis=1),
                    begins.reshape(n_cycle, per_cycle).sum(axis=1).astype(float),
                    impulse,
                    np.abs(beat),
                    np.angle(beat),
                ),
                strict=True,
            ):
                row.append(value)
        return tuple(np.stack(row, axis=1) for row in results)


def _end_walls(enclosure: Enclosure, along: Real) -> tuple[NDArray[np.int64], NDArray[np.int64]] | None:
    """Numbers of the walls that stand across the motion at its two ends; None where there are none, as in a sphere."""
    ends: tuple[set[int], set[int]] = (set(), set())
    for element in enclosure.elements:
        if element.kind == WallKind.PLANE:
            cosine = float(np.dot(element.numbers[3:6], along))
            if abs(cosine) > ALONG:
                ends[int(cosine < 0.0)].add(element.group)
    if not any(ends):
        return None
    return np.array(sorted(ends[0]), np.int64), np.array(sorted(ends[1]), np.int64)


def _coated_ends(damper: DamperSpec, enclosure: Enclosure, along: Real) -> list[tuple[int, Real, Real]]:
    """End, point and normal into the container of the surface of every coated end wall."""
    found, seen = [], set()
    for element in enclosure.elements:
        name = enclosure.names[element.group]
        surface = damper.container.walls.get(name)
        if element.kind != WallKind.PLANE or name in seen or surface is None or surface.coating is None:
            continue
        seen.add(name)  # the plane behind it is the stiff wall
        cosine = float(np.dot(element.numbers[3:6], along))
        if abs(cosine) > ALONG:
            found.append((int(cosine < 0.0), np.asarray(element.numbers[:3]), np.asarray(element.numbers[3:6])))
    return found
