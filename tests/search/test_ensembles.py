import numpy as np
import pytest
from goals import growth_target, maximum_growth
from rules import difference, ensemble_of, fixed, half_width
from search_fakes import PARTICLES, completed, failed

from agglom_mpi.search.ensemble import Ensemble
from agglom_mpi.search.stopping import AdaptiveRule


class Never(AdaptiveRule):
    """A rule that is never satisfied."""

    tolerance: float = 1.0
    max_samples: int = 1000

    def holds(self, before, after):
        return False


def filled(outcomes, rule=None, objective=None, max_samples=1000):
    ensemble = ensemble_of(rule or Never(), objective or growth_target(), PARTICLES, 2, max_samples)
    for outcome in outcomes:
        if ensemble.finished:
            break
        ensemble.add(outcome)
    return ensemble


@pytest.mark.parametrize("objective", [growth_target(2.0), maximum_growth(PARTICLES)])
def test_a_result_is_that_of_the_completed_samples(objective):
    ratios, left = np.array([1.5, 2.0, 3.5]), np.array([50, 25, 10])
    outcomes = [completed(*sample) for sample in zip(ratios, left, strict=True)]
    result = filled(outcomes, objective=objective).result()
    value, error = objective.of_ensemble(outcomes)
    assert result.objective == pytest.approx(value, rel=1e-14)
    assert result.standard_error == pytest.approx(error, rel=1e-14)
    assert result.mean_radius_ratio == pytest.approx(7 / 3, rel=1e-14)
    assert result.growth_number == pytest.approx((7 / 3) ** 3, rel=1e-14)
    assert result.mean_grains == pytest.approx(np.mean(PARTICLES / left), rel=1e-14)
    assert (result.samples_used, result.failed) == (3, 0)


def test_the_largest_number_of_samples_always_ends_it():
    ensemble = filled([completed(r) for r in np.linspace(1, 2, 50)], max_samples=20)
    assert ensemble.finished
    assert ensemble.result().samples_used == 20
    assert ensemble.result().hit_maximum


def test_a_rule_satisfied_by_the_last_allowed_sample_did_not_hit_the_maximum():
    ensemble = filled([completed(1.0)] * 2, difference(1e-5), max_samples=2)
    assert ensemble.finished
    assert not ensemble.result().hit_maximum


def test_a_failed_sample_is_counted_but_left_out_of_the_mean():
    outcomes = [completed(2.5), *[completed(1.5)] * 9, failed(), completed(3.0)]
    result = filled(outcomes).result()
    assert (result.samples_used, result.failed) == (12, 1)
    assert result.mean_radius_ratio == pytest.approx(19 / 11, rel=1e-14)
    assert np.isfinite(result.objective)


def test_a_failed_sample_does_not_look_like_a_mean_that_has_settled():
    rule = difference(1e-5)
    ensemble = filled([completed(1.0), completed(2.0), failed(), failed()], rule)
    assert not ensemble.finished


def test_failed_samples_do_not_count_towards_the_least_number():
    rule = half_width(1.0, 5)
    outcomes = [failed(), *[completed(2.0)] * 9]
    assert filled(outcomes, rule).samples_used == 6


def test_more_than_a_tenth_failed_ranks_last():
    short = filled([completed(2.0), completed(2.1), failed()], max_samples=3).result()
    assert short.objective == np.inf
    assert short.mean_radius_ratio == pytest.approx(2.05)
    exactly_a_tenth = filled([failed(), *[completed(2.5)] * 9], max_samples=10).result()
    assert exactly_a_tenth.objective == pytest.approx(0.25)


def test_failures_end_an_ensemble_from_ten_samples_on():
    outcomes = [failed(), failed(), *[completed(2.0)] * 50]
    ensemble = filled(outcomes)
    assert ensemble.finished
    result = ensemble.result()
    assert (result.samples_used, result.failed) == (10, 2)
    assert result.objective == np.inf
    assert not result.hit_maximum


def test_a_late_failure_ends_an_ensemble_when_it_makes_more_than_a_tenth():
    outcomes = [failed(), *[completed(2.0)] * 14, failed(), *[completed(2.0)] * 9]
    assert filled(outcomes).samples_used == 16


def test_a_string_whose_samples_all_fail_is_worth_inf_and_says_so():
    result = filled([failed()] * 20).result()
    assert result.objective == np.inf
    assert (result.samples_used, result.failed) == (10, 10)
    assert np.isnan(result.mean_radius_ratio)
    assert np.isnan(result.mean_grains)


def test_a_single_sample_is_an_ensemble_without_an_error():
    ensemble = Ensemble(fixed(1), growth_target(), PARTICLES)
    ensemble.add(completed(2.5))
    assert ensemble.finished
    assert ensemble.result().objective == 0.25
    assert np.isnan(ensemble.result().standard_error)


def test_a_finished_ensemble_takes_no_more_samples():
    ensemble = filled([completed(1.0)] * 2, difference(1e-5))
    with pytest.raises(ValueError, match="no more"):
        ensemble.add(completed(1.0))


@pytest.mark.parametrize(("least", "most"), [(0, 5), (6, 5)])
def test_numbers_of_samples_that_make_no_ensemble_are_refused(least, most):
    with pytest.raises(ValueError, match="min_samples"):
        half_width(0.1, least, most)
