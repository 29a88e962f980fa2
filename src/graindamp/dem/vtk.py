"""Files for ParaView and OVITO: particles, walls and fields on a grid in VTK's XML formats, and extended XYZ.

A file appears under its name only when it is whole, so a viewer that watches the folder never meets half of one.

Source: VTK file formats, XML, version 1.0 with 64-bit headers; arrays are uncompressed, base64, inline. Extended XYZ as
in ASE and OVITO.
"""

import base64
import os
import secrets
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO, Any, NamedTuple
from xml.sax.saxutils import quoteattr

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graindamp.errors import InputError

Floats = NDArray[np.float64]

_TYPES = {
    "f4": "Float32", "f8": "Float64", "i1": "Int8", "i2": "Int16", "i4": "Int32", "i8": "Int64",
    "u1": "UInt8", "u2": "UInt16", "u4": "UInt32", "u8": "UInt64",
}  # fmt: skip


class Frame(NamedTuple):
    """The particles at one time."""

    time: float  # [s]
    position: NDArray[Any]  # [m] (particle, 3)
    radius: NDArray[Any]  # [m] (particle,)
    fields: Mapping[str, NDArray[Any]]  # each (particle,) or (particle, 3)


def write_particles(
    path: Path | str, position: ArrayLike, radius: ArrayLike, fields: Mapping[str, ArrayLike], time: float
) -> Path:
    """Writes particles as points with data (.vtp).

    ParaView shows them by its filter Glyph with spheres, scaled by `radius` times 2; OVITO as they are.

    Numbers keep their precision: pass float32 for files of half the size.

    Args:
        path: file to write, ending in .vtp.
        position: centres [m], shape (particle, 3).
        radius: radii [m], shape (particle,).
        fields: further data by name, each of shape (particle,) or (particle, 3).
        time: time of the frame [s].

    Raises:
        InputError: the path ends otherwise or cannot be written.
        ValueError: an array of another length.
    """
    points, radii = _numbers("position", position), np.asarray(radius)
    data = _checked(points, radii, fields)
    one_each = np.arange(len(points), dtype=np.int64)
    with _written(path, ".vtp") as file:
        _begin(file, "PolyData")
        file.write(f'<Piece NumberOfPoints="{len(points)}" NumberOfVerts="{len(points)}" ')
        file.write('NumberOfLines="0" NumberOfStrips="0" NumberOfPolys="0">\n')
        _points(file, points)
        _cells(file, "Verts", one_each, one_each + 1)
        file.write('<PointData Scalars="radius">\n')
        for name, field in data.items():
            file.write(_array(name, field))
        file.write("</PointData>\n</Piece>\n")
        _time(file, time)  # after the piece: OVITO takes a file that begins otherwise for none of its own
        _end(file, "PolyData")
    return Path(path)


def write_walls(path: Path | str, triangle: ArrayLike | None = None, line: ArrayLike | None = None) -> Path:
    """Writes walls as triangles, lines or both (.vtp).

    Args:
        path: file to write, ending in .vtp.
        triangle: corners [m], shape (triangle, 3, 3), such as `MeshFeatures.face_vertex` or from `tessellate_box`.
        line: ends [m], shape (line, 2, 3), such as `MeshFeatures.edge_end`.

    Raises:
        InputError: the path ends otherwise or cannot be written.
    """
    triangles = np.asarray([] if triangle is None else triangle, dtype=np.float64).reshape(-1, 3, 3)
    lines = np.asarray([] if line is None else line, dtype=np.float64).reshape(-1, 2, 3)
    corners = np.concatenate([lines.reshape(-1, 3), triangles.reshape(-1, 3)])
    point, number = np.unique(corners, axis=0, return_inverse=True)
    number = number.ravel().astype(np.int64)
    with _written(path, ".vtp") as file:
        _begin(file, "PolyData")
        file.write(f'<Piece NumberOfPoints="{len(point)}" NumberOfVerts="0" NumberOfLines="{len(lines)}" ')
        file.write(f'NumberOfStrips="0" NumberOfPolys="{len(triangles)}">\n')
        _points(file, point)
        _cells(file, "Lines", number[: 2 * len(lines)], 2 * np.arange(1, len(lines) + 1, dtype=np.int64))
        _cells(file, "Polys", number[2 * len(lines) :], 3 * np.arange(1, len(triangles) + 1, dtype=np.int64))
        file.write("</Piece>\n")
        _end(file, "PolyData")
    return Path(path)


def write_grid(
    path: Path | str, origin: ArrayLike, spacing: ArrayLike, fields: Mapping[str, ArrayLike], time: float | None = None
) -> Path:
    """Writes fields that are constant in each cell of a regular grid (.vti), such as a mean velocity.

    Args:
        path: file to write, ending in .vti.
        origin: lowest corner of the grid [m], (3,).
        spacing: size of a cell [m], (3,).
        fields: data by name, each of shape (nx, ny, nz) or (nx, ny, nz, 3); NaN where there is none.
        time: time of the fields [s], if they have one.

    Raises:
        InputError: the path ends otherwise or cannot be written.
        ValueError: no fields, or fields of different grids.
    """
    data = {name: _numbers(name, field) for name, field in fields.items()}
    shapes = {field.shape[:3] for field in data.values()}
    if len(shapes) != 1 or any(f.ndim not in (3, 4) or f.shape[3:] not in ((), (3,)) for f in data.values()):
        found = {name: field.shape for name, field in data.items()}
        raise ValueError(f"fields have shapes {found}; allowed are (nx, ny, nz) or (nx, ny, nz, 3) on one grid")
    extent = " ".join(f"0 {n}" for n in shapes.pop())
    corner, size = (" ".join(repr(float(x)) for x in np.asarray(v).ravel()) for v in (origin, spacing))
    with _written(path, ".vti") as file:
        _begin(file, "ImageData", f' WholeExtent="{extent}" Origin="{corner}" Spacing="{size}"')
        if time is not None:
            _time(file, time)
        file.write(f'<Piece Extent="{extent}">\n<CellData>\n')
        for name, field in data.items():
            turned = np.moveaxis(field, (0, 1, 2), (2, 1, 0))  # VTK counts along x first
            file.write(_array(name, turned.reshape(-1, *field.shape[3:])))
        file.write("</CellData>\n</Piece>\n")
        _end(file, "ImageData")
    return Path(path)


def write_series(path: Path | str, files: Sequence[tuple[float, Path | str]]) -> Path:
    """Writes the list of the files of a motion (.pvd), which ParaView opens as one animation.

    Args:
        path: file to write, ending in .pvd.
        files: time [s] and file of each frame. A relative path counts from the folder of the list; an absolute one
            within it is made relative, so that the folder can be moved.

    Raises:
        InputError: the path ends otherwise or cannot be written.
    """
    folder = Path(path).absolute().parent
    with _written(path, ".pvd") as file:
        _begin(file, "Collection")
        for time, member in files:
            place = Path(member)
            if place.is_relative_to(folder):
                place = place.relative_to(folder)
            file.write(f'<DataSet timestep="{float(time)!r}" part="0" file={quoteattr(place.as_posix())}/>\n')
        _end(file, "Collection")
    return Path(path)


def write_xyz(path: Path | str, frames: Iterable[Frame]) -> Path:
    """Writes a motion as text in one file (.xyz, extended XYZ), for OVITO; positions and radii in metres.

    Args:
        path: file to write, ending in .xyz.
        frames: the frames in order of time; they may come from a generator and are not kept.

    Raises:
        InputError: the path ends otherwise or cannot be written.
        ValueError: an array of another length, or a name with a space or a colon.
    """
    with _written(path, ".xyz") as file:
        for frame in frames:
            data = _checked(frame.position, frame.radius, frame.fields)
            columns, properties = [np.asarray(frame.position)], ["pos:R:3"]
            for name, field in data.items():
                if any(letter.isspace() or letter in ':="' for letter in name):
                    raise ValueError(f"field {name!r}: extended XYZ does not allow spaces, ':', '=' or '\"' in a name")
                properties.append(
                    f"{name}:{'R' if field.dtype.kind == 'f' else 'I'}:{field.size // max(len(field), 1)}"
                )
                columns.append(field.reshape(len(field), -1))
            file.write(f"{len(frame.position)}\nProperties={':'.join(properties)} Time={float(frame.time)!r}\n")
            rows = [column.tolist() for column in columns]
            for parts in zip(*rows, strict=True):
                file.write(" ".join(repr(x) for part in parts for x in part) + "\n")
    return Path(path)


def tessellate_box(low: Sequence[float], high: Sequence[float]) -> Floats:
    """Triangles of a box between two corners [m], shape (12, 3, 3), counter-clockwise as seen from outside."""
    corner = np.array([[(low, high)[(n >> a) & 1][a] for a in range(3)] for n in range(8)], dtype=np.float64)
    square = np.array([[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]])
    return np.asarray(corner[np.concatenate([square[:, [0, 1, 2]], square[:, [0, 2, 3]]])])


def tessellate_cylinder(
    base: Sequence[float], axis: Sequence[float], radius: float, n_side: int = 64, *, closed: bool = True
) -> Floats:
    """Triangles of a cylinder [m], counter-clockwise as seen from outside; corners lie on the circle.

    Args:
        base: centre of one end [m].
        axis: from there to the centre of the other end [m].
        radius: radius [m].
        n_side: number of plane sides.
        closed: with both ends, 4 n_side triangles; otherwise 2 n_side.
    """
    centre, along = np.asarray(base, dtype=np.float64), np.asarray(axis, dtype=np.float64)
    across = np.cross(along, np.eye(3)[np.argmin(np.abs(along))])
    across /= np.linalg.norm(across)
    angle = 2 * np.pi * np.arange(n_side)[:, None] / n_side
    other = np.cross(along, across) / np.linalg.norm(along)
    low = centre + radius * (np.cos(angle) * across + np.sin(angle) * other)
    low_next = np.roll(low, -1, axis=0)
    high, high_next = low + along, low_next + along
    parts = [(low, low_next, high_next), (low, high_next, high)]
    if closed:
        ends = np.broadcast_to(centre, low.shape), np.broadcast_to(centre + along, low.shape)
        parts += [(ends[0], low_next, low), (ends[1], high, high_next)]
    return np.concatenate([np.stack(part, axis=1) for part in parts])


def tessellate_sphere(centre: Sequence[float], radius: float, n_side: int = 32) -> Floats:
    """Triangles of a sphere [m], counter-clockwise as seen from outside; corners lie on the sphere.

    Args:
        centre: centre [m].
        radius: radius [m].
        n_side: number of sides around the equator, even; half as many from pole to pole.
    """
    polar = np.pi * np.arange(n_side // 2 + 1)[:, None] / (n_side // 2)
    around = 2 * np.pi * np.arange(n_side) / n_side
    ring = np.sin(polar)
    ring[-1] = 0.0  # all corners at a pole are one, to the last bit
    unit = np.stack([ring * np.cos(around), ring * np.sin(around), np.cos(polar) + 0 * around], axis=2)
    turned = np.roll(unit, -1, axis=1)
    down = np.stack([unit[:-1], unit[1:], turned[1:]], axis=2)[:-1]
    up = np.stack([unit[:-1], turned[1:], turned[:-1]], axis=2)[1:]
    triangles = np.concatenate([down.reshape(-1, 3, 3), up.reshape(-1, 3, 3)])
    return np.asarray(centre, dtype=np.float64) + radius * triangles


def _checked(position: NDArray[Any], radius: NDArray[Any], fields: Mapping[str, ArrayLike]) -> dict[str, NDArray[Any]]:
    """Radius and fields by name, each with a row for each particle."""
    if position.ndim != 2 or position.shape[1] != 3:
        raise ValueError(f"position has shape {position.shape}; allowed is (particle, 3)")
    n = len(position)
    data = {name: _numbers(name, field) for name, field in {"radius": radius, **fields}.items()}
    for name, field in data.items():
        if field.shape not in ((n,), (n, 3)):
            raise ValueError(f"{name} has shape {field.shape}; allowed are ({n},) or ({n}, 3)")
    return data


def _numbers(name: str, values: ArrayLike) -> NDArray[Any]:
    """Values as an array of a type that VTK has; true and false become 1 and 0."""
    array = np.asarray(values)
    array = array.astype(np.int8) if array.dtype.kind == "b" else array
    if f"{array.dtype.kind}{array.dtype.itemsize}" not in _TYPES:
        raise ValueError(f"{name} holds {array.dtype}; allowed are {', '.join(_TYPES.values())}")
    return array


def _array(name: str, values: NDArray[Any], *, alone: bool = False) -> str:
    """A DataArray element; `alone` for field data, which states its own length."""
    little = np.ascontiguousarray(values, dtype=values.dtype.newbyteorder("<"))
    raw = little.tobytes()
    text = base64.b64encode(len(raw).to_bytes(8, "little") + raw).decode("ascii")
    size = f' NumberOfTuples="{len(values)}"' if alone else ""
    if values.ndim == 2:
        size += f' NumberOfComponents="{values.shape[1]}"'
    kind = _TYPES[f"{values.dtype.kind}{values.dtype.itemsize}"]
    return f'<DataArray type="{kind}" Name={quoteattr(name)}{size} format="binary">{text}</DataArray>\n'


def _begin(file: IO[str], kind: str, attributes: str = "") -> None:
    file.write('<?xml version="1.0"?>\n')
    file.write(f'<VTKFile type="{kind}" version="1.0" byte_order="LittleEndian" header_type="UInt64">\n')
    file.write(f"<{kind}{attributes}>\n")


def _end(file: IO[str], kind: str) -> None:
    file.write(f"</{kind}>\n</VTKFile>\n")


def _time(file: IO[str], time: float) -> None:
    file.write(f"<FieldData>\n{_array('TimeValue', np.array([float(time)]), alone=True)}</FieldData>\n")


def _points(file: IO[str], position: NDArray[Any]) -> None:
    file.write(f"<Points>\n{_array('Points', position)}</Points>\n")


def _cells(file: IO[str], kind: str, connectivity: NDArray[np.int64], offsets: NDArray[np.int64]) -> None:
    file.write(f"<{kind}>\n{_array('connectivity', connectivity)}{_array('offsets', offsets)}</{kind}>\n")


@contextmanager
def _written(path: Path | str, suffix: str) -> Iterator[IO[str]]:
    """A text file that takes its name when all of it is written, and leaves nothing behind when that fails."""
    target = Path(path)
    if target.suffix.lower() != suffix:
        raise InputError(f"{target}: this file is written as {suffix}; give a name that ends in {suffix}")
    if os.path.isdir(target):  # Path.is_dir raises on names that are too long
        raise InputError(f"{target}: this is a folder; give the name of a file in it")
    if not os.path.isdir(target.parent):
        raise InputError(f"{target}: there is no folder {target.parent}; create it, or write elsewhere")
    part = target.with_name(f".{target.name}.{secrets.token_hex(4)}.part")
    try:
        with part.open("x", encoding="utf-8", newline="\n") as file:
            yield file
        os.replace(part, target)
    except OSError as error:
        raise InputError(
            f"{target}: cannot be written ({error.strerror or error}); free the place, or write elsewhere"
        ) from None
    finally:
        with suppress(OSError):
            part.unlink(missing_ok=True)
