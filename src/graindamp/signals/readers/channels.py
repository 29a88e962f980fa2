"""The channels of a run, and the choice of force and motion among them."""

import difflib
from collections.abc import Collection, Iterable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from graindamp.errors import InputError
from graindamp.signals.readers.kinds import (
    SI_UNIT,
    Kind,
    kind_of_name,
    kind_of_unit,
    split_suffix,
    split_unit,
    told_unit,
    unit_factor,
)
from graindamp.signals.record import MOTION_UNIT, MotionKind
from graindamp.spec.measurement import ChannelsSpec

_EXAMPLES: dict[Kind, str] = {
    "force": "N, kN, mN, lbf",
    "velocity": "m/s, mm/s, in/s",
    "acceleration": "m/s^2, mm/s^2, g",
    "displacement": "m, mm, um, in",
    "time": "s, ms, us",
}


class Channel(NamedTuple):
    """One signal as the file holds it."""

    name: str
    """Name as the file writes it."""
    values: Any
    """Samples in the file's own unit; anything numpy can read, shape (sample,)."""
    unit: str | None = None
    """Unit as the file writes it; None when it does not."""
    kind: Kind | None = None
    """What it measures; None when neither name nor unit tells."""
    is_named: bool = False
    """True when a name or a data type of the file tells the kind, not only its unit."""
    rate: float | None = None
    """Samples per second of this channel alone [Hz], if the file tells."""
    resolution: NDArray[np.float64] | None = None
    """Last digit written of each value, in the file's own unit; None for stored floating-point numbers."""
    scale: float = 1.0
    """What 1 means in SI where no unit is written."""


def named_channel(name: str, values: Any, unit: str | None = None, rate: float | None = None) -> Channel:
    """Channel whose kind and unit are recognised from its name, unless `unit` is written elsewhere."""
    suffixed = split_suffix(name)
    kind, is_word = kind_of_name(suffixed[0]) if suffixed else (None, False)
    if suffixed and kind and unit_factor(suffixed[1], SI_UNIT[kind]) is not None:
        unit_in_name: str | None = suffixed[1]
    else:
        bare, unit_in_name = split_unit(name)
        kind, is_word = kind_of_name(bare)
    unit = told_unit(unit) or unit_in_name
    by_unit = kind_of_unit(unit)
    if unit and not is_word and kind != by_unit:  # a letter is weak evidence, a unit is not
        return Channel(name, values, unit, by_unit, False, rate)
    return Channel(name, values, unit, kind, kind is not None, rate)


def candidates(channels: Iterable[Channel], kinds: Collection[str], name: str | None = None) -> list[Channel]:
    """Channels called `name`; without a name those of one of `kinds`, told by name or type before told by unit."""
    channels = list(channels)
    if name is not None:
        exact = [channel for channel in channels if channel.name == name]
        return exact or [channel for channel in channels if _is_called(channel, name)]
    signals = [channel for channel in channels if channel.kind in kinds]
    return [channel for channel in signals if channel.is_named] or signals


def force_candidates(channels: Iterable[Channel], spec: ChannelsSpec) -> list[Channel]:
    """Channels that may be the force."""
    found = candidates(channels, ("force",), spec.force)
    return [channel for channel in found if spec.force or not _is_called(channel, spec.motion)]


def motion_candidates(channels: Iterable[Channel], spec: ChannelsSpec) -> list[Channel]:
    """Channels that may be the motion."""
    kinds = [spec.motion_kind] if spec.motion_kind else list(MOTION_UNIT)
    found = candidates(channels, kinds, spec.motion)
    return [channel for channel in found if spec.motion or not _is_called(channel, spec.force)]


def choose(channels: Collection[Channel], spec: ChannelsSpec, place: str) -> tuple[Channel, Channel, MotionKind]:
    """Force, motion and what the motion is.

    Raises:
        InputError: one of them missing or ambiguous; the message lists the channels and the keys that settle it.
    """
    forces, motions = force_candidates(channels, spec), motion_candidates(channels, spec)
    problems = [
        *_problem(forces, channels, spec.force, "force"),
        *_problem(motions, channels, spec.motion, spec.motion_kind or "motion"),
    ]
    if not problems and forces[0] is motions[0]:
        problems.append(f"'{forces[0].name}' is chosen for both force and motion")
    kind = (spec.motion_kind or _motion_kind(motions[0], spec.motion_unit)) if motions else None
    if kind is None and not problems:
        problems.append(f"what '{motions[0].name}' measures is not told by its name or unit")
    if problems or kind is None:
        raise InputError(
            f"{place}: {'; '.join(problems)}. Channels found: {_listed(channels)}. Say which is which in the "
            'description: [channels] force = "<name>", motion = "<name>", '
            'motion_kind = "velocity" (or "acceleration", "displacement")'
        )
    return forces[0], motions[0], kind


def choose_motion(channels: Collection[Channel], spec: ChannelsSpec, place: str) -> tuple[Channel, MotionKind]:
    """The motion and what it is, of a run that needs no force.

    A kind in the description settles what the one channel without any tells.

    Raises:
        InputError: missing or ambiguous; the message lists the channels and the keys that settle it.
    """
    motions = motion_candidates(channels, spec)
    if not motions and spec.motion is None and spec.motion_kind:
        motions = [channel for channel in channels if channel.kind is None]
    problems = _problem(motions, channels, spec.motion, spec.motion_kind or "motion")
    kind = (spec.motion_kind or _motion_kind(motions[0], spec.motion_unit)) if motions else None
    if problems or kind is None:
        problems = problems or [f"what '{motions[0].name}' measures is not told by its name or unit"]
        raise InputError(
            f"{place}: {'; '.join(problems)}. Channels found: {_listed(channels)}. Say which it is in the "
            'description: [channels] motion = "<name>", motion_kind = "velocity" (or "acceleration", "displacement")'
        )
    return motions[0], kind


def si_values(channel: Channel, kind: Kind, unit: str | None, option: str, place: str) -> NDArray[np.float64]:
    """Samples of a channel in SI, shape (sample,).

    Args:
        channel: as the file holds it.
        kind: what it measures.
        unit: unit given in the description, in place of the file's own.
        option: the key of the description that gives it.
        place: file and place, to open messages.

    Raises:
        InputError: not real numbers, or a unit of another kind.
    """
    given = unit or channel.unit
    factor = unit_factor(given, SI_UNIT[kind]) if given else channel.scale
    if factor is None:
        origin = f"the description gives {option} =" if unit else f"channel '{channel.name}' is in"
        raise InputError(
            f"{place}: {origin} '{given}', which is no unit of {kind}; allowed is such as {_EXAMPLES[kind]}; "
            f'write what it is in the description: [channels] {option} = "{SI_UNIT[kind]}"'
        )
    values = np.asarray(channel.values)
    if values.dtype.kind not in "iuf":
        raise InputError(f"{place}: channel '{channel.name}' holds {values.dtype} values; expected real numbers")
    return values.astype(np.float64).reshape(-1) * factor


def _problem(found: list[Channel], channels: Iterable[Channel], name: str | None, role: str) -> list[str]:
    if len(found) == 1:
        return []
    names = ", ".join(f"'{channel.name}'" for channel in found)
    if name is None:
        return [f"{len(found)} channels may be the {role} ({names})" if found else f"no {role} channel is recognised"]
    if found:
        return [f"{len(found)} channels are called '{name}' ({names})"]
    near = difflib.get_close_matches(name, [channel.name for channel in channels], n=1, cutoff=0.5)
    return [f"no channel is called '{name}' (the {role})" + (f", nearest is '{near[0]}'" if near else "")]


def _listed(channels: Iterable[Channel]) -> str:
    return ", ".join(f"'{channel.name}'" + (f" in {channel.unit}" if channel.unit else "") for channel in channels)


def _motion_kind(motion: Channel, unit: str | None) -> MotionKind | None:
    told = motion.kind if motion.kind in MOTION_UNIT else kind_of_unit(unit)
    return next((kind for kind in MOTION_UNIT if kind == told), None)


def _is_called(channel: Channel, name: str | None) -> bool:
    return name is not None and _plain(channel.name) == _plain(name)


def _plain(name: str) -> str:
    return split_unit(name)[0].lower()
