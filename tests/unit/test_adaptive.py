import numpy as np
import pytest

from graindamp.errors import InputError
from graindamp.field.adaptive import (
    LEAST_DISTANCE,
    candidates,
    coarse_start,
    cycles_cost,
    error_ratio,
    is_accurate,
    next_points,
)
from graindamp.field.surrogate import Surrogate
from graindamp.units import STANDARD_GRAVITY

pytest.importorskip("sklearn")

RANGES = (40.0, 400.0), (1.0, 40.0)
OPTIMUM = 1e-3
CLEARANCE = np.pi * OPTIMUM


@pytest.fixture(scope="module")
def surrogate():
    """Sixteen exact points of a field that jumps at X = 0.6 X_opt."""
    f, gamma = candidates(*RANGES, (4, 4))
    stroke = gamma * STANDARD_GRAVITY / (2 * np.pi * f) ** 2 / OPTIMUM
    eta = np.where(stroke > 0.6, 1.2 / (1 + stroke), 0.4 / (1 + gamma / 3))
    mass = np.where(stroke > 0.6, 0.8, 1 / (1 + gamma))
    error = 0.02 * np.maximum(eta, 0.05)
    return Surrogate.of_arrays(f, gamma, eta, mass, error, error, clearance=CLEARANCE)


@pytest.fixture(scope="module")
def grid():
    return candidates(*RANGES, (14, 8))


def test_candidates_fill_the_range():
    f, gamma = candidates(*RANGES)
    assert len(f) == len(gamma) == 28 * 15
    assert (f.min(), f.max(), gamma.min(), gamma.max()) == pytest.approx((40, 400, 1, 40))


@pytest.mark.parametrize("limits", [(40.0, 40.0), (0.0, 40.0), (50.0, 40.0), (1.0, np.inf), (np.nan, 3.0)])
def test_a_range_ascends_from_above_zero(limits):
    with pytest.raises(InputError, match="must ascend"):
        candidates(limits, (1.0, 40.0))
    with pytest.raises(InputError, match="must ascend"):
        candidates((40.0, 400.0), limits)


def test_one_value_is_no_axis():
    with pytest.raises(InputError, match="at least two"):
        candidates(*RANGES, (1, 5))


def test_a_start_looks_on_both_sides_of_the_expected_edge():
    plain, aware = coarse_start(*RANGES), coarse_start(*RANGES, clearance=CLEARANCE)
    assert len(plain) == 16
    assert aware[:16] == plain
    stroke = [gamma * STANDARD_GRAVITY / (2 * np.pi * f) ** 2 / OPTIMUM for f, gamma in aware[16:]]
    assert stroke == pytest.approx([0.3, 1.2])


def test_a_start_leaves_out_what_lies_outside():
    assert len(coarse_start((2000.0, 4000.0), (1.0, 40.0), clearance=CLEARANCE)) == 16
    with pytest.raises(InputError, match="clearance is 0"):
        coarse_start(*RANGES, clearance=0.0)


def test_the_worst_point_comes_first_and_all_need_it(surrogate, grid):
    chosen = next_points(surrogate, grid, 5)
    ratio = error_ratio(surrogate, *grid)
    assert len(chosen) == 5
    assert chosen[0].ratio == pytest.approx(ratio.max())
    assert all(choice.ratio > 1 for choice in chosen)
    assert next_points(surrogate, grid, 5) == chosen


def test_a_batch_keeps_its_distance(surrogate, grid):
    chosen = np.log([[choice.frequency, choice.intensity] for choice in next_points(surrogate, grid, 5)])
    known = np.log(np.column_stack([surrogate.frequency, surrogate.intensity]))
    gaps = np.linalg.norm(chosen[:, None] - np.concatenate([known, chosen]), axis=2)
    assert np.all(np.sort(gaps, axis=1)[:, 1] >= LEAST_DISTANCE)
    wide = next_points(surrogate, grid, 5, least_distance=0.6)
    places = np.log([[choice.frequency, choice.intensity] for choice in wide])
    assert all(np.linalg.norm(a - b) >= 0.6 for i, a in enumerate(places) for b in places[:i])


def test_running_points_count_as_chosen(surrogate, grid):
    """What follows one choice is the same whether that choice is running or in the batch."""
    first, second, third = next_points(surrogate, grid, 3)
    rest = next_points(surrogate, grid, 2, busy=[(first.frequency, first.intensity)])
    for choice, other in zip(rest, (second, third), strict=True):
        assert choice == pytest.approx(other, rel=1e-6)  # rounding


def test_a_cost_weighs_against_the_variance(surrogate, grid):
    """One choice of all candidates is the largest ratio squared per cost; a steep cost moves it to cheap points."""

    def steep(f, gamma):
        return f**-6.0

    far = np.array([np.min(np.hypot(np.log(surrogate.frequency / f), np.log(surrogate.intensity / gamma)))
                    for f, gamma in zip(*grid, strict=True)]) >= LEAST_DISTANCE  # fmt: skip
    ratio = np.where(far, error_ratio(surrogate, *grid), 0.0)
    for cost in (cycles_cost, steep):
        best = np.argmax(np.where(ratio > 1.0, ratio**2 / cost(*grid), 0.0))
        assert next_points(surrogate, grid, 1, cost=cost)[0][:2] == (grid[0][best], grid[1][best])
    plain, priced = next_points(surrogate, grid, 1)[0], next_points(surrogate, grid, 1, cost=steep)[0]
    assert priced.frequency > plain.frequency


def test_a_budget_is_kept(surrogate, grid):
    assert len(next_points(surrogate, grid, 5, budget=3)) == 3
    chosen = next_points(surrogate, grid, 9, cost=cycles_cost, budget=0.02)
    assert chosen
    assert sum(1 / choice.frequency for choice in chosen) <= 0.02
    assert next_points(surrogate, grid, 5, budget=0.0) == []


def test_nothing_is_chosen_once_accurate(surrogate, grid):
    assert next_points(surrogate, grid, 5, accuracy=100.0) == []
    assert next_points(surrogate, (surrogate.frequency, surrogate.intensity), 5) == []


@pytest.mark.parametrize("cost", [lambda f, gamma: 0.0 * f, lambda f, gamma: np.nan * f])
def test_a_cost_is_above_zero(surrogate, grid, cost):
    with pytest.raises(InputError, match="cost"):
        next_points(surrogate, grid, 1, cost=cost)


def test_a_verdict_says_where(surrogate):
    verdict = is_accurate(surrogate, *RANGES)
    assert not verdict.is_accurate
    ratio = error_ratio(surrogate, verdict.frequency, verdict.intensity)
    assert verdict.worst_ratio == pytest.approx(float(ratio), rel=1e-9)  # sums of another length round differently
    assert verdict.median_ratio < verdict.worst_ratio
    assert 0 < verdict.share < 1
    loose = is_accurate(surrogate, *RANGES, accuracy=100.0)
    assert loose.is_accurate
    assert loose.share == 1.0
    with pytest.raises(InputError, match="accuracy is 0"):
        is_accurate(surrogate, *RANGES, accuracy=0.0)
