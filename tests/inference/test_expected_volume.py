"""Expected volumes after a measurement, where they are known in closed form."""

import math

import numpy as np
import pytest
from scipy.stats import chi2, norm, qmc

from agglom_mpi.emulation.emulator import Emulator, merge_samples
from agglom_mpi.inference.expected_volume import (
    Candidate,
    DataAtPoints,
    LinearQuantity,
    WeightedPoints,
    emulated_candidate,
    expected_volume,
    region_volumes,
)

LINE = (np.arange(4000) + 0.5) / 4000
SQUARE = qmc.Sobol(2, seed=1).random(1 << 13)
WIDTH = 2.0 * norm.ppf(0.95)
"""Width of the central 90 % of a normal distribution in its standard deviations."""


def normal_points(at, deviation):
    """Return even points of the unit cube, (n, d), weighed by a normal density at its middle."""
    weights = np.exp(-0.5 * np.sum((at - 0.5) ** 2, axis=1) / deviation**2)
    return WeightedPoints(weights / weights.sum(), 1.0 / len(at))


def number(means, error, deviation=0.0):
    covariances = np.full((len(means), 1, 1), deviation**2)
    return Candidate(means[:, None], covariances, np.array([[error**2]]))


def stream():
    return np.random.default_rng(5)


def test_volume_is_that_of_the_narrowest_interval():
    points = normal_points(LINE[:, None], 0.05)
    # Half a point on either side is the resolution.
    assert points.volume == pytest.approx(WIDTH * 0.05, abs=points.share)


def test_volume_counts_a_part_of_the_last_point():
    weights = np.array([[0.8, 0.2, 0.0], [0.4, 0.4, 0.2], [0.0, 0.0, 3.0]])
    assert region_volumes(weights, 0.1) == pytest.approx([0.15, 0.25, 0.09])


@pytest.mark.parametrize(("error", "deviation"), [(0.04, 0.0), (0.1, 0.0), (0.03, 0.04)])
def test_expected_volume_of_a_linear_quantity_is_the_closed_form(error, deviation):
    points = normal_points(LINE[:, None], 0.05)
    slope = -2.0
    found = expected_volume(points, number(slope * LINE, error, deviation), stream())
    after = 1.0 / math.sqrt(1.0 / 0.05**2 + slope**2 / (error**2 + deviation**2))
    # The width does not depend on what is measured: only the resolution and the ends differ.
    assert found.value == pytest.approx(WIDTH * after, abs=2.0 * points.share)
    assert found.error < points.share


def test_expected_volume_of_two_correlated_numbers_is_the_closed_form():
    points = normal_points(SQUARE, 0.07)
    slopes = np.array([[1.0, 2.0], [1.0, -1.0]])
    emulator = np.array([[0.02, 0.01], [0.01, 0.03]]) ** 2
    error = np.array([[2e-3, -1e-3], [-1e-3, 4e-3]])
    candidate = Candidate(SQUARE @ slopes.T, np.tile(emulator, (len(SQUARE), 1, 1)), error)
    found = expected_volume(points, candidate, stream())
    precision = np.eye(2) / 0.07**2 + slopes.T @ np.linalg.inv(emulator + error) @ slopes
    area = math.pi * chi2.ppf(0.9, 2) / math.sqrt(np.linalg.det(precision))
    # Some 200 points lie in the region; even ones count an area in the plane to well within 1 %.
    assert found.value == pytest.approx(area, rel=0.01)


def test_quantity_that_does_not_depend_on_the_variables_changes_nothing():
    points = normal_points(SQUARE, 0.1)
    found = expected_volume(points, number(np.full(len(SQUARE), 3.0), 0.1, 0.2), stream())
    assert found.value == pytest.approx(points.volume, rel=1e-9)
    assert found.error < 1e-9 * points.volume


def test_measurement_twice_as_sure_leaves_less():
    points = normal_points(SQUARE, 0.1)
    quantity = SQUARE.sum(axis=1)
    errors = 0.2, 0.1, 0.05
    found = [expected_volume(points, number(quantity, e), stream()).value for e in errors]
    assert points.volume > found[0] > found[1] > found[2]


def test_variables_may_be_exchanged():
    points = normal_points(SQUARE, 0.1)
    candidates = [number(SQUARE[:, place] ** 2, 0.1) for place in (0, 1)]
    first, second = (expected_volume(points, each, stream()) for each in candidates)
    error = math.hypot(first.error, second.error)
    assert abs(first.value - second.value) < 5.0 * error + 1e-3 * points.volume


def test_truths_of_a_posterior_and_noise_have_the_stated_error():
    points = normal_points(LINE[:, None], 0.2)
    candidate = number(np.exp(3.0 * LINE), 0.5)  # the volume depends on the measured value
    means = [
        expected_volume(points, candidate, np.random.default_rng([seed, 7]), count=100)
        for seed in range(60)
    ]
    stated = float(np.mean([each.error for each in means]))
    scatter = float(np.std([each.value for each in means], ddof=1))
    # A standard deviation of 60 numbers has a relative error of 1/sqrt(118); five of these.
    assert scatter == pytest.approx(stated, rel=5.0 / math.sqrt(118.0))


def test_same_generator_gives_the_same_volumes():
    points = normal_points(LINE[:, None], 0.2)
    first, again = (expected_volume(points, number(LINE**2, 0.1), stream(), 30) for _ in range(2))
    assert first == again


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
