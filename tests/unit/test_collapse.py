"""Do curves fall onto one: made curves with known answers."""

import numpy as np
import pytest

from graindamp.errors import InputError
from graindamp.signals.collapse import collapse


def family(scales, noise=0.0, seed=0):
    """Curves of one law y(x / scale) and its scales, x evenly over the logarithm."""
    rng = np.random.default_rng(seed)
    x = [scale * np.geomspace(0.1, 10.0, 60) for scale in scales]
    return x, [
        np.exp(-(np.log(one / scale) ** 2)) + noise * rng.normal(size=60) for one, scale in zip(x, scales, strict=True)
    ]


def test_one_law_collapses_over_its_own_variable_only():
    scales = (1.0, 2.0, 4.0)
    x, y = family(scales)
    over_x = collapse(x, y)
    over_ratio = collapse([one / scale for one, scale in zip(x, scales, strict=True)], y)
    # Local means flatten a Gaussian of ln x by half its curvature times the width squared: 0.115^2 at most.
    assert over_ratio.scatter < 0.012
    assert over_ratio.n_left == 0
    assert over_x.unexplained > 0.5
    assert over_x.n_left > 0  # the outermost points have no other curve near them


def test_scatter_is_that_of_the_noise():
    # A point's own noise, and that of the mean of seven others over some points each: a little above 0.1.
    x, y = family(8 * (1.0,), noise=0.1)
    assert collapse(x, y).scatter == pytest.approx(0.1, rel=0.1)  # 480 points: 3 %; the mean of the others: 2 %


def test_scale_of_the_variable_does_not_matter():
    x, y = family((1.0, 1.5), noise=0.05)
    found = collapse(x, y)
    again = collapse([1e-3 * one for one in x], y)
    assert again.scatter == pytest.approx(found.scatter, rel=1e-9)  # rounding
    assert again.n_point == found.n_point


def test_variable_that_tells_nothing_explains_nothing():
    rng = np.random.default_rng(1)
    x = [np.sort(rng.uniform(1.0, 10.0, 200)) for _ in range(3)]
    # Noise about a common mean: the difference to it has the spread, and a little more for the noise of the mean.
    assert collapse(x, [rng.normal(size=200) for _ in x]).unexplained == pytest.approx(1.05, abs=0.1)


@pytest.mark.parametrize(
    ("x", "y", "options", "words"),
    [
        ([[1.0]], [[1.0]], {}, "two at least"),
        ([[1.0], [1.0, 2.0]], [[1.0], [1.0]], {}, "curve 2 has shapes"),
        ([[1.0], [0.0]], [[1.0], [1.0]], {}, "not above 0"),
        ([[1.0], [1.0]], [[1.0], [np.nan]], {}, "not finite"),
        ([[1.0], [1.0]], [[1.0], [1.0]], {"width": 0.0}, "width is 0.0"),
        ([[1.0], [10.0]], [[1.0], [1.0]], {}, "nothing to compare"),
    ],
)
def test_what_cannot_be_compared_is_said(x, y, options, words):
    with pytest.raises(InputError, match=words):
        collapse(x, y, **options)
