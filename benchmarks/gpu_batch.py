"""Worlds of the benchmark's bed on a GPU, without a queue: what gpu_check.py checks and times."""

import os
import time
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import particle_steps_per_second as rates
from graindamp.dem.container import Enclosure, enclosure_of
from graindamp.dem.engine import run
from graindamp.dem.excitation import motion_of
from graindamp.dem.interactions import Interactions, interactions_of
from graindamp.dem.world import Bed
from graindamp.spec.model import parse_spec
from graindamp.spec.simulation import DamperSpec, SimulationSpec


class Scene(NamedTuple):
    """A bed at eight phases of a cycle, and its surroundings."""

    damper: DamperSpec
    interactions: Interactions
    enclosure: Enclosure
    states: list[rates.State]


def scene_of(n: int, data: Path, rehearse: bool) -> Scene:
    """The benchmark's bed of `n` spheres."""
    if rehearse:
        return _tiny(n)
    states, length, _ = rates.prepared(n, 6, data)
    damper = rates.spec_of(n).damper
    interactions = interactions_of(damper)
    return Scene(damper, interactions, enclosure_of(damper, interactions, lid_height=length), states)


def _tiny(n: int) -> Scene:
    told = rates.spec_of(n).model_dump()
    told["damper"]["container"] |= {"radius": 2.9e-3, "length": 8e-3, "axis": "x"}
    told["damper"]["lid"] = None
    damper = parse_spec(told, SimulationSpec, "rehearsal").damper
    interactions = interactions_of(damper)
    k = np.arange(n)
    place = np.column_stack([1.5e-3 + (k // 2) * 2.6e-3, np.where(k % 2, -1.3e-3, 1.3e-3), np.zeros(n)])
    rng = np.random.default_rng(1)
    bed = Bed(place, np.full(n, rates.RADIUS), np.zeros(n, np.int32), rng.normal(0, 0.3, (n, 3)), np.zeros((n, 3)))
    return Scene(damper, interactions, enclosure_of(damper, interactions), [rates.State(bed, 0.0)] * 8)


class Batch:
    """Worlds of one scene on the device, without a queue: what is timed."""

    def __init__(self, scene: Scene, worlds: int, precision: str, threads: int, n_step: int, **options: Any) -> None:
        """`worlds` worlds at the scene's phases in turn, from the option `phase` on, for at most `n_step` steps."""
        from graindamp.dem.gpu.batch import PRECISION
        from graindamp.dem.gpu.columns import NEW, STAGE
        from graindamp.dem.gpu.device import Variant
        from graindamp.dem.gpu.kernels import kernels_of
        from graindamp.dem.gpu.load import loaded
        from graindamp.dem.gpu.memory import Memory

        self.threads, self.worlds, self.n = threads, worlds, len(scene.states[0].bed.radius)
        loads = []
        phase = options.get("phase", 0)
        for state in [*scene.states[phase:], *scene.states[:phase]][:worlds]:
            motion = motion_of(rates.spec_of(self.n).motion, start=-state.time)
            given = (state.bed.velocity, state.bed.spin)
            loads.append(
                loaded(
                    state.bed,
                    scene.enclosure,
                    scene.interactions,
                    scene.damper.gravity,
                    rates.TIME_STEP,
                    motion,
                    0.05 * rates.RADIUS,
                    n_step,
                    n_step,
                    given=given,
                )
            )
        self.team = options.get("team", 1)
        room = loads[0].room(threads * self.team)._replace(slots=worlds)
        real = PRECISION[precision]
        limit = options.get("limit", threads)
        variant = Variant(real, limit, room.springs, room.rolling, self.team > 1, options.get("fast", False))
        self.kernels = kernels_of(variant)
        self.memory = Memory(room, real)
        for slot in range(worlds):
            world = loads[slot % len(loads)]
            self.memory.load(slot, world)
            self.kernels.clear[1, threads](self.memory.batch, slot)
            counts = self.memory.read("slots", "counts", slot)
            counts[:] = 0
            counts[STAGE] = NEW
            self.memory.write("slots", "counts", slot, counts)
        self.order = loads[0].order

    def go(self, n_step: int) -> tuple[float, int]:
        """Advance all worlds; seconds, and particle-steps done."""
        from graindamp.dem.gpu.columns import STATUS, STEP

        before = self.memory.read("slots", "counts")[:, STEP].sum()
        begin = time.perf_counter()
        self.kernels.advance[self.worlds * self.team, self.threads](self.memory.batch, n_step)
        counts = self.memory.read("slots", "counts")
        seconds = time.perf_counter() - begin
        if counts[:, STATUS].any():
            raise RuntimeError(f"worlds stopped with status {set(counts[:, STATUS].tolist())}")
        return seconds, int(counts[:, STEP].sum() - before) * self.n


def rate(batch: Batch, seconds: float) -> float:
    """Particle-steps per second over about `seconds`, after a first launch that compiles and makes the lists."""
    spent, _ = batch.go(20)
    spent, _ = batch.go(20)
    chunk = max(int(20 * 0.2 * seconds / spent), 5)
    spent, _ = batch.go(chunk)
    n_step = max(int(chunk * seconds / spent), 5)
    spent, work = batch.go(n_step)
    return work / spent


def rate_alone(scene: Scene, seconds: float, **options: Any) -> float:
    """Particle-steps per second of one world, mean over the phases of a cycle with equal steps at each."""
    size = threads()
    per_phase = [
        rate(Batch(scene, 1, "mixed", size, 10**7, phase=phase, **options), seconds)
        for phase in range(len(scene.states))
    ]
    return len(per_phase) / sum(1.0 / value for value in per_phase)


def rate_on_a_core(scene: Scene, work: float, repeat: int = 3) -> float:
    """The same on one core of the processor: particle-steps per second of processor time, the best of `repeat` times
    about `work` particle-steps at each phase."""
    n = len(scene.states[0].bed.radius)
    n_step, spent = max(int(work / n), 20), 0.0
    for state in scene.states:
        worlds = rates.world_at(
            state, scene.damper, scene.enclosure, scene.interactions, rates.TIME_STEP, (repeat + 1) * n_step
        )
        worlds = run(worlds, 20)
        seconds = []
        for _ in range(repeat):
            begin = time.process_time()
            worlds = run(worlds, n_step)
            seconds.append(time.process_time() - begin)
        spent += min(seconds)
    return len(scene.states) * n_step * n / spent


def threads() -> int:
    """Threads of a block [-]; few in the simulator, whose threads are slow."""
    return 4 if os.environ.get("NUMBA_ENABLE_CUDASIM") == "1" else 512
