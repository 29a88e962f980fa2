"""Results of operating points to an effective field: the mean over beds, with an error that knows their scatter."""

import json
import math
from collections.abc import Mapping, Sequence
from importlib.metadata import version
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from graindamp.campaign.backends import CPU, is_device, precision_of
from graindamp.campaign.hysteresis import distance
from graindamp.campaign.point import LOSSES, PHYSICS, PointResult
from graindamp.errors import InputError
from graindamp.field.schema import TABLE, make_field
from graindamp.spec.field import FieldSpec, GridPlan
from graindamp.status import FATAL, Status

MISSING = Status.NOT_COMPUTED
"""Status of a point that has no result: it failed, or has not been run."""
UNKNOWN_MODE = -1
"""Motion mode of a point that was not classified."""

Place = tuple[float, float]
"""Frequency [Hz] and intensity Gamma [-]."""


class Answer(NamedTuple):
    """What one bed answers at one operating point."""

    rest: PointResult | None
    """Started from rest; None if there is no result."""
    other: PointResult | None = None
    """Started from a neighbour's end, if that differs."""
    particle_steps: float = 0.0
    """Cost of the runs from neighbours [-]."""


def field_of(spec: FieldSpec, answers: Mapping[Place, Sequence[Answer]], backend: str = CPU) -> xr.Dataset:
    """Effective field; it depends on the answers alone, to the last bit.

    Args:
        spec: the field.
        answers: of every bed, in the order of their numbers, at every operating point; on a grid points may be missing.
        backend: what has computed them.

    Raises:
        InputError: no point has a usable value.
    """
    grid = spec.plan if isinstance(spec.plan, GridPlan) else None
    places = list(grid.points) if grid else list(answers)
    columns = [_row(answers.get(place, ())) for place in places]
    if not any(np.isfinite(row["loss_factor"]) for row in columns):
        raise InputError(f"{spec.title}: no operating point has a usable value")
    shape = (len(grid.frequencies), len(grid.intensities)) if grid else (len(places),)
    values = {name: np.array([row[name] for row in columns]).reshape(shape) for name in columns[0]}
    if spec.hysteresis == "none":
        values = {name: value for name, value in values.items() if "_other" not in name}
    if spec.seeds == 1:
        values = {name: value for name, value in values.items() if not name.startswith("n_beds")}
    if np.all(values["motion_mode"] == UNKNOWN_MODE):
        del values["motion_mode"]
    first = [answer.rest for place in places for answer in answers.get(place, ()) if answer.rest is not None]
    damper = _damper(spec, first)
    field = make_field(
        grid.frequencies if grid else [f for f, _ in places],
        grid.intensities if grid else [gamma for _, gamma in places],
        values.pop("loss_factor"),
        values.pop("effective_mass_ratio"),
        damper["bed_mass"],
        source="simulated",
        scattered=grid is None,
        variables={name: value for name, value in values.items() if name in TABLE},
        damper=damper,
    )
    field.attrs |= {
        "spec": spec.model_dump_json(),
        "graindamp_version": version("graindamp"),
        "physics": PHYSICS,
        "seeds": spec.seeds,
        "softening": float(spec.damper.contact.softening),
        "backend": "cuda" if is_device(backend) else "cpu",
        "precision": precision_of(backend),
    }
    return field


def _row(answers: Sequence[Answer]) -> dict[str, Any]:
    """Values of one operating point."""
    good = [answer.rest for answer in answers if answer.rest is not None and not answer.rest.failed]
    first, second = _branches(answers)
    row: dict[str, Any] = {
        "particle_steps": sum(
            answer.particle_steps + (answer.rest.particle_steps if answer.rest else 0.0) for answer in answers
        ),
        "n_cycles": sum(one.n_cycles for one in first),
        "n_beds": len(first),
        "n_beds_other": len(second),
        "solid_fraction": _mean([one.solid_fraction for one in good]),
        "motion_mode": _mode(first),
        "status": _status(answers, good, bool(second)),
    } | _shares(first)
    for name in ("loss_factor", "effective_mass_ratio"):
        for branch, end in ((first, ""), (second, "_other")):
            values, errors = ([getattr(one, name + more) for one in branch] for more in ("", "_se"))
            row[name + end] = _mean(values)
            row[f"{name}{end}_se"] = _error(values, errors)
    return row


def _branches(answers: Sequence[Answer]) -> tuple[list[PointResult], list[PointResult]]:
    """Answers of all beds, by the branch that they are on; without second answers all are on the first.

    Beds may come to either branch from rest. So each answer goes to the nearer of the two answers that lie furthest
    apart in one bed, and the branch that more beds come to from rest is the first.
    """
    rest = [answer.rest for answer in answers if answer.rest is not None and not answer.rest.failed]
    pairs = [
        (answer.rest, answer.other)
        for answer in answers
        if answer.rest is not None and not answer.rest.failed and answer.other is not None
    ]
    if not pairs:
        return rest, []
    here, there = max(pairs, key=lambda pair: distance(*pair))

    def is_here(one: PointResult) -> bool:
        return distance(one, here) <= distance(one, there)

    from_rest = sum(is_here(one) for one in rest)
    whole = [*rest, *(other for _, other in pairs)]
    branches = [one for one in whole if is_here(one)], [one for one in whole if not is_here(one)]
    first = 0 if 2 * from_rest > len(rest) or (2 * from_rest == len(rest) and is_here(rest[0])) else 1
    return branches[first], branches[1 - first]


def _shares(good: Sequence[PointResult]) -> dict[str, float]:
    """Share of each mechanism in the power dissipated in all beds together; NaN where none is."""
    power = [math.fsum(float(one.losses[k]) for one in good) for k in range(len(LOSSES))]
    total = math.fsum(power)
    names = (name.replace("loss_", "loss_share_", 1) for name in LOSSES)
    return {name: value / total if total > 0.0 else math.nan for name, value in zip(names, power, strict=True)}


def _mean(values: Sequence[float]) -> float:
    return math.fsum(values) / len(values) if values else math.nan


def _error(values: Sequence[float], errors: Sequence[float]) -> float:
    """Standard error of the mean: the larger of that within the beds and that of their scatter."""
    n = len(values)
    if n == 0:
        return math.nan
    within = math.sqrt(math.fsum(error**2 for error in errors)) / n
    if n == 1:
        return within
    middle = _mean(values)
    scatter = math.sqrt(math.fsum((value - middle) ** 2 for value in values) / (n - 1))
    return max(within, scatter / math.sqrt(n))


def _mode(good: Sequence[PointResult]) -> int:
    """Motion mode of the first bed that has one; results of some versions have none."""
    modes = [int(getattr(one, "motion_mode", UNKNOWN_MODE)) for one in good]
    return next((mode for mode in modes if mode != UNKNOWN_MODE), UNKNOWN_MODE)


def _status(answers: Sequence[Answer], good: Sequence[PointResult], bistable: bool) -> int:
    """Bits of all beds. Where a bed is usable, the fatal bits of another are left out, for the value is usable."""
    if not good:
        bits = [answer.rest.status for answer in answers if answer.rest is not None]
        return int(np.bitwise_or.reduce(bits)) if bits else int(MISSING)
    status = int(np.bitwise_or.reduce([one.status for one in good]))
    if bistable:
        status |= int(Status.BISTABLE)
    return status & ~int(FATAL)


def _damper(spec: FieldSpec, results: Sequence[PointResult]) -> dict[str, Any]:
    """Facts of the bed, as means over all results."""
    facts: dict[str, Any] = {"name": spec.damper.name, "n_particle": results[0].n_particle}
    for name in ("bed_mass", "clearance", "solid_fraction"):
        values = [getattr(one, name) for one in results if math.isfinite(getattr(one, name))]
        if values:
            facts[name] = float(f"{_mean(values):.12g}")
    return json.loads(json.dumps(facts))  # type: ignore[no-any-return]
