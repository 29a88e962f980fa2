"""The effective field: schema, disk, interpolation."""

import io

import numpy as np
import pytest
import xarray as xr
from hypothesis import given, settings
from hypothesis import strategies as st

from fields_made import constant_field, random_field
from graindamp.errors import InputError
from graindamp.field.ideal import ideal_field
from graindamp.field.interpolate import Interpolant
from graindamp.field.schema import TABLE, check, damper_of, make_field
from graindamp.field.store import read_field, write_field
from graindamp.field.theory import collect_and_collide
from graindamp.report.figures import field_map
from graindamp.status import Status
from graindamp.units import STANDARD_GRAVITY


def plane(f, gamma):
    return 0.4 + 0.1 * np.log(f / 100) - 0.05 * np.log(gamma)


def scattered(n=60, seed=1):
    rng = np.random.default_rng(seed)
    f, gamma = np.exp(rng.uniform([[np.log(40)], [0.0]], [[np.log(400)], [np.log(40)]], (2, n)))
    eta = plane(f, gamma)
    return make_field(f, gamma, eta, 1 - eta, 0.13, source="plane", scattered=True)


def test_energy_and_power_follow_from_eta():
    field = constant_field(loss_factor=0.6, bed_mass=0.2, frequency=(50.0, 100.0), intensity=(1.0, 4.0))
    v = 4 * STANDARD_GRAVITY / (2 * np.pi * 100)
    energy = field["dissipated_energy"].sel(frequency=100, intensity=4).item()
    assert energy == pytest.approx(np.pi * 0.6 * 0.2 * v**2)
    assert field["power"].sel(frequency=100, intensity=4).item() == pytest.approx(100 * energy)
    for name in TABLE:
        if name in field.variables:
            assert field[name].attrs["units"] == TABLE[name].units


@pytest.mark.parametrize("make", [lambda: random_field(3), scattered], ids=["grid", "scattered"])
@pytest.mark.parametrize("suffix", [".nc", ".csv"])
def test_disk_gives_back_what_was_written(make, suffix, tmp_path):
    field = make()
    path = tmp_path / f"field{suffix}"
    write_field(field, path)
    again = read_field(path)
    xr.testing.assert_equal(again, field)
    assert again.attrs["bed_mass"] == field.attrs["bed_mass"]
    assert again.attrs["source"] == field.attrs["source"]


def test_from_one_format_to_the_other(tmp_path):
    write_field(random_field(4), tmp_path / "a.nc")
    write_field(read_field(tmp_path / "a.nc"), tmp_path / "b.csv")
    again = read_field(tmp_path / "b.csv")
    xr.testing.assert_equal(again, random_field(4))
    assert again.attrs["bed_mass"] == 0.3


def test_failed_points_survive_the_disk(tmp_path):
    field = random_field(3)
    eta = field["loss_factor"].to_numpy().copy()
    eta[1, 2] = np.nan
    mass = field["effective_mass_ratio"].to_numpy()
    gap = make_field(field["frequency"], field["intensity"], eta, mass, 0.3, source="gap")
    assert gap["status"].to_numpy()[1, 2] == Status.NO_SOLUTION
    for suffix in (".nc", ".csv"):
        write_field(gap, tmp_path / f"g{suffix}")
        xr.testing.assert_equal(read_field(tmp_path / f"g{suffix}"), gap)


def test_csv_typed_by_hand(tmp_path):
    path = tmp_path / "map.csv"
    path.write_text(
        "# bed_mass = 350 g\n# clearance = 1 mm\n# source = Table 3, shaker of 1998\n\n"
        "f [Hz]; acceleration [m/s^2]; eta; m'; remark\n"
        "40;9,80665;0,3;1,0;first\n40;98,0665;0,5;0,9;\n100;9,80665;0,4;0,9;\n100;98,0665;1,2;0,1;last\n",
        encoding="utf-8",
    )
    field = read_field(path)
    assert dict(field.sizes) == {"frequency": 2, "intensity": 2}
    assert field["loss_factor"].sel(frequency=100, intensity=10, method="nearest").item() == 1.2
    assert field.attrs["bed_mass"] == pytest.approx(0.35)
    assert "1998" in field.attrs["source"]
    assert np.isnan(field["loss_factor_se"]).all()


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("f,eta\n1,2\n", ["intensity", "m' [-]"]),
        ("# bed_mass = 3 g\nf,G,eta,m\n1,2,x,4\n", ["line 3", "'x'", "number"]),
        ("# bed_mass = 3 g\nf,G,eta,m\n1,2,3\n", ["line 3", "3 cells"]),
        ("# bed_mass = 3 g\nf,G,eta,m\n100,50,0,42,0,9\n", ["line 3", "6 cells", "semicolons"]),
        ("# bed_mass = 3 g\nf,acceleration,eta,m\n1,2,3,4\n", ["'acceleration' has no unit", "m/s^2"]),
        ("f,G,eta,m\n1,2,3,4\n", ["bed_mass", "350 g"]),
        ("# bed_mass = 3 g\n# clearance = -1 mm\nf,G,eta,m\n1,2,3,4\n", ["clearance", "'-1 mm'", "above 0"]),
        ("# bed_mass = heavy\nf,G,eta,m\n1,2,3,4\n", ["bed_mass", "'heavy'"]),
        ("# bed_mass = 3 g\nf,G,eta,m\n-1,2,3,4\n", ["frequency", "-1"]),
        ("# bed_mass = 3 g\nf,G,eta,m\n1,2,3,4\n1,2,3,5\n", ["1 Hz, 2", "2 times"]),
        ("# bed_mass = 3 g\nf,G,eta,eta,m\n1,2,3,4,5\n", ["two columns", "loss_factor"]),
        ("# bed_mass = 3 g\nf [N],G,eta,m\n1,2,3,4\n", ["column 'f [N]'"]),
        ("", ["no table"]),
        ("# bed_mass = 3 g\nf,G,eta,m,energy\n100,1,0.5,1,7\n", ["dissipated energy", "7 J"]),
    ],
)
def test_csv_mistakes_are_named(text, words, tmp_path):
    path = tmp_path / "map.csv"
    path.write_text(text)
    with pytest.raises(InputError) as caught:
        read_field(path)
    for word in [str(path), *words]:
        assert word in str(caught.value)


def test_a_typed_damper_that_gives_energy_is_marked(tmp_path):
    path = tmp_path / "map.csv"
    path.write_text("# bed_mass = 3 g\nf,G,eta,m\n100,1,-0.4,1\n100,2,0.4,1\n200,1,,1\n200,2,0.4,1\n")
    status = read_field(path)["status"].to_numpy()
    assert status.tolist() == [[Status.NOT_PASSIVE, Status.OK], [Status.NO_SOLUTION, Status.OK]]


def test_points_are_drawn_where_nothing_lies_between():
    """One of four corners has no value: the others are not hidden, and the figure is laid out."""
    eta = np.array([[0.4, 0.5], [0.6, np.nan]])
    figure = field_map(make_field([100.0, 200.0], [5.0, 10.0], eta, eta, 0.3, source="made"))
    figure.draw_without_rendering()
    assert len(figure.axes[0].collections[0].get_offsets()) == 3
    shown = [text.get_text() for text in figure.axes[0].get_xticklabels() if text.get_text()]
    assert {"100", "150", "200"} <= set(shown)


def test_names_of_dampers_survive_a_csv(tmp_path):
    f, gamma, eta = [50.0, 100.0], [1.0, 10.0], np.full((2, 2), 0.4)
    for name, expected in (("two\nlines, = x", "two lines, = x"), ("1e3", "1e3")):
        field = make_field(f, gamma, eta, eta, 0.3, source="made", damper={"name": name, "clearance": 1e-3})
        write_field(field, tmp_path / "x.csv")
        assert damper_of(read_field(tmp_path / "x.csv")) == {"name": expected, "clearance": 1e-3, "bed_mass": 0.3}


def test_files_that_are_no_fields(tmp_path):
    with pytest.raises(InputError, match="no such file"):
        read_field(tmp_path / "none.nc")
    (tmp_path / "bad.nc").write_text("hello")
    with pytest.raises(InputError, match="not a readable netCDF"):
        read_field(tmp_path / "bad.nc")
    with pytest.raises(InputError, match=r"\.nc or \.csv"):
        write_field(constant_field(), tmp_path / "field.txt")
    xr.Dataset({"a": 1}).to_netcdf(tmp_path / "other.nc", engine="h5netcdf")
    with pytest.raises(InputError, match="no frequency, intensity"):
        read_field(tmp_path / "other.nc")
    with pytest.raises(InputError, match="cannot be written"):
        write_field(constant_field(), tmp_path / "no-folder" / "field.csv")


@pytest.mark.parametrize(
    ("change", "word"),
    [
        (lambda f: f.assign_coords(frequency=f["frequency"][::-1]), "ascend"),
        (lambda f: f.drop_vars("status"), "status"),
        (lambda f: f.assign(loss_factor=f["loss_factor"] * np.nan), "good"),
        (lambda f: f.assign(loss_factor_se=f["loss_factor_se"] - 1), "negative"),
        (lambda f: f.assign_attrs(bed_mass=-1), "bed_mass"),
        (lambda f: f.assign(loss_factor=f["loss_factor"].T), "dimensions"),
        (lambda f: f.assign(power=2 * f["power"]), "times frequency"),
        (lambda f: f.isel(frequency=slice(0)), "no operating point"),
        (lambda f: f.assign(status=f["status"] + 1), "no operating point has a usable value"),
    ],
)
def test_schema_names_what_is_wrong(change, word):
    with pytest.raises(InputError, match=word):
        check(change(random_field(1)))


def test_bilinear_in_the_logarithms_is_exact():
    f, gamma = np.geomspace(40, 400, 6), np.geomspace(1, 40, 5)

    def value(x, y):
        return plane(x, y) + 0.01 * np.log(x) * np.log(y)

    grid = value(f[:, None], gamma[None, :])
    at = Interpolant(make_field(f, gamma, grid, 1 - grid, 0.1, source="exact"), "linear")
    for x, y in ((57.0, 3.3), (40.0, 40.0), (399.0, 1.0), (900.0, 90.0)):
        got = at(x, y)
        assert got.loss_factor == pytest.approx(value(x, y), abs=1e-12)  # rounding
        assert got.effective_mass_ratio == pytest.approx(1 - value(x, y), abs=1e-12)
        assert bool(got.extrapolated) == (x > 400)


def test_scattered_plane_is_exact_inside_and_linear_outside():
    at = Interpolant(scattered(), "linear")
    for x, y in ((100.0, 5.0), (800.0, 80.0)):
        assert at(x, y).loss_factor == pytest.approx(plane(x, y), abs=1e-10)  # rounding
    assert at(800.0, 80.0).extrapolated
    assert not at(100.0, 5.0).extrapolated


def test_policies_outside_the_points():
    field = random_field(2)
    with pytest.raises(InputError, match="20 to 200 Hz") as caught:
        Interpolant(field)(300.0, 5.0)
    assert "'constant' or 'linear'" in str(caught.value)
    held = Interpolant(field, "constant")
    assert held(300.0, 5.0).loss_factor == held(200.0, 5.0).loss_factor
    assert held(np.array([100.0, 300.0]), 5.0).extrapolated.tolist() == [False, True]
    assert (Interpolant(field, "linear")(np.array([1.0, 5e4]), np.array([[1e-4], [1e5]])).loss_factor >= 0).all()
    with pytest.raises(InputError, match="above 0"):
        held(-1.0, 5.0)
    with pytest.raises(InputError, match="'ignore'"):
        Interpolant(field, "ignore")


def test_gaps_are_bridged_not_spread():
    """A failed point takes itself out; its neighbours keep their values, where plain interpolation would lose them."""
    f, gamma = np.geomspace(40, 400, 6), np.geomspace(1, 40, 5)
    eta = plane(f[:, None], gamma[None, :])
    eta[2, 2] = np.nan
    at = Interpolant(make_field(f, gamma, eta, 1 - eta, 0.1, source="gap"))
    assert at(f[2], gamma[2]).loss_factor == pytest.approx(
        plane(f[2], gamma[2]), abs=1e-10
    )  # a plane is bridged exactly
    assert at(f[2], gamma[1]).loss_factor == pytest.approx(eta[2, 1])


def test_a_ragged_edge_is_an_edge():
    """Where a motion does not exist the field ends, and a bed below its existence limit gets no value."""
    f, gamma = np.geomspace(10, 1000, 40), np.geomspace(5, 400, 40)
    at = Interpolant(ideal_field("bouncing", f, gamma, 0.1, clearance=1e-3), "constant")
    inside, outside = at(100.0, 60.0), at(100.0, 6.0)  # X / X_opt = 4.7 and 0.47, the limit is 0.84
    assert inside.loss_factor == pytest.approx(collect_and_collide(4.684).loss_factor, rel=0.01)  # linear in 10 % cells
    assert not inside.extrapolated
    assert outside.extrapolated
    assert np.isfinite(outside.loss_factor)
    with pytest.raises(InputError, match="outside the field"):
        at.beyond("refuse")(100.0, 6.0)


def test_nobody_knows_the_error_of_what_was_extrapolated():
    values = Interpolant(random_field(1), "linear")(np.array([100.0, 300.0]), 5.0)
    assert np.isfinite(values.loss_factor_se).tolist() == [True, False]


def test_rows_of_scattered_points_make_flat_triangles_harmless():
    f, gamma = (axis.ravel() for axis in np.meshgrid(np.geomspace(40, 400, 7), np.geomspace(1, 40, 9)))
    keep = np.arange(len(f)) != 31
    eta = plane(f, gamma)[keep]
    at = Interpolant(make_field(f[keep], gamma[keep], eta, eta, 0.1, source="rows", scattered=True), "linear")
    places = np.linspace(41, 399, 50)[:, None], np.geomspace(1.1, 39, 50)
    assert np.abs(at(*places).loss_factor - plane(*places)).max() < 1e-6  # joggled corners


def test_points_on_a_line_are_refused():
    f = np.array([40.0, 80.0, 160.0])
    line = make_field(f, f / 10, f / 400, f / 400, 0.1, source="line", scattered=True)
    with pytest.raises(InputError, match="span no area"):
        Interpolant(line)


@given(seed=st.integers(0, 50), u=st.floats(0, 1), v=st.floats(0, 1), size=st.floats(0.01, 1.0), where=st.booleans())
@settings(max_examples=60, deadline=None)
def test_bounds_contain_every_value(seed, u, v, size, where):
    """Guaranteed bounds, for cells of a grid and for scattered points."""
    field = random_field(seed) if where else scattered(40, seed)
    at = Interpolant(field, "constant")
    x, y = at.breaks()
    i, j = int(u * (len(x) - 1) * 0.999), int(v * (len(y) - 1) * 0.999)
    x0, y0 = x[i] + u * (x[i + 1] - x[i]) * (1 - size), y[j] + v * (y[j + 1] - y[j]) * (1 - size)
    x1, y1 = x0 + size * (x[i + 1] - x[i]), y0 + size * (y[j + 1] - y[j])
    bounds = at.bounds((np.array([x0]), np.array([x1])), (np.array([y0]), np.array([y1])))
    xs, ys = np.meshgrid(np.linspace(x0, x1, 9), np.linspace(y0, y1, 9))
    values = at(np.exp(xs), np.exp(ys))
    for name in ("loss_factor", "effective_mass_ratio"):
        low, high = getattr(bounds, name)
        assert (getattr(values, name) >= low - 1e-9).all()  # rounding of exp and log
        assert (getattr(values, name) <= high + 1e-9).all()


def test_dollar_signs_in_names_are_no_formulas():
    figure = field_map(constant_field(), title="jar for $5 and $h_{1 $")
    figure.savefig(io.BytesIO(), format="png")
    assert any("$5" in part.get_text() for part in figure.texts) or "$5" in figure.get_suptitle()
