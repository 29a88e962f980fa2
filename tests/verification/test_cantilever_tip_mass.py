"""Beams with point masses against exact frequency equations, and their responses against direct inversion."""

import numpy as np
import pytest
from scipy.optimize import brentq

from graindamp.spec.structure import BeamSpec, MaterialSpec, PointMassSpec, RayleighDampingSpec, RectangleSection
from graindamp.structure.beam import assemble
from graindamp.structure.frf import receptance
from graindamp.structure.modal import beam_modal_model

# Steel strip and enclosure of Witt (2011), horizontal impact damper.
CANTILEVER = BeamSpec(
    length=0.244,
    section=RectangleSection(width=19.16e-3, height=3.19e-3),
    material=MaterialSpec(youngs_modulus=207e9, density=7840),
    ends=("clamped", "free"),
    n_element=40,
    n_mode=3,
)
TIP = 0.10225
BEAM_MASS = CANTILEVER.linear_density * CANTILEVER.length


def exact_theta(tip_mass, mode):
    """Root beta L of Omega (cos sinh - sin cosh) + cos cosh = -1, with Omega = m_e theta / (gamma L)."""

    def characteristic(theta):
        ratio = tip_mass * theta / BEAM_MASS
        sine, cosine = np.sin(theta), np.cos(theta)
        return ratio * (cosine * np.tanh(theta) - sine) + cosine + 1 / np.cosh(theta)

    return brentq(characteristic, mode * np.pi + 0.05, mode * np.pi + 0.5 * np.pi + 0.5, xtol=1e-14)


def exact_omega(theta):
    return theta**2 * np.sqrt(CANTILEVER.flexural_rigidity / CANTILEVER.linear_density) / CANTILEVER.length**2


def with_tip_mass(tip_mass):
    return beam_modal_model(CANTILEVER, {"tip": 0.244}, [PointMassSpec(position=0.244, mass=tip_mass)])


def test_the_published_cantilever():
    assert exact_theta(TIP, 0) == pytest.approx(1.28169, abs=5e-6)  # printed digits
    model = with_tip_mass(TIP)
    modal_mass = 1 / model.shape[0, 0] ** 2
    assert model.omega[0] / (2 * np.pi) == pytest.approx(20.78, abs=5e-3)  # printed digits
    assert modal_mass == pytest.approx(0.13015, abs=5e-6)  # printed digits
    assert modal_mass * model.omega[0] ** 2 == pytest.approx(2218.6, abs=0.05)  # printed digits


@pytest.mark.parametrize("tip_mass", [0.01, TIP, 1.0])
def test_three_modes_match_the_exact_frequency_equation(tip_mass):
    exact = exact_omega(np.array([exact_theta(tip_mass, mode) for mode in range(3)]))
    assert with_tip_mass(tip_mass).omega == pytest.approx(exact, rel=1e-6)  # (beta h)^4 / 1440 is 1.1e-6 for mode 3


def test_a_heavy_tip_mass_leaves_a_spring():
    """omega^2 (m_tip + 33/140 m_beam) = 3 EI / L^3, Rayleigh's static shape, exact as the tip mass grows."""
    model = with_tip_mass(100.0)
    stiffness = 3 * CANTILEVER.flexural_rigidity / CANTILEVER.length**3
    assert model.omega[0] ** 2 * (100 + 33 / 140 * BEAM_MASS) == pytest.approx(stiffness, rel=1e-6)  # (m_b / m_tip)^2


@pytest.mark.parametrize("ends", [("clamped", "free"), ("free", "free")], ids="-".join)
def test_modal_sum_equals_direct_inversion(ends):
    """All modes of a small model with Rayleigh damping: the sum is (K - omega^2 M + i omega C)^-1 to rounding."""
    damping = RayleighDampingSpec(alpha=3.0, beta=2e-5)
    rigid = 2 if ends == ("free", "free") else 0
    spec = BeamSpec(
        length=1.8,
        bending_stiffness=9930,
        mass_per_length=2.89,
        n_element=6,
        ends=ends,
        masses=[PointMassSpec(position=1.765, mass=0.2, rotary_inertia=1e-4)],
        damping=damping,
    )
    points = {"damper": 1.765, "shaker": 0.3}
    beam = assemble(spec, points)
    model = beam_modal_model(spec.model_copy(update={"n_mode": beam.free.size - rigid}), points)
    frequency = np.array([0.5, 10.0, 51.7, 200.0, 535.0, 2000.0])
    stiffness, mass = beam.stiffness.toarray(), beam.mass.toarray()
    for output, input in [(0, 0), (0, 1), (1, 1)]:
        direct = []
        for omega in 2 * np.pi * frequency:
            dynamic = stiffness - omega**2 * mass + 1j * omega * (3.0 * mass + 2e-5 * stiffness)
            force = np.zeros(beam.free.size)
            force[beam.deflection[input]] = 1.0
            direct.append(np.linalg.solve(dynamic, force)[beam.deflection[output]])
        summed = receptance(model, frequency, list(points)[output], list(points)[input])
        # rounding times the condition number of K, 1e9: relative to the largest of the terms that sum up
        assert summed == pytest.approx(np.array(direct), rel=1e-7, abs=1e-9 * abs(np.array(direct)).max())


def test_free_beam_with_two_point_masses():
    """A free-free beam of 5.2 kg with masses near both ends: the first four bending modes, independently computed."""
    spec = BeamSpec(
        length=1.8,
        bending_stiffness=9.93e3,
        mass_per_length=5.2 / 1.8,
        masses=[PointMassSpec(position=1.765, mass=0.2), PointMassSpec(position=0.05, mass=1.2)],
    )
    model = beam_modal_model(spec, {"damper": 1.765})
    assert model.omega[:2].tolist() == [0, 0]
    assert model.omega[2:] / (2 * np.pi) == pytest.approx([51.7, 153.7, 314.7, 535.5], abs=0.05)  # printed digits
    assert model.shape[0, 2:] ** 2 == pytest.approx([0.458, 0.337, 0.248, 0.183], abs=6e-4)  # printed digits
