"""Gear's predictor-corrector of fifth order with variable step, as Meyer & Seifried (2023) integrate.

Positions are carried as Nordsieck arrays r_k = h^k x^(k) / k!, k = 0 to 5, spins likewise as a first-order equation.
A step predicts by Taylor's series, evaluates the forces once at the predicted state, and corrects every term in
proportion to the error of the predicted acceleration. That error also sets the next step: it shrinks at once where
a contact stiffens, and grows slowly, never while contacts begin, and never beyond what the shortest contact allows.
A step is not taken back: contacts remember, and the correction has already used the force.

Hertz's force has a discontinuous second derivative where a contact begins, which keeps the practical order near 2.5;
the scheme costs more than leapfrog for the same energy error, and is there to reproduce and to compare.

Source: Gear (1971), Numerical Initial Value Problems in Ordinary Differential Equations; coefficients of
velocity-dependent forces as in Allen & Tildesley (1987), Computer Simulation of Liquids, App. E.
"""

import numpy as np

from graindamp.dem.backend import NEW, RUNNING, close_sample, fall_due, narrow, note, renew_lists
from graindamp.dem.columns import LOSS_NORMAL, N_LEDGER
from graindamp.dem.compile import compiled, inner
from graindamp.dem.contact import find_touching, pair_forces
from graindamp.dem.energy import velocity_now
from graindamp.dem.engine import start, with_room
from graindamp.dem.motion import move
from graindamp.dem.state import Worlds
from graindamp.dem.wall_contact import wall_forces
from graindamp.status import Status

SECOND = np.array([3.0 / 16.0, 251.0 / 360.0, 1.0, 11.0 / 18.0, 1.0 / 6.0, 1.0 / 60.0])
"""Corrector of a second-order equation whose forces depend on velocity."""

FIRST = np.array([95.0 / 288.0, 1.0, 25.0 / 24.0, 35.0 / 72.0, 5.0 / 48.0, 1.0 / 120.0])
"""Corrector of a first-order equation."""

SHORTEST = 0.02
"""Shortest step over the nominal one [-]."""

LONGEST = 1.0
"""Longest step over the nominal one [-]: two thirds of the nominal step's own limit of stability at 40 steps per
contact."""


SHARE = 0.05
"""Largest smoothed friction of one contact, as a share of what stops its slip within one step [-]. The correctors are
stable up to a rate of friction times step of 0.17 for velocities and 0.09 for spins; above, slip that should end
chatters, and its losses are counted too high."""


class Gear:
    """An integrator with memory: what it needs beside the worlds lives here from one call to the next."""

    def __init__(self, tolerance: float, longest: float = LONGEST, shortest: float = SHORTEST) -> None:
        """An integrator that keeps the error of a step below `tolerance` [m], steps between two shares of the
        nominal."""
        self.tolerance, self.longest, self.shortest = tolerance, longest, shortest
        self.place = np.zeros((0, 3, 6))
        self.turn = np.zeros((0, 3, 6))
        self.power, self.before = np.zeros(N_LEDGER), np.zeros(N_LEDGER)
        self.step = 0.0

    def run(self, worlds: Worlds, n_step: int) -> Worlds:
        """The first world `n_step` nominal time steps later."""
        nominal = float(worlds.rules.time_step[0])
        worlds.rules.friction_share[0] = SHARE
        if worlds.clock.stage[0] == NEW:
            worlds = start(worlds)
        if len(self.place) == 0:
            self._begin(worlds, nominal)
        stride = int(worlds.record.stride[0])
        left = n_step
        while left > 0 and worlds.clock.status[0] == 0:
            share = min(left, stride - int(worlds.record.n_pending[0]))
            goal = float(worlds.clock.time[0]) + share * nominal
            while worlds.clock.time[0] < goal:
                control = np.array(
                    [self.step, self.tolerance, self.longest * nominal, self.shortest * nominal, nominal]
                )
                gear_advance(0, goal, worlds, self.place, self.turn, self.power, self.before, control, SECOND, FIRST)
                self.step = float(control[0])
                if not worlds.clock.status[0] & Status.LISTS_FULL:
                    break
                worlds = with_room(worlds)
                worlds.clock.status[0] &= ~int(Status.LISTS_FULL)
            worlds.record.n_pending[0] += share
            if worlds.record.n_pending[0] == stride:
                close_sample(0, int(worlds.walls.n_group[0]), worlds.record)
            left -= share
        worlds.rules.time_step[0] = nominal
        self._leave(worlds, nominal)
        return worlds

    def _begin(self, worlds: Worlds, nominal: float) -> None:
        """Arrays from positions and velocities; higher derivatives start at zero."""
        velocity, spin = velocity_now(worlds)
        n = len(velocity)
        self.step = 0.1 * nominal
        self.place, self.turn = np.zeros((n, 3, 6)), np.zeros((n, 3, 6))
        self.place[:, :, 0] = worlds.particles.position[0, :n, :3]
        self.place[:, :, 1] = velocity * self.step
        body = worlds.rules.gravity[0] - worlds.motion.acceleration[0]
        inverse = worlds.particles.inverse_mass[0, :n]
        force, torque = worlds.particles.force[0, :n], worlds.particles.torque[0, :n]
        self.place[:, :, 2] = 0.5 * self.step**2 * (force * inverse[:, :1] + body)
        self.turn[:, :, 0] = spin
        self.turn[:, :, 1] = self.step * torque * inverse[:, 1:]

    def _leave(self, worlds: Worlds, nominal: float) -> None:
        """Velocities where others look for them: half a nominal step before the positions."""
        n = len(self.place)
        body = worlds.rules.gravity[0] - worlds.motion.acceleration[0]
        inverse = worlds.particles.inverse_mass[0, :n]
        force, torque = worlds.particles.force[0, :n], worlds.particles.torque[0, :n]
        half = 0.5 * nominal
        worlds.particles.velocity[0, :n, :3] = self.place[:, :, 1] / self.step - half * (force * inverse[:, :1] + body)
        worlds.particles.spin[0, :n, :3] = self.turn[:, :, 0] - half * torque * inverse[:, 1:]


@compiled
def gear_advance(w, goal, worlds, place, turn, power, before, control, second, first):
    """Advance world w to the time `goal` [s]; `control` holds step, tolerance, longest, shortest, nominal step."""
    particles, pairs, touches, walls = worlds.particles, worlds.pairs, worlds.touches, worlds.walls
    rules, clock, motion, record, scratch = worlds.rules, worlds.clock, worlds.motion, worlds.record, worlds.scratch
    n, bounds = particles.n_particle[w], clock.drift[w]
    while clock.status[w] == 0 and (clock.time[w] < goal or clock.stage[w] != RUNNING):
        h = chosen = control[0]
        if clock.stage[w] == RUNNING:
            left = goal - clock.time[w]
            if left < 1e-6 * control[4]:
                clock.time[w] = goal
                break
            wanted = h if h < 0.999 * left else left
            if wanted > 0.5 * left and wanted < left:
                wanted = 0.5 * left
            rescale(n, wanted / h, place, turn)
            h = wanted
            control[0] = h
            rules.time_step[w] = h
            # Half of a step's weight for the forces at its start, half for those at its end.
            middle = clock.time[w] + 0.5 * h
            note(w, 0.5 * h / control[4], control[4], middle, motion, clock, walls.n_group[w], record)
            fastest = predict(w, n, h, place, turn, particles, bounds)
            clock.step[w] += 1
            clock.time[w] = goal if h == left else clock.time[w] + h
            move(w, clock.time[w], motion)
            fall_due(w, fastest, h, clock)
        if not renew_lists(w, particles, pairs, touches, walls, rules, clock, scratch):
            break
        begun = clock.counts[w, 4]
        for k in range(LOSS_NORMAL, N_LEDGER):
            before[k] = record.ledger[w, k]
        narrow(w, particles, pairs, touches, walls, rules, clock)
        find_touching(w, particles, pairs)
        pair_forces(w, clock.step[w], particles, pairs, rules, record, scratch)
        wall_forces(w, clock.step[w], particles, touches, walls, rules, record, scratch)
        # The laws count a step's loss by the power at its end; the mean of both ends is right for unequal steps.
        for k in range(LOSS_NORMAL, N_LEDGER):
            now = (record.ledger[w, k] - before[k]) / h
            record.ledger[w, k] = before[k] + 0.5 * h * (power[k] + now)
            power[k] = now
        touching = touches.n_active[w] + touches.n_soft[w]
        clock.counts[w, 4] = pairs.n_active[w] + touching
        clock.counts[w, 2] += pairs.n_active[w]
        clock.counts[w, 3] += touching
        error = correct(w, n, h, place, turn, particles, rules, motion, second, first)
        middle = clock.time[w] - 0.5 * h
        note(w, 0.5 * h / control[4], control[4], middle, motion, clock, walls.n_group[w], record)
        clock.stage[w] = RUNNING
        factor = 1.1
        if error > 0.0:
            factor = min(max(0.9 * (control[1] / error) ** 0.2, 0.3), 1.1)
        if clock.counts[w, 4] > begun:
            factor = min(factor, 1.0)
        # A step cut short to meet the goal does not make those after it short.
        base = chosen if factor >= 1.0 else h
        wanted = min(max(base * factor, control[3]), control[2])
        rescale(n, wanted / h, place, turn)
        control[0] = wanted


@inner
def rescale(n, ratio, place, turn):
    """Express the arrays in a step `ratio` times as long."""
    if ratio == 1.0:
        return
    for i in range(n):
        for c in range(3):
            power = ratio
            for k in range(1, 6):
                place[i, c, k] *= power
                turn[i, c, k] *= power
                power *= ratio


@inner
def predict(w, n, h, place, turn, particles, bounds):
    """Taylor's series to the end of the step, forces cleared. Returns the largest speed relative to the carried one
    [m/s]."""
    fastest = 0.0
    for i in range(n):
        square = 0.0
        for c in range(3):
            before, turned = place[i, c, 0], turn[i, c, 0]
            for q in (place, turn):
                for k in range(5):
                    for m in range(4, k - 1, -1):
                        q[i, c, m] += q[i, c, m + 1]
            particles.position[w, i, c] = place[i, c, 0]
            # Springs grow by the slip in the middle of the step.
            particles.velocity[w, i, c] = (place[i, c, 0] - before) / h
            particles.spin[w, i, c] = 0.5 * (turned + turn[i, c, 0])
            particles.seen[w, i, c] = place[i, c, 1] / h
            particles.seen[w, i, 4 + c] = turn[i, c, 0]
            particles.load[w, i, c] = 0.0
            particles.load[w, i, 4 + c] = 0.0
            moved = (place[i, c, 0] - before) / h - bounds[c]
            square += moved * moved
        fastest = max(fastest, square)
    # What the last correction moved is not in this; it is far below the hundredth part of a step.
    return 1.01 * fastest**0.5


@inner
def correct(w, n, h, place, turn, particles, rules, motion, second, first):
    """Correct all terms by the error of the predicted accelerations; returns the largest h^2/2 times that error [m]."""
    worst = 0.0
    for i in range(n):
        inverse, inverse_inertia = particles.inverse_mass[w, i, 0], particles.inverse_mass[w, i, 1]
        for c in range(3):
            change = particles.load[w, i, c] * inverse + rules.gravity[w, c] - motion.acceleration[w, c]
            error = 0.5 * h * h * change - place[i, c, 2]
            for k in range(6):
                place[i, c, k] += second[k] * error
            worst = max(worst, abs(error))
            error = h * particles.load[w, i, 4 + c] * inverse_inertia - turn[i, c, 1]
            for k in range(6):
                turn[i, c, k] += first[k] * error
            # What a surface moves by.
            worst = max(worst, 0.5 * h * particles.position[w, i, 3] * abs(error))
            particles.position[w, i, c] = place[i, c, 0]
    return worst
