"""The command line as a person or a script meets it: output, files, messages, exit codes."""

import contextlib
import io
import json
import re
import subprocess
import sys
from unittest import mock

import h5py
import numpy as np
import pytest

from graindamp.cli.main import main
from signals_made import linear_bed, record_of

BED, CONTAINER = 0.132, 0.085


def run(*words, cwd=None):
    """Exit code, standard output and error stream of `graindamp words`, without the seconds that a process takes."""
    out, err = io.StringIO(), io.StringIO()
    with (
        mock.patch.object(sys, "argv", ["graindamp", *map(str, words)]),
        contextlib.chdir(cwd or "."),
        contextlib.redirect_stdout(out),
        contextlib.redirect_stderr(err),
    ):
        try:
            main()
            code = 0
        except SystemExit as end:
            code = end.code or 0
    return code, out.getvalue(), err.getvalue()


def run_process(*words, cwd=None):
    """The same in a process of its own."""
    done = subprocess.run(
        [sys.executable, "-m", "graindamp", *map(str, words)], capture_output=True, text=True, cwd=cwd
    )
    return done.returncode, done.stdout, done.stderr


def as_json(*words, cwd=None):
    code, out, err = run(*words, "--json", cwd=cwd)
    assert code == 0, err
    return json.loads(out)


def error(*words, cwd=None):
    """The message of a user's mistake: exit code 2, nothing on standard output, no traceback."""
    code, out, err = run(*words, cwd=cwd)
    assert code == 2, (code, err)
    assert out == ""
    assert "Traceback" not in err
    return err


@pytest.fixture(scope="session")
def signals(tmp_path_factory):
    """Nine operating points of a linear bed and their empty runs, with a delay of 20 us, in the layout of a rig."""
    path = tmp_path_factory.mktemp("signals") / "signals.h5"
    with h5py.File(path, "w") as file:
        file.attrs["bed_mass_kg"], file.attrs["container_mass_kg"] = BED, CONTAINER
        for i, f in enumerate((50.0, 100.0, 200.0)):
            for j, gamma in enumerate((1.0, 4.0, 16.0)):
                v = gamma * 9.80665 / (2 * np.pi * f)
                options = {
                    "frequency": f,
                    "velocity_amplitude": v,
                    "sampling_rate": 10_000.0,
                    "container_mass": CONTAINER,
                    "delay": 20e-6,
                    "noise": 2e-3,
                    "seed": 10 * i + j,
                }
                bed = linear_bed(0.2 + 0.1 * i + 0.05 * j, 0.5 - 0.1 * j, BED, f, v)
                for name, force in ((f"f{f:g}_G{gamma:g}", bed), (f"empty_f{f:g}_G{gamma:g}", lambda angle: 0 * angle)):
                    record = record_of(force, **options)
                    group = file.create_group(name)
                    group["force"], group["velocity"] = record.force, record.motion
                    group.attrs["sampling_rate_hz"], group.attrs["frequency_hz"] = 10_000.0, f
                    group.attrs["nominal_intensity"] = gamma
    return path


@pytest.fixture(scope="session")
def field(signals):
    path = signals.parent / "field.nc"
    code, out, err = run("analyze", signals, "-o", path)
    assert code == 0, err
    assert str(path) in out
    return path


PROJECT = """
[structure]
kind = "beam"
length = "1.8 m"
bending_stiffness = "9930 N m^2"
mass_per_length = "2.89 kg/m"
n_mode = 2
damping = {{ kind = "modal", ratio = "0.5 %" }}
[[dampers]]
point = "1.765 m"
field = "{field}"
container_mass = "0.2 kg"
[drive]
point = "5 cm"
force = "5 N"
"""


def test_signals_to_field(signals, field):
    document = as_json("analyze", signals)
    assert document["layout"] == "grid"
    assert document["bed_mass"] == BED
    assert len(document["records"]) == 9
    for point in document["points"]:
        i, j = [50, 100, 200].index(point["frequency"]), [1, 4, 16].index(point["intensity"])
        assert abs(point["loss_factor"] - (0.2 + 0.1 * i + 0.05 * j)) < 5 * point["loss_factor_se"]
        assert abs(point["effective_mass_ratio"] - (0.5 - 0.1 * j)) < 5 * point["effective_mass_ratio_se"]
    shown = as_json("show", field)
    assert [p["loss_factor"] for p in shown["points"]] == [p["loss_factor"] for p in document["points"]]


def test_show_draws_and_converts(field, tmp_path):
    code, out, _ = run("show", field, "--convert", tmp_path / "field.csv", cwd=tmp_path)
    assert code == 0
    assert "η [-]" in out
    assert (tmp_path / "field.png").stat().st_size > 10_000
    again = as_json("show", tmp_path / "field.csv")
    assert again["points"] == as_json("show", field)["points"]


def test_show_says_how_robust_a_field_is(field, tmp_path):
    code, out, _ = run("show", field, "--level", "0.3", cwd=tmp_path)
    assert code == 0
    assert "share of the range with η ≥ 0.3 [%]" in out
    found = as_json("show", field, "--level", "0.3")["robustness"]
    assert found["level"] == 0.3
    assert 0.0 < found["share"]["value"] < 1.0
    assert found["share"]["standard_error"] > 0.0
    assert found["steepest"]["value"] is None  # without a clearance
    code, _, err = run("show", field, "--level", "0", cwd=tmp_path)
    assert code == 2
    assert "a loss factor above 0 is needed" in err


def test_second_answers_are_shown(field, tmp_path):
    from graindamp.field.store import read_field, write_field
    from graindamp.status import Status

    twofold = read_field(field)
    for name in ("loss_factor", "effective_mass_ratio"):
        values = np.full(twofold["loss_factor"].shape, np.nan)
        values[0, 0] = 0.777
        twofold[f"{name}_other"] = (twofold["loss_factor"].dims, values)
    twofold["status"][0, 0] |= int(Status.BISTABLE)
    write_field(twofold, tmp_path / "twofold.nc")
    code, out, _ = run("show", tmp_path / "twofold.nc", cwd=tmp_path)
    assert code == 0
    assert "other η [-]" in out
    assert out.count("0.777") == 2
    assert "other η [-]" not in run("show", field, cwd=tmp_path)[1]


def test_prediction_and_its_files(field, tmp_path):
    project = tmp_path / "beam.toml"
    project.write_text(PROJECT.format(field=field) + '[response]\nband = ["20 Hz", "250 Hz"]\nn_frequency = 50\n')
    code, _, err = run("predict", project, cwd=tmp_path)
    assert code == 0, err
    folder = tmp_path / "beam-report"
    pictures = {f"{name}.png" for name in ("field", "shapes", "damping", "balance", "response")}
    assert {path.name for path in folder.iterdir()} == pictures | {"report.html", "result.json", "damping.csv"}
    page = (folder / "report.html").read_text()
    assert page.count("data:image/png;base64,") == len(pictures)
    assert "http://" not in page
    assert "https://" not in page
    document = as_json("predict", project)
    assert json.loads((folder / "result.json").read_text()) == document
    for mode in document["modes"]:
        (state,) = mode["equilibria"]
        assert 0.005 < state["damping_ratio"] < 0.1
        assert state["damping_ratio_se"] > 0
        assert mode["fixed_point"]["converged"]


def test_a_study_without_equilibria_is_a_report_nevertheless(field, tmp_path):
    """So small a force that the damper works below its field."""
    project = tmp_path / "beam.toml"
    project.write_text('force_study = ["0.1 mN", "0.2 mN"]\n' + PROJECT.format(field=field))
    code, _, err = run("predict", project, cwd=tmp_path)
    assert code == 0, err
    folder = tmp_path / "beam-report"
    assert (folder / "study-force.png").exists()
    assert (folder / "report.html").exists()
    project.write_text(re.sub("force = .*", "force = []", PROJECT.format(field=field)))
    assert "force is an empty list; at least one force is needed" in error("predict", project, cwd=tmp_path)


def test_files_count_once(signals, tmp_path):
    assert "is given twice; each record counts once" in error("analyze", signals, signals, cwd=tmp_path)


def test_a_field_is_not_written_over_itself(field, tmp_path):
    assert "is the field itself" in error("show", field, "--convert", field, cwd=tmp_path)


def test_predictions_from_a_softened_field_say_so(field, tmp_path):
    from graindamp.field.store import read_field, write_field

    softened = read_field(field)
    softened.attrs["softening"] = 100.0
    write_field(softened, tmp_path / "soft.nc")
    project = tmp_path / "beam.toml"
    project.write_text(PROJECT.format(field=tmp_path / "soft.nc"))
    code, _, err = run("predict", project, cwd=tmp_path)
    assert code == 0, err
    assert "contacts softened by 100, and the error of that is not known" in err
    assert "contacts softened by 100" in (tmp_path / "beam-report" / "report.html").read_text(encoding="utf-8")
    (damper,) = as_json("predict", project)["dampers"]
    assert damper["softening"]["softening"] == 100


def test_softened_fields_of_several_dampers_are_told_apart(field, tmp_path):
    from graindamp.field.store import read_field, write_field

    softened = read_field(field)
    softened.attrs["softening"] = 100.0
    for name in ("a", "b"):
        write_field(softened, tmp_path / f"{name}.nc")
    text = PROJECT.format(field=tmp_path / "a.nc").replace("[[dampers]]", '[[dampers]]\nname = "left"')
    for name, file in (("middle", "a"), ("right", "b")):
        more = f'[[dampers]]\nname = "{name}"\npoint = "0.9 m"\nfield = "{tmp_path / file}.nc"\n[drive]'
        text = text.replace("[drive]", more)
    (tmp_path / "three.toml").write_text(text)
    _, _, err = run("predict", tmp_path / "three.toml", "--json")
    told = [line for line in err.splitlines() if "softened by 100" in line]
    assert [line.split(": contacts")[0] for line in told] == [
        "warning: field of left, middle",
        "warning: field of right",
    ]


def test_a_badly_edited_head_names_its_file(field, tmp_path):
    code, _, _ = run("show", field, "--convert", tmp_path / "head.csv", cwd=tmp_path)
    assert code == 0
    path = tmp_path / "head.csv"
    path.write_text("# softening = hard\n" + path.read_text(encoding="utf-8"), encoding="utf-8")
    code, _, err = run("show", path, cwd=tmp_path)
    assert code == 2
    assert f"{path}: softening is 'hard', a number from 1 on is needed" in err


@pytest.mark.slow
def test_demo_on_measured_signals(tmp_path):
    """The main job; its numbers are those of shipped data and may change only with the method."""
    document = as_json("demo", "--measured", "--out", tmp_path / "demo")
    states = {(m["number"], m["force"]): m["equilibria"] for m in document["modes"]}
    assert len(states) == 12
    assert all(len(state) == 1 and state[0]["is_stable"] for state in states.values())
    first = states[1, 2.0][0]
    assert first["damping_ratio"] == pytest.approx(0.0138, abs=3 * first["damping_ratio_se"])
    assert not first["extrapolated"]
    assert states[4, 2.0][0]["extrapolated"]
    assert (tmp_path / "demo" / "report.html").exists()
    eta = {(p["frequency"], p["intensity"]): p["loss_factor"] for p in document["measurement"]["points"]}
    assert len(eta) == 30
    assert max(eta, key=eta.get) == (63.0, 40.0)
    again = as_json("predict", tmp_path / "demo" / "project.toml")
    assert again["modes"] == document["modes"]


@pytest.mark.slow
def test_demo(tmp_path, monkeypatch):
    """The demo's damper with a fifth of its spheres and few points, through the whole main job."""
    from graindamp.report import demo

    copied = demo._copied

    def smaller(name, target):
        text = copied(name, target).read_text()
        for given, other in (
            ("count = 300", "count = 60"),
            ('radius = "15 mm"', 'radius = "9 mm"'),
            ("max_points = 44", "max_points = 18"),
            ("tolerance = 0.04", "tolerance = 0.2"),
            ('points = [["50 Hz", 5], ["150 Hz", 5], ["600 Hz", 0.7]]', 'points = [["600 Hz", 0.7]]'),
        ):
            assert name != "demo-damper.toml" or given in text
            text = text.replace(given, other)
        target.write_text(text)
        return target

    monkeypatch.setattr(demo, "_copied", smaller)
    _, _, document = demo.run_demo(tmp_path, lambda text: None)
    assert len(document["modes"]) == 12
    simulation = document["simulation"]
    assert simulation["points"] == 18
    assert simulation["computed"] == 18 + 1 + 2  # a corner of the plan with stiffer contacts, and with other beds
    assert any("contacts softened by 100: " in warning for warning in document["warnings"])
    assert (tmp_path / "motion.gif").read_bytes()[:6] == b"GIF89a"
    page = (tmp_path / "report.html").read_text()
    assert "data:image/gif;base64," in page
    assert page.index("Simulated operating points") < page.index("Damping at resonance")
    assert json.loads((tmp_path / "result.json").read_text())["simulation"] == document["simulation"]


def test_a_process_says_the_same():
    words = ("rules", "bouncing", "--stroke-ratio", 2, "--restitution", 0.2, "--json")
    assert run_process(*words) == run(*words)
    wrong = ("rules", "bouncing", "--stroke-ratio", "two")
    assert run_process(*wrong) == run(*wrong)
    assert run(*wrong)[0] == 2


def test_rules_refuse_what_has_no_answer(tmp_path):
    for words, told in (
        (("bouncing", "--intensity", 1, "--clearance", 0, "--frequency", 10), "--clearance: given '0'; a value"),
        (("bouncing", "--intensity", 1, "--clearance", 1, "--frequency", 0), "--frequency: given '0'; a value"),
        (("bouncing-vertical", "--intensity", 1e8), "at most 10000"),
    ):
        code, _, err = run("rules", *words, cwd=tmp_path)
        assert code == 2
        assert told in err


def test_a_picture_of_no_kind_is_refused(field, tmp_path):
    code, _, err = run("show", field, "--figure", tmp_path / "map.xyz", cwd=tmp_path)
    assert code == 2
    assert "map.xyz: not a kind of picture; allowed are .png" in err


def test_rules_as_documented():
    bounce = as_json("rules", "bouncing", "--stroke-ratio", 2, "--restitution", 0.2)
    assert bounce["exists"] is True
    assert bounce["branch"] == "symmetric-two-impact"
    assert bounce["loss_factor"] == pytest.approx(0.8176, abs=5e-5)  # digits given
    assert bounce["effective_mass_ratio"] == pytest.approx(0.9450, abs=5e-5)
    assert bounce["stroke_ratio_min"] == pytest.approx(0.6137, abs=5e-5)
    gone = as_json("rules", "bouncing", "--stroke-ratio", 0.3)
    assert gone["exists"] is False
    assert gone["loss_factor"] is None
    slide = as_json("rules", "sliding", "--intensity", 0.2, "--friction", 0.1)
    assert slide["loss_factor"] == pytest.approx(0.3941, abs=5e-5)
    assert slide["effective_mass_ratio"] == pytest.approx(0.5)
    hop = as_json("rules", "bouncing-vertical", "--intensity", "1.5 g")
    assert hop["loss_factor"] == pytest.approx(0.2399, abs=5e-5)
    wall = as_json("rules", "coating", "--frequency", "60 Hz", "--bed-length", "50 mm")
    assert wall["wall_modulus"] == pytest.approx(0.4398e6, rel=1e-3)  # standard gravity against 9.81
    assert wall["n_line"] == 20
    assert wall["clearance"] == pytest.approx(3.253e-3, rel=1e-3)  # likewise
    assert wall["note"] == ""
    assert as_json("rules", "coating", "--frequency", 60, "--particle-radius", "1.25 mm") == wall
    back = as_json("rules", "coating", "--wall-modulus", "0.72 MPa", "--n-line", 20)
    assert back["frequency"] == pytest.approx(70.7, abs=0.1)
    both = as_json("rules", "coating", "--frequency", 60, "--wall-modulus", "0.72 MPa")
    assert both["frequency_at_hand"] == back["frequency"]
    assert both["wall_modulus_over_rule"] == pytest.approx(1.64, abs=5e-3)  # two digits: 64 % above
    assert "500 Hz" in as_json("rules", "coating", "--wall-modulus", "55 MPa")["note"]
    constants = ("--intensity", 2, "--speed-ratio", 1.3, "--compression-ratio", 0.8, "--bounce-intensity", "30 g")
    adjusted = as_json("rules", "coating", "--frequency", 60, *constants)
    change = 1.3**2 * 0.8**2.5 / 2**0.5
    assert adjusted["wall_modulus"] / wall["wall_modulus"] == pytest.approx(
        change, rel=1e-4
    )  # 1e-5: the ball gives too
    assert adjusted["clearance"] == pytest.approx(2 * wall["clearance"])
    gap = as_json("rules", "clearance", "--frequency", 60)
    assert gap["clearance"] == pytest.approx(3.253e-3, rel=1e-3)  # likewise
    same = as_json("rules", "clearance", "--clearance", f"{gap['clearance']} m")
    assert same["frequency"] == pytest.approx(60)
    bound = as_json("rules", "efficiency", "--bed-mass", "350 g", "--shape-squared", 0.332)
    assert bound["damping_ratio"] == pytest.approx(0.052, abs=5e-4)  # printed as 5.2 %
    code, out, _ = run("rules", "bouncing", "--clearance", "3 mm", "--frequency", 100, "--intensity", "40 g")
    assert code == 0
    assert "loss factor" in out


@pytest.mark.parametrize(
    ("words", "parts"),
    [
        (("rules", "bouncing", "--stroke-ratio", "abc"), ["--stroke-ratio", "'abc'"]),
        (("rules", "bouncing", "--stroke-ratio", "2", "--restitution", "1"), ["restitution", "1"]),
        (("rules", "bouncing"), ["--stroke-ratio", "--clearance"]),
        (("rules", "sliding", "--intensity", "1 kg", "--friction", "0.1"), ["--intensity", "[mass]"]),
        (("rules", "sliding", "--intensity", "1", "--friction", "0"), ["friction"]),
        (("rules", "sliding", "--intensity", "nan", "--friction", "0.1"), ["--intensity"]),
        (("rules", "coating"), ["--frequency", "--wall-modulus"]),
        (("rules", "coating", "--frequency", "60", "--particle-radius", "0 mm"), ["--particle-radius", "0 mm"]),
        (("rules", "coating", "--frequency", "60", "--bed-length", "1 mm"), ["n_line", "0.4"]),
        (("rules", "clearance"), ["--frequency", "--clearance"]),
        (("rules", "efficiency", "--bed-mass", "1 kg"), ["--shape-squared", "--modal-mass"]),
        (("analyze", "nothing.h5"), ["nothing.h5"]),
        (("analyze", "."), ["."]),
        (("predict", "nothing.toml"), ["nothing.toml", "cannot be opened"]),
        (("show", "nothing.nc"), ["nothing.nc", "no such file"]),
        (("show", "nothing.txt"), [".nc", ".csv"]),
        (("analyze", "a.h5", "-o", "field.txt"), ["field.txt", ".nc or .csv"]),
        (("analyse",), ["analyse"]),
        (("rules", "bouncing", "--stroke", "2"), ["--stroke"]),
    ],
)
def test_mistakes_get_one_message_and_exit_code_2(words, parts, tmp_path):
    err = error(*words, cwd=tmp_path)
    for part in parts:
        assert part in err


def test_messages_about_measurements(signals, tmp_path):
    with h5py.File(signals) as file:
        force, velocity = file["f50_G1/force"][:], file["f50_G1/velocity"][:]
    rows = "".join(f"{k / 10_000:.4f},{a:.8g},{b:.8g}\n" for k, (a, b) in enumerate(zip(force, velocity, strict=True)))
    run_file = tmp_path / "run.csv"
    run_file.write_text("time [s],force [N],velocity [m/s]\n" + rows)
    assert "--bed-mass" in error("analyze", run_file)
    assert "--container-mass" in error("analyze", run_file, "--bed-mass", "132 g")
    alone = ("analyze", run_file, "--bed-mass", "132 g", "--container-mass", "85 g")
    code, _, err = run(*alone)
    assert code == 0
    assert "no empty-container run" in err
    point = as_json(*alone, "--empty", signals)["points"][0]
    assert abs(point["loss_factor"] - 0.2) < 5 * point["loss_factor_se"]
    broken = np.where(np.arange(len(force)) == 50, np.nan, force)
    with h5py.File(tmp_path / "broken.h5", "w") as file:
        file["force"], file["velocity"] = broken, velocity
        file.attrs.update(sampling_rate_hz=10_000.0, bed_mass_kg=BED, container_mass_kg=CONTAINER)
    assert "NaN" in error("analyze", tmp_path / "broken.h5")


def test_a_bad_record_does_not_lose_the_others(signals, tmp_path):
    copy = tmp_path / "partly.h5"
    copy.write_bytes(signals.read_bytes())
    with h5py.File(copy, "r+") as file:
        file["f100_G4/force"][77] = np.nan
    code, _, err = run("analyze", copy, "-o", tmp_path / "field.nc")
    assert code == 0
    assert "f100_G4" in err
    assert "NaN" in err
    points = as_json("show", tmp_path / "field.nc")["points"]
    assert [p["loss_factor"] is None for p in points].count(True) == 1
    project = tmp_path / "p.toml"
    project.write_text(PROJECT.format(field="field.nc"))
    assert as_json("predict", project)["modes"][0]["equilibria"]


def test_a_description_with_its_own_files(signals, tmp_path):
    description = tmp_path / "rig.toml"
    description.write_text(f'files = ["{signals}"]\nname = "jar"\nclearance = "3 mm"\nskip_cycles = 4\n')
    document = as_json("analyze", description)
    assert document["damper"]["name"] == "jar"
    assert document["damper"]["clearance"] == pytest.approx(3e-3)
    assert all(record["n_skipped"] == 4 for record in document["records"])
    assert "alone" in error("analyze", description, signals)


def test_version_and_help():
    assert run("--version")[1].startswith("graindamp ")
    code, out, _ = run("--help")
    assert code == 0
    for command in ("demo", "analyze", "predict", "rules", "show"):
        assert command in out


def test_defects_are_told_from_mistakes(tmp_path):
    """Anything unforeseen ends with exit code 1 and one message; GRAINDAMP_DEBUG shows where."""
    code = "import graindamp.cli.rules as r, graindamp.cli.main as m; r.show_rule = None; m.main()"
    words = [sys.executable, "-c", code, "rules", "sliding", "--intensity", "1", "--friction", "0.1"]
    done = subprocess.run(words, capture_output=True, text=True)
    assert done.returncode == 1
    assert "internal error" in done.stderr
    assert "Traceback" not in done.stderr
