"""Single-body closed forms of the complex effective mass: the bed moves as one rigid block.

Each function gives one point of the field, M / m_bed = m' - i eta, for a container that moves as x = X sin(Omega t).
For a periodic motion of the bed M / m_bed is the fundamental of the bed's acceleration, impulses included, over the
acceleration of the container, so eta and m' both follow from the trajectory. Inside this module length is measured in
X and time in 1 / Omega: the container is at sin(phase), and its acceleration -sin(phase) has the complex amplitude i.
"""

from cmath import exp as cexp
from collections.abc import Callable
from math import acos, asin, atan2, ceil, cos, inf, isfinite, nan, pi, sin, sqrt
from typing import NamedTuple

from graindamp.errors import InputError

PHASE_TOLERANCE = 1e-10
"""Take-off phases closer than this [rad] are the same one; root finding is good to about 1e-12."""
MAX_FLIGHTS, TRANSIENT_FLIGHTS = 3000, 500
"""Flights followed in search of a repetition, and those left out of the average when there is none."""
MAX_INTENSITY = 1e4
"""Above it flights last thousands of cycles, each of which has to be looked at [-]."""


class TheoryPoint(NamedTuple):
    """One point of a closed-form field; both numbers are NaN where the assumed motion does not exist."""

    loss_factor: float
    """Loss factor eta [-]: dissipated energy per radian over the kinetic energy m_bed V^2 / 2."""
    effective_mass_ratio: float
    """In-phase effective mass over bed mass m' [-]; may be negative."""
    exists: bool
    """True where the assumed motion is possible; says nothing about its stability."""
    branch: str
    """Name of the assumed motion."""


class ForcePeak(NamedTuple):
    """Largest damping force of the plastic collect-and-collide motion, and where it occurs."""

    force_ratio: float
    """Largest (X / X_opt) eta [-]."""
    stroke_ratio: float
    """X / X_opt at which it occurs [-]."""


def frozen_bed() -> TheoryPoint:
    """Complex effective mass of a bed that never moves against its container: eta = 0, m' = 1 [-]."""
    return TheoryPoint(0.0, 1.0, True, "stuck")


def collect_and_collide(stroke_ratio: float, restitution: float = 0.0) -> TheoryPoint:
    """Complex effective mass of a bed thrown from wall to wall twice per cycle, without gravity and friction [-].

    Branch "plastic" (R = 0 and X >= X_opt): the bed leaves a wall at its greatest speed V, strikes the other one at
    phase phi, phi - sin(phi) = h / X, and rests there until that wall has its greatest speed:

        eta = (1 - cos phi)^2 / pi,   m' = (2 / pi) [(1 - cos phi) sin phi + (pi - phi + sin phi cos phi) / 2].

    Branch "symmetric-two-impact" (otherwise): the bed rebounds at once, at half-cycle intervals. With
    K = (1 + R) / (1 - R), the wall's displacement X s and velocity V c at impact obey pi K |c| = h / X + 2 s, and

        eta = (4 K / pi) c^2,   m' = (4 K / pi) |c| s.

    It exists from :func:`stroke_ratio_min` to :func:`stroke_ratio_max`, and is stable only below
    :func:`stroke_ratio_stable_max`. Other motions may coexist, such as that of a bed caught without impact at
    X = X_opt / 2, any R, which repeats after three cycles: eta = 0, m' = 1/3, and for R = 0 those of
    :func:`subharmonic_collide`. Above stroke_ratio_max a small R leads to
    a burst of impacts and rest; event-driven runs then have the plastic eta of R = 0 within 1 % for R <= 0.1, 3 % for
    R = 0.2, 7 % for R = 0.3.

    Args:
        stroke_ratio: X / X_opt with X_opt = h / pi, h the clearance [-], > 0. Exactly 1 is a grazing point for R = 0.
        restitution: coefficient of restitution R of bed and wall [-], 0 <= R < 1.

    Raises:
        InputError: an argument outside its range.

    Source: Bannerman et al. (2011), Phys. Rev. E 84, 011301, and Sack et al. (2013), Phys. Rev. Lett. 111, 018001, for
    the plastic bed; the limit of a driven container of Masri & Caughey (1966), J. Appl. Mech. 33, 586, for any R. m' is
    derived here.
    """
    _check("stroke_ratio", stroke_ratio, stroke_ratio > 0, "> 0")
    _check_restitution(restitution)
    if restitution == 0.0 and stroke_ratio >= 1.0:
        return _plastic(stroke_ratio)
    exists = stroke_ratio_min(restitution) <= stroke_ratio <= stroke_ratio_max(restitution)
    if not exists:
        return TheoryPoint(nan, nan, False, "symmetric-two-impact")
    gain = _gain(restitution)
    psi = acos(stroke_ratio_min(restitution) / stroke_ratio) - atan2(2.0, pi * gain)
    scale = 4.0 * gain / pi * cos(psi)
    return TheoryPoint(scale * cos(psi), scale * sin(psi), True, "symmetric-two-impact")


def subharmonic_collide(stroke_ratio: float, half_cycles: int = 3) -> TheoryPoint:
    """Complex effective mass of a plastic bed that needs several half cycles from wall to wall [-].

    The bed leaves a wall at its greatest speed, strikes the other one at phase phi, (n - 1) pi <= phi <= n pi, and
    rests there until that wall, n half cycles after the first, has its greatest speed. With phi - sin(phi) = pi / r,

        eta = (1 - cos phi)^2 / (n pi),   m' = (2 / n pi) [(1 - cos phi) sin phi + (n pi - phi + sin phi cos phi) / 2].

    It exists for 1 / n <= r <= 1 / (n - 1), repeats after n cycles, and forgets how it began, as
    :func:`collect_and_collide` for R = 0, which is n = 1. From r = 1 / n, where eta = 4 / (n pi), eta falls to 0 at
    1 / (n - 1), where the bed is caught without impact. Between these ranges a body strikes a wall that then draws
    back, twice in a row or without repetition.

    Args:
        stroke_ratio: X / X_opt with X_opt = h / pi, h the clearance [-], > 0.
        half_cycles: n, odd: 3, 5, ...; with an even number bed and container would not be mirrored.

    Raises:
        InputError: an argument outside its range.

    Source: derived here, as :func:`collect_and_collide` for R = 0.
    """
    _check("stroke_ratio", stroke_ratio, stroke_ratio > 0, "> 0")
    _check("half_cycles", half_cycles, half_cycles >= 3 and half_cycles % 2 == 1, "that is odd and 3 or more")
    if not 1.0 / half_cycles <= stroke_ratio <= 1.0 / (half_cycles - 1):
        return TheoryPoint(nan, nan, False, f"plastic-{half_cycles}")
    return _plastic(stroke_ratio, half_cycles)


def stroke_ratio_best(restitution: float = 0.0) -> float:
    """X / X_opt of the largest loss factor of collect-and-collide [-]: (1 - R) / (1 + R).

    There the walls meet the bed at their greatest speed, eta = (4 / pi) (1 + R) / (1 - R), and m' = 0.

    Args:
        restitution: coefficient of restitution R of bed and wall [-], 0 <= R < 1.
    """
    _check_restitution(restitution)
    return 1.0 / _gain(restitution)


def stroke_ratio_min(restitution: float = 0.0) -> float:
    """X / X_opt below which the bed cannot cross the clearance in half a cycle [-].

    A fold: eta does not fall to zero there, it jumps to that of another, weaker motion.

    Args:
        restitution: coefficient of restitution R of bed and wall [-], 0 <= R < 1.
    """
    _check_restitution(restitution)
    return 1.0 / sqrt(_gain(restitution) ** 2 + 4.0 / pi**2)


def stroke_ratio_max(restitution: float = 0.0) -> float:
    """X / X_opt above which the wall catches up with the bed it has just thrown [-]; inf for R = 0, whose bed rests.

    In the symmetric two-impact motion the distance to the wall just left is, at phase sigma after the impact,
    u sigma + sin(psi - sigma) - sin(psi), with the bed's speed u = K cos(psi) and sin(psi) = s. Where u < 1 it has a
    minimum at sigma = psi + acos(u). That minimum is a concave function of psi, positive where u = 1 and negative as
    the clearance vanishes, so the limit is its one root. The opposite wall is never nearer than this one. The limit
    is finite for every R > 0: it falls towards 1 as R goes to 0. Up to 10 % below it a motion with a second, weak
    impact on the same wall coexists or takes over; its eta is within 3 %.

    Args:
        restitution: coefficient of restitution R of bed and wall [-], 0 <= R < 1.
    """
    _check_restitution(restitution)
    if restitution == 0.0:
        return inf
    gain = _gain(restitution)

    def least_gap(psi: float) -> float:
        speed = min(1.0, gain * cos(psi))
        sigma = psi + acos(speed)
        return speed * sigma - sin(sigma - psi) - sin(psi)

    psi = _root(least_gap, acos(1.0 / gain), pi / 2 - atan2(2.0, pi * gain))
    return float(1.0 / (gain * cos(psi) - 2.0 / pi * sin(psi)))


def stroke_ratio_stable_max(restitution: float = 0.0) -> float:
    """X / X_opt above which the symmetric two-impact motion is unstable [-]; inf for R = 0, whose bed forgets at rest.

    The map from one impact to the next, mirrored, has trace 2 R - (pi / 2) (1 - R^2) tan(psi) and determinant R^2, with
    tan(psi) = s / |c|. It is stable from the fold at :func:`stroke_ratio_min` up to tan(psi) = 2 K / pi, where two
    unequal flights per cycle take over. Event-driven runs from there to :func:`stroke_ratio_max` have the symmetric eta
    within 2 % for R <= 0.2, 5 % for R = 0.3, 12 % for R = 0.5, 26 % for R = 0.8. For R < 0.08 the limit lies above
    stroke_ratio_max and plays no part.

    Args:
        restitution: coefficient of restitution R of bed and wall [-], 0 <= R < 1.
    """
    _check_restitution(restitution)
    if restitution == 0.0:
        return inf
    gain = _gain(restitution)
    return sqrt(pi**2 + 4.0 * gain**2) / (gain * (pi - 4.0 / pi))


def peak_force_ratio() -> ForcePeak:
    """Largest (X / X_opt) eta of the plastic collect-and-collide motion, and its X / X_opt [-].

    Beyond this stroke eta falls faster than 1 / X: a larger amplitude is held by a smaller force.
    With r = pi / (phi - sin phi), r eta = (1 - cos phi)^2 / (phi - sin phi) is largest where
    2 sin(phi) (phi - sin phi) = (1 - cos phi)^2.
    """
    phi = _root(lambda p: 2.0 * sin(p) * (p - sin(p)) - (1.0 - cos(p)) ** 2, 1.0, pi)
    return ForcePeak((1.0 - cos(phi)) ** 2 / (phi - sin(phi)), pi / (phi - sin(phi)))


def collect_and_collide_force_limit(
    bed_mass: float, clearance: float, frequency: float, shape_ratio: float = 1.0
) -> float:
    """Largest amplitude of a driving force that an ideal plastic damper can hold alone at resonance [N].

    At resonance, without structural damping, the force amplitude is m_bed eta Omega^2 X |phi_damper / phi_force|. No
    steady amplitude exists for a larger force.

    Args:
        bed_mass: mass of all particles [kg], > 0.
        clearance: free travel h of the bed [m], > 0.
        frequency: frequency of the resonance [Hz], > 0.
        shape_ratio: mode shape at the damper over that at the driving force, modulus [-], > 0.

    Raises:
        InputError: an argument outside its range.

    Source: derived from the equilibrium of Meyer & Seifried (2021), Granular Matter 23, Eqs 14-17, with D_k = 0.
    """
    for name, value in (
        ("bed_mass", bed_mass),
        ("clearance", clearance),
        ("frequency", frequency),
        ("shape_ratio", shape_ratio),
    ):
        _check(name, value, value > 0, "> 0")
    omega = 2.0 * pi * frequency
    return peak_force_ratio().force_ratio * bed_mass * clearance / pi * omega**2 * shape_ratio


def sliding_bed(intensity: float, friction: float) -> TheoryPoint:
    """Complex effective mass of a block on a horizontally shaken floor with Coulomb friction, walls out of reach [-].

    With lambda = Gamma / mu: "stuck" up to 1, "stick-slip" up to sqrt(1 + pi^2 / 4) = 1.862, where the end of a slip is
    the one root found numerically, then "slip" without rest, eta = 4 / (pi lambda) sqrt(1 - (pi / 2 lambda)^2) and
    m' = 2 / lambda^2. Static and sliding friction are the same.

    Args:
        intensity: Gamma, acceleration amplitude of the floor over gravity [-], > 0.
        friction: coefficient of friction mu [-], > 0.

    Raises:
        InputError: an argument outside its range.

    Source: Westermo & Udwadia (1983), Earthq. Eng. Struct. Dyn. 11, 135-146, for the motion; Fourier integrals here.
    """
    _check("intensity", intensity, intensity > 0, "> 0")
    _check("friction", friction, friction > 0, "> 0")
    drag = friction / intensity  # deceleration of the sliding block, in units of the floor's acceleration amplitude
    if drag >= 1.0:
        return frozen_bed()
    if drag <= 1.0 / sqrt(1.0 + pi**2 / 4.0):
        in_phase = pi * drag / 2.0  # cosine of the phase at which block and floor have the same velocity
        scale = 4.0 * drag / pi
        return TheoryPoint(scale * sqrt(1.0 - in_phase**2), scale * in_phase, True, "slip")
    onset = asin(drag)
    # Until pi - onset the block gains on the floor; slip ends before the floor pulls the other way at pi + onset.
    end = _root(lambda p: cos(onset) - drag * (p - onset) - cos(p), pi - onset, pi + onset)
    half_cycle = -_constant(drag, onset, end) + _following(end, onset + pi)
    return _point(2.0 / pi * half_cycle, "stick-slip")


def bouncing_bed_vertical(intensity: float) -> TheoryPoint:
    """Complex effective mass of a plastic bed (R = 0) on a vertically shaken floor without lid [-].

    The bed starts at rest on the floor, leaves it at sin(phase) = 1 / Gamma, and is followed from flight to flight. It
    takes the floor's velocity when it lands: if the floor then falls faster than the bed, the next flight begins at
    once, else the bed rides to the next take-off, which makes the motion periodic. Branch "stuck" for Gamma <= 1, else
    "period-1", "period-2", ..., repeating after that many cycles, or "irregular": no repetition within
    :data:`MAX_FLIGHTS` flights, given as the mean over all but the first :data:`TRANSIENT_FLIGHTS`.

    Args:
        intensity: Gamma, acceleration amplitude of the floor over gravity [-], > 0, at most :data:`MAX_INTENSITY`.

    Raises:
        InputError: an argument outside its range.

    Source: Mehta & Luck (1990), Phys. Rev. Lett. 65, 393-396, for the motion; complex effective mass derived here.
    """
    _check("intensity", intensity, 0 < intensity <= MAX_INTENSITY, f"> 0, at most {MAX_INTENSITY:g}")
    if intensity <= 1.0:
        return frozen_bed()
    gravity = 1.0 / intensity
    phase = asin(gravity)
    phases, transfers, durations = [phase], [0j], [0.0]
    first = TRANSIENT_FLIGHTS
    branch = "irregular"
    for _ in range(MAX_FLIGHTS):
        after, transfer = _flight(phase, gravity)
        transfers.append(transfers[-1] + transfer)
        durations.append(durations[-1] + after - phase)
        phase = after % (2.0 * pi)
        distances = [abs(earlier - phase) for earlier in phases]
        phases.append(phase)
        if min(distances) < PHASE_TOLERANCE:
            # A phase that overshoots its limit by turns comes close to the last but one before it does to the last.
            first = max(i for i, distance in enumerate(distances) if distance < 1e3 * PHASE_TOLERANCE)
            branch = f"period-{round((durations[-1] - durations[first]) / (2.0 * pi))}"
            break
    return _point(2.0 * (transfers[-1] - transfers[first]) / (durations[-1] - durations[first]), branch)


def _plastic(stroke_ratio: float, half_cycles: int = 1) -> TheoryPoint:
    """Bed that is thrown, and rests, every so many half cycles; its impact comes in the last of them."""
    period = half_cycles * pi
    # phi - sin(phi) increases, and exceeds every h / X <= n pi at n pi + 1.
    phi = _root(lambda p: p - sin(p) - pi / stroke_ratio, 0.0, period + 1.0)
    jump = 1.0 - cos(phi)
    in_phase = 2.0 / period * (jump * sin(phi) + (period - phi + sin(phi) * cos(phi)) / 2.0)
    return TheoryPoint(jump**2 / period, in_phase, True, "plastic" if half_cycles == 1 else f"plastic-{half_cycles}")


def _flight(takeoff: float, gravity: float) -> tuple[float, complex]:
    """Phase of the next take-off, and the integral of floor force times exp(-i phase) from take-off to take-off."""
    rise, fall = asin(gravity), pi - asin(gravity)
    landing = _landing(takeoff, gravity)
    transfer = (cos(landing) - cos(takeoff) + gravity * (landing - takeoff)) * cexp(-1j * landing)
    if rise <= landing % (2.0 * pi) < fall - PHASE_TOLERANCE:
        return landing, transfer
    after = rise + 2.0 * pi * ceil((landing - rise) / (2.0 * pi))
    return after, transfer + _constant(gravity, landing, after) + _following(landing, after)


def _landing(takeoff: float, gravity: float) -> float:
    """Phase of the first contact after `takeoff`, itself between asin(gravity) and pi - asin(gravity).

    Between these phases, in every cycle, the floor falls faster than the bed and the height of the bed above it is
    convex; elsewhere it is concave. On a concave stretch a change of sign is the first contact, on a convex one the
    lowest point decides. So no contact is missed, however shallow.
    """

    def height(phase: float) -> float:
        flight = phase - takeoff
        return sin(takeoff) + cos(takeoff) * flight - gravity * flight**2 / 2.0 - sin(phase)

    def slope(phase: float) -> float:
        return cos(takeoff) - gravity * (phase - takeoff) - cos(phase)

    convex = pi - 2.0 * asin(gravity)
    left = pi - asin(gravity)  # up to here the bed only gains height
    if height(left) <= 0.0:
        return left  # a flight lower than the rounding of the height
    while True:
        right = left + 2.0 * pi - convex
        if height(right) <= 0.0:
            return _root(height, left, right)
        left, right = right, right + convex
        if slope(left) < 0.0:
            lowest = right if slope(right) <= 0.0 else _root(slope, left, right)
            if height(lowest) <= 0.0:
                return _root(height, left, lowest)
        left = right


def _root(function: Callable[[float], float], low: float, high: float) -> float:
    """Where a function changes its sign, to rounding."""
    from scipy.optimize import brentq  # takes far longer to load than a rule to evaluate

    return float(brentq(function, low, high, xtol=1e-14))


def _constant(value: float, start: float, end: float) -> complex:
    """Integral of value exp(-i phase)."""
    return 1j * value * (cexp(-1j * end) - cexp(-1j * start))


def _following(start: float, end: float) -> complex:
    """Integral of -sin(phase) exp(-i phase): the bed moves with the container."""
    real = (sin(start) ** 2 - sin(end) ** 2) / 2.0
    return complex(real, (end - start) / 2.0 - (sin(2.0 * end) - sin(2.0 * start)) / 4.0)


def _point(acceleration: complex, branch: str) -> TheoryPoint:
    """Point of a bed whose acceleration has this complex amplitude; the container's is i."""
    ratio = acceleration / 1j
    return TheoryPoint(-ratio.imag, ratio.real, True, branch)


def _gain(restitution: float) -> float:
    """Speed K of a bed that rebounds steadily between two approaching walls, over the speed of the walls [-]."""
    return (1.0 + restitution) / (1.0 - restitution)


def _check(name: str, value: float, allowed: bool, text: str) -> None:
    if not (isfinite(value) and allowed):
        raise InputError(f"{name} is {value}, but must be a finite number {text}")


def _check_restitution(restitution: float) -> None:
    _check("restitution", restitution, 0.0 <= restitution < 1.0, ">= 0 and < 1")
