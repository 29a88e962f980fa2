"""The dampers of examples/meyer_seifried_2023: what the files say, and that tiny copies of each kind run."""

from math import pi
from pathlib import Path

import numpy as np
import pytest

import graindamp.dem.compile  # noqa: F401 - before the cache is moved: only beds go elsewhere, not compiled code
from graindamp.campaign.executors import Serial
from graindamp.campaign.point import measure, task_of
from graindamp.status import FATAL

FOLDER = Path(__file__).parents[2] / "examples" / "meyer_seifried_2023"
FILES = sorted(path.stem for path in FOLDER.glob("*.toml"))
BALL = 7900 * 4 / 3 * pi * 1.25e-3**3
"""Mass of one sphere [kg]."""


@pytest.fixture(autouse=True)
def _scripts(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(str(FOLDER))
    monkeypatch.setenv("GRAINDAMP_CACHE", str(tmp_path / "cache"))


@pytest.fixture
def setups():
    import setups

    return setups


def test_every_file_is_that_of_its_setup(setups):
    assert sorted(setups.NAMES) == FILES
    for name in setups.SETUPS:
        assert (FOLDER / f"{name}.toml").read_text(encoding="utf-8") == setups.text_of(name)


@pytest.mark.parametrize("name", FILES)
def test_every_file_loads(setups, name):
    spec = setups.load(name)
    assert spec.damper.name == name
    assert len(spec.plan.points) == 108
    # REFERENCE of the paper's grid, three digits each.
    assert spec.plan.frequencies[3] == pytest.approx(96.2, rel=1e-3)
    assert spec.plan.intensities[6] == pytest.approx(15.9, rel=5e-3)


def test_the_baseline_weighs_what_the_paper_says(setups):
    damper = setups.load("baseline").damper
    assert damper.fill.count * BALL == pytest.approx(0.291, abs=5e-4)  # three digits
    assert damper.container.radius == 0.02
    assert damper.lid.clearance == pytest.approx(pi * 1e-3, rel=1e-5)


@pytest.mark.parametrize(("name", "count", "mass"), [("single-cross", 1, 0.280), ("triple-cross", 3, 0.257)])
def test_crosses_are_where_and_as_large_as_they_should_be(setups, name, count, mass):
    damper = setups.load(name).damper
    assert [insert.arms for insert in damper.inserts] == [4] * count
    assert np.mean([insert.position for insert in damper.inserts]) == pytest.approx(0.025)
    assert mass_with_inserts(damper) == pytest.approx(mass, abs=1e-3)  # by hand; the paper has no number


def test_triple_star_leaves_the_mass_that_the_paper_says(setups):
    """Of 291 g 220 g are left. Eight arms leave 227 g by formula, six 241 g; what joins the stars is not in it."""
    assert mass_with_inserts(setups.load("triple-star").damper) == pytest.approx(0.220, abs=0.010)


def mass_with_inserts(damper):
    """Mass that fits 50 mm of bore [kg], as loosely filled as without inserts, but for the arms' surface: spheres lie
    looser at walls, which takes up a layer of about a fifth of a diameter."""
    radius = damper.container.radius
    assert damper.fill.height == 0.05
    taken = sum(insert.volume_in(radius) for insert in damper.inserts)
    surface = sum(insert.arms * 4 * insert.width * (radius - insert.width) for insert in damper.inserts)
    return 0.291 * (1 - (taken + 0.2 * 2.5e-3 * surface) / (pi * radius**2 * 0.05))


@pytest.mark.parametrize(
    ("name", "modulus", "clearance"),
    [
        ("coated-50hz", 0.27e6, 4.8e-3),
        ("coated-60hz", 0.72e6, 3.3e-3),
        ("coated-80hz", 1.4e6, 1.9e-3),
        ("coated-1.4mpa", 1.4e6, pi * 1e-3),
        ("coated-55mpa", 55e6, pi * 1e-3),
    ],
)
def test_coatings_are_those_of_the_paper(setups, name, modulus, clearance):
    damper = setups.load(name).damper
    assert set(damper.container.walls) == {"start", "end"}
    for wall in damper.container.walls.values():
        assert wall.coating.layer.youngs_modulus == modulus
        assert wall.coating.layer.poisson_ratio == 0.5
        assert wall.coating.thickness == 3e-3
    assert damper.lid.clearance == pytest.approx(clearance, rel=1e-5)


def test_a_block_is_known_by_its_answer():
    from courses import block_of

    from graindamp.field.theory import collect_and_collide

    for ratio, restitution in ((0.9, 0.0), (1.1, 0.06), (1.0, 0.2)):
        point = collect_and_collide(ratio, restitution)
        assert block_of(point.loss_factor, point.effective_mass_ratio) == pytest.approx(
            (ratio, restitution), abs=0.02
        )  # the table's spacing
    assert block_of(0.1, -0.05) is None  # a bed that floats


def test_changes_of_a_copy_leave_the_rest_alone(setups):
    spec = setups.load("baseline")
    other = setups.with_contact(spec, softening=7.0)
    assert other.damper.contact.softening == 7.0
    assert setups.with_contact(other, softening=spec.damper.contact.softening) == spec


def test_the_stiff_part_is_where_softening_matters(setups):
    spec = setups.load("baseline")
    part, whole = setups.stiff(spec), setups.stiff(spec, whole=True)
    assert part.damper.contact.softening == 1.0
    assert set(part.plan.points) < set(spec.plan.points)
    assert len(part.plan.points) == 36
    assert min(part.plan.frequencies) > 90
    assert max(part.plan.intensities) < 4.1
    assert whole.plan.points == spec.plan.points
    assert part.stop.max_cycles == 25


def test_stiff_values_take_the_place_of_softened_ones():
    import xarray as xr
    from fields import cost, merged

    names = ("loss_factor", "loss_factor_se", "effective_mass_ratio", "effective_mass_ratio_se", "particle_steps")
    axes = {"frequency": [50.0, 100.0], "intensity": [1.0, 2.0, 4.0]}
    softened = xr.Dataset({name: (tuple(axes), np.full((2, 3), 1.0)) for name in names}, axes)
    stiff = 3.0 * softened.sel(frequency=[100.0], intensity=[1.0, 2.0])
    field = merged(softened, stiff)
    np.testing.assert_array_equal(field["loss_factor"], [[1, 1, 1], [3, 3, 1]])
    np.testing.assert_array_equal(field["is_stiff"], [[0, 0, 0], [1, 1, 0]])
    assert "2 of them at the stiffness of steel; 4 and 6 particle-steps" in cost("made", field)
    assert not merged(softened, None)["is_stiff"].any()


def test_tiny_bed_is_run_and_kept(setups, tmp_path):
    from courses import course

    from graindamp.dem.packing import pack

    spec = setups.small(setups.with_contact(setups.load("baseline"), softening=1000.0), 8)
    bed = pack(spec.damper.model_copy(update={"packing": spec.damper.packing.model_copy(update={"tap": None})}))
    lower = setups.with_lid_at(bed, 2.5e-3)
    with pytest.raises(ValueError, match="highest sphere"):
        setups.with_lid_at(bed, -5e-3)
    one = course(spec, 100.0, 40.0, tmp_path, "tiny", cycles=8, packing=lower)
    assert one.clearance == 2.5e-3
    assert one.stroke_ratio == pytest.approx(pi * 0.994e-3 / 2.5e-3, rel=1e-3)
    assert len(one.cycle_loss_factor) == len(one.cycle_travel) == 8
    assert one.status & int(FATAL) == 0  # overlaps of so soft spheres are large, and said to be
    begun = [path.stat().st_mtime_ns for path in tmp_path.glob("tiny-*.json")]
    assert course(spec, 100.0, 40.0, tmp_path, "tiny", cycles=8, packing=lower) == one
    assert [path.stat().st_mtime_ns for path in tmp_path.glob("tiny-*.json")] == begun


@pytest.mark.slow
@pytest.mark.parametrize("name", ["baseline", "triple-cross", "coated-60hz"])
def test_tiny_copy_of_each_kind_runs(setups, name):
    spec = setups.small(setups.load(name), 40)
    stop = spec.stop.model_copy(update={"min_cycles": 8, "max_cycles": 8})
    found = measure(task_of(spec.model_copy(update={"stop": stop}), 100.0, 40.0))
    assert not found.failed
    assert found.n_particle == 40
    assert 0.05 < found.loss_factor < 2.0  # a bounce has about 1, a bed that floats 0.1
    # Coatings give way by about a stroke, 0.8 of a radius; the stiff wall is 2.4 radii behind their surface.
    assert found.largest_overlap < (2.4 if name.startswith("coated") else 0.1)


@pytest.mark.slow
def test_scripts_run(setups, tmp_path, monkeypatch, capsys):
    """As small as they can be: what they print and draw."""
    import fields
    import resonance
    import sensitivity
    import stiff
    import table_2
    import table_4
    import third
    import velocity

    out = tmp_path / "out"
    few = ["--out", str(out), "--count", "12", "--cycles", "8", "--softening", "1000"]
    monkeypatch.setattr("sys.argv", ["table_2.py", *few, "--seeds", "2", "--names", "baseline"])
    table_2.main()
    printed = capsys.readouterr().out
    assert "paper: test 1, simulation 0.98" in printed
    assert (out / "table-2-baseline.png").is_file()
    monkeypatch.setattr("sys.argv", ["third.py", *few, "--cycles", "10", "--clearance", "5"])
    third.main()
    assert "bed 0: eta" in capsys.readouterr().out
    assert (out / "third.png").is_file()
    monkeypatch.setattr(sensitivity, "changes", lambda spec, clearance: list(_few(sensitivity, spec)))
    monkeypatch.setattr("sys.argv", ["sensitivity.py", *few])
    sensitivity.main()
    assert "clearance 4.0 mm" in capsys.readouterr().out
    monkeypatch.setattr("sys.argv", ["fields.py", "--out", str(out), "--no-run"])
    fields.main()
    assert "no fields yet" in capsys.readouterr().out
    tiny = setups.with_contact(setups.small(setups.load("baseline"), 8), softening=1e4)
    monkeypatch.setattr(resonance, "FREQUENCIES", (900.0, 1000.0))
    monkeypatch.setattr("sys.argv", ["resonance.py", "--out", str(out), "--count", "8", "--softenings", "1000"])
    resonance.main()
    assert "softening  1000: eta" in capsys.readouterr().out
    for script in (stiff, table_4):  # processes would take longer to start than the points to run
        monkeypatch.setattr(script, "Processes", lambda n_worker: Serial())
    plan = tiny.plan.model_copy(update={"frequency": (1000.0,), "intensity": (1.0, 2.0)})
    monkeypatch.setattr(
        stiff, "stiff", lambda spec, whole: tiny.model_copy(update={"plan": plan, "softening_study": None})
    )
    monkeypatch.setattr("sys.argv", ["stiff.py", "--out", str(out), "--names", "baseline", "--workers", "1"])
    stiff.main()
    assert "2 points, 2 computed now" in capsys.readouterr().out
    few = ["--count", "12", "--softening", "1000", "--max-cycles", "12", "--workers", "1"]
    monkeypatch.setattr("sys.argv", ["table_4.py", "--out", str(out), *few])
    table_4.main()
    assert capsys.readouterr().out.count("60 Hz Gamma") == 4
    monkeypatch.setitem(velocity.FIGURES, "modes", (velocity.View("baseline", 1000.0, 4.0, "decoupled"),))
    few = ["--count", "30", "--softening", "1000", "--cycles", "8", "--figures", "modes"]
    monkeypatch.setattr("sys.argv", ["velocity.py", "--out", str(out), *few])
    velocity.main()
    (kept,) = (out / "runs").iterdir()
    monkeypatch.setattr(velocity, "simulate", None)  # the second time the run is read
    velocity.main()
    assert (out / "velocity-modes.png").is_file()
    assert kept.name == "baseline-1000-4-s1000-c8-n30.h5"


def _few(sensitivity, spec):
    from graindamp.dem.packing import pack

    bed = pack(spec.damper)
    yield sensitivity.Change("as described", spec, bed)
    yield sensitivity.Change("clearance 4.0 mm", spec, bed._replace(lid_height=bed.height + 4e-3, clearance=4e-3))


def test_values_that_are_not_available_are_said_not_to_be(setups, tmp_path):
    from courses import Course
    from table_2 import PUBLISHED, summary

    assert set(PUBLISHED) == {("baseline", 20.0), ("baseline", 40.0)}
    blank = dict.fromkeys(Course._fields, 0) | {
        "loss_factor": 0.5,
        "loss_factor_se": 0.01,
        "cycle_loss_factor": [0.5] * 25,
    }
    assert "not compared" in summary("triple-cross", 40.0, [Course(**blank)])
