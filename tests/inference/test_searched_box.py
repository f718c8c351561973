import numpy as np
from toy_posteriors import linear_emulator, measurements

from agglom_mpi.inference.emulated_set import settled_numbers

SLOPES = np.eye(2)
DATA = measurements([1.4, 1.5], [0.05, 0.05])


def test_failures_are_where_strings_failed(tmp_path):
    emulated = linear_emulator(tmp_path, SLOPES, DATA, failing=lambda places: places[:, 0] > 0.6)
    strings = emulated.box.space.from_unit(np.array([[0.95, 0.5], [0.1, 0.5]]))
    found = emulated.failing(emulated.coordinates.of_strings(strings))
    assert emulated.failing_strings > 0
    assert found[0] > 0.8
    assert found[1] < 0.1
    assert emulated.at(strings).failing.tolist() == found.tolist()


def test_without_failures_nothing_fails(tmp_path):
    emulated = linear_emulator(tmp_path, SLOPES, DATA)
    assert emulated.failing_strings == 0
    assert not emulated.failing(emulated.points).any()


def test_numbers_that_differ_by_rounding_are_the_same_to_an_emulator():
    ulp = np.finfo(np.float64).eps
    numbers = np.array([[1.0, 2.0], [1.0 + ulp, 2.5], [1.0 - ulp, 3.0]])
    assert np.array_equal(settled_numbers(numbers), [[1.0, 2.0], [1.0, 2.5], [1.0, 3.0]])
    assert np.array_equal(settled_numbers(np.zeros((3, 1))), np.zeros((3, 1)))
