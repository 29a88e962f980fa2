"""Values of a field between its points: linear in log f and log Gamma, with an explicit word on what lies outside.

eta, m' and their standard errors are interpolated one by one. A standard error is interpolated like its value, as if
neighbouring errors were fully correlated: never too small.
"""

import copy
from typing import Literal, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray

from graindamp.errors import InputError
from graindamp.field.schema import check, is_grid, places_of
from graindamp.status import FATAL

Real = NDArray[np.float64]
Outside = Literal["refuse", "constant", "linear"]

_NAMES = ("loss_factor", "effective_mass_ratio", "loss_factor_se", "effective_mass_ratio_se")
_EDGE = 1e-9


class FieldValues(NamedTuple):
    """A field at some operating points; all arrays have the shape of the frequencies and intensities asked for."""

    loss_factor: Real
    """eta [-]; never below 0 where extrapolated."""
    effective_mass_ratio: Real
    """m' [-]."""
    loss_factor_se: Real
    """Standard error of eta [-], NaN where unknown."""
    effective_mass_ratio_se: Real
    """Standard error of m' [-], NaN where unknown."""
    extrapolated: NDArray[np.bool_]
    """True outside the points of the field; standard errors are unknown there (NaN)."""


class FieldBounds(NamedTuple):
    """Least and largest value of a field over rectangles of log f, log Gamma; shape (rectangle,)."""

    loss_factor: tuple[Real, Real]
    effective_mass_ratio: tuple[Real, Real]


class Interpolant:
    """A field as a function of frequency and intensity."""

    def __init__(self, field: xr.Dataset, outside: Outside = "refuse") -> None:
        """Prepare the interpolation of `field`.

        Args:
            field: a valid effective field, grid or scattered. Failed points of a grid that lie between good ones are
                filled in from them; the other failed points are outside the field, and so are the cells they touch.
            outside: "refuse" raises outside the points, "constant" holds the nearest value, "linear" continues the
                outermost slope (as in Meyer & Seifried 2021), eta not below 0. All that lies outside is marked.

        Raises:
            InputError: not a field, unknown policy, or scattered points that span no area.
        """
        check(field)
        if outside not in ("refuse", "constant", "linear"):
            raise InputError(f"outside is {outside!r}; allowed are 'refuse', 'constant', 'linear'")
        self.outside: Outside = outside
        self.bed_mass = float(field.attrs["bed_mass"])
        usable = (field["status"].to_numpy() & int(FATAL)) == 0
        values = np.stack([field[name].to_numpy() for name in _NAMES])
        if is_grid(field):
            x, y = np.log(field["frequency"].to_numpy()), np.log(field["intensity"].to_numpy())
            self._surface: _Grid | _Triangles = _Grid(x, y, *_without_gaps(x, y, values, usable))
        else:
            f, gamma = places_of(field)
            points = np.log(np.column_stack([f[usable], gamma[usable]]))
            self._surface = _Triangles(points, values[:, usable])

    def beyond(self, outside: Outside) -> "Interpolant":
        """The same field with another policy outside its points."""
        other = copy.copy(self)
        other.outside = outside
        return other

    @property
    def frequency_range(self) -> tuple[float, float]:
        """Lowest and highest frequency of the points [Hz]."""
        low, high = np.exp(self._surface.x_range)
        return float(low), float(high)

    @property
    def intensity_range(self) -> tuple[float, float]:
        """Lowest and highest intensity of the points [-]."""
        low, high = np.exp(self._surface.y_range)
        return float(low), float(high)

    def __call__(self, frequency: ArrayLike, intensity: ArrayLike) -> FieldValues:
        """Field at frequencies [Hz] and intensities [-], arrays of one shape or broadcast to one.

        Raises:
            InputError: outside the points, when the policy is to refuse; or values not above 0.
        """
        f, gamma = np.broadcast_arrays(np.asarray(frequency, float), np.asarray(intensity, float))
        if not (np.all(f > 0) and np.all(gamma > 0)):
            raise InputError("frequency [Hz] and intensity [-] must be above 0")
        x, y = np.log(f).ravel(), np.log(gamma).ravel()
        values, beyond = self._surface.evaluate(x, y, linear=self.outside == "linear")
        if self.outside == "refuse" and beyond.any():
            i = int(np.argmax(beyond))
            (f_low, f_high), (g_low, g_high) = self.frequency_range, self.intensity_range
            raise InputError(
                f"{np.exp(x[i]):.4g} Hz, intensity {np.exp(y[i]):.4g} is outside the field ({f_low:g} to {f_high:g} "
                f"Hz, {g_low:g} to {g_high:g}); extend the field, or allow outside = 'constant' or 'linear'"
            )
        shaped = [value.reshape(f.shape) for value in values]
        return FieldValues(shaped[0], shaped[1], shaped[2], shaped[3], beyond.reshape(f.shape))

    def breaks(self) -> tuple[Real, Real]:
        """Values of log f and of log Gamma between which a grid is bilinear; only the range for scattered points."""
        return self._surface.breaks()

    def bounds(self, x: tuple[Real, Real], y: tuple[Real, Real]) -> FieldBounds:
        """Guaranteed bounds over rectangles in log f, log Gamma, each inside one cell of :meth:`breaks`.

        Scattered points with linear extrapolation are the one exception: outside their hull the planes of neighbouring
        edges do not meet, and the bounds hold for each plane only.

        Args:
            x: lower and upper log f of each rectangle, shape (rectangle,).
            y: lower and upper log Gamma likewise.
        """
        low, high = self._surface.bounds(x, y, linear=self.outside == "linear")
        return FieldBounds((low[0], high[0]), (low[1], high[1]))


def _physical(values: Real, beyond: NDArray[np.bool_]) -> Real:
    """Extrapolated loss factors cut off at zero; nobody knows the error of what was extrapolated."""
    values[0] = np.where(beyond, np.maximum(values[0], 0.0), values[0])
    values[2:] = np.where(beyond, np.nan, values[2:])
    return values


def _both_sides(usable: NDArray[np.bool_], axis: int) -> NDArray[np.bool_]:
    """True where good points lie on both sides along an axis."""
    before = np.maximum.accumulate(usable, axis=axis)
    after = np.flip(np.maximum.accumulate(np.flip(usable, axis), axis=axis), axis)
    return np.asarray(before & after)


def _without_gaps(x: Real, y: Real, values: Real, usable: NDArray[np.bool_]) -> tuple[Real, NDArray[np.bool_]]:
    """Values with failed points filled, and which points the field then covers.

    A failed point with good ones on both sides, along either axis, becomes the mean of what they interpolate to; any
    other takes the value of the nearest good point, but stays outside.
    """
    if usable.all():
        return values, usable
    from scipy.spatial import cKDTree

    filled, covered = values.copy(), usable.copy()
    between = [_both_sides(usable, axis) & ~usable for axis in (0, 1)]
    for i, j in np.argwhere(between[0] | between[1]):
        guesses = []
        for axis, along, place, line, good in (
            (x, between[0], i, values[:, :, j], usable[:, j]),
            (y, between[1], j, values[:, i], usable[i]),
        ):
            if along[i, j]:
                guesses.append([np.interp(axis[place], axis[good], row[good]) for row in line])
        filled[:, i, j], covered[i, j] = np.mean(guesses, axis=0), True
    missing, good = np.argwhere(~covered), np.argwhere(usable)
    places = np.column_stack([x[good[:, 0]], y[good[:, 1]]])
    _, nearest = cKDTree(places).query(np.column_stack([x[missing[:, 0]], y[missing[:, 1]]]))
    filled[:, missing[:, 0], missing[:, 1]] = values[:, *good[nearest].T]
    return filled, covered


class _Grid:
    """Bilinear cells; the outer ones continue without end. Beyond a ragged edge the nearest value holds."""

    def __init__(self, x: Real, y: Real, values: Real, covered: NDArray[np.bool_]) -> None:
        self.x, self.y, self.values = x, y, values
        self.missing = (~covered).astype(float) if not covered.all() else None
        self.x_range, self.y_range = (x[0], x[-1]), (y[0], y[-1])

    def evaluate(self, x: Real, y: Real, linear: bool) -> tuple[Real, NDArray[np.bool_]]:
        beyond = (x < self.x[0] - _EDGE) | (x > self.x[-1] + _EDGE)
        beyond |= (y < self.y[0] - _EDGE) | (y > self.y[-1] + _EDGE)
        i, i2, s = _locate(self.x, x, linear)
        j, j2, t = _locate(self.y, y, linear)
        v = self.values
        values = (1 - s) * ((1 - t) * v[:, i, j] + t * v[:, i, j2]) + s * ((1 - t) * v[:, i2, j] + t * v[:, i2, j2])
        if self.missing is not None:
            m, s, t = self.missing, np.clip(s, 0, 1), np.clip(t, 0, 1)
            share = (1 - s) * ((1 - t) * m[i, j] + t * m[i, j2]) + s * ((1 - t) * m[i2, j] + t * m[i2, j2])
            beyond |= share > _EDGE
        return _physical(values, beyond), beyond

    def breaks(self) -> tuple[Real, Real]:
        return self.x, self.y

    def bounds(self, x: tuple[Real, Real], y: tuple[Real, Real], linear: bool) -> tuple[Real, Real]:
        corners = np.stack([self.evaluate(a, b, linear)[0] for a in x for b in y])
        low: Real = corners.min(axis=0)
        high: Real = corners.max(axis=0)
        return low, high


def _locate(axis: Real, x: Real, linear: bool) -> tuple[NDArray[np.int64], NDArray[np.int64], Real]:
    """Lower and upper node of the interval of each x, and the place in it; 0 to 1 inside."""
    if len(axis) == 1:
        zero = np.zeros(len(x), np.int64)
        return zero, zero, np.zeros(len(x))
    i = np.clip(np.searchsorted(axis, x) - 1, 0, len(axis) - 2)
    place = (x - axis[i]) / (axis[i + 1] - axis[i])
    return i, i + 1, place if linear else np.clip(place, 0.0, 1.0)


class _Triangles:
    """Planes over the Delaunay triangles of scattered points; beyond them, those of the nearest edge."""

    def __init__(self, points: Real, values: Real) -> None:
        from scipy.spatial import Delaunay, QhullError

        self.x_range = (points[:, 0].min(), points[:, 0].max())
        self.y_range = (points[:, 1].min(), points[:, 1].max())
        self.values = values
        try:
            self.mesh = Delaunay(points)
            if not np.isfinite(self.mesh.transform).all():  # flat triangles along rows of points
                self.mesh = Delaunay(points, qhull_options="QJ Qbb")
        except (QhullError, ValueError):
            raise InputError(
                f"{len(points)} scattered points span no area over frequency and intensity; at least three that are "
                "not on one line are needed, or a full grid"
            ) from None
        owner, opposite = np.nonzero(self.mesh.neighbors == -1)
        corners = np.array([np.delete(self.mesh.simplices[t], k) for t, k in zip(owner, opposite, strict=True)])
        self.edge_owner, self.edge = owner, points[corners]
        weights = self.mesh.transform[:, :2, :]
        vertex = values[:, self.mesh.simplices]
        gradient = np.einsum("vtk,tkd->vtd", vertex[:, :, :2] - vertex[:, :, 2:], weights)
        self.steepest = np.sqrt(np.sum(gradient**2, axis=2)).max(axis=1)

    def evaluate(self, x: Real, y: Real, linear: bool) -> tuple[Real, NDArray[np.bool_]]:
        query = np.column_stack([x, y])
        triangle = self.mesh.find_simplex(query, tol=_EDGE)
        beyond = triangle < 0
        if beyond.any():
            triangle = triangle.copy()
            triangle[beyond], foot = self._nearest_edge(query[beyond])
            if not linear:
                query[beyond] = foot
        inverse = self.mesh.transform[triangle]
        place = np.einsum("nkd,nd->nk", inverse[:, :2, :], query - inverse[:, 2, :])
        weight = np.column_stack([place, 1 - place.sum(axis=1)])
        values = np.einsum("vnk,nk->vn", self.values[:, self.mesh.simplices[triangle]], weight)
        return _physical(values, beyond), beyond

    def _nearest_edge(self, query: Real) -> tuple[NDArray[np.int64], Real]:
        start, along = self.edge[:, 0], self.edge[:, 1] - self.edge[:, 0]
        offset = query[:, None, :] - start
        place = np.clip(np.einsum("ned,ed->ne", offset, along) / np.einsum("ed,ed->e", along, along), 0, 1)
        foot = start + place[..., None] * along
        nearest = np.argmin(np.sum((query[:, None, :] - foot) ** 2, axis=-1), axis=1)
        return self.edge_owner[nearest], foot[np.arange(len(query)), nearest]

    def breaks(self) -> tuple[Real, Real]:
        return np.array(self.x_range), np.array(self.y_range)

    def bounds(self, x: tuple[Real, Real], y: tuple[Real, Real], linear: bool) -> tuple[Real, Real]:
        """Value at the centre, give or take the steepest gradient of any triangle over half the diagonal."""
        centre, _ = self.evaluate((x[0] + x[1]) / 2, (y[0] + y[1]) / 2, linear)
        reach = self.steepest[:, None] * np.hypot(x[1] - x[0], y[1] - y[0]) / 2
        return centre - reach, centre + reach
