"""Pictures of a simulated field beside its map: how the bed moves, and what dissipates."""

from pathlib import Path
from typing import NamedTuple

import numpy as np
import xarray as xr

from graindamp.errors import InputError
from graindamp.field.interpolate import Interpolant
from graindamp.field.schema import damper_of, places_of
from graindamp.report.figures import save


class Picture(NamedTuple):
    """A figure that was written."""

    name: str
    path: Path
    caption: str


def write_pictures(field: xr.Dataset, stem: Path, points: xr.Dataset | None = None) -> tuple[Picture, ...]:
    """Write `<stem>.modes.png` and `<stem>.losses.png`; nothing for points on a line or where nothing is known.

    Args:
        field: an effective field.
        stem: path of the pictures without their ends.
        points: what was simulated, where the field is a prediction from it.

    Raises:
        InputError: a file cannot be written.
    """
    from graindamp.report.mode_figures import loss_share_maps, mode_map, shares_of_field

    known = field if points is None else points
    pictures = []
    if "motion_mode" in known and _spans_an_area(field) and _spans_an_area(known):
        target = stem.with_name(f"{stem.name}.modes.png")
        told = "Loss factor, and how the bed moves; lines: constant stroke."
        pictures.append(Picture("modes", save(mode_map(field, points=points), target), told))
    shares = shares_of_field(known) if any(str(name).startswith("loss_share_") for name in known) else None
    if shares is not None:
        whole = np.isfinite(shares.share).all(axis=1)
        drawn = shares.share[whole]
        spread = min(np.unique(axis[whole]).size for axis in (shares.frequency, shares.intensity))
        if spread >= 2 and np.any(drawn > 0.0):
            target = stem.with_name(f"{stem.name}.losses.png")
            told = "Share of each mechanism in what is dissipated."
            maps = loss_share_maps(shares, damper_of(known).get("clearance"))
            pictures.append(Picture("losses", save(maps, target), told))
    return tuple(pictures)


def _spans_an_area(field: xr.Dataset) -> bool:
    """Whether the points of a field lie on no line, so that it can be drawn between them."""
    if any(np.unique(axis).size < 2 for axis in places_of(field)):
        return False
    try:
        Interpolant(field, "constant")
    except InputError:
        return False
    return True
