import math
import subprocess
import sys

import matplotlib.figure
import numpy as np
import pytest
from accuracy_rows import frame_of
from goals import growth_target, maximum_growth
from rules import difference, ensemble_of, half_width, settled_moments

from agglom_mpi.accuracy.time_integration import stopping_study
from agglom_mpi.accuracy.time_integration.ensemble import ensemble_section
from agglom_mpi.accuracy.time_integration.stopping_study import (
    OWN,
    PUBLISHED_TOLERANCES,
    STUDIED_RULES,
    Truth,
    at_goal,
    at_stop,
    families,
    of_rules,
    proportion,
    root_mean_square,
    run_paths,
    stop,
    study,
)
from agglom_mpi.config.campaign import Campaign
from agglom_mpi.outcome import COMPLETED, FAILED, OUTCOME, summaries
from agglom_mpi.search.stopping import AdaptiveRule
from agglom_mpi.statistics import t_95

GRAINS = 60
FIRST_MOMENT, WITH_ERROR = "successive difference, mean radius", "standard error"
CAMPAIGN = """
title: A pool to draw from
seed: 5
scene: {particles: 60, half_width: 1 cm, velocities: uniform_x, restitution:
  {law: constant, value: 0}, heating: none, friction: none, reaction: none, end_time: 1 ms}
variables: {relative_speed: [1, 2], size_ratio: 0.5, density: 1000}
objective: {law: growth_target, ratio: 2}
ensemble: {rule: successive_difference, quantity: mean_radius, tolerance: 1e-4, max_samples: 300}
stopping: {generations: 1}
"""


def pool_of_radii(rows, seed):
    """Samples whose radii are drawn, so that their moments belong together."""
    random = np.random.default_rng(seed)
    pool = np.zeros(rows, OUTCOME)
    pool["state"] = COMPLETED
    for row in pool:
        radii = random.gamma(20.0, 0.1 * random.uniform(0.8, 1.2), random.integers(5, 15))
        row["particles"] = len(radii)
        row["mean_radius_ratio"] = radii.mean()
        for order in (2, 3, 4):
            row[f"radius_moment_{order}"] = np.mean((radii - radii.mean()) ** order)
    return pool


def normal_pool(rows, mean, spread, seed):
    pool = np.zeros(rows, OUTCOME)
    pool["state"] = COMPLETED
    pool["particles"] = 10
    pool["mean_radius_ratio"] = np.random.default_rng(seed).normal(mean, spread, rows)
    return pool


def drawn(pool, samples, orders, seed):
    return np.random.default_rng(seed).integers(0, len(pool), (samples, orders))


@pytest.mark.parametrize("objective", [growth_target(2.0), maximum_growth(GRAINS)])
@pytest.mark.parametrize("min_samples", [2, 7])
@pytest.mark.parametrize(
    "rule",
    [
        difference(1e-3, "mean_radius"),
        difference(1e-4, "objective"),
        settled_moments(1e-3, 1),
        settled_moments(3e-3, 2),
        settled_moments(3e-3, 3),
        settled_moments(1e-3, 4),
        half_width(0.02),
        half_width(1e-6, 9),
    ],
    ids=str,
)
def test_stops_are_those_of_the_ensemble_that_judges_one_by_one(rule, min_samples, objective):
    most = 150
    pool = pool_of_radii(40, seed=1)
    outcomes = summaries(pool)
    draws = drawn(pool, most, 20, seed=2)
    states, signed = run_paths(pool, objective, draws)
    used, satisfied = stop(rule, states, min_samples, most)
    for order, rows in enumerate(draws.T):
        judged = ensemble_of(rule, objective, GRAINS, min_samples, most)
        for row in rows:
            judged.add(outcomes[row])
            if judged.finished:
                break
        result = judged.result()
        assert used[order] == result.samples_used
        assert satisfied[order] != result.hit_maximum
        # Sums of at most 150 terms in another order: 150 roundings, of a spread of some 10 %.
        assert at_stop(states.mean_radius_ratio, used)[order] == pytest.approx(
            result.mean_radius_ratio, rel=150 * 2.0**-53
        )
        assert abs(at_stop(signed, used)[order]) == pytest.approx(
            result.objective, abs=150 * 2.0**-53
        )
        assert at_stop(states.standard_error, used)[order] == pytest.approx(
            result.standard_error, rel=1e-12
        )


def test_moments_of_a_path_are_those_of_all_its_particles():
    random = np.random.default_rng(3)
    groups = [random.gamma(20.0, 0.1, count) for count in (4, 9, 1, 6)]
    pool = np.zeros(len(groups), OUTCOME)
    for row, radii in zip(pool, groups, strict=True):
        row["particles"] = len(radii)
        row["mean_radius_ratio"] = radii.mean()
        for order in (2, 3, 4):
            row[f"radius_moment_{order}"] = np.mean((radii - radii.mean()) ** order)
    everyone = np.concatenate(groups)
    expected = [np.mean((everyone - everyone.mean()) ** order) for order in (2, 3, 4)]
    states, _ = run_paths(pool, growth_target(), np.arange(len(pool))[:, None])
    found = [moment[-1, 0] for moment in states.central_moments]
    assert found == pytest.approx(expected, rel=1e-12)


def test_the_first_moment_alone_is_the_successive_difference_of_the_mean_radius():
    pool = pool_of_radii(50, seed=4)
    paths, _ = run_paths(pool, growth_target(), drawn(pool, 200, 50, seed=5))
    first = stop(settled_moments(1e-3, 1), paths, 2, 200)
    published = stop(difference(1e-3, "mean_radius"), paths, 2, 200)
    assert np.array_equal(first[0], published[0])


def test_equal_samples_end_every_rule_at_once():
    pool = np.repeat(pool_of_radii(1, seed=6), 30)
    paths, _ = run_paths(pool, growth_target(), drawn(pool, 20, 3, seed=7))
    for rule, fewest in (
        (difference(1e-100, "objective"), 2),
        (half_width(1e-100), 5),
    ):
        assert np.all(stop(rule, paths, 2, 20)[0] == fewest)


def test_a_rule_that_is_satisfied_by_the_last_sample_did_not_end_at_the_limit():
    pool = np.repeat(pool_of_radii(1, seed=6), 30)
    paths, _ = run_paths(pool, growth_target(), drawn(pool, 20, 3, seed=7))
    assert np.all(stop(difference(1e-6), paths, 2, 2)[1])
    assert not np.any(stop(half_width(1e-6, 5), paths, 2, 4)[1])


def test_intervals_of_a_fixed_number_of_normal_samples_cover_95_percent():
    pool = normal_pool(20_000, 2.0, 0.1, seed=8)
    objective = growth_target()
    orders = 4000
    for samples in (5, 30):
        states, signed = run_paths(pool, objective, drawn(pool, samples, orders, seed=samples))
        half_width = t_95(samples - 1) * states.standard_error[-1]
        missed = np.abs(signed[-1] - Truth.of_pool(pool, objective).deviation) > half_width
        error = math.sqrt(0.05 * 0.95 / orders)
        assert abs(np.mean(missed) - 0.05) < 4.0 * error


def test_error_of_a_fixed_number_is_the_spread_over_its_root():
    pool = pool_of_radii(200, seed=9)
    truth = Truth.of_pool(pool, growth_target())
    for samples in (4, 50):
        orders = 4000
        states, _ = run_paths(pool, growth_target(), drawn(pool, samples, orders, seed=samples))
        squares = (states.mean_radius_ratio[-1] - truth.mean) ** 2
        error = np.std(squares, ddof=1) / math.sqrt(orders)
        assert abs(np.mean(squares) - truth.spread**2 / samples) < 4.0 * error


def rules_on(pool, samples, orders, seed):
    objective = growth_target()
    rules = families(Truth.of_pool(pool, objective), samples)
    return study(pool, objective, rules, drawn(pool, samples, orders, seed))


def test_a_published_rule_is_off_by_more_than_a_fixed_number_of_as_many_samples():
    pool = normal_pool(5000, 2.0, 0.1, seed=10)
    frame = rules_on(pool, 400, 1000, seed=11)
    row = frame[(frame["rule"] == FIRST_MOMENT) & (frame["tolerance"] == 1e-4)].iloc[0]
    fixed = 0.05 / math.sqrt(row["samples, mean"])
    assert row["rms error"] > fixed
    assert row["rms error"] > 10.0 * row["tolerance"]


def test_stopping_early_costs_coverage():
    frame = rules_on(normal_pool(5000, 2.0, 0.1, seed=12), 100, 4000, seed=13)
    for rule in (FIRST_MOMENT, WITH_ERROR):
        rows = frame[(frame["rule"] == rule) & (frame["samples, mean"] < 30)]
        worst = rows.sort_values("coverage").iloc[0]
        assert worst["coverage"] < 0.95 - 4.0 * worst["coverage, standard error"]


def test_tighter_tolerances_take_more_samples():
    frame = rules_on(pool_of_radii(100, seed=14), 300, 200, seed=15)
    for _, rows in frame.groupby("rule"):
        assert rows["samples, mean"].is_monotonic_increasing
        assert rows["tolerance"].is_monotonic_decreasing


def test_a_proportion_has_an_error_even_where_everything_hits():
    assert proportion(np.ones(100, bool))[0] == 1.0
    assert proportion(np.ones(100, bool))[1] > 0.0
    hits = np.arange(1000) < 300
    assert proportion(hits)[1] == pytest.approx(math.sqrt(0.3 * 0.7 / 1000), rel=0.01)


def test_band_of_a_root_mean_square_holds_it_in_95_percent():
    random = np.random.default_rng(16)
    trials = 2000
    held = 0
    for _ in range(trials):
        _, low, high = root_mean_square(random.normal(0.0, 1.0, 400))
        held += low <= 1.0 <= high
    # Squares of normals have skewness √8 and excess 12; the next term of Edgeworth's expansion of
    # Student's statistic is then -2.2/n (Hall 1992).
    expected = 0.95 - 2.2 / 400
    assert abs(held / trials - expected) < 4.0 * math.sqrt(0.05 * 0.95 / trials)


def test_section_leaves_out_failed_samples_and_can_be_drawn():
    pool = pool_of_radii(100, seed=17)
    pool["state"][:7] = FAILED
    pool["mean_radius_ratio"][:7] = np.nan
    section = ensemble_section(Campaign.from_text(CAMPAIGN), pool, quick=True)
    assert "7 samples of the pool had failed" in section.setups
    assert "93 completed samples" in section.reference
    for figure in section.figures:
        figure.draw(matplotlib.figure.Figure())
    frame = {table.name: frame_of(table) for table in section.tables}["ensemble_rules"]
    assert np.all(np.isfinite(frame["rms error"]))
    assert not any("nan" in sentence for sentence in (*section.failures, *section.conclusions))
    for table in section.tables:
        assert all(column.cell(row) for row in table.rows for column in table.columns)


def test_section_judges_the_campaigns_own_rule_within_its_own_limits():
    section = ensemble_section(
        Campaign.from_text(CAMPAIGN), pool_of_radii(100, seed=18), quick=True
    )
    frame = {table.name: frame_of(table) for table in section.tables}["ensemble_rules"]
    own = frame[frame["rule"] == OWN].iloc[0]
    same = frame[(frame["rule"] == FIRST_MOMENT) & (frame["tolerance"] == 1e-4)].iloc[0]
    assert own["samples, mean"] <= 300.0
    assert own["ended at max_samples"] >= same["ended at max_samples"]
    assert own["samples, mean"] <= same["samples, mean"]
    assert set(frame["tolerance"]) >= set(PUBLISHED_TOLERANCES)
    goal = at_goal(of_rules(frame), 1e-2)
    assert np.all(goal["ended at max_samples"] <= 0.5)


def test_section_of_a_scene_alone_has_no_rule_of_its_own():
    alone = CAMPAIGN[: CAMPAIGN.index("objective:")].replace("[1, 2]", "1")
    section = ensemble_section(Campaign.from_text(alone), pool_of_radii(60, seed=22), quick=True)
    assert "no rule of its own" in section.setups
    assert not any("This campaign" in sentence for sentence in section.conclusions)
    assert OWN not in set(frame_of(section.tables[1])["rule"])


def test_section_is_the_same_again():
    campaign, pool = Campaign.from_text(CAMPAIGN), pool_of_radii(60, seed=19)
    first, again = (ensemble_section(campaign, pool, quick=True) for _ in range(2))
    assert first.conclusions == again.conclusions
    assert frame_of(first.tables[1]).equals(frame_of(again.tables[1]))


def test_section_of_equal_samples_says_so():
    pool = np.repeat(pool_of_radii(1, seed=20), 40)
    section = ensemble_section(Campaign.from_text(CAMPAIGN), pool)
    assert section.figures == ()
    assert "the same mean radius" in section.conclusions[0]


def test_section_of_too_small_a_pool_says_so():
    pool = pool_of_radii(30, seed=21)
    pool["state"][9:] = FAILED
    section = ensemble_section(Campaign.from_text(CAMPAIGN), pool)
    assert section.figures == ()
    assert "Of 30 samples 9 completed" in section.failures[0]


def test_sections_are_imported_without_the_libraries_of_the_report():
    code = (
        "import sys, agglom_mpi.accuracy.time_integration.ensemble; "
        "absent = {'pandas', 'matplotlib', 'jinja2', 'mpi4py.MPI'}; "
        "sys.exit(bool(absent & set(sys.modules)))"
    )
    assert subprocess.run([sys.executable, "-c", code]).returncode == 0


class NarrowMean(AdaptiveRule):
    """A rule that the package does not have: a standard error below a share of the mean."""

    @property
    def relative_to(self):
        return "mean_radius"

    @property
    def label(self):
        return "narrow mean"

    def holds(self, before, after):
        return after.standard_error <= self.tolerance * after.mean_radius_ratio


def test_a_rule_that_is_added_is_studied_and_reported(monkeypatch):
    monkeypatch.setattr(stopping_study, "STUDIED_RULES", (*STUDIED_RULES, ("narrow", NarrowMean)))
    section = ensemble_section(Campaign.from_text(CAMPAIGN), pool_of_radii(60, seed=23), quick=True)
    frame = {table.name: frame_of(table) for table in section.tables}["ensemble_rules"]
    rows = frame[frame["rule"] == "narrow"]
    assert rows["tolerance"].tolist() == list(PUBLISHED_TOLERANCES)
    assert rows["samples, mean"].is_monotonic_increasing
    assert "narrow" in section.conclusions[0]
