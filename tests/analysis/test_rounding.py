"""Objectives that differ by rounding alone are equal in reports, verdicts and tables."""

import json
import math

import numpy as np
import pytest
from campaign_runs import QUICKSTART, TINY, finish, write_campaign
from click.testing import CliRunner
from goals import FUNCTION_MEAN, growth_target, maximum_growth, moment_targets

from agglom_mpi.analysis.estimates import Estimate, estimates_of, rounding_of, unconverged
from agglom_mpi.analysis.ranking import rank_strings
from agglom_mpi.analysis.run_warnings import run_warnings
from agglom_mpi.analysis.selection_bias import (
    p_value,
    paired_p_value,
    selection_bias,
    significant_differences,
)
from agglom_mpi.analysis.sensitivity import (
    LEAST_EXPLAINED,
    Sensitivity,
    as_dict,
    sensitivity,
    sensitivity_of,
    sensitivity_table,
)
from agglom_mpi.cli import main
from agglom_mpi.config.loading import load_campaign
from agglom_mpi.formatting import ROUNDING
from agglom_mpi.report.style import histogram_range
from agglom_mpi.runtime import task_runner
from agglom_mpi.search.objectives.moment_targets import MomentTarget
from agglom_mpi.statistics import MeanEstimate
from agglom_mpi.storage.reader import read_campaign
from agglom_mpi.verbs.estimate import estimate as estimate_of_string

ULP = np.finfo(np.float64).eps
RULE = "{rule: successive_difference, quantity: objective, tolerance: 5e-4, max_samples: 5}"
"""It compares an objective with itself, so that one that is rounding never settles."""


@pytest.fixture(scope="module")
def path(tmp_path_factory):
    """Return the file of a campaign whose samples all double the grains, but for rounding."""
    folder = tmp_path_factory.mktemp("rounding")
    campaign = write_campaign(
        folder / "even.yaml", **TINY | {"population": 12}, final="{strings: 4, samples: 6}"
    )
    head, _, rest = campaign.read_text().partition("ensemble:")
    campaign.write_text(f"{head}ensemble: {RULE}\n\nstopping:{rest.partition('stopping:')[2]}")
    simulate = task_runner.simulate_scene

    def doubled(*arguments):
        record, particles = simulate(*arguments)
        record["mean_radius_ratio"] = 2.0 * (1.0 + ULP * (int(record["collisions"]) % 3))
        return record, particles

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(task_runner, "simulate_scene", doubled)
        patch.setattr(task_runner, "MAX_AT_ONCE", 1)
        finish(folder, "even.yaml", "-q")
    return folder / "even.h5"


def test_the_campaign_found_nothing_but_rounding(path):
    objectives = read_campaign(path).result_rows()["objective"]
    assert len(objectives) == 12
    assert 0.0 < objectives.max() < 10.0 * ULP


def test_its_report_takes_rounding_for_0(path):
    said = CliRunner().invoke(main, ["report", str(path), "--sensitivity"]).stdout
    assert "not converged" not in said
    assert "they equal the search's own objectives" in said
    assert "all of them are worth the same" in said
    assert "e-1" not in said
    data = read_campaign(path)
    ranked = rank_strings(data)
    assert {float(row["objective"]) for row in ranked.results.values()} == {0.0}
    assert {float(row["standard_error"]) for row in ranked.results.values()} == {0.0}
    assert unconverged(data) == 0
    assert sensitivity_of(data)[1] is None
    assert [e.objective for e in estimates_of(data)] == [0.0] * 4
    verdict = json.loads(CliRunner().invoke(main, ["report", str(path), "--json"]).stdout)[
        "verdict"
    ]
    assert (verdict["optimism"], verdict["is_bias"], len(verdict["same"])) == (0.0, False, 3)


def test_a_target_that_is_met_but_for_rounding_is_not_warned_of(path):
    data = read_campaign(path)
    wanted = {"stopping.target.objective": 0.0, "stopping.target.top": 2}
    data.identity.update(wanted)
    reached = data.generation_rows().copy()
    reached["mean_of_top"] = 3.0 * ULP
    data.generation_rows = lambda: reached
    assert not any(line.startswith("stopping.target") for line in run_warnings(data))
    reached["mean_of_top"] = 1e-9
    assert any(line.startswith("stopping.target") for line in run_warnings(data))


def test_rounding_is_of_the_scale_of_what_is_compared():
    assert growth_target(2.0).rounding([]) == ROUNDING
    assert maximum_growth(100).rounding([0.0, math.inf, math.nan]) == ROUNDING
    assert growth_target(2.0).rounding([0.1, -40.0]) == 40.0 * ROUNDING
    targets = moment_targets((MomentTarget("mean", 2.0, 3.0), MomentTarget("spread", 0.0, 1.0)))
    assert targets.rounding([0.5]) == 4.0 * ROUNDING
    assert FUNCTION_MEAN.rounding([1e-16]) == pytest.approx(1e-16 * ROUNDING)


def test_the_rounding_of_a_file_is_that_of_its_objective(path):
    assert rounding_of(read_campaign(path)) == ROUNDING


def test_a_histogram_of_values_that_are_equal_but_for_rounding_can_be_drawn():
    equal = 2.0 + ULP * np.arange(5.0)
    low, high = histogram_range(equal)
    assert (low, high) == pytest.approx((1.5, 2.5))
    assert np.histogram(equal, 36, histogram_range(equal))[0].sum() == 5
    assert histogram_range(np.array([1.0, 1.1])) is None
    assert histogram_range(np.array([])) is None


def test_an_estimate_takes_rounding_for_0(monkeypatch):
    from agglom_mpi.search.objectives import growth as growth_objectives

    campaign = load_campaign(QUICKSTART)
    monkeypatch.setattr(
        growth_objectives.GrowthTarget, "of_ensemble", lambda self, outcomes: (2.0 * ULP, ULP)
    )
    objective = estimate_of_string(campaign, {}, samples=2).objective
    assert (objective.value, objective.error) == (0.0, 0.0)


def test_means_that_differ_by_rounding_do_not_differ():
    one, other = (MeanEstimate(value, 1e-18, 20) for value in (0.75, 0.75 + ULP))
    assert p_value(one, other) < 1e-6
    assert p_value(one, other, ROUNDING) == 1.0
    assert paired_p_value(MeanEstimate(ULP, 1e-18, 20), ROUNDING) == 1.0
    assert significant_differences([one, other, one], rounding=ROUNDING) == set()
    apart = MeanEstimate(0.76, 1e-18, 20)
    assert significant_differences([one, other, apart], rounding=ROUNDING) == {(0, 2), (1, 2)}


def test_an_optimism_that_is_rounding_is_none():
    def estimate(string, objective):
        ends = (objective, 1e-18, objective, objective)
        return Estimate(string, *ends, 20, 0, 1.0, objective - 2.0 * ULP, 1e-18)

    found = selection_bias([estimate(3, 0.75), estimate(5, 0.75 + ULP)], rounding=ROUNDING)
    assert (found.optimism, found.is_bias, found.same) == (0.0, False, [5])
    assert selection_bias([estimate(3, 0.75)]).is_bias


def test_of_objectives_that_differ_by_rounding_there_are_no_indices():
    random = np.random.default_rng(1)
    points, ones = random.random((64, 2)), np.ones(64, np.int64)
    objectives = ULP * np.rint(2.0 * points[:, 0])
    assert sensitivity(points, objectives, ones) is not None
    assert sensitivity(points, objectives, ones, growth_target(1.0).rounding(objectives)) is None


@pytest.mark.parametrize(
    ("explained", "shown"), [(-0.24, False), (LEAST_EXPLAINED, False), (0.2, True)]
)
def test_a_regression_that_predicts_nothing_has_no_table(explained, shown):
    names, halves = ("density", "friction"), np.full(2, 0.5)
    found = Sensitivity(halves, halves, 48, explained, 0.9)
    table = sensitivity_table(names, found)
    assert isinstance(table, str) is not shown
    if not shown:
        assert f"{explained:.0%}" in table
        assert "density" not in table
    values = as_dict(names, found)
    assert values["explained"] == explained
    assert set(values["variables"]) == (set(names) if shown else set())
