"""Kernels and contact laws compile for a GPU where there is none, in the precision that was meant."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("numba_cuda", reason="the extra `gpu` (numba-cuda) is not installed")

LIBRARY = 1
"""Instructions in single precision in CUDA's own tanh for double precision, which foam uses."""

TESTS = Path(__file__).parents[1]


def compiled(*arguments):
    """What :mod:`ptx_made` finds; in a process where numba compiles for CUDA and does not simulate."""
    environment = {**os.environ, "NUMBA_ENABLE_CUDASIM": "0", "PYTHONPATH": str(TESTS)}
    command = [sys.executable, str(TESTS / "ptx_made.py"), *arguments]
    out = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert out.returncode == 0, out.stderr[-3000:]
    return json.loads(out.stdout.splitlines()[-1])


@pytest.mark.slow
@pytest.mark.parametrize("precision", ["mixed", "double"])
def test_contact_laws_compute_in_one_precision(precision):
    """A bare 0.5 in a law would promote single precision to double; none does, and none drops to single in double."""
    for name, found in compiled("laws", precision).items():
        assert found["own"] > 4, name
        assert found["other"] <= (LIBRARY if name == "foam_force" else 0), name


@pytest.mark.slow
@pytest.mark.parametrize(("precision", "features"), [("mixed", "springs"), ("double", "plain")])
def test_the_kernel_compiles(precision, features):
    """In both precisions, with and without springs and teams. No atomic sums: their order would show."""
    found = compiled("advance", precision, features)
    assert found["entries"] == found["target"] == 1
    assert found["barriers"] > 10
    assert found["float_atomics"] == 0
    assert found["own"] > 100
    if precision == "double":
        assert found["other"] <= LIBRARY


@pytest.mark.slow
@pytest.mark.parametrize("precision", ["mixed", "double"])
def test_the_kernel_that_clears_a_slot_compiles(precision):
    assert compiled("clear", precision, "plain")["entries"] == 1
