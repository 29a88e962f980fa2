import numpy as np
import pytest

from graindamp.errors import InputError
from graindamp.spec.structure import BeamSpec, PointMassSpec
from graindamp.structure.beam import SAME_NODE, assemble, node_positions


def beam(**changes):
    return BeamSpec(**({"length": 1.8, "bending_stiffness": 9930.0, "mass_per_length": 2.89} | changes))


def test_without_special_positions_the_mesh_is_uniform():
    position = node_positions(1.8, 90)
    assert position.size == 91
    assert np.diff(position) == pytest.approx(1.8 / 90, rel=1e-12)  # rounding
    assert position[0] == 0
    assert position[-1] == 1.8


def test_every_special_position_is_a_node_and_elements_stay_short():
    special = [1.765, 0.05, 0.9, 0.31]
    position = node_positions(1.8, 20, special)
    assert set(special) <= set(position.tolist())
    assert np.diff(position).max() <= 1.8 / 20 * (1 + 1e-6)  # as much an element may be longer by design
    assert np.diff(position).min() > 0


def test_neighbours_share_a_node():
    close = 0.4 * SAME_NODE * 1.8
    assert node_positions(1.8, 10, [0.9, 0.9 + close, close, 1.8 - close, 0.0, 1.8]).size == 11


def test_a_special_position_on_a_uniform_node_adds_nothing():
    assert node_positions(1.8, 90, [0.9, 0.9, 0.02 * 7]).size == 91


def test_element_matrices_of_one_element():
    """Closed form of a single free element: deflection, rotation at each end."""
    model = assemble(beam(length=2.0, bending_stiffness=3.0, mass_per_length=5.0, n_element=1), {})
    k, m = 3.0 / 2.0**3, 5.0 * 2.0 / 420
    assert model.stiffness.toarray() == pytest.approx(
        k * np.array([[12, 12, -12, 12], [12, 16, -12, 8], [-12, -12, 12, -12], [12, 8, -12, 16]])
    )
    assert model.mass.toarray() == pytest.approx(
        m * np.array([[156, 44, 54, -26], [44, 16, 26, -12], [54, 26, 156, -44], [-26, -12, -44, 16]])
    )


def rigid_motions(model, about):
    translation = np.tile([1.0, 0.0], model.position.size)
    rotation = np.stack([model.position - about, np.ones_like(model.position)], axis=1).ravel()
    return translation, rotation


def test_mass_matrix_knows_mass_static_moment_and_inertia():
    """Consistent mass integrates rigid motions exactly, so only rounding remains (1e-13)."""
    mass = PointMassSpec(position=0.3, mass=1.5, rotary_inertia=0.02)
    model = assemble(beam(masses=[mass]), {}, [PointMassSpec(position=1.765, mass=0.2)])
    translation, rotation = rigid_motions(model, about=0.0)
    per_length, length = 2.89, 1.8
    assert translation @ model.mass @ translation == pytest.approx(per_length * length + 1.7, rel=1e-13)
    moment = per_length * length**2 / 2 + 1.5 * 0.3 + 0.2 * 1.765
    assert translation @ model.mass @ rotation == pytest.approx(moment, rel=1e-13)
    inertia = per_length * length**3 / 3 + 1.5 * 0.3**2 + 0.02 + 0.2 * 1.765**2
    assert rotation @ model.mass @ rotation == pytest.approx(inertia, rel=1e-13)


def test_rigid_motions_strain_springs_only():
    spring = {"position": 0.4, "stiffness": 700.0, "torsion_stiffness": 30.0}
    model = assemble(beam(springs=[spring]), {})
    translation, rotation = rigid_motions(model, about=0.0)
    # 1e-6: rounding of 12 EI / h^3 = 1.5e10 N/m, against 700 N/m
    assert translation @ model.stiffness @ translation == pytest.approx(700, rel=1e-6)
    assert rotation @ model.stiffness @ rotation == pytest.approx(700 * 0.4**2 + 30, rel=1e-6)


@pytest.mark.parametrize(
    ("ends", "load", "deflection"),
    [
        (("clamped", "free"), 1.8, 1.8**3 / 3),
        (("pinned", "pinned"), 0.9, 1.8**3 / 48),
        (("clamped", "clamped"), 0.9, 1.8**3 / 192),
        (("free", "clamped"), 0.0, 1.8**3 / 3),
    ],
)
def test_static_deflection_is_exact(ends, load, deflection):
    """Cubic elements are exact under point loads; 1e-9: rounding times the condition of the stiffness."""
    model = assemble(beam(n_element=8, ends=ends), {"load": load})
    force = np.zeros(model.free.size)
    force[model.deflection[0]] = 9930.0
    assert np.linalg.solve(model.stiffness.toarray(), force)[model.deflection[0]] == pytest.approx(deflection, rel=1e-9)


def test_supports_hold_what_they_should():
    model = assemble(beam(ends=("clamped", "pinned"), n_element=4), {"root": 0.0, "middle": 0.9, "tip": 1.8})
    assert model.deflection.tolist() == [-1, 2, -1]
    assert model.rotation.tolist() == [-1, 3, 6]
    assert model.free.tolist() == [2, 3, 4, 5, 6, 7, 9]


def test_points_off_the_beam_are_named():
    with pytest.raises(InputError, match=r"point 'damper' is 1.9 m, but the beam ends at 1.8 m; allowed 0 to 1.8 m"):
        assemble(beam(), {"damper": 1.9})
    with pytest.raises(InputError, match=r"point 'damper' is -0.1 m"):
        assemble(beam(), {"damper": -0.1})
    with pytest.raises(InputError, match="extra mass 'container' is 2 m"):
        assemble(beam(), {}, [PointMassSpec(position=2, mass=1, name="container")])
