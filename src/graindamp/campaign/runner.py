"""The loop of a campaign: claim points, have them computed, keep their results, take care of what goes wrong."""

import time
from collections.abc import Callable, Collection, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait
from typing import Any, NamedTuple

import numpy as np

from graindamp.campaign.backends import DeviceLost
from graindamp.campaign.executors import Executor
from graindamp.campaign.outlook import Outlook, State, outlook_of
from graindamp.campaign.point import PointResult, PointTask
from graindamp.campaign.store import Store
from graindamp.campaign.work import Measure, work
from graindamp.errors import InputError

MOST_TRIES = 3
"""Workers that may die at a point before it is given up."""
POLL = 0.5
"""Seconds between looks at what other campaigns have done."""

Watch = Callable[[Outlook], None]


class Failure(NamedTuple):
    """A point without a result."""

    task: PointTask
    reason: str


class Runner:
    """Runs tasks with the results in a store.

    Attributes:
        results: of all that is done, by key, without the arrays of their ends.
        failures: of all that has failed, by key.
        n_computed: points computed by this campaign [-].
        stage: what is being run, in words, for the progress.
    """

    def __init__(self, store: Store, executor: Executor, how: Measure, watch: Watch | None = None) -> None:
        """Prepare; nothing runs yet.

        Args:
            store: where results are and go.
            executor: who computes.
            how: how a point is measured; importable where the workers are.
            watch: told what is known, at most every half second.
        """
        self.store, self.executor, self.how = store, executor, how
        self.results: dict[str, PointResult] = {}
        self.failures: dict[str, Failure] = {}
        self.n_computed = 0
        self.stage = "from rest"
        self._watch = watch
        self._tasks: dict[str, PointTask] = {}
        self._todo: dict[str, PointTask] = {}
        self._running: dict[Future[Any], str] = {}
        self._elsewhere: set[str] = set()
        self._begun: float | None = None
        self._cost_done = 0.0
        self._told = self._looked = -np.inf

    @property
    def keys(self) -> set[str]:
        """Of all tasks entered so far."""
        return set(self._tasks)

    @property
    def n_point(self) -> int:
        """Tasks entered so far [-]."""
        return len(self._tasks)

    def run(self, tasks: Sequence[PointTask]) -> dict[str, PointResult]:
        """Results of tasks by key, without those that fail; returns when each is done or failed.

        Raises:
            InputError: the store cannot be written, or the workers are gone.
            KeyboardInterrupt: Ctrl-C; whatever was running is queued again when the store is closed.
        """
        self.begin(tasks)
        keys = [task.key for task in tasks]
        self.finish(keys)
        return {key: self.results[key] for key in keys if key in self.results}

    def begin(self, tasks: Sequence[PointTask]) -> None:
        """Enter tasks; those that are in the store already are done at once."""
        new = {task.key: task for task in tasks}
        new = {key: task for key, task in new.items() if key not in self._tasks}
        self.store.add(new.values())
        self._tasks |= new
        self._todo |= new
        self._todo = dict(sorted(self._todo.items(), key=lambda item: -_cost(item[1])))  # stable: the long ones first
        self._look()
        self._start_more()

    def finish(self, keys: Collection[str]) -> None:
        """Return when each of the keys is done or failed; errors as of :meth:`run`."""
        while any(key not in self.results and key not in self.failures for key in keys):
            self._start_more()
            self._tell()
            if self._running:
                done, _ = wait(self._running, timeout=POLL, return_when=FIRST_COMPLETED)
                for future in done:
                    self._take(self._running.pop(future), future)
            elif self._todo:
                time.sleep(POLL)
            if time.monotonic() - self._looked > POLL:
                self._look()
        self._tell(now=True)

    def _look(self) -> None:
        """Take over what the store knows of the points that are left."""
        entries = self.store.entries()
        self._looked = time.monotonic()
        self._elsewhere.clear()
        for key in list(self._todo):
            entry = entries.get(key)
            if entry is None:
                self.store.add([self._todo[key]])
            elif entry.state == "done":
                result = self.store.load(key)
                if result is not None:
                    self._keep(key, result)
            elif entry.state == "failed":
                self._give_up(key, entry.reason)
            elif not self.store.is_free(entry):
                self._elsewhere.add(key)

    def _start_more(self) -> None:
        """Give every idle worker a point."""
        for key in list(self._todo):
            if len(self._running) >= self.executor.n_worker:
                return
            task = self._todo.get(key)
            if task is None or key in self._elsewhere or task.start in self._todo:
                continue  # where its start is computed again, it comes after that
            if task.start is not None and task.start in self._running.values():
                continue
            if task.start is not None and task.start in self.failures:
                self._give_up(key, f"the run that it starts from failed: {self.failures[task.start].reason}")
                continue
            if not self.store.claim(key):
                self._elsewhere.add(key)  # what it is there, the next look tells
                continue
            start = None
            if task.start is not None:
                start = self.store.load(task.start)
                if start is None:
                    self._start_is_gone(key, task.start)
                    continue
            del self._todo[key]
            self._begin_one(key, task, start)

    def _begin_one(self, key: str, task: PointTask, start: PointResult | None) -> None:
        if self._begun is None:
            self._begun = time.monotonic()
        placeholder: Future[Any] = Future()
        self._running[placeholder] = key
        self._tell()  # before the call: an executor of this process computes in it
        del self._running[placeholder]
        try:
            future = self.executor.submit(work, task.dump(), start, self.how)
        except RuntimeError as error:
            raise InputError(
                f"{self.executor.name}: takes no more work ({error}); give the same command again"
            ) from None
        self._running[future] = key

    def _start_is_gone(self, key: str, start: str) -> None:
        """Compute a result again whose file was damaged and from whose end another point starts."""
        self.store.again(key)
        self.results.pop(start, None)
        self._todo = {start: self._tasks[start]} | self._todo

    def _take(self, key: str, future: "Future[Any]") -> None:
        """Keep what a worker has returned."""
        task = self._tasks[key]
        if future.cancelled():
            raise InputError(f"{self.executor.name}: is gone; what was done is kept, give the same command again")
        error = future.exception()
        if error is None:
            self.store.finish(task, future.result())
            self.n_computed += 1
            self._cost_done += _cost(task)
            self._keep(key, future.result())
            return
        if isinstance(error, ImportError):  # no fault of the point: every other one would fail with it
            raise InputError(f"{self.executor.name}: graindamp cannot be loaded there ({error}); mend that and go on")
        if isinstance(error, DeviceLost):
            raise InputError(f"{self.executor.name}: {error}; what was done is kept, mend that and go on")
        deaths = 1 if isinstance(error, KeyboardInterrupt) else self.executor.deaths(error)
        if not deaths:
            reason = str(error) if isinstance(error, InputError) else f"{type(error).__name__}: {error}"
            self.store.fail(key, reason)
            self._give_up(key, reason)
            return
        tries = self.store.again(key, "worker died", attempts=deaths)
        if tries < MOST_TRIES:
            self._todo = {key: task} | self._todo
            return
        reason = f"worker died, {tries} times"
        self.store.fail(key, reason, attempts=0)
        self._give_up(key, reason)

    def _keep(self, key: str, result: PointResult) -> None:
        nothing = np.empty((0, 3))
        self.results[key] = result._replace(end_position=nothing, end_velocity=nothing, end_spin=nothing)
        self._todo.pop(key, None)

    def _give_up(self, key: str, reason: str) -> None:
        self.failures[key] = Failure(self._tasks[key], reason)
        self._todo.pop(key, None)

    def _tell(self, now: bool = False) -> None:
        if self._watch is None or (not now and time.monotonic() - self._told < POLL):
            return
        self._watch(self.outlook())
        self._told = time.monotonic()

    def outlook(self) -> Outlook:
        """What is known now."""
        states: dict[str, State] = dict.fromkeys(self._running.values(), "running")
        states |= dict.fromkeys(self._elsewhere & self._todo.keys(), "elsewhere")
        states |= dict.fromkeys(self.failures, "failed")
        return outlook_of(self.stage, self._tasks, self.results, states, self._seconds_left())

    def _seconds_left(self) -> float | None:
        """From the cost of what is left, at the speed so far [s]; half of what is running counts as done."""
        if self._begun is None or self._cost_done == 0.0:
            return None
        running = sum(_cost(self._tasks[key]) for key in self._running.values())
        left = sum(_cost(task) for task in self._todo.values()) + 0.5 * running
        speed = (self._cost_done + 0.5 * running) / (time.monotonic() - self._begun)
        return left / speed


def _cost(task: PointTask) -> float:
    """Particle-steps of a cycle up to a factor: the time step of a damper is about the same at all points."""
    return 1.0 / task.frequency


def reasons(failures: Mapping[str, Failure]) -> list[str]:
    """Failed points in words."""
    return [
        f"{task.frequency:g} Hz, {task.intensity:g}, bed {task.seed}: {reason}" for task, reason in failures.values()
    ]
