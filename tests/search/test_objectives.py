import numpy as np
import pytest
from goals import growth_target, maximum_growth
from search_fakes import completed

from agglom_mpi.search.objectives.moment_targets import MomentTargets
from agglom_mpi.search.objectives.objective import Objective


def test_growth_target_is_the_relative_miss_of_the_wanted_radius():
    assert growth_target().of_ratio(2.0) == 0.0
    assert growth_target().of_ratio(1.0) == 0.5
    assert growth_target(4.0).of_ratio(np.array([4.0, 6.0, 2.0])).tolist() == [0.0, 0.5, 0.5]


def test_growth_target_judges_the_mean_radius_not_the_mean_miss():
    ratios = np.array([1.0, 3.0])
    assert growth_target().of_ensemble(map(completed, ratios))[0] == 0.0
    assert np.mean(growth_target().of_ratio(ratios)) == 0.5


def test_maximum_growth_runs_from_no_growth_to_a_single_sphere():
    objective = maximum_growth(1000)
    assert objective.of_ratio(10.0) == 0.0
    assert objective.of_ratio(1.0) == pytest.approx(0.9, rel=1e-15)
    assert objective.of_ensemble(map(completed, [2.0, 4.0]))[0] == pytest.approx(0.7, rel=1e-15)


def test_the_published_best_string_of_paper_b_has_its_published_value():
    assert maximum_growth(1000).of_ratio(3.2292) == pytest.approx(0.67708, abs=1e-9)


@pytest.mark.parametrize("objective", [growth_target(), maximum_growth(1000)])
def test_one_sample_has_no_standard_error_and_none_is_worth_inf(objective):
    value, error = objective.of_ensemble([completed(3.0)])
    assert value == objective.of_ratio(3.0)
    assert np.isnan(error)
    value, error = objective.of_ensemble([])
    assert value == np.inf
    assert np.isnan(error)


@pytest.mark.parametrize(
    "objective", [growth_target(2.0), growth_target(5.0), maximum_growth(1000)]
)
def test_the_standard_error_is_the_scatter_of_repeated_ensembles(objective):
    samples, repeats, deviation = 8, 5000, 0.05
    rng = np.random.default_rng(20031)
    ratios = rng.normal(2.5, deviation, (repeats, samples))
    values, errors = np.array([objective.of_ensemble(map(completed, row)) for row in ratios]).T
    scale = objective.ratio if objective.is_magnitude else 10.0
    variance = (deviation / scale) ** 2 / samples
    # A sample variance of n normal numbers has relative standard deviation sqrt(2/(n-1)), and
    # the squared errors are such variances of `samples` numbers, averaged over the repeats.
    assert abs(np.var(values, ddof=1) / variance - 1) < 4 * np.sqrt(2 / (repeats - 1))
    assert abs(np.mean(errors**2) / variance - 1) < 4 * np.sqrt(2 / (samples - 1) / repeats)


def test_a_recorded_campaign_names_its_objective():
    target = Objective.of_entries({"law": "growth_target", "ratio": 3.0})
    assert target == growth_target(3.0)
    greatest = Objective.of_entries({"law": "maximum_growth"})
    assert greatest.of_grains(1000) == maximum_growth(1000)
    function = Objective.of_entries({"law": "function", "call": "a:b", "source_sha256": "0" * 64})
    assert function.entries() == {"law": "function", "call": "a:b"}


def test_an_unknown_objective_is_none_of_those_that_are_known():
    with pytest.raises(ValueError, match="smallest_growth") as caught:
        Objective.of_entries({"law": "smallest_growth"})
    assert all(name in str(caught.value) for name in Objective.components())


def test_the_terms_of_recorded_moments_are_added_in_their_recorded_order():
    entries = {"law": "moments", "targets": {"spread": 0.4, "mean": 2.0}, "weights": {}}
    assert [term.name for term in Objective.of_entries(entries).terms] == ["spread", "mean"]
    assert [term.name for term in MomentTargets(targets=entries["targets"]).terms] == [
        *("mean", "spread")
    ]
