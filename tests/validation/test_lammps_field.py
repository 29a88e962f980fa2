"""Loss factor and effective mass of a 500-sphere damper against LAMMPS, at points of the shipped field."""

import importlib.util
import sys
from pathlib import Path

import numpy as np
import pytest

SCRIPT = Path(__file__).parents[2] / "benchmarks" / "lammps_field.py"


@pytest.fixture(scope="module")
def script():
    """The benchmark that compares all thirty points."""
    spec = importlib.util.spec_from_file_location("lammps_field", SCRIPT)
    module = importlib.util.module_from_spec(spec)
    sys.modules["lammps_field"] = module
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def points(script):
    """What LAMMPS gave, by frequency and intensity."""
    return {(p.frequency, p.nominal_intensity): p for p in script.reference()}


def test_loss_factor_and_mass_are_near_those_of_lammps(script, points):
    """One point for every test run, in 16 cycles after 0.02 s at rest, half of what LAMMPS took.

    The first cycles, in which the bed still loosens, then weigh more: measured -11 % and 0.012, of which the scatter
    between runs is 1 % and 0.001. What is left to 20 % and 0.02 is the wandering of such beds, up to 10 %.
    """
    row = script.compare(points[400.0, 16.0], cycles=16, settle=0.02)
    assert row["eta"] == pytest.approx(row["eta_lammps"], rel=0.2)
    assert row["mass"] == pytest.approx(row["mass_lammps"], abs=0.02)


@pytest.mark.slow
def test_loss_factor_and_mass_agree_with_lammps(script, points):
    """Beds started alike are chaotic, so only their statistics can agree: within combined standard errors.

    Chi-square of the six numbers stays under its 99.9 % quantile for six degrees of freedom, 22.5, times 1.5 squared.
    The factor is for errors from within a run that are too small for beds that wander: over 26 points the scatter
    between runs is 1.0 (eta) and 1.2 (m') times these in the mean square, but chi-square of single runs goes up to 2.3
    and 3.5 times its expectation (benchmarks/results/lammps_field.md).
    """
    rows = [script.compare(points[key]) for key in ((250.0, 40.0), (400.0, 2.5), (400.0, 16.0))]
    z = np.array([[row["eta_z"], row["mass_z"]] for row in rows])
    assert np.sum(z**2) < 22.5 * 1.5**2
    assert all(row["eta"] > 0 for row in rows)
