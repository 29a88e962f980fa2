"""The modal model of any described structure, at the points that a user names."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from graindamp.errors import InputError
from graindamp.spec.structure import BeamSpec, ModalSpec, PointMassSpec, UffSpec
from graindamp.structure.modal import ModalModel, beam_modal_model, modal_model, point_index
from graindamp.structure.uff import uff_modal_model
from graindamp.units import to_si


def modal_model_of(
    spec: BeamSpec | ModalSpec | UffSpec,
    points: Mapping[str, float | str],
    extra_masses: Sequence[PointMassSpec] = (),
    folder: str | Path = ".",
) -> ModalModel:
    """Modal model of the structure, with `points` as its points.

    Args:
        spec: the structure.
        points: what each name stands for: on a beam a position [m], else the name of a point of the modes. There, a
            direction turned round, as in '101Z-' where the modes have '101Z+', changes the sign.
        extra_masses: bodies fixed to a beam besides those of `spec`, such as damper containers.
        folder: what the file of a universal file is relative to.

    Raises:
        InputError: a point that does not exist, a position in place of a name or the reverse, extra masses on a
            structure that is not a beam, or whatever is wrong with the structure itself.
    """
    if isinstance(spec, BeamSpec):
        return beam_modal_model(spec, _positions(points), extra_masses)
    if any(extra.mass > 0 or extra.rotary_inertia > 0 for extra in extra_masses):
        raise InputError(
            f"a mass cannot be added to a structure of kind '{spec.kind}': its modes are fixed. Take modes that "
            "include the empty container, and leave the mass out here"
        )
    if isinstance(spec, ModalSpec):
        return select_points(modal_model(spec), points)
    return select_points(uff_modal_model(Path(folder) / spec.file, spec.damping), points)


def place_on(point: str | float, is_beam: bool, key: str) -> float | str:
    """A described point as :func:`modal_model_of` takes it: a position [m] on a beam, else a name.

    Raises:
        InputError: not a position although the structure is a beam; `key` opens the message.
    """
    if not is_beam:
        return point if isinstance(point, str) else str(point)
    try:
        return to_si(point, "m")
    except ValueError as error:
        raise InputError(f"{key}: given {point!r}; on a beam a point is a position; {error}") from None


def _positions(points: Mapping[str, float | str]) -> dict[str, float]:
    positions = {}
    for name, place in points.items():
        if isinstance(place, str):
            raise InputError(f"point '{name}' is given as '{place}'; on a beam it is a position in m")
        positions[name] = place
    return positions


def select_points(model: ModalModel, points: Mapping[str, float | str]) -> ModalModel:
    """The same modes at other points: each name in `points` stands for a point of `model`.

    Raises:
        InputError: a number in place of a name, or no such point.
    """
    row, sign = [], []
    for name, existing in points.items():
        if not isinstance(existing, str):
            raise InputError(f"point '{name}' is given as the number {existing:g}; name a point of the modes")
        turned = existing[:-1] + {"+": "-", "-": "+"}.get(existing[-1:], existing[-1:])
        reverse = existing not in model.points and turned in model.points
        row.append(point_index(model, turned if reverse else existing))
        sign.append(-1.0 if reverse else 1.0)
    factor = np.array(sign).reshape(-1, 1)
    shape, slope = factor * model.shape[row], factor * model.slope[row]
    return model._replace(shape=shape, slope=slope, points=tuple(points))
