import numpy as np
import pytest
from scipy.stats import qmc

from agglom_mpi.emulation.likelihood_fit import (
    LargeFit,
    emulator_prior,
    fit_data,
    negative_log_posterior,
)


def test_the_gradient_of_the_likelihood_is_its_slope():
    rng = np.random.default_rng(0)
    points, values = rng.random((20, 3)), rng.normal(size=20)
    weights, at = rng.uniform(1.0, 5.0, 20), np.log([1.2, 0.5, 0.8, 1.5, 0.3])
    data = fit_data(points, values, weights, emulator_prior(3, 1), False)
    _, gradient = negative_log_posterior(at, data)
    for i, slope in enumerate(gradient):
        step = np.eye(5)[i] * 1e-5
        ends = [negative_log_posterior(at + s * step, data, gradient=False)[0] for s in (1, -1)]
        assert slope == pytest.approx((ends[0] - ends[1]) / 2e-5, rel=1e-4, abs=1e-5)


def test_what_does_not_matter_gets_the_longest_length():
    points, rng = qmc.Sobol(3, seed=9).random(256), np.random.default_rng(1)
    values = np.sin(6.0 * points[:, 1]) + 0.05 * rng.normal(size=256)
    lengths = LargeFit(points, values, np.ones(256), rng).fitted().lengths
    assert lengths[1] < 0.3 * min(lengths[0], lengths[2])


def test_a_group_explains_what_a_variable_of_it_explains_as_well():
    """Where one does not change without the other, only what is expected tells them apart."""
    rng = np.random.default_rng(2)
    points = qmc.Sobol(2, seed=7).random(256)
    points = np.column_stack((points, points[:, 0]))
    values = np.sin(6.0 * points[:, 0]) + 0.05 * rng.normal(size=256)
    own, _, group = LargeFit(points, values, np.ones(256), rng, groups=1).fitted().lengths
    assert group < 0.3 * own
