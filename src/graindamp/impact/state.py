"""Arrays of the event-driven solver: what stays, what moves, what is written down."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

IMPACT, STICK, RELEASE = 1, 2, 3
"""Kinds of event: a ball strikes a wall, comes to rest on it, leaves it."""
VISCOUS, IMPACTS, FORCE_WORK, BASE_WORK = 0, 1, 2, 3
"""Places in the ledger."""
EVENT_COLUMNS = ("time", "ball", "kind", "wall", "speed", "impulse", "loss")
"""Columns of the table of events: [s], number, kind, 1 lower or -1 upper, [m/s], [N s], [J]."""
PEAK_COLUMNS = ("time", "displacement", "speed")
"""Columns of the table of turning points: [s], [m], largest speed since the one before [m/s]."""


class System(NamedTuple):
    """What stays: modes q'' + D q' + omega^2 q = force z, cavities at y = shape q + base z, drives z = cos(w t + p)."""

    omega_squared: NDArray[np.float64]
    """Natural angular frequencies squared [1/s^2] (mode,)."""
    damping: NDArray[np.float64]
    """Modal damping D [1/s] (mode,)."""
    shape: NDArray[np.float64]
    """Mass-normalised shapes at the cavities [kg^-1/2] (ball, mode)."""
    mass: NDArray[np.float64]
    """Masses of the balls [kg] (ball,)."""
    clearance: NDArray[np.float64]
    """Free travel of the balls [m] (ball,)."""
    restitution: NDArray[np.float64]
    """Coefficients of restitution of ball and wall [-] (ball,)."""
    drive_omega: NDArray[np.float64]
    """Angular frequencies of the drives [rad/s] (drive,)."""
    drive_phase: NDArray[np.float64]
    """Phases of the drives at t = 0 [rad] (drive,)."""
    force: NDArray[np.float64]
    """Modal force amplitudes [m kg^1/2 s^-2] (mode, drive)."""
    base: NDArray[np.float64]
    """Amplitudes of the cavities' prescribed motion [m] (ball, drive)."""


class Motion(NamedTuple):
    """What moves; written in place."""

    q: NDArray[np.float64]
    """Modal coordinates [m kg^1/2] (mode,)."""
    v: NDArray[np.float64]
    """Modal velocities [m kg^1/2 s^-1] (mode,)."""
    x: NDArray[np.float64]
    """Positions of the balls in the frame at rest [m] (ball,); a cavity reaches from y to y + clearance."""
    u: NDArray[np.float64]
    """Velocities of the balls [m/s] (ball,)."""
    wall: NDArray[np.int64]
    """Where each ball rests (ball,): 1 on the lower wall, -1 on the upper, 0 in flight."""
    left: NDArray[np.int64]
    """Wall that each ball touches at this moment though it is in flight (ball,): 1 lower, -1 upper, twice that where it
    separates with a speed; 0 for none."""
    clock: NDArray[np.float64]
    """Time [s], sign of the observed velocity, its largest modulus since the last turning point [m/s] (3,)."""
    ledger: NDArray[np.float64]
    """Viscous loss, loss in impacts, work of forces, work of prescribed motions since the start [J] (4,)."""


class Log(NamedTuple):
    """What is written down; the columns of the tables are named above."""

    events: NDArray[np.float64]
    """Impacts, rests and releases (row, column)."""
    peaks: NDArray[np.float64]
    """Turning points of the observed displacement (row, column)."""
    sample_time: NDArray[np.float64]
    """When to sample [s] (sample,), ascending."""
    sample_q: NDArray[np.float64]
    """Modal coordinates (sample, mode)."""
    sample_v: NDArray[np.float64]
    """Modal velocities (sample, mode)."""
    sample_x: NDArray[np.float64]
    """Positions of the balls [m] (sample, ball)."""
    sample_u: NDArray[np.float64]
    """Velocities of the balls [m/s] (sample, ball)."""
    tally: NDArray[np.int64]
    """Rows in use of events, turning points and samples (3,)."""


class Scratch(NamedTuple):
    """Room for intermediate results, so that compiled code allocates nothing."""

    cq: NDArray[np.float64]
    """Coefficients of the modes (mode, degree + 1)."""
    cz: NDArray[np.float64]
    """Coefficients of the drives (drive, degree + 1)."""
    cy: NDArray[np.float64]
    """Coefficients of the cavities (ball, degree + 1)."""
    line: NDArray[np.float64]
    """Coefficients of the observed displacement, and of the function whose root is sought (2, degree + 1)."""
    modal: NDArray[np.float64]
    """Modal accelerations and their rates (2, mode)."""
    inverse_mass: NDArray[np.float64]
    """Inverse of the modal mass matrix with resting balls (mode, mode)."""
    cavity: NDArray[np.float64]
    """Displacement to jerk of the cavities, sizes of displacement to acceleration (7, ball)."""
    contact: NDArray[np.float64]
    """Separation, restitution, offset, solution and right-hand side of the contact problem (5, ball)."""
    matrix: NDArray[np.float64]
    """Matrix of the contact problem and its active part (2, ball, ball)."""
    number: NDArray[np.int64]
    """Side, members, active members and fresh contacts (4, ball)."""
    drive: NDArray[np.float64]
    """Displacement to jerk of the drives (4, drive)."""


def scratch_for(n_mode: int, n_drive: int, n_ball: int, degree: int) -> Scratch:
    """Room for a system of this size."""
    return Scratch(
        np.zeros((n_mode, degree + 1)),
        np.zeros((n_drive, degree + 1)),
        np.zeros((n_ball, degree + 1)),
        np.zeros((2, degree + 1)),
        np.zeros((2, n_mode)),
        np.zeros((n_mode, n_mode)),
        np.zeros((7, n_ball)),
        np.zeros((5, n_ball)),
        np.zeros((2, n_ball, n_ball)),
        np.zeros((4, n_ball), dtype=np.int64),
        np.zeros((4, n_drive)),
    )
