"""Modes: natural frequencies and mass-normalised shapes, from matrices, from a beam, or as typed in."""

import difflib
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from graindamp.errors import InputError
from graindamp.spec.structure import BeamSpec, DampingSpec, ModalSpec, PointMassSpec, RayleighDampingSpec
from graindamp.structure.beam import assemble
from graindamp.structure.eigen import ROUNDING, solve_modes


class ModalModel(NamedTuple):
    """A linear structure as the sum of its modes: all that a coupling needs to know of it.

    Each mode obeys q'' + D_k q' + omega_k^2 q = phi_k f, with q in m kg^1/2; a point moves by the sum of phi_k q_k.
    """

    omega: NDArray[np.float64]
    """Natural angular frequencies without damping [rad/s] (mode,), ascending; exactly 0 for rigid-body modes."""
    damping: NDArray[np.float64]
    """Modal damping D_k = 2 zeta_k omega_k [1/s] (mode,)."""
    shape: NDArray[np.float64]
    """Mass-normalised mode shapes phi [kg^-1/2] (point, mode)."""
    slope: NDArray[np.float64]
    """Rotation of each point per unit modal coordinate [rad m^-1 kg^-1/2] (point, mode); NaN where it is not known."""
    points: tuple[str, ...]
    """Names of the points, (point,)."""


def beam_modal_model(
    spec: BeamSpec, points: Mapping[str, float], extra_masses: Sequence[PointMassSpec] = ()
) -> ModalModel:
    """Modes of a beam at its named points: the rigid-body modes and `spec.n_mode` elastic ones.

    Args:
        spec: the beam.
        points: position of each named point [m], 0 to the length.
        extra_masses: bodies fixed to the beam besides those of `spec`, such as damper containers.

    Raises:
        InputError: a position off the beam, more modes than the beam has, or a list of damping ratios too short.
    """
    beam = assemble(spec, points, extra_masses)
    modes = solve_modes(beam.stiffness, beam.mass, spec.n_mode, precision=ROUNDING)

    def at(row: NDArray[np.intp]) -> NDArray[np.float64]:
        return np.where(row[:, None] < 0, 0.0, modes.vectors[row])

    damping = modal_damping(spec.damping, modes.omega)
    return ModalModel(modes.omega, damping, at(beam.deflection), at(beam.rotation), tuple(points))


def modal_model(spec: ModalSpec) -> ModalModel:
    """Modes as typed in; slopes are not known.

    Raises:
        InputError: a list of damping ratios shorter than the number of elastic modes.
    """
    omega = 2 * np.pi * np.array(spec.frequencies)
    shape = np.array(list(spec.shapes.values()))
    return ModalModel(omega, modal_damping(spec.damping, omega), shape, np.full_like(shape, np.nan), tuple(spec.shapes))


def modal_damping(spec: DampingSpec, omega: NDArray[np.float64]) -> NDArray[np.float64]:
    """Modal damping D_k = 2 zeta_k omega_k [1/s] (mode,).

    A list of ratios counts elastic modes only; those beyond the modes of the model are not used. Rigid-body modes get 0
    from ratios, and alpha from Rayleigh damping.

    Args:
        spec: the damping.
        omega: natural angular frequencies [rad/s] (mode,), 0 for rigid-body modes.

    Raises:
        InputError: fewer ratios than elastic modes.
    """
    if isinstance(spec, RayleighDampingSpec):
        return spec.alpha + spec.beta * omega**2
    elastic = omega > 0
    n_elastic = int(elastic.sum())
    ratio = np.zeros_like(omega)
    if isinstance(spec.ratio, tuple):
        if len(spec.ratio) < n_elastic:
            raise InputError(
                f"damping.ratio lists {len(spec.ratio)} values for {n_elastic} elastic modes; "
                "give one for each, or a single number for all"
            )
        ratio[elastic] = spec.ratio[:n_elastic]
    else:
        ratio[elastic] = spec.ratio
    return 2 * ratio * omega


def point_index(model: ModalModel, name: str) -> int:
    """Row of the point called `name` in `model.shape`.

    Raises:
        InputError: no such point; the message gives the nearest name and the first few there are.
    """
    if name in model.points:
        return model.points.index(name)
    near = difflib.get_close_matches(name, model.points, n=1, cutoff=0.4)
    hint = f"; nearest is '{near[0]}'" if near else ""
    more = f" and {len(model.points) - 12} more" if len(model.points) > 12 else ""
    raise InputError(
        f"the structure has no point '{name}'{hint}; it has {', '.join(model.points[:12]) or 'no points'}{more}"
    )
