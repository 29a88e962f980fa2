"""What a prediction tells of the fields that it was made with."""

import json

from typer.testing import CliRunner

from fields_made import constant_field
from graindamp.cli.main import app
from graindamp.field.store import write_field
from graindamp.status import Status

PROJECT = """
[structure]
kind = "beam"
length = "1 m"
n_element = 10
bending_stiffness = "500 N m^2"
mass_per_length = "2 kg/m"
ends = ["free", "free"]
n_mode = 1
damping = { kind = "modal", ratio = "0.2 %" }

[[dampers]]
name = "jar"
point = "0.95 m"
field = "field.nc"

[drive]
point = "5 cm"
force = ["5 N"]
"""


def warnings_with(tmp_path, field):
    write_field(field, tmp_path / "field.nc")
    (tmp_path / "project.toml").write_text(PROJECT, encoding="utf-8")
    result = CliRunner().invoke(app, ["predict", str(tmp_path / "project.toml"), "--json"])
    assert result.exit_code == 0, result.output + str(result.exception)
    return json.loads(result.stdout)["warnings"]


def test_points_with_two_answers_are_told(tmp_path):
    field = constant_field()
    assert warnings_with(tmp_path, field) == []
    field["status"][0, 0] = int(Status.BISTABLE)
    (told,) = warnings_with(tmp_path, field)
    assert told.startswith("field of jar: 1 of 4 points depend on where the bed started (BISTABLE)")


def test_a_field_of_one_bed_is_told(tmp_path):
    field = constant_field()
    field.attrs["seeds"] = 1
    (told,) = warnings_with(tmp_path, field)
    assert "add [bed_study]" in told
