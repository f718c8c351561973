"""Strings on the same random configurations are compared by the differences of their samples."""

import json
import math

import numpy as np
import pytest
from campaign_runs import finish, write_campaign
from click.testing import CliRunner
from goals import growth_target, maximum_growth
from reestimation_runs import assert_fresh_are_those_of_the_best, fresh_rows
from scipy import stats

from agglom_mpi.analysis.estimates import Estimate, estimates_of
from agglom_mpi.analysis.selection_bias import (
    PairedSamples,
    paired_p_value,
    sample_values,
    selection_bias,
)
from agglom_mpi.cli import main
from agglom_mpi.config.loading import load_campaign
from agglom_mpi.outcome import OUTCOME
from agglom_mpi.search.space import SearchSpace
from agglom_mpi.storage.reader import read_campaign
from agglom_mpi.verbs.simulate import simulate

COMMON = "\n  common_configurations: true"


def rows_of(ratios, numbers=None):
    """Completed samples with these mean radius ratios."""
    rows = np.zeros(len(ratios), [("sample", "i8"), *OUTCOME.descr])
    rows["state"], rows["particles"] = 1, 1
    rows["sample"] = range(100, 100 + len(ratios)) if numbers is None else numbers
    rows["mean_radius_ratio"] = ratios
    return rows


def alike(correlation, means, samples, seed):
    """Normal samples of two strings with a correlation, shape (2, samples)."""
    covariance = 0.04 * np.array([[1.0, correlation], [correlation, 1.0]])
    return np.random.default_rng(seed).multivariate_normal(means, covariance, samples).T


@pytest.mark.parametrize("law", [growth_target(2.0), maximum_growth(100)])
def test_a_difference_is_that_of_the_objectives_and_its_chance_that_of_the_paired_test(law):
    one, other = map(rows_of, alike(0.999, [2.4, 2.38], 50, 1))
    difference = PairedSamples(
        {7: sample_values(law, one), 2: sample_values(law, other)}
    ).difference(7, 2)
    assert difference.value == pytest.approx(law.of_rows(one)[0] - law.of_rows(other)[0])
    wanted = stats.ttest_rel(one["mean_radius_ratio"], other["mean_radius_ratio"]).pvalue
    assert paired_p_value(difference) == pytest.approx(wanted, rel=1e-9)
    apart = stats.ttest_ind(one["mean_radius_ratio"], other["mean_radius_ratio"]).pvalue
    assert wanted < 1e-3 * apart


def test_strings_on_either_side_of_the_target_are_rarely_told_apart_if_both_miss_it_by_as_much():
    """What they have in common brings one nearer and takes the other away: it does not cancel."""
    repeats, told, law = 2000, 0, growth_target(2.0)
    for seed in range(repeats):
        one, other = map(rows_of, alike(0.9, [2.4, 1.6], 20, seed))
        difference = PairedSamples(
            {0: sample_values(law, one), 1: sample_values(law, other)}
        ).difference(0, 1)
        told += paired_p_value(difference) < 0.05
    assert abs(told / repeats - 0.05) < 4.0 * math.sqrt(0.05 * 0.95 / repeats)


def test_only_samples_that_both_have_are_compared():
    law = maximum_growth(8)
    one = sample_values(law, rows_of([1.0, 1.2, 1.4], [5, 6, 8]))
    other = sample_values(law, rows_of([1.5, 1.1, 1.3], [6, 7, 8]))
    paired = PairedSamples({0: one, 1: other, 2: (one[0][:1], one[1][:1])})
    assert paired.difference(0, 1).samples == 2
    assert paired.difference(0, 1).value == pytest.approx((0.3 - 0.1) / 2 / 2)
    assert paired.difference(0, 2).samples == 1
    assert paired_p_value(paired.difference(0, 2)) == 1.0


def test_the_error_of_the_average_counts_what_strings_have_in_common():
    law, rng = maximum_growth(8), np.random.default_rng(3)
    common = rng.normal(0.0, 0.1, 100)
    ratios = 1.5 + common + rng.normal(0.0, 0.05, (4, 100))
    samples = {i: sample_values(law, rows_of(row)) for i, row in enumerate(ratios)}
    average = PairedSamples(samples).average()
    assert average.error == pytest.approx(ratios.mean(axis=0).std(ddof=1) / 2.0 / 10.0)
    errors = [law.of_rows(rows_of(row))[1] for row in ratios]
    assert average.error > 1.5 * np.linalg.norm(errors) / 4
    found = [
        Estimate(i, *law.of_rows(rows_of(row)), 0.0, 1.0, 100, 0, 2.0, 0.2, 0.02)
        for i, row in enumerate(ratios)
    ]
    bias = selection_bias(found, PairedSamples(samples))
    assert bias.standard_error == pytest.approx(np.hypot(average.error, 0.02))


@pytest.fixture(scope="module")
def common(tmp_path_factory):
    """Return the file of a finished campaign with common configurations."""
    folder = tmp_path_factory.mktemp("common")
    numbers = {"generations": 2, "max_samples": 12, "final": "{strings: 4, samples: 12}"}
    text = write_campaign(folder / "common.yaml", **numbers).read_text()
    (folder / "common.yaml").write_text(text.replace("max_samples: 12", f"max_samples: 12{COMMON}"))
    finish(folder, "common.yaml")
    return folder / "common.h5"


def test_fresh_samples_have_common_configurations_too(common):
    assert_fresh_are_those_of_the_best(common, common.with_suffix(".yaml"), 4, 12)
    campaign = load_campaign(str(common.with_suffix(".yaml")))
    space = SearchSpace.of(campaign.variables)
    near = space.from_unit(np.outer([0.5, 0.5 + 1e-13], np.ones(space.dimensions)))
    one, other = (simulate(campaign, string, 12).mean_radius_ratio for string in near)
    assert near[0].tobytes() != near[1].tobytes()
    assert one == pytest.approx(other, rel=1e-6)


def test_a_report_says_that_pairs_were_compared_and_tells_what_they_tell(common):
    said = CliRunner().invoke(main, ["report", str(common)]).output
    assert "(paired t on common configurations, 6 pairs, Holm)" in said
    file = read_campaign(common)
    estimates = estimates_of(file)
    paired = PairedSamples.behind(estimates, file)
    rows = fresh_rows(common)
    ratios = [rows[rows["string"] == e.string]["mean_radius_ratio"] / 2.0 - 1.0 for e in estimates]
    signed = [np.sign(values.mean()) * values for values in ratios]
    for place, estimate in enumerate(estimates[1:], 1):
        difference = paired.difference(estimates[0].string, estimate.string)
        wanted = stats.ttest_rel(signed[0], signed[place]).pvalue
        assert paired_p_value(difference) == pytest.approx(wanted, rel=1e-6)
    told = json.loads(CliRunner().invoke(main, ["report", "--json", str(common)]).stdout)
    assert told["verdict"]["test"] == "paired t on common configurations"


def test_strings_with_configurations_of_their_own_are_not_paired(finished):
    file = read_campaign(finished)
    assert PairedSamples.behind(estimates_of(file), file) is None
