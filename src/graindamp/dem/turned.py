"""The packed bed after its container was turned: at rest under the gravity of the run.

A bed is packed under gravity along the direction of pouring, and then turned to how the damper is mounted. It slumps
for some hundredths of a second, with more energy than a weak vibration at high frequency puts into it; a run that began
on the way would measure the slump. So the bed is brought to rest once, and kept beside the packing.
"""

import hashlib
from pathlib import Path

import numpy as np

from graindamp.dem.cavity import Cavity
from graindamp.dem.container import enclosure_of
from graindamp.dem.interactions import interactions_of
from graindamp.dem.packing_store import Packing, Progress, default_folder, kept, packing_key
from graindamp.dem.settle import (
    SOFT_OVERLAP,
    Grains,
    Scene,
    grains_of,
    pressure_of,
    resting_overlap,
    run_to_rest,
    slow_speed,
    softened,
    softening,
    stiffened,
    time_step,
)
from graindamp.spec.simulation import DamperSpec
from graindamp.units import STANDARD_GRAVITY

LOOK, LONGEST = 5e-3, 1.0
"""Time between looks at a bed that comes to rest, and time after which it is stopped [s], under standard gravity."""

LOOSE = 0.6
"""Solid fraction that the width of the bed is guessed with [-]."""


def turned(
    damper: DamperSpec,
    packing: Packing,
    *,
    physics: int,
    folder: Path | None = None,
    cache: Path | None = None,
    progress: Progress | None = None,
) -> Packing:
    """The bed at rest under the damper's gravity, from the cache or brought to rest now.

    Args:
        damper: the description.
        packing: its bed, as packed.
        physics: version of how beds are packed, part of the key.
        folder: what files in the description are relative to; None: the working folder.
        cache: folder of stored packings; None: that of the user.
        progress: told how far it is.

    Raises:
        PackingError: the bed found no rest, a defect.
    """
    if not _was_turned(damper):
        return packing
    path = (default_folder() if cache is None else cache) / f"{_key(damper, packing, physics, folder)[:32]}.npz"
    return kept(path, lambda: at_rest(damper, packing, folder=folder, progress=progress), "settled")


def at_rest(
    damper: DamperSpec, packing: Packing, *, folder: Path | None = None, progress: Progress | None = None
) -> Packing:
    """The bed after it came to rest under the damper's gravity; arguments and errors as :func:`turned`.

    Contacts are soft on the way and are stiffened at the end, as while packing.
    """

    def watch(fraction: float) -> None:
        if progress is not None:
            progress("settle", min(fraction, 1.0), None)

    interactions = interactions_of(damper)
    enclosure = enclosure_of(damper, interactions, lid_height=packing.lid_height, folder=folder)
    material = np.asarray(interactions.component, np.int32)[packing.component]
    grains = Grains.at_rest(packing.position, packing.radius, material, interactions.density)
    weight = float(np.linalg.norm(damper.gravity)) / STANDARD_GRAVITY
    pressure = weight * pressure_of(grains, (grains.solid_volume / LOOSE) ** (2.0 / 3.0))
    divisor = softening(interactions, packing.radius, slow_speed(grains) * weight**0.5, pressure)
    soft = softened(interactions, divisor)
    scene = Scene(enclosure, interactions, damper.gravity)
    worlds = scene._replace(interactions=soft).worlds(grains, time_step(soft, packing.radius, SOFT_OVERLAP))
    grains = grains_of(run_to_rest(worlds, grains, LOOK / weight**0.5, LONGEST / weight**0.5, watch), grains)
    cavity = Cavity(damper, enclosure, grains.solid_volume)
    allowed = resting_overlap(interactions, packing.radius, pressure)
    grains = stiffened(scene, grains, cavity, divisor, allowed, watch)
    return packing._replace(position=grains.bed.position)


def _was_turned(damper: DamperSpec) -> bool:
    """Whether gravity of the run is another than that of the packing."""
    gravity = np.asarray(damper.gravity)
    size = float(np.linalg.norm(gravity))
    if size == 0.0:
        return False
    along = float(gravity @ np.asarray(damper.pour_direction))
    return damper.packing.method == "grow" or along < (1.0 - 1e-9) * size


def _key(damper: DamperSpec, packing: Packing, physics: int, folder: Path | None) -> str:
    told = hashlib.sha256(packing_key(damper, physics, folder).encode())
    told.update(np.asarray(damper.gravity, float).tobytes() + packing.position.tobytes())
    told.update(repr(packing.lid_height).encode())  # beds are dear, lids are not: one bed may be under several
    return told.hexdigest()
