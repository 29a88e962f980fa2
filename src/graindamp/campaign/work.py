"""What a worker does: one operating point, its bed packed once per machine."""

from collections.abc import Callable
from importlib.metadata import version
from typing import NamedTuple

from graindamp.campaign.backends import is_device
from graindamp.campaign.point import PHYSICS, PointResult, PointTask, measure
from graindamp.locks import alone

Measure = Callable[[PointTask, PointResult | None], PointResult]
"""How a point is measured; importable on the workers."""


class Tool(NamedTuple):
    """What a worker computes with."""

    version: str
    """Of graindamp."""
    physics: int
    """Of the engine."""


def work(task: str, start: PointResult | None, how: Measure) -> PointResult:
    """Result of a task given as text, so that it travels between processes and versions of pydantic alike.

    Raises:
        InputError: as :func:`graindamp.campaign.point.measure`.
    """
    return how(PointTask.load(task), start)


def measure_packed(task: PointTask, start: PointResult | None) -> PointResult:
    """Simulate a point by its back end; of the workers on a machine that need the same bed, one packs and the others
    wait for it; without locks it is packed twice, no more.

    Raises:
        InputError: as :func:`graindamp.campaign.point.measure`.
        DeviceLost: as :func:`graindamp.campaign.device.measure_on_device`.
    """
    from graindamp.dem.packing import PHYSICS as PACKING
    from graindamp.dem.packing import pack
    from graindamp.dem.packing_store import default_folder, packing_key
    from graindamp.dem.turned import turned

    folder = task.where
    key = packing_key(task.simulation.damper, PACKING, folder)[:32]
    with alone(default_folder() / f"{key}.lock"):
        packing = pack(task.simulation.damper, folder=folder)
        if task.start is None:
            turned(task.simulation.damper, packing, physics=PACKING, folder=folder)
    if not is_device(task.backend):
        return measure(task, start)
    from graindamp.campaign.device import measure_on_device

    return measure_on_device(task, start)


def tool() -> Tool:
    """What this process computes with."""
    return Tool(version("graindamp"), PHYSICS)
