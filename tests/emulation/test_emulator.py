import numpy as np
import pytest
from scipy.stats import qmc, t

from agglom_mpi.emulation.emulator import Emulator, merge_samples

COUNT = 500


def truth(points):
    return 1.0 + 2.0 / (1.0 + np.exp(-8.0 * (points[:, 0] - 0.5 * points[:, 1] - 0.2)))


def noise(points):
    return 0.02 + 0.4 * points[:, 0]


@pytest.fixture(scope="module")
def emulator():
    points = qmc.Sobol(2, seed=3).random(512)[:COUNT]
    rng = np.random.default_rng(8)
    values = truth(points) + noise(points) * rng.normal(size=COUNT)
    return Emulator(merge_samples(points, values), np.random.default_rng(1))


@pytest.fixture(scope="module")
def others():
    return 0.05 + 0.9 * np.random.default_rng(5).random((400, 2))


def test_the_mean_is_within_its_errors(emulator, others):
    scores = (emulator.mean(others) - truth(others)) / emulator.deviation(others)
    # Errors at points near each other are alike: as few as 20 of the points are independent.
    assert np.sqrt(np.mean(scores**2)) < 1.0 + 4.0 / np.sqrt(2 * 20)
    assert np.abs(emulator.mean(others) - truth(others)).mean() < 0.06


def test_the_noise_follows_the_points(emulator, others):
    ratio = np.log(emulator.noise(others) / noise(others))
    # The logarithm of the variance of 50 values has a standard deviation of sqrt(2/50).
    assert np.abs(ratio).mean() < 4.0 * 0.5 * np.sqrt(2.0 / 50)
    low, high = others[:, 0] < 0.2, others[:, 0] > 0.8
    assert emulator.noise(others[high]).mean() > 2.0 * emulator.noise(others[low]).mean()


def test_held_out_intervals_cover_as_often_as_they_say(emulator):
    predicted, deviation = emulator.held_out()
    scores = (emulator.data.means - predicted) / deviation
    coverage = np.mean(np.abs(scores) < 1.6449)
    assert abs(coverage - 0.9) < 4.0 * np.sqrt(0.9 * 0.1 / COUNT)


def test_drawn_functions_have_the_mean_of_the_posterior(emulator, others):
    drawn = emulator.draw(1000, np.random.default_rng(2))(others[:50])
    away = drawn.mean(axis=0) - emulator.mean(others[:50])
    assert np.abs(away / drawn.std(axis=0)).max() < 4.5 / np.sqrt(1000)


def test_drawn_functions_have_the_variance_of_the_posterior_on_average(emulator, others):
    """Functions drawn together share their waves, and are too rough or too smooth together."""
    count, variance = 24, emulator.deviation(others[:50]) ** 2
    ratios = []
    for seed in range(count):
        drawn = emulator.draw(100, np.random.default_rng(seed))(others[:50])
        ratios.append(np.mean(drawn.var(axis=0, ddof=1) / variance))
    error = np.std(ratios, ddof=1) / np.sqrt(count)
    assert abs(np.mean(ratios) - 1.0) < t.isf(3e-5, count - 1) * error
    assert error < 0.1


def test_functions_can_be_asked_again_elsewhere(emulator, others):
    functions = emulator.draw(3, np.random.default_rng(2))
    whole = functions(others)
    assert functions(others[7:9]) == pytest.approx(whole[:, 7:9])


def test_equal_points_are_one_with_the_mean_of_their_samples():
    points = np.array([[0.2, 0.1], [0.5, 0.5], [0.2, 0.1]])
    data = merge_samples(points, np.array([1.0, 5.0, 2.0]))
    assert data.points.tolist() == [[0.2, 0.1], [0.5, 0.5]]
    assert data.means.tolist() == [1.5, 5.0]
    assert data.samples.tolist() == [2, 1]
    assert data.squares.tolist() == [0.5, 0.0]


def test_many_samples_of_a_point_say_its_noise():
    """30 samples each: the noise is known to sqrt(1/58) of itself at every point."""
    points, rng = qmc.Sobol(2, seed=4).random(64), np.random.default_rng(4)
    points = np.repeat(points, 30, axis=0)
    values = truth(points) + noise(points) * rng.normal(size=len(points))
    found = Emulator(merge_samples(points, values), np.random.default_rng(1))
    ratio = found.noise(points[::30]) / noise(points[::30])
    assert ratio == pytest.approx(1.0, abs=4.0 * np.sqrt(1.0 / 58))
