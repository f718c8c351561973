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
from agglom_mpi.physics.sizes import (
    ListedSizes,
    LognormalSizes,
    UniformSizes,
    draw_radii,
    size_classes,
    third_moment,
)

LAWS = {
    "lognormal": LognormalSizes(math.log(1.3)),
    "uniform": UniformSizes(0.5, 1.5),
    "list": ListedSizes(np.array([0.5, 0.75, 1.0, 1.75])),
}
DRAWS = 100_000


@pytest.mark.parametrize("law", LAWS.values(), ids=LAWS)
def test_drawn_radii_have_the_moments_of_their_law_and_descend(law):
    radii = draw_radii(law, np.random.default_rng(1), DRAWS)
    assert np.all(np.diff(radii) <= 0.0)
    for values, expected in ((radii, 1.0), (radii**3, third_moment(law))):
        error = np.std(values) / math.sqrt(DRAWS)
        assert np.mean(values) == pytest.approx(expected, abs=4.0 * error)


def test_a_lognormal_law_has_its_geometric_standard_deviation():
    logarithms = np.log(draw_radii(LAWS["lognormal"], np.random.default_rng(2), DRAWS))
    error = math.log(1.3) / math.sqrt(2.0 * DRAWS)
    assert np.std(logarithms) == pytest.approx(math.log(1.3), abs=4.0 * error)


@pytest.mark.parametrize("law", [None, ListedSizes(np.ones(3))], ids=["none", "one size"])
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
