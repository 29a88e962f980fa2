"""graindamp: predict and design particle dampers.

The names below are those of ordinary use; each is imported when it is first asked for, so that `import graindamp` costs
nothing. Everything else lives in the modules described in ARCHITECTURE.md.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from graindamp.couple.predict import predict
    from graindamp.dem.packing import pack
    from graindamp.dem.simulate import simulate
    from graindamp.errors import InputError
    from graindamp.field.ideal import ideal_field
    from graindamp.field.interpolate import Interpolant
    from graindamp.field.measured import measure
    from graindamp.field.store import read_field, write_field
    from graindamp.signals.power import analyze
    from graindamp.signals.readers.read import read_records
    from graindamp.spec.measurement import MeasurementSpec
    from graindamp.spec.model import load_spec
    from graindamp.spec.project import ProjectSpec
    from graindamp.spec.simulation import DamperSpec, SimulationSpec

__version__ = "0.1.0"

_HOME = {
    "DamperSpec": "spec.simulation",
    "InputError": "errors",
    "Interpolant": "field.interpolate",
    "MeasurementSpec": "spec.measurement",
    "ProjectSpec": "spec.project",
    "SimulationSpec": "spec.simulation",
    "analyze": "signals.power",
    "ideal_field": "field.ideal",
    "load_spec": "spec.model",
    "measure": "field.measured",
    "pack": "dem.packing",
    "predict": "couple.predict",
    "read_field": "field.store",
    "read_records": "signals.readers.read",
    "simulate": "dem.simulate",
    "write_field": "field.store",
}

__all__ = [
    "DamperSpec",
    "InputError",
    "Interpolant",
    "MeasurementSpec",
    "ProjectSpec",
    "SimulationSpec",
    "analyze",
    "ideal_field",
    "load_spec",
    "measure",
    "pack",
    "predict",
    "read_field",
    "read_records",
    "simulate",
    "write_field",
]


def __getattr__(name: str) -> Any:
    if name in _HOME:
        return getattr(import_module(f"graindamp.{_HOME[name]}"), name)
    raise AttributeError(f"module 'graindamp' has no attribute {name!r}")


def __dir__() -> list[str]:
    return [*__all__, "__version__"]
