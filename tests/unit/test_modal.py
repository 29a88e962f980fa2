import numpy as np
import pytest

from graindamp.errors import InputError
from graindamp.spec.structure import BeamSpec, ModalDampingSpec, ModalSpec, PointMassSpec, RayleighDampingSpec
from graindamp.structure.modal import beam_modal_model, modal_damping, modal_model, point_index

OMEGA = np.array([0.0, 0.0, 10.0, 30.0, 60.0])


def beam(**changes):
    return BeamSpec(
        **({"length": 1.8, "bending_stiffness": 9930.0, "mass_per_length": 2.89, "n_element": 30} | changes)
    )


def test_one_ratio_damps_elastic_modes_only():
    assert modal_damping(ModalDampingSpec(ratio=0.02), OMEGA).tolist() == [0, 0, 0.4, 1.2, 2.4]


def test_a_list_counts_elastic_modes():
    given = modal_damping(ModalDampingSpec(ratio=(0.01, 0.02, 0.03, 0.04)), OMEGA)
    assert given == pytest.approx([0, 0, 0.2, 1.2, 3.6], rel=1e-15)  # rounding


def test_rayleigh_damps_rigid_modes_by_alpha():
    assert modal_damping(RayleighDampingSpec(alpha=2, beta=1e-3), OMEGA) == pytest.approx([2, 2, 2.1, 2.9, 5.6])


def test_a_list_too_short_is_explained():
    with pytest.raises(InputError, match=r"damping.ratio lists 2 values for 3 elastic modes"):
        modal_damping(ModalDampingSpec(ratio=(0.01, 0.02)), OMEGA)


def test_n_mode_counts_elastic_modes():
    assert beam_modal_model(beam(n_mode=3), {"a": 0.0}).omega.tolist()[:2] == [0, 0]
    assert beam_modal_model(beam(n_mode=3), {"a": 0.0}).omega.size == 5
    assert beam_modal_model(beam(n_mode=3, ends=("pinned", "free")), {"a": 0.0}).omega.size == 4
    assert beam_modal_model(beam(n_mode=3, ends=("clamped", "free")), {"a": 0.0}).omega.size == 3


def test_more_modes_than_the_beam_has():
    with pytest.raises(InputError, match=r"5 elastic modes are asked for, but the structure has only 4"):
        beam_modal_model(beam(n_element=2, n_mode=5), {})
    with pytest.raises(InputError, match="at least one row"):
        beam_modal_model(beam(n_element=1, n_mode=1, ends=("clamped", "clamped")), {})


def test_rigid_modes_carry_mass_and_inertia():
    """A force at x moves a free body by 1 / m + (x - c)^2 / J, the sum of squared rigid shapes."""
    model = beam_modal_model(beam(), {"end": 1.8, "damper": 1.5}, [PointMassSpec(position=0.2, mass=1.2)])
    mass = 2.89 * 1.8 + 1.2
    centre = (2.89 * 1.8**2 / 2 + 1.2 * 0.2) / mass
    inertia = 2.89 * 1.8**3 / 3 + 1.2 * 0.2**2 - mass * centre**2
    exact = 1 / mass + (np.array([1.8, 1.5]) - centre) ** 2 / inertia
    rigid = model.omega == 0
    assert (model.shape[:, rigid] ** 2).sum(axis=1) == pytest.approx(exact, rel=1e-8)  # rounding over the gap
    assert (model.slope[:, rigid] ** 2).sum(axis=1) == pytest.approx(1 / inertia, rel=1e-8)  # as above


def test_slope_is_the_derivative_of_the_shape():
    step = 2e-3
    points = {"x": 0.7, "left": 0.7 - step, "right": 0.7 + step}
    model = beam_modal_model(beam(), points)
    difference = (model.shape[2] - model.shape[1]) / (2 * step)
    assert model.slope[0] == pytest.approx(difference, abs=5e-3)  # step^2 / 6 phi''' with phi''' up to 5e3 m^-3 kg^-1/2


def test_a_point_in_a_support_does_not_move():
    model = beam_modal_model(beam(ends=("clamped", "pinned")), {"root": 0.0, "tip": 1.8})
    assert (model.shape == 0).all()
    assert (model.slope[0] == 0).all()
    assert (model.slope[1] != 0).all()


def test_extra_mass_is_the_same_as_a_mass_of_the_spec():
    mass = PointMassSpec(position=1.765, mass=0.2, rotary_inertia=1e-3)
    inside, outside = beam_modal_model(beam(masses=[mass]), {"a": 0.9}), beam_modal_model(beam(), {"a": 0.9}, [mass])
    assert (inside.omega == outside.omega).all()
    assert (inside.shape == outside.shape).all()


def test_modal_model_as_typed_in():
    spec = ModalSpec(
        frequencies=(0.0, 50.0), shapes={"a": (0.3, 0.5), "b": (0.3, -0.2)}, damping=ModalDampingSpec(ratio=(0.01,))
    )
    model = modal_model(spec)
    assert model.points == ("a", "b")
    assert model.omega.tolist() == [0, 100 * np.pi]
    assert model.damping == pytest.approx([0, 2 * np.pi], rel=1e-15)  # rounding
    assert model.shape.tolist() == [[0.3, 0.5], [0.3, -0.2]]
    assert np.isnan(model.slope).all()


def test_unknown_point_names_the_nearest():
    model = beam_modal_model(beam(), {"damper": 1.7, "shaker": 0.05})
    assert point_index(model, "shaker") == 1
    with pytest.raises(InputError, match=r"no point 'dampr'; nearest is 'damper'; it has damper, shaker"):
        point_index(model, "dampr")
