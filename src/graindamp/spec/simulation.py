"""Description of a simulation: a damper, the motion of its container, and how it is run."""

import difflib
import math
from typing import Annotated, Any, Literal, Self

from pydantic import BeforeValidator, Field, model_validator

from graindamp.errors import InputError
from graindamp.spec.contact import ContactMaterialSpec, ContactSpec, canonical, check_override
from graindamp.spec.container import (
    AXES,
    BoxContainer,
    ContainerSpec,
    CylinderContainer,
    FoamLid,
    InsertSpec,
    LidSpec,
    SphereContainer,
    StarInsert,
    WallsContainer,
    unit_vector,
    with_number,
)
from graindamp.spec.model import Spec
from graindamp.spec.motion import HarmonicMotion, HarmonicsMotion, MotionSpec, RandomMotion, SweepMotion
from graindamp.spec.particles import DENSEST_PACKING, BedComponent, FillSpec, ListRadius
from graindamp.spec.quantity import (
    Direction,
    Duration,
    DurationOrZero,
    Frequency,
    Gravity,
    Intensity,
    Length,
    Number,
    Phase,
)
from graindamp.units import STANDARD_GRAVITY

DEFAULT_CYCLES = 25
"""Cycles of a periodic motion where the run gives none [-], as simulated by Meyer & Seifried (2023)."""

DEFAULT_SAMPLES_PER_CYCLE = 200
"""Samples per cycle of the recorded series where the run gives none [-]: block means then pass the tenth harmonic to
0.4 %."""

DEFAULT_SAMPLE_RATE = 20e3
"""Samples per second of the recorded series of motions without a cycle [Hz]."""


class TapSpec(Spec):
    """Shaking along the direction of pouring that compacts the bed before the lid is set."""

    frequency: Frequency = 30.0
    """Frequency [Hz], > 0."""
    intensity: Intensity = 2.5
    """Intensity Gamma of the shaking in units of standard gravity [-], > 0; above 1 for the bed to lift off."""
    max_cycles: int = Field(default=400, ge=1)
    """Cycles after which shaking ends although the bed still settles, >= 1."""
    tolerance: Number = Field(default=0.01, gt=0, lt=1)
    """Shaking ends when the clearance that settling frees over 20 cycles drops below this part of the lid's
    clearance, or, without a lid, of a particle's diameter [-], above 0 and below 1."""


def _tap(value: Any) -> Any:
    return {True: TapSpec(), False: None}[value] if isinstance(value, bool) else value


class PackingSpec(Spec):
    """How the particles are brought into the container."""

    method: Literal["pour", "grow"] = "pour"
    """ "pour": particles fall from random places, as in a real damper; "grow": they grow from points, quicker and
    without a heap. Pouring needs one flat wall above, which is opened for it: in spheres, in meshes, and in cylinders
    that are filled across their axis particles grow, and then fall along `direction`, either way."""
    direction: Direction | None = None
    """Direction of gravity while the bed is poured; default: along the axis of a cylinder from "end" to "start", else
    "-z"."""
    tap: Annotated[TapSpec | None, BeforeValidator(_tap)] = TapSpec()
    """Shaking before the lid is set, a table; false leaves the bed as poured."""
    seed: int = Field(default=0, ge=0)
    """Seed of the radii and first places, >= 0; another seed gives another bed of the same description."""


class DamperSpec(Spec):
    """A container with particles."""

    name: str = "damper"
    """Name of the damper in tables and figures."""
    gravity: Gravity = (0.0, 0.0, -STANDARD_GRAVITY)
    """Acceleration of free fall in the container's frame [m/s^2]: a vector, "-z" and the like, or "none"; default
    "-z"."""
    particles: tuple[BedComponent, ...] = Field(min_length=1)
    """The bed's components, at least one ([[damper.particles]] in the file)."""
    fill: FillSpec | None = None
    """How many particles: exactly one of count, mass, height and solid_fraction; left out only where kind = "list"
    gives every radius."""
    container: ContainerSpec
    """What holds the particles: kind = "cylinder", "box", "sphere", "mesh" or "walls"."""
    inserts: tuple[InsertSpec, ...] = ()
    """Solid bodies fixed inside the container, kind = "box", "cylinder" or "star" ([[damper.inserts]] in the file)."""
    lid: LidSpec | None = None
    """A lid set after the bed is packed, kind = "rigid" or "foam"; default: the container as described."""
    contact: ContactSpec
    """Laws and constants of the contacts."""
    packing: PackingSpec = PackingSpec()
    """How the particles are brought into the container."""

    @property
    def pour_direction(self) -> tuple[float, float, float]:
        """Unit vector along gravity while the bed is poured [-]."""
        if self.packing.direction is not None:
            return self.packing.direction
        axis = self.container.axis if isinstance(self.container, CylinderContainer) else "z"
        return unit_vector(axis, -1.0)

    @property
    def lid_wall(self) -> str | None:
        """Name of the wall that the lid moves or hangs on; None without a lid."""
        if self.lid is None:
            return None
        return self.lid.wall or self._wall_above()

    @property
    def surfaces(self) -> dict[str, ContactMaterialSpec]:
        """Material that the particles touch on every wall and insert, by name; of coated walls the coating's."""
        walls = {}
        for name in self.container.wall_names:
            surface = self.container.walls.get(name)
            coating = None if surface is None else surface.coating
            walls[name] = self.container.wall_material(name) if coating is None else coating.layer
        return walls | {name: insert.material for name, insert in with_number(self.inserts).items()}

    @property
    def backings(self) -> dict[str, ContactMaterialSpec]:
        """Material of the stiff wall behind every coating, by name of the wall."""
        return {
            name: self.container.wall_material(name)
            for name, surface in self.container.walls.items()
            if surface.coating is not None
        }

    def _wall_above(self) -> str | None:
        """Wall that particles come from when they are poured; None where no single flat wall lies there."""
        x, y, z = (round(-component, 9) for component in self.pour_direction)
        if sorted(map(abs, (x, y, z))) != [0.0, 0.0, 1.0]:
            return None
        axis = AXES[[abs(x), abs(y), abs(z)].index(1.0)]
        positive = x + y + z > 0
        if isinstance(self.container, BoxContainer):
            return axis + ("+" if positive else "-")
        if isinstance(self.container, CylinderContainer) and axis == self.container.axis:
            return "end" if positive else "start"
        return None

    @model_validator(mode="after")
    def _particles_counted(self) -> Self:
        listed = [isinstance(component.radius, ListRadius) for component in self.particles]
        if any(listed) and not all(listed):
            raise InputError(
                'radii of kind = "list" cannot be mixed with other kinds; list the radii of every component'
            )
        if all(listed) and self.fill is not None:
            raise InputError('radii of kind = "list" say how many particles there are; leave out fill')
        if not any(listed) and self.fill is None:
            raise InputError("fill is missing; give one of count, mass, height and solid_fraction in [damper.fill]")
        if (
            self.fill is not None
            and self.fill.solid_fraction is not None
            and isinstance(self.container, WallsContainer)
        ):
            raise InputError('fill by solid_fraction needs a closed container; with kind = "walls" give count or mass')
        if self.fill is not None and self.fill.height is not None and self.packing.method == "grow":
            raise InputError(
                'fill by height is found by pouring; choose method = "pour", or give count, mass or solid_fraction'
            )
        return self

    @model_validator(mode="after")
    def _particles_fit(self) -> Self:
        smallest = min(component.limits[0] for component in self.particles)
        largest = max(component.limits[1] for component in self.particles)
        width = _narrowest(self.container)
        if width is not None and 2 * largest >= width:
            raise InputError(
                f"particles of up to {2 * largest:g} m in diameter do not fit the container, {width:g} m at its "
                "narrowest; radius is half of the diameter"
            )
        volume, count = self.container.volume, self._count()
        sphere = 4.0 / 3.0 * math.pi * smallest**3
        if volume is not None and count is not None and count * sphere > DENSEST_PACKING * volume:
            raise InputError(
                f"{count} particles fill {count * sphere / volume:.2f} of the container, but equal spheres at most "
                f"0.74, and poured at random about 0.6, {math.floor(0.6 * volume / sphere)} particles; lower fill or "
                "enlarge the container"
            )
        return self

    def _count(self) -> int | None:
        if self.fill is not None:
            return self.fill.count
        return sum(
            len(component.radius.radius) for component in self.particles if isinstance(component.radius, ListRadius)
        )

    @model_validator(mode="after")
    def _inserts_fit(self) -> Self:
        if len(with_number(self.inserts)) < len(self.inserts):
            raise InputError("every insert needs a name of its own, and none that follows from another's number")
        for name, insert in with_number(self.inserts).items():
            if name in self.container.wall_names:
                raise InputError(f"insert '{name}' has the name of a wall; give it another")
            if not isinstance(insert, StarInsert):
                continue
            if not isinstance(self.container, CylinderContainer):
                raise InputError(f'a star insert needs a container of kind = "cylinder", given "{self.container.kind}"')
            half = insert.width / 2
            if not half <= insert.position <= self.container.length - half:
                raise InputError(
                    f"insert '{name}' at {insert.position:g} m with arms {insert.width:g} m wide leaves the container; "
                    f"allowed {half:g} to {self.container.length - half:g} m"
                )
            if half >= self.container.radius:
                raise InputError(f"insert '{name}' has arms {insert.width:g} m wide and would close the container")
        return self

    @model_validator(mode="after")
    def _lid_fits(self) -> Self:
        if self.lid is None:
            return self
        kind = self.container.kind
        if kind in ("sphere", "mesh"):
            raise InputError(
                f'a lid needs a flat wall to move, and a container of kind = "{kind}" has none; leave the lid out'
            )
        above = self._wall_above()
        if self.lid.wall is None and above is None:
            raise InputError(
                f"the lid needs wall, one of {', '.join(self.container.wall_names)}: "
                "no single flat wall lies opposite to where the bed is poured"
            )
        if self.lid.wall is not None and self.lid.wall not in self.container.wall_names:
            raise InputError(f"the lid's wall is '{self.lid.wall}'; allowed are {', '.join(self.container.wall_names)}")
        if self.lid_wall == "side":
            raise InputError('the lid cannot be the "side" of a cylinder; choose "start" or "end"')
        planes = self.container.planes if isinstance(self.container, WallsContainer) else ()
        if any(plane.name == self.lid_wall and plane.radius is not None for plane in planes):
            raise InputError(f"the lid cannot be the disc '{self.lid_wall}'; choose a plane without radius")
        if above is not None and self.lid_wall != above:
            raise InputError(
                f"the lid is to close wall '{self.lid_wall}', but the bed is poured away from wall '{above}'; "
                "change the lid's wall or packing.direction"
            )
        depth = self._depth()
        if isinstance(self.lid, FoamLid) and depth is not None and self.lid.lid_height > depth:
            raise InputError(
                f"the stiff lid behind the foam stands {self.lid.lid_height:g} m above the floor "
                f"(height - preload + travel), but the container is only {depth:g} m deep"
            )
        if not isinstance(self.lid, FoamLid) and depth is not None and self.lid.clearance >= depth:
            raise InputError(f"clearance is {self.lid.clearance:g} m, but the container is only {depth:g} m deep")
        return self

    def _depth(self) -> float | None:
        """Inner length across the lid [m]; None for planes, which need not have one."""
        if isinstance(self.container, CylinderContainer):
            return self.container.length
        if isinstance(self.container, BoxContainer) and self.lid_wall is not None:
            return self.container.size["xyz".index(self.lid_wall[0])]
        return None

    @model_validator(mode="after")
    def _contacts_fit(self) -> Self:
        materials = [component.material for component in self.particles]
        materials += [*self.surfaces.values(), *self.backings.values()]
        names = {canonical(material.name): material.name for material in materials if material.name}
        for pair in self.contact.pairs:
            for name in pair.between:
                if canonical(name) not in names:
                    near = difflib.get_close_matches(canonical(name), list(names), n=1, cutoff=0.5)
                    hint = f"; nearest is '{names[near[0]]}'" if near else ""
                    raise InputError(
                        f"contact.pairs: nothing here is made of '{name}'{hint}; "
                        f"materials are {', '.join(names.values())}"
                    )
        for name, surface in self.container.walls.items():
            check_override(surface, self.contact, f"wall '{name}'")
            if surface.coating is not None:
                check_override(surface.coating, self.contact, f"the coating of wall '{name}'")
        return self

    @model_validator(mode="after")
    def _materials_agree(self) -> Self:
        known: dict[str, ContactMaterialSpec] = {}
        for component in self.particles:
            name = canonical(component.material.name)
            if name and known.setdefault(name, component.material) != component.material:
                raise InputError(
                    f"two components are made of '{component.material.name}' with different values; "
                    "give one another name"
                )
        return self


def _narrowest(container: ContainerSpec) -> float | None:
    """Smallest inner width of a container [m]; None where the description does not tell it."""
    if isinstance(container, CylinderContainer):
        return min(2 * container.radius, container.length)
    if isinstance(container, BoxContainer):
        return min(container.size)
    return 2 * container.radius if isinstance(container, SphereContainer) else None


class VelocityFieldSpec(Spec):
    """Particle velocities averaged over cells, at one phase of the cycle, over all recorded cycles."""

    phase: Phase = 0.5 * math.pi
    """Phase of the cycle [rad]; default a quarter of a cycle, where a sine stands at its turning point x = X."""
    cell: Length
    """Side of the cubic cells [m], > 0; two particle diameters or more for smooth fields."""


class RunSpec(Spec):
    """How long and how finely a simulation runs."""

    cycles: Annotated[Number, Field(gt=0, le=1e5)] | None = None
    """Cycles of a periodic motion, > 0, at most 100000; default 25. Give it or duration."""
    duration: Duration | None = None
    """Time that the container moves [s], > 0; default: cycles, or the motion's own duration."""
    settle: DurationOrZero | None = None
    """Time at rest under gravity before the motion starts [s], >= 0; default: until a bed that was turned after it was
    packed has come to rest, once for all runs of the damper."""
    integrator: Literal["verlet", "gear"] = "verlet"
    """Time integration: "verlet" (leapfrog, second order, fixed step) or "gear" (predictor-corrector, fifth order,
    variable step, for comparison with Meyer & Seifried 2023; slower)."""
    steps_per_contact: int = Field(default=40, ge=10, le=1000)
    """Time steps per shortest contact, 10 to 1000: below 10 the energy of an impact is wrong by more than
    restitutions are known, above 1000 rounding and patience set the limit."""
    time_step: Duration | None = None
    """Time step [s], > 0, in place of steps_per_contact; default: from the stiffness, mass and speed of the
    contacts."""
    tolerance: Annotated[Number, Field(gt=0, le=1e-2)] | None = None
    """Error per step that integrator = "gear" allows, over the smallest radius [-], above 0 to 0.01; default 1e-6."""
    sample_rate: Frequency | None = None
    """Samples per second of the recorded forces [Hz], > 0; default: from samples_per_cycle, or 20 kHz without
    cycles."""
    samples_per_cycle: int | None = Field(default=None, ge=8)
    """Samples per cycle of the recorded forces, >= 8, which still tell the third harmonic; default 200 for periodic
    motions."""
    snapshots_per_cycle: int = Field(default=0, ge=0, le=1000)
    """Snapshots of all particles per cycle, 0 to 1000; they cost memory and disk, 0 writes none."""
    velocity_field: VelocityFieldSpec | None = None
    """Averaged velocity field at one phase of the cycle; default: none."""

    @model_validator(mode="after")
    def _one_way_each(self) -> Self:
        for pair in (("cycles", "duration"), ("sample_rate", "samples_per_cycle")):
            if all(getattr(self, name) is not None for name in pair):
                raise InputError(f"give either {pair[0]} or {pair[1]}, not both")
        if self.time_step is not None and "steps_per_contact" in self.model_fields_set:
            raise InputError("give either time_step or steps_per_contact, not both")
        if self.tolerance is not None and self.integrator != "gear":
            raise InputError(f'tolerance belongs to integrator = "gear"; "{self.integrator}" has a fixed step')
        return self


class SimulationSpec(Spec):
    """What to simulate."""

    title: str = "Particle damper simulation"
    """Heading of the report."""
    damper: DamperSpec
    """Container, particles and contacts."""
    motion: MotionSpec
    """Motion of the container: kind = "harmonic", "harmonics", "sweep", "series", "random" or "rest"."""
    run: RunSpec = RunSpec()
    """How long and how finely it runs."""

    @property
    def base_frequency(self) -> float | None:
        """Frequency that cycles are counted by [Hz]; None where the motion has no cycle."""
        return self.motion.base_frequency if isinstance(self.motion, HarmonicMotion | HarmonicsMotion) else None

    @property
    def duration(self) -> float | None:
        """Time that the container moves [s]; None where only the file of the motion tells it."""
        if self.run.duration is not None:
            return self.run.duration
        if self.base_frequency is not None:
            return (self.run.cycles or DEFAULT_CYCLES) / self.base_frequency
        return self.motion.duration if isinstance(self.motion, SweepMotion | RandomMotion) else None

    @property
    def sample_rate(self) -> float:
        """Samples per second of the recorded forces [Hz]."""
        if self.run.sample_rate is not None:
            return self.run.sample_rate
        if self.base_frequency is not None:
            return (self.run.samples_per_cycle or DEFAULT_SAMPLES_PER_CYCLE) * self.base_frequency
        return DEFAULT_SAMPLE_RATE

    @model_validator(mode="after")
    def _run_fits_motion(self) -> Self:
        kind = self.motion.kind
        if self.base_frequency is None:
            for name, given in (
                ("cycles", self.run.cycles is not None),
                ("samples_per_cycle", self.run.samples_per_cycle is not None),
                ("snapshots_per_cycle", self.run.snapshots_per_cycle > 0),
                ("velocity_field", self.run.velocity_field is not None),
            ):
                if given:
                    raise InputError(
                        f'run.{name} needs a motion with cycles, kind = "harmonic" or "harmonics", given "{kind}"'
                    )
        if kind == "rest" and self.run.duration is None:
            raise InputError('run.duration is missing; a motion of kind = "rest" has no length of its own')
        if (
            isinstance(self.motion, SweepMotion)
            and self.run.duration is not None
            and self.run.duration > self.motion.duration
        ):
            raise InputError(
                f"run.duration is {self.run.duration:g} s, but the sweep ends after {self.motion.duration:g} s; "
                "leave it out"
            )
        if isinstance(self.motion, HarmonicMotion | HarmonicsMotion) and self.duration is not None:
            soft = self.motion.soft_start / self.motion.base_frequency
            if soft >= self.duration:
                raise InputError(
                    f"motion.soft_start lasts {soft:g} s, the whole run of {self.duration:g} s; run longer"
                )
        return self
