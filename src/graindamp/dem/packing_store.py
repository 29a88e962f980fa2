"""Packings kept on disk, so that a bed is packed once and then used by every run of the damper."""

import hashlib
import json
import math
import os
import tempfile
import warnings
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from graindamp.errors import InputError
from graindamp.spec.container import MeshContainer
from graindamp.spec.simulation import DamperSpec

Real = NDArray[np.float64]
Progress = Callable[[str, float, float | None], None]
"""Told the stage, the fraction of it done and the seconds it has left, None where they are not known."""

FOAM_AFTERWARDS = ("coefficients", "pressure", "loss_factor")
"""What a foam lid does only after the bed is packed."""


class Packing(NamedTuple):
    """A bed at rest in its container, in the container's frame, under gravity along the direction of pouring."""

    position: Real
    """Centres [m]; (particle, 3)."""
    radius: Real
    """Radii [m]; (particle,)."""
    component: NDArray[np.int32]
    """Number of the component in damper.particles; (particle,)."""
    height: float
    """Of the bed as a block [m]: the level up to which the container's free volume, filled evenly, has the bed's centre
    of volume; twice the height of that centre in a straight container without inserts."""
    poured_height: float
    """The same before the bed was shaken [m]; under softened contacts, about 0.4 % low, unless the lid is set by it."""
    top: float
    """Mean level of the tops of the highest hundredth of the particles [m]."""
    solid_fraction: float
    """Volume of the particles over the free volume below `height` [-]; NaN where no walls stand round the bed."""
    lid_height: float | None
    """Distance of the lid from the floor [m]; with foam, of the stiff lid behind it; None without."""
    clearance: float | None
    """Free travel of the bed, lid_height - height [m]; None without a rigid lid."""
    tap_cycles: int
    """Cycles that the bed was shaken for [-]."""
    seconds: float
    """Time that packing took [s]."""


def packing_key(damper: DamperSpec, physics: int, folder: Path | None) -> str:
    """Hash of everything that a packing depends on.

    The damper's name, gravity of the run and the forces of foam do not count; of a mesh the content of its file does.
    """
    told: dict[str, Any] = damper.model_dump(mode="json", exclude={"name", "gravity"})
    if told["lid"] is not None:
        told["lid"] = {key: value for key, value in told["lid"].items() if key not in FOAM_AFTERWARDS}
    told["physics"] = physics
    if isinstance(damper.container, MeshContainer):
        path = Path(damper.container.file) if folder is None else folder / damper.container.file
        del told["container"]["file"]
        if path.is_file():
            told["mesh"] = hashlib.sha256(path.read_bytes()).hexdigest()
    return hashlib.sha256(json.dumps(told, sort_keys=True).encode()).hexdigest()


def default_folder() -> Path:
    """Folder of packings in the user's cache."""
    home = os.environ.get("GRAINDAMP_CACHE") or os.environ.get("XDG_CACHE_HOME") or "~/.cache"
    return Path(home).expanduser() / "graindamp" / "packings"


def kept(path: Path, make: Callable[[], Packing], verb: str) -> Packing:
    """The packing that a file keeps, or one made now and kept there; damage and a full disk are warnings.

    Args:
        path: the file.
        make: makes the packing.
        verb: what is done again where the file is damaged, in the past tense.
    """
    try:
        return load(path)
    except FileNotFoundError:
        pass
    except InputError as error:
        warnings.warn(f"{error}; {verb} again", stacklevel=3)
    packing = make()
    try:
        save(path, packing)
    except OSError as error:
        warnings.warn(
            f"{path}: the {verb} bed could not be stored ({error.strerror}) and will be made again", stacklevel=3
        )
    return packing


def save(path: Path, packing: Packing) -> None:
    """Write a packing to an .npz file, whole or not at all.

    Raises:
        OSError: the file cannot be written.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    values: dict[str, Any] = {
        name: np.asarray(math.nan if value is None else value) for name, value in packing._asdict().items()
    }
    handle, draft = tempfile.mkstemp(dir=path.parent, prefix=path.stem, suffix=".part")
    try:
        with os.fdopen(handle, "wb") as file:
            np.savez(file, **values)
        os.replace(draft, path)
    except BaseException:
        Path(draft).unlink(missing_ok=True)
        raise


def load(path: Path) -> Packing:
    """Packing from a file written by :func:`save`.

    Raises:
        FileNotFoundError: there is no such file.
        InputError: the file cannot be read, or does not hold a packing.
    """
    try:
        with open(path, "rb") as opened, np.load(opened, allow_pickle=False) as file:
            values = {name: file[name] for name in Packing._fields}
    except FileNotFoundError:
        raise
    except (OSError, ValueError, KeyError, EOFError, zipfile.BadZipFile) as error:
        raise InputError(f"{path}: not a packing, or damaged ({error}); remove the file to pack again") from None
    position = np.ascontiguousarray(values["position"], np.float64)
    radius = np.ascontiguousarray(values["radius"], np.float64)
    component = np.ascontiguousarray(values["component"], np.int32)
    n = len(radius)
    if position.shape != (n, 3) or component.shape != (n,) or not np.isfinite(position).all() or not (radius > 0).all():
        raise InputError(f"{path}: not a packing, or damaged (arrays do not fit); remove the file to pack again")

    def number(name: str) -> float:
        return float(values[name])

    def number_or_none(name: str) -> float | None:
        return None if math.isnan(number(name)) else number(name)

    return Packing(
        position=position,
        radius=radius,
        component=component,
        height=number("height"),
        poured_height=number("poured_height"),
        top=number("top"),
        solid_fraction=number("solid_fraction"),
        lid_height=number_or_none("lid_height"),
        clearance=number_or_none("clearance"),
        tap_cycles=int(values["tap_cycles"]),
        seconds=number("seconds"),
    )
