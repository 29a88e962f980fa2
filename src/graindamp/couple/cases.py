"""What is simulated together: a structure, the dampers on it, how it starts, and the forces on it."""

from collections.abc import Sequence
from math import isfinite, pi
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from graindamp.dem.packing_store import Packing
from graindamp.errors import InputError
from graindamp.spec.simulation import DamperSpec
from graindamp.structure.modal import ModalModel, point_index

Real = NDArray[np.float64]

LOOKS = 400
"""Pieces of a run, after which energies are written down and Ctrl-C is heard [-]."""


class Carried(NamedTuple):
    """A damper at a point of the structure, its particles simulated."""

    damper: DamperSpec
    point: str
    """Point of the modal model that its container is fixed to; the model holds the mass of the empty container."""
    direction: tuple[float, float, float] = (1.0, 0.0, 0.0)
    """Direction in which the point moves, in the damper's axes; a unit vector."""
    along: tuple[float, float, float] | None = None
    """Direction of the structure's axis in the damper's axes, a unit vector across `direction`: the container then
    turns with the slope of the structure, about the axis along x direction. None: it only moves to and fro."""
    pivot: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Place of the structure's point in the damper's axes [m], about which the container turns."""
    packing: Packing | None = None
    """The bed to start from; None: pack, or take the stored one."""


class HarmonicForce(NamedTuple):
    """Force amplitude sin(2 pi frequency t + phase) on a point."""

    point: str
    amplitude: float
    """[N]"""
    frequency: float
    """[Hz], >= 0; 0 with a phase of pi/2 is a constant force."""
    phase: float = 0.0
    """[rad]"""
    soft_start: float = 0.0
    """Time over which it rises [s]."""


class SweptForce(NamedTuple):
    """Force of constant amplitude and running frequency on a point; none after its end."""

    point: str
    amplitude: float
    """[N]"""
    start: float
    """First frequency [Hz], > 0."""
    stop: float
    """Last frequency [Hz], > 0; may be below the first."""
    duration: float
    """[s]"""
    law: str = "linear"
    """How frequency runs over time: "linear" or "log"."""
    soft_start: float = 0.0
    """Time over which it rises [s]."""


class SampledForce(NamedTuple):
    """Force given by samples, joined by straight lines, on a point; none after the last."""

    point: str
    samples: Real
    """[N]; (sample,)."""
    rate: float
    """Samples per second [Hz]."""


Force = HarmonicForce | SweptForce | SampledForce


class Case(NamedTuple):
    """One structure with its dampers over a time."""

    model: ModalModel
    """Structure with empty containers."""
    dampers: tuple[Carried, ...]
    duration: float
    """Time to follow [s]."""
    q: Real | None = None
    """Modal coordinates at the start [m kg^1/2], measured from the equilibrium under the weight of the beds; (mode,).
    None: zero."""
    v: Real | None = None
    """Modal velocities at the start [m kg^1/2/s]; (mode,). None: zero. The beds start at rest in their containers."""
    forces: tuple[Force, ...] = ()
    sample_rate: float | None = None
    """Samples per second of what is written down [Hz]; None: 40 per period of the highest mode, 1 kHz at least."""
    steps_per_contact: int = 40
    """Time steps in the shortest contact [-]."""
    time_step: float | None = None
    """Largest time step [s]; None: by steps_per_contact."""
    snapshots: int = 1
    """Times at which all particles are written down, evenly spread, the last at the end [-], 1 to 400."""


def released(model: ModalModel, point: str, displacement: float, mode: int | None = None) -> Real:
    """Modal coordinates of a structure held at a point and about to be let go.

    Args:
        model: the structure.
        point: where it is held.
        displacement: of that point [m].
        mode: number of the only mode in the shape, from 0; None: the shape that a force at the point bends it to, which
            only a structure without rigid-body modes has.

    Returns:
        q [m kg^1/2]; (mode,).

    Raises:
        InputError: no such point or mode, the mode does not move the point, or no static shape exists.
    """
    if not isfinite(displacement):
        raise InputError(f"displacement is {displacement}, but must be a finite number")
    shape = model.shape[point_index(model, point)]
    n_mode = len(model.omega)
    if mode is not None:
        if not 0 <= mode < n_mode:
            raise InputError(f"mode is {mode}, but the structure has {n_mode} modes, counted from 0")
        if shape[mode] == 0.0:
            raise InputError(f"mode {mode} does not move point '{point}'; release another mode or point")
        coordinates = np.zeros(n_mode)
        coordinates[mode] = displacement / shape[mode]
        return coordinates
    if np.any(model.omega == 0.0):
        raise InputError("a structure with rigid-body modes has no static shape; give the mode to release")
    bent = shape / model.omega**2
    flexibility = float(shape @ bent)
    if flexibility == 0.0:
        raise InputError(f"no mode moves point '{point}'; release another point")
    return np.asarray(displacement / flexibility * bent)


def check(case: Case) -> None:
    """Look at the numbers of a case.

    Raises:
        InputError: what is wrong, and what is allowed.
    """
    if not case.dampers:
        raise InputError("dampers is empty, but at least one damper is needed")
    n_mode = len(case.model.omega)
    for name, value in (("duration", case.duration), ("sample_rate", case.sample_rate), ("time_step", case.time_step)):
        if value is not None and not (isfinite(value) and value > 0.0):
            raise InputError(f"{name} is {value}, but must be a finite number > 0")
    if case.steps_per_contact < 10:
        raise InputError(f"steps_per_contact is {case.steps_per_contact}, but must be 10 or more")
    if not 1 <= case.snapshots <= LOOKS:
        raise InputError(f"snapshots is {case.snapshots}, but must be 1 to {LOOKS}")
    for name, start in (("q", case.q), ("v", case.v)):
        if start is not None and (np.shape(start) != (n_mode,) or not np.isfinite(start).all()):
            raise InputError(f"{name} has shape {np.shape(start)}, but must be {n_mode} finite numbers, one per mode")
    for number, carried in enumerate(case.dampers, 1):
        _check_carried(f"dampers[{number}]", carried, case.model)
    for number, force in enumerate(case.forces, 1):
        point_index(case.model, force.point)
        _check_force(f"forces[{number}]", force)


def _check_carried(where: str, carried: Carried, model: ModalModel) -> None:
    row = point_index(model, carried.point)
    if abs(np.linalg.norm(carried.direction) - 1.0) > 1e-9:
        raise InputError(f"{where}.direction is {carried.direction}, but must be a unit vector")
    if carried.along is None:
        return
    if abs(np.linalg.norm(carried.along) - 1.0) > 1e-9 or abs(np.dot(carried.along, carried.direction)) > 1e-9:
        raise InputError(f"{where}.along is {carried.along}, but must be a unit vector across direction")
    if np.isnan(model.slope[row]).any():
        raise InputError(
            f"{where}.along is given, but the slope of the structure at point '{carried.point}' is not known; take a "
            "beam, or leave along out and the container only moves to and fro"
        )


def _check_force(where: str, force: Force) -> None:
    if isinstance(force, SampledForce):
        samples = np.asarray(force.samples)
        if samples.ndim != 1 or len(samples) < 2 or not np.isfinite(samples).all():
            raise InputError(f"{where}.samples has shape {samples.shape}, but must be two or more finite numbers")
        wanted: Sequence[tuple[str, float, bool]] = [("rate", force.rate, force.rate > 0.0)]
    elif isinstance(force, SweptForce):
        if force.law not in ("linear", "log"):
            raise InputError(f"{where}.law is {force.law!r}, but must be 'linear' or 'log'")
        wanted = [(name, getattr(force, name), getattr(force, name) > 0.0) for name in ("start", "stop", "duration")]
    else:
        wanted = [("frequency", force.frequency, force.frequency >= 0.0)]
    for name, value, allowed in wanted:
        if not (isfinite(value) and allowed):
            raise InputError(f"{where}.{name} is {value}, but must be a finite number in its range")
    if not isinstance(force, SampledForce) and not isfinite(force.amplitude):
        raise InputError(f"{where}.amplitude is {force.amplitude}, but must be a finite number")


def weight_of(case: Case, mass: Sequence[float]) -> Real:
    """Modal force of the weight of the beds, whose masses [kg] are given [N kg^-1/2]; (mode,)."""
    total = np.zeros(len(case.model.omega))
    for carried, bed_mass in zip(case.dampers, mass, strict=True):
        pull = bed_mass * float(np.dot(carried.damper.gravity, carried.direction))
        total += pull * case.model.shape[point_index(case.model, carried.point)]
    return total


def sag_of(case: Case, mass: Sequence[float]) -> Real:
    """Modal coordinates of the equilibrium under the weight of the beds [m kg^1/2]; (mode,).

    Rigid-body modes stay where they are: what holds a free structure up holds the beds' weight too.
    """
    weight, omega = weight_of(case, mass), case.model.omega
    return np.divide(weight, omega**2, out=np.zeros_like(weight), where=omega > 0.0)


def bare_speed(case: Case, row: int) -> float:
    """Bound on the velocity of a point of the structure without beds [m/s]: its free motion and its motion under each
    force, all added."""
    from scipy.signal import cont2discrete, lfilter

    model = case.model
    shape, omega = model.shape[row], model.omega
    q = np.zeros(len(omega)) if case.q is None else case.q
    v = np.zeros(len(omega)) if case.v is None else case.v
    bound = float(np.abs(shape) @ np.sqrt((omega * q) ** 2 + v**2))
    for force in case.forces:
        highest = max(float(omega.max()) / (2.0 * pi), _highest(force), 1.0 / case.duration)
        count = int(min(max(20.0 * highest * case.duration, 200.0), 2e6))
        step = case.duration / count
        signal = force_values(force, np.asarray(step * np.arange(count + 1), np.float64))
        participation = model.shape[point_index(model, force.point)]
        speed = np.zeros(count + 1)
        for k in range(len(omega)):
            system = ([1.0, 0.0], [1.0, float(model.damping[k]), float(omega[k] ** 2)])
            numerator, denominator, _ = cont2discrete(system, step, "foh")
            speed += shape[k] * participation[k] * lfilter(np.ravel(numerator), denominator, signal)
        bound += float(np.abs(speed).max())
    return bound


def _highest(force: Force) -> float:
    if isinstance(force, SampledForce):
        return 0.5 * force.rate
    return max(force.start, force.stop) if isinstance(force, SweptForce) else force.frequency


def force_values(force: Force, time: Real) -> Real:
    """The force at times [s] from the start, in [N]."""
    if isinstance(force, SampledForce):
        grid = np.arange(len(force.samples)) / force.rate
        return np.asarray(np.interp(time, grid, force.samples, right=0.0))
    rise = np.clip(time / force.soft_start, 0.0, 1.0) if force.soft_start > 0.0 else np.ones_like(time)
    gain = force.amplitude * rise**3 * (10.0 + rise * (6.0 * rise - 15.0))
    if isinstance(force, HarmonicForce):
        return np.asarray(gain * np.sin(2.0 * pi * force.frequency * time + force.phase))
    t = np.minimum(time, force.duration)
    if force.law == "log" and force.stop != force.start:
        rate = np.log(force.stop / force.start) / force.duration
        phase = 2.0 * pi * force.start * np.expm1(rate * t) / rate
    else:
        phase = 2.0 * pi * (force.start + 0.5 * (force.stop - force.start) * t / force.duration) * t
    return np.asarray(np.where(time <= force.duration, gain * np.sin(phase), 0.0))
