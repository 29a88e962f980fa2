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
    learned_cost,
    nearest,
    next_points,
)
from graindamp.field.surrogate import Surrogate
from graindamp.spec.field import logarithmic
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
    assert len(plain) == 16  # 4, 3, 4 and 3 with the two corners
    assert aware[:16] == plain
    stroke = [gamma * STANDARD_GRAVITY / (2 * np.pi * f) ** 2 / OPTIMUM for f, gamma in aware[16:]]
    assert stroke == pytest.approx([0.3, 1.2])


def test_a_start_is_staggered_and_spans_the_range():
    start = np.array(coarse_start(*RANGES, 4, 4))
    columns = [start[start[:, 0] == f, 1] for f in np.unique(start[:, 0])]
    between = np.sqrt(columns[0][1:] * columns[0][:-1])
    assert columns[1] == pytest.approx(between)
    assert columns[2] == pytest.approx(columns[0])
    assert columns[3] == pytest.approx([1.0, *between, 40.0])


def test_candidates_are_those_of_a_grid_plan():
    """To the last bit: a result is known by its frequency and intensity."""
    f, gamma = candidates(*RANGES, (28, 15))
    assert set(f) == set(logarithmic(*RANGES[0], 28))
    assert set(gamma) == set(logarithmic(*RANGES[1], 15))


def test_a_start_moves_onto_the_candidates(grid):
    start = coarse_start(*RANGES, clearance=CLEARANCE)
    moved = nearest([*start, start[0]], grid)
    assert set(moved) <= set(zip(*grid, strict=True))
    assert len(set(moved)) == len(moved) <= len(start)
    assert moved[0] == (RANGES[0][0], RANGES[1][0])


def test_a_cost_is_learned_where_it_was_paid():
    """Ten times the cycles about one place: dear there, and far away as cheap as the others."""
    f, gamma = candidates(*RANGES, (6, 6))
    dear = (f == f[0]) & (gamma == gamma[-1])
    cost = learned_cost(f, gamma, np.where(dear, 10.0, 1.0) / f)
    assert cost(f[dear], gamma[dear])[0] > 2 / f[0]  # the neighbours have a say: 10^0.4
    far = np.hypot(np.log(f / f[0]), np.log(gamma / gamma[-1])) > 2
    assert cost(f[far], gamma[far]) == pytest.approx(1 / f[far], rel=0.02)
    with pytest.raises(InputError, match="of one point at least"):
        learned_cost([], [], [])
    with pytest.raises(InputError, match="above 0"):
        learned_cost([100.0], [1.0], [0.0])


def test_a_start_leaves_out_what_lies_outside():
    assert len(coarse_start((2000.0, 4000.0), (1.0, 40.0), clearance=CLEARANCE)) == 16
    with pytest.raises(InputError, match="clearance is 0"):
        coarse_start(*RANGES, clearance=0.0)


def test_points_lie_where_they_help_most(surrogate, grid):
    """The first choice lowers the errors of the range more than the worst place alone would."""
    chosen = next_points(surrogate, grid, 5)
    ratio = error_ratio(surrogate, *grid)
    assert len(chosen) == 5
    at = np.flatnonzero((grid[0] == chosen[0].frequency) & (grid[1] == chosen[0].intensity))[0]
    assert chosen[0].ratio == pytest.approx(ratio[at])
    assert next_points(surrogate, grid, 5) == chosen
    joint = surrogate.joint(*grid)

    def left(k):
        squares = []
        for covariance, noise, error in zip(*joint, _errors(surrogate, grid), strict=True):
            variance = np.diagonal(covariance)
            taken = covariance[:, k] ** 2 / variance / (variance[k] + noise[k])
            squares.append(error**2 * np.clip(1 - taken, 0, 1))
        return np.sum(np.sqrt(np.maximum(np.sqrt(np.maximum(*squares)), 1.0)))

    assert left(at) < left(int(np.argmax(ratio)))
    assert left(at) == pytest.approx(min(left(k) for k in range(len(ratio))))


def _errors(surrogate, grid):
    """Predicted standard errors of eta and m' over 5 % of max(eta, 0.05)."""
    values = surrogate.predict(*grid)
    asked = 0.05 * np.maximum(values.loss_factor, 0.05)
    return values.loss_factor_se / asked, values.effective_mass_ratio_se / asked


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


def test_a_steep_cost_moves_the_choice_to_cheap_points(surrogate, grid):
    plain = next_points(surrogate, grid, 1)[0]
    priced = next_points(surrogate, grid, 1, cost=lambda f, gamma: f**-6.0)[0]
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
