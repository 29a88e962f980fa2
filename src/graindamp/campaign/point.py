"""One operating point of a field: what determines it, its hash, and its measurement."""

import hashlib
import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from graindamp.spec.container import MeshContainer
from graindamp.spec.field import FieldSpec, StopSpec
from graindamp.spec.model import parse_spec
from graindamp.spec.simulation import SimulationSpec
from graindamp.status import FATAL, Status

Real = NDArray[np.float64]

PHYSICS = 1
"""Version of the engine's physics. Raised by whoever changes what comes out of a run beyond rounding; results of other
versions are then computed anew, never mixed."""

LOSSES = ("loss_normal", "loss_friction", "loss_normal_wall", "loss_friction_wall", "loss_lid", "loss_rolling")
"""Mechanisms that a run tells apart, in the order of `PointResult.losses`."""

NO_CRITERIA: Real = np.full(15, np.nan)
"""Criteria of a point whose motion is unknown."""


class PointTask(NamedTuple):
    """Everything that determines the result of one operating point, and where its files are."""

    simulation: SimulationSpec
    stop: StopSpec
    start: str | None = None
    """Key of the result whose end this point starts from; None: from rest."""
    folder: str | None = None
    """What files in the description are relative to; their content counts for the key, not their place."""

    @property
    def frequency(self) -> float:
        """Driving frequency [Hz]."""
        assert self.simulation.base_frequency is not None
        return self.simulation.base_frequency

    @property
    def intensity(self) -> float:
        """Intensity Gamma [-]."""
        value = getattr(self.simulation.motion, "intensity", None)
        assert isinstance(value, float)
        return value

    @property
    def seed(self) -> int:
        """Seed of the bed [-]."""
        return self.simulation.damper.packing.seed

    def document(self) -> dict[str, Any]:
        """All that determines the result, as plain tables; titles and names do not."""
        told: dict[str, Any] = self.simulation.model_dump(mode="json", exclude={"title": True, "damper": {"name"}})
        container = self.simulation.damper.container
        if isinstance(container, MeshContainer):
            path = Path(self.folder or ".") / container.file
            del told["damper"]["container"]["file"]
            told["mesh"] = hashlib.sha256(path.read_bytes()).hexdigest() if path.is_file() else None
        return {
            "simulation": told,
            "stop": self.stop.model_dump(mode="json"),
            "start": self.start,
            "physics": PHYSICS,
        }

    @property
    def key(self) -> str:
        """Hash of :meth:`document`, 64 hexadecimal digits."""
        return hashlib.sha256(json.dumps(self.document(), sort_keys=True).encode()).hexdigest()

    def dump(self) -> str:
        """The task as text, for :meth:`load`."""
        return json.dumps(
            {
                "simulation": self.simulation.model_dump(mode="json"),
                "stop": self.stop.model_dump(mode="json"),
                "start": self.start,
                "folder": self.folder,
            },
            sort_keys=True,
        )

    @classmethod
    def load(cls, text: str) -> "PointTask":
        """The task that :meth:`dump` wrote.

        Raises:
            InputError: the text does not describe a task.
        """
        told = json.loads(text)
        return cls(
            simulation=parse_spec(told["simulation"], SimulationSpec, "task: simulation"),
            stop=parse_spec(told["stop"], StopSpec, "task: stop"),
            start=told["start"],
            folder=told["folder"],
        )


def task_of(
    spec: FieldSpec,
    frequency: float,
    intensity: float,
    seed: int = 0,
    start: str | None = None,
    folder: Path | None = None,
) -> PointTask:
    """Task of one operating point of a field.

    Args:
        spec: the field.
        frequency: [Hz].
        intensity: Gamma [-].
        seed: number of the bed, 0 to spec.seeds - 1.
        start: key of the result whose end it starts from; None: from rest.
        folder: what files in the description are relative to.
    """
    where = None if folder is None else str(folder.resolve())
    return PointTask(spec.at(frequency, intensity, seed), spec.stop, start, where)


class PointResult(NamedTuple):
    """What is known of one operating point after its run. All of it but `seconds` follows from the task."""

    frequency: float
    """[Hz]"""
    intensity: float
    """Gamma [-]."""
    bed_mass: float
    """[kg]"""
    loss_factor: float
    """eta [-]; NaN where the run failed."""
    loss_factor_se: float
    """Its standard error [-]."""
    effective_mass_ratio: float
    """m' [-]."""
    effective_mass_ratio_se: float
    """Its standard error [-]."""
    n_cycles: int
    """Cycles averaged over [-]."""
    n_skipped: int
    """Cycles dropped before them [-]."""
    status: int
    """Status bits, see :class:`graindamp.status.Status`."""
    n_particle: int
    n_step: int
    """Time steps of the motion [-]."""
    time_step: float
    """[s]"""
    seconds: float
    """Time that the motion took to compute [s]."""
    solid_fraction: float
    """Of the packed bed [-]; NaN where it has no walls round it."""
    clearance: float
    """Free travel of the packed bed [m]; NaN without a rigid lid."""
    largest_overlap: float
    """Over the smallest radius [-]."""
    largest_speed: float
    """Speed of the fastest impact [m/s]."""
    losses: Real
    """Mean power dissipated by each of :data:`LOSSES` over the cycles averaged over [W]; (6,)."""
    cycle_loss_factor: Real
    """eta of every cycle, transient included [-]; (cycle,)."""
    cycle_mass_ratio: Real
    """m' of every cycle [-]; (cycle,)."""
    end_position: Real
    """Centres at the end [m]; (particle, 3), or (0, 3) where the run failed."""
    end_velocity: Real
    """Velocities at the end over the container's speed amplitude [-]; (particle, 3)."""
    end_spin: Real
    """Angular velocities times radius over the same [-]; (particle, 3)."""
    motion_mode: int = -1
    """A :class:`graindamp.signals.motion_modes.MotionMode`, -1 where unknown."""
    criteria: Real = NO_CRITERIA
    """What it was judged by, in the order of :class:`graindamp.signals.motion_modes.Criteria` [-]; (15,)."""

    @property
    def particle_steps(self) -> float:
        """Particles times time steps [-], what the point cost."""
        return float(self.n_particle) * self.n_step

    @property
    def failed(self) -> bool:
        """Whether there is no usable value."""
        return bool(self.status & int(FATAL))


def measure(
    task: PointTask,
    start: PointResult | None = None,
    *,
    cache: Path | None = None,
    progress: Callable[[str, float, float | None], None] | None = None,
) -> PointResult:
    """Simulate one operating point until it is known as well as asked, or the limit of cycles is reached.

    Ctrl-C is passed on: a partial point is no point.

    Args:
        task: what to simulate.
        start: the result that `task.start` names; None: from rest.
        cache: folder of stored packings; None: that of the user.
        progress: as of :func:`graindamp.dem.simulate.simulate`.

    Raises:
        InputError: the bed does not fit, or a file cannot be used.
        KeyboardInterrupt: the run was stopped.
    """
    from graindamp.dem.packing import pack
    from graindamp.dem.run import BedState
    from graindamp.dem.simulate import simulate
    from graindamp.signals.motion_modes import classify
    from graindamp.signals.simulated import ratios_of
    from graindamp.signals.stopping import Stopping, estimate

    folder = None if task.folder is None else Path(task.folder)
    packing = pack(task.simulation.damper, folder=folder, cache=cache, progress=progress)
    density = np.array([component.density for component in task.simulation.damper.particles])
    mass = float(np.sum(density[packing.component] * 4.0 / 3.0 * np.pi * packing.radius**3))
    rule = Stopping(task.stop.tolerance, task.stop.floor, task.stop.min_cycles)
    omega = 2.0 * math.pi * task.frequency
    bed = None if start is None else BedState(start.end_position, start.end_velocity, start.end_spin)
    run = simulate(
        task.simulation,
        folder=folder,
        cache=cache,
        packing=packing,
        start=bed,
        enough=lambda cycles: rule.enough(*ratios_of(cycles.force, cycles.velocity, omega, mass)),
        progress=progress,
    )
    if run.status & int(Status.INTERRUPTED):
        raise KeyboardInterrupt
    cycles = ratios_of(run.cycle_force, run.cycle_velocity, omega, mass)
    status = run.status
    nothing = np.empty((0, 3))
    common: dict[str, Any] = {
        "frequency": task.frequency,
        "intensity": task.intensity,
        "bed_mass": mass,
        "n_particle": len(run.mass),
        "n_step": run.n_step,
        "time_step": run.time_step,
        "seconds": run.seconds,
        "solid_fraction": packing.solid_fraction,
        "clearance": math.nan if packing.clearance is None else packing.clearance,
        "largest_overlap": float(np.max(run.largest_overlap)),
        "largest_speed": run.largest_speed,
        "cycle_loss_factor": cycles.loss_factor,
        "cycle_mass_ratio": cycles.effective_mass_ratio,
        "end_position": nothing if run.end is None else run.end.position,
        "end_velocity": nothing if run.end is None else run.end.velocity,
        "end_spin": nothing if run.end is None else run.end.spin,
    }
    if len(cycles.loss_factor) < 2 or status & int(FATAL):
        nan = math.nan
        status |= 0 if status & int(FATAL) else int(Status.TOO_SHORT)
        return PointResult(
            loss_factor=nan, loss_factor_se=nan, effective_mass_ratio=nan, effective_mass_ratio_se=nan,
            n_cycles=0, n_skipped=0, status=status, losses=np.full(len(LOSSES), nan), **common,
        )  # fmt: skip
    found = estimate(cycles.loss_factor, cycles.effective_mass_ratio, task.stop.floor)
    if not found.is_steady:
        status |= int(Status.NOT_STEADY)
    if not rule.met(found):
        status |= int(Status.NOT_CONVERGED)
    verdict = classify(run, found.n_skipped)
    return PointResult(
        loss_factor=found.loss_factor,
        loss_factor_se=found.loss_factor_se,
        effective_mass_ratio=found.effective_mass_ratio,
        effective_mass_ratio_se=found.effective_mass_ratio_se,
        n_cycles=found.n_cycle,
        n_skipped=found.n_skipped,
        status=status,
        losses=_losses(run, found.n_skipped),
        motion_mode=int(verdict.mode),
        criteria=np.array(verdict.criteria),
        **common,
    )


def _losses(run: Any, n_skipped: int) -> Real:
    """Mean power of each mechanism after the cycles dropped [W]."""
    begin = n_skipped / run.frequency
    first = int(np.argmin(np.abs(run.energy_time - begin)))
    span = float(run.energy_time[-1] - run.energy_time[first])
    table = np.array([[getattr(one, name) for name in LOSSES] for one in (run.energy[first], run.energy[-1])])
    return np.asarray((table[1] - table[0]) / span)
