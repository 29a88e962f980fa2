"""Eigenvalues of Euler-Bernoulli beams converge to the closed form with the fourth power of the element length.

Roots of cos x cosh x = 1 (both ends free or clamped), cos x cosh x = -1 (clamped-free), sin x = 0 (pinned): Blevins
(1979), Formulas for Natural Frequency and Mode Shape, Table 8-1. The leading error of cubic elements with consistent
mass is (beta h)^4 / 720: Strang & Fix (1973), An Analysis of the Finite Element Method, section 6.3.
"""

import numpy as np
import pytest
from scipy.optimize import brentq

from graindamp.spec.structure import BeamSpec
from graindamp.structure.beam import assemble
from graindamp.structure.eigen import solve_modes

SIGN = {("free", "free"): 1, ("clamped", "clamped"): 1, ("clamped", "free"): -1}
CASES = [*SIGN, ("pinned", "pinned")]


def root(ends, mode):
    """Closed-form beta L of elastic mode 0, 1, 2 ..."""
    if ends == ("pinned", "pinned"):
        return (mode + 1) * np.pi
    near = (mode + 1.5) * np.pi if SIGN[ends] == 1 else (mode + 0.5) * np.pi
    return brentq(lambda x: np.cos(x) - SIGN[ends] / np.cosh(x), near - 0.5, near + 0.5, xtol=1e-14)


def eigenvalue_errors(ends, n_element):
    """Relative errors of the first three elastic eigenvalues omega^2 and the closed-form roots beta L."""
    beam = assemble(BeamSpec(length=1, bending_stiffness=1, mass_per_length=1, n_element=n_element, ends=ends), {})
    modes = solve_modes(beam.stiffness, beam.mass, 3)
    assert modes.n_rigid == (2 if ends == ("free", "free") else 0)
    roots = np.array([root(ends, mode) for mode in range(3)])
    return modes.omega[modes.n_rigid :] ** 2 / roots**4 - 1, roots


@pytest.mark.parametrize("ends", CASES, ids="-".join)
def test_halving_the_elements_divides_the_error_by_16(ends):
    coarse, middle, fine = (eigenvalue_errors(ends, n)[0] for n in (8, 16, 32))
    assert coarse / middle == pytest.approx(16, rel=0.12)  # 0.12: next-order term of mode 3, measured 14.2 to 15.9
    assert middle / fine == pytest.approx(16, rel=0.035)  # 0.035: a quarter of it and rounding, measured 15.5 to 16.0


@pytest.mark.parametrize("ends", CASES, ids="-".join)
def test_leading_error_is_that_of_cubic_elements(ends):
    error, roots = eigenvalue_errors(ends, 32)
    assert error == pytest.approx((roots / 32) ** 4 / 720, rel=0.012)  # next order, (beta h)^2 / 10, and rounding
    assert (error > 0).all()  # Rayleigh-Ritz: from above


@pytest.mark.parametrize(
    ("ends", "place", "exact"),
    [
        (("free", "free"), 1.0, 4.0),
        (("clamped", "free"), 1.0, 4.0),
        (("pinned", "pinned"), 0.5, 2.0),
        (("clamped", "clamped"), 0.5, 1.588146**2),
    ],
)
def test_first_mode_shape_matches_closed_form(ends, place, exact):
    """Squared mass-normalised shape times the mass of the beam, at a free end or in the middle."""
    beam = assemble(BeamSpec(length=1, bending_stiffness=1, mass_per_length=1, n_element=32, ends=ends), {"p": place})
    modes = solve_modes(beam.stiffness, beam.mass, 1)
    value = modes.vectors[beam.deflection[0], modes.n_rigid] ** 2
    assert value == pytest.approx(exact, rel=2e-6)  # (beta h)^4 / 720 = 7e-7, and seven printed digits
