"""From a description to the arrays of one slot, as the processor's engine makes them for one world."""

import math
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from graindamp.dem.container import Enclosure, enclosure_of
from graindamp.dem.excitation import motion_of
from graindamp.dem.gpu.columns import (
    END,
    GIVEN,
    GRAVITY,
    LARGEST,
    MOVING,
    N_CODE,
    N_COUNT,
    N_NUMBER,
    N_PARTICLE,
    N_SETTLE,
    NORMAL,
    PER_ROW,
    ROLLING_CODE,
    SKIN,
    TANGENTIAL,
    TENSION,
    TIME_STEP,
    WHOLE_MASS,
)
from graindamp.dem.gpu.state import Room
from graindamp.dem.interactions import Interactions, interactions_of
from graindamp.dem.laws import TangentialLaw
from graindamp.dem.motion import FUNDAMENTAL, move
from graindamp.dem.packing import PHYSICS, pack
from graindamp.dem.packing_store import Packing
from graindamp.dem.plan import CHUNKS, Plan, plan_of
from graindamp.dem.run import BedState
from graindamp.dem.simulate import SKIN_STEPS
from graindamp.dem.state import Motion
from graindamp.dem.timestep import expected_speed, shortest_contact
from graindamp.dem.turned import turned
from graindamp.dem.world import Bed, _by_place, walls_of
from graindamp.errors import InputError
from graindamp.spec.simulation import DamperSpec, SimulationSpec

PAIRS_PER_PARTICLE = 5.0
"""Room for pairs at first [-]; equal spheres have three to four within the skin."""

TOUCHES_PER_PARTICLE = 1.0
"""Room for contacts with walls at first [-]."""

LEAST_ROOM = 16
"""Room for pairs, and for contacts with walls, of the smallest beds [-]."""


class Loaded(NamedTuple):
    """One world as arrays of the host, without the slot axis and without padding."""

    arrays: dict[str, dict[str, NDArray[Any]]]
    """By part and name as in :mod:`graindamp.dem.gpu.state`; what is missing starts empty."""
    order: NDArray[np.int64]
    """Number of each particle as described."""
    n_settle: int
    end: int
    """Last step, settling included [-]."""
    n_row: int
    """Rows that it writes [-]."""

    def room(self, threads: int) -> Room:
        """The least arrays that hold it."""
        n = self.arrays["bed"]["radius"].shape[0]
        walls, motion, tables = self.arrays["walls"], self.arrays["motion"], self.arrays["tables"]
        codes = self.arrays["slots"]["codes"]
        return Room(
            slots=1,
            particles=n,
            pairs=int(PAIRS_PER_PARTICLE * n) + LEAST_ROOM,
            touches=int(TOUCHES_PER_PARTICLE * n) + LEAST_ROOM,
            rows=self.n_row,
            waves=motion["wave"].shape[0],
            samples=motion["series"].shape[0],
            materials=tables["pair"].shape[0],
            elements=walls["kind"].shape[0],
            edges=walls["edges"].shape[0],
            cells=walls["cell_start"].shape[0],
            entries=walls["cell_element"].shape[0],
            threads=threads,
            springs=bool(codes[TANGENTIAL] >= TangentialLaw.MINDLIN),
            rolling=bool(codes[ROLLING_CODE]),
        )


def loaded(
    bed: Bed,
    enclosure: Enclosure,
    interactions: Interactions,
    gravity: tuple[float, float, float],
    time_step: float,
    motion: Motion,
    skin: float,
    n_step: int,
    per_row: int,
    n_settle: int = 0,
    given: tuple[NDArray[np.float64], NDArray[np.float64]] | None = None,
) -> Loaded:
    """One world of a bed.

    Args:
        bed: the particles, with velocities at the first positions.
        enclosure: the walls.
        interactions: constants of their contacts.
        gravity: in the container's frame [m/s^2].
        time_step: [s].
        motion: of the container, after it has been at rest for `n_settle` steps.
        skin: reach of the outer lists [m].
        n_step: steps of the motion [-].
        per_row: steps between two rows that are written down [-].
        n_settle: steps at rest before [-].
        given: velocities [m/s] and spins [rad/s] when the motion begins, each (particle, 3); None: those of the settled
            bed, which the container leaves behind if it starts with a speed.
    """
    n = len(bed.radius)
    order = _by_place(bed.position, float(bed.radius.max()))
    mass = interactions.density[bed.material] * 4.0 / 3.0 * np.pi * bed.radius**3
    inertia = 0.4 * mass * bed.radius**2
    largest = float(bed.radius.max())
    walls = walls_of(enclosure, interactions, largest + skin, 2.0 * largest)
    codes, numbers = np.zeros(N_CODE, np.int64), np.zeros(N_NUMBER)
    codes[N_PARTICLE], codes[NORMAL], codes[TANGENTIAL] = n, interactions.normal, interactions.tangential
    codes[TENSION], codes[ROLLING_CODE] = interactions.tension, interactions.rolling
    codes[N_SETTLE], codes[PER_ROW], codes[END], codes[GIVEN] = n_settle, per_row, n_settle + n_step, given is not None
    numbers[GRAVITY : GRAVITY + 3], numbers[TIME_STEP], numbers[SKIN], numbers[LARGEST] = (
        gravity,
        time_step,
        skin,
        largest,
    )
    numbers[WHOLE_MASS] = mass.sum()
    if n_settle == 0:
        move(0, 0.0, motion)
        numbers[MOVING : MOVING + 3], numbers[MOVING + 3 : MOVING + 6] = motion.acceleration[0], motion.velocity[0]
        numbers[MOVING + 6] = 1.0
    velocity, spin = bed.velocity[order].T, bed.spin[order].T
    shown = (bed.velocity, bed.spin) if given is None else given
    return Loaded(
        arrays={
            "bed": {
                "position": bed.position[order].T,
                "radius": bed.radius[order],
                "velocity": velocity,
                "spin": spin,
                "velocity_next": velocity,
                "spin_next": spin,
                "inverse": np.stack([1.0 / mass[order], 1.0 / inertia[order]]),
                "material": bed.material[order],
                "velocity_shown": shown[0][order].T,
                "spin_shown": shown[1][order].T,
            },
            "walls": {name: value[0] for name, value in walls._asdict().items()},
            "tables": {"pair": interactions.pair, "loss": interactions.loss},
            "motion": {name: value[0] for name, value in motion._asdict().items()},
            "slots": {"counts": np.zeros(N_COUNT, np.int64), "codes": codes, "numbers": numbers},
        },
        order=order,
        n_settle=n_settle,
        end=n_settle + n_step,
        n_row=math.ceil(n_step / per_row) + 1,
    )


class Described(NamedTuple):
    """An operating point as arrays, and what its result is made of."""

    spec: SimulationSpec
    packing: Packing
    enclosure: Enclosure
    plan: Plan
    loaded: Loaded
    mass: NDArray[np.float64]
    """[kg], in the order of the description."""
    speed: float
    """Speed amplitude of the container's first harmonic, 0 for motions without cycles [m/s]."""
    direction: NDArray[np.float64]
    contact: float
    """Shortest contact at a speed of 1 m/s [s]."""


class Describer:
    """Turns operating points into arrays; contact constants of dampers that differ in their seed alone are found
    once."""

    def __init__(self, folder: Path | None, cache: Path | None) -> None:
        """Files are relative to `folder`; packings are kept in `cache`, None: that of the user."""
        self.folder, self.cache = folder, cache
        self.known: dict[str, Interactions] = {}

    def interactions(self, damper: DamperSpec) -> Interactions:
        """Contact constants of a damper."""
        key = damper.model_dump_json(exclude={"packing", "name"})
        if key not in self.known:
            self.known[key] = interactions_of(damper)
        return self.known[key]

    def described(self, spec: SimulationSpec, packing: Packing | None, start: BedState | None) -> Described:
        """Arrays of one operating point.

        Raises:
            InputError: the bed does not fit, a file cannot be used, `start` is of another bed, or the description asks
                for what only the processor's engine does.
        """
        _check(spec)
        damper = spec.damper
        if packing is None:
            packing = pack(damper, folder=self.folder, cache=self.cache)
        if start is None and spec.run.settle is None:
            packing = turned(damper, packing, physics=PHYSICS, folder=self.folder, cache=self.cache)
        n = len(packing.radius)
        if start is not None and len(start.position) != n:
            raise InputError(f"start holds {len(start.position)} particles, the bed {n}; start from a run of this bed")
        interactions = self.interactions(damper)
        enclosure = enclosure_of(damper, interactions, lid_height=packing.lid_height, folder=self.folder)
        material = np.asarray(interactions.component, np.int32)[packing.component]
        motion = motion_of(spec.motion, folder=self.folder)
        speed = expected_speed(motion, float(np.linalg.norm(damper.gravity)), float(packing.radius.max()))
        contact = shortest_contact(interactions, packing.radius, material, speed)
        plan = plan_of(spec, motion, spec.run.time_step or contact / spec.run.steps_per_contact)
        smallest = float(packing.radius.min())
        omega = float(motion.timing[0, FUNDAMENTAL])
        amplitude = omega * float(np.linalg.norm(motion.wave[0, 0, 2:5])) if omega > 0.0 else 0.0
        given = None
        if start is not None:
            given = amplitude * start.velocity, amplitude * start.spin / packing.radius[:, None]
        position = packing.position if start is None else np.ascontiguousarray(start.position)
        world = loaded(
            Bed.at_rest(position, packing.radius, material),
            enclosure,
            interactions,
            damper.gravity,
            plan.time_step,
            motion,
            min(max(SKIN_STEPS * speed * plan.time_step, 0.04 * smallest), 0.25 * smallest),
            plan.n_step,
            plan.per_cycle or max(plan.n_step // CHUNKS, 1),
            0 if start is not None else plan.n_settle,
            given,
        )
        return Described(
            spec=spec,
            packing=packing,
            enclosure=enclosure,
            plan=plan,
            loaded=world,
            mass=interactions.density[material] * 4.0 / 3.0 * np.pi * packing.radius**3,
            speed=amplitude,
            direction=motion.timing[0, 2:5].copy(),
            contact=shortest_contact(interactions, packing.radius, material, 1.0),
        )


def _check(spec: SimulationSpec) -> None:
    """Refuse what the batch does not do."""
    run = spec.run
    wanted = {
        'run.integrator = "gear"': run.integrator != "verlet",
        "run.snapshots_per_cycle": run.snapshots_per_cycle > 0,
        "run.velocity_field": run.velocity_field is not None,
    }
    for name, given in wanted.items():
        if given:
            raise InputError(f"{name} is not available on the GPU; leave it out or use the CPU back end")
