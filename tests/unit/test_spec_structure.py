import math

import pytest

from graindamp.errors import InputError
from graindamp.materials import MATERIALS, material_named
from graindamp.spec.model import Spec, parse_spec
from graindamp.spec.structure import (
    BeamSpec,
    MaterialSpec,
    ModalDampingSpec,
    ModalSpec,
    RayleighDampingSpec,
    RectangleSection,
    StructureSpec,
    TubeSection,
    UffSpec,
)


class Project(Spec):
    structure: StructureSpec
    """What vibrates."""


BEAM = {"kind": "beam", "length": "1.8 m", "bending_stiffness": "9930 N m^2", "mass_per_length": "2.89 kg/m"}


def read(**structure):
    return parse_spec({"structure": structure}, Project, "project.toml").structure


def test_kind_selects_the_spec():
    assert isinstance(read(**BEAM), BeamSpec)
    assert isinstance(read(kind="modal", frequencies=["10 Hz"], shapes={"tip": [1.0]}), ModalSpec)
    assert isinstance(read(kind="uff", file="modes.uff"), UffSpec)


def test_beam_defaults():
    beam = read(**BEAM)
    assert (beam.ends, beam.n_element, beam.n_mode) == (("free", "free"), 90, 4)
    assert beam.damping == ModalDampingSpec(ratio=0.0)
    assert (beam.flexural_rigidity, beam.linear_density) == (9930.0, 2.89)


def test_section_and_material_give_rigidity_and_density():
    beam = read(
        kind="beam",
        length="244 mm",
        section={"shape": "rectangle", "width": "19.16 mm", "height": "3.19 mm"},
        material={"youngs_modulus": "207 GPa", "density": "7840 kg/m^3"},
    )
    assert beam.flexural_rigidity == pytest.approx(10.729, rel=1e-4)  # four to five printed digits
    assert beam.linear_density == pytest.approx(0.47918, rel=1e-5)  # five printed digits


def test_hollow_sections_are_the_difference_of_solid_ones():
    outer, inner = RectangleSection(width=0.08, height=0.03), RectangleSection(width=0.07, height=0.02)
    box = RectangleSection(width=0.08, height=0.03, wall=0.005)
    assert box.area == pytest.approx(outer.area - inner.area, rel=1e-14)  # rounding
    assert box.second_moment == pytest.approx(outer.second_moment - inner.second_moment, rel=1e-14)  # rounding
    tube, bore = TubeSection(diameter=0.03, wall=0.002), TubeSection(diameter=0.026)
    assert tube.area == pytest.approx(TubeSection(diameter=0.03).area - bore.area, rel=1e-14)  # rounding
    assert TubeSection(diameter=2.0).second_moment == pytest.approx(math.pi / 4, rel=1e-14)  # rounding


def test_thin_tube_approaches_pi_r3_t():
    tube = TubeSection(diameter=0.1, wall=1e-6)
    assert tube.second_moment == pytest.approx(math.pi * 0.05**3 * 1e-6, rel=1e-4)  # first order: 3/2 wall / radius


def test_material_by_name_keeps_its_values_through_json():
    beam = read(kind="beam", length=1, section={"shape": "tube", "diameter": "30 mm"}, material="Aluminium")
    assert beam.material == MaterialSpec(youngs_modulus=70e9, density=2700, name="aluminium")
    assert BeamSpec.model_validate_json(beam.model_dump_json()) == beam


@pytest.mark.parametrize("name", sorted(MATERIALS))
def test_every_material_is_sourced_and_plausible(name):
    material = material_named(name)
    assert material.name == name
    assert material.source
    assert 1e9 < material.youngs_modulus < 5e11
    assert 0 < material.poisson_ratio < 0.5
    assert 1e3 < material.density < 2e4


def test_materials_cannot_be_changed():
    with pytest.raises(TypeError):
        MATERIALS["butter"] = MATERIALS["steel"]


def test_unknown_material_names_the_nearest():
    with pytest.raises(InputError, match=r"'aluminum'; nearest is 'aluminium'; allowed are steel"):
        material_named("aluminum")


@pytest.mark.parametrize(
    ("given", "listed"),
    [
        ({}, "none of them"),
        ({"bending_stiffness": 1}, "given: bending_stiffness"),
        ({"material": "steel"}, "given: material"),
        (
            {"bending_stiffness": 1, "mass_per_length": 1, "material": "steel"},
            "given: bending_stiffness, mass_per_length, material",
        ),
    ],
)
def test_one_way_to_describe_a_beam(given, listed):
    with pytest.raises(InputError, match=f"either bending_stiffness and mass_per_length, or section.*{listed}"):
        read(kind="beam", length=1, **given)


@pytest.mark.parametrize("what", ["masses", "springs"])
def test_position_beyond_the_length_is_named(what):
    item = {"position": "2 m"} | ({"mass": 1} if what == "masses" else {"stiffness": 1})
    with pytest.raises(InputError, match=rf"{what}\[2\].position is 2 m.*allowed 0 to 1.8 m"):
        read(**BEAM, **{what: [item | {"position": 0.1}, item]})


def test_position_at_the_end_may_be_rounded():
    assert read(**BEAM, masses=[{"position": 1.8 * (1 + 1e-12), "mass": 1}])


def test_wall_thicker_than_the_section():
    with pytest.raises(InputError, match=r"wall is 0.015 m.*only 0.03 m thick; allowed below 0.015 m"):
        read(kind="beam", length=1, section={"shape": "tube", "diameter": 0.03, "wall": 0.015}, material="steel")


@pytest.mark.parametrize("ratio", ["2 %", 0.02, [0.01, "2 %"], 0])
def test_damping_ratio_one_or_list(ratio):
    damping = read(**BEAM, damping={"kind": "modal", "ratio": ratio}).damping
    assert ModalDampingSpec.model_validate_json(damping.model_dump_json()) == damping


def test_damping_ratio_of_a_list_is_located():
    with pytest.raises(InputError, match=r"damping.ratio\[2\]: given 3; Input should be less than 1") as raised:
        read(**BEAM, damping={"kind": "modal", "ratio": [0.01, 3]})
    assert len(str(raised.value).splitlines()) == 1


def test_rayleigh_damping():
    damping = read(**BEAM, damping={"kind": "rayleigh", "alpha": 3, "beta": "20 us"}).damping
    assert isinstance(damping, RayleighDampingSpec)
    assert (damping.alpha, damping.beta) == (3, pytest.approx(20e-6, rel=1e-15))  # rounding of the unit


def test_end_misspelt():
    with pytest.raises(InputError, match=r"ends\[2\]: given 'fixed'; Input should be 'free', 'clamped' or 'pinned'"):
        read(**BEAM, ends=["free", "fixed"])


def test_modal_shapes_must_fit_frequencies():
    with pytest.raises(InputError, match=r"shapes.tip has 3 values; allowed is one per frequency, that is 2"):
        read(kind="modal", frequencies=[0, "10 Hz"], shapes={"tip": [1, 2, 3]})
    with pytest.raises(InputError, match=r"frequencies\[2\] is 5 Hz after 10 Hz"):
        read(kind="modal", frequencies=[10, 5], shapes={"tip": [1, 2]})


def test_modal_values_take_units():
    modal = read(kind="modal", frequencies=["0 Hz", "0.1 kHz"], shapes={"tip": [1, "2 kg^-0.5"]})
    assert modal.frequencies == (0.0, 100.0)
    assert modal.shapes == {"tip": (1.0, 2.0)}
