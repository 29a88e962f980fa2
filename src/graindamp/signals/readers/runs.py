"""A run, the common form of all file formats, and its record in SI."""

from collections.abc import Callable, Iterable
from typing import NamedTuple

import numpy as np

from graindamp.errors import InputError
from graindamp.signals.readers.channels import (
    Channel,
    candidates,
    choose,
    choose_motion,
    force_candidates,
    motion_candidates,
    si_values,
)
from graindamp.signals.readers.clock import AGREEMENT, rate_of_time, stored_resolution
from graindamp.signals.readers.facts import Facts
from graindamp.signals.readers.kinds import unit_factor
from graindamp.signals.record import Record
from graindamp.spec.measurement import ChannelsSpec


class Run(NamedTuple):
    """One stretch of signals at one operating point, before anyone knows which channel is what."""

    channels: tuple[Channel, ...]
    facts: Facts
    label: str
    source: str
    place: str
    """File and place, to open messages."""
    rate_hint: str
    """How a file of this format supplies the sampling rate."""
    is_empty: bool = False
    where: Callable[[int], str] = "sample {}".format
    """How a person finds sample i."""


def records_of(runs: Iterable[Run], spec: ChannelsSpec, path: object) -> list[Record]:
    """Records of all runs of a file. Groups of arrays without any force or motion are not runs and are passed over.

    Raises:
        InputError: no run at all, or a run whose force, motion, unit or sampling rate is missing or ambiguous.
    """
    runs = [run for run in runs if run.channels]
    if not runs:
        needed = "a force and a motion, each" if spec.with_force else "a motion,"
        raise InputError(f"{path}: holds no signals; a record needs {needed} an array of samples")
    signals = [
        run
        for run in runs
        if (spec.with_force and force_candidates(run.channels, spec)) or motion_candidates(run.channels, spec)
    ]
    return [_record(run, spec) for run in signals or runs[:1]]


def _record(run: Run, spec: ChannelsSpec) -> Record:
    if spec.with_force:
        force, motion, kind = choose(run.channels, spec, run.place)
        force_values = si_values(force, "force", spec.force_unit, "force_unit", run.place) * spec.force_sign
    else:
        motion, kind = choose_motion(run.channels, spec, run.place)
        force, force_values = motion, np.empty(0)
    sampling_rate, motion_rate = _rates(run, force, motion, spec)
    return Record(
        force=force_values,
        motion=si_values(motion, kind, spec.motion_unit, "motion_unit", run.place),
        motion_kind=kind,
        sampling_rate=sampling_rate,
        motion_rate=motion_rate,
        frequency=run.facts.get("frequency"),
        nominal_intensity=run.facts.get("nominal_intensity"),
        label=run.label,
        source=run.source,
        container_mass=run.facts.get("container_mass"),
        bed_mass=run.facts.get("bed_mass"),
        is_empty=run.is_empty,
    )


def _rates(run: Run, force: Channel, motion: Channel, spec: ChannelsSpec) -> tuple[float, float]:
    """Samples per second of force and motion [Hz]: by the description, else the file's words, else its time channel."""
    told = run.facts.get("sampling_rate")
    force_told = force.rate or told or motion.rate
    motion_told = motion.rate or told or force.rate
    if spec.sampling_rate is not None:  # corrects the file, but two rates stay two rates
        ratio = motion_told / force_told if motion_told and force_told else 1.0
        return spec.sampling_rate, spec.sampling_rate * ratio
    measured = _time_rate(run, is_needed=force_told is None)
    if force_told is None or motion_told is None:
        if measured is None:
            raise InputError(
                f"{run.place}: the sampling rate is not told; {run.rate_hint}, "
                'or write it in the description: [channels] sampling_rate = "51200 Hz"'
            )
        return measured, measured
    if measured is not None and abs(measured / force_told - 1) > AGREEMENT:
        raise InputError(
            f"{run.place}: the file states a sampling rate of {force_told:.8g} Hz, but its time channel steps at "
            f"{measured:.8g} Hz; correct one of them (is the unit of time right?), or write the rate in the "
            f'description: [channels] sampling_rate = "{measured:.8g} Hz"'
        )
    return force_told, motion_told


def _time_rate(run: Run, is_needed: bool) -> float | None:
    """Rate of the time channel [Hz]; None without one, or for one without numbers where the rate is told elsewhere."""
    time = next(iter(candidates(run.channels, ("time",))), None)
    if time is None or not (is_needed or time.is_named):  # seconds alone may be a delay
        return None
    seconds = si_values(time, "time", None, "sampling_rate", run.place)
    if not is_needed and not np.isfinite(seconds).any():
        return None
    if time.resolution is None:
        resolution = stored_resolution(seconds)
    else:
        resolution = time.resolution * (unit_factor(time.unit or "s", "s") or 1.0)
    return rate_of_time(seconds, resolution, f"{run.place}: channel '{time.name}'", run.where)
