"""Motion mode of a simulated run: solid-like, fluidised, bouncing, decoupled, compressing.

Modes are those of Meyer & Seifried (2023), "Design of robust particle dampers", sections 2.1, 4.1 and 4.3, told apart
there by eye from animations and velocity fields. Here each is a statement about numbers of the run
(:class:`graindamp.dem.stirring.Stirring`), asked in a fixed order:

1. Unknown where nothing was recorded, or where the bed's own flow, such as its slumping after the container was turned,
   has more energy than what the container does and still dies away.
2. Decoupled: the bed's centre and its particles hardly move in the frame at rest.
3. Bouncing collect-and-collide: the bed crosses its free travel as a block.
4. Solid-like: the particles hardly move in the container.
5. Compression collect-and-collide: the bed presses coated walls in, as a block, and moves mostly by that.
6. Local fluidisation: the lowest third of the bed still follows the container while the highest does not.
7. Global fluidisation: everything else.

The transitions are smooth. `margins` say how far a run is from each threshold, so that a map can mark what is close.
"""

import math
from enum import IntEnum
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from graindamp.dem.run import Run

Real = NDArray[np.float64]


class MotionMode(IntEnum):
    """How the bed moves."""

    UNKNOWN = -1
    SOLID_LIKE = 0
    LOCAL_FLUIDIZATION = 1
    GLOBAL_FLUIDIZATION = 2
    BOUNCING = 3
    """Bouncing collect-and-collide."""
    DECOUPLED = 4
    COMPRESSION = 5
    """Compression collect-and-collide, with coated walls."""


NAMES = {
    MotionMode.UNKNOWN: "unknown",
    MotionMode.SOLID_LIKE: "solid-like",
    MotionMode.LOCAL_FLUIDIZATION: "local fluidisation",
    MotionMode.GLOBAL_FLUIDIZATION: "global fluidisation",
    MotionMode.BOUNCING: "bouncing collect-and-collide",
    MotionMode.DECOUPLED: "decoupled",
    MotionMode.COMPRESSION: "compression collect-and-collide",
}
"""The modes in words."""

CROSSING = 0.6
"""Travel of the bed's centre over the clearance from which the bed crosses it [-]. A block that bounces has 1, less
what its loose end lags behind and what compacting or loosening changes. A bed at rest beside the moving container has
2 X / h = (2 / pi) X / X_opt: under 0.54 below the least stroke of a plastic block's bounce, X = 0.844 X_opt."""

COHESION = 0.5
"""Energy of the centre of mass over all kinetic energy, both relative to the container, from which the bed moves as a
block [-]: more goes into common motion than into all motion of the particles among each other."""

STAYS = 0.15
"""Speed of the bed's centre in the frame at rest over that of the container below which the bed stays behind [-]. Force
is mass times acceleration of the centre, so that the fundamental part of this speed is |m' - i eta|: below 0.15 no bed
has the eta > 0.15 that the paper finds outside this mode."""

ABSOLUTE = 0.25
"""Kinetic energy in the frame at rest over m_bed V^2 / 2 below which the particles stay behind as well [-]: half of the
1/2 of a bed that clings, so that they are nearer to rest than to following. Above it they rattle about a centre that
stays, which is fluidisation."""

SOLID = 0.01
"""Relative kinetic energy over m_bed V^2 / 2 below which the bed is solid-like [-]. A block on a floor with Coulomb
friction that just begins to slip has 0.009 where it dissipates eta = 0.1, the limit that the paper gives."""

FOLLOWS = 0.5
"""Root mean square speed over V below which the lowest third follows the container [-]. Its energy is then 1/4, half of
that of a layer that stays at rest beside the container: it is nearer to following than to staying behind. A bed that
slips a little as a whole counts likewise."""

INDENTED = 0.25
"""Indentation of a coated end over the stroke X from which the coating takes part [-]. The paper finds the best damping
where both are alike (Eq. 17)."""

FLOWS = 0.5
"""Share of the relative kinetic energy in the particles' mean velocities over a cycle from which the bed flows [-]."""

DIES = 0.5
"""Kinetic energy in the last third of the cycles over that in the first below which it dies away [-]."""


class Criteria(NamedTuple):
    """What a mode is judged by, means over the cycles after the transient [-]."""

    relative_energy: float
    """Kinetic energy relative to the container over m_bed V^2 / 2."""
    absolute_energy: float
    """Kinetic energy in the frame at rest over the same."""
    cohesion: float
    """Share of the relative energy in the motion of the bed's centre along the container's."""
    flow: float
    """Share of the relative energy in the particles' mean velocities over a cycle."""
    decay: float
    """Relative energy in the last third of the cycles over that in the first."""
    moving: float
    """Share of particles that move, see :data:`graindamp.dem.stirring.MOVING`."""
    lowest_speed: float
    """Root mean square speed of the lowest third of the particles over V; of all where there are no layers."""
    highest_speed: float
    """Of the highest third."""
    inertial_speed: float
    """Root mean square speed of the bed's centre in the frame at rest over that of the container."""
    travel: float
    """Way of the bed's centre in the container over the clearance; NaN without one."""
    stroke_travel: float
    """The same way over 2 X: 1 for a bed at rest beside the container."""
    contact: float
    """Share of the cycle in contact with an end wall, mean of both."""
    impacts: float
    """Times per cycle that the bed comes to an end wall, both together: 2 for collect-and-collide."""
    sharpness: float
    """1 for one sharp impact per cycle at each end, 0 for a steady push, mean of both."""
    indentation: float
    """Deepest indentation of a coated end over the stroke X; NaN without coating."""


NO_CRITERIA = Criteria(*[math.nan] * len(Criteria._fields))


class ModeVerdict(NamedTuple):
    """The mode of a run and why."""

    mode: MotionMode
    criteria: Criteria
    margins: dict[str, float]
    """How far each criterion that was asked is from its threshold: ln(value / threshold), by the name of the threshold;
    within 0.2 of 0 the verdict is close."""

    @property
    def is_close(self) -> bool:
        """Whether some threshold is nearer than a fifth of its value."""
        return any(abs(margin) < CLOSE for margin in self.margins.values())


CLOSE = 0.2
"""Margin below which a verdict is close [-]."""


def classify(run: "Run", n_skipped: int = 0) -> ModeVerdict:
    """Motion mode of a run.

    Args:
        run: a simulated run.
        n_skipped: cycles to leave out at the start; fewer where less than two would remain.
    """
    return judge(criteria_of(run, n_skipped))


def criteria_of(run: "Run", n_skipped: int = 0) -> Criteria:
    """Numbers that the mode of a run is judged by; all NaN where the run recorded no whole cycle.

    Args:
        run: a simulated run.
        n_skipped: cycles to leave out at the start.
    """
    stirring = run.stirring
    if stirring is None or run.frequency is None:
        return NO_CRITERIA
    n = len(stirring.kinetic)
    used = slice(min(n_skipped, max(n - 2, 0)), None)
    kinetic = stirring.kinetic[used]
    third = max(len(kinetic) // 3, 1)
    energy = float(kinetic.mean())
    size = max(energy, 1e-300)
    omega = 2.0 * np.pi * run.frequency
    stroke = float(np.mean(np.abs(run.cycle_velocity))) / omega if len(run.cycle_velocity) else math.nan
    clearance = run.packing.clearance
    way = float(stirring.travel[used].mean())
    low, high = (_mean(stirring.layer_speed[used][:, k]) for k in (0, -1))
    if math.isnan(low):
        low = high = math.sqrt(energy)
    return Criteria(
        relative_energy=energy,
        absolute_energy=float(stirring.absolute[used].mean()),
        cohesion=float(stirring.block[used].mean()) / size,
        flow=float(stirring.drift[used].mean()) / size,
        decay=float(kinetic[-third:].mean()) / max(float(kinetic[:third].mean()), 1e-300),
        moving=float(stirring.moving[used].mean()),
        lowest_speed=low,
        highest_speed=high,
        inertial_speed=float(stirring.inertial[used].mean()),
        travel=math.nan if clearance is None or clearance <= 0.0 else way / clearance,
        stroke_travel=way / (2.0 * stroke),
        contact=float(stirring.end_contact[used].mean()),
        impacts=float(stirring.end_episodes[used].sum(axis=1).mean()),
        sharpness=_mean(stirring.end_concentration[used]),
        indentation=_largest_end(stirring.compression[used]) / stroke,
    )


def _mean(values: Real) -> float:
    """Mean of what is a number; NaN where nothing is."""
    known = values[np.isfinite(values)]
    return float(known.mean()) if known.size else math.nan


def _largest_end(compression: Real) -> float:
    """Mean over the cycles of the end that is pressed in more; NaN where none is coated."""
    ends = [_mean(compression[:, k]) for k in range(compression.shape[1])]
    known = [value for value in ends if not math.isnan(value)]
    return max(known) if known else math.nan


def judge(criteria: Criteria) -> ModeVerdict:
    """Mode that follows from the criteria, in the order told at the head of this module."""
    margins: dict[str, float] = {}

    def above(name: str, value: float, threshold: float) -> bool:
        margins[name] = math.log(max(value, 1e-12) / threshold)
        return value >= threshold

    c = criteria
    if math.isnan(c.relative_energy):
        return ModeVerdict(MotionMode.UNKNOWN, c, margins)
    if c.relative_energy >= SOLID and c.flow >= FLOWS and c.decay < DIES:
        return ModeVerdict(MotionMode.UNKNOWN, c, {"flow": math.log(c.flow / FLOWS)})
    if not above("stays", c.inertial_speed, STAYS) and not above("absolute", c.absolute_energy, ABSOLUTE):
        return ModeVerdict(MotionMode.DECOUPLED, c, margins)
    crosses = not math.isnan(c.travel) and above("crossing", c.travel, CROSSING)
    if crosses and above("cohesion", c.cohesion, COHESION):
        return ModeVerdict(MotionMode.BOUNCING, c, margins)
    if not above("solid", c.relative_energy, SOLID):
        return ModeVerdict(MotionMode.SOLID_LIKE, c, margins)
    presses = not math.isnan(c.indentation) and above("indentation", c.indentation, INDENTED)
    if presses and above("cohesion", c.cohesion, COHESION):
        return ModeVerdict(MotionMode.COMPRESSION, c, margins)
    if not above("follows", c.lowest_speed, FOLLOWS):
        return ModeVerdict(MotionMode.LOCAL_FLUIDIZATION, c, margins)
    return ModeVerdict(MotionMode.GLOBAL_FLUIDIZATION, c, margins)
