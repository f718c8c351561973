"""Homogeneous cooling of rough grains beside kinetic theory."""

import math

import numpy as np
import pytest
from rough_cooling import Pairs, coefficients, collision_rate, cooled, gas, late_ratio, temperatures

ROUGHEST = 1e6
"""Coefficient of friction at which all contacts stick."""


def start_rate(scene):
    """Collisions per grain and s at the start, where components are uniform from −v⁰ to v⁰."""
    return collision_rate(scene, scene.mass * scene.velocities.relative_speed**2 / 3.0)


def test_the_late_ratio_of_maxwellians_is_that_of_santos_and_others():
    """θ = C + √(1 + C²) by their C of the restitutions α and β and of κ = 4I/(mσ²)."""
    kappa = 0.4
    for e in (0.5, 0.8, 1.0):
        for beta in (-0.9, 0.0, 0.5, 1.0):
            rough = (1.0 + kappa) * (1.0 - e * e) / (1.0 + beta) - (1.0 - kappa) * (1.0 - beta)
            c = (1.0 + kappa) / (2.0 * kappa * (1.0 + beta)) * rough
            assert late_ratio(e, beta) == pytest.approx(c + math.sqrt(1.0 + c * c), rel=1e-12)
    assert late_ratio(1.0, 1.0) == pytest.approx(1.0)
    a, b, c = coefficients(1.0, 1.0)  # elastic and perfectly rough: no energy is lost
    assert (a, c) == pytest.approx((b, b))


@pytest.mark.slow
@pytest.mark.parametrize(("e", "beta", "ratio"), [(0.95, 0.9, 0.0), (0.95, -0.5, 1.0)])
def test_both_temperatures_fall_as_huthmann_and_zippelius_say(e, beta, ratio):
    """Within 2 % at a volume fraction of 0.05, from 5 to some 60 collisions of each grain."""
    scene = gas(e, ROUGHEST, beta, ratio, 2000, 0.05)
    times = np.array([5.0, 10.0, 20.0, 40.0, 80.0]) / start_rate(scene)
    found = temperatures(scene, times, range(20))
    mean, error = found.mean(axis=0), found.std(axis=0, ddof=1) / math.sqrt(len(found))
    expected = cooled(scene, e, beta, mean[:, 0], times)
    relative = error / mean
    allowed = 0.02 + 4.0 * np.hypot(relative, relative[:, :1])
    assert mean[0, -1] < 0.7 * mean[0, 0]
    assert np.all(np.abs(mean / expected - 1.0)[:, 1:] <= allowed[:, 1:])


@pytest.mark.slow
def test_the_ratio_at_late_times_is_that_of_the_sonine_approximation():
    """And not that of Maxwellians, which is 5 % above it."""
    e, beta = 0.9, 0.0
    states = np.array([Pairs(100_000, seed).late_state(e, beta) for seed in range(8)])
    ratio = states[:, 0].mean()
    scene = gas(e, ROUGHEST, beta, ratio, 2000, 0.02)
    found = temperatures(scene, [200.0 / start_rate(scene)], range(40))
    ratios = found[:, 1, 0] / found[:, 0, 0]
    errors = [values.std(ddof=1) / math.sqrt(len(values)) for values in (states[:, 0], ratios)]
    assert abs(ratios.mean() - ratio) <= 4.0 * math.hypot(*errors)
    assert late_ratio(e, beta) - ratios.mean() > 4.0 * errors[1]
