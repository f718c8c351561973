import numpy as np
import pytest
from scipy.stats import norm

from agglom_mpi.inference.criteria import Band, MomentBands, NearMaximum, criterion_of
from agglom_mpi.outcome import OUTCOME, summaries
from agglom_mpi.search.moment_targets import MomentTarget, MomentTargets

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
    [reached] = MomentTargets((MomentTarget(name, 1.0),)).reached(summaries(samples))
    assert found[0] == pytest.approx(reached.value, rel=1e-9)


def test_several_moments_keep_their_order():
    samples = rows()
    targets = {"spread": 0.5, "mean": 2.0, "third": 1.0}
    criterion = MomentBands(targets, 0.05)
    found = criterion.compared(criterion.numbers(samples, 20).mean(axis=0)[None])[0]
    terms = tuple(MomentTarget(name, target) for name, target in targets.items())
    reached = MomentTargets(terms).reached(summaries(samples))
    assert found == pytest.approx([each.value for each in reached])


def test_all_moments_must_be_within_the_tolerance_of_their_targets():
    criterion = MomentBands({"mean": 2.0, "skewness": 0.0}, 0.1)
    values = np.array([[2.1, 0.05], [2.3, 0.05], [2.1, 0.15]])
    assert criterion.holds(values).tolist() == [True, False, False]


def test_the_probability_of_a_band_is_the_normal_one():
    band = Band("mean_radius_ratio", 1.9, 2.1, "")
    mean, deviation = np.array([2.0, 2.3]), np.array([0.1, 0.2])
    expected = norm.cdf(2.1, mean, deviation) - norm.cdf(1.9, mean, deviation)
    assert band.probability(mean, deviation) == pytest.approx(expected)


def test_each_objective_has_its_criterion():
    growth = criterion_of({"law": "growth_target", "ratio": 2.0}, 0.05)
    assert isinstance(growth, Band)
    assert growth.bounds() == pytest.approx((1.9, 2.1))
    most = criterion_of({"law": "maximum_growth"}, 0.02)
    assert isinstance(most, NearMaximum)
    assert most.bounds(4.0) == pytest.approx((3.92, np.inf))
    function = criterion_of({"law": "function", "call": "a:b"}, 0.3)
    assert function.bounds() == (-np.inf, 0.3)
    moments = criterion_of({"law": "moments", "targets": {"mean": 2.0, "spread": 0.4}}, 0.05)
    assert moments.quantities == ("mean", "spread")
