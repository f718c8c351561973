import numpy as np
import pytest
from search_fakes import completed

from agglom_mpi.config import objective as config
from agglom_mpi.search.objectives import GrowthTarget, MaximumGrowth


def test_growth_target_is_the_relative_miss_of_the_wanted_radius():
    assert GrowthTarget().of_ratio(2.0) == 0.0
    assert GrowthTarget().of_ratio(1.0) == 0.5
    assert GrowthTarget(4.0).of_ratio(np.array([4.0, 6.0, 2.0])).tolist() == [0.0, 0.5, 0.5]


def test_growth_target_judges_the_mean_radius_not_the_mean_miss():
    ratios = np.array([1.0, 3.0])
    assert GrowthTarget().of_ensemble(map(completed, ratios))[0] == 0.0
    assert np.mean(GrowthTarget().of_ratio(ratios)) == 0.5


def test_maximum_growth_runs_from_no_growth_to_a_single_sphere():
    objective = MaximumGrowth(1000)
    assert objective.of_ratio(10.0) == 0.0
    assert objective.of_ratio(1.0) == pytest.approx(0.9, rel=1e-15)
    assert objective.of_ensemble(map(completed, [2.0, 4.0]))[0] == pytest.approx(0.7, rel=1e-15)


def test_the_published_best_string_of_paper_b_has_its_published_value():
    assert MaximumGrowth(1000).of_ratio(3.2292) == pytest.approx(0.67708, abs=1e-9)


@pytest.mark.parametrize("objective", [GrowthTarget(), MaximumGrowth(1000)])
def test_one_sample_has_no_standard_error_and_none_is_worth_inf(objective):
    value, error = objective.of_ensemble([completed(3.0)])
    assert value == objective.of_ratio(3.0)
    assert np.isnan(error)
    value, error = objective.of_ensemble([])
    assert value == np.inf
    assert np.isnan(error)


@pytest.mark.parametrize("objective", [GrowthTarget(2.0), GrowthTarget(5.0), MaximumGrowth(1000)])
def test_the_standard_error_is_the_scatter_of_repeated_ensembles(objective):
    samples, repeats, deviation = 8, 5000, 0.05
    rng = np.random.default_rng(20031)
    ratios = rng.normal(2.5, deviation, (repeats, samples))
    values, errors = np.array([objective.of_ensemble(map(completed, row)) for row in ratios]).T
    scale = objective.ratio if isinstance(objective, GrowthTarget) else 10.0
    variance = (deviation / scale) ** 2 / samples
    # A sample variance of n normal numbers has relative standard deviation sqrt(2/(n-1)), and
    # the squared errors are such variances of `samples` numbers, averaged over the repeats.
    assert abs(np.var(values, ddof=1) / variance - 1) < 4 * np.sqrt(2 / (repeats - 1))
    assert abs(np.mean(errors**2) / variance - 1) < 4 * np.sqrt(2 / (samples - 1) / repeats)


def test_a_campaign_names_its_objective():
    target = config.GrowthTarget(law="growth_target", ratio=3.0)
    assert target.build(100) == GrowthTarget(3.0)
    assert config.MaximumGrowth(law="maximum_growth").build(1000) == MaximumGrowth(1000)
