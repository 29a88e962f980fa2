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
    """One point in 20 cycles instead of 30, for every test run.

    eta of 30 cycles scatters by 2 % between runs here, and LAMMPS' own is right to 2 %; fewer cycles leave more of the
    first ones in the mean, in which the bed still loosens, measured -4 %. Beds of 500 spheres wander by up to 10 %.
    """
    row = script.compare(points[400.0, 16.0], cycles=20)
    assert row["eta"] == pytest.approx(row["eta_lammps"], rel=0.15)
    assert row["mass"] == pytest.approx(row["mass_lammps"], abs=0.01)  # scatter 0.001, LAMMPS' own error 0.004


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
