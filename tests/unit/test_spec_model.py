"""Messages about descriptions: file, key, what was given, what is allowed, the nearest valid key."""

import pytest
from pydantic import BaseModel

from campaign_made import DAMPER, GRID
from graindamp.errors import InputError
from graindamp.spec import measurement, project, structure
from graindamp.spec.field import FieldSpec
from graindamp.spec.measurement import MeasurementSpec
from graindamp.spec.model import Spec, helps_of, load_spec, parse_spec
from graindamp.spec.project import ProjectSpec

PROJECT = """
[structure]
kind = "beam"
length = "1.8 m"
bending_stiffness = "9930 N m^2"
mass_per_length = "2.89 kg/m"
[[dampers]]
point = "1.7 m"
field = "field.nc"
[drive]
point = 0.05
force = ["13 N", 26]
"""


def message(text, tmp_path, kind=ProjectSpec):
    path = tmp_path / "project.toml"
    path.write_text(text)
    with pytest.raises(InputError) as caught:
        load_spec(path, kind)
    return str(caught.value)


def test_reads_numbers_and_units(tmp_path):
    path = tmp_path / "p.toml"
    path.write_text(PROJECT)
    spec = load_spec(path, ProjectSpec)
    assert spec.structure.length == 1.8
    assert spec.drive.forces == (13.0, 26.0)
    assert spec.dampers[0].container_mass == 0.0


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        (
            'length = "1.8 m"',
            'lenght = "1.8 m"',
            ["structure", "unknown key 'lenght'", "'1.8 m'", "nearest valid key is 'length'"],
        ),
        ('length = "1.8 m"', 'length = "1.8 kg"', ["structure.length", "'1.8 kg'", "[mass]", "[length]"]),
        ('length = "1.8 m"', "length = -1", ["structure.length", "given -1", "greater than 0"]),
        ('length = "1.8 m"', "", ["structure.length", "is missing", "[m]"]),
        ('kind = "beam"', 'kind = "beem"', ["structure", "beem", "beam"]),
        ('force = ["13 N", 26]', 'force = "0 N"', ["drive.force", "greater than 0"]),
        ('field = "field.nc"', "", ["dampers[1]", "either field or ideal"]),
        ("[drive]", "[drive", ["not a TOML file", "line"]),
        ('point = "1.7 m"', 'point = "1.7 m"\nbed_mass = 0', ["dampers[1].bed_mass", "given 0"]),
    ],
)
def test_names_the_mistake(old, new, words, tmp_path):
    assert old in PROJECT
    text = message(PROJECT.replace(old, new), tmp_path)
    assert text.startswith(str(tmp_path / "project.toml"))
    for word in words:
        assert word in text, text


def test_missing_file_and_no_text(tmp_path):
    with pytest.raises(InputError, match="cannot be opened"):
        load_spec(tmp_path / "none.toml", ProjectSpec)
    (tmp_path / "b.toml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(InputError, match="not a TOML file"):
        load_spec(tmp_path / "b.toml", ProjectSpec)


def test_several_mistakes_are_told_at_once():
    with pytest.raises(InputError) as caught:
        parse_spec({"files": ["a"], "bed_mass": "-1 g", "clearance": "x"}, MeasurementSpec, "d.toml")
    assert str(caught.value).count("d.toml: ") == 2


def test_a_wrong_entry_of_a_list_is_all_that_is_told():
    """Not that no other form fits, nor that without it too few are left."""
    for change, told in (
        ({"damper": DAMPER | {"particles": [{"material": "steel-s235", "radius": "-2 mm"}]}}, "particles[1].radius"),
        ({"plan": GRID | {"frequency": ["-120 Hz", "60 Hz"]}}, "frequency[1]"),
    ):
        with pytest.raises(InputError) as caught:
            parse_spec({"title": "made", "damper": DAMPER, "plan": GRID} | change, FieldSpec, "test")
        (line,) = str(caught.value).splitlines()
        assert told in line


def test_intensity_may_be_typed_as_acceleration():
    data = {"motion": "frozen", "intensity_range": ["1 g", "40 g"]}
    assert parse_spec(data, project.IdealFieldSpec, "x").intensity_range == pytest.approx((1, 40))


def test_specs_are_frozen():
    spec = MeasurementSpec(files=("a.csv",), bed_mass=0.1)
    with pytest.raises(ValueError, match="frozen"):
        spec.bed_mass = 0.2


def test_signals_need_a_file():
    with pytest.raises(InputError, match="files"):
        parse_spec({"files": []}, MeasurementSpec, "m.toml")


EVERY_SPEC = [
    entry
    for module in (measurement, project, structure)
    for entry in vars(module).values()
    if isinstance(entry, type) and issubclass(entry, BaseModel) and entry.__module__ == module.__name__
]


@pytest.mark.parametrize("kind", EVERY_SPEC, ids=lambda kind: kind.__name__)
def test_every_field_has_help_with_its_unit(kind):
    """The text under a field is its help; where the type knows a unit, the help names it."""
    assert issubclass(kind, Spec)
    for name, field in kind.model_fields.items():
        text = helps_of(kind).get(name, "")
        assert text, f"{kind.__name__}.{name} has no help"
        unit = (field.json_schema_extra or {}).get("unit") if isinstance(field.json_schema_extra, dict) else None
        if unit:
            assert f"[{unit}]" in text, f"{kind.__name__}.{name} does not name [{unit}]"
