import numpy as np
import pytest
from numpy.testing import assert_allclose

from field_made import field_document
from graindamp.errors import InputError
from graindamp.spec.field import FieldSpec, logarithmic
from graindamp.spec.model import parse_spec


def parsed(**changes):
    return parse_spec(field_document() | changes, FieldSpec, "field.toml")


def test_a_plan_without_a_kind_is_a_grid():
    plan = parsed().plan
    assert plan.kind == "grid"
    assert_allclose(plan.frequencies, 40.0 * 25.0 ** (np.arange(28) / 27), rtol=1e-12)
    assert plan.intensities == (1.0, 2.0, 5.0)
    assert len(plan.points) == 84
    assert plan.points[:3] == ((40.0, 1.0), (40.0, 2.0), (40.0, 5.0))


def test_the_ends_of_an_axis_are_exact():
    values = logarithmic(0.8, 40.0, 15)
    assert (values[0], values[-1]) == (0.8, 40.0)
    assert_allclose(np.diff(np.log(values)), np.log(50.0) / 14, rtol=1e-12)


def test_a_point_is_a_whole_simulation():
    spec = parsed(seeds=3, direction="y")
    simulation = spec.at(100.0, 20.0, seed=2)
    assert simulation.motion.frequency == 100.0
    assert simulation.motion.intensity == 20.0
    assert simulation.motion.direction == (0.0, 1.0, 0.0)
    assert simulation.damper.packing.seed == 2
    assert simulation.run.cycles == spec.stop.max_cycles


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"plan": {"frequency": [100, 50], "intensity": [1]}}, "frequency must ascend"),
        ({"plan": {"frequency": {"start": 50, "stop": 50, "count": 3}, "intensity": [1]}}, "must ascend"),
        ({"plan": {"kind": "list", "points": [[100, 1], ["100 Hz", 1]]}}, "there twice"),
        ({"plan": {"kind": "lattice"}}, "allowed are 'grid', 'list', 'adaptive'"),
        ({"plan": {"frequency": [50], "intensities": [1]}}, "nearest valid key is 'intensity'"),
        ({"plan": {"kind": "list", "points": [[100, 1]]}, "hysteresis": "intensity"}, "needs neighbours"),
        ({"stop": {"min_cycles": 40, "max_cycles": 20}}, "more than max_cycles"),
        ({"softening_study": {"points": [[100, 1]], "factors": [10, 1]}}, "factors must ascend"),
        ({"softening_study": {"points": [[100, 1], ["100 Hz", 1]], "factors": [1, 10]}}, "there twice"),
        ({"bed_study": {"points": [[100, 1], [100, 1]]}}, "there twice"),
        ({"bed_study": {"points": [[100, 1]], "seeds": 1}}, "seeds"),
        (
            {"plan": {"kind": "adaptive", "frequency_range": [50, 40], "intensity_range": [1, 2]}},
            "frequency_range must ascend",
        ),
        (
            {
                "plan": {
                    "kind": "adaptive", "frequency_range": [40, 50], "intensity_range": [1, 2], "max_points": 10,
                }
            },
            "more than max_points",
        ),
        (
            {"plan": {key: {"start": 1, "stop": 2, "count": 1000} for key in ("frequency", "intensity")}},
            "at most 100000",
        ),
    ],
)  # fmt: skip
def test_what_makes_no_sense_is_said(changes, message):
    with pytest.raises(InputError, match=message) as caught:
        parsed(**changes)
    assert "field.toml" in str(caught.value)
