"""Kernels and the forces of contacts compile for a GPU where there is none, in the precision that was meant."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("numba_cuda", reason="the extra `gpu` (numba-cuda) is not installed")

ALLOWED = {
    "pair": {
        "sub": 7,  # positions 3, velocities at mid-step 3, squares of distance and reach
        "add": 2,  # radii, number of contacts
        "mul": 2,  # square of the distance, of the reach
        "fma": 5,  # square of the distance 2, losses of the step to the ledger 3
        "rcp": 1,  # 1 / time step
        "setp": 1,  # whether they touch
        "max": 1,  # largest overlap
        "cvt from": 17,  # of double numbers read or subtracted, which go on in single precision
        "cvt to": 4,  # losses 3, largest overlap
    },
    "wall": {
        "sub": 5,  # overlap, arm, power and force of the container 2, its work
        "add": 1,  # number of contacts
        "mul": 3,  # power, force along the motion, work
        "fma": 10,  # power 2, force 2, Fourier sums 2, losses of the step to the ledger 4
        "rcp": 1,
        "setp": 2,  # whether they touch, by element and at last
        "max": 2,  # largest overlap, of the step and of all
        "cvt from": 23,
        "cvt to": 7,  # force 3, losses 4
    },
}
"""Instructions in double precision in the forces of mixed precision: positions, velocities at mid-step and their
differences, sums. A bare 0.5 in a law, or a tuple (0.0, 0.0), adds to them."""

LIBRARY = {"cvt to": 1, "cvt from": 2, "mul": 1, "ex2": 1, "abs": 1, "setp": 5}
"""Instructions in single precision in CUDA's own functions for double precision: in the exp of the tanh that foam uses,
and in divisions, which compare exponents to find the quotients that need care."""

TESTS = Path(__file__).parents[1]


def compiled(*arguments):
    """What :mod:`ptx_made` finds; in a process where numba compiles for CUDA and does not simulate."""
    paths = os.pathsep.join([str(TESTS), *filter(None, [os.environ.get("PYTHONPATH")])])
    environment = {**os.environ, "NUMBA_ENABLE_CUDASIM": "0", "PYTHONPATH": paths}
    command = [sys.executable, str(TESTS / "ptx_made.py"), *arguments]
    out = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert out.returncode == 0, out.stderr[-3000:]
    return json.loads(out.stdout.splitlines()[-1])


@pytest.mark.slow
def test_forces_in_mixed_precision_are_single_where_they_are_meant_to_be():
    """The forces of pairs and walls as a whole, with springs, rolling resistance and foam."""
    for name, found in compiled("forces").items():
        assert sum(found["f32"].values()) > 200, name
        allowed = ALLOWED[name]
        assert {key: count for key, count in found["f64"].items() if count > allowed.get(key, 0)} == {}, name


@pytest.mark.slow
@pytest.mark.parametrize(("precision", "features"), [("mixed", "plain"), ("double", "features")])
def test_the_kernels_compile(precision, features):
    """As fields run it, in mixed precision without springs and teams; and in double precision with all of them, where
    nothing is single. No atomic sums: their order would show. The stopping rule is called, not woven in, where it would
    take registers from the steps."""
    found = compiled(precision, features)
    assert found["entries"] == found["clear_entries"] == found["target"] == 1
    assert found["apart"] >= 1
    assert found["barriers"] > 10
    assert found["float_atomics"] == 0
    assert found["own"] > 100
    if precision == "double":
        assert {key: count for key, count in found["other"].items() if count > LIBRARY.get(key, 0)} == {}
