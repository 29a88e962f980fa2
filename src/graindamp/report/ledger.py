"""The energy ledger of a simulated run: what the container put in, where it went, and what is left unexplained."""

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from graindamp.report.tables import Table
from graindamp.report.wording import plain

if TYPE_CHECKING:
    from graindamp.dem.run import Run

LOSSES = {
    "loss_normal": "impacts between particles",
    "loss_friction": "friction between particles",
    "loss_normal_wall": "impacts with walls",
    "loss_friction_wall": "friction with walls",
    "loss_rolling": "rolling resistance",
    "loss_lid": "foam of the lid",
}
"""Ways of losing energy in :class:`graindamp.dem.energy.Energies`, in words."""


class Ledger(NamedTuple):
    """Energies between two times [J]: work = losses + stored + closure."""

    start: float
    """First time [s], once the transient is over."""
    stop: float
    """Last time [s]."""
    n_cycle: float | None
    """Cycles between them [-]; None for a motion without cycles."""
    work: float
    """Done by the container on the particles."""
    losses: dict[str, float]
    """By name as in LOSSES."""
    stored: float
    """Gain of kinetic, potential and elastic energy."""
    closure: float
    """What does not add up: work less losses less gain."""

    @property
    def throughput(self) -> float:
        """Energy that went through the bed, what closure is measured against [J]."""
        return max(abs(self.work), sum(abs(loss) for loss in self.losses.values()), abs(self.stored))

    @property
    def closure_share(self) -> float:
        """Closure over throughput [-]; NaN where nothing happened."""
        return self.closure / self.throughput if self.throughput > 0.0 else float("nan")


def ledger_of(run: "Run", n_skipped: int = 0) -> Ledger | None:
    """Energies of a run after its transient; None with fewer than two records.

    Args:
        run: a simulated run.
        n_skipped: cycles to leave out at the start; fewer where the run is too short for that.
    """
    time = np.asarray(run.energy_time, dtype=np.float64)
    moving = np.flatnonzero(time >= -1e-12) if len(time) else np.empty(0, np.int64)
    if len(moving) < 2:
        return None
    first, last = int(moving[0]), len(time) - 1
    if run.frequency is not None:
        steady = np.flatnonzero(time >= time[first] + (n_skipped - 1e-6) / run.frequency)
        if len(steady) >= 2:
            first = int(steady[0])
        whole = np.flatnonzero(time <= time[first] + np.floor((time[-1] - time[first]) * run.frequency + 1e-6)
                               / run.frequency + 1e-12)  # fmt: skip
        last = int(whole[-1]) if whole[-1] > first else last
    begin, end = run.energy[first], run.energy[last]
    losses = {name: float(getattr(end, name) - getattr(begin, name)) for name in LOSSES}
    work, stored = float(end.work - begin.work), float(end.stored - begin.stored)
    n_cycle = None if run.frequency is None else float((time[last] - time[first]) * run.frequency)
    closure = work - sum(losses.values()) - stored
    return Ledger(float(time[first]), float(time[last]), n_cycle, work, losses, stored, closure)


def closure_series(run: "Run") -> NDArray[np.float64]:
    """Work less losses less gain of stored energy since the first record [J], at every record."""
    begin = run.energy[0]
    return np.array(
        [(now.work - begin.work) - (now.lost - begin.lost) - (now.stored - begin.stored) for now in run.energy]
    )


def ledger_table(ledger: Ledger) -> Table:
    """The ledger per cycle, or over the whole time where there are no cycles."""
    n = ledger.n_cycle or 1.0
    unit = "mJ per cycle" if ledger.n_cycle else "mJ"
    whole = ledger.throughput

    def row(name: str, value: float) -> tuple[str, str, str]:
        share = plain(100.0 * value / whole, 3) if whole > 0.0 else "–"
        return (name, plain(1e3 * value / n, 4), share)

    rows = [row("work of the container on the bed", ledger.work)]
    rows += [row(f"  {text}", ledger.losses[name]) for name, text in LOSSES.items() if ledger.losses[name] != 0.0]
    rows += [
        row("all losses", sum(ledger.losses.values())),
        row("gain of stored energy", ledger.stored),
        row("closure (work − losses − gain)", ledger.closure),
    ]
    span = f"{ledger.n_cycle:.4g} cycles" if ledger.n_cycle else f"{ledger.stop - ledger.start:.4g} s"
    note = f"Mean over {span} after the transient; share of the larger of work and losses."
    return Table("Energy ledger", ("energy", unit, "share [%]"), tuple(rows), note)
