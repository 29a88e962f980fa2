"""What is known while a campaign runs: counts, time left, and the state and value at every operating point."""

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Literal, NamedTuple

import numpy as np

from graindamp.campaign.point import PointResult, PointTask

State = Literal["queued", "running", "elsewhere", "done", "failed"]
"""Of a point; "elsewhere": run by another campaign on the same store."""


class PlaceView(NamedTuple):
    """One operating point, all its beds together."""

    frequency: float
    """[Hz]"""
    intensity: float
    """Gamma [-]."""
    state: State
    loss_factor: float
    """Mean eta of the beds that are done [-]; NaN if none is."""
    effective_mass_ratio: float
    """Mean m' [-]."""
    error: float
    """Largest standard error of eta and m' over max(eta, floor) [-]; NaN if unknown."""


class Outlook(NamedTuple):
    """A campaign at one moment."""

    stage: str
    """What is being run: "from rest", "from neighbours", "adaptive"."""
    places: tuple[PlaceView, ...]
    """Points that start from rest."""
    n_point: int
    """Runs known to be needed, all beds and starts [-]."""
    n_done: int
    n_running: int
    n_elsewhere: int
    n_failed: int
    seconds_left: float | None
    """Time left at the speed so far [s]; None if unknown."""
    worst_error: float
    """Largest of the errors of the places [-]; NaN if none is known."""
    clearance: float | None
    """Free travel of the bed [m], where it is known."""


def outlook_of(
    stage: str,
    tasks: Mapping[str, PointTask],
    results: Mapping[str, PointResult],
    states: Mapping[str, State],
    seconds_left: float | None,
) -> Outlook:
    """The state of a campaign.

    Args:
        stage: what is being run.
        tasks: all that are known to be needed, by key.
        results: of those that are done, by key.
        states: of the others, by key; queued where there is none.
        seconds_left: [s].
    """
    state: dict[str, State] = {key: "done" if key in results else states.get(key, "queued") for key in tasks}
    count = Counter(state.values())
    groups: dict[tuple[float, float], list[str]] = {}
    for key, task in tasks.items():
        if task.start is None:
            groups.setdefault((task.frequency, task.intensity), []).append(key)
    places = tuple(
        _view(place, [state[key] for key in group], [results.get(key) for key in group], tasks[group[0]].stop.floor)
        for place, group in groups.items()
    )
    errors = [place.error for place in places if np.isfinite(place.error)]
    clearances = [result.clearance for result in results.values() if np.isfinite(result.clearance)]
    return Outlook(
        stage=stage,
        places=places,
        n_point=len(tasks),
        n_done=count["done"],
        n_running=count["running"],
        n_elsewhere=count["elsewhere"],
        n_failed=count["failed"],
        seconds_left=seconds_left,
        worst_error=max(errors, default=float("nan")),
        clearance=clearances[0] if clearances else None,
    )


def _view(
    place: tuple[float, float], states: Sequence[str], results: Sequence[PointResult | None], floor: float
) -> PlaceView:
    known = [result for result in results if result is not None and not result.failed]
    order: tuple[State, ...] = ("failed", "running", "elsewhere", "queued")
    state: State = next((name for name in order if name in states), "done")
    if state == "done" and not known:
        state = "failed"
    nan = float("nan")
    if not known:
        return PlaceView(*place, state, nan, nan, nan)
    errors = [max(one.loss_factor_se, one.effective_mass_ratio_se) / max(abs(one.loss_factor), floor) for one in known]
    eta = float(np.mean([one.loss_factor for one in known]))
    return PlaceView(*place, state, eta, float(np.mean([one.effective_mass_ratio for one in known])), max(errors))
