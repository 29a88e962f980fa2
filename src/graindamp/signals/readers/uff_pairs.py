"""Which force record of a universal file belongs to which motion record."""

from collections.abc import Callable, Hashable
from pathlib import Path
from typing import NamedTuple

from graindamp.errors import InputError
from graindamp.signals.readers.channels import Channel, choose, force_candidates, motion_candidates
from graindamp.signals.readers.runs import Run
from graindamp.spec.measurement import ChannelsSpec


class TimeRecord(NamedTuple):
    """One time record of dataset 58."""

    channel: Channel
    number: int
    """Place among the datasets 58 of the file, from 1."""
    run: tuple[Hashable, ...]
    """What may tell its run: id lines 2 to 5, version and load case."""
    node: tuple[Hashable, ...]
    """Response entity and node."""
    direction: int
    """Response axis: 1, 2, 3 along x, y, z; 4, 5, 6 about them; 0 not told."""


_KEYS: tuple[Callable[[TimeRecord], tuple[Hashable, ...]], ...] = (
    lambda record: (record.run, record.node, record.direction),
    lambda record: (record.run, record.node),
    lambda record: (record.run,),
    lambda record: (record.node, record.direction),
    lambda record: (record.node,),
    lambda record: (),
)
"""From the strictest to the loosest reason to take two records for one run."""


def paired_runs(records: list[TimeRecord], spec: ChannelsSpec, path: Path) -> list[Run]:
    """A run for each force record with its motion record, by id lines and response node, else by order.

    Where no force is asked for, a run for each motion record.

    Raises:
        InputError: force or motion missing, numbers that do not pair, or a pair along different axes.
    """
    channels = [record.channel for record in records]
    if not spec.with_force:
        return _single_runs(records, spec, path)
    chosen_forces = {id(channel) for channel in force_candidates(channels, spec)}
    chosen_motions = {id(channel) for channel in motion_candidates(channels, spec)}
    forces = [record for record in records if id(record.channel) in chosen_forces]
    motions = [record for record in records if id(record.channel) in chosen_motions]
    if not forces or not motions:
        choose(channels, spec, str(path))  # raises, and lists what there is
    pairs = next((found for key in _KEYS if (found := _pairs(forces, motions, key))), None)
    if pairs is None and len(forces) == len(motions):
        pairs = list(zip(forces, motions, strict=True))
    if pairs is None:
        raise InputError(
            f"{path}: {len(forces)} force and {len(motions)} motion records do not pair by id lines, response node or "
            f"order: {_listed([*forces, *motions])}. Say which to use in the description: [channels] "
            'motion_kind = "velocity", or force = "<id line 1>", motion = "<id line 1>"'
        )
    return [
        _run(force, motion, i if len(pairs) > 1 else None, spec, path) for i, (force, motion) in enumerate(pairs, 1)
    ]


def _single_runs(records: list[TimeRecord], spec: ChannelsSpec, path: Path) -> list[Run]:
    """A run for each motion record; of all where none is told, so that the message lists them."""
    chosen = {id(channel) for channel in motion_candidates([record.channel for record in records], spec)}
    motions = [record for record in records if id(record.channel) in chosen]
    return [
        Run(
            channels=(motion.channel,),
            facts={},
            label=path.stem if len(motions) == 1 else f"{path.stem}:{i}",
            source=f"{path.name}:record {motion.number}",
            place=f"{path}: record {motion.number}",
            rate_hint="export with even spacing and an abscissa increment",
        )
        for i, motion in enumerate(motions or records, 1)
    ]


def _pairs(
    forces: list[TimeRecord], motions: list[TimeRecord], key: Callable[[TimeRecord], tuple[Hashable, ...]]
) -> list[tuple[TimeRecord, TimeRecord]] | None:
    """Pairs of equal key; None unless every force has a key of its own and exactly one motion has it too."""
    partners: dict[tuple[Hashable, ...], list[TimeRecord]] = {}
    for motion in motions:
        partners.setdefault(key(motion), []).append(motion)
    if len({key(force) for force in forces}) < len(forces):
        return None
    found = [(force, partners.get(key(force), [])) for force in forces]
    return [(force, motion[0]) for force, motion in found] if all(len(motion) == 1 for _, motion in found) else None


def _run(force: TimeRecord, motion: TimeRecord, place_in_file: int | None, spec: ChannelsSpec, path: Path) -> Run:
    is_told = spec.force is not None and spec.motion is not None
    if force.direction and motion.direction and force.direction != motion.direction and not is_told:
        raise InputError(
            f"{path}: force and motion are along different axes: {_listed([force, motion])}. If they belong together, "
            'name them in the description: [channels] force = "<id line 1>", motion = "<id line 1>"'
        )
    numbers = f"records {force.number} and {motion.number}"
    return Run(
        channels=(force.channel, motion.channel),
        facts={},
        label=path.stem if place_in_file is None else f"{path.stem}:{place_in_file}",
        source=f"{path.name}:{numbers}",
        place=f"{path}: {numbers}",
        rate_hint="export with even spacing and an abscissa increment",
    )


def _listed(records: list[TimeRecord]) -> str:
    return ", ".join(
        f"{record.number} '{record.channel.name}' ({record.channel.kind}, node {record.node[-1]}, "
        f"axis {record.direction})"
        for record in records
    )
