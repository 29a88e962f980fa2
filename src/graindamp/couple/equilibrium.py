"""All equilibria of a mode with its dampers, each with its stability and its error.

The search is by exclusion: rectangles of frequency and amplitude in which either equation provably has no zero are
thrown away, the others are quartered, until each that is left holds one equilibrium. Nothing is missed, whatever the
starting point; where a field is bilinear its bounds over a rectangle are exact.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from graindamp.couple.balance import damping_ratio_of
from graindamp.couple.single_mode import (
    Box,
    LoadedMode,
    Loads,
    damping_ratio,
    held_force,
    imbalance,
    loads,
    search_box,
)
from graindamp.units import STANDARD_GRAVITY

Real = NDArray[np.float64]
NAN = float("nan")

SMALLEST = 1e-5
"""Size in log f and log a at which a rectangle is handed to Newton's method."""
MOST_BOXES = 20_000
"""More surviving rectangles than this mean a continuum of equilibria rather than single ones."""


class Equilibrium(NamedTuple):
    """A steady state of one mode at its resonance. Values per damper in the order of all dampers; NaN on a node."""

    frequency: float
    """Resonance frequency with the beds [Hz]."""
    frequency_se: float
    """Its standard error from that of the fields [Hz]; NaN where a field does not tell its own."""
    damping_ratio: float
    """Total, structure and dampers [-]."""
    damping_ratio_se: float
    modal_amplitude: float
    """Amplitude Q of the mass-normalised modal coordinate [kg^1/2 m]."""
    displacement: Real
    """Displacement amplitude of each container X [m]."""
    intensity: Real
    """Excitation intensity of each container Gamma [-]."""
    intensity_se: Real
    loss_factor: Real
    """eta of each damper there [-]."""
    effective_mass_ratio: Real
    """m' of each damper there [-]."""
    slope: float
    """d log(force held) / d log(amplitude) at fixed frequency [-]: above 0 the damper takes more from a motion that
    grows than the drive gives, so it falls back; 1 for a linear damper, 0 at a fold."""
    is_stable: bool
    """slope > 0."""
    extrapolated: bool
    """True where any field was used outside its points."""


class ModeResult(NamedTuple):
    """One mode under one force: its equilibria, or why there are none."""

    number: int
    """1 for the first elastic mode."""
    bare_frequency: float
    """Without the beds [Hz]."""
    bare_damping_ratio: float
    """Structural [-]."""
    force: float
    """Force amplitude [N]."""
    efficient_damping_ratio: float
    """Structure left out, all dampers with eta = 1 and m' = 1 (Meyer & Seifried 2021, Eq. 18) [-]."""
    equilibria: tuple[Equilibrium, ...]
    """In ascending amplitude."""
    largest_force: float
    """Largest force amplitude held anywhere in the region searched [N]."""
    largest_force_intensity: float
    """Largest intensity among the dampers there [-]."""
    smallest_force: float
    """Force held at the smallest amplitude searched [N]."""
    reason: str
    """Why there is no equilibrium, in a sentence; empty where there is one."""

    @property
    def stable(self) -> tuple[Equilibrium, ...]:
        """Equilibria in which the mode can stay."""
        return tuple(state for state in self.equilibria if state.is_stable)


def solve_mode(mode: LoadedMode, n_damper: int, with_capacity: bool = True) -> ModeResult:
    """All equilibria of a loaded mode.

    Args:
        mode: the mode with its drive and the dampers that take part.
        n_damper: number of all dampers, those on nodes included.
        with_capacity: also find the forces that can be held, which takes as long again; without, they are found only
            where there is no equilibrium, and NaN elsewhere.
    """
    efficient = sum(damper.bed_mass * shape**2 for damper, shape in zip(mode.dampers, mode.shape, strict=True))
    result = ModeResult(
        mode.number,
        mode.omega / (2 * np.pi),
        mode.static_damping_ratio,
        mode.force,
        float(damping_ratio_of(1.0, efficient)),
        (),
        NAN,
        NAN,
        NAN,
        "",
    )
    if mode.drive_shape == 0:
        return result._replace(reason="the driven point is a node of this mode; the force does not excite it")
    if not mode.dampers:
        return _without_dampers(mode, result, n_damper)
    box = search_box(mode)
    if isinstance(box, str):
        return result._replace(reason=box)
    states = [_state(mode, x, y, n_damper) for x, y in find_roots(mode, box)]
    if with_capacity or not states:
        result = result._replace(**force_capacity(mode, box)._asdict())
    if states:
        return result._replace(equilibria=tuple(sorted(states, key=lambda state: state.modal_amplitude)))
    return result._replace(reason=_explain(mode, result))


def _explain(mode: LoadedMode, result: ModeResult) -> str:
    if np.isnan(result.largest_force):
        return "the loaded mode has no resonance inside the fields: its frequency leaves their range"
    if mode.force > result.largest_force:
        tops = [damper.field.intensity_range[1] for damper in mode.dampers]
        at_edge = result.largest_force_intensity > 0.999 * min(tops)
        return (
            f"{mode.force:.4g} N is more than the damper can hold: at most {result.largest_force:.4g} N, at intensity "
            f"{result.largest_force_intensity:.3g}" + (", where its field ends" if at_edge else "")
        )
    return (
        f"{mode.force:.4g} N moves the damper less than its field begins; {result.smallest_force:.4g} N reach it"
        if mode.force < result.smallest_force
        else "no amplitude inside the fields balances the force: it lies where the resonance leaves their range"
    )


def _without_dampers(mode: LoadedMode, result: ModeResult, n_damper: int) -> ModeResult:
    """Every damper on a node: a linear mode, damped by the structure alone."""
    if mode.damping == 0:
        return result._replace(reason="every damper sits on a node and the structure has no damping", largest_force=0.0)
    x = np.log(mode.omega / (2 * np.pi))
    y = np.log(mode.drive_shape * mode.force * mode.omega / (mode.damping * STANDARD_GRAVITY))
    return result._replace(equilibria=(_state(mode, float(x), float(y), n_damper),))


def find_roots(mode: LoadedMode, box: Box) -> list[tuple[float, float]]:
    """All (x, y) in `box` at which both equations hold, by exclusion and Newton's method."""
    x_low, y_low = (corner.ravel() for corner in np.meshgrid(box.x[:-1], box.y[:-1], indexing="ij"))
    x_high, y_high = (corner.ravel() for corner in np.meshgrid(box.x[1:], box.y[1:], indexing="ij"))
    while True:
        keep = _may_hold_root(mode, (x_low, x_high), (y_low, y_high))
        x_low, x_high, y_low, y_high = (side[keep] for side in (x_low, x_high, y_low, y_high))
        if len(x_low) == 0:
            return []
        size = max(np.max(x_high - x_low), np.max(y_high - y_low))
        if size < SMALLEST or len(x_low) > MOST_BOXES:
            break
        x_mid, y_mid = (x_low + x_high) / 2, (y_low + y_high) / 2
        x_low, x_high = np.concatenate([x_low, x_mid] * 2), np.concatenate([x_mid, x_high] * 2)
        y_low, y_high = np.concatenate([y_low, y_low, y_mid, y_mid]), np.concatenate([y_mid, y_mid, y_high, y_high])
    roots: list[tuple[float, float]] = []
    for x, y in _clusters((x_low + x_high) / 2, (y_low + y_high) / 2, 4 * size):
        x, y = _polish(mode, x, y, box, 4 * size)
        if any(mode.confined) and loads(mode, np.array(x), np.array(y)).extrapolated:
            continue  # inside the range of the field, but where it has no points
        if not any(abs(x - other[0]) + abs(y - other[1]) < 4 * SMALLEST for other in roots):
            roots.append((x, y))
    return roots


def _may_hold_root(mode: LoadedMode, x: tuple[Real, Real], y: tuple[Real, Real]) -> NDArray[np.bool_]:
    """False for rectangles in which the resonance or the energy equation has no zero."""
    mass, loss = [np.zeros(len(x[0])) for _ in x], [np.zeros(len(x[0])) for _ in x]
    for damper, shape, offset in zip(mode.dampers, mode.shape, mode.offset, strict=True):
        bounds = damper.field.bounds(x, (y[0] + offset, y[1] + offset))
        for side in (0, 1):
            mass[side] += shape**2 * (damper.container_mass + damper.bed_mass * bounds.effective_mass_ratio[side])
            loss[side] += shape**2 * damper.bed_mass * bounds.loss_factor[side]
    none = np.zeros(len(x[0]), bool)
    low = imbalance(mode, x[0], y[0], Loads(mass[0], loss[0], none))
    high = imbalance(mode, x[1], y[1], Loads(mass[1], loss[1], none))
    # Structural damping enters as D / omega, largest at the low frequency: bound it on its own side.
    energy_low = imbalance(mode, x[1], y[0], Loads(mass[0], loss[0], none))[1]
    energy_high = imbalance(mode, x[0], y[1], Loads(mass[1], loss[1], none))[1]
    slack = 1e-12
    possible: NDArray[np.bool_] = (low[0] <= slack) & (high[0] >= -slack) & (energy_low <= slack)
    return possible & (energy_high >= -slack)


def _clusters(x: Real, y: Real, reach: float) -> list[tuple[float, float]]:
    """Centres of groups of points closer than `reach` to one another."""
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import cKDTree

    points = np.column_stack([x, y])
    pairs = cKDTree(points).sparse_distance_matrix(cKDTree(points), reach, p=np.inf)
    n, label = connected_components(pairs + pairs.T, directed=False)
    return [tuple(points[label == group].mean(axis=0)) for group in range(n)]


def _polish(mode: LoadedMode, x: float, y: float, box: Box, reach: float) -> tuple[float, float]:
    """Newton's method from the middle of a cluster, kept inside it; the middle itself where that does not converge."""

    def equations(z: Real) -> Real:
        added = loads(mode, z[0], z[1])
        return np.array(imbalance(mode, z[0], z[1], added), float)

    low = np.array([box.x[0], box.y[0]])
    high = np.array([box.x[-1], box.y[-1]])
    z = np.clip(np.array([x, y]), low, high)
    for _ in range(20):
        value = equations(z)
        if np.abs(value).max() < 1e-12:
            break
        step = 1e-7 * np.where(z + 1e-7 > high, -1.0, 1.0)
        jacobian = np.column_stack([(equations(z + step * unit) - value) / (step @ unit) for unit in np.eye(2)])
        try:
            change = np.linalg.solve(jacobian, value)
        except np.linalg.LinAlgError:
            break
        z = np.clip(z - change, np.maximum(low, np.array([x, y]) - reach), np.minimum(high, np.array([x, y]) + reach))
    return float(z[0]), float(z[1])


class Capacity(NamedTuple):
    """What the dampers can hold along the resonance."""

    largest_force: float
    largest_force_intensity: float
    smallest_force: float


class HoldingCurve(NamedTuple):
    """Force that keeps the mode at each resonant amplitude, sorted by amplitude; all arrays (sample,)."""

    log_amplitude: Real
    """y = log(a / g)."""
    intensity: Real
    """Largest intensity among the dampers [-]."""
    frequency: Real
    """Resonance frequency at this amplitude [Hz]."""
    force: Real
    """Force amplitude held [N]."""


def holding_curve(mode: LoadedMode, box: Box, n_amplitude: int = 160, n_frequency: int = 60) -> HoldingCurve:
    """Force held along the resonance inside `box`; an equilibrium lies wherever it equals the driving force.

    Args:
        mode: the loaded mode.
        box: region of log f and log amplitude, of :func:`graindamp.couple.single_mode.search_box`.
        n_amplitude: amplitudes sampled, besides those at which a field bends.
        n_frequency: frequencies among which the resonance of each amplitude is bracketed, besides those at which a
            field bends.
    """
    y = np.unique(np.concatenate([np.linspace(box.y[0], box.y[-1], n_amplitude), box.y]))
    return _resonances(mode, box, y, n_frequency)


def force_capacity(mode: LoadedMode, box: Box) -> Capacity:
    """Largest and first force held along the resonance inside `box` [N], NaN where it has no resonance."""
    curve = holding_curve(mode, box)
    if len(curve.force) == 0:
        return Capacity(NAN, NAN, NAN)
    best = int(np.argmax(curve.force))
    ends = curve.log_amplitude[max(best - 2, 0)], curve.log_amplitude[min(best + 2, len(curve.force) - 1)]
    fine = _resonances(mode, box, np.linspace(*ends, 101), 60)
    top = int(np.argmax(fine.force))
    return Capacity(float(fine.force[top]), float(fine.intensity[top]), float(curve.force[0]))


def _resonances(mode: LoadedMode, box: Box, y: Real, n_frequency: int) -> HoldingCurve:
    """Every sign change of the resonance equation over frequency at each amplitude, bisected."""
    x = np.unique(np.concatenate([np.linspace(box.x[0], box.x[-1], n_frequency), box.x]))
    xx, yy = np.meshgrid(x, y)
    value = imbalance(mode, xx, yy, loads(mode, xx, yy))[0]
    row, column = np.nonzero(np.diff(np.signbit(value), axis=1))
    low, high, at = x[column], x[np.minimum(column + 1, len(x) - 1)], y[row]
    start = np.signbit(value[row, column])
    for _ in range(40):
        mid = (low + high) / 2
        same = np.signbit(imbalance(mode, mid, at, loads(mode, mid, at))[0]) == start
        low, high = np.where(same, mid, low), np.where(same, high, mid)
    added = loads(mode, low, at)
    known = ~added.extrapolated if any(mode.confined) else np.full(len(at), True)
    curve = HoldingCurve(at, mode.shape.max() * np.exp(at), np.exp(low), held_force(mode, low, at, added))
    return HoldingCurve(*(part[known] for part in curve))


def _state(mode: LoadedMode, x: float, y: float, n_damper: int) -> Equilibrium:
    point = np.array(x), np.array(y)
    added = loads(mode, *point)
    omega = 2 * np.pi * np.exp(x)
    modal = np.exp(y) * STANDARD_GRAVITY / omega**2
    per_damper = np.full((4, n_damper), NAN)
    error = np.full((2, len(mode.dampers)), NAN)
    for d, (damper, place) in enumerate(zip(mode.dampers, mode.indices, strict=True)):
        gamma = mode.shape[d] * np.exp(y)
        values = damper.field(np.exp(x), gamma)
        per_damper[:, place] = mode.shape[d] * modal, gamma, values.loss_factor, values.effective_mass_ratio
        error[:, d] = values.loss_factor_se, values.effective_mass_ratio_se
    slope = _slope(mode, x, y)
    spread = _propagate(mode, x, y, error)
    intensity_se = np.full(n_damper, NAN)
    intensity_se[list(mode.indices)] = per_damper[1, list(mode.indices)] * spread[1]
    return Equilibrium(
        float(np.exp(x)),
        float(np.exp(x) * spread[0]),
        float(damping_ratio(mode, *point[:1], added)),
        float(spread[2]),
        float(modal),
        per_damper[0],
        per_damper[1],
        intensity_se,
        per_damper[2],
        per_damper[3],
        slope,
        bool(slope > 0),
        bool(added.extrapolated),
    )


def _slope(mode: LoadedMode, x: float, y: float, step: float = 1e-6) -> float:
    """d log(force held) / d log(amplitude) at fixed frequency."""
    at, amplitude = np.full(2, x), np.array([y - step, y + step])
    force = np.log(held_force(mode, at, amplitude, loads(mode, at, amplitude)))
    return float((force[1] - force[0]) / (2 * step))


def _propagate(mode: LoadedMode, x: float, y: float, error: Real, step: float = 1e-6) -> Real:
    """Standard errors of x, y and the damping ratio from those of eta and m' of each damper, shape (3,).

    Implicit function theorem: both equations stay fulfilled while one field value moves by its error.

    Args:
        mode: the loaded mode.
        x: log f of the equilibrium.
        y: its log(a / g).
        error: standard errors of eta and m', shape (2, damper).
        step: of the difference quotients.
    """

    def evaluate(z: Real, shift: Real) -> Real:
        at = np.array(z[0]), np.array(z[1])
        added = loads(mode, *at, shift=(shift[0], shift[1]))
        return np.array([*imbalance(mode, *at, added), damping_ratio(mode, at[0], added)])

    z, zero = np.array([x, y]), np.zeros_like(error)
    by_state = np.column_stack([(evaluate(z + e, zero) - evaluate(z - e, zero)) / (2 * step) for e in step * np.eye(2)])
    variance = np.zeros(3)
    for place in np.ndindex(error.shape):
        shift = zero.copy()
        shift[place] = step
        direct = (evaluate(z, shift) - evaluate(z, -shift)) / (2 * step)
        try:
            moves = -np.linalg.solve(by_state[:2], direct[:2])
        except np.linalg.LinAlgError:
            return np.full(3, NAN)
        variance += (np.array([*moves, direct[2] + by_state[2] @ moves]) * error[place]) ** 2
    spread: Real = np.sqrt(variance)
    return spread
