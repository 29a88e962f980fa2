"""Modes from a universal file: real normal modes in datasets 55, as finite element and test software write them."""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graindamp.errors import InputError
from graindamp.spec.structure import DampingSpec
from graindamp.structure.modal import ModalModel, modal_damping

DIRECTIONS = ("X", "Y", "Z", "RX", "RY", "RZ")
"""Names of the six components of a node, three translations and three rotations."""

RIGID_FREQUENCY = 1e-4
"""A mode below this part of the highest frequency in the file is a rigid-body mode [-]: its frequency is rounding."""

_NORMAL_MODE = 2
_COMPLEX_MODES = (3, 7)
_MOTIONS = (0, 1, 8, 11, 12)  # unknown, general, displacement, velocity, acceleration; not stress, strain, energy


def uff_modal_model(path: str | Path, damping: DampingSpec | None = None) -> ModalModel:
    """Modes of a universal file, in SI and with unit modal mass.

    Each component of each node is a point, named '101Z+' for the translation of node 101 along its Z axis and '101RZ+'
    for the rotation about it [rad m^-1 kg^-1/2], which is given with six components per node. Axes are those in which
    the node reports its displacements. A node left out of a mode is at rest in it, as the format has it. Units of a
    dataset 164 are converted, so a model in t, mm, s gives the same as one in SI; without one the file counts as SI.

    Args:
        path: the universal file.
        damping: in place of the file's damping ratios. The file's viscous ratio counts where there is one, else half of
            the hysteretic one, which is the same at resonance.

    Raises:
        InputError: no such file, not a universal file, no normal modes in it, complex modes, a modal mass that is not
            positive, or a list of damping ratios too short.

    Source: University of Cincinnati, Structural Dynamics Research Lab, Universal File Format, datasets 55 and 164.
    """
    path = Path(path)
    datasets, (length_unit, mass_unit) = _read(path)
    modes = sorted(_normal_modes(path, datasets), key=lambda mode: float(mode["freq"]))
    frequency = np.array([float(mode["freq"]) for mode in modes])
    frequency[abs(frequency) <= RIGID_FREQUENCY * abs(frequency).max()] = 0.0
    if not np.isfinite(frequency).all() or (frequency < 0).any():
        raise InputError(f"{path}: a mode has frequency {frequency.min():g} Hz; natural frequencies are not negative")
    modal_mass = np.array([float(mode["modal_m"]) for mode in modes])
    if not (modal_mass > 0).all():
        worst = int(np.argmin(modal_mass > 0))
        raise InputError(
            f"{path}: mode {modes[worst]['mode_n']} has modal mass {modal_mass[worst]:g}, so its shape has no scale; "
            "export the modes again with their modal masses"
        )
    points, shape = _shapes(modes)
    shape /= np.sqrt(modal_mass * mass_unit)
    rotations = np.array([point[:-1].endswith(DIRECTIONS[3:]) for point in points])
    shape[rotations] /= length_unit
    omega = 2 * np.pi * frequency
    if damping is not None:
        d = modal_damping(damping, omega)
    else:
        viscous = np.array([float(mode["modal_damp_vis"]) for mode in modes])
        hysteretic = np.array([float(mode["modal_damp_his"]) for mode in modes])
        d = 2 * np.where(viscous > 0, viscous, hysteretic / 2) * omega
    return ModalModel(omega, d, shape, np.full_like(shape, np.nan), points)


def _read(path: Path) -> tuple[list[dict[str, Any]], tuple[float, float]]:
    """Datasets 55 of the file, and its units of length [m] and mass [kg]."""
    import pyuff

    if not path.is_file():
        raise InputError(f"{path}: there is no such file")
    try:
        file = pyuff.UFF(str(path))
        kinds = [int(kind) for kind in file.get_set_types()]
    except Exception as error:  # pyuff raises bare Exceptions
        raise InputError(f"{path}: cannot be read as a universal file ({error})") from None
    if not any(kinds):
        raise InputError(f"{path}: is not a universal file; its datasets would stand between lines of '    -1'")
    if 55 not in kinds:
        present = ", ".join(str(kind) for kind in sorted(set(kinds) - {0}))
        raise InputError(f"{path}: has no dataset 55 with mode shapes, only {present}; export the modes with it")
    units = (1.0, 1.0)
    datasets = []
    for number, kind in enumerate(kinds):
        if kind not in (55, 164):
            continue
        try:
            dataset = file.read_sets(number)
        except Exception:  # as above
            raise InputError(
                f"{path}: dataset {number + 1}, of type {kind}, cannot be read; of type 55 it must be real normal "
                "modes with 3 or 6 values at each node"
            ) from None
        if kind == 55:
            datasets.append(dataset)
        else:  # the file gives its units per metre and per newton
            units = 1 / dataset["length"], dataset["length"] / dataset["force"]
    return datasets, units


def _normal_modes(path: Path, datasets: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Those datasets that are real shapes of normal modes; complains where none is."""
    modes = [
        dataset
        for dataset in datasets
        if dataset["analysis_type"] == _NORMAL_MODE
        and dataset["spec_data_type"] in _MOTIONS
        and dataset["data_type"] == 2
        and dataset["n_data_per_node"] in (3, 6)
    ]
    if modes:
        return modes
    if any(dataset["analysis_type"] in _COMPLEX_MODES or dataset["data_type"] == 5 for dataset in datasets):
        raise InputError(
            f"{path}: its modes are complex; real normal modes are needed: export those of the undamped structure, or "
            "let the modal analysis give real modes"
        )
    found = sorted({(d["analysis_type"], d["spec_data_type"], d["n_data_per_node"]) for d in datasets})
    raise InputError(
        f"{path}: no dataset 55 holds normal modes (analysis type 2, motion, 3 or 6 values at each node); "
        f"found (analysis type, data type, values) {found}"
    )


def _shapes(modes: list[dict[str, Any]]) -> tuple[tuple[str, ...], NDArray[np.float64]]:
    """Names of all components of all nodes (point,), and their values in the unit of the file (point, mode)."""
    nodes = np.unique(np.concatenate([mode["node_nums"] for mode in modes]))
    n_component = max(int(mode["n_data_per_node"]) for mode in modes)
    value = np.zeros((nodes.size, n_component, len(modes)))
    for number, mode in enumerate(modes):
        row = np.searchsorted(nodes, mode["node_nums"])
        for component in range(int(mode["n_data_per_node"])):
            value[row, component, number] = mode[f"r{component + 1}"]
    points = tuple(f"{node}{direction}+" for node in nodes for direction in DIRECTIONS[:n_component])
    return points, value.reshape(-1, len(modes))
