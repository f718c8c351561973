"""A candidate given the data, against the conditional distribution and against functions known."""

import numpy as np
import pytest

from agglom_mpi.emulation.emulator import Emulator, merge_samples
from agglom_mpi.inference.expected_volume import (
    DataAtPoints,
    LinearQuantity,
    emulated_candidate,
)


def test_candidate_given_data_is_the_conditional_normal_distribution():
    random = np.random.default_rng(3)
    n, p, r, q = 5, 4, 3, 2
    means, deviations = random.normal(size=(n, p)), random.uniform(0.5, 1.5, (n, p))
    matrix, own = random.normal(size=(r, p)), random.normal(size=(q, p))
    rest, rest_deviations = random.normal(size=(n, q)), random.uniform(0.1, 0.5, (n, q))
    root = random.normal(size=(r, r))
    data = DataAtPoints(means, deviations, matrix, random.normal(size=r), root @ root.T)
    found = data.expected(LinearQuantity(own, rest, rest_deviations), np.eye(q))
    for i in range(n):
        both = np.vstack((own, matrix))
        joint = both @ np.diag(deviations[i] ** 2) @ both.T
        joint[:q, :q] += np.diag(rest_deviations[i] ** 2)
        joint[q:, q:] += data.covariance
        # The inverse of the block of a precision matrix is the conditional covariance.
        conditional = np.linalg.inv(np.linalg.inv(joint)[:q, :q])
        gain = joint[:q, q:] @ np.linalg.inv(joint[q:, q:])
        mean = own @ means[i] + rest[i] + gain @ (data.measured - matrix @ means[i])
        assert found.means[i] == pytest.approx(mean)
        assert found.covariances[i] == pytest.approx(conditional)


def test_repetition_of_a_sure_datum_by_an_unsure_emulator_is_known_beforehand():
    one = np.ones((1, 1))
    data = DataAtPoints(np.array([[5.0]]), np.array([[2.0]]), one, np.array([4.0]), 0.01 * one)
    found = data.expected(LinearQuantity(one), one)
    assert found.means[0, 0] == pytest.approx(4.0, abs=0.01)
    assert found.covariances[0, 0, 0] == pytest.approx(0.01, rel=0.01)


def test_noise_that_is_shared_with_the_data_is_no_noise_of_the_rest():
    random = np.random.default_rng(11)
    coordinates = np.repeat(random.random((60, 1)), 10, axis=0)
    x = coordinates[:, 0]
    noise = random.normal(size=(2, len(x)))
    emulated = (np.sin(3.0 * x) + 0.3 * noise[0])[:, None]
    number = x**2 + 2.0 * 0.3 * noise[0] + 0.01 * noise[1]
    first = Emulator(merge_samples(coordinates, emulated[:, 0]), random)
    residuals = (first.data.means - first.held_out()[0])[:, None]
    points = np.linspace(0.1, 0.9, 9)[:, None]
    rest = emulated_candidate((coordinates, emulated, residuals), number, points, random)
    # Whatever the slope is, the candidate is right; how sure the rest is shows that it is near 2.
    expected = points[:, 0] ** 2 - rest.matrix[0, 0] * np.sin(3.0 * points[:, 0])
    assert np.all(np.abs(rest.rest[:, 0] - expected) < 5.0 * rest.rest_deviations[:, 0])
    alone = Emulator(merge_samples(coordinates, number), random).deviation(points)
    assert np.all(rest.rest_deviations[:, 0] < 0.5 * alone)
