"""What an effective field is: one table of variables, checked on every write and read.

A field is an xarray Dataset. On a grid its variables have the dimensions (frequency, intensity); scattered points have
one dimension, point, with frequency and intensity as coordinates along it.
"""

import json
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray

from graindamp.errors import InputError
from graindamp.signals.motion_modes import MotionMode
from graindamp.status import FATAL, Status
from graindamp.units import STANDARD_GRAVITY

SCHEMA_VERSION = 1
GRID = ("frequency", "intensity")
SCATTERED = ("point",)


class Variable(NamedTuple):
    """One row of the table."""

    units: str
    long_name: str
    is_required: bool
    kind: str = "float"


TABLE: dict[str, Variable] = {
    "frequency": Variable("Hz", "driving frequency f", True),
    "intensity": Variable("1", "excitation intensity, acceleration amplitude over 9.80665 m/s^2, Gamma", True),
    "loss_factor": Variable("1", "loss factor eta, dissipated energy per radian over m_bed V^2 / 2", True),
    "effective_mass_ratio": Variable("1", "in-phase effective mass over bed mass, m'", True),
    "loss_factor_se": Variable("1", "standard error of the loss factor, NaN where unknown", True),
    "effective_mass_ratio_se": Variable("1", "standard error of the effective mass ratio, NaN where unknown", True),
    "dissipated_energy": Variable("J", "dissipated energy per cycle", True),
    "power": Variable("W", "mean dissipated power", True),
    "n_cycles": Variable("1", "cycles averaged, 0 where that has no meaning", True, "int"),
    "status": Variable("1", "status bits, 0 is good", True, "int"),
    "measured_intensity": Variable("1", "intensity actually reached at each point", False),
    "effective_mass_modulus_ratio": Variable("1", "modulus of M_eff - m_container over bed mass", False),
    "loss_factor_other": Variable("1", "loss factor of a bistable point's second answer, NaN elsewhere", False),
    "effective_mass_ratio_other": Variable("1", "effective mass ratio of the second answer, NaN elsewhere", False),
    "loss_factor_other_se": Variable("1", "standard error of the second answer's loss factor", False),
    "effective_mass_ratio_other_se": Variable("1", "standard error of the second answer's mass ratio", False),
    "n_beds": Variable("1", "beds that the value is the mean of", False, "int"),
    "n_beds_other": Variable("1", "beds that the second answer is the mean of, 0 where there is none", False, "int"),
    "solid_fraction": Variable("1", "solid fraction of the packed bed", False),
    "motion_mode": Variable("1", "motion mode, -1 where it is unknown", False, "int"),
    "loss_share_normal": Variable("1", "share of normal damping between particles in all that is dissipated", False),
    "loss_share_friction": Variable("1", "share of friction between particles in all that is dissipated", False),
    "loss_share_normal_wall": Variable("1", "share of normal damping at walls in all that is dissipated", False),
    "loss_share_friction_wall": Variable("1", "share of friction at walls in all that is dissipated", False),
    "loss_share_lid": Variable("1", "share of foam in all that is dissipated", False),
    "loss_share_rolling": Variable("1", "share of rolling resistance in all that is dissipated", False),
    "particle_steps": Variable("1", "particles times time steps that the point cost", False),
}
COORDINATES = ("frequency", "intensity")


def make_field(
    frequency: ArrayLike,
    intensity: ArrayLike,
    loss_factor: ArrayLike,
    effective_mass_ratio: ArrayLike,
    bed_mass: float,
    *,
    source: str,
    scattered: bool = False,
    variables: Mapping[str, ArrayLike] | None = None,
    damper: Mapping[str, Any] | None = None,
) -> xr.Dataset:
    """Effective field from values, everything that follows from them filled in.

    Args:
        frequency: [Hz], shape (frequency,), or (point,) if `scattered`.
        intensity: [-], shape (intensity,), or (point,).
        loss_factor: eta [-], shape (frequency, intensity), or (point,); NaN where the point failed.
        effective_mass_ratio: m' [-], likewise.
        bed_mass: mass of all particles [kg].
        source: where the values come from, in words.
        scattered: points instead of a grid.
        variables: further rows of the table, by name, shaped likewise; standard errors default to unknown (NaN).
        damper: description of the damper, kept as JSON.

    Raises:
        InputError: whatever :func:`check` objects to.
    """
    f, gamma = np.asarray(frequency, float), np.asarray(intensity, float)
    eta, mass = np.asarray(loss_factor, float), np.asarray(effective_mass_ratio, float)
    shape = f.shape if scattered else (len(f), len(gamma))
    dims = SCATTERED if scattered else GRID
    f_full, gamma_full = (f, gamma) if scattered else np.meshgrid(f, gamma, indexing="ij")
    velocity = gamma_full * STANDARD_GRAVITY / (2 * np.pi * f_full)
    failed = ~(np.isfinite(eta) & np.isfinite(mass)) if eta.shape == mass.shape == shape else np.zeros(shape, bool)
    energy = np.pi * eta * bed_mass * velocity**2 if eta.shape == shape else np.full(shape, np.nan)
    values: dict[str, ArrayLike] = {
        "loss_factor": eta,
        "effective_mass_ratio": mass,
        "loss_factor_se": np.full(shape, np.nan),
        "effective_mass_ratio_se": np.full(shape, np.nan),
        "dissipated_energy": energy,
        "power": energy * f_full,
        "n_cycles": np.zeros(shape, np.int64),
        "status": np.where(failed, int(Status.NO_SOLUTION), 0).astype(np.int64),
    }
    values |= dict(variables or {})
    dataset = xr.Dataset(
        {
            name: (dims, _shaped(name, value, shape), {"units": TABLE[name].units, "long_name": TABLE[name].long_name})
            for name, value in values.items()
        },
        coords={
            name: (
                SCATTERED if scattered else name,
                value,
                {"units": TABLE[name].units, "long_name": TABLE[name].long_name},
            )
            for name, value in (("frequency", f), ("intensity", gamma))
        },
        attrs={
            "title": "effective field of a particle damper",
            "schema_version": SCHEMA_VERSION,
            "bed_mass": float(bed_mass),
            "damper": json.dumps(dict(damper or {}), sort_keys=True),
            "source": source,
        },
    )
    check(dataset)
    return dataset


def _shaped(name: str, value: ArrayLike, shape: tuple[int, ...]) -> NDArray[Any]:
    array = np.asarray(value, np.int64 if TABLE[name].kind == "int" else float)
    if array.shape != shape:
        raise InputError(f"field: {name} has shape {array.shape}, frequency and intensity ask for {shape}")
    return array


def is_grid(field: xr.Dataset) -> bool:
    """True for values on a grid, False for scattered points."""
    return tuple(field["loss_factor"].dims) == GRID


def places_of(field: xr.Dataset) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Frequency [Hz] and intensity [-] of every operating point, both shaped like the variables of the field."""
    axes = field["frequency"], field["intensity"]
    f, gamma = xr.broadcast(*axes) if is_grid(field) else axes
    return f.to_numpy(), gamma.to_numpy()


def damper_of(field: xr.Dataset) -> dict[str, Any]:
    """Description of the damper a field belongs to; empty if none was kept."""
    description: dict[str, Any] = json.loads(field.attrs.get("damper", "{}"))
    return description


def is_asked_for(field: xr.Dataset, name: str) -> bool:
    """Whether the description that a field keeps, if it keeps one, has a table of this name."""
    try:
        return json.loads(field.attrs.get("spec", "{}")).get(name) is not None
    except (AttributeError, TypeError, ValueError):
        return False


def check(field: xr.Dataset, where: str = "field") -> None:
    """Pass a valid effective field in silence.

    Raises:
        InputError: naming the variable, what it holds, and what is allowed; `where` opens the message.
    """
    missing = [name for name, row in TABLE.items() if row.is_required and name not in field.variables]
    if missing:
        raise InputError(f"{where}: no {', '.join(missing)}; an effective field holds {', '.join(TABLE)}")
    dims = tuple(field["loss_factor"].dims)
    if dims not in (GRID, SCATTERED):
        raise InputError(f"{where}: loss_factor has dimensions {dims}, allowed are {GRID} or {SCATTERED}")
    for name in field.data_vars:
        if name in TABLE and tuple(field[name].dims) != dims:
            raise InputError(f"{where}: {name} has dimensions {field[name].dims}, loss_factor has {dims}")
    _check_axes(field, dims, where)
    _check_values(field, where)


def _check_axes(field: xr.Dataset, dims: tuple[str, ...], where: str) -> None:
    if field["loss_factor"].size == 0:
        raise InputError(f"{where}: holds no operating point")
    for name in COORDINATES:
        values = field[name].to_numpy()
        if field[name].dims != ((name,) if dims == GRID else SCATTERED):
            raise InputError(f"{where}: {name} has dimensions {field[name].dims}, not those of an axis of {dims}")
        if not np.all(np.isfinite(values)) or np.any(values <= 0):
            raise InputError(f"{where}: {name} holds {values.min():g}, only finite values above 0 are allowed")
        if dims == GRID and np.any(np.diff(values) <= 0):
            raise InputError(f"{where}: {name} must ascend without repeats, it reads {_list(values)}")
    if dims == SCATTERED:
        pairs = np.column_stack([field[name].to_numpy() for name in COORDINATES])
        unique, count = np.unique(pairs, axis=0, return_counts=True)
        if np.any(count > 1):
            f, gamma = unique[np.argmax(count)]
            raise InputError(
                f"{where}: the point {f:g} Hz, {gamma:g} is there {count.max()} times; average or drop repeats"
            )


def _list(values: NDArray[np.float64]) -> str:
    return ", ".join(f"{value:g}" for value in values[:8]) + (", ..." if len(values) > 8 else "")


def _check_values(field: xr.Dataset, where: str) -> None:
    bed_mass = field.attrs.get("bed_mass")
    if not isinstance(bed_mass, (int, float, np.number)) or not np.isfinite(bed_mass) or bed_mass <= 0:
        raise InputError(f"{where}: attribute bed_mass is {bed_mass!r}, a mass above 0 [kg] is needed")
    eta, mass = field["loss_factor"].to_numpy(), field["effective_mass_ratio"].to_numpy()
    status = field["status"].to_numpy()
    usable = (status & int(FATAL)) == 0
    if np.any(usable & ~(np.isfinite(eta) & np.isfinite(mass))):
        raise InputError(f"{where}: loss_factor or effective_mass_ratio is missing where status says that it is good")
    if not np.any(usable):
        raise InputError(f"{where}: no operating point has a usable value")
    for name in ("loss_factor_se", "effective_mass_ratio_se"):
        if np.any(field[name].to_numpy() < 0):
            raise InputError(f"{where}: {name} is negative somewhere; standard errors are 0 or more, NaN if unknown")
    if "motion_mode" in field:
        told, allowed = np.unique(field["motion_mode"].to_numpy()), [int(mode) for mode in MotionMode]
        if np.any(~np.isin(told, allowed)):
            raise InputError(f"{where}: motion_mode holds {_list(told)}, allowed are {min(allowed)} to {max(allowed)}")
    f, gamma = places_of(field)
    velocity = gamma * STANDARD_GRAVITY / (2 * np.pi * f)
    scale = np.pi * bed_mass * velocity**2
    energy = field["dissipated_energy"].to_numpy()
    with np.errstate(invalid="ignore"):
        wrong = usable & (np.abs(energy / scale - eta) > 0.1 * np.maximum(np.abs(eta), 0.01))
        wrong |= usable & (np.abs(field["power"].to_numpy() - energy * f) > 0.1 * np.abs(energy * f))
    if np.any(wrong):
        i = np.flatnonzero(wrong)[0]
        raise InputError(
            f"{where}: at {f.flat[i]:g} Hz, {gamma.flat[i]:g} the dissipated energy per cycle "
            f"is {energy.flat[i]:.4g} J, eta = {eta.flat[i]:.4g} asks for {(scale * eta).flat[i]:.4g} J and power = "
            "energy times frequency; check units (J per cycle, W) and bed_mass, or leave both columns out"
        )
