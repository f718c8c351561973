"""Sheared gases beside kinetic theory: elastic ones heat, inelastic ones reach a steady state."""

import math

import numpy as np
import pytest
from sheared_gas import RATE, coefficients, enskog, history, navier_stokes, started, steady_state

pytestmark = pytest.mark.slow


def mean_and_error(values):
    values = np.asarray(values)
    return values.mean(axis=0), values.std(axis=0, ddof=1) / math.sqrt(len(values))


def test_coefficients_are_those_of_enskog_without_dissipation():
    """η = η₀[(1 + 8φχ/5)²/χ + 768φ²χ/(25π)] (Chapman and Cowling), and nothing cools."""
    fraction, chi = 0.2, (1.0 - 0.1) / 0.8**3
    viscosity, cooling = coefficients(1.0, fraction)
    expected = (1.0 + 1.6 * fraction * chi) ** 2 / chi
    expected += 768.0 / (25.0 * math.pi) * fraction**2 * chi
    assert viscosity == pytest.approx(expected, rel=1e-12)
    assert cooling == 0.0


def test_elastic_grains_heat_as_their_viscosity_says():
    """√T grows evenly, by (2/3)ηa²/n = dT/dt and Enskog's η ~ √T; within 5 %."""
    fraction, viscosity = 0.1, coefficients(1.0, 0.1)[0]
    density, speed = 6.0 * fraction / math.pi, 8.0  # √T over aσ at the start: weak shear
    scene = started(1.0, fraction, 500, 1.0, 6.01)
    scene = started(1.0, fraction, 500, math.sqrt(3.0) * speed * 2.0 * scene.radius * RATE, 6.01)
    strains = np.array([1.0, 6.0])
    runs = np.array([history(scene, seed, strains) for seed in range(16)])
    growth = np.diff(np.sqrt(runs[:, 0]), axis=1)[:, 0] / 5.0
    expected = viscosity * 0.3125 / math.sqrt(math.pi) / (3.0 * density)
    mean, error = mean_and_error(growth)
    assert abs(mean / expected - 1.0) <= 0.05 + 4.0 * error / expected
    assert np.all(runs[:, 2] == 0.0)


@pytest.mark.parametrize("fraction", [0.1, 0.3])
def test_nearly_elastic_grains_come_to_the_steady_state_of_garzo_and_dufty(fraction):
    """T and the stress of e = 0.95 within 5 %."""
    found = [steady_state(0.95, fraction, 500, seed) for seed in range(8)]
    mean, error = mean_and_error(found)
    expected = np.array(navier_stokes(0.95, fraction))
    assert np.all(np.abs(mean / expected - 1.0) <= 0.05 + 4.0 * error / expected)


@pytest.mark.parametrize("fraction", [0.1, 0.3])
@pytest.mark.parametrize("e", [0.9, 0.8])
def test_inelastic_grains_come_to_the_steady_state_of_enskogs_equation(e, fraction):
    """Within 6 %, and colder than weak shear says.

    In a box of few grains: in a larger one, motion of whole regions adds to T, some 10 % from 60 to
    4000 grains at e = 0.8 and φ = 0.1.
    """
    found = [steady_state(e, fraction, 100, seed, (15.0, 215.0)) for seed in range(8)]
    mean, error = mean_and_error(found)
    theory, spread = mean_and_error([enskog(e, fraction, seed) for seed in range(3)])
    assert np.all(np.abs(mean / theory - 1.0) <= 0.06 + 4.0 * np.hypot(error, spread) / theory)
    assert mean[0] < navier_stokes(e, fraction)[0]


def test_the_flow_gives_what_impacts_take():
    """In the steady state, but for the energy that fluctuates."""
    scene = started(0.9, 0.1, 500, 5.0, 75.1)
    found = history(scene, 1, np.array([25.0, 75.0]))
    given, taken = np.diff(found[1:], axis=1)[:, 0]
    assert given == pytest.approx(taken, rel=0.05)
