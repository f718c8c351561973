import math

import numpy as np
import pytest

from agglom_mpi.measurements.datum import Datum, data_times
from agglom_mpi.measurements.quantities import PARTICLE_WEIGHTS, QUANTITIES

EDGES = np.array([0.0, 1e-4, np.inf])
HALVES = np.array([0.5, 0.5])


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


def test_one_number_has_a_value_for_every_quantity_without_a_file():
    for quantity in (name for name, kind in QUANTITIES.items() if not kind.has_file):
        for weight in PARTICLE_WEIGHTS:
            datum = Datum.of_value(quantity, 2.0, 0.5, weight)
            assert datum.values.tolist() == [2.0]
            assert datum.covariance.tolist() == [[0.25]]
