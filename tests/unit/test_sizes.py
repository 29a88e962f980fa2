"""Radii as drawn against the distribution that was described, and the mean volume against closed forms."""

import math

import numpy as np
import pytest
from scipy.stats import truncnorm

from graindamp.dem.sizes import apportion, count_for, draw, draw_bed, mean_particle, mean_volume
from graindamp.errors import InputError
from graindamp.spec.particles import (
    BedComponent,
    DiscreteRadius,
    ListRadius,
    LognormalRadius,
    NormalRadius,
    UniformRadius,
)

N = 20_000
SPHERE = 4 / 3 * math.pi

RADII = {
    "length": 1e-3,
    "normal": NormalRadius(mean=1e-3, std=1e-4),
    "one-sided": NormalRadius(mean=1e-3, std=5e-4, min=2e-4, max=1.2e-3),
    "uniform": UniformRadius(low=5e-4, high=2e-3),
    "lognormal": LognormalRadius(median=1e-3, spread=0.3),
    "discrete": DiscreteRadius(radius=(1e-3, 2e-3), share=(3, 1)),
    "list": ListRadius(radius=tuple(np.linspace(1e-3, 2e-3, N))),
}


def drawn(name, n=N, seed=1):
    return draw(RADII[name], n, np.random.default_rng(seed))


@pytest.mark.parametrize("name", RADII)
def test_radii_are_positive_and_within_their_limits(name):
    radius = drawn(name)
    assert radius.shape == (N,)
    assert radius.dtype == np.float64
    assert np.all(radius > 0)
    limits = getattr(RADII[name], "limits", (RADII[name], RADII[name]))
    assert limits[0] <= radius.min() <= radius.max() <= limits[1]


@pytest.mark.parametrize("name", RADII)
def test_the_same_seed_draws_the_same_radii(name):
    assert np.array_equal(drawn(name), drawn(name))


@pytest.mark.parametrize("name", RADII)
def test_mean_volume_is_that_of_the_radii_drawn(name):
    volume = SPHERE * drawn(name) ** 3
    error = volume.std() / math.sqrt(N)
    assert mean_volume(RADII[name]) == pytest.approx(volume.mean(), abs=4 * error, rel=1e-12)  # four standard errors


@pytest.mark.parametrize("name", ["normal", "one-sided"])
def test_normal_radii_have_mean_and_spread_of_the_cut_off_distribution(name):
    spec, radius = RADII[name], drawn(name)
    low, high = spec.limits
    exact = truncnorm((low - spec.mean) / spec.std, (high - spec.mean) / spec.std, spec.mean, spec.std)
    error = exact.std() / math.sqrt(N)
    assert radius.mean() == pytest.approx(exact.mean(), abs=4 * error)  # four standard errors
    assert radius.std() == pytest.approx(
        exact.std(), abs=4 * error
    )  # std of std is error / sqrt(2) for a normal sample
    assert mean_volume(spec) == pytest.approx(SPHERE * exact.moment(3), rel=1e-9)  # its own rounding in the tails


def test_three_standard_deviations_change_the_spread_by_little():
    radius = drawn("normal")
    assert radius.mean() == pytest.approx(1e-3, abs=4 * 1e-4 / math.sqrt(N))  # four standard errors
    assert radius.std() == pytest.approx(0.9866e-4, rel=0.02)  # 0.9866 by the cut; 4 / sqrt(2 N) of scatter


def test_lognormal_radii_by_their_logarithms():
    logarithm = np.log(drawn("lognormal") / 1e-3)
    assert logarithm.mean() == pytest.approx(0, abs=4 * 0.3 / math.sqrt(N))  # four standard errors
    assert logarithm.std() == pytest.approx(0.9866 * 0.3, rel=0.02)  # as for normal radii


def test_mean_volume_of_a_wide_lognormal_tends_to_its_closed_form():
    """E[r^3] = median^3 exp(9 s^2 / 2) without a cut; at s = 0.1, cut at 10 s, nothing is missing."""
    spec = LognormalRadius(median=1e-3, spread=0.1, min=1e-3 * math.exp(-1), max=1e-3 * math.exp(1))
    assert mean_volume(spec) == pytest.approx(SPHERE * 1e-9 * math.exp(0.045), rel=1e-11)  # tails beyond 9.7 s


def test_mean_volume_of_uniform_and_discrete_radii():
    nodes = np.linspace(5e-4, 2e-3, 100_001)
    assert mean_volume(RADII["uniform"]) == pytest.approx(SPHERE * np.mean(nodes**3), rel=1e-4)  # ends weigh 1e-5 each
    assert mean_volume(RADII["discrete"]) == pytest.approx(SPHERE * (3 * 1e-9 + 8e-9) / 4, rel=1e-14)  # rounding


def test_discrete_radii_meet_their_shares_exactly():
    radius = drawn("discrete")
    assert np.count_nonzero(radius == 1e-3) == 15_000
    assert not np.all(np.diff(radius[:100]) >= 0)  # mixed, not sorted


def test_a_list_keeps_its_order_and_its_length():
    assert np.array_equal(drawn("list"), RADII["list"].radius)
    with pytest.raises(InputError, match="20000 values, but 3 particles"):
        drawn("list", n=3)


@pytest.mark.parametrize(
    ("share", "n", "counts"),
    [
        ((1,), 7, [7]),
        ((1, 1), 5, [3, 2]),
        ((1, 2, 3), 6, [1, 2, 3]),
        ((1, 1, 1), 1, [1, 0, 0]),
        ((0.6, 0.4), 0, [0, 0]),
    ],
)
def test_apportion_gives_whole_numbers_near_the_shares(share, n, counts):
    assert apportion(share, n).tolist() == counts


def bed(*radii, **more):
    return tuple(BedComponent(material="steel", radius=radius, **more) for radius in radii)


def test_a_bed_mixes_its_components_by_number():
    radius, component = draw_bed(bed(1e-3, 2e-3), 1000, np.random.default_rng(2))
    assert np.count_nonzero(component == 0) == 500
    assert np.all(radius == np.where(component == 0, 1e-3, 2e-3))
    assert 300 < np.count_nonzero(np.diff(component)) < 700  # 500 expected, 16 standard deviations wide


def test_lists_say_how_many_there_are():
    components = bed(ListRadius(radius=(1e-3, 2e-3)), ListRadius(radius=(3e-3,)))
    radius, component = draw_bed(components, None, np.random.default_rng(0))
    assert radius.tolist() == [1e-3, 2e-3, 3e-3]
    assert component.tolist() == [0, 0, 1]
    with pytest.raises(InputError, match="3 values, but 4"):
        draw_bed(components, 4, np.random.default_rng(0))
    with pytest.raises(InputError, match="number of particles is missing"):
        draw_bed(bed(1e-3), None, np.random.default_rng(0))


def test_count_for_the_mass_of_the_baseline_damper():
    """291 g of steel balls of 1.25 mm radius and 7900 kg/m^3 are 4502; Meyer & Seifried (2023) say about 4500."""
    components = (BedComponent(material="steel-s235", radius="1.25 mm"),)
    assert mean_particle(components)[1] == pytest.approx(6.463e-5, rel=1e-4)  # four printed digits
    assert count_for(components, mass=0.291) == 4502
    assert count_for(components, volume=0.291 / 7900) == 4502
    with pytest.raises(InputError, match="less than half a particle"):
        count_for(components, mass=1e-5)


def test_mean_particle_weighs_components_by_number():
    lead = BedComponent(material="lead", radius=2e-3, share=1)
    steel = BedComponent(material="steel", radius=1e-3, share=3)
    volume, mass = mean_particle((lead, steel))
    assert volume == pytest.approx(SPHERE * (8e-9 + 3e-9) / 4, rel=1e-14)  # rounding
    assert mass == pytest.approx(SPHERE * (8e-9 * 11350 + 3e-9 * 7850) / 4, rel=1e-14)  # rounding
