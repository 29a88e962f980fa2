"""Tangential springs with memory, and rolling resistance: what needs more than the slip of this instant."""

from math import sqrt

from graindamp.dem.compile import inner, pointwise

SMALLEST = 1e-300
"""Guard against division by zero, far below every force, stiffness and speed."""


@pointwise
def spring_force(px, py, pz, before, x, y, z, u, v, s, du, dv, ds, stiffness, dashpot, bound, time_step):
    """Tangential force limited by Coulomb (3) [N], force of the spring to remember (3) [N], power dissipated [W].

    The spring's force (px, py, pz) and stiffness `before` are those of the last step. The force is turned into the
    present tangent plane (normal x, y, z) and grows by stiffness times the slip in the middle of the step (du, dv, ds),
    which makes it of second order; dashpot and power see the present slip (u, v, s). Where the stiffness has dropped
    since, as in a Hertz contact that unloads, the force drops with it, so that force over stiffness changes by the slip
    alone; where it has grown, its mean counts. Energy is lost and never made.

    Source: Mindlin & Deresiewicz (1953), J. Appl. Mech. 20, 327-344, in the form of Thornton, Cummins & Cleary
    (2013), Powder Technol. 233, 30-46; Cundall & Strack (1979), Geotechnique 29, 47-65.
    """
    size = px * px + py * py + pz * pz
    before = max(before, SMALLEST)
    energy = -0.5 * size / before
    along = px * x + py * y + pz * z
    px, py, pz = px - along * x, py - along * y, pz - along * z
    keep = sqrt(size / max(px * px + py * py + pz * pz, SMALLEST)) * min(stiffness / before, 1.0)
    grow = 0.5 * (stiffness + min(stiffness, before)) * time_step
    px, py, pz = keep * px - grow * du, keep * py - grow * dv, keep * pz - grow * ds
    fx, fy, fz = px - dashpot * u, py - dashpot * v, pz - dashpot * s
    share = min(bound / sqrt(max(fx * fx + fy * fy + fz * fz, SMALLEST)), 1.0)
    fx, fy, fz = share * fx, share * fy, share * fz
    size = sqrt(max(px * px + py * py + pz * pz, SMALLEST))
    share *= min(bound / max(share * size, SMALLEST), 1.0)
    px, py, pz = share * px, share * py, share * pz
    energy += 0.5 * (px * px + py * py + pz * pz) / max(stiffness, SMALLEST)
    loss = -(fx * u + fy * v + fz * s) - energy / time_step
    return fx, fy, fz, px, py, pz, loss


@inner
def rolling_torque(x, y, z, wx, wy, wz, normal, coefficient, radius, inertia_limit):
    """Torque against the relative rolling of two bodies [N m], and rolling speed squared times its slope [W].

    Constant torque mu_r R F_n against the relative spin (wx, wy, wz) without its part about the normal, smoothed so
    that it does not turn the spin round within a step (`inertia_limit` [N m s]). Source: Zhou et al. (1999), Physica
    A 269, 536-553."""
    about = wx * x + wy * y + wz * z
    wx, wy, wz = wx - about * x, wy - about * y, wz - about * z
    spin = sqrt(wx * wx + wy * wy + wz * wz)
    if spin == 0.0:
        return 0.0, 0.0, 0.0, 0.0
    slope = min(coefficient * radius * normal / spin, inertia_limit)
    return -slope * wx, -slope * wy, -slope * wz, slope * spin * spin
