"""Structures that carry containers: sums of modes, stepped with the particles that they shake.

Each mode obeys q'' + D q' + omega^2 q = sum of shape . force + slope * moment + participation * external force. It is
stepped as the particles are: q' lives at mid-step, and the damping force is that of the velocity in the middle between
two mid-steps, so that the scheme is of second order and exchanges momentum with the particles without any error but
rounding.
"""

from math import cos, sin
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from graindamp.dem.compile import merged, pointwise
from graindamp.dem.motion import ramp
from graindamp.dem.state import Count, Real

FORCE_HARMONIC, FORCE_SWEEP, FORCE_SERIES = 0, 1, 2
"""Kinds of external force: a sine, a sine of running frequency, samples joined by straight lines."""

FORCE_START = 0
"""Places in a row of Oscillators.force: time at which it begins [s]."""
FORCE_RAMP = 1
"""Duration of its soft start [s]."""
FORCE_DURATION = 2
"""Sweep: duration; series: sampling interval [s]."""
FORCE_AMPLITUDE = 3
"""[N]"""
FORCE_OMEGA = 4
"""Angular frequency, of a sweep the first [rad/s]."""
FORCE_OMEGA_LAST = 5
FORCE_PHASE = 6
"""[rad]"""
FORCE_LOGARITHMIC = 7
"""Sweep: 0 linear, 1 logarithmic."""
FORCE_COUNT = 8
"""Series: number of samples."""
N_FORCE_COLUMN = 9

DAMPED, FORCED = 0, 1
"""Places in a row of Oscillators.ledger: energy lost in the damping of the modes, work of the external forces [J]."""

ANGLE, TURN_RATE, TURN_CHANGE = 0, 1, 2
"""Places in a row of Oscillators.turn: angle [rad], angular velocity [rad/s], angular acceleration [rad/s^2]."""


class Oscillators(NamedTuple):
    """A batch of structures; axis 0 is the structure, or the world where that is said."""

    first: Count
    """First world that each carries; the others follow it; (structure,)."""
    n_world: Count
    """Worlds that each carries; (structure,)."""
    n_mode: Count
    """Modes of each; the rest of a row is padding; (structure,)."""
    stiffness: Real
    """omega^2 [1/s^2]; (structure, mode)."""
    damping: Real
    """D = 2 zeta omega [1/s]; (structure, mode)."""
    coordinate: Real
    """q at the time of the positions [m kg^1/2]; (structure, mode)."""
    speed: Real
    """q' at mid-step [m kg^1/2/s]; (structure, mode)."""
    change: Real
    """q'' at the time of the positions [m kg^1/2/s^2]; (structure, mode)."""
    load: Real
    """Modal force of particles and external forces [N kg^-1/2]; (structure, mode)."""
    shape: Real
    """Motion of the container's origin per modal coordinate, in the structure's axes [kg^-1/2]; (world, mode, 3)."""
    slope: Real
    """Rotation of the container about its axis per modal coordinate [rad m^-1 kg^-1/2]; (world, mode)."""
    axis: Real
    """Unit vector of that axis; (world, 3)."""
    pivot: Real
    """Place of the structure's point in the container's frame, which the container turns about [m]; (world, 3)."""
    turns: Count
    """1: the container turns; (world,)."""
    turn: Real
    """Angle, angular velocity and acceleration of the container at the time of the positions; (world, 3)."""
    force_kind: Count
    """Kind of each external force; (structure, force)."""
    force: Real
    """Its numbers, see the places above; (structure, force, N_FORCE_COLUMN)."""
    force_series: Real
    """Its samples [N]; (structure, force, sample)."""
    participation: Real
    """Modal force per external force [kg^-1/2]; (structure, force, mode)."""
    ledger: Real
    """Energies since the start, see the places above [J]; (structure, 2)."""
    series: Real
    """Samples of q [m kg^1/2] and q' [m kg^1/2/s] at the ends of strides; (structure, sample, 2, mode)."""
    n_sample: NDArray[np.int64]
    """Samples written; (structure,)."""
    step: NDArray[np.int64]
    """Steps done, -1 before the forces at the first positions are known; (structure,)."""


@pointwise
def force_at(time, kind, row, series):
    """External force at `time` [s], in [N]."""
    t = time - row[FORCE_START]
    value = 0.0
    if t >= 0.0:
        gain = ramp(t, row[FORCE_RAMP])[0]
        if kind == FORCE_HARMONIC:
            value = gain * row[FORCE_AMPLITUDE] * sin(row[FORCE_OMEGA] * t + row[FORCE_PHASE])
        elif kind == FORCE_SWEEP:
            if t <= row[FORCE_DURATION]:
                value = gain * row[FORCE_AMPLITUDE] * sin(swept_phase(t, row) + row[FORCE_PHASE])
        else:
            place = t / row[FORCE_DURATION]
            k = int(place)
            if k < row[FORCE_COUNT] - 1.0:
                value = gain * (series[k] + (place - k) * (series[k + 1] - series[k]))
    return value


@merged
def swept_phase(t, row):
    """Phase of a sweep [rad], `t` [s] after it began."""
    first, last, duration = row[FORCE_OMEGA], row[FORCE_OMEGA_LAST], row[FORCE_DURATION]
    if row[FORCE_LOGARITHMIC] > 0.5:
        rate = np.log(last / first) / duration
        return first * (np.exp(rate * t) - 1.0) / rate
    return (first + 0.5 * (last - first) * t / duration) * t


@merged
def swing(s, time_step, oscillators):
    """Kick the modes of structure s by their last accelerations and move them."""
    for k in range(oscillators.n_mode[s]):
        oscillators.speed[s, k] += time_step * oscillators.change[s, k]
        oscillators.coordinate[s, k] += time_step * oscillators.speed[s, k]


@merged
def gather(s, w, oscillators, particles, record, n_group):
    """Add the force and moment of the particles of world w to the modal forces of structure s."""
    fx, fy, fz = 0.0, 0.0, 0.0
    for g in range(n_group):
        fx += record.wall_force[w, g, 0]
        fy += record.wall_force[w, g, 1]
        fz += record.wall_force[w, g, 2]
    moment = 0.0
    if oscillators.turns[w] > 0:
        angle = 0.0
        for k in range(oscillators.n_mode[s]):
            angle += oscillators.slope[w, k] * oscillators.coordinate[s, k]
        fx, fy, fz = turned_by(angle, oscillators.axis[w], fx, fy, fz)
        moment = moment_of(w, oscillators, particles)
    for k in range(oscillators.n_mode[s]):
        shape = oscillators.shape[w, k]
        oscillators.load[s, k] += shape[0] * fx + shape[1] * fy + shape[2] * fz + oscillators.slope[w, k] * moment


@merged
def moment_of(w, oscillators, particles):
    """Moment of the particles on the container about its axis through the pivot [N m].

    Forces between particles cancel in the sum over all of them, so that what is left is the walls'.
    """
    axis, pivot = oscillators.axis[w], oscillators.pivot[w]
    mx, my, mz = 0.0, 0.0, 0.0
    for i in range(particles.n_particle[w]):
        position, load = particles.position[w, i], particles.load[w, i]
        x, y, z = position[0] - pivot[0], position[1] - pivot[1], position[2] - pivot[2]
        mx -= y * load[2] - z * load[1] + load[4]
        my -= z * load[0] - x * load[2] + load[5]
        mz -= x * load[1] - y * load[0] + load[6]
    return axis[0] * mx + axis[1] * my + axis[2] * mz


@pointwise
def turned_by(angle, axis, x, y, z):
    """A vector turned by `angle` [rad] about the unit vector `axis` (Rodrigues)."""
    a, b = cos(angle), sin(angle)
    along = (1.0 - a) * (axis[0] * x + axis[1] * y + axis[2] * z)
    return (
        a * x + b * (axis[1] * z - axis[2] * y) + along * axis[0],
        a * y + b * (axis[2] * x - axis[0] * z) + along * axis[1],
        a * z + b * (axis[0] * y - axis[1] * x) + along * axis[2],
    )


@merged
def answer(s, time, time_step, is_new, oscillators):
    """Accelerations of the modes of structure s under the forces in `load`, and its energies of this step.

    The velocity is that of mid-step, half a step ago; in the first step it is that of now, and is taken back to
    mid-step here.
    """
    half = 0.0 if is_new else 0.5 * time_step
    lost, done = 0.0, 0.0
    for k in range(oscillators.n_mode[s]):
        external = 0.0
        for f in range(oscillators.force_kind.shape[1]):
            value = force_at(
                time, oscillators.force_kind[s, f], oscillators.force[s, f], oscillators.force_series[s, f]
            )
            external += oscillators.participation[s, f, k] * value
        damping, speed = oscillators.damping[s, k], oscillators.speed[s, k]
        elastic = oscillators.stiffness[s, k] * oscillators.coordinate[s, k]
        change = (oscillators.load[s, k] + external - elastic - damping * speed) / (1.0 + half * damping)
        now = speed + half * change
        oscillators.change[s, k] = change
        if is_new:
            oscillators.speed[s, k] -= 0.5 * time_step * change
        else:
            lost += damping * now * now
            done += external * now
        oscillators.load[s, k] = 0.0
    oscillators.ledger[s, DAMPED] += time_step * lost
    oscillators.ledger[s, FORCED] += time_step * done


@merged
def carry_container(s, w, time_step, oscillators, rules, motion):
    """Motion of the container of world w at the time of the positions, in its own axes.

    Gravity turns with a container that turns; the difference is put into the acceleration, which the particles feel
    together with gravity.
    """
    place, speed, change = motion.displacement[w], motion.velocity[w], motion.acceleration[w]
    for c in range(3):
        place[c], speed[c], change[c] = 0.0, 0.0, 0.0
    angle, rate, rate_change = 0.0, 0.0, 0.0
    for k in range(oscillators.n_mode[s]):
        now = oscillators.speed[s, k] + 0.5 * time_step * oscillators.change[s, k]
        for c in range(3):
            shape = oscillators.shape[w, k, c]
            place[c] += shape * oscillators.coordinate[s, k]
            speed[c] += shape * now
            change[c] += shape * oscillators.change[s, k]
        angle += oscillators.slope[w, k] * oscillators.coordinate[s, k]
        rate += oscillators.slope[w, k] * now
        rate_change += oscillators.slope[w, k] * oscillators.change[s, k]
    if oscillators.turns[w] > 0:
        turn, axis, gravity = oscillators.turn[w], oscillators.axis[w], rules.gravity[w]
        turn[ANGLE], turn[TURN_RATE], turn[TURN_CHANGE] = angle, rate, rate_change
        x, y, z = turned_by(-angle, axis, gravity[0] - change[0], gravity[1] - change[1], gravity[2] - change[2])
        change[0], change[1], change[2] = gravity[0] - x, gravity[1] - y, gravity[2] - z
        x, y, z = turned_by(-angle, axis, speed[0], speed[1], speed[2])
        speed[0], speed[1], speed[2] = x, y, z


@merged
def swirl(w, oscillators, particles):
    """Add the Coriolis, Euler and centrifugal forces of a turning container, and their torques, to the loads."""
    axis, pivot, turn = oscillators.axis[w], oscillators.pivot[w], oscillators.turn[w]
    ox, oy, oz = turn[TURN_RATE] * axis[0], turn[TURN_RATE] * axis[1], turn[TURN_RATE] * axis[2]
    ax, ay, az = turn[TURN_CHANGE] * axis[0], turn[TURN_CHANGE] * axis[1], turn[TURN_CHANGE] * axis[2]
    for i in range(particles.n_particle[w]):
        position, seen, load = particles.position[w, i], particles.seen[w, i], particles.load[w, i]
        mass, inertia = 1.0 / particles.inverse_mass[w, i, 0], 1.0 / particles.inverse_mass[w, i, 1]
        x, y, z = position[0] - pivot[0], position[1] - pivot[1], position[2] - pivot[2]
        # Twice the velocity in the frame and the velocity of the frame turn with omega.
        u = 2.0 * seen[0] + oy * z - oz * y
        v = 2.0 * seen[1] + oz * x - ox * z
        q = 2.0 * seen[2] + ox * y - oy * x
        load[0] -= mass * (oy * q - oz * v + ay * z - az * y)
        load[1] -= mass * (oz * u - ox * q + az * x - ax * z)
        load[2] -= mass * (ox * v - oy * u + ax * y - ay * x)
        load[4] -= inertia * (ax + oy * seen[6] - oz * seen[5])
        load[5] -= inertia * (ay + oz * seen[4] - ox * seen[6])
        load[6] -= inertia * (az + ox * seen[5] - oy * seen[4])


@merged
def sample(s, time_step, stride, oscillators):
    """Write the modes of structure s down where a stride ends."""
    if oscillators.step[s] % stride == 0 and oscillators.n_sample[s] < oscillators.series.shape[1]:
        row = oscillators.series[s, oscillators.n_sample[s]]
        for k in range(oscillators.n_mode[s]):
            row[0, k] = oscillators.coordinate[s, k]
            row[1, k] = oscillators.speed[s, k] + 0.5 * time_step * oscillators.change[s, k]
        oscillators.n_sample[s] += 1


def empty_oscillators(
    n_structure: int, n_world: int, n_mode: int, n_force: int, n_force_sample: int, n_sample: int
) -> Oscillators:
    """Structures at rest without stiffness, damping, forces and containers."""
    integer: dict[str, Any] = {"dtype": np.int32}
    return Oscillators(
        first=np.zeros(n_structure, **integer),
        n_world=np.zeros(n_structure, **integer),
        n_mode=np.full(n_structure, n_mode, **integer),
        stiffness=np.zeros((n_structure, n_mode)),
        damping=np.zeros((n_structure, n_mode)),
        coordinate=np.zeros((n_structure, n_mode)),
        speed=np.zeros((n_structure, n_mode)),
        change=np.zeros((n_structure, n_mode)),
        load=np.zeros((n_structure, n_mode)),
        shape=np.zeros((n_world, n_mode, 3)),
        slope=np.zeros((n_world, n_mode)),
        axis=np.tile([0.0, 0.0, 1.0], (n_world, 1)),
        pivot=np.zeros((n_world, 3)),
        turns=np.zeros(n_world, **integer),
        turn=np.zeros((n_world, 3)),
        force_kind=np.zeros((n_structure, n_force), **integer),
        force=np.zeros((n_structure, n_force, N_FORCE_COLUMN)),
        force_series=np.zeros((n_structure, n_force, n_force_sample)),
        participation=np.zeros((n_structure, n_force, n_mode)),
        ledger=np.zeros((n_structure, 2)),
        series=np.zeros((n_structure, n_sample, 2, n_mode)),
        n_sample=np.zeros(n_structure, np.int64),
        step=np.full(n_structure, -1, np.int64),
    )
