"""Compiles kernels and the forces of contacts for a Hopper GPU on a machine without one; run as a script, prints what
is in the PTX as JSON. In a process of its own, because the other tests let numba simulate."""

import gc
import json
import re
import sys
from collections import Counter
from typing import Any

import numba
import numpy as np
from numba import cuda, types
from numba.cuda import dispatcher

from graindamp.dem.gpu import forces, kernels, state, touches
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


COMPUTE = "add|sub|mul|fma|mad|div|sqrt|rsqrt|rcp|min|max|abs|neg|setp|ex2|lg2|sin|cos|tanh|copysign|cvt"
"""Instructions that compute, compare or convert. Moves, loads and selections do not count."""


def operations(ptx: str, kind: str) -> dict[str, int]:
    """Number of instructions that compute with numbers of type `kind`, by name; conversions by direction, "cvt to" and
    "cvt from" that type, and only between two kinds of numbers that are not whole."""
    found: Counter[str] = Counter()
    for name, rest in re.findall(rf"^\s*(?:@!?%\w+\s+)?({COMPUTE})\.([a-z0-9.]+)", ptx, re.MULTILINE):
        types_of = [part for part in rest.split(".") if re.fullmatch(r"[fsub](?:16|32|64)|pred", part)]
        if name != "cvt":
            found[name] += kind in types_of
        elif set(types_of) == {"f32", "f64"}:
            found["cvt to" if types_of[0] == kind else "cvt from"] += 1
    return {name: count for name, count in sorted(found.items()) if count}


def _pair_held(w, step, i, j, p, rate, law, side, tangential, touched, grip, batch):
    """Stands for the function that finds the constants of a contact at its onset, in double precision."""


def _wall_held(w, step, i, e, t, rate, law, side, batch, grip):
    """The same for walls."""


def _plane(kind, shapes, e, edges, x, y, z, radius):
    """Stands for `nearest`, which finds the nearest point of a wall, in double precision; computes nothing."""
    return x, y, z, 1.0


def forces_of() -> dict[str, dict[str, dict[str, int]]]:
    """Instructions in the forces of pairs and of walls in mixed precision, by their kind: springs, rolling resistance
    and foam are included; what is meant to be double throughout is replaced by functions that compute nothing."""
    variant = Variant(np.float32, 512, springs=True, rolling=True)
    whole, row, batch = types.int64, types.Array(types.float64, 1, "C"), batch_type(variant)
    forces.take_hold, touches.take_hold, touches.nearest = _pair_held, _wall_held, _plane
    bodies = {
        "pair": (forces.pair_forces, (whole, whole, whole, whole, batch)),
        "wall": (touches.wall_forces, (whole, whole, row, whole, whole, batch)),
    }
    found = {}
    for name, (body, arguments) in bodies.items():
        ptx = cuda.compile_ptx(Builder(variant).plain(body), arguments, device=True, cc=CAPABILITY)[0]
        found[name] = {kind: operations(ptx, kind) for kind in ("f32", "f64")}
    return found


def kernels_of(precision: str, features: bool) -> dict[str, Any]:
    """What is in the kernel of the steps, and the entries of the one that clears a slot; `features`: with springs,
    rolling resistance and teams of blocks."""
    real, own, other = WORKING[precision]
    variant = Variant(real, 512, springs=features, rolling=features, teams=features)
    ptx, clear = kernel("advance", variant), kernel("clear", variant)
    return {
        "entries": ptx.count(".visible .entry"),
        "clear_entries": clear.count(".visible .entry"),
        "target": int("sm_90" in ptx),
        "own": sum(operations(ptx, own).values()),
        "other": operations(ptx, other),
        "apart": len(re.findall(r"^\.weak \.func .*verdict5judge", ptx, re.MULTILINE)),
        "barriers": ptx.count("bar.sync") + ptx.count("barrier.sync") + ptx.count("bar.red"),
        "float_atomics": len(re.findall(r"\b(?:atom|red)\.[a-z.]*f(?:32|64)", ptx)),
    }


if __name__ == "__main__":
    gc.disable()  # a tenth of the time, for nothing that would be freed
    dispatcher.get_current_device = lambda: _Hopper
    if sys.argv[1] == "forces":
        print(json.dumps(forces_of()))
    else:
        print(json.dumps(kernels_of(sys.argv[1], sys.argv[2] == "features")))
