"""Files for viewers: read back with nothing but XML and base64, and never half written."""

import base64
import xml.etree.ElementTree as ElementTree

import numpy as np
import pytest

from graindamp.dem.triangles import signed_volume
from graindamp.dem.vtk import (
    Frame,
    tessellate_box,
    tessellate_cylinder,
    tessellate_sphere,
    write_grid,
    write_particles,
    write_series,
    write_walls,
    write_xyz,
)
from graindamp.errors import InputError

TYPES = {"Float32": "<f4", "Float64": "<f8", "Int8": "<i1", "Int32": "<i4", "Int64": "<i8"}


def arrays(path, place):
    """All arrays under the element `place` of a VTK file, by name."""
    root = ElementTree.parse(path).getroot()
    assert root.attrib["byte_order"] == "LittleEndian"
    assert root.attrib["header_type"] == "UInt64"
    found = {}
    for element in root.iterfind(f".//{place}/DataArray"):
        raw = base64.b64decode(element.text)
        assert int.from_bytes(raw[:8], "little") == len(raw) - 8
        values = np.frombuffer(raw[8:], TYPES[element.attrib["type"]])
        n = int(element.attrib.get("NumberOfComponents", 1))
        found[element.attrib["Name"]] = values.reshape(-1, n) if n > 1 else values
    return found


def made(n=5):
    rng = np.random.default_rng(1)
    fields = {
        "velocity": rng.normal(size=(n, 3)).astype(np.float32),
        "number": np.arange(n, dtype=np.int32),
        "mean <force> & \"x\"": rng.normal(size=n),
        "awake": np.arange(n) % 2 == 0,
    }  # fmt: skip
    return rng.normal(size=(n, 3)), rng.uniform(1e-3, 2e-3, n), fields


@pytest.mark.parametrize("n", [0, 1, 5])
def test_particles_read_back(tmp_path, n):
    position, radius, fields = made(n)
    path = write_particles(tmp_path / "bed.vtp", position, radius, fields, time=0.125)
    if n > 1:
        assert (arrays(path, "Points")["Points"] == position).all()
    data = arrays(path, "PointData")
    assert list(data) == ["radius", *fields]
    assert (data["radius"] == radius).all()
    for name, field in fields.items():
        assert (data[name] == field).all()
        assert data[name].dtype == (np.int8 if field.dtype == bool else field.dtype)
    assert arrays(path, "Verts")["connectivity"].tolist() == list(range(n))
    assert arrays(path, "Verts")["offsets"].tolist() == list(range(1, n + 1))
    assert arrays(path, "FieldData")["TimeValue"].tolist() == [0.125]
    order = [element.tag for element in ElementTree.parse(path).getroot().find("PolyData")]
    assert order == ["Piece", "FieldData"]  # OVITO 3.17 does not recognise particles the other way round
    assert [file.name for file in tmp_path.iterdir()] == ["bed.vtp"]


def test_big_endian_and_strided_arrays_read_back(tmp_path):
    position, radius, _ = made(6)
    path = write_particles(tmp_path / "bed.vtp", position.astype(">f8")[::2], radius[::-2], {}, 0.0)
    assert (arrays(path, "Points")["Points"] == position[::2]).all()
    assert (arrays(path, "PointData")["radius"] == radius[::-2]).all()


def test_walls_share_points(tmp_path):
    box = tessellate_box((0, 0, 0), (1, 2, 3))
    line = np.array([[[0, 0, 0], [1, 2, 3]], [[0, 0, 0], [9, 9, 9]]], float)
    path = write_walls(tmp_path / "walls.vtp", box, line)
    point = arrays(path, "Points")["Points"]
    assert len(point) == 9
    polys, lines = arrays(path, "Polys"), arrays(path, "Lines")
    assert (point[polys["connectivity"]].reshape(-1, 3, 3) == box).all()
    assert polys["offsets"].tolist() == list(range(3, 37, 3))
    assert (point[lines["connectivity"]].reshape(-1, 2, 3) == line).all()
    assert lines["offsets"].tolist() == [2, 4]


def test_grid_counts_along_x_first(tmp_path):
    speed = np.arange(24.0).reshape(2, 3, 4)
    velocity = np.stack([speed, -speed, 2 * speed], axis=-1)
    path = write_grid(
        tmp_path / "mean.vti", (0, 0, -1), (0.1, 0.2, 0.3), {"speed": speed, "velocity": velocity}, time=2
    )
    image = ElementTree.parse(path).getroot().find("ImageData")
    assert image.attrib == {"WholeExtent": "0 2 0 3 0 4", "Origin": "0.0 0.0 -1.0", "Spacing": "0.1 0.2 0.3"}
    data = arrays(path, "CellData")
    assert (data["speed"] == speed.ravel(order="F")).all()
    assert (data["velocity"][:, 2] == 2 * speed.ravel(order="F")).all()


def test_series_names_files_from_its_folder(tmp_path):
    path = write_series(tmp_path / "bed.pvd", [(0.0, tmp_path / "a & b.vtp"), (0.5, "frames/c.vtp")])
    members = ElementTree.parse(path).getroot().findall("Collection/DataSet")
    assert [(m.attrib["timestep"], m.attrib["file"]) for m in members] == [
        ("0.0", "a & b.vtp"),
        ("0.5", "frames/c.vtp"),
    ]


def test_xyz_reads_back(tmp_path):
    position, radius, fields = made(3)
    del fields['mean <force> & "x"']
    path = write_xyz(tmp_path / "bed.xyz", (Frame(t, position + t, radius, fields) for t in (0.0, 0.5)))
    lines = path.read_text().splitlines()
    assert len(lines) == 10
    assert lines[5:7] == ["3", "Properties=pos:R:3:radius:R:1:velocity:R:3:number:I:1:awake:I:1 Time=0.5"]
    values = np.array([line.split() for line in lines[7:]], float)
    assert (values[:, :3] == position + 0.5).all()
    assert (values[:, 3] == radius).all()
    assert (values[:, 4:7] == fields["velocity"]).all()
    assert values[:, 8].tolist() == [1, 0, 1]
    with pytest.raises(ValueError, match="does not allow spaces"):
        write_xyz(tmp_path / "bed.xyz", [Frame(0.0, position, radius, {"mean force": radius})])


def test_arrays_of_another_length_are_refused(tmp_path):
    position, radius, _ = made(4)
    with pytest.raises(ValueError, match=r"speed has shape \(3,\); allowed are \(4,\) or \(4, 3\)"):
        write_particles(tmp_path / "bed.vtp", position, radius, {"speed": np.zeros(3)}, 0.0)
    with pytest.raises(ValueError, match=r"position has shape \(4, 2\)"):
        write_particles(tmp_path / "bed.vtp", position[:, :2], radius, {}, 0.0)
    with pytest.raises(ValueError, match="name holds <U1"):
        write_particles(tmp_path / "bed.vtp", position, radius, {"name": np.full(4, "a")}, 0.0)
    with pytest.raises(ValueError, match="on one grid"):
        write_grid(tmp_path / "a.vti", (0, 0, 0), (1, 1, 1), {"a": np.zeros((2, 2, 2)), "b": np.zeros((2, 2, 3))})


@pytest.mark.parametrize(("name", "message"), [
    ("bed.vtk", "give a name that ends in .vtp"),
    ("absent/bed.vtp", "there is no folder"),
    ("folder.vtp", "this is a folder"),
    ("x" * 300 + ".vtp", "cannot be written"),
])  # fmt: skip
def test_places_that_cannot_be_written(tmp_path, name, message):
    (tmp_path / "folder.vtp").mkdir()
    with pytest.raises(InputError, match=message):
        write_walls(tmp_path / name, tessellate_box((0, 0, 0), (1, 1, 1)))


def test_failure_leaves_the_old_file_and_no_other(tmp_path):
    position, radius, _ = made(3)
    path = write_xyz(tmp_path / "bed.xyz", [Frame(0.0, position, radius, {})])
    before = path.read_text()

    def failing():
        yield Frame(0.0, position, radius, {})
        raise RuntimeError("the run ended")

    with pytest.raises(RuntimeError, match="the run ended"):
        write_xyz(path, failing())
    assert path.read_text() == before
    assert [file.name for file in tmp_path.iterdir()] == ["bed.xyz"]


@pytest.mark.parametrize(("triangle", "volume"), [
    (tessellate_box((1, 2, 3), (2, 4, 6)), 6),
    (tessellate_cylinder((1, 2, 3), (0, 3, 4), 0.5, 48), 5 * 24 * np.sin(2 * np.pi / 48) * 0.25),
    (tessellate_cylinder((0, 0, 0), (0, 0, -2), 1.0, 6), 2 * 3 * np.sin(2 * np.pi / 6)),
])  # fmt: skip
def test_shapes_are_closed_with_normals_out(triangle, volume):
    assert signed_volume(triangle) == pytest.approx(volume, rel=1e-12)  # rounding
    a, b = triangle, np.roll(triangle, -1, axis=1)
    assert np.allclose(np.cross(a, b).sum(axis=(0, 1)), 0, atol=1e-12)  # the area vectors of a closed surface cancel


def test_sphere_converges_to_its_volume():
    error = []
    for n in (16, 32, 64):
        triangle = tessellate_sphere((1, 2, 3), 2.0, n)
        assert len(triangle) == n * (n - 2)
        assert np.allclose(np.linalg.norm(triangle - [1, 2, 3], axis=2), 2, rtol=1e-15)
        error.append(1 - signed_volume(triangle) / (32 / 3 * np.pi))
    assert error[0] / error[1] == pytest.approx(4, rel=0.02)  # second order
    assert error[1] / error[2] == pytest.approx(4, rel=0.005)
