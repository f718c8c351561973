"""Declarations of measured quantities, and a quantity that a test adds."""

from typing import Literal

import numpy as np
import pytest
from measured_samples import drawn_census

from agglom_mpi.inference.candidate_data import quantities_to_measure, read_errors
from agglom_mpi.measurements.datum import Datum, predictions
from agglom_mpi.measurements.quantities import PARTICLE_WEIGHTS, QUANTITIES, Quantile


def test_quantities_under_another_name_are_proposed_under_that_one_alone():
    proposed = {(n, by) for n, each in QUANTITIES.items() for by in each.next_weights}
    for each in QUANTITIES.values():
        for weight in PARTICLE_WEIGHTS:
            assert each.has_file or each.one_name(weight) in proposed
            own = QUANTITIES[each.one_name(weight)[0]]
            assert own.one_name(each.one_name(weight)[1]) == each.one_name(weight)
    assert all(QUANTITIES[name].one_name(by) == (name, by) for name, by in proposed)


def test_equal_grains_are_within_the_limits_of_every_number_at_the_start():
    for each in QUANTITIES.values():
        if not each.has_file:
            value = np.array([[each.at_start(50, 1e-4, 290.0)]])
            assert each.within_limits(value, (1e-4, 1e-4)) == pytest.approx(value)


def test_shares_that_are_moved_into_their_limits_keep_their_sum():
    moved = QUANTITIES["sizes"].within_limits(np.array([[0.7, 0.4, -0.1]]), (0.0, 1.0))
    assert moved.min() == 0.0
    assert moved.sum() == pytest.approx(1.0)


def test_one_more_class_is_predicted_and_proposed(monkeypatch):
    class D95(Quantile):
        """Diameter below which 95 % lie."""

        quantity: Literal["d95"] = "d95"
        share = 0.95

    monkeypatch.setitem(QUANTITIES, "d95", D95())
    census = drawn_census(3, np.random.default_rng(1))
    data = [Datum.of_value(name, 1e-4, 1e-6, "mass") for name in ("d90", "d95")]
    found = predictions(census, data).pooled
    assert found[0] < found[1]
    new = quantities_to_measure((None,), data, has_heat=False)
    assert sum(datum.quantity == "d95" for datum in new) == len(PARTICLE_WEIGHTS) - 1
    assert read_errors({"d95": "3%"})["d95"].is_relative
