"""Number tables of the contacts against values worked out by hand and those of the papers."""

import math

import numpy as np
import pytest

from graindamp.dem import columns
from graindamp.dem.interactions import (
    interactions_of,
    reduced_shear_modulus,
    reduced_youngs_modulus,
    restitution_curve,
)
from graindamp.dem.laws import NormalLaw, TangentialLaw
from graindamp.dem.restitution import loss_table
from graindamp.errors import InputError
from graindamp.spec.contact import ContactMaterialSpec, ContactSpec
from graindamp.spec.model import load_spec, parse_spec
from graindamp.spec.simulation import DamperSpec, SimulationSpec

BALL = {"name": "stainless-steel", "yield_stress": "345 MPa", "poisson_ratio": 0.3}
CYLINDER = {"kind": "cylinder", "radius": "20 mm", "length": "70 mm", "material": "aluminium-6060"}
CONTACT = {"restitution": 0.6, "friction": 0.1}


def damper(contact=None, **more):
    data = {
        "particles": [{"material": "steel-s235", "radius": "1.25 mm"}],
        "fill": {"count": 100},
        "container": CYLINDER,
        "contact": {**CONTACT, **(contact or {})},
        **more,
    }
    return parse_spec(data, DamperSpec, "damper.toml")


def with_walls(**walls):
    return {"container": {**CYLINDER, "walls": walls}}


def test_baseline_damper_has_the_stiffnesses_of_its_paper(request):
    """Steel on steel 3.810e9, steel on aluminium 2.756e9 N/m^1.5 at r = 1.25 mm (E* 114.3 and 58.46 GPa)."""
    spec = load_spec(request.path.parents[1] / "data" / "baseline-damper.toml", SimulationSpec)
    table = interactions_of(spec.damper)
    assert table.names == ("steel-s235", "aluminium-6060 (side, start, end)")
    assert (table.component, set(table.wall.values()), table.insert) == ((0,), {1}, ())
    ball, wall = table.pair[0, 0], table.pair[0, 1]
    radius = spec.damper.particles[0].radius
    assert ball[columns.STIFFNESS] * math.sqrt(radius / 2) == pytest.approx(3.810e9, rel=2e-4)  # four digits
    assert wall[columns.STIFFNESS] * math.sqrt(radius) == pytest.approx(2.756e9, rel=2e-4)  # four digits
    assert table.density.tolist() == [7900, 2700]
    assert ball[columns.FRICTION] == wall[columns.FRICTION] == 0.1
    assert ball[columns.SPEED_SCALE] == wall[columns.SPEED_SCALE] == 0.03
    assert (table.normal, table.tangential) == (NormalLaw.HERTZ_GONTHIER, TangentialLaw.TANH)
    assert not table.rolling
    assert not table.tension
    slow, fast = restitution_curve(spec.damper.contact.restitution)[0](np.array([0.0, np.inf]))
    assert (slow, fast) == (1.0, 0.63)
    assert not np.array_equal(table.loss[0, 0], table.loss[0, 1])  # 0.63 against 0.54


def test_moduli_mix_as_springs_in_series():
    steel = ContactMaterialSpec(youngs_modulus=208e9, poisson_ratio=0.3)
    rubber = ContactMaterialSpec(youngs_modulus=0.72e6, poisson_ratio=0.5)
    assert reduced_youngs_modulus(steel, steel) == pytest.approx(208e9 / (2 * 0.91), rel=1e-15)  # rounding
    assert reduced_youngs_modulus(steel, rubber) == pytest.approx(0.72e6 / 0.75, rel=1e-5)  # moduli apart by 3e5
    assert reduced_shear_modulus(steel, steel) == pytest.approx(80e9 / (2 * 1.7), rel=1e-15)  # rounding; G = 80 GPa


def test_mindlin_stiffness_is_eight_g_star():
    table = interactions_of(damper({"tangential": "mindlin"}))
    assert table.pair[0, 0, columns.SHEAR] == pytest.approx(8 * 80e9 / 3.4, rel=1e-14)  # rounding
    aluminium, steel = 70e9 / 2.66, 80e9
    expected = 8 / (1.67 / aluminium + 1.7 / steel)
    assert table.pair[0, 1, columns.SHEAR] == pytest.approx(expected, rel=1e-14)  # rounding
    halved = interactions_of(damper({"tangential": "mindlin", "shear": 0.5}))
    normal = 2 * reduced_youngs_modulus(*[ContactMaterialSpec(youngs_modulus=208e9, poisson_ratio=0.3)] * 2)
    assert halved.pair[0, 0, columns.SHEAR] == pytest.approx(0.5 * normal, rel=1e-14)  # rounding


def test_linear_ratio_for_equal_materials_is_mindlins():
    table = interactions_of(damper({"law": "linear", "stiffness": "1e6 N/m", "tangential": "linear"}))
    assert table.pair[0, 0, columns.STIFFNESS] == 1e6
    assert table.pair[0, 0, columns.SHEAR] == pytest.approx(2 * 0.7 / 1.7, rel=1e-14)  # rounding
    assert table.pair[0, 0, columns.RULE] == 0


def series(table, a, b, column, radius):
    """Stiffness of the two bodies in series, as the engine forms it at a wall or between equal particles."""
    return 1 / (1 / (table.pair[a, b, column] * radius) + 1 / (table.pair[b, a, column] * radius))


def foam_damper(**contact):
    return damper(
        {"law": "linear", "stiffness_rule": "yield-stress", "tangential": "linear", **contact},
        particles=[{"material": BALL, "radius": "1.5 mm"}],
        container={**CYLINDER, "material": "perspex"},
    )


def test_yield_stress_rule_gives_the_stiffnesses_of_wong_and_rongong():
    table = interactions_of(foam_damper(shear="as-printed"))
    normal, shear = columns.STIFFNESS, columns.SHEAR
    assert np.all(table.pair[0, :, columns.RULE] == 1)
    # four digits each: entity, ball on ball, ball on wall
    assert table.pair[0, 1, normal] * 1.5e-3 == pytest.approx(2.235e6, rel=3e-4)
    assert table.pair[1, 0, normal] * 1.5e-3 == pytest.approx(4.918e5, rel=3e-4)
    assert table.pair[0, 1, shear] * 1.5e-3 == pytest.approx(4.127e6, rel=3e-4)
    assert table.pair[1, 0, shear] * 1.5e-3 == pytest.approx(8.743e5, rel=3e-4)
    assert series(table, 0, 0, normal, 1.5e-3) == pytest.approx(1.118e6, rel=5e-4)
    assert series(table, 0, 0, shear, 1.5e-3) == pytest.approx(2.064e6, rel=5e-4)
    assert series(table, 0, 1, normal, 1.5e-3) == pytest.approx(4.031e5, rel=5e-4)
    assert series(table, 0, 1, shear, 1.5e-3) == pytest.approx(7.215e5, rel=5e-4)


def test_the_contact_reading_of_the_rule_is_plastic_loading_with_the_softer_yield_stress():
    """2.75 pi Y R*: R* is half a radius between equal balls, a whole one at a wall."""
    table = interactions_of(foam_damper(interpretation="contact"))
    ball = 2.75 * math.pi * 345e6 * 0.75e-3
    wall = 2.75 * math.pi * 75.9e6 * 1.5e-3
    assert series(table, 0, 0, columns.STIFFNESS, 1.5e-3) == pytest.approx(ball, rel=1e-14)  # rounding
    assert series(table, 0, 1, columns.STIFFNESS, 1.5e-3) == pytest.approx(wall, rel=1e-14)  # rounding
    ratio = series(table, 0, 0, columns.SHEAR, 1.5e-3) / ball
    assert ratio == pytest.approx(2 * 0.7 / 1.7, rel=1e-14)  # rounding; Mindlin's ratio is the default


def test_the_rule_needs_yield_stresses():
    spec = damper({"law": "linear", "stiffness_rule": "yield-stress"})
    with pytest.raises(InputError, match="yield stress of every material, but aluminium-6060 has none"):
        interactions_of(spec)


def test_a_stiffness_of_its_own_replaces_the_rule():
    spec = foam_damper(pairs=[{"between": ["Stainless steel", "perspex"], "stiffness": "2e5 N/m"}])
    table = interactions_of(spec)
    assert table.pair[0, 0, columns.RULE] == 1
    assert table.pair[0, 1, columns.RULE] == 0
    assert table.pair[0, 1, columns.STIFFNESS] == 2e5


@pytest.mark.parametrize("linear", [{}, {"stiffness": 1e6}, {"stiffness_rule": "yield-stress"}])
def test_softening_divides_every_stiffness_but_no_ratio(linear):
    def table(softening):
        return interactions_of(
            damper(
                {**({"law": "linear", **linear} if linear else {}), "softening": softening},
                particles=[{"material": BALL, "radius": "1.5 mm"}],
                container={**CYLINDER, "material": "perspex"},
            )
        )

    stiff, soft = table(1), table(100)
    assert soft.pair[0, 1, columns.STIFFNESS] == pytest.approx(
        stiff.pair[0, 1, columns.STIFFNESS] / 100, rel=1e-14
    )  # rounding
    factor = 1 if "stiffness" in linear else 100
    assert soft.pair[0, 1, columns.SHEAR] == pytest.approx(
        stiff.pair[0, 1, columns.SHEAR] / factor, rel=1e-14
    )  # rounding
    assert np.array_equal(soft.loss, stiff.loss)  # the loss constants know no stiffness


def test_the_most_specific_description_wins():
    table = interactions_of(
        damper(
            {
                "pairs": [
                    {"between": ["steel-s235", "aluminium 6060"], "friction": 0.2, "restitution": 0.5},
                    {"between": ["steel-s235", "steel-s235"], "rolling_friction": 0.01},
                ]
            },
            **with_walls(start={"friction": 0.3}, end={"material": "lead"}),
        )
    )
    assert table.names == ("steel-s235", "aluminium-6060 (side)", "aluminium-6060 (start)", "lead (end)")
    friction = table.pair[0, :, columns.FRICTION]
    assert friction[table.wall["side"]] == 0.2
    assert friction[table.wall["start"]] == 0.3
    assert friction[table.wall["end"]] == 0.1  # no pair names steel and lead: the contact's own
    assert friction[0] == 0.1
    assert table.rolling
    assert table.pair[0, 0, columns.ROLLING] == 0.01
    assert np.array_equal(table.loss[0, table.wall["side"]], table.loss[0, table.wall["start"]])
    assert not np.array_equal(table.loss[0, table.wall["side"]], table.loss[0, 0])


def test_a_coating_is_touched_and_the_wall_lies_behind():
    coating = {"youngs_modulus": "0.72 MPa", "poisson_ratio": 0.5, "thickness": "3 mm", "restitution": 0.3}
    table = interactions_of(damper(**with_walls(end={"coating": coating, "friction": 0.4})))
    front, back = table.wall["end"], table.backing["end"]
    assert table.names[front] == "coating (coating of end)"
    assert table.names[back] == "aluminium-6060 (behind coating of end)"
    assert table.pair[0, front, columns.STIFFNESS] == pytest.approx(4 / 3 * 0.72e6 / 0.75, rel=1e-5)  # steel is rigid
    assert table.pair[0, front, columns.FRICTION] == 0.1  # the wall's own friction is the wall's, behind
    assert table.pair[0, back, columns.FRICTION] == 0.4
    expected = loss_table("hertz-gonthier", lambda v: np.full(np.shape(v), 0.3), 1.0, False)
    assert np.array_equal(table.loss[0, front], expected)
    assert table.density[front] == 0


def test_inserts_follow_the_walls_in_their_own_order():
    table = interactions_of(
        damper(
            inserts=[
                {"kind": "star", "material": "perspex", "position": "20 mm", "width": "5 mm"},
                {"kind": "cylinder", "material": "lead", "start": [0.01, 0, 0], "end": [0.02, 0, 0], "radius": "2 mm"},
                {"kind": "star", "material": "perspex", "position": "40 mm", "width": "5 mm", "name": "second star"},
            ]
        )
    )
    assert table.insert == (2, 3, 2)
    assert table.names[2:] == ("perspex (insert 1, second star)", "lead (insert 2)")


def test_walls_of_the_particles_material_are_surfaces_of_their_own():
    table = interactions_of(damper(container={**CYLINDER, "material": "steel-s235"}))
    assert table.n_particle_material == 1
    assert table.wall["side"] == 1
    assert np.array_equal(table.pair[0, 0], table.pair[0, 1])


def test_tables_are_symmetric_and_walls_never_meet():
    table = interactions_of(
        damper(
            particles=[{"material": "steel-s235", "radius": 1e-3}, {"material": "lead", "radius": 1e-3}],
            **with_walls(end={"material": "glass"}),
        )
    )
    assert table.component == (0, 1)
    assert np.array_equal(table.pair, table.pair.swapaxes(0, 1))
    assert np.array_equal(table.loss, table.loss.swapaxes(0, 1))
    assert not table.pair[2:, 2:].any()
    assert np.all(table.pair[:2, :, columns.STIFFNESS] > 0)
    assert table.pair.shape == (4, 4, columns.N_COLUMN)
    assert table.loss.shape == (4, 4, columns.N_NODE, 2)


def test_components_of_one_material_share_a_number():
    parts = [{"material": "lead", "radius": 1e-3}, {"material": "lead", "radius": 2e-3}]
    assert interactions_of(damper(particles=parts)).component == (0, 0)


@pytest.mark.parametrize("law", ["hertz-gonthier", "hertz-viscoelastic", "linear"])
def test_every_law_has_its_code_and_finite_tables(law):
    linear = {"stiffness": 1e6} if law == "linear" else {}
    table = interactions_of(damper({"law": law, **linear}))
    assert table.normal == NormalLaw[law.upper().replace("-", "_")]
    assert np.all(np.isfinite(table.loss))
    assert np.all(np.isfinite(table.pair))


@pytest.mark.parametrize("tangential", ["none", "tanh", "mindlin"])
def test_every_tangential_law_has_its_code(tangential):
    assert interactions_of(damper({"tangential": tangential})).tangential == TangentialLaw[tangential.upper()]


@pytest.mark.parametrize(
    ("given", "scale", "at_scale"),
    [
        (0.7, 1.0, 0.7),
        ({"plateau": 0.5, "reference_speed": "20 mm/s", "exponent": 2}, 0.02, 0.75),
        ({"speed": [0.01, 1], "restitution": [0.9, 0.5]}, 0.1, 0.7),  # halfway in ln v
    ],
)
def test_restitution_becomes_a_curve_and_the_speed_of_its_change(given, scale, at_scale):
    spec = ContactSpec(restitution=given, friction=0)
    curve, found = restitution_curve(spec.restitution)
    assert found == pytest.approx(scale, rel=1e-15)  # rounding of the root
    assert curve(np.array([found]))[0] == pytest.approx(at_scale, rel=1e-14)  # rounding
