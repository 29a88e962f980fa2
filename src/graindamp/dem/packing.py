"""Beds of particles: poured or grown into the container, shaken until they are compact, and closed with the lid.

Packing works with softened contacts, whose longer time steps save nearly all of the work, and ends with a bed at rest
under the described stiffness.
"""

import math
import time
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from graindamp.dem.cavity import Cavity, random_places
from graindamp.dem.container import Enclosure, enclosure_of
from graindamp.dem.engine import run
from graindamp.dem.interactions import Interactions, interactions_of
from graindamp.dem.motion import DIRECTION, START, MotionKind
from graindamp.dem.packing_store import Packing, Progress, default_folder, kept, packing_key
from graindamp.dem.settle import (
    SOFT_OVERLAP,
    Grains,
    PackingError,
    Scene,
    grains_of,
    largest_overlap,
    pressure_of,
    quench,
    resting_overlap,
    run_to_rest,
    slippery,
    slow_speed,
    softened,
    softening,
    sound,
    stiffened,
    time_step,
)
from graindamp.dem.sizes import count_for, draw_bed, mean_particle
from graindamp.dem.state import Motion, Worlds
from graindamp.errors import InputError
from graindamp.spec.container import FoamLid, MeshContainer, RigidLid, SphereContainer
from graindamp.spec.particles import DENSEST_PACKING
from graindamp.spec.simulation import DamperSpec, TapSpec
from graindamp.units import STANDARD_GRAVITY

Real = NDArray[np.float64]

PHYSICS = 1
"""Version of how beds are packed; a higher one makes stored packings worthless."""

LOOSE_FRACTION = 0.25
"""Solid fraction of the random arrangement that falls or grows [-]; random places end near 0.38."""

DENSE_FRACTION = 0.62
"""Solid fraction of a shaken bed [-], where a message says how many particles would fit."""

GROWTH = 0.02
"""Share of its radius by which a growing particle grows at a time [-]; overlaps stay below twice that."""

TAP_BLOCK = 20
"""Cycles between two looks at the height of a shaken bed at rest [-]."""

PRESS_STEP = 0.02
"""Way of a lid that presses the bed's tops, at a time, over the smallest radius [-]."""


class _Teller:
    """Progress of one stage, with an estimate of the time left from the time it has taken."""

    def __init__(self, progress: Progress | None) -> None:
        self.progress, self.stage, self.begun = progress, "", 0.0

    def begin(self, stage: str) -> None:
        self.stage, self.begun = stage, time.monotonic()
        self(0.0)

    def __call__(self, fraction: float) -> None:
        if self.progress is None:
            return
        spent = time.monotonic() - self.begun
        left = spent * (1.0 - fraction) / fraction if fraction > 0.02 else None
        self.progress(self.stage, min(fraction, 1.0), left)


class _Site(NamedTuple):
    """What stays the same while one damper is packed."""

    damper: DamperSpec
    scene: Scene
    cavity: Cavity
    """Open above where particles are poured."""
    component: NDArray[np.int32]
    """Component of every particle."""
    area: float
    """Cross-section that carries the bed [m^2]."""


def pack(
    damper: DamperSpec, *, folder: Path | None = None, cache: Path | None = None, progress: Progress | None = None
) -> Packing:
    """The bed of a damper, from the cache or packed now; the same description gives the same numbers to the last bit.

    Args:
        damper: the description.
        folder: what files in the description are relative to; None: the working directory.
        cache: folder of stored packings; None: that of the user.
        progress: told the stage, the fraction of it done and the seconds it has left, None where they are not known.

    Raises:
        InputError: the bed does not fit, or the description cannot be packed.
        PackingError: the bed packed is not sound, a defect.
    """
    if cache is not None and cache.exists() and not cache.is_dir():
        raise InputError(f"{cache}: a folder is needed for stored packings, this is a file")
    path = (default_folder() if cache is None else cache) / f"{packing_key(damper, PHYSICS, folder)[:32]}.npz"
    return kept(path, lambda: packed(damper, folder, progress), "packed")


def packed(damper: DamperSpec, folder: Path | None = None, progress: Progress | None = None) -> Packing:
    """The bed of a damper, packed now; arguments and errors as :func:`pack`."""
    begun = time.monotonic()
    tell = _Teller(progress)
    rng = np.random.default_rng(damper.packing.seed)
    tell.begin("place")
    site, grains = _begin(damper, folder, rng)
    if _poured(damper):
        grains = _pour(site, grains, rng, tell)
        if damper.fill is not None and damper.fill.height is not None:
            site, grains = _level_off(site, grains, damper.fill.height)
            grains = _rest(site, grains, tell)
    else:
        grains = _grow(site, grains, rng, tell)
    poured = _height(site, grains)
    if damper.packing.tap is not None and isinstance(damper.lid, RigidLid) and damper.lid.measured == "poured":
        tell.begin("stiffen")
        poured = _height(site, _stiffen(site, grains, tell))
    cycles = 0
    if damper.packing.tap is not None:
        grains, cycles = _tap(site, grains, damper.packing.tap, tell)
    tell.begin("stiffen")
    grains = _stiffen(site, grains, tell)
    height = _height(site, grains)
    if damper.packing.tap is None:
        poured = height
    lid = _lid_height(site, grains, height, poured)
    tell.begin("lid")
    grains = _close(site, grains, lid, folder, tell)
    height = _height(site, grains)
    radius = grains.bed.radius
    tops = np.sort(site.cavity.level_of(grains.bed.position) + radius)
    cavity = site.cavity
    solid = float(4.0 / 3.0 * np.pi * np.sum(radius**3))
    return Packing(
        position=grains.bed.position,
        radius=radius,
        component=site.component,
        height=height,
        poured_height=poured,
        top=float(tops[-max(1, len(tops) // 100) :].mean()),
        solid_fraction=solid / cavity.volume_below(height) if cavity.bounded else math.nan,
        lid_height=lid,
        clearance=lid - height if lid is not None and isinstance(damper.lid, RigidLid) else None,
        tap_cycles=cycles,
        seconds=time.monotonic() - begun,
    )


def _poured(damper: DamperSpec) -> bool:
    """Whether particles fall in from above, through the open lid; else they grow where they are."""
    if isinstance(damper.container, SphereContainer | MeshContainer):
        return False
    if damper.container.kind == "walls":
        return True
    return damper.packing.method == "pour" and damper._wall_above() is not None


def _begin(damper: DamperSpec, folder: Path | None, rng: np.random.Generator) -> tuple[_Site, Grains]:
    """The container, and particles that have no place yet."""
    interactions = interactions_of(damper)
    poured = _poured(damper)
    enclosure = enclosure_of(damper, interactions, closed=not poured, folder=folder)
    mean_volume, _ = mean_particle(damper.particles)
    guess = damper._count() or (count_for(damper.particles, mass=given) if (given := _mass(damper)) is not None else 1)
    cavity = Cavity(damper, enclosure, guess * mean_volume)
    _refuse_lid_askew(damper, cavity)
    count = _count(damper, cavity)
    radius, component = draw_bed(damper.particles, None if damper.fill is None else count, rng)
    material = np.asarray(interactions.component, np.int32)[component]
    grains = Grains.at_rest(np.zeros((len(radius), 3)), radius, material, interactions.density)
    solid = grains.solid_volume
    if poured:
        cavity.reach(1.5 * _loose_level(cavity, solid))
    level = _loose_level(cavity, solid)
    x, y, z = (float(-STANDARD_GRAVITY * c) for c in cavity.up)
    site = _Site(damper, Scene(enclosure, interactions, (x, y, z)), cavity, component, solid / LOOSE_FRACTION / level)
    if damper.fill is None or damper.fill.height is None:
        _refuse_overfull(site, grains, solid / DENSEST_PACKING)
    return site, grains


def _mass(damper: DamperSpec) -> float | None:
    return None if damper.fill is None else damper.fill.mass


def _loose_level(cavity: Cavity, solid: float) -> float:
    """Level that loosely arranged particles of a solid volume [m^3] reach [m]."""
    return cavity.level_with(solid / LOOSE_FRACTION)


def _count(damper: DamperSpec, cavity: Cavity) -> int | None:
    """Number of particles; more than enough where the bed is to reach a mark; None where every radius is listed."""
    fill = damper.fill
    if fill is None or fill.count is not None:
        return damper._count()
    if fill.mass is not None:
        return count_for(damper.particles, mass=fill.mass)
    if fill.solid_fraction is not None:
        return count_for(damper.particles, volume=fill.solid_fraction * cavity.free_volume())
    assert fill.height is not None
    largest = max(component.limits[1] for component in damper.particles)
    if not cavity.bounded:
        raise InputError("fill.height needs walls all round the bed; give fill.count or fill.mass")
    if not _poured(damper):
        raise InputError(
            "fill.height needs a bed that is poured through one flat wall, which this container or packing.direction "
            "does not allow; give fill.count, fill.mass or fill.solid_fraction"
        )
    if cavity.depth is not None and fill.height > cavity.depth:
        raise InputError(
            f"fill.height is {_mm(fill.height)}, but the container only {_mm(cavity.depth)} deep; lower it"
        )
    if fill.height < 2.0 * min(component.limits[0] for component in damper.particles):
        raise InputError(f"fill.height is {_mm(fill.height)}, below the smallest diameter; raise it")
    cavity.reach(fill.height + 4.0 * largest)
    volume, _ = mean_particle(damper.particles)
    return math.ceil(0.66 * cavity.volume_below(fill.height + 3.0 * largest) / volume) + 3


def _refuse_lid_askew(damper: DamperSpec, cavity: Cavity) -> None:
    """Complain of a lid that is not above the bed, or that no floor lies opposite to."""
    if damper.lid is None:
        return
    level = damper._wall_above() is not None
    if damper.container.kind == "walls":
        normal = next(plane.normal for plane in damper.container.planes if plane.name == damper.lid_wall)
        level = float(np.dot(normal, cavity.up)) < -1.0 + 1e-9
    if not level or cavity.depth is None:
        raise InputError(
            f"the lid on wall '{damper.lid_wall}' does not lie above the bed that is poured along "
            f"{damper.pour_direction}, so that its clearance has no meaning; change packing.direction or the lid's wall"
        )


def _refuse_overfull(site: _Site, grains: Grains, needed: float) -> None:
    """Complain of a bed that takes up a volume [m^3] which the container, less the lid's clearance, does not have."""
    damper, cavity = site.damper, site.cavity
    if cavity.depth is None or not cavity.bounded:
        return
    depth, what = cavity.depth, ""
    if isinstance(damper.lid, RigidLid):
        depth, what = depth - damper.lid.clearance, f" and the lid's clearance of {_mm(damper.lid.clearance)}"
    elif isinstance(damper.lid, FoamLid):
        depth, what = damper.lid.lid_height, " under the lid behind the foam"
    room = cavity.volume_below(depth)
    if needed <= room * (1.0 + 1e-9):
        return
    fraction = min(DENSE_FRACTION, grains.solid_volume / needed)
    most = math.floor(fraction * room / grains.solid_volume * len(grains.mass))
    mass = most * float(grains.mass.mean())
    raise InputError(
        f"damper '{damper.name}': {len(grains.mass)} particles{what} do not fit the container, "
        f"{_mm(cavity.depth)} deep; at most about {most} particles ({1e3 * mass:.4g} g) do: "
        "lower fill, or enlarge the container"
    )


def _mm(length: float) -> str:
    return f"{1e3 * length:.4g} mm"


def _pour(site: _Site, grains: Grains, rng: np.random.Generator, tell: _Teller) -> Grains:
    """Particles fall from random places onto the floor, and come to rest."""
    height = _loose_level(site.cavity, grains.solid_volume) + 2.0 * float(grains.bed.radius.max())
    place = random_places(site.cavity, grains.bed.radius, height, rng)
    while place is None:
        height *= 1.2
        site.cavity.reach(1.5 * height)
        place = random_places(site.cavity, grains.bed.radius, height, rng)
    grains = grains._replace(bed=grains.bed._replace(position=place))
    tell.begin("pour")
    fall = 0.5 * height
    speed = math.sqrt(2.0 * STANDARD_GRAVITY * fall)
    soft = _soft(site, grains, speed)
    step = time_step(soft, grains.bed.radius, SOFT_OVERLAP)
    duration = math.sqrt(2.0 * height / STANDARD_GRAVITY)
    worlds = site.scene._replace(interactions=soft).worlds(grains, step)
    n_step = math.ceil(duration / step)
    for k in range(20):
        worlds = sound(run(worlds, n_step * (k + 1) // 20 - n_step * k // 20))
        tell((k + 1) / 20)
    return _rest(site, grains_of(worlds, grains), tell)


def _soft(site: _Site, grains: Grains, speed: float, intensity: float = 0.0) -> Interactions:
    """Contacts softened for a speed [m/s], and for the bed's weight times 1 + `intensity`."""
    pressure = (1.0 + intensity) * pressure_of(grains, site.area)
    return softened(site.scene.interactions, softening(site.scene.interactions, grains.bed.radius, speed, pressure))


def _rest(site: _Site, grains: Grains, tell: _Teller) -> Grains:
    """Particles at rest under gravity, after a time at most; what still moves then is stopped."""
    tell.begin("settle")
    soft = _soft(site, grains, slow_speed(grains))
    worlds = site.scene._replace(interactions=soft).worlds(grains, time_step(soft, grains.bed.radius, SOFT_OVERLAP))
    return grains_of(run_to_rest(worlds, grains, 5e-3, 0.5, tell), grains)


def _level_off(site: _Site, grains: Grains, mark: float) -> tuple[_Site, Grains]:
    """Only the particles that stand wholly below the mark [m]."""
    below = site.cavity.level_of(grains.bed.position) + grains.bed.radius <= mark
    if not below.any():
        raise InputError(f"fill.height is {_mm(mark)}, and no particle lies wholly below; raise it")
    return site._replace(component=site.component[below]), grains.kept(below)


def _grow(site: _Site, grains: Grains, rng: np.random.Generator, tell: _Teller) -> Grains:
    """Particles grow at random places to their radii, without weight or friction, then settle under gravity.

    Source: Lubachevsky & Stillinger (1990), J. Stat. Phys. 60, 561-583 (growth); here quenching takes
    overlaps out.
    """
    assert site.cavity.depth is not None
    full = grains.bed.radius
    room = site.cavity.free_volume()
    size = min(1.0, (LOOSE_FRACTION * room / grains.solid_volume) ** (1.0 / 3.0))
    place = None
    while place is None:
        place = random_places(site.cavity, size * full, site.cavity.depth, rng)
        if place is None:
            size *= 0.9
        if size < 0.05:
            raise InputError(
                f"damper '{site.damper.name}': no place in the container for the particles; check its size"
            )
    grains = grains._replace(bed=grains.bed._replace(position=place))
    tell.begin("grow")
    n_stage = math.ceil(math.log(1.0 / size) / math.log(1.0 + GROWTH))
    interactions = site.scene.interactions
    smooth = slippery(softened(interactions, softening(interactions, full, slow_speed(grains), 0.0)))
    scene = site.scene._replace(interactions=smooth, gravity=(0.0, 0.0, 0.0))
    for stage in range(1, n_stage + 1):
        radius = full * size ** (1.0 - stage / n_stage)
        grains = grains._replace(bed=grains.bed._replace(radius=radius)).stopped()
        worlds = scene.worlds(grains, time_step(smooth, full, 2.0 * GROWTH))

        def apart(worlds: Worlds, old: Grains = grains) -> bool:
            return largest_overlap(grains_of(worlds, old), site.cavity) < 0.2 * GROWTH

        grains = grains_of(quench(worlds, grains, 10, 1000, apart), grains)
        tell(stage / n_stage)
    if largest_overlap(grains, site.cavity) > 2.0 * SOFT_OVERLAP:
        _refuse_overfull(site, grains, 1.001 * room)
    speed = math.sqrt(2.0 * STANDARD_GRAVITY * site.cavity.depth)
    tell.begin("fall")
    soft = _soft(site, grains, speed)
    worlds = site.scene._replace(interactions=soft).worlds(
        grains.stopped(), time_step(soft, grains.bed.radius, SOFT_OVERLAP)
    )
    worlds = run_to_rest(worlds, grains, 5e-3, 1.5 * speed / STANDARD_GRAVITY, tell)
    return _rest(site, grains_of(worlds, grains), tell)


def _height(site: _Site, grains: Grains) -> float:
    return site.cavity.bed_level(grains.bed.position, grains.bed.radius)


def _tap(site: _Site, grains: Grains, tap: TapSpec, tell: _Teller) -> tuple[Grains, int]:
    """Particles at rest after shaking along the direction of pouring, and for how many cycles.

    Heights are compared at rest, after every TAP_BLOCK cycles.
    """
    tell.begin("tap")
    lid = site.damper.lid
    reference = lid.clearance if isinstance(lid, RigidLid) else 2.0 * float(grains.bed.radius.mean())
    omega = 2.0 * math.pi * tap.frequency
    amplitude = tap.intensity * STANDARD_GRAVITY / omega**2
    soft = _soft(site, grains, max(2.0 * amplitude * omega, slow_speed(grains)), tap.intensity)
    n_cycle_step = math.ceil(1.0 / tap.frequency / time_step(soft, grains.bed.radius, SOFT_OVERLAP))
    motion = _shaking(omega, amplitude * site.cavity.up)
    worlds = site.scene._replace(interactions=soft).worlds(grains, 1.0 / tap.frequency / n_cycle_step, motion)
    height, done = _height(site, grains), 0
    while done < tap.max_cycles:
        cycles = min(TAP_BLOCK, tap.max_cycles - done)
        worlds.motion.kind[0] = MotionKind.HARMONICS
        worlds.motion.timing[0, START] = worlds.clock.time[0]
        for cycle in range(cycles):
            worlds = sound(run(worlds, n_cycle_step))
            tell((done + cycle + 1) / tap.max_cycles)
        done += cycles
        worlds.motion.kind[0] = MotionKind.REST
        worlds = run_to_rest(worlds, grains, 5e-3, 0.15, lambda _: None)
        grains = grains_of(worlds, grains)
        before, height = height, _height(site, grains)
        if before - height < tap.tolerance * reference * cycles / TAP_BLOCK and cycles == TAP_BLOCK:
            break
    return grains, done


def _shaking(omega: float, amplitude: Real) -> Motion:
    """Harmonic motion of the container, with its angular frequency [rad/s] and vector of amplitude [m]; at rest yet."""
    timing = np.zeros((1, 8))
    timing[0, DIRECTION : DIRECTION + 3] = amplitude / np.linalg.norm(amplitude)
    return Motion(
        kind=np.array([MotionKind.REST], np.int32),
        wave=np.array([[[omega, 0.0, *amplitude]]]),
        series=np.zeros((1, 1, 3)),
        timing=timing,
        displacement=np.zeros((1, 3)),
        velocity=np.zeros((1, 3)),
        acceleration=np.zeros((1, 3)),
    )


def _stiffen(site: _Site, grains: Grains, tell: _Teller) -> Grains:
    """Particles at rest under the described stiffness."""
    pressure = pressure_of(grains, site.area)
    divisor = softening(site.scene.interactions, grains.bed.radius, slow_speed(grains), pressure)
    allowed = resting_overlap(site.scene.interactions, grains.bed.radius, pressure)
    return stiffened(site.scene, grains, site.cavity, divisor, allowed, tell)


def _lid_height(site: _Site, grains: Grains, height: float, poured: float) -> float | None:
    """Distance of the lid from the floor [m]; None without a lid.

    Raises:
        InputError: bed and clearance are higher than the container, or the lid meets an insert.
    """
    lid, cavity = site.damper.lid, site.cavity
    if lid is None:
        _refuse_overfull(site, grains, cavity.volume_below(height))
        return None
    if isinstance(lid, FoamLid):
        level = lid.lid_height
        top = float((cavity.level_of(grains.bed.position) + grains.bed.radius).max())
        if top > level:
            raise InputError(
                f"the bed's highest particle stands {_mm(top)} above the floor, but the stiff lid behind the foam only "
                f"{_mm(level)} (height - preload + travel); raise the lid's height or lower fill"
            )
    else:
        _refuse_overfull(site, grains, cavity.volume_below(height))
        level = (poured if lid.measured == "poured" else height) + lid.clearance
        if cavity.depth is not None and level > cavity.depth:
            _refuse_overfull(site, grains, cavity.volume_below(level - lid.clearance))
    for name, _, high in cavity.insert_levels():
        if high > level * (1.0 + 1e-9):
            raise InputError(
                f"insert '{name}' reaches up to {_mm(high)}, above the lid at {_mm(level)} (bed {_mm(height)}); "
                "fill more particles, lower the insert, or give a larger clearance"
            )
    return level


def _close(site: _Site, grains: Grains, lid: float | None, folder: Path | None, tell: _Teller) -> Grains:
    """Particles in the closed container: a lid lower than the tops of the bed presses them down on its way.

    Raises:
        InputError: tops that cannot be pressed under the lid.
        PackingError: particles overlap or lie outside.
    """
    damper, radius = site.damper, grains.bed.radius
    allowed = resting_overlap(site.scene.interactions, radius, pressure_of(grains, site.area))
    closed = enclosure_of(damper, site.scene.interactions, folder=folder)
    level = lid if lid is not None else site.cavity.depth
    cavity = site.cavity
    if level is not None and _poured(damper):
        tops = site.cavity.level_of(grains.bed.position) + radius
        cavity = site.cavity.with_lid(closed, level)
        if tops.max() > level:
            grains = _press(site, grains, closed, float(tops.max()), level, tell)
            if largest_overlap(grains, cavity) > 2.0 * allowed:
                raise InputError(
                    f"the bed's tops, up to {_mm(float(tops.max()))} above the floor, do not go under the lid at "
                    f"{_mm(level)}; give a larger clearance, or fewer particles"
                )
    if not np.isfinite(grains.bed.position).all():
        raise PackingError("positions of the packed bed are not finite; report this with the description")
    worst = largest_overlap(grains, cavity)
    if worst > 2.0 * allowed:
        raise PackingError(
            f"the packed bed overlaps itself or the walls by {worst:.2g} of a radius, allowed are {2.0 * allowed:.2g}; "
            "report this with the description"
        )
    tell(1.0)
    return grains


def _press(site: _Site, grains: Grains, closed: Enclosure, start: float, level: float, tell: _Teller) -> Grains:
    """Particles under a lid that comes down from `start` to `level` [m]; friction is off while they give way."""
    pressure = pressure_of(grains, site.area)
    divisor = softening(site.scene.interactions, grains.bed.radius, slow_speed(grains), pressure)
    soft = slippery(softened(site.scene.interactions, divisor))
    n_stage = math.ceil((start - level) / (PRESS_STEP * float(grains.bed.radius.min())))
    for stage in range(1, n_stage + 1):
        cavity = site.cavity.with_lid(closed, start + (level - start) * stage / n_stage)
        scene = site.scene._replace(interactions=soft, enclosure=cavity.enclosure)
        worlds = scene.worlds(grains.stopped(), time_step(soft, grains.bed.radius, 2.0 * SOFT_OVERLAP))

        def gives_way(worlds: Worlds, old: Grains = grains, cavity: Cavity = cavity) -> bool:
            return largest_overlap(grains_of(worlds, old), cavity) < PRESS_STEP

        grains = grains_of(quench(worlds, grains, 10, 400, gives_way), grains)
        tell(0.5 * stage / n_stage)
    allowed = resting_overlap(site.scene.interactions, grains.bed.radius, pressure)
    scene = site.scene._replace(enclosure=cavity.enclosure)
    return stiffened(scene, grains, cavity, divisor, allowed, tell)
