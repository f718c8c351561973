import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from agglom_mpi.measurements.datum import (
    PARTICLE_WEIGHTS,
    QUANTITIES,
    Datum,
    data_times,
    multinomial_covariance,
    shares_from_cumulative,
)

EDGES = np.array([0.0, 1e-4, np.inf])
HALVES = np.array([0.5, 0.5])


def test_shares_between_sieves_are_differences_with_their_covariance():
    sizes, passing = np.array([1e-4, 2e-4, 4e-4]), np.array([0.1, 0.5, 0.8])
    errors = np.array([0.01, 0.02, 0.03])
    shares = shares_from_cumulative(sizes, passing, errors)
    differences = np.array([[1, 0, 0], [-1, 1, 0], [0, -1, 1], [0, 0, -1]])
    assert np.allclose(shares.values, [0.1, 0.4, 0.3, 0.2], rtol=0.0, atol=1e-15)
    assert np.allclose(shares.covariance, differences @ np.diag(errors**2) @ differences.T)
    assert shares.edges.tolist() == [0.0, 1e-4, 2e-4, 4e-4, math.inf]


def test_a_curve_that_is_exactly_complete_has_no_class_beyond_its_ends():
    shares = shares_from_cumulative([1e-4, 2e-4, 4e-4], [0.0, 0.4, 1.0], [0.0, 0.1, 0.0])
    assert shares.edges.tolist() == [1e-4, 2e-4, 4e-4]
    assert np.allclose(shares.values, [0.4, 0.6])
    assert np.allclose(shares.covariance, [[0.01, -0.01], [-0.01, 0.01]])


def test_an_uncertain_end_keeps_the_class_beyond_it():
    shares = shares_from_cumulative([1e-4, 2e-4], [0.4, 1.0], 0.1)
    assert shares.edges.tolist() == [0.0, 1e-4, 2e-4, math.inf]
    assert shares.values[-1] == 0.0
    assert shares.covariance[-1, -1] == pytest.approx(0.01)


@given(
    st.lists(st.floats(0.0, 1.0), min_size=1, max_size=12),
    st.floats(1e-6, 1.0),
    st.floats(-9.0, 1.0),
)
def test_shares_of_any_curve_sum_to_one_and_their_errors_to_none(passing, error, decade):
    sizes = 10.0**decade * np.arange(1, len(passing) + 1)
    shares = shares_from_cumulative(sizes, np.sort(passing), error)
    assert np.sum(shares.values) == pytest.approx(1.0, abs=1e-12)
    assert np.abs(np.sum(shares.covariance, axis=0)).max() <= 1e-12 * error**2
    assert np.linalg.eigvalsh(shares.covariance).min() >= -1e-12 * error**2
    Datum("sizes", *shares[:2], edges=shares.edges)


def test_counted_shares_scatter_as_their_covariance_states():
    shares, counted, draws = np.array([0.2, 0.5, 0.3]), 400, 4000
    drawn = np.random.default_rng(2).multinomial(counted, shares, size=draws) / counted
    covariance = multinomial_covariance(shares, counted)
    errors = np.sqrt((covariance**2 + np.outer(*[np.diag(covariance)] * 2)) / draws)
    # Half a particle more in each class changes shares by up to 1/counted.
    assert np.all(np.abs(np.cov(drawn.T) - covariance) < 4.0 * errors + 2.0 / counted**2)


def test_an_empty_class_has_an_error_of_about_one_particle():
    error = math.sqrt(multinomial_covariance([0.0, 0.4, 0.6], 100)[0, 0])
    assert 0.5 / 100 < error < 1.0 / 100


@pytest.mark.parametrize(
    ("changes", "word"),
    [
        ({"quantity": "d51"}, "d51"),
        ({"weight": "volume"}, "volume"),
        ({"covariance": np.eye(3)}, "covariance"),
        ({"values": np.array([0.5, math.nan])}, "finite"),
        ({"covariance": np.zeros((2, 2))}, "error"),
        ({"edges": None}, "edges"),
        ({"edges": EDGES[:2]}, "edges"),
        ({"edges": EDGES[::-1]}, "edges"),
        ({"edges": np.array([-1.0, 1.0, 2.0])}, "edges"),
        ({"values": np.array([0.5, 0.6])}, "sum"),
        ({"quantity": "d50"}, "d50"),
    ],
)
def test_what_does_not_fit_together_is_no_datum(changes, word):
    given_ = {"quantity": "sizes", "values": HALVES, "covariance": np.eye(2), "edges": EDGES}
    with pytest.raises(ValueError, match=word):
        Datum(**{**given_, **changes})


def test_times_ascend_and_the_end_comes_last():
    data = [Datum.of_value("d50", 1.0, 0.1, time=time) for time in (3.0, None, 1.0, 3.0)]
    assert data_times(data) == (1.0, 3.0, None)
    assert data_times(data[:1]) == (3.0,)


def test_one_number_has_a_value_for_every_quantity_but_sizes():
    for quantity in QUANTITIES.keys() - {"sizes"}:
        for weight in PARTICLE_WEIGHTS:
            datum = Datum.of_value(quantity, 2.0, 0.5, weight)
            assert datum.values.tolist() == [2.0]
            assert datum.covariance.tolist() == [[0.25]]
