"""A setting reaches an error where all finer ones do, too."""

import math

import pandas as pd
import pytest

from agglom_mpi.accuracy.time_integration.steps import cost_at, lasting
from agglom_mpi.accuracy.time_integration.stopping_study import at_goal

ERRORS = [0.5, 0.004, 0.04, 0.02, 0.01]
COSTS = [1.0, 2.0, 4.0, 8.0, 16.0]


def test_only_what_stays_within_counts():
    assert lasting(ERRORS, 0.02).tolist() == [False, False, False, True, True]
    assert lasting(ERRORS, 0.005).tolist() == [False] * 5
    assert lasting([0.5, math.nan, 0.001], 0.01).tolist() == [False, False, True]


def test_the_cost_of_an_error_is_that_where_it_is_reached_to_stay():
    assert cost_at(ERRORS, COSTS, 0.02) == pytest.approx(8.0)
    assert cost_at(ERRORS, COSTS, math.sqrt(0.01 * 0.02)) == pytest.approx(math.sqrt(8.0 * 16.0))
    assert cost_at(ERRORS, COSTS, 0.005) == math.inf
    assert cost_at(ERRORS, COSTS, 1.0) == 1.0
    errors, samples = [0.1, 0.02, 0.005], [4.0, 100.0, 1600.0]
    assert cost_at(errors, samples, 0.01) == pytest.approx(400.0)  # ∝ 1/√n between the last two
    assert cost_at([0.5, math.nan, 0.001], [1.0, 2.0, 4.0], 0.01) == 4.0


def test_stopping_rules_are_compared_at_errors_that_they_keep():
    rules = pd.DataFrame({"rule": "one", "rms error": ERRORS, "samples, mean": COSTS})
    assert at_goal(rules, 0.02)["samples, mean"].tolist() == [8.0]
    assert at_goal(rules, 0.005)["samples, mean"].tolist() == [16.0]
