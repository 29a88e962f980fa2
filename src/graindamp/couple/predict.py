"""A whole prediction: structure and fields read, every mode solved, response and studies on top."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from graindamp.couple.balance import Attached
from graindamp.couple.equilibrium import ModeResult, solve_mode
from graindamp.couple.fixed_point import FixedPoint, solve_fixed_point
from graindamp.couple.response import Response, respond, response_grid
from graindamp.couple.single_mode import load_mode
from graindamp.errors import InputError
from graindamp.field.ideal import ideal_field
from graindamp.field.interpolate import Interpolant
from graindamp.field.remarks import remarks_on
from graindamp.field.store import read_field
from graindamp.spec.project import AttachedSpec, IdealFieldSpec, ProjectSpec
from graindamp.spec.structure import BeamSpec, PointMassSpec
from graindamp.status import Status
from graindamp.structure.build import modal_model_of, place_on
from graindamp.structure.modal import ModalModel

Real = NDArray[np.float64]
Progress = Callable[[str], None]

DRIVE, OUTPUT = "drive", "output"


class ModePrediction(NamedTuple):
    """One mode under one force, solved both ways."""

    result: ModeResult
    fixed_point: FixedPoint | None
    """None where the force does not excite the mode or no damper moves with it."""


class Study(NamedTuple):
    """Every mode over forces or positions; axis 0 is the value varied."""

    name: str
    """'force [N]' or 'position [m]'."""
    value: Real
    predictions: tuple[tuple[ModeResult, ...], ...]
    """(value, mode)."""


class ShapeCurves(NamedTuple):
    """Mode shapes along a beam that carries its containers."""

    position: Real
    """[m], shape (position,)."""
    shape: Real
    """Mass-normalised [kg^-1/2], elastic modes only, shape (position, mode)."""


class Prediction(NamedTuple):
    """All that was asked of a project."""

    title: str
    model: ModalModel
    """Structure with containers, without beds; points are the drive, the output and each damper by name."""
    dampers: tuple[Attached, ...]
    fields: tuple[xr.Dataset, ...]
    """Field of each damper."""
    forces: tuple[float, ...]
    """[N]."""
    modes: tuple[tuple[ModePrediction, ...], ...]
    """(force, mode)."""
    responses: tuple[tuple[Response, Response], ...]
    """Upward and downward sweep of each force; empty where none was asked for."""
    studies: tuple[Study, ...]
    places: dict[str, float | str]
    """Position [m] or point of the modes of the drive and of each damper, by name."""
    shapes: ShapeCurves | None
    """Mode shapes of a beam; None for modes that were typed in or read."""
    warnings: tuple[str, ...]


def predict(project: ProjectSpec, folder: str | Path = ".", progress: Progress = lambda text: None) -> Prediction:
    """Solve a project.

    Args:
        project: what to compute.
        folder: what the files of the project are relative to.
        progress: told what is going on, a line each.

    Raises:
        InputError: a field, point, position or structure that cannot be used.
    """
    fields = tuple(_field_of(damper, Path(folder)) for damper in project.dampers)
    model = _model_of(project, folder)
    dampers = tuple(
        Attached(spec.name, spec.name, Interpolant(field, project.outside), spec.bed_mass or field.attrs["bed_mass"])
        for spec, field in zip(project.dampers, fields, strict=True)
    )
    if not np.any(model.omega > 0):
        raise InputError("the structure has no elastic mode; nothing can resonate")
    modes = []
    for force in project.drive.forces:
        progress(f"modes at {force:g} N")
        modes.append(
            tuple(_solve_both(model, mode, force, dampers) for mode in np.flatnonzero(model.omega > 0).tolist())
        )
    responses = []
    if project.response is not None:
        for force, solved in zip(project.drive.forces, modes, strict=True):
            progress(f"response at {force:g} N")
            grid = response_grid(project.response.band, [mode.result for mode in solved], project.response.n_frequency)
            up, down = (respond(model, dampers, DRIVE, OUTPUT, force, grid, way) for way in ("up", "down"))
            responses.append((up, down))
    return Prediction(
        project.title,
        model,
        dampers,
        fields,
        project.drive.forces,
        tuple(modes),
        tuple(responses),
        tuple(_studies(project, model, dampers, folder, progress)),
        {name: place for name, place in _named_places(project, None).items() if name != OUTPUT},
        _shapes(project, folder),
        (*_of_fields(project.dampers, fields), *_warnings(modes, model)),
    )


def _field_of(damper: AttachedSpec, folder: Path) -> xr.Dataset:
    if damper.ideal is None:
        return read_field(folder / str(damper.field), damper.bed_mass)
    ideal: IdealFieldSpec = damper.ideal
    return ideal_field(
        ideal.motion,
        np.geomspace(*ideal.frequency_range, ideal.n_point),
        np.geomspace(*ideal.intensity_range, ideal.n_point),
        damper.bed_mass or 0.0,
        clearance=ideal.clearance,
        restitution=ideal.restitution,
        friction=ideal.friction,
    )


def _model_of(project: ProjectSpec, folder: str | Path, first_position: float | None = None) -> ModalModel:
    """Modal model with the containers on it; the first damper at `first_position` [m] if given."""
    places = _named_places(project, first_position)
    return modal_model_of(project.structure, places, _containers(project, places), folder)


def _named_places(project: ProjectSpec, first_position: float | None) -> dict[str, float | str]:
    is_beam = isinstance(project.structure, BeamSpec)
    places: dict[str, float | str] = {
        damper.name: place_on(damper.point, is_beam, f"dampers '{damper.name}' point") for damper in project.dampers
    }
    if first_position is not None:
        places[project.dampers[0].name] = first_position
    output = project.response.output if project.response and project.response.output is not None else None
    places[DRIVE] = place_on(project.drive.point, is_beam, "drive.point")
    places[OUTPUT] = places[project.dampers[0].name] if output is None else place_on(output, is_beam, "response.output")
    return places


def _containers(project: ProjectSpec, places: dict[str, float | str]) -> list[PointMassSpec]:
    """Containers as point masses on the beam."""
    heavy = [damper for damper in project.dampers if damper.container_mass > 0]
    if heavy and not isinstance(project.structure, BeamSpec):
        raise InputError(
            "dampers: container_mass is given, but modes that were typed in or read from a file cannot take it; use "
            "modes of the structure with the empty containers, and leave container_mass out"
        )
    return [
        PointMassSpec(position=float(places[damper.name]), mass=damper.container_mass, name=f"container {damper.name}")
        for damper in heavy
    ]


def _shapes(project: ProjectSpec, folder: str | Path) -> ShapeCurves | None:
    if not isinstance(project.structure, BeamSpec):
        return None
    position = np.linspace(0.0, project.structure.length, 91)
    named = _named_places(project, None) | {f"{k} along": float(x) for k, x in enumerate(position)}
    model = modal_model_of(project.structure, named, _containers(project, named), folder)
    return ShapeCurves(position, model.shape[len(named) - len(position) :, model.omega > 0])


def _solve_both(model: ModalModel, mode: int, force: float, dampers: Sequence[Attached]) -> ModePrediction:
    loaded = load_mode(model, mode, DRIVE, force, dampers)
    result = solve_mode(loaded, len(dampers))
    moves = loaded.dampers and loaded.drive_shape > 0
    return ModePrediction(result, solve_fixed_point(loaded) if moves else None)


def solve_modes_at(model: ModalModel, force: float, dampers: Sequence[Attached]) -> tuple[ModeResult, ...]:
    """All elastic modes of a model under one force amplitude [N] at its point 'drive'."""
    return tuple(
        solve_mode(load_mode(model, mode, DRIVE, force, dampers), len(dampers), with_capacity=False)
        for mode in np.flatnonzero(model.omega > 0).tolist()
    )


def _studies(
    project: ProjectSpec, model: ModalModel, dampers: Sequence[Attached], folder: str | Path, progress: Progress
) -> list[Study]:
    studies = []
    if project.force_study:
        progress(f"force study, {len(project.force_study)} forces")
        forces = np.array(sorted(project.force_study))
        studies.append(Study("force [N]", forces, tuple(solve_modes_at(model, f, dampers) for f in forces)))
    if project.position_study is not None:
        study = project.position_study
        positions = np.linspace(study.start, study.stop, study.n_position)
        rows = []
        for k, position in enumerate(positions):
            progress(f"position study, {k + 1} of {len(positions)}")
            moved = _model_of(project, folder, float(position))
            rows.append(solve_modes_at(moved, project.drive.forces[-1], dampers))
        studies.append(Study("position [m]", positions, tuple(rows)))
    return studies


def _of_fields(dampers: Sequence[AttachedSpec], fields: Sequence[xr.Dataset]) -> list[str]:
    """What is to be known of the fields, once for every field with the names of its dampers."""
    names: dict[tuple[str, str], list[str]] = {}
    for damper, field in zip(dampers, fields, strict=True):
        for remark in (*remarks_on(field), *_bistable(field)):
            names.setdefault((str(damper.field), remark), []).append(damper.name)
    return [f"field of {', '.join(named)}: {remark}" for (_, remark), named in names.items()]


def _bistable(field: xr.Dataset) -> tuple[str, ...]:
    """Whether points of a field have a second answer, which a prediction does not use."""
    marked = (field["status"].to_numpy() & int(Status.BISTABLE)) != 0
    if not marked.any():
        return ()
    return (
        f"{int(marked.sum())} of {marked.size} points depend on where the bed started (BISTABLE); the first answer is "
        "used, 'graindamp show' has the other",
    )


def _warnings(modes: Sequence[Sequence[ModePrediction]], model: ModalModel) -> list[str]:
    lines = []
    for solved in modes:
        for mode in solved:
            result = mode.result
            place = f"mode {result.number} at {result.force:g} N"
            if not result.equilibria:
                lines.append(f"{place}: no equilibrium: {result.reason}")
            elif not result.stable:
                lines.append(f"{place}: no equilibrium is stable")
            elif len(result.stable) > 1:
                ratios = ", ".join(f"{100 * state.damping_ratio:.3g} %" for state in result.stable)
                lines.append(f"{place}: {len(result.stable)} stable equilibria, damping ratios {ratios}")
            if any(state.extrapolated for state in result.equilibria):
                lines.append(f"{place}: uses a field outside its points")
    return lines
