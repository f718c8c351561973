"""Laws of the grains' sizes: draws against their moments; contact values and rates of mixtures."""

import math

import numpy as np
import pytest

from agglom_mpi.physics.kinetic_theory import (
    contact_value,
    enskog_rate,
    mixture_contact_values,
    mixture_rates,
    volume_fraction,
)
from agglom_mpi.physics.size_distributions import (
    ListedDistribution,
    LognormalDistribution,
    UniformDistribution,
    VolumeUniformDistribution,
    draw_radii,
    size_classes,
    third_moment,
)

LAWS = {
    "lognormal": LognormalDistribution(math.log(1.3)),
    "uniform": UniformDistribution(0.5, 1.5),
    "list": ListedDistribution(np.array([0.5, 0.75, 1.0, 1.75])),
    "uniform by volume": VolumeUniformDistribution(2 / 3, 2.0),
    "list by volume": ListedDistribution(np.array([1.0, 1.0, 2.0]) * (17 / 18), by_volume=True),
}
DRAWS = 100_000


@pytest.mark.parametrize("law", LAWS.values(), ids=LAWS)
def test_drawn_radii_have_the_moments_of_their_law_and_descend(law):
    radii = draw_radii(law, np.random.default_rng(1), DRAWS)
    assert np.all(np.diff(radii) <= 0.0)
    for values, expected in ((radii, 1.0), (radii**3, third_moment(law))):
        error = np.std(values) / math.sqrt(DRAWS)
        assert np.mean(values) == pytest.approx(expected, abs=4.0 * error)


@pytest.mark.parametrize("law", LAWS.values(), ids=LAWS)
def test_moments_of_a_law_are_those_of_its_draws(law):
    radii = draw_radii(law, np.random.default_rng(4), DRAWS)
    assert law.moment(1) == pytest.approx(1.0, rel=1e-14)
    for power in (2, 4):
        error = np.std(radii**power) / math.sqrt(DRAWS)
        assert np.mean(radii**power) == pytest.approx(law.moment(power), abs=5.0 * error)


@pytest.mark.parametrize("law", LAWS.values(), ids=LAWS)
def test_a_share_of_grains_and_of_volume_lies_below_a_quantile(law):
    radii = draw_radii(law, np.random.default_rng(5), DRAWS)
    for power in (0, 3):
        weights = radii**power / np.sum(radii**power)
        for share in (0.1, 0.5, 0.9):
            # Rows of a list jump over the share: below it before a row, above it with the row.
            end = law.quantile(share, by_volume=power == 3)
            below = float(weights[radii < end * (1.0 - 1e-9)].sum())
            up_to = float(weights[radii <= end * (1.0 + 1e-9)].sum())
            assert below - 0.01 <= share <= up_to + 0.01


@pytest.mark.parametrize("law", LAWS.values(), ids=LAWS)
def test_the_volume_of_a_sample_varies_as_the_sixth_moment_says(law):
    random, count, samples = np.random.default_rng(6), 50, 4000
    volumes = [np.mean(draw_radii(law, random, count) ** 3) for _ in range(samples)]
    relative = np.std(volumes) / law.third_moment
    # Relative standard error of a standard deviation of heavy tails, generously.
    assert relative == pytest.approx(law.volume_deviation(count), rel=0.15)
    assert ListedDistribution(np.ones(3)).volume_deviation(10) == 0.0


def test_classes_by_volume_of_a_long_list_stand_for_it():
    rows = np.linspace(1.0, 3.0, 1001)
    law = ListedDistribution(rows / (np.sum(rows**-2) / np.sum(rows**-3.0)), by_volume=True)
    assert law.moment(1) == pytest.approx(1.0, rel=1e-14)
    assert law.third_moment == pytest.approx(
        VolumeUniformDistribution(2 / 3, 2).third_moment, rel=1e-2
    )
    ratios, shares = size_classes(law)
    assert shares @ ratios == pytest.approx(1.0, rel=1e-2)
    assert shares @ ratios**3 == pytest.approx(law.third_moment, rel=2e-2)


def test_a_lognormal_law_has_its_geometric_standard_deviation():
    logarithms = np.log(draw_radii(LAWS["lognormal"], np.random.default_rng(2), DRAWS))
    error = math.log(1.3) / math.sqrt(2.0 * DRAWS)
    assert np.std(logarithms) == pytest.approx(math.log(1.3), abs=4.0 * error)


@pytest.mark.parametrize("law", [None, ListedDistribution(np.ones(3))], ids=["none", "one size"])
def test_equal_grains_draw_nothing(law):
    random = np.random.default_rng(3)
    assert draw_radii(law, random, 5).tolist() == [1.0] * 5
    assert random.bit_generator.state == np.random.default_rng(3).bit_generator.state
    assert third_moment(law) == 1.0


@pytest.mark.parametrize("law", LAWS.values(), ids=LAWS)
def test_classes_of_sizes_stand_for_their_law(law):
    ratios, shares = size_classes(law)
    assert shares.sum() == pytest.approx(1.0, rel=1e-12)
    assert shares @ ratios == pytest.approx(1.0, rel=1e-3)
    assert shares @ ratios**3 == pytest.approx(third_moment(law), rel=1e-2)


def test_a_mixture_of_equal_spheres_is_that_of_carnahan_and_starling_and_enskog():
    densities, diameter = np.array([1e6, 3e6]), 4e-3
    fraction = volume_fraction(4e6, diameter)
    chi = mixture_contact_values(densities, np.full(2, diameter))
    assert chi == pytest.approx(np.full((2, 2), contact_value(fraction)), rel=1e-13)
    rates = mixture_rates(densities, np.full(2, diameter), np.full(2, 2.0), 5.0)
    assert rates.sum(axis=1) == pytest.approx(enskog_rate(4e6, diameter, 5.0, 2.0), rel=1e-13)


def test_both_species_count_the_same_collisions_with_each_other():
    densities = np.array([2e6, 5e4])
    rates = mixture_rates(densities, np.array([2e-3, 7e-3]), np.array([1.0, 40.0]), 1.0)
    assert densities[0] * rates[0, 1] == pytest.approx(densities[1] * rates[1, 0], rel=1e-13)


def test_a_point_among_spheres_finds_the_free_share_of_the_volume():
    """As its diameter vanishes, χ at contact with any sphere is 1/(1 − φ)."""
    chi = mixture_contact_values(np.array([1.0, 3e6]), np.array([1e-12, 4e-3]))
    assert chi[0, 1] == pytest.approx(1.0 / (1.0 - volume_fraction(3e6, 4e-3)), rel=1e-8)
