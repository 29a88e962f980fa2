"""Many operating points at once on one GPU: each has a slot while it runs, and leaves it to the next one when it has
ended. The device decides when that is; the host looks at counts after every launch."""

import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from graindamp.dem.gpu.columns import (
    ENOUGH,
    FLOOR,
    IDLE,
    N_COUNT,
    NEW,
    NEXT_LOOK,
    ROW,
    STAGE,
    STATUS,
    STEP,
    TOLERANCE,
    UNTIL,
    UNTIL_CYCLE,
    UNTIL_END,
    UNTIL_KNOWN,
    WANTED_PAIRS,
    WANTED_TOUCHES,
)
from graindamp.dem.gpu.device import Variant, require, simulated
from graindamp.dem.gpu.kernels import Kernels, kernels_of
from graindamp.dem.gpu.load import Described, Describer
from graindamp.dem.gpu.memory import Memory, covering
from graindamp.dem.gpu.outcome import run_of
from graindamp.dem.gpu.state import Room
from graindamp.dem.packing_store import Packing
from graindamp.dem.run import BedState, Run
from graindamp.errors import InputError
from graindamp.signals.stopping import Stopping
from graindamp.spec.simulation import SimulationSpec
from graindamp.status import Status

LISTS_FULL = int(Status.LISTS_FULL)

GROWTH = 1.3
"""Factor by which lists grow beyond what a world asked for [-]."""

LAUNCH_SECONDS = 0.1
"""Time that one launch shall take [s]: long beside what the host does between two, short beside a cycle."""

FIRST_CHUNK = 200
"""Steps of the first launch [-]."""

THREADS = 512
"""Threads of a block: leaves a thread 128 registers, with which next to nothing spills to memory."""

SIMULATED_THREADS = 4

PRECISION = {"mixed": np.float32, "double": np.float64}
"""Working type by name: forces and velocities at contacts in single precision, or everything in double."""


class Task(NamedTuple):
    """One operating point to simulate; arguments as of :func:`graindamp.dem.simulate.simulate`."""

    spec: SimulationSpec
    packing: Packing | None = None
    start: BedState | None = None


def simulate_batch(
    tasks: Iterable[Task | None],
    *,
    stopping: Callable[[int], Stopping | None] | None = None,
    hurry: Callable[[], bool] | None = None,
    refused: Callable[[int, InputError], None] | None = None,
    precision: str = "mixed",
    folder: Path | None = None,
    cache: Path | None = None,
    slots: int | None = None,
    chunk: int | None = None,
    team: int = 1,
    variant: Variant | None = None,
    progress: Callable[[int, float], None] | None = None,
) -> Iterator[tuple[int, Run]]:
    """Simulate operating points side by side on one GPU.

    Each is simulated as :func:`graindamp.dem.simulate.simulate` does it. A run holds cycles, energies at the end of
    every cycle, impacts and the final bed; it holds no force series. Results do not depend on which operating points
    ran beside it, nor on `slots` and `chunk`.

    Args:
        tasks: operating points; taken from the iterable when a slot is free, so that it may be endless for a while.
            None: there is none now, look again after a launch. If nothing is under way either, the batch ends.
        stopping: called with the number of a task; gives the rule by which the device ends it, one that has not looked
            yet. None: it runs to the end of its description, as those without cycles always do.
        hurry: asked before every launch; once it is True, every operating point ends with its next whole cycle that is
            the eighth or a later one, whatever its rule.
        refused: told the number of a task that cannot be simulated and why; the others go on. None: raised.
        precision: "mixed" or "double".
        folder: what files in the descriptions are relative to; None: the working folder.
        cache: folder of stored packings; None: that of the user.
        slots: operating points that run at once, at most; None: as many as keep the GPU busy.
        chunk: steps per launch; None: as many as take a tenth of a second.
        team: thread blocks per operating point, for fewer operating points than the GPU has multiprocessors; `slots`
            times `team` may not exceed what runs on the GPU at once.
        variant: what the kernels are compiled for, for experiments; its precision and features are filled in.
        progress: called after every launch with operating points finished and particle-steps done.

    Yields:
        Number of the task, counted from 0, and its result, in the order in which they end.

    Raises:
        InputError: numba-cuda or a GPU is missing; or, unless there is `refused`, a description cannot be used or its
            world does not fit the GPU.
    """
    if precision not in PRECISION:
        raise InputError(f'precision is "{precision}"; it can be "mixed" or "double"')
    require()
    base = variant or Variant(threads=SIMULATED_THREADS if simulated() else THREADS)
    base = base._replace(real=PRECISION[precision], teams=team > 1)
    blocks = _blocks_of(base)
    slots = slots or max(blocks // team, 1)
    if team > 1 and slots * team > blocks:
        raise InputError(f"{slots} slots of {team} blocks are more than the {blocks} that run at once; use fewer")
    describer = Describer(folder, cache)
    driver = _Driver(iter(tasks), stopping, hurry, refused, base, describer, slots, team, chunk, progress)
    yield from driver.results()


def full_slots() -> int:
    """Operating points that keep the GPU busy [-].

    Raises:
        InputError: numba-cuda or a GPU is missing.
    """
    require()
    return _blocks_of(Variant(threads=SIMULATED_THREADS if simulated() else THREADS))


class _Resident:
    """A world in its slot."""

    def __init__(self, number: int, world: Described, rule: Stopping | None) -> None:
        self.number, self.world, self.rule = number, world, rule
        self.step, self.seconds = 0, 0.0

    def until(self, hurries: bool) -> int:
        """Until when it runs."""
        if not self.world.plan.per_cycle:
            return UNTIL_END
        return UNTIL_CYCLE if hurries else UNTIL_END if self.rule is None else UNTIL_KNOWN


class _Driver:
    """Keeps the slots filled."""

    def __init__(
        self,
        tasks: Iterator[Task | None],
        stopping: Callable[[int], Stopping | None] | None,
        hurry: Callable[[], bool] | None,
        refused: Callable[[int, InputError], None] | None,
        variant: Variant,
        describer: Describer,
        slots: int,
        team: int,
        chunk: int | None,
        progress: Callable[[int, float], None] | None,
    ) -> None:
        self.tasks, self.stopping, self.refused = tasks, stopping, refused
        self.hurry, self.hurries = hurry, False
        self.variant, self.describer, self.team = variant, describer, team
        self.most, self.taken = slots, 0
        self.chunk, self.adapt, self.progress = chunk or FIRST_CHUNK, chunk is None and not simulated(), progress
        self.waiting: deque[tuple[int, Described]] = deque()
        self.resident: list[_Resident | None] = []
        self.memory: Memory | None = None
        self.kernels: Kernels | None = None
        self.finished, self.work = 0, 0.0

    def results(self) -> Iterator[tuple[int, Run]]:
        """Run all tasks."""
        while True:
            while not self._fill():
                pass
            if not any(self.resident):
                return
            self._launch()
            yield from self._look()

    def _next(self) -> tuple[int, Described] | None:
        """The next world to be loaded; None: there is none now."""
        if self.waiting:
            return self.waiting.popleft()
        for task in self.tasks:
            if task is None:
                return None
            number, self.taken = self.taken, self.taken + 1
            try:
                return number, self.describer.described(*task)
            except InputError as error:
                if self.refused is None:
                    raise
                self.refused(number, error)
        return None

    def _fill(self) -> bool:
        """Load worlds into free slots, and make more slots while worlds wait and the most is not reached. False: there
        was no room, fewer have to be tried."""
        had = len(self.resident)
        new = self._taken_in()
        if not new:
            return True
        wanted = self._room([resident.world for _, resident in new])
        fits = self.memory is not None and covering(wanted, self.memory.room) == self.memory.room
        if not fits and not self._enlarge(wanted):
            if self.memory is not None and len(self.resident) > had:
                self._retreat(new, had)
            else:
                self._fewer()
            return False
        assert self.memory is not None
        assert self.kernels is not None
        for slot, resident in new:
            self.memory.load(slot, resident.world.loaded)
            self.kernels.clear[1, self.variant.threads](self.memory.batch, slot)
            self._aim(slot, resident)
            self._start(slot, resident)
        return True

    def _taken_in(self) -> list[tuple[int, _Resident]]:
        """The next worlds with their slots, which they have now, but not yet on the device."""
        new: list[tuple[int, _Resident]] = []
        for slot in range(self.most):
            if slot < len(self.resident) and self.resident[slot] is not None:
                continue
            found = self._next()
            if found is None:
                break
            number, world = found
            resident = _Resident(number, world, self.stopping(number) if self.stopping else None)
            self.resident[slot : slot + 1] = [resident]
            new.append((slot, resident))
        return new

    def _room(self, worlds: list[Described]) -> Room:
        rooms = [world.loaded.room(self.variant.threads * self.team) for world in worlds]
        room = rooms[0]
        for one in rooms[1:]:
            room = covering(room, one)
        return room._replace(slots=len(self.resident))

    def _enlarge(self, wanted: Room) -> bool:
        """Make room for all worlds as they are. False: there was none, and nothing has changed."""
        try:
            if self.memory is None:
                self.memory = Memory(wanted, self.variant.real)
            else:
                self.memory = self.memory.enlarged(covering(wanted, self.memory.room))
        except MemoryError:
            return False
        room = self.memory.room
        if self.kernels is None or (self.variant.springs, self.variant.rolling) != (room.springs, room.rolling):
            self.variant = self.variant._replace(springs=room.springs, rolling=room.rolling)
            self.kernels = kernels_of(self.variant)
        return True

    def _retreat(self, new: list[tuple[int, _Resident]], slots: int) -> None:
        """Put new worlds back, and stay with the slots that there were."""
        for slot, one in reversed(new):
            self.waiting.appendleft((one.number, one.world))
            self.resident[slot] = None
        self.most = slots
        del self.resident[slots:]

    def _fewer(self) -> None:
        """Put all worlds back, to start anew in half the slots; give one up that does not fit alone."""
        worlds = [one for one in self.resident if one is not None]
        self.resident, self.memory, self.most = [], None, max(len(worlds) // 2, 1)
        if len(worlds) > 1:
            self.waiting.extendleft((one.number, one.world) for one in reversed(worlds))
            return
        reason = InputError("one operating point alone does not fit the GPU; use the CPU back end")
        if self.refused is None:
            raise reason
        self.refused(worlds[0].number, reason)

    def _aim(self, slot: int, resident: _Resident) -> None:
        """Tell a world until when it runs."""
        assert self.memory is not None
        codes = resident.world.loaded.arrays["slots"]["codes"].copy()
        codes[UNTIL] = resident.until(self.hurries)
        self.memory.write("slots", "codes", slot, codes)

    def _start(self, slot: int, resident: _Resident) -> None:
        """Give a world its rule, and let it begin with the next launch."""
        assert self.memory is not None
        counts = np.zeros(N_COUNT, np.int64)
        counts[STAGE] = NEW
        if resident.rule is not None:
            numbers = resident.world.loaded.arrays["slots"]["numbers"].copy()
            numbers[TOLERANCE], numbers[FLOOR] = resident.rule.tolerance, resident.rule.floor
            self.memory.write("slots", "numbers", slot, numbers)
            counts[NEXT_LOOK] = resident.rule.next_look
        self.memory.write("slots", "counts", slot, counts)

    def _launch(self) -> None:
        assert self.memory is not None
        assert self.kernels is not None
        if not self.hurries and self.hurry is not None and self.hurry():
            self.hurries = True
            for slot, one in enumerate(self.resident):
                if one is not None:
                    self._aim(slot, one)
        begin = time.perf_counter()
        self.kernels.advance[len(self.resident) * self.team, self.variant.threads](self.memory.batch, self.chunk)
        self.counts = self.memory.read("slots", "counts")
        spent = time.perf_counter() - begin
        work = [0.0] * len(self.resident)
        for slot, one in enumerate(self.resident):
            if one is not None:
                step = int(self.counts[slot, STEP])
                work[slot] = (step - one.step) * len(one.world.mass)
                one.step = step
        self.work += sum(work)
        for one, part in zip(self.resident, work, strict=True):
            if one is not None:
                one.seconds += spent * part / max(sum(work), 1.0)
        if self.adapt:
            self.chunk = int(min(max(self.chunk * LAUNCH_SECONDS / spent, 0.5 * self.chunk, 10), 2 * self.chunk))
        if self.progress is not None:
            self.progress(self.finished, self.work)

    def _look(self) -> Iterator[tuple[int, Run]]:
        """Take what has ended out of its slot, and make room where lists are full."""
        assert self.memory is not None
        full = []
        for slot, one in enumerate(self.resident):
            if one is None:
                continue
            counts = self.counts[slot]
            if counts[STATUS] & LISTS_FULL:
                full.append(slot)
                continue
            if counts[STATUS] or counts[ENOUGH] or one.step >= one.world.loaded.end:
                rows = self.memory.read("slots", "rows", slot)[: counts[ROW]]
                run = run_of(one.world, rows, one.step, one.seconds, int(counts[STATUS]), self.memory, slot)
                counts[STAGE] = IDLE
                self.memory.write("slots", "counts", slot, counts)
                self.resident[slot] = None
                self.finished += 1
                yield one.number, run
        if full:
            self._relieve(full)

    def _relieve(self, full: list[int]) -> None:
        """Give the lists of all worlds the room that those of the slots `full` asked for; these go on where they
        stopped."""
        assert self.memory is not None
        room = self.memory.room
        pairs, touches = (int(self.counts[full, column].max()) for column in (WANTED_PAIRS, WANTED_TOUCHES))
        longer = room._replace(
            pairs=int(GROWTH * pairs) + 16 if pairs > room.pairs else room.pairs,
            touches=int(GROWTH * touches) + 16 if touches > room.touches else room.touches,
        )
        if not self._enlarge(longer):
            self._fewer()
            return
        for slot in full:
            counts = self.counts[slot].copy()
            counts[STATUS] &= ~LISTS_FULL
            self.memory.write("slots", "counts", slot, counts)


def _blocks_of(variant: Variant) -> int:
    """Blocks that fill the GPU: as many as its multiprocessors hold at a time."""
    if simulated():
        return 2
    from numba import cuda

    return int(cuda.get_current_device().MULTIPROCESSOR_COUNT) * max(1024 // variant.threads, 1)
