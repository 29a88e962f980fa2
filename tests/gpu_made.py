"""Small worlds for the GPU back end, in the simulator."""

import sys
import threading
from contextlib import contextmanager
from typing import NamedTuple
from unittest.mock import patch

import numpy as np

from dem_made import damper_of, state_of
from graindamp.dem.container import enclosure_of
from graindamp.dem.energy import energies
from graindamp.dem.engine import run, start
from graindamp.dem.gpu import batch, device
from graindamp.dem.gpu.columns import STATUS
from graindamp.dem.gpu.device import Builder, Variant
from graindamp.dem.gpu.kernels import Kernels, advance, clear, kernels_of
from graindamp.dem.gpu.load import loaded
from graindamp.dem.gpu.memory import Memory
from graindamp.dem.gpu.outcome import energies_of
from graindamp.dem.interactions import interactions_of
from graindamp.dem.packing_store import Packing
from graindamp.dem.world import Bed, world_of
from graindamp.spec.model import parse_spec
from graindamp.spec.simulation import SimulationSpec

THREADS = 4
REAL = {"double": np.float64, "mixed": np.float32}


@contextmanager
def quick_turns():
    """Simulated threads take turns at barriers; Python's usual 5 ms between turns would be all of the time."""
    before = sys.getswitchinterval()
    sys.setswitchinterval(2e-5)
    try:
        yield
    finally:
        sys.setswitchinterval(before)


def quick_worker():
    """The same for the rest of a process, with one thread per block, which waits for nobody."""
    sys.setswitchinterval(2e-5)
    batch.SIMULATED_THREADS = 1


class _Place(NamedTuple):
    x: int


class Team:
    """Stands for `cuda` in kernels whose blocks run at the same time, which numba's simulator cannot; for one world."""

    def __init__(self, blocks, threads):
        self.blocks, self.threads, self.own = blocks, threads, threading.local()
        self.barriers = [threading.Barrier(threads) for _ in range(blocks)]
        self.flags = [[False] * threads for _ in range(blocks)]
        self.made, self.lock = {}, threading.Lock()
        self.shared = self.atomic = self

    gridDim = property(lambda self: _Place(self.blocks))
    blockDim = property(lambda self: _Place(self.threads))
    threadIdx = property(lambda self: _Place(self.own.thread))
    blockIdx = property(lambda self: _Place(self.own.block))

    def syncthreads(self):
        self.barriers[self.own.block].wait(timeout=60)

    def syncthreads_or(self, flag):
        flags = self.flags[self.own.block]
        flags[self.own.thread] = bool(flag)
        self.syncthreads()
        result = any(flags)
        self.syncthreads()
        return result

    def threadfence(self):
        pass

    def array(self, shape, dtype):
        with self.lock:
            return self.made.setdefault((self.own.block, sys._getframe(1).f_lineno), np.zeros(shape, dtype))

    def add(self, array, place, value):
        with self.lock:
            before = array[place]
            array[place] += value
        return before

    def launch(self, body, *arguments):
        failed = []

        def thread(block, number):
            self.own.block, self.own.thread = block, number
            try:
                body(*arguments)
            except Exception as error:
                failed.append(error)
                for barrier in self.barriers:
                    barrier.abort()

        crew = [threading.Thread(target=thread, args=(b, t)) for b in range(self.blocks) for t in range(self.threads)]
        for one in crew:
            one.start()
        for one in crew:
            one.join()
        if failed:
            raise failed[0]


class Alone(Team):
    """Stands for `cuda` where blocks have one thread: they run one after the other in this thread, and wait for nobody.
    numba's simulator starts a thread for each, and looks all the time whether it is done."""

    def __init__(self):
        super().__init__(1, 1)

    def syncthreads(self):
        pass

    def syncthreads_or(self, flag):
        return bool(flag)

    def launch(self, body, *arguments):
        for block in range(self.blocks):
            self.own.block, self.own.thread = block, 0
            self.made.clear()
            body(*arguments)


class Launched:
    """Stands for a kernel whose blocks a :class:`Team` runs."""

    def __init__(self, team, body):
        self.team, self.body = team, body

    def __getitem__(self, shape):
        self.team.blocks = int(shape[0])
        return lambda *arguments: self.team.launch(self.body, *arguments)


def alone_kernels(variant):
    """The kernels of a variant with one thread per block."""
    alone = Alone()
    with patch.object(device, "_SimulatedCuda", lambda: alone):
        builder = Builder(variant)
        return Kernels(Launched(alone, builder.plain(advance)), Launched(alone, builder.plain(clear)))


def both(
    damper,
    bed,
    motion,
    time_step,
    n_step,
    precision,
    gravity=(0.0, 0.0, -9.81),
    skin=None,
    lid_height=None,
    team=None,
    folder=None,
):
    """Positions, velocities, spins, energies and Fourier sums after `n_step` steps: on the processor, on the device.

    Both start from the same positions and velocities; `motion` is a function that makes the container's motion anew. A
    `team` of blocks works on the world in place of one."""
    interactions = interactions_of(damper)
    enclosure = enclosure_of(damper, interactions, lid_height, folder=folder)
    skin = 0.1 * float(bed.radius.min()) if skin is None else skin
    worlds = world_of(bed, enclosure, interactions, gravity, time_step, motion(), skin=skin, n_cycle=1)
    worlds = run(start(worlds), n_step)
    cpu = [*state_of(worlds), energies(worlds), worlds.record.fourier[0, 0, :4]]
    given = (bed.velocity, bed.spin)
    world = loaded(bed, enclosure, interactions, gravity, time_step, motion(), skin, n_step, n_step, given=given)
    blocks = 1 if team is None else team.blocks
    room = world.room(THREADS * blocks)
    memory = Memory(room, REAL[precision])
    variant = Variant(REAL[precision], THREADS, room.springs, room.rolling, team is not None)
    memory.load(0, world)
    with quick_turns():
        kernels_of(variant).clear[1, THREADS](memory.batch, 0)
        if team is None:
            kernels_of(variant).advance[1, THREADS](memory.batch, 10**9)
        else:
            with patch.object(device, "_SimulatedCuda", lambda: team):
                body = Builder(variant).plain(advance)
            team.launch(body, memory.batch, n_step // 2)
            team.launch(body, memory.batch, 10**9)
    assert memory.read("slots", "counts", 0)[STATUS] == 0
    place = np.argsort(world.order)
    state = [memory.read("bed", name, 0).T[place] for name in ("position", "velocity_shown", "spin_shown")]
    row = memory.read("slots", "rows", 0)[1]
    return cpu, [*state, energies_of(row), row[:4]]


def spec_of(count=6, frequency=1000.0, intensity=100.0, cycles=2, settle=5e-5, **contact):
    """An operating point of a tiny damper, 200 steps per cycle."""
    told = {
        "damper": {
            "gravity": "-z",
            "particles": [{"material": "steel", "radius": 1e-3}],
            "fill": {"count": count},
            "container": {
                "kind": "cylinder", "axis": "x", "radius": 2.6e-3, "length": 6e-3, "material": "aluminium-6060",
            },
            "contact": {"restitution": 0.6, "friction": 0.2, "softening": 1e4, **contact},
        },
        "motion": {"kind": "harmonic", "frequency": frequency, "intensity": intensity, "direction": "x"},
        "run": {"cycles": cycles, "settle": settle},
    }  # fmt: skip
    return parse_spec(told, SimulationSpec, "made")


def packing_of(count):
    """Balls in two rows that nearly touch."""
    k = np.arange(count)
    position = np.column_stack(
        [1.2e-3 + (k // 2) * 1.55e-3, np.where(k % 2, -1.05e-3, 1.05e-3), -0.9e-3 + 0.3e-3 * (k % 3)]
    )
    return Packing(
        position=position,
        radius=np.full(count, 1e-3),
        component=np.zeros(count, np.int32),
        height=0.0,
        poured_height=0.0,
        top=0.0,
        solid_fraction=0.5,
        lid_height=None,
        clearance=None,
        tap_cycles=0,
        seconds=0.0,
    )


def bed_of(position, radius, velocity=0.0, spin=0.0):
    """Particles of one material."""
    position = np.atleast_2d(np.asarray(position, float))
    n = len(position)
    return Bed(
        position,
        np.broadcast_to(np.asarray(radius, float), n).copy(),
        np.zeros(n, np.int32),
        np.broadcast_to(np.asarray(velocity, float), (n, 3)).copy(),
        np.broadcast_to(np.asarray(spin, float), (n, 3)).copy(),
    )


__all__ = ["Team", "bed_of", "both", "damper_of", "packing_of", "quick_turns", "quick_worker", "spec_of"]
