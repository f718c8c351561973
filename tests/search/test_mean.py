import math

import pytest

from agglom_mpi.statistics import MeanEstimate, mean_of


def test_a_mean_has_a_standard_error_and_t_interval():
    found = mean_of([1.0, 2.0, 3.0, 6.0])
    assert found.value == 3.0
    assert found.error == pytest.approx(math.sqrt(14.0 / 3.0 / 4.0), rel=1e-14)
    assert found.half_width == pytest.approx(3.182446305 * found.error, rel=1e-8)


def test_one_value_has_no_error_and_none_no_mean():
    assert math.isnan(mean_of([2.0]).error)
    assert mean_of([2.0]).half_width == math.inf
    assert math.isnan(mean_of([]).value)


def test_equal_values_have_no_error():
    assert mean_of([2.0, 2.0, 2.0]) == MeanEstimate(2.0, 0.0, 3)
