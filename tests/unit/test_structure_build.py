from pathlib import Path

import numpy as np
import pytest

from graindamp.errors import InputError
from graindamp.spec.structure import BeamSpec, ModalSpec, PointMassSpec, UffSpec
from graindamp.structure.build import modal_model_of

DATA = Path(__file__).parents[1] / "data"
BEAM = BeamSpec(length=1.8, bending_stiffness=9930, mass_per_length=2.89, n_element=20)
MODAL = ModalSpec(frequencies=(10.0, 30.0), shapes={"tip": (1.0, -0.5), "root": (0.1, 0.2)})
MASS = PointMassSpec(position=1.0, mass=0.2)


def test_beam_takes_positions_and_masses():
    model = modal_model_of(BEAM, {"damper": 1.765}, [MASS])
    assert model.points == ("damper",)
    assert model.omega[2] < modal_model_of(BEAM, {"damper": 1.765}).omega[2]


def test_modal_points_are_renamed():
    model = modal_model_of(MODAL, {"damper": "tip", "shaker": "root", "sensor": "tip"})
    assert model.points == ("damper", "shaker", "sensor")
    assert model.shape.tolist() == [[1.0, -0.5], [0.1, 0.2], [1.0, -0.5]]


def test_uff_direction_may_be_turned_round():
    model = modal_model_of(UffSpec(file="beam-modes.uff"), {"a": "221Z+", "b": "221Z-"}, folder=DATA)
    assert (model.shape[0] == -model.shape[1]).all()
    assert np.any(model.shape[0] != 0)


def test_no_points():
    assert modal_model_of(MODAL, {}).shape.shape == (0, 2)
    assert modal_model_of(BEAM, {}).shape.shape == (0, 6)


def test_wrong_kind_of_point_is_explained():
    with pytest.raises(InputError, match="point 'damper' is given as 'tip'; on a beam it is a position in m"):
        modal_model_of(BEAM, {"damper": "tip"})
    with pytest.raises(InputError, match=r"point 'damper' is given as the number 1.7; name a point of the modes"):
        modal_model_of(MODAL, {"damper": 1.7})
    with pytest.raises(InputError, match="no point 'tipp'; nearest is 'tip'"):
        modal_model_of(MODAL, {"damper": "tipp"})


def test_masses_need_a_beam():
    with pytest.raises(InputError, match="cannot be added to a structure of kind 'modal'"):
        modal_model_of(MODAL, {"damper": "tip"}, [MASS])
    weightless = PointMassSpec(position=0, mass=0)
    assert modal_model_of(MODAL, {"damper": "tip"}, [weightless]).points == ("damper",)
