"""One operating point of a field: what determines it, its hash, and its measurement."""

import hashlib
import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from graindamp.campaign.backends import CPU, checked
from graindamp.spec.container import MeshContainer
from graindamp.spec.field import FieldSpec, StopSpec
from graindamp.spec.model import parse_spec
from graindamp.spec.simulation import SimulationSpec
from graindamp.status import FATAL, Status

if TYPE_CHECKING:
    from graindamp.dem.notes import Cycles
    from graindamp.dem.packing_store import Packing
    from graindamp.dem.run import Run

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
    backend: str = CPU
    """What computes it, one of :data:`graindamp.campaign.backends.BACKENDS`."""

    @property
    def where(self) -> Path | None:
        """The folder as a path."""
        return None if self.folder is None else Path(self.folder)

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
        """All that determines the result, as plain tables; titles and names do not. Of the processor's points the back
        end is not told, so that they keep the keys that they had before there was another one."""
        told: dict[str, Any] = self.simulation.model_dump(mode="json", exclude={"title": True, "damper": {"name"}})
        container = self.simulation.damper.container
        if isinstance(container, MeshContainer):
            path = (self.where or Path()) / container.file
            del told["damper"]["container"]["file"]
            told["mesh"] = hashlib.sha256(path.read_bytes()).hexdigest() if path.is_file() else None
        document = {
            "simulation": told,
            "stop": self.stop.model_dump(mode="json"),
            "start": self.start,
            "physics": PHYSICS,
        }
        return document if self.backend == CPU else document | {"backend": self.backend}

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
                "backend": self.backend,
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
            backend=checked(told.get("backend", CPU)),
        )


def task_of(
    spec: FieldSpec,
    frequency: float,
    intensity: float,
    seed: int = 0,
    start: str | None = None,
    folder: Path | None = None,
    backend: str = CPU,
) -> PointTask:
    """Task of one operating point of a field.

    Args:
        spec: the field.
        frequency: [Hz].
        intensity: Gamma [-].
        seed: number of the bed, 0 to spec.seeds - 1.
        start: key of the result whose end it starts from; None: from rest.
        folder: what files in the description are relative to.
        backend: what computes it.
    """
    where = None if folder is None else str(folder.resolve())
    return PointTask(spec.at(frequency, intensity, seed), spec.stop, start, where, backend)


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


class PointRule:
    """When the run of a task on the processor may end, asked after each of its cycles; a GPU has the same rule."""

    def __init__(self, task: PointTask, mass: float) -> None:
        """A rule that has not looked yet, for a bed of the given mass [kg]."""
        from graindamp.signals.stopping import Stopping

        self._stopping = Stopping(task.stop.tolerance, task.stop.floor, task.stop.min_cycles)
        self._omega, self._mass = 2.0 * math.pi * task.frequency, mass

    def __call__(self, cycles: "Cycles") -> bool:
        """Whether the run may end, from all of its cycles."""
        from graindamp.signals.simulated import ratios_of

        ratios = ratios_of(cycles.force, cycles.velocity, self._omega, self._mass)
        return self._stopping.enough(ratios.loss_factor, ratios.effective_mass_ratio)


def bed_mass(task: PointTask, packing: "Packing") -> float:
    """Mass of the particles of a bed [kg]."""
    density = np.array([component.density for component in task.simulation.damper.particles])
    return float(np.sum(density[packing.component] * 4.0 / 3.0 * np.pi * packing.radius**3))


def measure(
    task: PointTask,
    start: PointResult | None = None,
    *,
    cache: Path | None = None,
    progress: Callable[[str, float, float | None], None] | None = None,
) -> PointResult:
    """Simulate one operating point on the processor until it is known as well as asked, or the limit of cycles is
    reached.

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

    packing = pack(task.simulation.damper, folder=task.where, cache=cache, progress=progress)
    run = simulate(
        task.simulation,
        folder=task.where,
        cache=cache,
        packing=packing,
        start=None if start is None else BedState(start.end_position, start.end_velocity, start.end_spin),
        enough=PointRule(task, bed_mass(task, packing)),
        progress=progress,
    )
    if run.status & int(Status.INTERRUPTED):
        raise KeyboardInterrupt
    return result_of(task, run, packing)


def result_of(task: PointTask, run: "Run", packing: "Packing") -> PointResult:
    """What is known of a task after its run, whatever has computed it.

    Args:
        task: what was simulated.
        run: its run.
        packing: its bed as packed.
    """
    from graindamp.signals.motion_modes import classify
    from graindamp.signals.simulated import ratios_of
    from graindamp.signals.stopping import Stopping, estimate

    cycles = ratios_of(run.cycle_force, run.cycle_velocity, 2.0 * math.pi * task.frequency, bed_mass(task, packing))
    facts = _facts(task, run, packing) | {
        "cycle_loss_factor": cycles.loss_factor,
        "cycle_mass_ratio": cycles.effective_mass_ratio,
    }
    status = run.status
    if len(cycles.loss_factor) < 2 or status & int(FATAL):
        nan = math.nan
        status |= 0 if status & int(FATAL) else int(Status.TOO_SHORT)
        return PointResult(
            loss_factor=nan, loss_factor_se=nan, effective_mass_ratio=nan, effective_mass_ratio_se=nan,
            n_cycles=0, n_skipped=0, status=status, losses=np.full(len(LOSSES), nan), **facts,
        )  # fmt: skip
    found = estimate(cycles.loss_factor, cycles.effective_mass_ratio, task.stop.floor)
    if not found.is_steady:
        status |= int(Status.NOT_STEADY)
    if not Stopping(task.stop.tolerance, task.stop.floor, task.stop.min_cycles).met(found):
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
        **facts,
    )


def _facts(task: PointTask, run: "Run", packing: "Packing") -> dict[str, Any]:
    """What a result holds whether or not the run gave a value."""
    nothing = np.empty((0, 3))
    return {
        "frequency": task.frequency,
        "intensity": task.intensity,
        "bed_mass": bed_mass(task, packing),
        "n_particle": len(run.mass),
        "n_step": run.n_step,
        "time_step": run.time_step,
        "seconds": run.seconds,
        "solid_fraction": packing.solid_fraction,
        "clearance": math.nan if packing.clearance is None else packing.clearance,
        "largest_overlap": float(np.max(run.largest_overlap)),
        "largest_speed": run.largest_speed,
        "end_position": nothing if run.end is None else run.end.position,
        "end_velocity": nothing if run.end is None else run.end.velocity,
        "end_spin": nothing if run.end is None else run.end.spin,
    }


def _losses(run: "Run", n_skipped: int) -> Real:
    """Mean power of each mechanism after the cycles dropped [W]."""
    assert run.frequency is not None
    begin = n_skipped / run.frequency
    first = int(np.argmin(np.abs(run.energy_time - begin)))
    span = float(run.energy_time[-1] - run.energy_time[first])
    table = np.array([[getattr(one, name) for name in LOSSES] for one in (run.energy[first], run.energy[-1])])
    return np.asarray((table[1] - table[0]) / span)
