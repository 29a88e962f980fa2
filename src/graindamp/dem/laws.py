"""Contact laws: functions of scalars that know neither particles nor worlds.

Overlap and overlap rate are positive while pressing in; a normal force is positive when it pushes apart. Every law
takes the constants that were found when the contact began (see :mod:`graindamp.dem.grip`), so that a step costs no
look-up."""

from enum import IntEnum
from math import pi, sqrt, tanh

from graindamp.dem.compile import pointwise


class NormalLaw(IntEnum):
    """Normal force of a contact."""

    HERTZ_GONTHIER = 0
    HERTZ_VISCOELASTIC = 1
    LINEAR = 2
    FOAM = 3


class TangentialLaw(IntEnum):
    """Tangential force of a contact."""

    NONE = 0
    TANH = 1
    MINDLIN = 2
    LINEAR = 3


DASHPOT_SHARE = 0.25
"""Largest dashpot of one contact, as a share of reduced mass over time step [-]. A dashpot of once that value stops
the approach within a step; a particle may have a dozen contacts, and a quarter keeps all of them together from
reversing it. With 40 steps per contact it binds for restitutions below 0.1 (0.05 becomes 0.076); 0.05 is right from 80
steps on, 0.01 from 150."""

FRICTION_SHARE = 0.25
"""Largest smoothed friction of one contact, as a share of what stops its slip within one step [-]; as DASHPOT_SHARE.
For velocity Verlet; :mod:`graindamp.dem.gear` has its own."""

SLIP_MASS = 2.0 / 7.0
"""Mass that resists slip at the surface of a solid sphere, over the mass that resists approach [-]: 1 / (1 + 5/2)."""


@pointwise
def elastic_hertz(overlap, stiffness):
    """Elastic force k d^1.5 of two spheres, or of sphere and wall [N]. Source: Hertz (1882), J. reine angew. Math.
    92."""
    return stiffness * overlap * sqrt(overlap)


@pointwise
def normal_gonthier(elastic, overlap_rate, damping, least, dashpot_limit):
    """Hertz force with damping set by restitution and the speed at onset [N], never attractive.

    F = F_el max(1 - d, 1 + (d/e) rate / onset), with `damping` = d / (e onset) [s/m] and `least` = 1 - d [-]. In a
    free impact the bracket reaches 1 - d just as the bodies part; the bound keeps a contact that others drive apart
    faster from losing more. The dashpot F_el d / (e onset) [N s/m] is held below `dashpot_limit`.

    Source: Gonthier et al. (2004), Multibody Syst. Dyn. 11, 209-233.
    """
    dashpot = min(elastic * damping, dashpot_limit)
    return max(elastic * least, elastic + dashpot * overlap_rate)


@pointwise
def normal_viscous(elastic, dashpot, overlap_rate, dashpot_limit, tension):
    """Elastic force with a dashpot [N s/m], held below `dashpot_limit`; without `tension` never attractive [N].

    Source: Cundall & Strack (1979), Geotechnique 29, 47-65 (linear); Tsuji et al. (1992), Powder Technol. 71, 239-250
    (Hertz)."""
    force = elastic + min(dashpot, dashpot_limit) * overlap_rate
    return force if tension else max(force, force - force)


@pointwise
def friction_smoothed(force, friction, slip_square, smoothing, limit):
    """Friction over slip of the Coulomb law smoothed by tanh [N s/m]; `limit` is what cannot reverse the slip in a
    step.

    mu F tanh(tau v) / v, from the square of the slip v [m^2/s^2]. There is no rest: under a tangential load T < mu F
    a contact creeps at artanh(T / mu F) / tau. tanh(x)/x is a quotient of two polynomials in x^2, right to 3e-9,
    below x = 10 and 1/x above, where tanh is within 4e-9 of 1: one division and no call, since half of all contacts
    slip that slowly.

    Source: Andersson et al. (2007), Tribol. Int. 40, 580-587; Meyer & Seifried (2023), Eq. 10.
    """
    y = smoothing * smoothing * slip_square
    p = 0.9999999971033622 + y * (
        0.13737036786046317 + y * (0.003947166544888554 + y * (3.0273728483390063e-05 + y * 4.6272176706509456e-08))
    )
    q = 1.0 + y * (
        0.47070367468728674
        + y
        * (
            0.02751509860431106
            + y * (0.00040970899726356887 + y * (1.5167736121974307e-06 + y * 6.488778121087068e-10))
        )
    )
    above = 1.0 if y > 100.0 else p
    below = sqrt(y) if y > 100.0 else q
    return min(friction * force * smoothing * above / below, limit)


@pointwise
def normal_force(law, overlap, overlap_rate, stiffness, damping, least, dashpot_limit, tension):
    """Normal force of law `law` and the elastic part of it [N]; arguments as the laws it chooses from."""
    if law == NormalLaw.HERTZ_GONTHIER:
        elastic = elastic_hertz(overlap, stiffness)
        normal = normal_gonthier(elastic, overlap_rate, damping, least, dashpot_limit)
    elif law == NormalLaw.HERTZ_VISCOELASTIC:
        elastic = elastic_hertz(overlap, stiffness)
        normal = normal_viscous(elastic, damping * sqrt(sqrt(overlap)), overlap_rate, dashpot_limit, tension)
    else:
        elastic = stiffness * overlap
        normal = normal_viscous(elastic, damping, overlap_rate, dashpot_limit, tension)
    return normal, elastic


@pointwise
def dashpot_of(law, overlap, elastic, damping, dashpot_limit):
    """Dashpot of the normal law [N s/m], which a spring's tangential dashpot is a fraction of."""
    if law == NormalLaw.HERTZ_GONTHIER:
        dashpot = elastic * damping
    elif law == NormalLaw.HERTZ_VISCOELASTIC:
        dashpot = damping * sqrt(sqrt(overlap))
    else:
        dashpot = damping
    return min(dashpot, dashpot_limit)


@pointwise
def foam_force(overlap, overlap_rate, first, second, third, loss_factor, turn_speed):
    """Force of foam on one particle and its elastic part [N], from the compression [m] of the foam at the particle.

    Elastic: c1 x + c2 x^2 + c3 x^3 (Wong & Rongong 2009, Eq. 16). Loss: a share (pi/4) of the loss factor of the
    elastic force, against the motion, whatever its rate; a cycle between 0 and 2a on a linear spring then loses pi
    eta k a^2, as the loss factor demands. tanh(rate / turn_speed) turns it round."""
    elastic = overlap * (first + overlap * (second + overlap * third))
    return elastic * (1.0 + 0.25 * pi * loss_factor * tanh(overlap_rate / turn_speed)), elastic
