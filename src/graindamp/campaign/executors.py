"""Who computes: this process, processes of this machine, or a Dask cluster, all in the shape of concurrent.futures."""

import importlib
import importlib.util
import logging
import math
import multiprocessing
import os
import signal
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor, ThreadPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager, suppress
from typing import Any, Protocol

from graindamp.campaign.work import Tool, tool
from graindamp.errors import InputError

KINDS = ("local", "processes", "serial", "dask", "slurm")
"""Names of executors."""
PATIENCE = 10.0
"""Seconds to wait for a scheduler to answer."""
COUNT_EVERY = 2.0
"""Seconds between counts of the workers of a cluster that may grow."""


class Executor(Protocol):
    """Runs functions and gives futures of the standard library."""

    name: str
    """What it is, in words."""

    @property
    def n_worker(self) -> int:
        """Functions that can run at the same time [-]."""

    def submit(self, function: Callable[..., Any], /, *arguments: Any) -> "Future[Any]":
        """Begin a call; what it returns or raises is in the future."""

    def deaths(self, error: BaseException) -> int:
        """Number of workers that an error says have died at their work; 0 if it says something else."""

    def shutdown(self, *, now: bool = False) -> None:
        """End it; `now` does not wait for what is running."""


class Serial:
    """Everything in this process, one call after another: for debugging."""

    name = "this process"
    n_worker = 1

    def submit(self, function: Callable[..., Any], /, *arguments: Any) -> "Future[Any]":
        """The call, made at once. Ctrl-C is passed on."""
        future: Future[Any] = Future()
        try:
            future.set_result(function(*arguments))
        except Exception as error:
            future.set_exception(error)
        return future

    def deaths(self, error: BaseException) -> int:
        """There is nobody to die."""
        return 0

    def shutdown(self, *, now: bool = False) -> None:
        """Nothing to end."""


class Processes:
    """Processes of this machine, from the standard library: a pool for each, so that a death takes one call with it."""

    def __init__(self, n_worker: int) -> None:
        """Prepare `n_worker` processes; each starts with its first call."""
        self.n_worker = n_worker
        self.name = f"{n_worker} processes"
        self._idle: list[ProcessPoolExecutor] = []
        self._busy: dict[Future[Any], ProcessPoolExecutor] = {}

    def submit(self, function: Callable[..., Any], /, *arguments: Any) -> "Future[Any]":
        """Begin a call in a process that has nothing to do."""
        for future in [future for future in self._busy if future.done()]:
            pool = self._busy.pop(future)
            if future.cancelled() or not isinstance(future.exception(), BrokenProcessPool):
                self._idle.append(pool)
            else:
                pool.shutdown(wait=False)
        pool = self._idle.pop() if self._idle else self._new()
        begun = pool.submit(function, *arguments)
        self._busy[begun] = pool
        return begun

    def deaths(self, error: BaseException) -> int:
        """A broken pool is one dead worker."""
        return int(isinstance(error, BrokenProcessPool))

    def shutdown(self, *, now: bool = False) -> None:
        """End the processes."""
        for pool in [*self._idle, *self._busy.values()]:
            processes = list((getattr(pool, "_processes", None) or {}).values())
            if now:
                for process in processes:
                    process.kill()
            pool.shutdown(wait=True, cancel_futures=True)
        self._idle, self._busy = [], {}

    def _new(self) -> ProcessPoolExecutor:
        return ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn"), initializer=_begin_process)


class Threads:
    """Threads of this process that share its GPU."""

    name = "the GPU of this process"

    def __init__(self, n_worker: int | None) -> None:
        """Prepare.

        Args:
            n_worker: calls at a time; None: as many as keep the GPU busy. It is not touched before somebody asks.
        """
        self._n_worker = n_worker
        self._pool: ThreadPoolExecutor | None = None

    @property
    def n_worker(self) -> int:
        """Functions that can run at the same time [-]."""
        if self._n_worker is None:
            from graindamp.campaign.device import points_at_once

            try:
                self._n_worker = points_at_once()
            except InputError as error:
                raise InputError(
                    f"points of a GPU are left: {error} with --backend cpu, which computes all points anew"
                ) from None
        return self._n_worker

    def submit(self, function: Callable[..., Any], /, *arguments: Any) -> "Future[Any]":
        """Begin a call in a thread."""
        if self._pool is None:
            self._pool = ThreadPoolExecutor(self.n_worker)
        return self._pool.submit(function, *arguments)

    def deaths(self, error: BaseException) -> int:
        """Nobody dies without this process."""
        return 0

    def shutdown(self, *, now: bool = False) -> None:
        """End the threads; `now`: what runs on the GPU is dropped after its launch."""
        from graindamp.campaign.device import stop_devices

        if now:
            stop_devices()
        if self._pool is not None:
            self._pool.shutdown(wait=not now, cancel_futures=True)
        stop_devices()


def _begin_process() -> None:
    """Leave Ctrl-C to the campaign, and end with it even if it is killed."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = multiprocessing.parent_process()

    assert parent is not None

    def follow() -> None:
        parent.join()
        os._exit(1)

    threading.Thread(target=follow, daemon=True).start()


class Dask:
    """A Dask cluster, of our own or of somebody else's."""

    def __init__(self, client: Any, name: str, n_worker: int | None, cluster: Any = None) -> None:
        """Use a client.

        Args:
            client: `distributed.Client`.
            name: what it is, in words.
            n_worker: calls at a time; None: as many as there are threads of workers at the moment.
            cluster: to be closed at the end, if it is ours.
        """
        self.name = name
        self._client, self._cluster, self._n_worker = client, cluster, n_worker
        self._executor = client.get_executor(pure=False)
        self._n_thread, self._counted = 1, -math.inf

    @property
    def n_worker(self) -> int:
        """Functions that can run at the same time [-]."""
        if self._n_worker is not None:
            return self._n_worker
        if time.monotonic() - self._counted > COUNT_EVERY:
            try:
                self._n_thread = max(1, sum(self._client.nthreads().values()))
            except Exception as error:  # of many kinds, all meaning that nobody answers
                raise InputError(f"{self.name} is gone ({error}); what was done is kept") from None
            self._counted = time.monotonic()
        return self._n_thread

    def submit(self, function: Callable[..., Any], /, *arguments: Any) -> "Future[Any]":
        """Begin a call on some worker."""
        future: Future[Any] = self._executor.submit(function, *arguments)
        return future

    def deaths(self, error: BaseException) -> int:
        """Dask gives up when a number of workers have died at the same call."""
        if not isinstance(error, imported("distributed.scheduler").KilledWorker):
            return 0
        return 1 + int(error.args[2])  # one more than it allows

    def shutdown(self, *, now: bool = False) -> None:
        """Cancel what is left; close the cluster if it is ours."""
        with suppress(Exception):  # whatever a scheduler that is gone answers
            self._executor.shutdown(wait=False)
        if now and self._cluster is not None:
            _kill_workers(self._cluster)
        with suppress(Exception):
            self._client.close(timeout=2 if now else 10)
        if self._cluster is not None:
            with suppress(Exception):
                self._cluster.close(timeout=2 if now else 10)


def executor_of(
    kind: str,
    *,
    n_worker: int | None = None,
    address: str | None = None,
    options: dict[str, Any] | None = None,
    on_device: bool = False,
) -> Executor:
    """Executor by name.

    Args:
        kind: "local" (Dask on this machine, or "processes" where Dask is not installed), "processes", "serial",
            "dask" (the scheduler at `address`), "slurm".
        n_worker: calls at a time; None: the cores of this machine, all of the cluster, or one SLURM job.
        address: of the scheduler, such as "tcp://host:8786".
        options: of the SLURM jobs, see :mod:`graindamp.campaign.slurm`.
        on_device: for points of a GPU: "local" are then threads that share the GPU of this process, and the workers
            of "dask" must have one each.

    Raises:
        InputError: unknown, not installed, nobody answers at the address, or not made for GPUs.
    """
    if on_device and kind == "local":
        return Threads(n_worker)
    if on_device and kind in ("processes", "slurm"):
        raise InputError(
            f"the executor '{kind}' knows no GPUs; take 'local' for the one of this machine, or 'dask' with a worker "
            "for each"
        )
    if kind == "serial":
        return Serial()
    if kind == "processes" or (kind == "local" and not _has_dask()):
        return Processes(n_worker or _cores())
    if kind == "local":
        return _local(n_worker or _cores())
    if kind == "dask":
        if address is None:
            raise InputError("the executor 'dask' needs the address of a scheduler, such as tcp://host:8786")
        return _remote(address, n_worker, on_device)
    if kind == "slurm":
        from graindamp.campaign.slurm import slurm

        return slurm(n_worker or 1, options or {})
    raise InputError(f"executor: given '{kind}'; allowed are {', '.join(KINDS)}")


def _cores() -> int:
    """Cores that this process may use [-]."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _has_dask() -> bool:
    return importlib.util.find_spec("distributed") is not None


def imported(name: str) -> Any:
    """A module that may not be installed and tells no types."""
    return importlib.import_module(name)


def _need_dask() -> None:
    if not _has_dask():
        raise InputError("Dask is not installed; pip install 'graindamp[cluster]', or take the executor 'processes'")


ANY_PORT = "127.0.0.1:0"
"""Where a scheduler shows how it is: with a fixed port a machine's second campaign would be warned that it is taken."""


def _local(n_worker: int) -> Dask:
    dask, distributed = imported("dask"), imported("distributed")
    # A death is counted here, not by Dask; and no memory is watched, as a point needs a few megabytes.
    with dask.config.set({"distributed.scheduler.allowed-failures": 0}), _interrupts_off():
        cluster = distributed.LocalCluster(
            n_workers=n_worker, threads_per_worker=1, processes=True, memory_limit=None,
            dashboard_address=ANY_PORT, silence_logs=logging.CRITICAL,
        )  # fmt: skip
        client = distributed.Client(cluster)
    return Dask(client, f"{n_worker} local workers", n_worker, cluster)


def _remote(address: str, n_worker: int | None, on_device: bool) -> Dask:
    _need_dask()
    try:
        client = imported("distributed").Client(address, timeout=PATIENCE)
    except (OSError, ValueError) as error:
        raise InputError(f"--scheduler {address}: nobody answers there ({error})") from None
    _check_workers(client, address)
    if on_device:
        _check_devices(client, address)
    return Dask(client, f"the scheduler at {address}", n_worker)


def _check_workers(client: Any, address: str) -> None:
    """Refuse workers that compute with another engine."""
    try:
        tools: dict[str, Tool] = client.run(tool)
    except Exception as error:
        client.close()
        raise InputError(f"{address}: graindamp cannot be used on the workers ({error}); install it there") from None
    for worker, found in tools.items():
        if found != tool():
            client.close()
            raise InputError(
                f"{address}: the worker {worker} has graindamp {found[0]} with physics {found[1]}, here is {tool()[0]} "
                f"with {tool()[1]}; install the same everywhere"
            )


def _check_devices(client: Any, address: str) -> None:
    """Refuse workers without a GPU."""
    from graindamp.campaign.device import missing

    lacking = {worker: reason for worker, reason in client.run(missing).items() if reason}
    if lacking:
        client.close()
        worker, reason = next(iter(lacking.items()))
        raise InputError(f"{address}: {len(lacking)} workers cannot compute on a GPU; {worker}: {reason}")


@contextmanager
def _interrupts_off() -> Iterator[None]:
    """Processes started in here ignore Ctrl-C, which a terminal sends to them as well; it is for the campaign alone."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


def _kill_workers(cluster: Any) -> None:
    """End worker processes of this machine at once; they would finish their point first."""
    for nanny in list(getattr(cluster, "workers", {}).values()):
        process = getattr(nanny, "process", None)
        pid = getattr(process, "pid", None)
        if pid:
            nanny.auto_restart = False
            with suppress(OSError):
                os.kill(pid, getattr(signal, "SIGKILL", signal.SIGTERM))
