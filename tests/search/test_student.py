import math

import pytest

from agglom_mpi.statistics import t_95, t_quantile, t_tails


@pytest.mark.parametrize(
    ("freedom", "quantile"), [(1, 12.706), (2, 4.303), (4, 2.776), (9, 2.262), (120, 1.980)]
)
def test_the_quantiles_are_those_of_the_printed_tables(freedom, quantile):
    assert t_95(freedom) == pytest.approx(quantile, abs=5e-4)


def test_with_one_degree_of_freedom_it_is_cauchys_distribution():
    assert t_quantile(1, 0.99) == pytest.approx(math.tan(0.495 * math.pi), rel=1e-9)


@pytest.mark.parametrize("freedom", [1, 3, 30, 10**6])
def test_the_tails_beyond_a_quantile_are_what_it_leaves_out(freedom):
    assert t_tails(t_quantile(freedom, 0.9), freedom) == pytest.approx(0.1, rel=1e-9)
    assert t_tails(0.0, freedom) == 1.0
