"""The GPU of a process: points that its threads ask for run side by side, as many at a time as there are threads.

A thread hands its point over and waits; one more thread keeps the GPU's slots filled from what is waiting. So an
executor needs to know nothing of GPUs: what it runs in many threads of one process is one batch there.
"""

import threading
from collections import deque
from collections.abc import Iterator, Sequence
from concurrent.futures import Future
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from graindamp.campaign.backends import DeviceLost, precision_of
from graindamp.campaign.point import PointResult, PointTask, result_of
from graindamp.errors import InputError

if TYPE_CHECKING:
    from graindamp.dem.gpu.batch import Task
    from graindamp.dem.run import Run
    from graindamp.signals.stopping import Stopping

STOPPED = "the campaign was stopped"
WAITING = 8
"""One point more for every so many slots waits for the next free one, with its bed packed [-]."""


def measure_on_device(task: PointTask, start: PointResult | None) -> PointResult:
    """Simulate one operating point on the GPU beside those of other threads; like
    :func:`graindamp.campaign.point.measure`, of which it has the rule when to stop and the form of the result.

    Args:
        task: what to simulate.
        start: the result that `task.start` names; None: from rest.

    Raises:
        InputError: the bed does not fit its container or the GPU, or a file cannot be used.
        DeviceLost: there is no GPU, or it has failed.
    """
    from graindamp.dem.gpu.batch import Task
    from graindamp.dem.packing import pack
    from graindamp.dem.run import BedState
    from graindamp.signals.stopping import Stopping

    packing = pack(task.simulation.damper, folder=task.where)
    bed = None if start is None else BedState(start.end_position, start.end_velocity, start.end_spin)
    device = _device_of(precision_of(task.backend), task.where)
    rule = Stopping(task.stop.tolerance, task.stop.floor, task.stop.min_cycles)
    run = device.simulate(Task(task.simulation, packing, bed), rule)
    return result_of(task, run, packing)


def points_at_once() -> int:
    """Threads that keep the GPU of this process busy [-].

    Raises:
        InputError: numba-cuda or a GPU is missing.
    """
    from graindamp.dem.gpu.batch import full_slots

    slots = full_slots()
    return slots + max(slots // WAITING, 1)


def missing() -> str:
    """Why this process cannot compute on a GPU; empty if it can."""
    from graindamp.dem.gpu.device import require

    try:
        require()
    except InputError as error:
        return str(error)
    return ""


def stop_devices() -> None:
    """End all batches of this process after the launch that is running; threads that wait get DeviceLost."""
    with _lock:
        for device in _devices.values():
            device.stop()
            _ending.append(device.thread)
        _devices.clear()


class _Asked(NamedTuple):
    task: "Task"
    rule: "Stopping"
    run: "Future[Run]"


class _Stopped(Exception):
    """The batch is to end."""


class Device:
    """One batch at a time on the GPU, for points of one precision whose files are in one folder."""

    def __init__(self, precision: str, folder: Path | None, before: Sequence[threading.Thread] = ()) -> None:
        """Wait for points; the GPU is not touched before the first, nor before the threads `before` have left it."""
        self.precision, self.folder, self._before = precision, folder, before
        self._waiting: deque[_Asked] = deque()
        self._under_way: dict[int, _Asked] = {}
        self._changed = threading.Condition()
        self._stopped = False
        self.thread = threading.Thread(target=self._serve, daemon=True)
        self.thread.start()

    def simulate(self, task: "Task", rule: "Stopping") -> "Run":
        """The run of a task; returns when it has ended.

        Raises:
            InputError: the task cannot be simulated.
            DeviceLost: there is no GPU, or it has failed.
        """
        asked = _Asked(task, rule, Future())
        with self._changed:
            if self._stopped:
                raise DeviceLost(STOPPED)
            self._waiting.append(asked)
            self._changed.notify()
        return asked.run.result()

    def stop(self) -> None:
        """Let nobody wait any more; what runs on the GPU is dropped after its launch."""
        with self._changed:
            self._stopped = True
            self._changed.notify()
        self._let_go(STOPPED)

    def _serve(self) -> None:
        """Run batches until stopped: each lasts as long as there is something to do, and leaves no memory taken."""
        for thread in self._before:
            thread.join()
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._waiting or self._stopped)
            if self._stopped:
                self._let_go(STOPPED)
                return
            try:
                self._batch()
            except _Stopped:
                continue
            except BaseException as error:  # whatever it is, threads wait for an answer
                told = str(error) if isinstance(error, InputError) else f"{type(error).__name__}: {error}"
                self._let_go(f"the GPU cannot be used or has failed ({told})")

    def _batch(self) -> None:
        """Simulate what waits, and what comes while it runs."""
        from graindamp.dem.gpu.batch import simulate_batch

        runs = simulate_batch(
            self._tasks(),
            stopping=lambda number: self._under_way[number].rule,
            refused=self._refuse,
            precision=self.precision,
            folder=self.folder,
            progress=lambda finished, work: self._check(),
        )
        for number, run in runs:
            self._check()
            self._under_way.pop(number).run.set_result(run)

    def _tasks(self) -> Iterator["Task | None"]:
        """Tasks in the order in which they were asked for; None while none waits, and the end when all are done."""
        number = 0
        while True:
            self._check()
            asked = None
            with suppress(IndexError):
                asked = self._waiting.popleft()
            if asked is not None:
                self._under_way[number] = asked
                number += 1
                yield asked.task
            elif self._under_way:
                yield None
            else:
                return

    def _refuse(self, number: int, error: InputError) -> None:
        self._under_way.pop(number).run.set_exception(error)

    def _check(self) -> None:
        if self._stopped:
            raise _Stopped

    def _let_go(self, reason: str) -> None:
        """Answer everybody who waits that there is no answer."""
        with self._changed:
            left = [*self._under_way.values(), *self._waiting]
            self._under_way.clear()
            self._waiting.clear()
        for asked in left:
            asked.run.set_exception(DeviceLost(reason))


_devices: dict[tuple[str, Path | None], Device] = {}
_ending: list[threading.Thread] = []
"""Of stopped devices, which may still be in their last launch."""
_lock = threading.Lock()


def _device_of(precision: str, folder: Path | None) -> Device:
    with _lock:
        if (precision, folder) not in _devices:
            _ending[:] = [thread for thread in _ending if thread.is_alive()]
            _devices[precision, folder] = Device(precision, folder, tuple(_ending))
        return _devices[precision, folder]
