"""Workers as jobs of SLURM, through dask-jobqueue."""

import importlib.util
from collections.abc import Sequence
from typing import Any

from graindamp.campaign.executors import Dask, imported
from graindamp.errors import InputError

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
        InputError: dask-jobqueue is not installed, or an option is refused.
    """
    if importlib.util.find_spec("dask_jobqueue") is None:
        raise InputError("dask-jobqueue is not installed; pip install 'graindamp[slurm]'")
    dask, distributed = imported("dask"), imported("distributed")
    cores = int(options.get("cores", 1))
    told = {"memory": f"{2 * cores}GB", "walltime": "24:00:00"} | options | {"cores": cores, "processes": cores}
    kind = imported("dask_jobqueue").SLURMCluster if cluster_class is None else cluster_class
    try:
        with dask.config.set({"distributed.scheduler.allowed-failures": 0}):
            cluster = kind(**told)
            cluster.scale(n=n_worker)
            client = distributed.Client(cluster)
    except (ValueError, TypeError, OSError, RuntimeError) as error:
        raise InputError(f"--executor slurm: the jobs cannot be made ({error})") from None
    return Dask(client, f"SLURM, {n_worker} workers", n_worker, cluster)
