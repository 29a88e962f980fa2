"""A simulated run for ParaView and OVITO: particles of every snapshot, the walls, and the mean velocity field."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from graindamp.errors import InputError
from graindamp.report.motion_picture import scenes_of
from graindamp.report.outline import wall_triangles

if TYPE_CHECKING:
    from graindamp.dem.container import Enclosure
    from graindamp.dem.run import Run
    from graindamp.spec.simulation import SimulationSpec


def write_vtk(run: "Run", folder: Path) -> Path:
    """Write particles-00000.vtp and so on, particles.pvd, walls.pvd and, where there is one, velocity-field.vti.

    Everything is in the frame at rest, in which the container moves; the velocity field alone is in the container's
    frame.

    Args:
        run: a run with snapshots.
        folder: made if it is not there.

    Returns:
        The list to open in ParaView, particles.pvd.

    Raises:
        InputError: the run has no snapshots, or a file cannot be written.
    """
    from graindamp.dem.vtk import write_grid, write_particles, write_series

    scenes_of(run)  # says what is missing where there are no snapshots
    _made(folder)
    reach = _reach([shot.position for shot in run.snapshots], run.radius)
    surfaces = wall_triangles(run.spec.damper, run.enclosure, reach)
    triangles = np.concatenate(list(surfaces.values()))
    frames: list[tuple[float, Path | str]] = []
    walls: list[tuple[float, Path | str]] = []
    for k, shot in enumerate(run.snapshots):
        fields = {
            "velocity": np.asarray(shot.velocity + shot.container_velocity, dtype=np.float32),
            "velocity_in_container": np.asarray(shot.velocity, dtype=np.float32),
            "spin": np.asarray(shot.spin, dtype=np.float32),
            "component": np.asarray(run.component, dtype=np.int32),
        }
        path = folder / f"particles-{k:05d}.vtp"
        write_particles(path, shot.position + shot.displacement, run.radius, fields, shot.time)
        frames.append((shot.time, path))
        walls.append((shot.time, _walls(folder / f"walls-{k:05d}.vtp", triangles + shot.displacement)))
    write_series(folder / "walls.pvd", walls)
    field = run.velocity_field
    if field is not None:
        data: dict[str, Any] = {"velocity_in_container": np.asarray(field.velocity)}
        write_grid(folder / "velocity-field.vti", field.origin, np.full(3, field.cell), data)
    return write_series(folder / "particles.pvd", frames)


def write_packing_vtk(spec: "SimulationSpec", packing: Any, enclosure: "Enclosure", folder: Path) -> Path:
    """Write a packed bed as packing.vtp and its walls as walls.vtp.

    Raises:
        InputError: a file cannot be written.
    """
    from graindamp.dem.vtk import write_particles

    _made(folder)
    surfaces = wall_triangles(spec.damper, enclosure, _reach([packing.position], packing.radius))
    _walls(folder / "walls.vtp", np.concatenate(list(surfaces.values())))
    fields = {"component": np.asarray(packing.component, dtype=np.int32)}
    return write_particles(folder / "packing.vtp", packing.position, packing.radius, fields, 0.0)


def _reach(positions: list[Any], radius: Any) -> tuple[Any, Any]:
    low = np.min([np.min(position - radius[:, None], axis=0) for position in positions], axis=0)
    high = np.max([np.max(position + radius[:, None], axis=0) for position in positions], axis=0)
    return low, high


def _walls(path: Path, triangles: Any) -> Path:
    from graindamp.dem.vtk import write_walls

    return write_walls(path, triangles)


def _made(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{folder}: cannot be made ({error.strerror or error})") from None
