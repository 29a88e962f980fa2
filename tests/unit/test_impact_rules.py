"""`graindamp rules impact | layers | beta`: JSON documents and printed lines."""

import json
from math import pi

import pytest
import typer
from typer.testing import CliRunner

from graindamp.cli.impact import register_impact
from graindamp.errors import InputError


def run(*words):
    app = typer.Typer(rich_markup_mode=None)
    register_impact(app)
    result = CliRunner().invoke(app, [str(word) for word in words])
    if result.exception and not isinstance(result.exception, SystemExit):
        raise result.exception
    return result.stdout


def document(*words):
    return json.loads(run(*words, "--json"))


def test_impact_rule():
    rule = document("impact", "--amplitude", "2 mm", "--mass-ratio", 0.027, "--restitution", 0.3)
    assert rule["clearance"] == pytest.approx(pi * 2e-3 * 1.3 / 0.7)
    assert rule["clearance_head_on"] == pytest.approx(pi * 2e-3)
    assert rule["head_on_psi_m"] == pytest.approx(5.16, abs=5e-3)
    assert rule["units"]["first_impact_phase"] == "rad"
    both = document("impact", "--amplitude", "2 mm", "--clearance", "6.283185307179586 mm")
    assert both["alpha"] == pytest.approx(1 / pi)
    assert both["steady_psi_m"] == pytest.approx(7.84, abs=0.01)
    gone = document("impact", "--amplitude", "1 mm", "--clearance", "6.2832 mm")
    assert gone["steady_psi_m"] is None
    assert "no steady motion" in gone["note"]
    text = run("impact", "--clearance", "14.88 mm")
    assert "amplitude best" in text
    assert "Witt (2011)" in text
    with pytest.raises(InputError, match="--amplitude"):
        run("impact")


def test_layers_and_beta():
    rule = document("layers", "--bed-height", "16.89 mm", "--diameter", "1.27 mm")
    assert (rule["layers"], rule["layers_close_packed"]) == (15, 16)
    words = ("--diameter", "1.27 mm", "--bed-height", "4.41 mm", "--cavity-height", "35.31 mm")
    rule = document("beta", "--amplitude", "5 mm", "--frequency", 20, *words)
    assert rule["beta"] == pytest.approx(18.6, abs=0.05)
    assert rule["sliding"] is True
