import numpy as np
import pytest
from goals import FUNCTION_MEAN, growth_target, maximum_growth, moment_targets
from scipy.stats import norm

from agglom_mpi.outcome import OUTCOME, summaries
from agglom_mpi.search.criteria import Band, NearMaximum, NoCriterionError
from agglom_mpi.search.moments import MomentBands
from agglom_mpi.search.objectives.moment_targets import MomentTarget
from agglom_mpi.search.objectives.objective import Objective

NAMES = ("mean", "spread", "skewness", "kurtosis", "second", "third", "fourth")


def rows(count=50, seed=2):
    """Samples of 3 to 9 particles with radii of their own."""
    rng, found = np.random.default_rng(seed), np.zeros(count, OUTCOME)
    for row in found:
        radii = 1.0 + rng.exponential(0.7, rng.integers(3, 10))
        row["state"], row["particles"], row["mean_radius_ratio"] = 1, len(radii), radii.mean()
        for order in (2, 3, 4):
            row[f"radius_moment_{order}"] = np.mean((radii - radii.mean()) ** order)
    return found


@pytest.mark.parametrize("name", NAMES)
def test_moments_of_the_emulated_numbers_are_those_of_the_objective(name):
    samples = rows()
    criterion = MomentBands({name: 1.0}, 0.05)
    numbers = criterion.numbers(samples, 20).mean(axis=0)
    [found] = criterion.compared(numbers[None])
    [reached] = moment_targets((MomentTarget(name, 1.0),)).reached(summaries(samples))
    assert found[0] == pytest.approx(reached.value, rel=1e-9)


def test_several_moments_keep_their_order():
    samples = rows()
    targets = {"spread": 0.5, "mean": 2.0, "third": 1.0}
    criterion = MomentBands(targets, 0.05)
    found = criterion.compared(criterion.numbers(samples, 20).mean(axis=0)[None])[0]
    terms = tuple(MomentTarget(name, target) for name, target in targets.items())
    reached = moment_targets(terms).reached(summaries(samples))
    assert found == pytest.approx([each.value for each in reached])


def test_all_moments_must_be_within_the_tolerance_of_their_targets():
    criterion = MomentBands({"mean": 2.0, "skewness": 0.0}, 0.1)
    values = np.array([[2.1, 0.05], [2.3, 0.05], [2.1, 0.15]])
    assert criterion.holds(values).tolist() == [True, False, False]


class Certain:
    """An emulator whose mean and deviation are the coordinates of its points."""

    def mean(self, points):
        return points[:, :1]

    def deviation(self, points):
        return points[:, 1:]


def test_the_probability_of_a_band_is_the_normal_one():
    band = Band("mean_radius_ratio", 1.9, 2.1, "")
    mean, deviation = np.array([2.0, 2.3]), np.array([0.1, 0.2])
    expected = norm.cdf(2.1, mean, deviation) - norm.cdf(1.9, mean, deviation)
    found = band.probability(Certain(), np.column_stack((mean, deviation)))
    assert found == pytest.approx(expected)


def test_what_is_near_an_uncertain_maximum_is_near_that_of_each_function():
    slopes = np.array([1.0, 2.0, 4.0])

    class Lines:
        def draw(self, number, random):
            return lambda points: (slopes[:, None] * points[:, 0])[..., None]

    ends, points = np.array([[0.5], [1.0]]), np.array([[0.85], [0.95]])
    found = NearMaximum(0.1).with_emulator(Lines(), lambda: ends, None)
    assert found.maximum == pytest.approx((slopes.mean(), slopes.std()))
    assert found.bounds() == pytest.approx((0.9 * slopes.mean(), np.inf))
    assert found.half_width == pytest.approx(0.1 * slopes.mean())
    assert found.probability(Lines(), points).tolist() == [0.0, 1.0]
    assert found.drawn_members(Lines(), points, None).tolist() == [[False, True]] * 3


def test_each_objective_has_its_criterion():
    growth = growth_target(2.0).criterion(0.05)
    assert growth.bounds() == pytest.approx((1.9, 2.1))
    assert maximum_growth(100).criterion(0.02).share == pytest.approx(0.98)
    function = FUNCTION_MEAN.criterion(0.3)
    assert function.quantities == ("objective",)
    assert function.bounds() == (-np.inf, 0.3)
    terms = (MomentTarget("mean", 2.0), MomentTarget("spread", 0.4))
    moments = moment_targets(terms).criterion(0.05)
    assert moments.quantities == ("mean", "spread")
    assert moments.scales == pytest.approx([0.1, 0.02])


def test_an_objective_that_states_no_criterion_has_none():
    class Entropy(Objective):
        """An objective without a name in files."""

        def accumulator(self):
            raise NotImplementedError

        def of_samples(self, rows):
            raise NotImplementedError

        def influence_values(self, outcomes):
            raise NotImplementedError

    with pytest.raises(NoCriterionError):
        Entropy().criterion(0.05)


def test_growth_and_moments_are_ratios_and_functions_of_ones_own_may_not_be():
    moments = moment_targets((MomentTarget("mean", 2.0),))
    for objective in (growth_target(2.0), maximum_growth(100), moments):
        assert objective.criterion(0.05).of_ratios
    assert not FUNCTION_MEAN.criterion(0.3).of_ratios
