"""From a description to a case: structure with containers, dampers, release and forces."""

from pathlib import Path

import numpy as np

from graindamp.couple.cases import Carried, Case, Force, HarmonicForce, SampledForce, SweptForce, released
from graindamp.dem.excitation import read_series
from graindamp.errors import InputError
from graindamp.spec.cosimulation import CarriedSpec, CosimulationSpec, ForceSpec, HarmonicForceSpec, SweptForceSpec
from graindamp.spec.model import parse_spec, read_toml
from graindamp.spec.simulation import DamperSpec
from graindamp.spec.structure import BeamSpec, PointMassSpec
from graindamp.structure.build import modal_model_of, place_on
from graindamp.structure.modal import ModalModel

RELEASE = "release"


def case_of(spec: CosimulationSpec, folder: Path) -> Case:
    """The case that a description tells of.

    Points of the model are the dampers by name, "release", "force 1" and so on, and the outputs as they are typed.

    Args:
        spec: the description.
        folder: what its files are relative to.

    Raises:
        InputError: a point, file, mode or container mass that cannot be used.
    """
    model = _model_of(spec, folder)
    q = None
    if spec.release is not None:
        q = released(model, RELEASE, spec.release.displacement, _mode_of(spec, model))
    return Case(
        model=model,
        dampers=tuple(
            Carried(_damper_of(carried, folder), carried.name, carried.direction, carried.along, carried.pivot)
            for carried in spec.dampers
        ),
        duration=spec.run.duration,
        q=q,
        forces=tuple(_force_of(force, f"force {number}", folder) for number, force in enumerate(spec.forces, 1)),
        sample_rate=spec.run.sample_rate,
        steps_per_contact=spec.run.steps_per_contact,
        time_step=spec.run.time_step,
        snapshots=spec.run.snapshots,
    )


def output_points(spec: CosimulationSpec) -> tuple[str, ...]:
    """Names of the points whose motion is written down."""
    return (*(carried.name for carried in spec.dampers), *(str(output) for output in spec.outputs))


def _model_of(spec: CosimulationSpec, folder: Path) -> ModalModel:
    is_beam = isinstance(spec.structure, BeamSpec)
    places = {
        carried.name: place_on(carried.point, is_beam, f"dampers '{carried.name}' point") for carried in spec.dampers
    }
    if spec.release is not None:
        places[RELEASE] = place_on(spec.release.point, is_beam, "release.point")
    for number, force in enumerate(spec.forces, 1):
        places[f"force {number}"] = place_on(force.point, is_beam, f"forces[{number}].point")
    for output in spec.outputs:
        places[str(output)] = place_on(output, is_beam, "outputs")
    containers = [
        PointMassSpec(position=_position(places[carried.name], carried), mass=carried.container_mass, name=carried.name)
        for carried in spec.dampers
        if carried.container_mass > 0.0
    ]
    return modal_model_of(spec.structure, places, containers, folder)


def _position(place: float | str, carried: CarriedSpec) -> float:
    if isinstance(place, str):
        raise InputError(
            f"dampers '{carried.name}': container_mass is given, but modes that were typed in or read from a file "
            "cannot take it; use modes of the structure with the empty containers, and leave container_mass out"
        )
    return place


def _mode_of(spec: CosimulationSpec, model: ModalModel) -> int | None:
    """Row of the elastic mode that is released; None for a static shape."""
    assert spec.release is not None
    if spec.release.mode is None:
        return None
    elastic = np.flatnonzero(model.omega > 0.0)
    if spec.release.mode > len(elastic):
        raise InputError(
            f"release.mode is {spec.release.mode}, but the structure has {len(elastic)} elastic modes; raise its "
            "n_mode, or release another"
        )
    return int(elastic[spec.release.mode - 1])


def _damper_of(carried: CarriedSpec, folder: Path) -> DamperSpec:
    if carried.damper is not None:
        return carried.damper
    path = folder / str(carried.file)
    table = read_toml(path).get("damper")
    if not isinstance(table, dict):
        raise InputError(f"{path}: no table [damper]; name a file that describes a damper")
    return parse_spec(table, DamperSpec, f"{path}: damper")


def _force_of(force: ForceSpec, point: str, folder: Path) -> Force:
    if isinstance(force, HarmonicForceSpec):
        return HarmonicForce(point, force.amplitude, force.frequency, force.phase, force.soft_start)
    if isinstance(force, SweptForceSpec):
        return SweptForce(point, force.amplitude, force.start, force.stop, force.duration, force.law, force.soft_start)
    path = folder / force.file
    time, value = read_series(path, force.time_column, force.value_column, force.unit, "N")
    interval = np.diff(time)
    if len(time) < 2 or not (interval > 0.0).all() or np.ptp(interval) > 1e-3 * interval.mean():
        raise InputError(f"{path}: times of a force must ascend in even steps; resample it first")
    # Times are from the start of the run, whatever the first one in the file is.
    return SampledForce(point, value, float(1.0 / interval.mean()))
