"""What a campaign gives: files of its field, a document, and what to say of failures and of softened contacts."""

from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from graindamp.campaign.run import FieldRun
from graindamp.campaign.store import Store
from graindamp.errors import InputError
from graindamp.field.remarks import remarks_on
from graindamp.field.store import SUFFIXES, write_field
from graindamp.report.document import bed_document, softening_document
from graindamp.status import FATAL, REMEDY, Status

if TYPE_CHECKING:
    from graindamp.field.adaptive import Verdict

SHOWN = 10
"""Failed points that are listed; the others are counted."""


def write_run(run: FieldRun, target: Path) -> Path | None:
    """Write the field, and of an adaptive plan the points it was made from; their file, or None.

    Raises:
        InputError: a file cannot be written.
    """
    _write(run.field, target)
    points = points_beside(target)
    if run.points is run.field:
        with suppress(OSError):
            points.unlink(missing_ok=True)  # of a field that had this name before
        return None
    _write(run.points, points)
    return points


def points_beside(field: Path) -> Path:
    """File of the points that a field of an adaptive plan was made from."""
    return field.with_name(f"{field.stem}.points{field.suffix}")


def check_suffix(target: Path) -> None:
    """Pass a name that a field can be written under; else an InputError."""
    if target.suffix not in SUFFIXES:
        raise InputError(f"--output: given '{target}'; a field file ends in {' or '.join(SUFFIXES)}")


def run_document(run: FieldRun, target: Path, store: Store) -> dict[str, Any]:
    """Where the field is, what it took, what failed, and what softening did to it."""
    usable = np.isfinite(run.points["loss_factor"].to_numpy())
    return {
        "field": str(target),
        "store": str(store.folder),
        "places": int(usable.size),
        "usable": int(usable.sum()),
        "runs": run.n_point,
        "computed": run.n_computed,
        "backend": run.points.attrs["backend"],
        "precision": run.points.attrs["precision"],
        "softening": softening_document(run.points),
        "beds": bed_document(run.points),
        "particle_steps": float(run.points["particle_steps"].sum()),
        "accuracy": None if run.verdict is None else run.verdict._asdict(),
        "status": _counts(run.points),
        "failed": list(run.failures),
        "lost": list(run.lost),
        "warnings": list(run.warnings),
    }


def warnings_of(run: FieldRun, store: Path) -> list[str]:
    """All that a user is told of a field beside where it is: of the store, of softened contacts, of accuracy, of runs
    without a value and failures."""
    told = [*run.warnings, *remarks_on(run.points), *_statuses(run.points), *_shortfall(run)]
    told += _listed("no value", run.lost)
    if run.failures:
        retry = f"'graindamp campaign retry {store}' queues them again; then give the same command"
        told += [*_listed("failed", run.failures), retry]
    return told


def _listed(what: str, lines: tuple[str, ...]) -> list[str]:
    more = [f"{what}: and {len(lines) - SHOWN} more"] if len(lines) > SHOWN else []
    return [*(f"{what}: {line}" for line in lines[:SHOWN]), *more]


def _counts(points: xr.Dataset) -> dict[str, int]:
    """Number of operating points by the bits of their status."""
    status = points["status"].to_numpy()
    counts = {str(bit.name): int(np.count_nonzero(status & int(bit))) for bit in Status if bit}
    return {name: count for name, count in counts.items() if count}


def _statuses(points: xr.Dataset) -> list[str]:
    """What points with a value have to be told of."""
    n, counts = points["status"].size, _counts(points)
    bits = [Status[name] for name in counts if not Status[name] & FATAL]
    return [f"{counts[str(bit.name)]} of {n} points {bit.name}: {REMEDY[bit]}" for bit in bits]


def _shortfall(run: FieldRun) -> list[str]:
    """How far an adaptive plan that came to its limits, or is not done, is from the accuracy that was asked for."""
    verdict = run.verdict
    if verdict is None or verdict.is_accurate:
        return []
    if not run.is_ended:
        return [f"so far {accuracy_text(verdict)}"]
    more = "raise its limit of points, cost or time to go on"
    return [f"the plan ended before its accuracy was reached: {accuracy_text(verdict)}; {more}"]


def accuracy_text(verdict: "Verdict") -> str:
    """How accurate the field of an adaptive plan is, as a clause."""
    return (
        f"errors are predicted within what was asked over {100 * verdict.share:.0f} % of the range, and "
        f"{verdict.worst_ratio:.2g} times as much at most, at {verdict.frequency:.4g} Hz, {verdict.intensity:.3g}"
    )


def _write(field: xr.Dataset, target: Path) -> None:
    """Write a field under a name that appears when all of it is there."""
    draft = target.with_name(f".{target.stem}.part{target.suffix}")
    try:
        target.parent.mkdir(parents=True, exist_ok=True)
        write_field(field, draft)
        draft.replace(target)
    except OSError as error:
        raise InputError(f"{target}: cannot be written ({error.strerror or error})") from None
    finally:
        with suppress(OSError):
            draft.unlink(missing_ok=True)
