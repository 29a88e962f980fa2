"""Workers as jobs of SLURM, through dask-jobqueue."""

import importlib.util
import logging
import shutil
import time
from collections.abc import Sequence
from typing import Any

from graindamp.campaign.executors import ANY_PORT, Dask, imported
from graindamp.errors import InputError

FIRST_JOB = 30.0
"""Time in which the first job is taken or refused; a slower cluster is trusted [s]."""

OPTIONS: dict[str, type] = {
    "queue": str,
    "account": str,
    "walltime": str,
    "memory": str,
    "cores": int,
    "interface": str,
    "python": str,
    "log_directory": str,
    "local_directory": str,
    "shebang": str,
    "job_extra_directives": list,
    "job_script_prologue": list,
}
"""Options of jobs and their types; lists are split at semicolons. docs/campaigns.md has the table."""


def read_options(texts: Sequence[str]) -> dict[str, Any]:
    """Options typed as "name=value".

    Raises:
        InputError: not of this form, unknown, or not a number where one is needed.
    """
    options: dict[str, Any] = {}
    for text in texts:
        name, equals, value = text.partition("=")
        name = name.strip().replace("-", "_")
        if not equals or name not in OPTIONS:
            raise InputError(f"--slurm: given '{text}'; write name=value, with name one of {', '.join(OPTIONS)}")
        if OPTIONS[name] is int:
            if not value.strip().isdigit() or int(value) < 1:
                raise InputError(f"--slurm {name}: given '{value}'; a whole number above 0 is needed")
            options[name] = int(value)
        elif OPTIONS[name] is list:
            options[name] = [part.strip() for part in value.split(";") if part.strip()]
        else:
            options[name] = value.strip()
    return options


def slurm(n_worker: int, options: dict[str, Any], cluster_class: Any = None) -> Dask:
    """Workers in SLURM jobs, as many jobs as `n_worker` needs; each core of a job is a worker with one thread.

    Args:
        n_worker: points at a time.
        options: of the jobs, by the names of :data:`OPTIONS`.
        cluster_class: another class of dask-jobqueue in place of SLURMCluster.

    Raises:
        InputError: dask-jobqueue is not installed, there is no SLURM here, or an option or the first job is refused.
    """
    if importlib.util.find_spec("dask_jobqueue") is None:
        raise InputError("dask-jobqueue is not installed; pip install 'graindamp[slurm]'")
    if cluster_class is None and shutil.which("sbatch") is None:
        raise InputError("--executor slurm: there is no sbatch here; give the command on a login node of the cluster")
    dask, distributed = imported("dask"), imported("distributed")
    cores = int(options.get("cores", 1))
    told = {"memory": f"{2 * cores}GB", "walltime": "24:00:00"} | options | {"cores": cores, "processes": cores}
    told["scheduler_options"] = {"dashboard_address": ANY_PORT}
    kind = imported("dask_jobqueue").SLURMCluster if cluster_class is None else cluster_class
    try:
        with dask.config.set({"distributed.scheduler.allowed-failures": 0}):
            cluster = kind(**told)
            _submit_first(cluster, n_worker)
            client = distributed.Client(cluster)
    except (ValueError, TypeError, OSError, RuntimeError) as error:
        raise InputError(f"--executor slurm: the jobs cannot be made ({error})") from None
    return Dask(client, f"SLURM, {n_worker} workers", n_worker, cluster)


class _Refusals(logging.Handler):
    """Keeps the errors that submission, which runs in the background, can only log."""

    def __init__(self) -> None:
        super().__init__()
        self.errors: list[str] = []

    def emit(self, record: logging.LogRecord) -> None:
        if record.exc_info is not None:
            self.errors.append(" ".join(str(record.exc_info[1]).split()))


def _submit_first(cluster: Any, n_worker: int) -> None:
    """Ask for the workers, and from then on for others in the place of those whose jobs end."""
    log, refusals = logging.getLogger("tornado.application"), _Refusals()
    before = log.handlers, log.propagate
    log.handlers, log.propagate = [refusals], False
    try:
        cluster.scale(n=n_worker)
        until = time.monotonic() + FIRST_JOB
        while not refusals.errors and time.monotonic() < until:
            if any(getattr(job, "job_id", None) is not None for job in list(cluster.workers.values())):
                break
            time.sleep(0.05)
    finally:
        log.handlers, log.propagate = before
    if refusals.errors:
        for job in getattr(cluster, "_created", ()):  # Dask closes no cluster with jobs that were never begun
            job.status = imported("distributed").Status.failed
        cluster.close()
        raise RuntimeError(refusals.errors[0])
    cluster.adapt(minimum=n_worker, maximum=n_worker)
