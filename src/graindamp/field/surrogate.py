"""Effective field with error bars from scattered points: two Gaussian processes that meet at an uncertain edge.

eta and m' fall into two regimes that share nothing: *collect and collide*, where the stroke X = Gamma g / (2 pi f)^2
is large enough for the bed to cross its clearance, and everything below (solid-like, fluidised, decoupled). One
stationary process cannot follow the jump between them. Here each regime has its own process in its own coordinates,
and a gate

    s = 1 / (1 + exp(-(ln(X / X_opt) - position - slope F - curvature F^2) / width)),   F = ln(f / 100 Hz),
    y = (1 - s) y_below + s y_above

passes from one to the other. Where the edge lies is a question of probability: a lattice of edges is weighed by the
marginal likelihood of all points, and a prediction is the mixture over it. Between the last point below and the first
point above, the edges disagree, and the error bar grows by itself to the height of the jump.

Sources: Rasmussen & Williams (2006), Gaussian Processes for Machine Learning, sections 2.2, 2.7, 5.4.2; change
surfaces: Herlands et al. (2016), AISTATS, PMLR 51, 1013-1021; mixtures over partitions: Gramacy & Lee (2008), JASA
103, 1119-1130.
"""

from collections.abc import Iterator
from importlib.util import find_spec
from typing import Any, Literal, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray

from graindamp.errors import InputError
from graindamp.field.schema import check, make_field, places_of
from graindamp.field.surrogate_edges import (
    CURVATURES,
    EDGE_STEP,
    NO_EDGE,
    WIDTHS,
    gate_of,
    gated,
    lattice,
    lattice_of,
    probable,
    regions,
    threshold,
)
from graindamp.field.surrogate_prior import (
    FADE,
    Form,
    Places,
    kernels,
    presumed,
    prior,
    stroke_of,
    theory_table,
)
from graindamp.status import FATAL, Status
from graindamp.units import STANDARD_GRAVITY

Real = NDArray[np.float64]

MIN_POINTS = 6
"""Fewest usable points from which a surrogate is made."""
CLEARANCE_FACTORS = (0.7, 1.0, 1.4, 2.0, 2.8)
"""Clearances tried for the mean function, over the one given: beds compact while they are shaken, by factors."""
DEFAULT_ERROR = 0.02
"""Standard error assumed where it is unknown, over max(eta, 0.05)."""
SMALLEST_ETA = 0.05

_FEWEST_WEIGHT, _MOST_EDGES, _CHUNK = 1e-3, 64, 32
_LARGEST_LOG_VARIANCE = 1.0


class SurrogateValues(NamedTuple):
    """Surrogate at some operating points; all arrays have the shape of the frequencies and intensities asked for."""

    loss_factor: Real
    """eta [-]."""
    effective_mass_ratio: Real
    """m' [-]."""
    loss_factor_se: Real
    """Predicted standard error of eta [-], of the field itself: the noise of a single run is not in it."""
    effective_mass_ratio_se: Real
    """Predicted standard error of m' [-], likewise."""


class LeaveOneOut(NamedTuple):
    """Each point predicted from all others; shape (point,)."""

    loss_factor_residual: Real
    """Value at the point less its prediction [-]."""
    effective_mass_ratio_residual: Real
    loss_factor_sd: Real
    """Predicted standard deviation of the residual [-], the noise of the point included; not inflated."""
    effective_mass_ratio_sd: Real
    log_density: Real
    """Logarithm of the joint density predicted for eta and m' at the values that were found [-]."""


class Edge(NamedTuple):
    """Where collect and collide begins, at some frequencies."""

    intensity: Real
    """Gamma at the edge [-], median over the probable edges; NaN if no edge is more probable than one."""
    log_sd: Real
    """Standard deviation of ln Gamma at the edge [-]."""
    probability: float
    """Probability that the points have an edge at all [-]."""


class Joint(NamedTuple):
    """Predicted covariances between places, and the variance of a run at each, both of eta as the process describes it
    and of m'."""

    covariance: tuple[Real, Real]
    """Of the field itself; (place, place)."""
    noise: tuple[Real, Real]
    """Of a run about the field; (place,)."""


class _Posterior(NamedTuple):
    """Probable edges and, given each, the process conditioned on the points, for eta and m'."""

    edges: Real  # position, slope, curvature, width, log prior; (edge, 5)
    weight: Real  # (edge,), sums to 1
    inverse: tuple[Real, Real]  # of the covariance of the points; (edge, point, point)
    coefficient: tuple[Real, Real]  # inverse times (value - mean); (edge, point)


class Surrogate:
    """eta and m' as functions of frequency and intensity, with standard errors, from scattered points.

    The same points give the same surrogate, whatever was computed before.
    """

    def __init__(
        self, points: xr.Dataset, clearance: float | None, restitution: float = 0.0, form: Form | None = None
    ) -> None:
        """Fit a surrogate.

        Args:
            points: effective field, grid or scattered. Points with a fatal status are left out; standard errors that
                are unknown count as 2 % of max(eta, 0.05).
            clearance: free travel h of the bed [m], the edge is expected within a factor of two about X = h / pi; None
                expects it anywhere between the points, and knows no theory.
            restitution: coefficient of restitution of bed and end wall [-], of the theory.
            form: other assumptions than the usual ones.

        Raises:
            InputError: scikit-learn is missing, not a field, fewer than six usable points, or an argument outside its
                range.
        """
        if find_spec("sklearn") is None:
            raise InputError('a surrogate needs scikit-learn; install it with: pip install "graindamp[opt]"')
        if clearance is not None and not (np.isfinite(clearance) and clearance > 0):
            raise InputError(f"clearance is {clearance} m, but must be a finite length above 0, or None if unknown")
        check(points, "points of a surrogate")
        self.form = form or Form()
        self.bed_mass = float(points.attrs["bed_mass"])
        self.source = str(points.attrs.get("source", "unknown"))
        self.frequency, self.intensity, self.values, self.errors = _usable(points)
        if len(self.frequency) < MIN_POINTS:
            raise InputError(f"a surrogate needs at least {MIN_POINTS} usable points, given {len(self.frequency)}")
        stroke = stroke_of(self.frequency, self.intensity)
        self.optimum = clearance / np.pi if clearance is not None else float(np.exp(np.mean(np.log(stroke))))
        self._table = theory_table(restitution) if clearance is not None and self.form.has_theory else None
        self._quantities = presumed(self.form)
        self._is_free = clearance is None
        self._lattice = lattice(self.form, np.log(stroke / self.optimum) if self._is_free else None)
        self.clearance_factor: float | None = None
        self.stretch = 1.0
        self._theta = [prior(quantity)[0] for quantity in self._quantities]
        self._choose()
        self._posterior = self._conditioned(self._refined())
        self._inflation = self._calibrated()

    @classmethod
    def of_arrays(
        cls,
        frequency: ArrayLike,
        intensity: ArrayLike,
        loss_factor: ArrayLike,
        effective_mass_ratio: ArrayLike,
        loss_factor_se: ArrayLike,
        effective_mass_ratio_se: ArrayLike,
        *,
        clearance: float | None,
        restitution: float = 0.0,
        form: Form | None = None,
    ) -> "Surrogate":
        """Fit a surrogate to arrays of shape (point,): f [Hz], Gamma, eta, m' and their standard errors [-].

        The bed mass, which only energies need, is taken as 1 kg.
        """
        errors = {"loss_factor_se": loss_factor_se, "effective_mass_ratio_se": effective_mass_ratio_se}
        points = make_field(
            frequency,
            intensity,
            loss_factor,
            effective_mass_ratio,
            1.0,
            source="arrays",
            scattered=True,
            variables=errors,
        )
        return cls(points, clearance, restitution, form)

    def predict(self, frequency: ArrayLike, intensity: ArrayLike) -> SurrogateValues:
        """Field at frequencies [Hz] and intensities [-], arrays of one shape or broadcast to one.

        Beyond the points the processes return to their means and the errors grow; nothing is refused here.

        Raises:
            InputError: values that are not finite or not above 0.
        """
        f, gamma = np.broadcast_arrays(np.asarray(frequency, float), np.asarray(intensity, float))
        if not (np.all(np.isfinite(f) & (f > 0)) and np.all(np.isfinite(gamma) & (gamma > 0))):
            raise InputError("frequency [Hz] and intensity [-] must be finite and above 0")
        places = self._places(f.ravel(), gamma.ravel())
        mean, variance = self._given_edges(places)
        region = regions(self._posterior.weight, gate_of(self._posterior.edges, places))
        values, errors = [], []
        for k in (0, 1):
            value, error = _mixture(mean[k], variance[k], self._posterior.weight[:, None], self._offset(k))
            values.append(value.reshape(f.shape))
            errors.append((error * np.sqrt(self._inflation[k] @ region)).reshape(f.shape))
        return SurrogateValues(values[0], values[1], errors[0], errors[1])

    def field(
        self, frequency: ArrayLike, intensity: ArrayLike, outside: Literal["refuse", "mark"] = "refuse"
    ) -> xr.Dataset:
        """Effective field on a grid.

        Args:
            frequency: [Hz], ascending, shape (frequency,).
            intensity: Gamma [-], ascending, shape (intensity,).
            outside: "refuse" raises where the grid leaves the convex hull of the points in ln f, ln Gamma; "mark" gives
                NaN and Status.NOT_COVERED there.

        Raises:
            InputError: an unknown policy, a grid outside the points, or one outside altogether.
        """
        if outside not in ("refuse", "mark"):
            raise InputError(f"outside is {outside!r}; allowed are 'refuse', 'mark'")
        f, gamma = np.asarray(frequency, float), np.asarray(intensity, float)
        values = self.predict(f[:, None], gamma[None])
        covered = self.covers(f[:, None], gamma[None])
        if outside == "refuse" and not covered.all():
            i, j = np.argwhere(~covered)[0]
            raise InputError(
                f"{f[i]:.4g} Hz, intensity {gamma[j]:.4g} is outside the points of the surrogate "
                f"({self.frequency.min():.4g} to {self.frequency.max():.4g} Hz, {self.intensity.min():.4g} to "
                f"{self.intensity.max():.4g}); add points there, or mark it with outside = 'mark'"
            )
        eta, mass, eta_se, mass_se = (np.where(covered, value, np.nan) for value in values)
        return make_field(
            f,
            gamma,
            np.maximum(eta, 0.0),
            mass,
            self.bed_mass,
            source=f"Gaussian process surrogate of {len(self.frequency)} points ({self.source})",
            variables={
                "loss_factor_se": eta_se,
                "effective_mass_ratio_se": mass_se,
                "status": np.where(covered, 0, int(Status.NOT_COVERED)),
            },
        )

    def covers(self, frequency: ArrayLike, intensity: ArrayLike) -> NDArray[np.bool_]:
        """True inside the convex hull of the points in ln f, ln Gamma; broadcast shape.

        Raises:
            InputError: the points lie on one line.
        """
        from scipy.spatial import ConvexHull, QhullError

        f, gamma = np.broadcast_arrays(np.asarray(frequency, float), np.asarray(intensity, float))
        try:
            hull = ConvexHull(np.log(np.column_stack([self.frequency, self.intensity])))
        except QhullError:
            raise InputError("the points of the surrogate lie on one line and span no area; add others") from None
        place = np.log(np.stack([f, gamma], axis=-1))
        inside = place @ hull.equations[:, :2].T + hull.equations[:, 2] <= 1e-9
        return np.asarray(inside.all(axis=-1))

    def edge(self, frequency: ArrayLike) -> Edge:
        """Intensity at which collect and collide begins, at frequencies [Hz] of any shape."""
        f = np.asarray(frequency, float)
        edges, weight = self._posterior.edges, self._posterior.weight
        real = edges[:, 0] < NO_EDGE
        probability = min(1.0, float(weight[real].sum()))
        if probability < 0.5:
            return Edge(np.full(f.shape, np.nan), np.full(f.shape, np.nan), probability)
        edges, weight = edges[real], weight[real] / probability
        base = np.log(self.optimum * (2 * np.pi * f) ** 2 / STANDARD_GRAVITY)
        line = base[..., None] + threshold(edges, np.log(f / 100.0)[..., None])
        mean = line @ weight
        # A transition of logistic shape has a standard deviation of pi / sqrt(3) times its width.
        spread = ((line - mean[..., None]) ** 2 + (edges[:, 3] * np.pi) ** 2 / 3.0) @ weight
        order = np.argsort(line, axis=-1)
        share = np.cumsum(weight[order], axis=-1)
        middle = np.take_along_axis(order, np.argmax(share >= 0.5, axis=-1)[..., None], axis=-1)
        median = np.take_along_axis(line, middle, axis=-1)[..., 0]
        return Edge(np.exp(median), np.sqrt(spread), probability)

    def leave_one_out(self) -> LeaveOneOut:
        """Residual of every point from the prediction of all others, by formula, for fixed hyperparameters.

        Given an edge, the inverse K^-1 of the covariance of the points yields all of them: y_i - [K^-1 y]_i / [K^-1]_ii
        with variance 1 / [K^-1]_ii. The weight of an edge without point i is its weight over the density it predicts
        for point i, so that the mixture, too, is exact.

        Source: Rasmussen & Williams (2006), Eqs 5.10 to 5.12; Dubrule (1983), Math. Geology 15, 687-699.
        """
        posterior = self._posterior
        transformed, _ = self._transformed()
        means, variances = [], []
        log_density = np.zeros(posterior.coefficient[0].shape)
        for k in (0, 1):
            precision = np.diagonal(posterior.inverse[k], axis1=1, axis2=2)
            residual = posterior.coefficient[k] / precision
            means.append(transformed[k] - residual)
            variances.append(1.0 / precision)
            log_density += 0.5 * (np.log(precision / (2 * np.pi)) - precision * residual**2)
        log_weight = np.log(posterior.weight)[:, None] - log_density
        weight = np.exp(log_weight - log_weight.max(axis=0))
        weight /= weight.sum(axis=0)
        eta, eta_sd = _mixture(means[0], variances[0], weight, self._offset(0))
        mass, mass_sd = _mixture(means[1], variances[1], weight, None)
        density = np.log((weight * np.exp(log_density)).sum(axis=0)) - self._log_derivative()
        return LeaveOneOut(self.values[0] - eta, self.values[1] - mass, eta_sd, mass_sd, density)

    def joint(self, frequency: ArrayLike, intensity: ArrayLike, error: float = DEFAULT_ERROR) -> Joint:
        """What the values at some places say about each other: frequencies [Hz] and intensities [-] of shape (place,).

        Covariances are those of the mixture: the mean over the edges of what each predicts, plus that of their means,
        so that two places between which an edge may lie vary together. Inflation is not in it.

        Args:
            frequency: [Hz].
            intensity: Gamma [-].
            error: standard error of a run over max(eta, 0.05) [-].
        """
        places = self._places(np.asarray(frequency, float), np.asarray(intensity, float))
        points = self._places(self.frequency, self.intensity)
        posterior = self._posterior
        gate_points, gate = gate_of(posterior.edges, points), gate_of(posterior.edges, places)
        mean, _ = self._given_edges(places)
        middle = [posterior.weight @ mean[k] for k in (0, 1)]
        offset = self._offset(0)
        eta = middle[0] if offset is None else np.exp(middle[0]) - offset
        run = error * np.maximum(eta, SMALLEST_ETA)
        covariances, noises = [], []
        for k in (0, 1):
            prior, cross = self._regime_covariances(k, places, places), self._regime_covariances(k, places, points)
            total = np.zeros((len(eta), len(eta)))
            for e, weight in enumerate(posterior.weight):
                here, there = gate[e : e + 1], gate_points[e : e + 1]
                known = gated(here, there, *cross)[0]
                away = mean[k][e] - middle[k]
                part = gated(here, here, *prior)[0] - known @ posterior.inverse[k][e] @ known.T
                total += weight * (part + np.outer(away, away))
            covariances.append(total)
            noise = (run / np.exp(middle[0])) ** 2 if k == 0 and offset is not None else run**2
            noises.append(noise + posterior.weight @ self._nugget(k, self._theta[k], places, gate))
        return Joint((covariances[0], covariances[1]), (noises[0], noises[1]))

    def _offset(self, k: int) -> float | None:
        return self.form.offset if k == 0 and np.isfinite(self.form.offset) else None

    def _log_derivative(self) -> Real:
        """Logarithm of d eta / d(transformed eta): turns a density of the transformed eta into one of eta."""
        offset = self._offset(0)
        return np.zeros(self.values.shape[1]) if offset is None else _logged(self.values[0], offset)

    def _transformed(self) -> tuple[Real, Real]:
        """Values and standard errors in which the processes work; both (quantity, point)."""
        values, errors = self.values.copy(), self.errors.copy()
        offset = self._offset(0)
        if offset is not None:
            values[0] = _logged(values[0], offset)
            errors[0] = errors[0] / np.exp(values[0])
        return values, errors

    def _places(self, frequency: Real, intensity: Real) -> Places:
        f, gamma = np.log(frequency / 100.0), np.log(intensity)
        stretched = gamma + (self.stretch - 1.0) * 0.25 * np.tanh((gamma - 0.1) / 0.25)
        stroke = np.log(stroke_of(frequency, intensity) / self.optimum)
        return Places(np.column_stack([f, stretched]), np.column_stack([stroke, f]), gamma)

    def _mean(self, k: int, places: Places, gate: Real) -> Real:
        """Mean function, shape of gate (edge, point)."""
        quantity = self._quantities[k]
        above: Real | float = quantity.level_above
        if self.clearance_factor is not None and self._table is not None:
            theory = np.interp(places.stroke - np.log(self.clearance_factor), self._table[0], self._table[quantity.row])
            offset = self._offset(k)
            above = theory if offset is None else np.log(theory + offset)
        return (1.0 - gate) * quantity.level_below * self._fade(k, places) + gate * above

    def _fade(self, k: int, places: Places) -> Real:
        """Size of the process below the edge, and of its nugget, at each place [-]; (point,)."""
        if k == 0 or not self.form.has_fade:
            return np.ones_like(places.intensity)
        return np.asarray(1.0 / (1.0 + np.exp(places.intensity) / FADE))

    def _processes(self, k: int) -> tuple[Any, Any]:
        return kernels(self._theta[k], self.form.smoothness)

    def _trends(self, k: int, places: Places) -> tuple[Real, Real]:
        """Functions with coefficients of unit variance: level and slope below the edge, level above; (trend, point)."""
        sd = self._quantities[k].level_sd
        one, fade = np.ones_like(places.intensity), self._fade(k, places)
        level_above = sd if self.clearance_factor is None else 0.3
        return sd * fade * np.stack([one, 0.5 * places.intensity]), level_above * one[None]

    def _regime_covariances(self, k: int, first: Places, second: Places) -> tuple[Real, Real]:
        below, above = self._processes(k)
        trends = zip(self._trends(k, first), self._trends(k, second), strict=True)
        linear_below, linear_above = (a.T @ b for a, b in trends)
        faded = np.outer(self._fade(k, first), self._fade(k, second))
        return faded * below(first.below, second.below) + linear_below, above(first.above, second.above) + linear_above

    def _nugget(self, k: int, theta: Real, places: Places, gate: Real) -> Real:
        """Variance that the standard errors miss at each point; (edge, point)."""
        return np.asarray(np.exp(2.0 * theta[6]) * (((1.0 - gate) * self._fade(k, places)) ** 2 + gate**2))

    def _systems(self, edges: Real) -> Iterator[tuple[Real, list[tuple[Real, Real]]]]:
        """For some edges at a time: log priors, and for eta and m' the points' covariances and values less mean."""
        places = self._places(self.frequency, self.intensity)
        values, errors = self._transformed()
        regimes = [self._regime_covariances(k, places, places) for k in (0, 1)]
        for start in range(0, len(edges), _CHUNK):
            part = edges[start : start + _CHUNK]
            gate = gate_of(part, places)
            systems = []
            for k in (0, 1):
                covariance = gated(gate, gate, *regimes[k])
                noise = errors[k] ** 2 + self._nugget(k, self._theta[k], places, gate)
                covariance[:, range(len(noise[0])), range(len(noise[0]))] += noise
                systems.append((covariance, values[k] - self._mean(k, places, gate)))
            yield part[:, 4], systems

    def _log_weights(self, edges: Real) -> Real:
        """Log prior plus log marginal likelihood of each edge, up to a constant; (edge,)."""
        from scipy.linalg.lapack import dposv

        parts = []
        for log_weight, systems in self._systems(edges):
            for covariances, residuals in systems:
                fits = []
                for covariance, residual in zip(covariances, residuals, strict=True):
                    factor, coefficient, failed = dposv(covariance, residual)
                    assert not failed, "the nugget keeps covariances positive definite"
                    fits.append(0.5 * (residual @ coefficient) + np.log(np.diagonal(factor)).sum())
                log_weight = log_weight - np.array(fits)
            parts.append(log_weight)
        return np.concatenate(parts)

    def _conditioned(self, edges: Real) -> _Posterior:
        inverse: tuple[list[Real], list[Real]] = ([], [])
        coefficient: tuple[list[Real], list[Real]] = ([], [])
        for _, systems in self._systems(edges):
            for k, (covariance, residual) in enumerate(systems):
                inverse[k].append(np.asarray(np.linalg.inv(covariance), np.float64))
                coefficient[k].append((inverse[k][-1] @ residual[..., None])[..., 0])
        log_weight = self._log_weights(edges)
        weight = np.exp(log_weight - log_weight.max())
        return _Posterior(
            edges,
            weight / weight.sum(),
            (np.concatenate(inverse[0]), np.concatenate(inverse[1])),
            (np.concatenate(coefficient[0]), np.concatenate(coefficient[1])),
        )

    def _evidence(self, log_weights: Real) -> float:
        """Log marginal likelihood over the edges, times the prior density of the hyperparameters."""
        best = log_weights.max()
        penalty = 0.0
        for quantity, theta in zip(self._quantities, self._theta, strict=True):
            centre, spread = prior(quantity)
            penalty += 0.5 * float(np.sum(((theta - centre) / spread) ** 2))
        return float(best + np.log(np.sum(np.exp(log_weights - best))) - penalty)

    def _choose(self) -> None:
        """Hyperparameters, stretch of ln Gamma and mean function of the largest marginal likelihood."""
        edges = self._fitted(rounds=2)
        evidence = self._evidence(self._log_weights(edges))
        if self.form.has_stretch:
            plain = self._theta
            self.stretch = 3.0
            self._theta = [self._maximised(k, edges[0]) for k in (0, 1)]
            if self._evidence(self._log_weights(edges)) <= evidence:
                self.stretch, self._theta = 1.0, plain
        if self._table is not None:
            found: dict[float | None, float] = {}
            for factor in (None, *CLEARANCE_FACTORS):
                self.clearance_factor = factor
                found[factor] = self._evidence(self._log_weights(edges))
            self.clearance_factor = max(found, key=lambda factor: found[factor])
        self._theta = [self._maximised(k, edges[0]) for k in (0, 1)]

    def _fitted(self, rounds: int) -> Real:
        """Fit hyperparameters to the most probable edge and find that edge again; probable edges, the best first."""
        order = np.argsort(-self._log_weights(self._lattice), kind="stable")
        for _ in range(rounds):
            best = order[0]
            self._theta = [self._maximised(k, self._lattice[best]) for k in (0, 1)]
            order = np.argsort(-self._log_weights(self._lattice), kind="stable")
            if order[0] == best:
                break
        return self._lattice[order[:_CHUNK]]

    def _refined(self) -> Real:
        """Probable edges of a finer lattice that spans those of the coarse one."""
        coarse = probable(self._lattice, self._log_weights(self._lattice), 1e-3)
        real = coarse[coarse[:, 0] < NO_EDGE]
        if not len(real):
            return coarse
        margin = np.array([EDGE_STEP, 0.1])
        low, high = real[:, :2].min(axis=0) - margin, real[:, :2].max(axis=0) + margin
        position, slope = np.linspace(low[0], high[0], 19), np.linspace(low[1], high[1], 7)
        fine = lattice_of(position, slope, CURVATURES, WIDTHS, self._is_free)
        edges = np.concatenate([coarse[coarse[:, 0] == NO_EDGE], fine])
        return probable(edges, self._log_weights(edges), _FEWEST_WEIGHT, _MOST_EDGES)

    def _maximised(self, k: int, edge: Real) -> Real:
        """Hyperparameters of the largest marginal likelihood times prior, given an edge, from where they are.

        The search stops after 60 steps; a search that has not converged by then still returns its best, which the
        prior keeps sensible, so that is no cause for a warning.
        """
        from scipy.optimize import minimize

        places = self._places(self.frequency, self.intensity)
        gate = gate_of(edge[None], places)
        values, errors = self._transformed()
        residual = (values[k] - self._mean(k, places, gate))[0]
        shares = [np.outer(1.0 - gate[0], 1.0 - gate[0]), np.outer(gate[0], gate[0])]
        trends = self._trends(k, places)
        fixed = sum(share * (trend.T @ trend) for share, trend in zip(shares, trends, strict=True))
        fade = self._fade(k, places)
        shares[0] = shares[0] * np.outer(fade, fade)
        fixed = fixed + np.diag(errors[k] ** 2)
        centre, spread = prior(self._quantities[k])

        def cost(theta: Real) -> tuple[float, Real]:
            nugget = self._nugget(k, theta, places, gate)[0]
            covariance = fixed + np.diag(nugget)
            slopes = []
            coordinates = places.below, places.above
            for process, place, share in zip(kernels(theta, self.form.smoothness), coordinates, shares, strict=True):
                part, slope = process(place, eval_gradient=True)
                covariance = covariance + share * part
                slopes.append((share, slope))
            inverse = np.linalg.inv(covariance)
            coefficient = inverse @ residual
            away = (theta - centre) / spread
            value = 0.5 * (residual @ coefficient + np.linalg.slogdet(covariance)[1] + away @ away)
            sensitivity = 0.5 * (inverse - np.outer(coefficient, coefficient))
            gradient = [np.tensordot(sensitivity * share, slope, axes=2) for share, slope in slopes]
            return float(value), np.concatenate([*gradient, [2.0 * nugget @ np.diagonal(sensitivity)]]) + away / spread

        bounds = np.column_stack([centre - 4.0 * spread, centre + 4.0 * spread])
        found = minimize(cost, self._theta[k], jac=True, method="L-BFGS-B", bounds=bounds, options={"maxiter": 60})
        return np.asarray(found.x)

    def _given_edges(self, places: Places) -> tuple[tuple[Real, Real], tuple[Real, Real]]:
        """Means and variances given each probable edge, for eta (transformed) and m'; (edge, place)."""
        posterior = self._posterior
        points = self._places(self.frequency, self.intensity)
        gate_points, gate = gate_of(posterior.edges, points), gate_of(posterior.edges, places)
        means, variances = [], []
        for k in (0, 1):
            cross = gated(gate, gate_points, *self._regime_covariances(k, places, points))
            below, above = self._processes(k)
            trend_below, trend_above = self._trends(k, places)
            faded = self._fade(k, places) ** 2 * below.diag(places.below)
            prior = (1.0 - gate) ** 2 * (faded + (trend_below**2).sum(axis=0))
            prior += gate**2 * (above.diag(places.above) + (trend_above**2).sum(axis=0))
            explained = np.einsum("cmn,cmn->cm", cross @ posterior.inverse[k], cross)
            means.append(self._mean(k, places, gate) + np.einsum("cmn,cn->cm", cross, posterior.coefficient[k]))
            variances.append(np.maximum(prior - explained, 1e-12))
        return (means[0], means[1]), (variances[0], variances[1])

    def _calibrated(self) -> tuple[Real, Real]:
        """Factors on the predicted variance of eta and m' below, at and above the edge, from leave-one-out residuals.

        Mean square of the standardised residuals of a region (each at most 9), shrunk towards 1 by eight imagined
        points, between 0.5 and 9; a scaled inverse chi-square estimate.
        """
        left = self.leave_one_out()
        gate = gate_of(self._posterior.edges, self._places(self.frequency, self.intensity))
        region = regions(self._posterior.weight, gate)
        factors = []
        for residual, sd in (
            (left.loss_factor_residual, left.loss_factor_sd),
            (left.effective_mass_ratio_residual, left.effective_mass_ratio_sd),
        ):
            square = np.minimum((residual / sd) ** 2, 9.0)
            factors.append(np.clip((8.0 + region @ square) / (8.0 + region.sum(axis=1)), 0.5, 9.0))
        return factors[0], factors[1]


def _usable(points: xr.Dataset) -> tuple[Real, Real, Real, Real]:
    """Frequency, intensity, values and standard errors (both (quantity, point)) of the points that have a value."""
    f, gamma = places_of(points)
    good = ((points["status"].to_numpy() & int(FATAL)) == 0).ravel()
    names = ("loss_factor", "effective_mass_ratio")
    values = np.stack([points[name].to_numpy().ravel()[good] for name in names])
    errors = np.stack([points[f"{name}_se"].to_numpy().ravel()[good] for name in names])
    presumed = DEFAULT_ERROR * np.maximum(values[0], SMALLEST_ETA)
    return f.ravel()[good], gamma.ravel()[good], values, np.where(np.isfinite(errors), errors, presumed)


def _logged(eta: Real, offset: float) -> Real:
    """ln(eta + offset); a loss factor that noise has made negative counts as no less than -0.8 offset."""
    return np.asarray(np.log(np.maximum(eta + offset, 0.2 * offset)))


def _mixture(mean: Real, variance: Real, weight: Real, offset: float | None) -> tuple[Real, Real]:
    """Mean and standard deviation of a mixture of normal, or with an offset shifted lognormal, variables; (place,).

    Variances of the logarithm count as 1 at most: far from all points the mean of a lognormal means nothing.
    """
    if offset is not None:
        variance = np.minimum(variance, _LARGEST_LOG_VARIANCE)
        mean = np.exp(mean + variance / 2.0)
        variance = mean**2 * np.expm1(variance)
        mean = mean - offset
    middle = (weight * mean).sum(axis=0)
    return middle, np.sqrt((weight * (variance + (mean - middle) ** 2)).sum(axis=0))
