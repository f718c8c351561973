import numpy as np

from agglom_mpi.inference.membership import FailingShare, settled_numbers


def test_failures_are_where_strings_failed():
    rng = np.random.default_rng(1)
    points = rng.random((300, 2))
    failing = FailingShare(points, points[:, 0] > 0.8, rng)
    assert failing.count == np.sum(points[:, 0] > 0.8)
    found = failing.at(np.array([[0.95, 0.5], [0.2, 0.5]]))
    assert found[0] > 0.8
    assert found[1] < 0.1


def test_without_failures_nothing_fails():
    points = np.random.default_rng(2).random((60, 2))
    failing = FailingShare(points, np.zeros(60, bool), np.random.default_rng(3))
    assert failing.at(points).tolist() == [0.0] * 60


def test_numbers_that_differ_by_rounding_are_the_same_to_an_emulator():
    ulp = np.finfo(np.float64).eps
    numbers = np.array([[1.0, 2.0], [1.0 + ulp, 2.5], [1.0 - ulp, 3.0]])
    assert np.array_equal(settled_numbers(numbers), [[1.0, 2.0], [1.0, 2.5], [1.0, 3.0]])
    assert np.array_equal(settled_numbers(np.zeros((3, 1))), np.zeros((3, 1)))
