import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.stats import chi2, norm
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import ConstantKernel, Matern

from agglom_mpi.emulation.gaussian_process import (
    JITTER,
    Covariance,
    GaussianProcess,
    distances,
    matern,
    standardised,
)
from agglom_mpi.emulation.likelihood_fit import (
    LENGTH_BOUNDS,
    NOISE_BOUNDS,
    fit_covariance,
    fit_data,
    negative_log,
    negative_log_posterior,
    search_prior,
)

# Conditions of all matrices here are below 1e6, which rounding multiplies.
ROUNDING = 1e-9

cases = given(
    dimensions=st.integers(1, 4),
    count=st.integers(2, 12),
    seed=st.integers(0, 2**32),
    decades=st.tuples(*[st.floats(-1, 1)] * 3),
)
modest = settings(derandomize=True, deadline=None, max_examples=40)


def drawn(dimensions, count, seed, decades=(0.0, 0.0, -0.5)):
    """Return a covariance, points, means and numbers of samples."""
    rng = np.random.default_rng(seed)
    lengths = 10.0 ** decades[1] * rng.uniform(0.5, 2.0, dimensions)
    covariance = Covariance(10.0 ** decades[0], lengths, 10.0 ** (decades[2] - 1.5))
    points = rng.random((count, dimensions))
    return covariance, points, 5.0 + 0.1 * rng.normal(size=count), rng.integers(1, 6, count)


def prior(covariance, points, samples):
    """Return the covariance of the observed means, shape (n, n)."""
    between = matern(distances(points / covariance.lengths, points / covariance.lengths))
    return covariance.variance * between + np.diag(covariance.noise / samples + JITTER)


def logarithms(covariance):
    return np.log([covariance.variance, *covariance.lengths, covariance.noise])


def data_of(points, values, samples, is_recorded=True):
    """Return the data of a fit with the prior of a search."""
    prior = search_prior(points.shape[1])
    return fit_data(points, standardised(values)[2], samples.astype(float), prior, is_recorded)


def differences(function, at, step):
    """Central differences of a function of a vector."""
    steps = step * np.eye(len(at))
    return np.array([(function(at + h) - function(at - h)) / (2.0 * step) for h in steps])


@pytest.mark.parametrize("is_recorded", [True, False], ids=["recorded", "fast"])
@cases
@modest
def test_the_gradient_of_the_likelihood_is_its_derivative(
    is_recorded, dimensions, count, seed, decades
):
    covariance, points, values, samples = drawn(dimensions, count, seed, decades)
    data, at = data_of(points, values, samples, is_recorded), logarithms(covariance)
    value, gradient = negative_log_posterior(at, data)
    found = differences(lambda x: negative_log_posterior(x, data, gradient=False)[0], at, 1e-4)
    # Logarithms change by 1e-4: a third derivative of the value's size gives 1e-8 of it.
    assert np.allclose(found, gradient, rtol=0.0, atol=1e-6 * (1.0 + abs(value)))


@cases
@modest
def test_both_arithmetics_give_the_same_likelihood_but_for_rounding(
    dimensions, count, seed, decades
):
    covariance, points, values, samples = drawn(dimensions, count, seed, decades)
    one, other = (
        negative_log_posterior(
            logarithms(covariance), data_of(points, values, samples, is_recorded)
        )
        for is_recorded in (True, False)
    )
    assert one[0] == pytest.approx(other[0], rel=ROUNDING, abs=ROUNDING)
    size = 1.0 + abs(one[0]) + abs(one[1]).max()
    assert np.allclose(one[1], other[1], rtol=0.0, atol=1e-7 * size)


@cases
@modest
def test_the_slope_of_the_mean_is_its_derivative(dimensions, count, seed, decades):
    covariance, points, values, samples = drawn(dimensions, count, seed, decades)
    process = GaussianProcess(covariance, points, values, samples)
    at = np.random.default_rng(seed + 1).random(dimensions)
    value, slope = process.mean_and_slope(at)
    assert value == pytest.approx(process.mean(at[None])[0], rel=ROUNDING)
    found = differences(lambda x: process.mean(x[None])[0], at, 1e-5)
    # Three derivatives by a length of at least 0.05 are 8000 times the value, times 1e-10.
    inverse = np.linalg.inv(prior(covariance, points, samples))
    _, scale, standard = standardised(values)
    size = abs(inverse @ standard).sum() * scale * covariance.variance
    assert np.allclose(found, slope, rtol=0.0, atol=1e-5 * size)


def test_the_slope_is_finite_at_a_point_of_the_data():
    covariance, points, values, samples = drawn(3, 8, 1)
    process = GaussianProcess(covariance, points, values, samples)
    value, slope = process.mean_and_slope(points[2])
    assert value == pytest.approx(process.mean(points[2:3])[0], rel=ROUNDING)
    found = differences(lambda x: process.mean(x[None])[0], points[2], 1e-6)
    assert np.allclose(found, slope, rtol=0.0, atol=1e-5)


@cases
@modest
def test_posterior_and_likelihood_are_those_of_scikit_learn(dimensions, count, seed, decades):
    covariance, points, values, samples = drawn(dimensions, count, seed, decades)
    centre, scale, standard = standardised(values)
    peer = GaussianProcessRegressor(
        ConstantKernel(covariance.variance) * Matern(covariance.lengths, nu=2.5),
        alpha=covariance.noise / samples + JITTER,
        optimizer=None,
    ).fit(points, standard)
    at = np.random.default_rng(seed + 1).random((20, dimensions))
    mean, deviation = peer.predict(at, return_std=True)
    process = GaussianProcess(covariance, points, values, samples)
    assert np.allclose(process.mean(at), centre + scale * mean, rtol=0.0, atol=1e-8 * scale)
    # Variances are differences of numbers of the size of the prior one.
    variance = (process.deviation(at) / scale) ** 2
    assert np.allclose(variance, deviation**2, rtol=0.0, atol=1e-8 * covariance.variance)
    assert process.sample_deviation == pytest.approx(scale * np.sqrt(covariance.noise))
    at = logarithms(covariance)
    unlikely, _ = negative_log_posterior(at, data_of(points, values, samples))
    before = negative_log(search_prior(dimensions), at[1:-1])[0]
    likelihood = before - unlikely - 0.5 * count * np.log(2.0 * np.pi)
    assert likelihood == pytest.approx(peer.log_marginal_likelihood_value_, rel=1e-7, abs=1e-7)


@cases
@modest
def test_at_the_points_of_the_data_it_expects_what_it_does_elsewhere(
    dimensions, count, seed, decades
):
    covariance, points, values, samples = drawn(dimensions, count, seed, decades)
    process = GaussianProcess(covariance, points, values, samples)
    at, scale = ROUNDING * covariance.variance, standardised(values)[1]
    assert np.allclose(process.mean_at_points, process.mean(points), rtol=0.0, atol=at * scale)
    variances = process.deviation_at_points**2, process.deviation(points) ** 2
    assert np.allclose(*variances, rtol=0.0, atol=at * scale**2)


@cases
@modest
def test_grown_by_a_border_it_is_as_if_made_at_once(dimensions, count, seed, decades):
    covariance, points, values, samples = drawn(dimensions, count, seed, decades)
    at = np.random.default_rng(seed + 1).random((20, dimensions))
    known = 1 + seed % (count - 1)
    first = points[:known], 2.0 + values[:known] ** 2, samples[:known]
    grown = GaussianProcess(
        covariance, points, values, samples, GaussianProcess(covariance, *first)
    )
    whole = GaussianProcess(covariance, points, values, samples)
    close = {"rtol": 0.0, "atol": ROUNDING * covariance.variance * standardised(values)[1]}
    assert np.allclose(grown.mean(at), whole.mean(at), **close)
    assert np.allclose(grown.deviation(at) ** 2, whole.deviation(at) ** 2, **close)
    assert np.allclose(grown.deviation_at_points**2, whole.deviation_at_points**2, **close)
    assert np.allclose(grown.leave_one_out(), whole.leave_one_out(), rtol=1e-6)


@cases
@modest
def test_the_order_of_the_data_does_not_matter(dimensions, count, seed, decades):
    covariance, *data = drawn(dimensions, count, seed, decades)
    order = np.random.default_rng(seed).permutation(count)
    at = np.random.default_rng(seed + 1).random((5, dimensions))
    one = GaussianProcess(covariance, *data)
    other = GaussianProcess(covariance, *(column[order] for column in data))
    assert np.allclose(one.mean(at), other.mean(at), rtol=ROUNDING)
    assert np.allclose(one.deviation(at), other.deviation(at), rtol=1e-6, atol=1e-7)


@cases
@modest
def test_values_may_have_any_unit_and_origin(dimensions, count, seed, decades):
    covariance, points, values, samples = drawn(dimensions, count, seed, decades)
    at = np.random.default_rng(seed + 1).random((5, dimensions))
    one = GaussianProcess(covariance, points, values, samples)
    other = GaussianProcess(covariance, points, 700.0 - 3.0 * values, samples)
    assert np.allclose(other.mean(at), 700.0 - 3.0 * one.mean(at), rtol=ROUNDING)
    assert np.allclose(other.deviation(at), 3.0 * one.deviation(at), rtol=ROUNDING)
    assert np.allclose(other.sample_deviation, 3.0 * one.sample_deviation, rtol=ROUNDING)


def test_the_unit_of_the_values_does_not_change_what_is_fitted():
    _, points, values, samples = drawn(3, 40, 4)
    one = fit_covariance(points, values, samples)
    other = fit_covariance(points, 64.0 * values, samples)  # a power of 2, so without rounding
    assert np.array_equal(np.hstack(one), np.hstack(other))


def test_a_mean_of_n_samples_weighs_like_n_samples():
    covariance, points, values, _ = drawn(2, 6, 5)
    at, times = np.random.default_rng(0).random((7, 2)), 4
    mean = GaussianProcess(covariance, points, values, np.full(6, times))
    data = np.repeat(points, times, axis=0), np.repeat(values, times), np.ones(6 * times, int)
    single = GaussianProcess(covariance, *data)
    # The jitter of 1e-8 of the prior variance is there once, or four times.
    assert np.allclose(mean.mean(at), single.mean(at), rtol=0.0, atol=1e-6)
    assert np.allclose(mean.deviation(at), single.deviation(at), rtol=0.0, atol=1e-6)
    fewer = GaussianProcess(covariance, points, values, np.full(6, 1))
    assert np.all(mean.deviation(points) < fewer.deviation(points))


def test_far_from_all_data_nothing_is_known():
    covariance, points, values, samples = drawn(3, 10, 6)
    process = GaussianProcess(covariance, points, values, samples)
    far = np.full((1, 3), 1e3)
    assert process.mean(far)[0] == pytest.approx(values.mean(), rel=1e-14)
    prior = values.std() * np.sqrt(covariance.variance)
    assert process.deviation(far)[0] == pytest.approx(prior, rel=1e-14)


def test_draws_have_mean_and_covariance_of_the_posterior():
    covariance, points, values, samples = drawn(2, 6, 7)
    process = GaussianProcess(covariance, points, values, samples)
    at, number = np.random.default_rng(1).random((4, 2)), 20000
    draws = process.draw(at, number, np.random.default_rng(2))
    _, scale, _ = standardised(values)
    kernel = ConstantKernel(covariance.variance) * Matern(covariance.lengths, nu=2.5)
    noise = np.diag(covariance.noise / samples + JITTER)
    across = kernel(points, at)
    wanted = kernel(at) - across.T @ np.linalg.solve(kernel(points) + noise, across)
    wanted = scale**2 * (wanted + 1e-6 * covariance.variance * np.eye(4))
    variances = np.diag(wanted)
    errors = np.sqrt(variances / number)
    assert np.all(abs(draws.mean(axis=0) - process.mean(at)) < 4.0 * errors)
    # Var of a sample covariance of normal numbers: (C_ii C_jj + C_ij²) / n.
    errors = np.sqrt((np.outer(variances, variances) + wanted**2) / number)
    assert np.all(abs(np.cov(draws.T) - wanted) < 4.0 * errors)


def covariance_matrix(logs, points):
    lengths = np.exp(logs[1:-1])
    away = (points[:, None] - points[None]) / lengths
    smooth = np.exp(logs[0]) * matern(np.sqrt((away**2).sum(axis=2)))
    return smooth + np.exp(logs[-1]) * np.eye(len(points))


def noise_error(logs, points):
    """Standard error of the logarithm of the noise."""
    matrix = covariance_matrix(logs, points)
    slopes = differences(lambda x: covariance_matrix(x, points), logs, 1e-5)
    relative = [np.linalg.solve(matrix, slope) for slope in slopes]
    # Fisher information of a normal distribution [RW 5.9 squared and averaged].
    information = np.array([[0.5 * np.trace(a @ b) for a in relative] for b in relative])
    return np.sqrt(np.linalg.inv(information)[-1, -1])


def log_likelihood(logs, points, values):
    matrix = covariance_matrix(logs, points)
    return -0.5 * (values @ np.linalg.solve(matrix, values) + np.linalg.slogdet(matrix)[1])


@pytest.mark.parametrize("seed", range(3))
def test_a_fit_finds_the_lengths_and_the_noise_that_there_are(seed):
    """By the ratio of the likelihoods; logarithms of lengths are far from normally distributed."""
    rng = np.random.default_rng(seed)
    logs, points = np.log([1.0, 0.3, 0.8, 0.05]), rng.random((200, 2))
    values = np.linalg.cholesky(covariance_matrix(logs, points)) @ rng.normal(size=200)
    found = fit_covariance(points, values, np.ones(200, int))
    # Variances are relative to those of the values, lengths are not.
    scale, centred = values.var(), values - values.mean()
    fitted = np.log([found.variance * scale, *found.lengths, found.noise * scale])
    better = log_likelihood(fitted, points, centred) - log_likelihood(logs, points, centred)
    unlikely = chi2.isf(2.0 * norm.sf(4.0), len(logs))  # as 4 standard errors
    prior = search_prior(2)
    by_prior = negative_log(prior, logs[1:-1])[0] - negative_log(prior, fitted[1:-1])[0]
    assert better + by_prior > 0.0  # the fit is at least as good as what there is
    assert 2.0 * better < unlikely
    error = noise_error(logs, points)
    assert abs(fitted[-1] - logs[-1]) < 4.0 * error
    assert error < 0.2  # or this would not say much


@pytest.mark.parametrize("seed", range(3))
def test_pure_noise_is_not_taken_for_a_function(seed):
    rng = np.random.default_rng(seed)
    points, values = rng.random((60, 5)), rng.normal(size=60)
    found = fit_covariance(points, values, np.ones(60, int))
    process = GaussianProcess(found, points, values, np.ones(60, int))
    # 60 numbers tell their standard deviation to 1/√120; a regression may explain a third.
    assert process.sample_deviation > (1.0 - 4.0 / np.sqrt(120.0)) * values.std()


def test_a_length_of_what_plays_no_part_is_longer_than_the_box():
    rng = np.random.default_rng(3)
    points = rng.random((80, 3))
    values = np.sin(6.0 * points[:, 0]) + 0.1 * rng.normal(size=80)
    found = fit_covariance(points, values, np.ones(80, int))
    assert found.lengths[0] < 1.0
    assert np.all(found.lengths[1:] > 1.0)


@pytest.mark.parametrize("value", [0.0, 0.1, -3e7])
def test_values_that_are_all_equal_are_expected_everywhere(value):
    points = np.random.default_rng(0).random((9, 4))
    values, samples = np.full(9, value), np.ones(9, int)
    process = GaussianProcess(fit_covariance(points, values, samples), points, values, samples)
    at = np.random.default_rng(1).random((6, 4))
    assert np.allclose(process.mean(at), value, rtol=1e-12, atol=0.0)
    assert np.all(np.isfinite(process.deviation(at)))
    assert np.all(np.isfinite(process.draw(at, 3, np.random.default_rng(2))))


@pytest.mark.parametrize("away", [1.0, 1e-9, 0.0])
def test_two_points_are_enough_for_a_fit(away):
    points = np.array([[0.2, 0.4], [0.2 + 0.5 * away, 0.4]])
    values, samples = np.array([1.0, 2.0]), np.array([1, 3])
    found = fit_covariance(points, values, samples)
    assert np.all((found.lengths >= LENGTH_BOUNDS[0]) & (found.lengths <= LENGTH_BOUNDS[1]))
    assert NOISE_BOUNDS[0] * (1 - 1e-12) <= found.noise <= NOISE_BOUNDS[1]
    process = GaussianProcess(found, points, values, samples)
    assert np.all((process.mean(points) > 0.9) & (process.mean(points) < 2.1))
