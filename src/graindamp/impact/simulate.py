"""Motion of impact dampers from event to event: free or forced, any restitution, any number of balls and modes."""

from math import inf, isfinite
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from graindamp.errors import InputError
from graindamp.impact.events import FULL, SMALL, STALLED, advance
from graindamp.impact.series import DEGREE, PANEL
from graindamp.impact.state import (
    BASE_WORK,
    EVENT_COLUMNS,
    FORCE_WORK,
    IMPACTS,
    PEAK_COLUMNS,
    VISCOUS,
    Log,
    Motion,
    System,
    scratch_for,
)
from graindamp.impact.system import fastest_rate

TABLE_ROWS = 4096
"""Rows of the tables of events and turning points between two interruptions of the compiled loop."""


class Start(NamedTuple):
    """State that a run starts from."""

    time: float
    """Time [s], which sets the phase of forces and prescribed motions."""
    q: NDArray[np.float64]
    """Modal coordinates [m kg^1/2] (mode,)."""
    v: NDArray[np.float64]
    """Modal velocities [m kg^1/2 s^-1] (mode,)."""
    offset: NDArray[np.float64]
    """Distance of each ball from its lower wall [m] (ball,), 0 to its clearance."""
    u: NDArray[np.float64]
    """Velocities of the balls in the frame at rest [m/s] (ball,)."""


class Ledger(NamedTuple):
    """Energies at the end of a run and what went in and out, each found by itself."""

    start: float
    """Kinetic energy of structure and balls and elastic energy at the start [J]."""
    end: float
    """The same at the end [J]."""
    viscous: float
    """Loss in the damping of the modes [J], integrated."""
    impacts: float
    """Loss in impacts [J], from impulses and approach speeds."""
    force_work: float
    """Work of forces [J], integrated."""
    base_work: float
    """Work of prescribed motions [J], from impulses and integrated contact forces."""

    @property
    def residual(self) -> float:
        """What does not close, over the sum of all entries [-]."""
        gain = self.start + self.force_work + self.base_work
        total = abs(self.start) + self.end + self.viscous + self.impacts + abs(self.force_work) + abs(self.base_work)
        return (gain - self.end - self.viscous - self.impacts) / total if total > 0 else 0.0


class ImpactRun(NamedTuple):
    """A motion from event to event."""

    events: NDArray[np.float64]
    """Impacts, rests and releases (event, column): see :data:`graindamp.impact.state.EVENT_COLUMNS`."""
    peaks: NDArray[np.float64]
    """Turning points of the observed displacement (turn, column): see :data:`graindamp.impact.state.PEAK_COLUMNS`."""
    time: NDArray[np.float64]
    """Times of the samples [s] (sample,)."""
    q: NDArray[np.float64]
    """Modal coordinates [m kg^1/2] (sample, mode)."""
    v: NDArray[np.float64]
    """Modal velocities [m kg^1/2 s^-1] (sample, mode)."""
    ball_position: NDArray[np.float64]
    """Positions of the balls in the frame at rest [m] (sample, ball); a cavity reaches from y to y + clearance."""
    ball_velocity: NDArray[np.float64]
    """Velocities of the balls in the frame at rest [m/s] (sample, ball)."""
    end: Start
    """State at the end, from which a further run may start."""
    resting: NDArray[np.int64]
    """Where each ball is at the end (ball,): 1 at rest on its lower wall, -1 on its upper, 0 in flight."""
    ledger: Ledger
    """Energies."""
    ended_small: bool
    """True where the run ended early because two turning points in a row lay below `until_below`."""


def at_rest(system: System, time: float = 0.0) -> Start:
    """Everything at rest in the middle, balls halfway between their walls; parts are changed by `_replace`."""
    n = system.omega_squared.size
    return Start(time, np.zeros(n), np.zeros(n), system.clearance / 2.0, np.zeros(system.mass.size))


def released(system: System, amplitude: float, mode: int = 0, ball: int = 0) -> Start:
    """A structure bent along one mode and let go, each ball on the wall that will push it.

    Args:
        system: balls on a structure.
        amplitude: displacement of the cavity of ball `ball` [m], not 0.
        mode: number of the mode, from 0.
        ball: number of the ball, from 0, whose cavity has this displacement.

    Raises:
        InputError: amplitude is 0, no such mode or ball, or the cavity lies in a node of the mode.
    """
    n = system.omega_squared.size
    if not 0 <= mode < n:
        raise InputError(f"mode is {mode}, but the structure has {n} modes, counted from 0")
    if not 0 <= ball < system.mass.size:
        raise InputError(f"ball is {ball}, but there are {system.mass.size} balls, counted from 0")
    if not (isfinite(amplitude) and amplitude != 0):
        raise InputError(f"amplitude is {amplitude}, but must be a finite number other than 0")
    if system.shape[ball, mode] == 0:
        raise InputError(f"mode {mode} does not move the cavity of ball {ball}; release another mode")
    start = at_rest(system)
    start.q[mode] = amplitude / system.shape[ball, mode]
    displaced = system.shape @ start.q
    return start._replace(offset=np.where(displaced > 0, system.clearance, 0.0))


def simulate(
    system: System,
    duration: float,
    start: Start | None = None,
    *,
    sample_rate: float = 0.0,
    observed: NDArray[np.float64] | None = None,
    until_below: float = 0.0,
) -> ImpactRun:
    """Motion of structure and balls over a time.

    Between events the motion is exact to rounding. A ball that rests on a wall moves with it as an added mass until the
    contact force vanishes. Bounces that end within a finite time are followed until they are lower than positions can
    tell.

    Args:
        system: balls on a structure or in a driven container.
        duration: time to follow [s], > 0.
        start: where to start from; default: :func:`at_rest`.
        sample_rate: samples per second [Hz], 0 for none; the first at the start.
        observed: modes in the displacement whose turning points are noted (mode,); default: that of the first cavity.
        until_below: displacement [m] that ends the run when two turning points in a row lie below it; 0 for never.

    Raises:
        InputError: an argument outside its range, a ball outside its cavity, or arrays of the wrong length.
    """
    start = at_rest(system) if start is None else start
    _check(system, duration, start, sample_rate, until_below)
    motion = _motion(system, start)
    n, nd, nb = system.omega_squared.size, system.drive_omega.size, system.mass.size
    watch_shape = system.shape[0] if observed is None else np.asarray(observed, dtype=float)
    watch_base = system.base[0] if observed is None else np.zeros(nd)
    if watch_shape.shape != (n,):
        raise InputError(f"observed has shape {watch_shape.shape}, but the structure has {n} modes: shape ({n},)")
    count = int(np.floor(duration * sample_rate * (1 + 1e-12))) + 1 if sample_rate > 0 else 0
    time = start.time + np.arange(count) / (sample_rate or 1.0)
    log = Log(
        np.zeros((TABLE_ROWS + 8 * nb, len(EVENT_COLUMNS))),
        np.zeros((TABLE_ROWS, len(PEAK_COLUMNS))),
        np.minimum(time, start.time + duration),
        np.zeros((count, n)),
        np.zeros((count, n)),
        np.zeros((count, nb)),
        np.zeros((count, nb)),
        np.zeros(3, dtype=np.int64),
    )
    rate = fastest_rate(system)
    panel = min(PANEL / rate if rate > 0 else inf, duration)
    energy = _energy(system, motion)
    scratch = scratch_for(n, nd, nb, DEGREE)
    end_time = start.time + duration
    events, peaks, code = [], [], FULL
    while code == FULL:
        code = advance(system, motion, log, scratch, end_time, panel, watch_shape, watch_base, until_below)
        events.append(log.events[: log.tally[0]].copy())
        peaks.append(log.peaks[: log.tally[1]].copy())
        log.tally[:2] = 0
    assert code != STALLED, "events without advance in time: a defect of the solver"
    used = log.tally[2]
    ledger = Ledger(
        energy,
        _energy(system, motion),
        *(float(motion.ledger[place]) for place in (VISCOUS, IMPACTS, FORCE_WORK, BASE_WORK)),
    )
    end = Start(float(motion.clock[0]), motion.q, motion.v, _offset(system, motion), motion.u)
    tables = np.concatenate(events), np.concatenate(peaks)
    samples = time[:used], log.sample_q[:used], log.sample_v[:used], log.sample_x[:used], log.sample_u[:used]
    return ImpactRun(*tables, *samples, end, motion.wall, ledger, code == SMALL)


def cavity_motion(system: System, run: ImpactRun) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Displacement [m] and velocity [m/s] of the cavities at the samples of a run (sample, ball)."""
    angle = run.time[:, None] * system.drive_omega + system.drive_phase
    displacement = run.q @ system.shape.T + np.cos(angle) @ system.base.T
    velocity = run.v @ system.shape.T - (system.drive_omega * np.sin(angle)) @ system.base.T
    return displacement, velocity


def _cavity(system: System, time: float, q: NDArray[np.float64]) -> NDArray[np.float64]:
    """Displacement of the lower wall of each cavity [m] (ball,)."""
    drives = np.cos(system.drive_omega * time + system.drive_phase)
    return np.asarray(system.shape @ q + system.base @ drives)


def _motion(system: System, start: Start) -> Motion:
    x = _cavity(system, start.time, start.q) + start.offset
    nb = system.mass.size
    return Motion(
        start.q.astype(float),
        start.v.astype(float),
        x,
        start.u.astype(float),
        np.zeros(nb, dtype=np.int64),
        np.zeros(nb, dtype=np.int64),
        np.array([start.time, 0.0, 0.0]),
        np.zeros(4),
    )


def _offset(system: System, motion: Motion) -> NDArray[np.float64]:
    offset = motion.x - _cavity(system, float(motion.clock[0]), motion.q)
    return np.asarray(np.clip(offset, 0.0, system.clearance))


def _energy(system: System, motion: Motion) -> float:
    """Kinetic energy of structure and balls, and elastic energy [J]."""
    structure = motion.v @ motion.v + motion.q @ (system.omega_squared * motion.q)
    return float(structure + motion.u @ (system.mass * motion.u)) / 2.0


def _check(system: System, duration: float, start: Start, sample_rate: float, until_below: float) -> None:
    if not (isfinite(duration) and duration > 0):
        raise InputError(f"duration is {duration} s, but must be a finite number > 0")
    for name, value in (("sample_rate", sample_rate), ("until_below", until_below)):
        if not (isfinite(value) and value >= 0):
            raise InputError(f"{name} is {value}, but must be a finite number >= 0")
    n, nb = system.omega_squared.size, system.mass.size
    for name, size in (("q", n), ("v", n), ("offset", nb), ("u", nb)):
        array = np.asarray(getattr(start, name))
        if array.shape != (size,) or not np.isfinite(array).all():
            raise InputError(f"start.{name} is {array}, but must be {size} finite numbers")
    outside = (start.offset < 0) | (start.offset > system.clearance)
    if outside.any():
        ball = int(np.flatnonzero(outside)[0])
        raise InputError(
            f"start.offset of ball {ball} is {start.offset[ball]:g} m, but its cavity allows 0 to "
            f"{system.clearance[ball]:g} m"
        )
