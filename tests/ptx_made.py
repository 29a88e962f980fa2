"""Compiles kernels and contact laws for a Hopper GPU on a machine without one; run as a script, prints what is in the
PTX as JSON. In a process of its own, because the other tests let numba simulate."""

import json
import re
import sys
from typing import Any

import numba
import numpy as np
from numba import cuda, types
from numba.cuda import dispatcher

from graindamp.dem import laws, springs
from graindamp.dem.gpu import forces, kernels, state
from graindamp.dem.gpu.device import Builder, Variant

CAPABILITY = (9, 0)
WORKING = {"mixed": (np.float32, "f32", "f64"), "double": (np.float64, "f64", "f32")}


class _Hopper:
    """Stands for the device that a device function is compiled for."""

    compute_capability = CAPABILITY


def batch_type(variant: Variant) -> Any:
    """Type of the argument of the kernels."""
    room = state.Room(*[1] * 12, variant.threads, variant.springs, variant.rolling)
    parts = []
    for part, names in state.layout(room, variant.real).items():
        kind = state.PARTS[part]
        arrays = [
            types.Array(numba.from_dtype(np.dtype(names[name][1])), len(names[name][0]), "C") for name in kind._fields
        ]
        parts.append(types.NamedTuple(arrays, kind))
    return types.NamedTuple(parts, state.Batch)


def kernel(name: str, variant: Variant) -> str:
    """PTX of a kernel."""
    builder = Builder(variant)
    return cuda.compile_ptx(
        builder.plain(getattr(kernels, name)), (batch_type(variant), types.int64), cc=CAPABILITY, fastmath=variant.fast
    )[0]


def function(body: Any, variant: Variant, arguments: tuple[Any, ...]) -> str:
    """PTX of a function of scalars."""
    body = getattr(body, "py_func", body)
    return cuda.compile_ptx(Builder(variant).plain(body), arguments, device=True, cc=CAPABILITY)[0]


def arithmetic(ptx: str, kind: str) -> int:
    """Instructions that compute with numbers of type `kind`; moves, loads and conversions do not count."""
    return len(re.findall(rf"^\s*(?:add|sub|mul|fma|div|sqrt|rcp|min|max)\.[a-z.]*{kind}\b", ptx, re.MULTILINE))


def laws_of(precision: str) -> dict[str, dict[str, int]]:
    """Instructions of the working type and of the other one in every contact law."""
    real, own, other = WORKING[precision]
    x = numba.from_dtype(np.dtype(real))
    variant, integer, flag = Variant(real), types.int64, types.boolean
    bodies = {
        "smooth_contact": (forces.smooth_contact, (integer, flag, flag, *[x] * 12)),
        "spring_force": (springs.spring_force, (x,) * 17),
        "rolling_torque": (springs.rolling_torque, (x,) * 10),
        "foam_force": (laws.foam_force, (x,) * 7),
        "dashpot_of": (laws.dashpot_of, (integer, *[x] * 4)),
    }
    found = {}
    for name, (body, arguments) in bodies.items():
        ptx = function(body, variant, arguments)
        found[name] = {"own": arithmetic(ptx, own), "other": arithmetic(ptx, other)}
    return found


def kernel_of(name: str, precision: str, features: bool) -> dict[str, int]:
    """What is in a kernel."""
    real, own, other = WORKING[precision]
    ptx = kernel(name, Variant(real, 512, springs=features, rolling=features, teams=features))
    return {
        "entries": ptx.count(".visible .entry"),
        "target": int("sm_90" in ptx),
        "own": arithmetic(ptx, own),
        "other": arithmetic(ptx, other),
        "barriers": ptx.count("bar.sync") + ptx.count("barrier.sync") + ptx.count("bar.red"),
        "float_atomics": len(re.findall(r"\b(?:atom|red)\.[a-z.]*f(?:32|64)", ptx)),
    }


if __name__ == "__main__":
    dispatcher.get_current_device = lambda: _Hopper
    if sys.argv[1] == "laws":
        print(json.dumps(laws_of(sys.argv[2])))
    else:
        print(json.dumps(kernel_of(sys.argv[1], sys.argv[2], sys.argv[3] == "springs")))
