import itertools

import pytest
from scipy import stats

from agglom_mpi.search.student import t_95


@pytest.mark.parametrize("freedom", [*range(1, 260), 1000, 10**4, 10**6])
def test_the_quantile_is_that_of_scipy_to_ten_digits(freedom):
    assert t_95(freedom) == pytest.approx(stats.t.ppf(0.975, freedom), rel=1e-10)


def test_the_quantile_falls_with_the_degrees_of_freedom():
    quantiles = [t_95(freedom) for freedom in range(1, 300)]
    assert all(later < earlier for earlier, later in itertools.pairwise(quantiles))
