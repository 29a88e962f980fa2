from pathlib import Path

import numpy as np
import pytest
import pyuff

from graindamp.errors import InputError
from graindamp.spec.structure import ModalDampingSpec
from graindamp.structure.uff import uff_modal_model

SAMPLE = Path(__file__).parents[1] / "data" / "beam-modes.uff"

FREQUENCIES = [49.55952, 114.5622, 145.4083, 295.8417, 332.5846, 501.4356, 629.8509, 666.0388, 763.2769, 1083.742]
# Elastic modes at node 221, along Z, of an independent solution; up to one sign per mode.
SHAPE_221Z = [0.6849819, 0.0, 0.586058, -0.50215, 0.0, -0.432209, 0.0, 0.0, -0.374046, 0.325112]
SHAPE_101Z = [0.432997, 0.0, -0.30946, -0.23958, 0.0, 0.194636, 0.0, 0.0, -0.163821, -0.141667]


def mode(number, frequency, **changes):
    """A dataset 55: nodes 3 and 7, three components."""
    return {
        "type": 55,
        "analysis_type": 2,
        "data_ch": 2,
        "spec_data_type": 8,
        "load_case": 1,
        "mode_n": number,
        "freq": frequency,
        "modal_m": 1.0,
        "node_nums": np.array([3, 7]),
        "r1": np.array([0.1, 0.2]),
        "r2": np.array([0.3, 0.4]),
        "r3": np.array([0.5, -0.6]),
    } | changes


def units(length, force):
    return {"type": 164, "units_code": 9, "length": length, "force": force, "temp": 1.0, "temp_offset": 273.15}


def written(tmp_path, *datasets):
    path = tmp_path / "modes.uff"
    pyuff.UFF(str(path)).write_sets(list(datasets), mode="overwrite")
    return path


def test_sample_frequencies_and_rigid_modes():
    model = uff_modal_model(SAMPLE)
    assert (model.omega[:6] == 0).all()
    assert model.omega[6:] == pytest.approx(2 * np.pi * np.array(FREQUENCIES), rel=1e-5)  # six digits in the file
    assert (model.damping == 0).all()


def test_sample_shapes():
    model = uff_modal_model(SAMPLE)
    assert len(model.points) == 27 * 3
    assert model.points[:3] == ("101X+", "101Y+", "101Z+")
    here, there = (model.shape[model.points.index(name), 6:] for name in ("221Z+", "101Z+"))
    assert abs(here) == pytest.approx(np.abs(SHAPE_221Z), abs=1e-5)  # six digits in the file
    assert here * there == pytest.approx(np.multiply(SHAPE_221Z, SHAPE_101Z), abs=1e-5)  # one sign per mode
    assert np.isnan(model.slope).all()


def test_sample_rigid_modes_carry_the_mass():
    """Of a force along the axis only the mass is felt: 6.06 kg."""
    model = uff_modal_model(SAMPLE)
    assert (model.shape[model.points.index("161X+"), :6] ** 2).sum() == pytest.approx(1 / 6.06, rel=1e-5)  # six digits


def test_shapes_are_scaled_to_unit_modal_mass(tmp_path):
    model = uff_modal_model(written(tmp_path, mode(1, 10.0), mode(2, 20.0, modal_m=4.0)))
    assert model.points == ("3X+", "3Y+", "3Z+", "7X+", "7Y+", "7Z+")
    assert model.shape[:, 0] == pytest.approx([0.1, 0.3, 0.5, 0.2, 0.4, -0.6], rel=1e-5)  # six digits in the file
    assert model.shape[:, 1] == pytest.approx(model.shape[:, 0] / 2, rel=1e-5)


def test_rotations_are_points_of_their_own(tmp_path):
    rotations = {f"r{i}": np.array([i, -i]) for i in (4, 5, 6)}
    model = uff_modal_model(written(tmp_path, mode(1, 10.0, data_ch=3, **rotations)))
    assert model.points[3:6] == ("3RX+", "3RY+", "3RZ+")
    assert model.shape[model.points.index("7RZ+"), 0] == -6


def test_units_of_t_mm_s_become_si(tmp_path):
    """Modal mass 1 t, lengths in mm: shapes are sqrt(1000) smaller in SI, rotations 1000 / sqrt(1000) larger."""
    rotations = {f"r{i}": np.array([i, -i]) for i in (4, 5, 6)}
    plain = uff_modal_model(written(tmp_path, mode(1, 10.0, data_ch=3, **rotations)))
    model = uff_modal_model(written(tmp_path, units(1000.0, 1.0), mode(1, 10.0, data_ch=3, **rotations)))
    ratio = (model.shape / plain.shape)[:, 0]
    assert ratio == pytest.approx(np.tile(np.repeat([1000**-0.5, 1000**0.5], 3), 2), rel=1e-12)  # rounding


def test_mm_kg_s_leaves_translations_alone(tmp_path):
    plain = uff_modal_model(written(tmp_path, mode(1, 10.0)))
    model = uff_modal_model(written(tmp_path, units(1000.0, 1000.0), mode(1, 10.0)))
    assert (model.shape == plain.shape).all()


def test_nodes_left_out_are_at_rest_and_modes_are_sorted(tmp_path):
    one = {"node_nums": np.array([7]), "r1": np.array([1.0]), "r2": np.array([2.0]), "r3": np.array([3.0])}
    model = uff_modal_model(written(tmp_path, mode(2, 20.0), mode(1, 10.0, **one)))
    assert model.omega == pytest.approx(2 * np.pi * np.array([10, 20]), rel=1e-15)  # rounding
    assert model.shape[:, 0].tolist() == [0, 0, 0, 1, 2, 3]


def test_rounding_left_by_a_solver_is_a_rigid_mode(tmp_path):
    model = uff_modal_model(written(tmp_path, mode(1, -3e-4), mode(2, 2e-4), mode(3, 100.0)))
    assert model.omega == pytest.approx([0, 0, 200 * np.pi], rel=1e-15)  # rounding


def test_damping_of_the_file_and_its_override(tmp_path):
    path = written(tmp_path, mode(1, 10.0, modal_damp_vis=0.01), mode(2, 20.0, modal_damp_his=0.04))
    omega = 2 * np.pi * np.array([10, 20])
    assert uff_modal_model(path).damping == pytest.approx(2 * np.array([0.01, 0.02]) * omega, rel=1e-5)  # six digits
    override = uff_modal_model(path, ModalDampingSpec(ratio=0.1))
    assert override.damping == pytest.approx(0.2 * omega, rel=1e-12)  # rounding


def test_complex_modes_are_explained(tmp_path):
    value = np.array([1 + 1j, 2.0])
    path = written(tmp_path, mode(1, 0.0, analysis_type=3, eig=-1 + 60j, r1=value, r2=value, r3=value))
    with pytest.raises(InputError, match=r"modes.uff: its modes are complex; real normal modes are needed"):
        uff_modal_model(path)


def test_modal_mass_must_be_there(tmp_path):
    with pytest.raises(InputError, match="mode 2 has modal mass 0, so its shape has no scale"):
        uff_modal_model(written(tmp_path, mode(1, 10.0), mode(2, 20.0, modal_m=0.0)))


def test_negative_frequency(tmp_path):
    with pytest.raises(InputError, match="frequency -20 Hz"):
        uff_modal_model(written(tmp_path, mode(1, 10.0), mode(2, -20.0)))


def test_no_shapes_in_the_file(tmp_path):
    with pytest.raises(InputError, match="has no dataset 55 with mode shapes, only 164"):
        uff_modal_model(written(tmp_path, units(1.0, 1.0)))
    with pytest.raises(InputError, match=r"no dataset 55 holds normal modes.*found"):
        uff_modal_model(written(tmp_path, mode(1, 10.0, spec_data_type=2)))


def test_a_damaged_dataset_is_named(tmp_path):
    path = written(tmp_path, mode(1, 10.0))
    path.write_text(path.read_text().replace("1.00000e-01", "1.0000xe-01"))
    with pytest.raises(InputError, match="dataset 1, of type 55, cannot be read"):
        uff_modal_model(path)


def test_not_a_universal_file(tmp_path):
    path = tmp_path / "notes.uff"
    path.write_text("nothing of the kind\n")
    with pytest.raises(InputError, match=r"notes.uff: is not a universal file"):
        uff_modal_model(path)
    with pytest.raises(InputError, match=r"nowhere.uff: there is no such file"):
        uff_modal_model(tmp_path / "nowhere.uff")
