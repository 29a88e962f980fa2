"""Steady response to a harmonic force of fixed amplitude over a band: all modes, all dampers, one harmonic.

At one frequency the unknowns are the amplitudes s_d of the dampers. They fix each field, the fields fix the complex
masses, and a linear system then gives the motion u(s): balance is |u_d(s)| = s_d. A sweep follows the solution nearest
to the last one, so that up and down differ where several exist.
"""

from collections.abc import Sequence
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from graindamp.couple.balance import Attached, damper_mass, intensity_of, residual
from graindamp.couple.equilibrium import ModeResult
from graindamp.errors import InputError
from graindamp.structure.frf import receptance
from graindamp.structure.modal import ModalModel
from graindamp.units import STANDARD_GRAVITY

Real = NDArray[np.float64]
Complex = NDArray[np.complex128]
Direction = Literal["up", "down"]

TOLERANCE = 1e-8
"""Residual of the balance over the motion that counts as solved [-]."""


class Response(NamedTuple):
    """Response of one sweep; axis 0 is the frequency."""

    direction: Direction
    frequency: Real
    """[Hz], ascending whatever the direction of the sweep."""
    mobility: Complex
    """Velocity of the output point per force [m/(N s)], shape (frequency,)."""
    intensity: Real
    """Excitation intensity of each damper [-], shape (frequency, damper)."""
    extrapolated: NDArray[np.bool_]
    """True where a field was used outside its points, held at its nearest value; shape (frequency,)."""
    converged: NDArray[np.bool_]
    """False where no balance was found; values are NaN there."""
    n_solution: NDArray[np.int64]
    """Solutions that exist at this frequency where all were looked for (one damper), else 0."""
    residual: Real
    """Residual of the balance over the largest motion [-], shape (frequency,)."""


class Peak(NamedTuple):
    """A resonance read off a response curve."""

    frequency: float
    """[Hz]."""
    mobility: float
    """[m/(N s)]."""
    damping_ratio: float
    """From the half-power bandwidth [-]; NaN where the curve does not fall to it on both sides."""
    extrapolated: bool


class _Linear(NamedTuple):
    """The structure without beds at every frequency of the band."""

    frequency: Real
    between: Complex
    """(frequency, damper, damper) [m/N]."""
    free: Complex
    """(frequency, damper) [m]."""
    output: Complex
    """(frequency,) motion of the output point under the drive [m]."""
    to_output: Complex
    """(frequency, damper) [m/N]."""


def respond(
    model: ModalModel,
    dampers: Sequence[Attached],
    drive: str,
    output: str,
    force: float,
    frequency: Real,
    direction: Direction = "up",
) -> Response:
    """Nonlinear frequency response at a fixed force.

    Far from resonance a damper hardly moves and leaves the points of any field; fields are held constant there and the
    points marked.

    Args:
        model: modes of the structure without beds.
        dampers: any number; none gives the linear response.
        drive: driven point.
        output: observed point.
        force: force amplitude [N], > 0.
        frequency: ascending frequencies [Hz], shape (frequency,).
        direction: which way the sweep goes.

    Raises:
        InputError: unknown points, a force or frequencies that are not above 0 or do not ascend.
    """
    if not force > 0:
        raise InputError(f"force is {force!r} N; an amplitude above 0 is needed")
    frequency = np.asarray(frequency, float)
    if frequency.ndim != 1 or len(frequency) == 0 or frequency[0] <= 0 or np.any(np.diff(frequency) <= 0):
        raise InputError("frequencies of a response must be above 0 Hz and ascend")
    held = tuple(damper._replace(field=damper.field.beyond("constant")) for damper in dampers)
    linear = _linear(model, held, drive, output, force, frequency)
    choices = _all_amplitudes(linear, held[0]) if len(held) == 1 else [np.empty(0)] * len(frequency)
    n = len(frequency)
    motion = np.full((n, len(held)), np.nan, complex)
    error = np.full(n, np.nan)
    last: Real | None = None
    for k in range(n) if direction == "up" else range(n - 1, -1, -1):
        one = _Linear(*(part[k] for part in linear))
        if len(held) == 1 and len(choices[k]):
            near = 0 if last is None else int(np.argmin(np.abs(np.log(choices[k] / last[0]))))
            amplitude: Real | None = choices[k][near : near + 1]
        else:
            amplitude = _balance(one, held, last)
        if amplitude is None:
            continue
        motion[k] = _motion(one, held, amplitude)
        last = np.abs(motion[k]) if held else None
        if held:
            missing = residual(motion[k], float(one.frequency), one.between, one.free, held)
            error[k] = np.abs(missing).max() / np.abs(motion[k]).max()
    return _collect(linear, held, motion, error, direction, np.array([len(c) for c in choices]), force)


def _linear(
    model: ModalModel, dampers: Sequence[Attached], drive: str, output: str, force: float, frequency: Real
) -> _Linear:
    on_pole = np.isin(2 * np.pi * frequency, model.omega)
    at = np.where(on_pole, frequency * (1 + 1e-9), frequency)  # an undamped pole is singular only without its beds
    shape = (len(frequency), len(dampers))
    between = np.empty((*shape, len(dampers)), complex)
    free, to_output = np.empty(shape, complex), np.empty(shape, complex)
    for d, damper in enumerate(dampers):
        free[:, d] = receptance(model, at, damper.point, drive) * force
        to_output[:, d] = receptance(model, at, output, damper.point)
        for e, other in enumerate(dampers):
            between[:, d, e] = receptance(model, at, damper.point, other.point)
    return _Linear(at, between, free, receptance(model, at, output, drive) * force, to_output)


def _motion(one: _Linear, dampers: Sequence[Attached], amplitude: Real) -> Complex:
    """Motion of the dampers if their fields were those of `amplitude` [m], shape (damper,)."""
    gamma = intensity_of(amplitude, one.frequency)
    mass = np.array([complex(damper_mass(d, one.frequency, g)[0]) for d, g in zip(dampers, gamma, strict=True)])
    matrix = np.eye(len(dampers)) - one.between * ((2 * np.pi * one.frequency) ** 2 * mass)
    return np.asarray(np.linalg.solve(matrix, one.free), complex)


def _all_amplitudes(linear: _Linear, damper: Attached, n_sample: int = 150) -> list[Real]:
    """Every amplitude [m] that balances one damper, at every frequency, by sign changes on a fine grid, bisected."""
    omega2 = ((2 * np.pi * linear.frequency) ** 2)[:, None]
    low, high = np.log(np.array(damper.field.intensity_range) * np.array([1e-4, 30.0]))
    # Below and above the field it is held constant: the damper is linear there, and Newton's method finds the rest.
    grid = np.unique(np.concatenate([np.linspace(low, high, n_sample), damper.field.breaks()[1]]))

    def excess(log_gamma: Real, rows: NDArray[np.int64] | slice) -> Real:
        f, scale = linear.frequency[rows], omega2[rows]
        gamma = np.exp(log_gamma)
        mass, _ = damper_mass(damper, np.broadcast_to(f[:, None], gamma.shape), gamma)
        motion = np.abs(linear.free[rows]) / np.abs(1 - linear.between[rows, 0] * scale * mass)
        return np.log(motion * scale / STANDARD_GRAVITY) - log_gamma

    every = np.broadcast_to(grid, (len(linear.frequency), len(grid)))
    sign = np.signbit(excess(every, slice(None)))
    row, column = np.nonzero(np.diff(sign, axis=1))
    a, b = grid[column].copy(), grid[column + 1].copy()
    start = sign[row, column]
    for _ in range(45):
        mid = (a + b) / 2
        same = np.signbit(excess(mid[:, None], row)[:, 0]) == start
        a, b = np.where(same, mid, a), np.where(same, b, mid)
    amplitude = np.exp((a + b) / 2) * STANDARD_GRAVITY / omega2[row, 0]
    return [amplitude[row == k] for k in range(len(linear.frequency))]


def _balance(one: _Linear, dampers: Sequence[Attached], last: Real | None, n_iter: int = 30) -> Real | None:
    """Amplitudes of all dampers that balance at one frequency [m]: Newton's method in their logarithms, from several
    starts; None where none converges."""
    if not dampers:
        return np.empty(0)
    to_amplitude = STANDARD_GRAVITY / (2 * np.pi * one.frequency) ** 2
    levels = [np.full(len(dampers), gamma * to_amplitude) for gamma in (0.01, 1.0, 10.0, 100.0)]
    for start in ([last] if last is not None else []) + [np.abs(_motion(one, dampers, level)) for level in levels]:
        z = np.log(np.maximum(start, 1e-30))
        for _ in range(n_iter):
            value = np.log(np.abs(_motion(one, dampers, np.exp(z)))) - z
            if np.abs(value).max() < 0.1 * TOLERANCE:
                return np.exp(z)
            step = 1e-6
            columns = [
                np.log(np.abs(_motion(one, dampers, np.exp(z + step * e)))) - z - step * e for e in np.eye(len(z))
            ]
            jacobian = (np.column_stack(columns) - value[:, None]) / step
            try:
                change = np.linalg.solve(jacobian, -value)
            except np.linalg.LinAlgError:
                break
            z = z + np.clip(change, -1.0, 1.0)
    return None


def _collect(
    linear: _Linear,
    dampers: Sequence[Attached],
    motion: Complex,
    error: Real,
    direction: Direction,
    n_solution: NDArray[np.int64],
    force: float,
) -> Response:
    omega = 2 * np.pi * linear.frequency
    intensity = intensity_of(motion, linear.frequency[:, None])
    total = linear.output.copy()
    extrapolated = np.zeros(len(omega), bool)
    converged = np.asarray(np.isfinite(motion).all(axis=1))
    for d, damper in enumerate(dampers):
        gamma = np.where(converged, intensity[:, d], 1.0)
        mass, values = damper_mass(damper, linear.frequency, gamma)
        total += linear.to_output[:, d] * omega**2 * mass * motion[:, d]
        extrapolated |= values.extrapolated
    return Response(
        direction, linear.frequency, 1j * omega * total / force, intensity, extrapolated, converged, n_solution, error
    )


def response_grid(band: tuple[float, float], results: Sequence[ModeResult], n_frequency: int = 400) -> Real:
    """Frequencies [Hz] that resolve every resonance: even in log f, dense about each mode, bare and loaded.

    Args:
        band: lowest and highest frequency [Hz].
        results: solved modes.
        n_frequency: number of evenly spaced ones.
    """
    parts = [np.geomspace(*band, n_frequency)]
    for result in results:
        for state in result.equilibria:
            parts.append(state.frequency * (1 + state.damping_ratio * np.linspace(-12, 12, 121)))
        width = max(result.bare_damping_ratio, 1e-3)
        parts.append(result.bare_frequency * (1 + width * np.linspace(-8, 8, 81)))
    every = np.unique(np.concatenate(parts))
    inside: Real = every[(every >= band[0]) & (every <= band[1])]
    kept: Real = inside[np.concatenate([[True], np.diff(inside) > 1e-9 * inside[:-1]])]
    return kept


def peaks(response: Response, prominence: float = 1.2) -> list[Peak]:
    """Resonances of a response curve, with the damping of their half-power bandwidth.

    On a nonlinear curve that bandwidth mixes the damping of all amplitudes it crosses; it equals the damping ratio at
    the peak only where the fields hardly change between peak and half power.

    Args:
        response: a sweep.
        prominence: a maximum counts as a peak if the curve falls by this factor on both sides before it rises above it.
    """
    from scipy.signal import find_peaks

    size = np.where(response.converged, np.abs(response.mobility), 0.0)
    found, _ = find_peaks(np.log(np.maximum(size, 1e-300)), prominence=np.log(prominence))
    rows = []
    for k in found:
        left = _crossing(response.frequency[: k + 1][::-1], size[: k + 1][::-1], size[k] / np.sqrt(2))
        right = _crossing(response.frequency[k:], size[k:], size[k] / np.sqrt(2))
        f = float(response.frequency[k])
        rows.append(Peak(f, float(size[k]), (right - left) / (2 * f), bool(response.extrapolated[k])))
    return rows


def _crossing(frequency: Real, size: Real, level: float) -> float:
    """Frequency at which a curve that starts above `level` first falls below it [Hz], NaN if it never does."""
    below = np.flatnonzero(size < level)
    if len(below) == 0:
        return float("nan")
    k = int(below[0])
    return float(np.interp(level, [size[k], size[k - 1]], [frequency[k], frequency[k - 1]]))
