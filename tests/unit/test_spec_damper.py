"""The description of a simulated damper: what it accepts, what it refuses, and in which words."""

import copy
import math

import numpy as np
import pytest
from pydantic import BaseModel

from graindamp.errors import InputError
from graindamp.materials import MATERIALS
from graindamp.spec import contact, container, motion, particles, simulation
from graindamp.spec.container import FoamLid, StarInsert, on_axis
from graindamp.spec.model import Spec, helps_of, load_spec, parse_spec
from graindamp.spec.simulation import DamperSpec, RunSpec, SimulationSpec
from graindamp.units import STANDARD_GRAVITY

MODULES = (contact, container, motion, particles, simulation)

BASE = {
    "damper": {
        "particles": [{"material": "steel-s235", "radius": "1.25 mm"}],
        "fill": {"count": 100},
        "container": {"kind": "cylinder", "radius": "20 mm", "length": "70 mm", "material": "aluminium-6060"},
        "contact": {"restitution": 0.6, "friction": 0.1},
    },
    "motion": {"kind": "harmonic", "frequency": "100 Hz", "intensity": 40},
}

BOX = {"kind": "box", "size": ["30 mm", "20 mm", "50 mm"], "material": "perspex"}
SPHERE = {"kind": "sphere", "radius": "20 mm", "material": "perspex"}
MESH = {"kind": "mesh", "file": "cavity.stl", "length_unit": "mm", "material": "steel"}
FLOOR = {"kind": "walls", "planes": [{"name": "floor", "point": [0, 0, 0], "normal": "z"}], "material": "steel"}
FOAM = {"kind": "foam", "height": "9 mm", "travel": "10 mm", "coefficients": [12.48, -2.73e3, 4.35e5]}
STAR = {"kind": "star", "material": "perspex", "position": "25 mm", "width": "5 mm"}

GONE = object()


def changed(**changes):
    """BASE with dotted keys changed; dots are written as two underscores, GONE takes a key away."""
    data = copy.deepcopy(BASE)
    for key, value in changes.items():
        *path, last = key.split("__")
        table = data
        for part in path:
            table = table.setdefault(part, {})
        if value is GONE:
            table.pop(last, None)
        else:
            table[last] = value
    return data


def read(**changes):
    return parse_spec(changed(**changes), SimulationSpec, "sim.toml")


def message(**changes):
    with pytest.raises(InputError) as caught:
        read(**changes)
    text = str(caught.value)
    assert text.startswith("sim.toml: ")
    return text


def test_the_baseline_damper_reads_as_its_paper_says(request):
    spec = load_spec(request.path.parents[1] / "data" / "baseline-damper.toml", SimulationSpec)
    damper = spec.damper
    assert damper.particles[0].radius == pytest.approx(1.25e-3, rel=1e-15)  # rounding of the unit
    assert damper.particles[0].density == 7900
    assert damper.fill.count == 4500
    assert damper.container.radius == 0.02
    assert damper.lid.clearance == pytest.approx(3.14159e-3, rel=1e-15)  # rounding of the unit
    assert damper.lid_wall == "end"
    assert damper.pour_direction == (-1, 0, 0)
    assert damper.gravity == (0, 0, -STANDARD_GRAVITY)
    assert spec.motion.acceleration_amplitude(100) == 40 * STANDARD_GRAVITY
    assert (spec.duration, spec.base_frequency, spec.sample_rate) == (0.25, 100, 20_000)
    assert SimulationSpec.model_validate_json(spec.model_dump_json()) == spec


@pytest.mark.parametrize(
    ("given", "vector"),
    [
        ("-z", (0, 0, -STANDARD_GRAVITY)),
        ("x", (STANDARD_GRAVITY, 0, 0)),
        ("+y", (0, STANDARD_GRAVITY, 0)),
        ("none", (0, 0, 0)),
        ([0, "1 g", -1.62], (0, STANDARD_GRAVITY, -1.62)),
    ],
)
def test_gravity_is_a_vector_or_a_word(given, vector):
    assert read(damper__gravity=given).damper.gravity == vector


def test_a_direction_becomes_a_unit_vector():
    assert read(motion__direction=[3, 0, 4]).motion.direction == pytest.approx((0.6, 0, 0.8), rel=1e-15)  # rounding
    assert read(motion__direction="-y").motion.direction == (0, -1, 0)
    assert "needs a component other than 0" in message(motion__direction=[0, 0, 0])
    assert '"x", "y", "z"' in message(motion__direction="up")
    assert '"x", "y", "z"' in message(damper__gravity="down")


@pytest.mark.parametrize(
    ("radius", "limits"),
    [
        ("1.25 mm", (1.25e-3, 1.25e-3)),
        ({"kind": "normal", "mean": "1 mm", "std": "0.1 mm"}, (0.7e-3, 1.3e-3)),
        ({"kind": "normal", "mean": "1 mm", "std": "0.5 mm", "min": "0.2 mm"}, (0.2e-3, 2.5e-3)),
        ({"kind": "uniform", "low": "0.2 mm", "high": "0.4 mm"}, (0.2e-3, 0.4e-3)),
        ({"kind": "lognormal", "median": 1e-3, "spread": 0.1, "max": "1.2 mm"}, (1e-3 * math.exp(-0.3), 1.2e-3)),
        ({"kind": "discrete", "radius": ["1 mm", 2e-3], "share": [1, 2]}, (1e-3, 2e-3)),
    ],
)
def test_radius_is_a_length_or_a_distribution(radius, limits):
    component = read(damper__particles=[{"material": "lead", "radius": radius}]).damper.particles[0]
    assert component.limits == pytest.approx(limits, rel=1e-12)  # rounding


@pytest.mark.parametrize(
    ("radius", "words"),
    [
        ({"kind": "normal", "mean": "1 mm", "std": "0.5 mm"}, ["mean - 3 std", "must be positive", "give min"]),
        ({"kind": "normal", "mean": 1e-3, "std": 1e-4, "min": 1.1e-3}, ["must ascend"]),
        ({"kind": "uniform", "low": 2e-3, "high": 1e-3}, ["high must lie above low"]),
        ({"kind": "lognormal", "median": 1e-3, "spread": 2}, ["less than or equal to 1"]),
        ({"kind": "discrete", "radius": [1e-3, 2e-3], "share": [1]}, ["2 and share 1 values"]),
        ({"kind": "gaussian", "mean": 1e-3}, ["a table with kind", "normal", "lognormal"]),
        ({"mean": 1e-3}, ["a table with kind"]),
        ("1.25 kg", ["[mass]", "[length]"]),
        (0, ["greater than 0"]),
        ({"kind": "normal", "mean": 1e-3, "sdt": 1e-4}, ["unknown key 'sdt'", "'std'"]),
    ],
)
def test_radius_names_the_mistake(radius, words):
    text = message(damper__particles=[{"material": "steel", "radius": radius}])
    assert "damper.particles[1].radius" in text
    for word in words:
        assert word in text, text


def test_materials_come_by_name_by_table_or_by_both():
    parts = [
        {"material": "Steel S235", "radius": 1e-3},
        {
            "material": {"name": "hard", "youngs_modulus": "600 GPa", "poisson_ratio": 0.2, "density": 15e3},
            "radius": 1e-3,
        },
        {"material": {"name": "stainless-steel", "yield_stress": "345 MPa"}, "radius": 1e-3},
    ]
    steel, hard, yielding = (part.material for part in read(damper__particles=parts).damper.particles)
    assert (steel.name, steel.youngs_modulus, steel.yield_stress) == ("steel-s235", 208e9, 235e6)
    assert (hard.name, hard.youngs_modulus) == ("hard", 600e9)
    assert (yielding.youngs_modulus, yielding.yield_stress) == (MATERIALS["stainless-steel"].youngs_modulus, 345e6)
    parts[1]["material"] = {"name": "steel-s235", "density": 7700}
    assert "with different values" in message(damper__particles=parts)


def test_particles_need_a_density_and_walls_do_not():
    glassy = {"youngs_modulus": "70 GPa", "poisson_ratio": 0.2}
    assert "needs a density" in message(damper__particles=[{"material": glassy, "radius": 1e-3}])
    assert read(damper__container__material=glassy).damper.container.material.density is None
    assert "no material is called 'steal'; nearest is 'steel'" in message(damper__container__material="steal")
    assert "less than or equal to 0.5" in message(damper__container__material={**glassy, "poisson_ratio": 0.6})


@pytest.mark.parametrize(
    ("fill", "words"),
    [
        ({}, "none of them"),
        ({"count": 3, "mass": "1 g"}, "count, mass"),
        ({"count": 0}, "greater than or equal to 1"),
        ({"solid_fraction": 0.8}, "less than 0.74"),
        (GONE, "fill is missing"),
        ({"count": 10_000_000}, "enlarge the container"),
    ],
)
def test_fill_is_exactly_one_of_four(fill, words):
    assert words in message(damper__fill=fill)


@pytest.mark.parametrize("fill", [{"mass": "291 g"}, {"height": "50 mm"}, {"solid_fraction": "58 %"}])
def test_other_ways_to_fill(fill):
    read(damper__fill=fill)


def test_listed_radii_need_no_fill():
    listed = {"material": "steel", "radius": {"kind": "list", "radius": [1e-3, "2 mm"]}}
    assert read(damper__particles=[listed], damper__fill=GONE).damper.fill is None
    assert "leave out fill" in message(damper__particles=[listed])
    assert "cannot be mixed" in message(damper__particles=[listed, {"material": "steel", "radius": 1e-3}])


def test_fill_that_cannot_be_found_is_refused():
    assert "closed container" in message(damper__container=FLOOR, damper__fill={"solid_fraction": 0.5})
    assert 'choose method = "pour"' in message(damper__fill={"height": "1 cm"}, damper__packing={"method": "grow"})


def test_particles_must_fit_the_container():
    assert "radius is half of the diameter" in message(damper__container__radius="1 mm")


@pytest.mark.parametrize(
    ("given", "names", "volume"),
    [
        (BASE["damper"]["container"], "side start end", math.pi * 0.02**2 * 0.07),
        (BOX, "x- x+ y- y+ z- z+", 3e-5),
        (SPHERE, "wall", 4 / 3 * math.pi * 8e-6),
        (MESH, "mesh", None),
        (FLOOR, "floor", None),
    ],
)
def test_containers_name_their_walls(given, names, volume):
    found = read(damper__container=given).damper.container
    assert found.wall_names == tuple(names.split())
    assert found.volume == (None if volume is None else pytest.approx(volume, rel=1e-14))  # rounding
    text = message(damper__container={**given, "walls": {"ned": {"friction": 0.2}}})
    assert "no wall is called 'ned'" in text
    assert f"this container has {', '.join(names.split())}" in text


def test_kinds_are_told_apart_and_named():
    assert "allowed are 'cylinder', 'box', 'sphere', 'mesh', 'walls'" in message(damper__container={"kind": "tube"})
    assert "is missing" in message(damper__container={"radius": 1})
    assert "allowed are 'harmonic'" in message(motion={"kind": "sine"})
    assert "pattern" in message(damper__container={**MESH, "file": "cavity.step"})
    assert read(damper__container=MESH).damper.container.scale == 1e-3


def test_a_wall_may_have_its_own_material_and_coating():
    coating = {"youngs_modulus": "0.72 MPa", "poisson_ratio": 0.5, "thickness": "3 mm"}
    damper = read(damper__container__walls={"end": {"coating": coating}, "start": {"material": "lead"}}).damper
    assert damper.surfaces["end"].youngs_modulus == 0.72e6
    assert damper.surfaces["start"].name == "lead"
    assert damper.surfaces["side"].name == "aluminium-6060"
    assert {name: material.name for name, material in damper.backings.items()} == {"end": "aluminium-6060"}


@pytest.mark.parametrize(
    ("coating", "words"),
    [
        ({"thickness": 1e-3}, "either material, or youngs_modulus and poisson_ratio"),
        ({"thickness": 1e-3, "youngs_modulus": 1e6}, "either material, or youngs_modulus and poisson_ratio"),
        ({"thickness": 1e-3, "material": "lead", "youngs_modulus": 1e6, "poisson_ratio": 0.5}, "either material"),
        ({"material": "lead"}, "thickness: is missing"),
        ({"material": "lead", "thickness": "5 cm"}, "give a thinner one"),
        ({"material": "lead", "thickness": 1e-3, "stiffness": 1e6}, "coating of wall 'end' gives a stiffness"),
    ],
)
def test_coatings_name_the_mistake(coating, words):
    assert words in message(damper__container__walls={"end": {"coating": coating}})


def test_a_mesh_cannot_be_coated():
    walls = {"mesh": {"coating": {"material": "lead", "thickness": 1e-3}}}
    assert "a mesh cannot be coated" in message(damper__container={**MESH, "walls": walls})


def test_planes_need_names_of_their_own():
    planes = [FLOOR["planes"][0]] * 2
    assert "a name of its own" in message(damper__container={**FLOOR, "planes": planes})


@pytest.mark.parametrize("axis", ["x", "y", "z"])
def test_a_star_is_made_of_beams_across_the_whole_section(axis):
    star = StarInsert(material="perspex", position=0.025, width=0.005, arms=6, angle=0.1)
    beams = star.beams(axis, 0.02)
    assert [beam.angle for beam in beams] == pytest.approx([0.1, 0.1 + math.pi / 3, 0.1 + 2 * math.pi / 3])  # rounding
    for beam in beams:
        along = "xyz".index(axis)
        assert beam.center == on_axis(axis, 0.025)
        assert beam.size[along] == 0.005
        assert beam.size[(along + 1) % 3] == 0.04
        assert beam.size[(along + 2) % 3] == 0.005
        assert beam.axis == axis


@pytest.mark.parametrize("arms", [2, 4, 6, 8])
def test_volume_of_a_star_is_that_of_the_points_inside(arms):
    star = StarInsert(material="perspex", position=0.025, width=0.005, arms=arms)
    n, radius = 1000, 0.02
    x, y = np.meshgrid(*[(np.arange(n) + 0.5) / n * 2 * radius - radius] * 2)
    turns = [0.3 + 2 * math.pi * k / arms for k in range(arms // 2)]
    beams = np.any([abs(x * math.sin(a) - y * math.cos(a)) < 0.0025 for a in turns], axis=0)
    area = np.count_nonzero(beams & (x**2 + y**2 < radius**2)) * (2 * radius / n) ** 2
    # Beams turned off the grid: of 1e5 cells inside, each of a few thousand on an edge is wrong by half at random.
    assert star.volume_in(radius) == pytest.approx(area * 0.005, rel=5e-3)


def test_a_wide_star_fills_its_slice():
    star = StarInsert(material="perspex", position=0.025, width=0.02, arms=12)
    assert star.volume_in(0.02) == pytest.approx(math.pi * 0.02**2 * 0.02, rel=1e-14)  # rounding


@pytest.mark.parametrize(
    ("inserts", "words"),
    [
        ([{**STAR, "arms": 5}], "multiple of 2"),
        ([{**STAR, "position": "1 mm"}], "leaves the container; allowed 0.0025 to 0.0675 m"),
        ([{**STAR, "width": "4 cm"}], "would close the container"),
        ([{**STAR, "name": "a"}, {**STAR, "name": "a", "position": 0.05}], "a name of its own"),
        ([{**STAR, "name": "end"}], "the name of a wall"),
        ([{"kind": "cylinder", "material": "lead", "start": [0, 0, 0], "end": [0, 0, 0], "radius": 1}], "same point"),
        ([{"kind": "ring"}], "allowed are 'box', 'cylinder', 'star'"),
    ],
)
def test_inserts_name_the_mistake(inserts, words):
    assert words in message(damper__inserts=inserts)


def test_a_star_needs_a_cylinder():
    assert 'a star insert needs a container of kind = "cylinder"' in message(
        damper__container=BOX, damper__inserts=[STAR]
    )


def test_blocks_and_bars_know_their_volume():
    inserts = [
        {"kind": "box", "material": "lead", "center": ["1 cm", 0, 0], "size": [0.01, 0.02, 0.03], "angle": "45 deg"},
        {"kind": "cylinder", "material": "lead", "start": [0, 0, 0], "end": [0.03, 0, 0.04], "radius": "1 cm"},
    ]
    box, bar = read(damper__inserts=inserts).damper.inserts
    assert box.volume == pytest.approx(6e-6, rel=1e-14)  # rounding
    assert box.angle == pytest.approx(math.pi / 4, rel=1e-14)  # rounding
    assert bar.volume == pytest.approx(math.pi * 1e-4 * 0.05, rel=1e-14)  # rounding


@pytest.mark.parametrize(
    ("container_given", "direction", "wall"),
    [
        (BASE["damper"]["container"], None, "end"),
        (BASE["damper"]["container"], "x", "start"),
        ({**BASE["damper"]["container"], "axis": "z"}, None, "end"),
        (BOX, None, "z+"),
        (BOX, "y", "y-"),
        (BOX, [-2, 0, 0], "x+"),
    ],
)
def test_the_lid_closes_the_wall_that_the_bed_is_poured_from(container_given, direction, wall):
    packing = {} if direction is None else {"direction": direction}
    lid = {"kind": "rigid", "clearance": "1 mm"}
    damper = read(damper__container=container_given, damper__packing=packing, damper__lid=lid).damper
    assert damper.lid_wall == wall
    assert damper.lid.measured == "compacted"
    assert read().damper.lid_wall is None


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"damper__container": SPHERE}, 'a container of kind = "sphere" has none'),
        ({"damper__container": MESH}, 'a container of kind = "mesh" has none'),
        ({"damper__lid__wall": "side"}, 'cannot be the "side"'),
        ({"damper__lid__wall": "top"}, "allowed are side, start, end"),
        ({"damper__lid__wall": "start"}, "poured away from wall 'end'"),
        ({"damper__packing": {"direction": [1, 1, 0]}}, "no single flat wall"),
        ({"damper__packing": {"direction": "y"}}, "no single flat wall"),
        ({"damper__lid": {"kind": "rigid", "clearance": 1}}, "only 0.07 m deep"),
        ({"damper__lid__travel": "80 mm"}, "(height - preload + travel)"),
        ({"damper__lid__preload": "10 mm"}, "the foam is solid at 0.01 m"),
        ({"damper__lid__preload": "9.5 mm"}, "hangs 0.009 m above the floor"),
        ({"damper__lid__loss_factor": 2}, "above 1 the foam would pull"),
        ({"damper__lid__pressure": [1, 0, 0]}, "either coefficients (per particle) or pressure"),
        ({"damper__lid__coefficients": GONE}, "either coefficients (per particle) or pressure"),
        ({"damper__lid__coefficients": [12.48, -2.73e3]}, "expected three numbers"),
        ({"damper__lid__coefficients": [1, -1e3, 1e5]}, "a foam only pushes"),
        ({"damper__lid__coefficients": [0, 0, 0]}, "a foam only pushes"),
    ],
)
def test_lids_name_the_mistake(changes, words):
    assert words in message(**{"damper__lid": dict(FOAM), **changes})


def test_the_foam_of_wong_and_rongong_is_accepted_at_every_preload():
    """Printed cubic per ball; 75 balls carry 1.053, 2.556, 5.292 N at 1.5, 4 and 6 mm of preload."""
    for preload, total in ((1.5e-3, 1.053), (4e-3, 2.556), (6e-3, 5.292)):
        foam = FoamLid(**{**FOAM, "preload": preload})
        force = sum(c * preload ** (k + 1) for k, c in enumerate(foam.polynomial))
        assert 75 * force == pytest.approx(total, rel=5e-4)  # four digits
        assert foam.relaxed_height == pytest.approx(9e-3 - preload, rel=1e-12)  # rounding
        assert foam.lid_height == pytest.approx(19e-3 - preload, rel=1e-12)  # rounding


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"law": "linear"}, "either stiffness [N/m] or stiffness_rule"),
        ({"law": "linear", "stiffness": 1e6, "stiffness_rule": "yield-stress"}, "and not both"),
        ({"stiffness": 1e6}, "takes its stiffness from the materials"),
        ({"tangential": "linear"}, 'needs law = "linear"'),
        ({"law": "linear", "stiffness": 1e6, "tangential": "mindlin"}, "needs a Hertz law"),
        ({"shear": "as-printed"}, 'belongs to stiffness_rule = "yield-stress"'),
        ({"shear": "as printed"}, "shear"),
        ({"shear": -1}, "greater than"),
        ({"tension": True}, "never pulls"),
        ({"softening": 0.5}, "greater than or equal to 1"),
        ({"restitution": 0}, "greater than or equal to 0.01"),
        ({"restitution": 1.1}, "less than or equal to 1"),
        ({"restitution": {}}, "a table with speed and restitution"),
        ({"restitution": {"plateau": 0.6}}, "reference_speed: is missing"),
        ({"restitution": {"speed": [1, 2], "restitution": [0.5]}}, "speed has 2 and restitution 1 values"),
        ({"restitution": {"speed": [2, 1], "restitution": [0.5, 0.6]}}, "speed must ascend"),
        ({"restitution": GONE}, "restitution: is missing"),
        ({"friction": -0.1}, "greater than or equal to 0"),
        ({"pairs": [{"between": ["steel-s235", "lead"]}]}, "nothing here is made of 'lead'"),
        ({"pairs": [{"between": ["steel", "aluminium-6060"]}]}, "nearest is 'steel-s235'"),
        ({"pairs": [{"between": ["steel-s235"] * 2}] * 2}, "given twice"),
        ({"pairs": [{"between": ["steel-s235"] * 2, "stiffness": 1}]}, "gives a stiffness, but law"),
    ],
)
def test_contacts_name_the_mistake(given, words):
    table = {**BASE["damper"]["contact"], **given}
    text = message(damper__contact={key: value for key, value in table.items() if value is not GONE})
    assert words in text, text
    assert "damper" in text


def test_pairs_may_name_any_material_touched():
    pairs = [{"between": ["Steel S235", "lead"]}, {"between": ["coating", "steel-s235"]}]
    walls = {"end": {"coating": {"youngs_modulus": 1e6, "poisson_ratio": 0.5, "thickness": 1e-3}}}
    insert = {**STAR, "material": "lead"}
    read(damper__contact__pairs=pairs, damper__container__walls=walls, damper__inserts=[insert])


def test_tapping_may_be_set_or_left_out():
    assert read().damper.packing.tap.frequency == 30
    assert read(damper__packing={"tap": False}).damper.packing.tap is None
    assert read(damper__packing={"tap": True}).damper.packing.tap == read().damper.packing.tap
    assert read(damper__packing={"tap": {"intensity": "3 g"}}).damper.packing.tap.intensity == pytest.approx(
        3
    )  # rounding
    assert "greater than 0" in message(damper__packing={"tap": {"tolerance": 0}})


@pytest.mark.parametrize("strength", [{"intensity": "40 g"}, {"amplitude": "0.99362 mm"}, {"speed": "0.62431 m/s"}])
def test_three_ways_to_say_how_strong(strength):
    spec = read(motion={"kind": "harmonic", "frequency": 100, **strength}).motion
    assert spec.acceleration_amplitude(100) == pytest.approx(40 * STANDARD_GRAVITY, rel=1e-5)  # five digits


PSD = {"kind": "random", "frequencies": [20, 2000], "psd": ["0.04 g^2/Hz", 3.0], "duration": 1}


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"kind": "harmonic", "frequency": 1}, "intensity, amplitude and speed; given: none"),
        ({"kind": "harmonic", "frequency": 1, "intensity": 1, "speed": 1}, "given: intensity, speed"),
        ({"kind": "harmonics", "components": [{"frequency": 1}]}, "given: none of them"),
        ({"kind": "harmonics", "components": []}, "at least 1 item"),
        ({"kind": "sweep", "start": 10, "stop": 10, "duration": 1, "intensity": 1}, 'choose kind = "harmonic"'),
        ({"kind": "series", "file": "a.xlsx"}, "pattern"),
        ({**PSD, "psd": [1]}, "at least two values"),
        ({**PSD, "psd": [1, 1, 1]}, "frequencies has 2 and psd 3"),
        ({**PSD, "frequencies": [20, 10]}, "must ascend"),
        ({**PSD, "psd": [0, 0]}, 'choose kind = "rest"'),
        ({**PSD, "psd": [1, 0]}, "psd is 0 at 2000 Hz"),
        ({**PSD, "duration": 1e-4}, "give a longer duration"),
        ({**PSD, "psd": ["0.04 g^2", 1]}, "'0.04 g^2/Hz'"),
        ({"kind": "rest"}, "run.duration is missing"),
    ],
)
def test_motions_name_the_mistake(given, words):
    assert words in message(motion=given)


def test_spectral_density_is_in_gravities_or_in_si():
    spec = read(motion=PSD).motion
    assert spec.psd == (pytest.approx(0.04 * STANDARD_GRAVITY**2, rel=1e-14), 3.0)  # rounding
    assert read(motion={**PSD, "psd": ["3 (m/s^2)^2/Hz", "3 m^2/s^3"]}).motion.psd == pytest.approx((3, 3))  # rounding


@pytest.mark.parametrize(
    ("given", "run", "duration", "rate"),
    [
        (BASE["motion"], {}, 0.25, 20e3),
        (BASE["motion"], {"cycles": 3.5, "samples_per_cycle": 100}, 0.035, 10e3),
        (BASE["motion"], {"duration": "2 s", "sample_rate": "5 kHz"}, 2, 5e3),
        ({"kind": "harmonics", "components": [{"frequency": f, "intensity": 1} for f in (50, 30)]}, {}, 25 / 30, 6e3),
        ({"kind": "sweep", "start": 10, "stop": 500, "duration": "30 s", "intensity": 2, "law": "log"}, {}, 30, 20e3),
        ({"kind": "series", "file": "road.csv", "unit": "g"}, {}, None, 20e3),
        (PSD, {}, 1, 20e3),
        (PSD, {"duration": 5}, 5, 20e3),
        ({"kind": "rest"}, {"duration": 1}, 1, 20e3),
    ],
)
def test_every_motion_knows_how_long_it_runs(given, run, duration, rate):
    spec = read(motion=given, run=run)
    assert spec.duration == (None if duration is None else pytest.approx(duration, rel=1e-14))  # rounding
    assert spec.sample_rate == pytest.approx(rate, rel=1e-14)  # rounding


@pytest.mark.parametrize(
    ("run", "words"),
    [
        ({"cycles": 3, "duration": 1}, "either cycles or duration"),
        ({"sample_rate": 1e4, "samples_per_cycle": 100}, "either sample_rate or samples_per_cycle"),
        ({"time_step": "1 us", "steps_per_contact": 20}, "either time_step or steps_per_contact"),
        ({"tolerance": 1e-6}, 'belongs to integrator = "gear"'),
        ({"steps_per_contact": 5}, "greater than or equal to 10"),
        ({"integrator": "euler"}, "'verlet' or 'gear'"),
        ({"velocity_field": {}}, "run.velocity_field.cell: is missing"),
    ],
)
def test_runs_name_the_mistake(run, words):
    assert words in message(run=run)


@pytest.mark.parametrize(
    "run", [{"cycles": 3}, {"samples_per_cycle": 100}, {"snapshots_per_cycle": 1}, {"velocity_field": {"cell": 0.01}}]
)
def test_cycles_need_a_motion_that_has_them(run):
    text = message(motion=PSD, run=run)
    assert f"run.{next(iter(run))} needs a motion with cycles" in text


def test_a_run_fits_its_motion():
    sweep = {"kind": "sweep", "start": 10, "stop": 500, "duration": 1, "intensity": 2}
    assert "the sweep ends after 1 s" in message(motion=sweep, run={"duration": 2})
    assert "run longer" in message(motion__soft_start=30)


def test_specs_can_be_made_in_python_too():
    damper = DamperSpec(**BASE["damper"])
    spec = SimulationSpec(damper=damper, motion={"kind": "rest"}, run=RunSpec(duration=1))
    assert spec.damper is damper


EVERY_SPEC = [
    entry
    for module in MODULES
    for entry in vars(module).values()
    if isinstance(entry, type) and issubclass(entry, BaseModel) and entry.__module__ == module.__name__
]


@pytest.mark.parametrize("kind", EVERY_SPEC, ids=lambda kind: kind.__name__)
def test_every_field_has_help_with_its_unit(kind):
    """The text under a field is its help; where the type knows a unit, the help names it."""
    assert issubclass(kind, Spec)
    for name, field in kind.model_fields.items():
        text = helps_of(kind).get(name, "")
        assert text, f"{kind.__name__}.{name} has no help"
        unit = (field.json_schema_extra or {}).get("unit") if isinstance(field.json_schema_extra, dict) else None
        if unit:
            assert f"[{unit}]" in text, f"{kind.__name__}.{name} does not name [{unit}]"


@pytest.mark.parametrize("name", ["steel-s235", "perspex", "lead", "glass"])
def test_particle_materials_are_sourced_and_plausible(name):
    material = MATERIALS[name]
    assert material.source
    assert 1e9 < material.youngs_modulus < 5e11
    assert 0 < material.poisson_ratio < 0.5
    assert 1e3 < material.density < 2e4
    assert material.yield_stress is None or 1e6 < material.yield_stress < 1e10
