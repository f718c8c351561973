"""The formulas of kinetic theory against quadrature of what they are mean values of."""

import math

import kinetic_theory as theory
import numpy as np
import pytest

from agglom_mpi.physics.kinetic_theory import (
    contact_value,
    enskog_rate,
    mean_free_path,
    volume_fraction,
)

SAMPLES = 400_000
T, M = 1.7, 0.6


def pairs(seed):
    """Velocities of two Maxwellian spheres, and directions on the unit sphere."""
    generator = np.random.default_rng(seed)
    first, second = generator.normal(size=(2, SAMPLES, 3)) * math.sqrt(T / M)
    n = generator.normal(size=(SAMPLES, 3))
    return first, second, n / np.linalg.norm(n, axis=1)[:, None]


def agrees(samples, expected):
    """Whether the mean is the expected one, within four standard errors."""
    error = np.std(samples) / math.sqrt(len(samples))
    return abs(np.mean(samples) - expected) < 4.0 * error


def ratio_agrees(above, below, expected):
    """The same of a ratio of means: of the mean of above − expected·below, which is zero."""
    return agrees(above - expected * below, 0.0)


def squared(v):
    return np.sum(v**2, axis=1)


# rates


def test_the_rate_is_that_of_the_mean_relative_speed():
    first, second, _ = pairs(1)
    n, sigma = 0.3, 0.5
    chi = contact_value(volume_fraction(n, sigma))
    swept = n * chi * math.pi * sigma**2 * np.linalg.norm(first - second, axis=1)
    assert agrees(swept, enskog_rate(n, sigma, T, M))


def test_a_collision_cylinder_and_the_flux_onto_the_sphere_are_the_same_rate():
    first, second, n = pairs(2)
    sigma = 0.5
    flux = 4.0 * math.pi * sigma**2 * np.maximum(np.sum((first - second) * n, axis=1), 0.0)
    assert agrees(flux, enskog_rate(1e-9, sigma, T, M) / 1e-9)


def test_the_free_path_is_the_mean_speed_over_the_rate():
    first, _, _ = pairs(3)
    n, sigma = 0.3, 0.5
    path = mean_free_path(n, sigma)
    assert agrees(np.sqrt(squared(first)), path * enskog_rate(n, sigma, T, M))


@pytest.mark.parametrize("fraction", [0.01, 0.1, 0.3])
def test_the_contact_value_gives_carnahan_and_starlings_pressure(fraction):
    pressure = (1.0 + fraction + fraction**2 - fraction**3) / (1.0 - fraction) ** 3
    assert 1.0 + 4.0 * fraction * contact_value(fraction) == pytest.approx(pressure)


def test_the_contact_value_begins_with_the_third_spheres_shadow():
    # At contact the excluded spheres of radius σ share a lens; χ = 1 + n·lens + O(φ²).
    generator = np.random.default_rng(4)
    r = generator.uniform(-1.0, 1.0, (SAMPLES, 3))
    lens = 8.0 * ((squared(r) < 1.0) & (squared(r - [1.0, 0, 0]) < 1.0))
    fraction = 1e-5
    slope = (contact_value(fraction) - 1.0) / fraction
    assert slope == pytest.approx(2.5, rel=1e-4)
    assert agrees(lens, slope * math.pi / 6.0)


@pytest.mark.parametrize("number", [2, 3, 5, 50])
def test_the_finite_rate_is_that_of_a_fixed_energy_and_no_momentum(number):
    generator = np.random.default_rng(number)
    sigma, volume = 1e-3, 2.0
    relative = []
    for _ in range(20_000):
        v = theory.maxwellian(np.full(number, M), T, generator)
        relative.append(np.linalg.norm(v[0] - v[1]))
    swept = (number - 1) / volume * math.pi * sigma**2 * np.array(relative)
    expected = theory.finite_rate(number, volume, sigma, T, M)
    if number == 2:  # all the energy is in one relative velocity
        np.testing.assert_allclose(swept, expected, rtol=1e-7)
    else:
        assert agrees(swept, expected)


def test_the_finite_rate_becomes_enskogs():
    number, volume, sigma = 10**6, 8.0, 0.01
    expected = enskog_rate(number / volume, sigma, T, M)
    assert theory.finite_rate(number, volume, sigma, T, M) == pytest.approx(expected, rel=3e-6)


# cooling


def test_collisions_meet_a_mean_square_approach_of_four_temperatures():
    first, second, n = pairs(5)
    w = np.maximum(np.sum((first - second) * n, axis=1), 0.0)
    assert ratio_agrees(w**3, w, 4.0 * T / M)
    e = 0.7
    loss = 0.5 * (0.5 * M) * w**2 * (1.0 - e**2)
    assert ratio_agrees(loss * w, w, theory.energy_loss(e, T))


def test_haffs_law_solves_its_equation():
    e, initial, rate, step = 0.8, 1.3, 0.7, 1e-5
    for time in (0.0, 1.0, 30.0):
        at = theory.haff_temperature(time, initial, e, rate)
        slope = theory.haff_temperature(time + step, initial, e, rate) - at
        now = rate * math.sqrt(at / initial)
        loss = 0.5 * now * theory.energy_loss(e, at)  # ω/2 collisions per sphere
        assert 1.5 * slope / step == pytest.approx(-loss, rel=1e-5)
        count = theory.haff_collisions(time + step, e, rate) - theory.haff_collisions(time, e, rate)
        assert count / step == pytest.approx(now, rel=1e-5)


def test_without_losses_haffs_gas_stays_warm_and_collides_evenly():
    assert theory.haff_temperature(5.0, 1.3, 1.0, 0.7) == 1.3
    assert theory.haff_collisions(5.0, 1.0, 0.7) == 3.5
    assert theory.haff_collisions(5.0, 1.0 - 1e-9, 0.7) == pytest.approx(3.5, rel=1e-8)


def reduced(v):
    """c² = mv²/(2T)."""
    return squared(v) * M / (2.0 * T)


def sonine(x):
    return 0.5 * x**2 - 2.5 * x + 15.0 / 8.0


def test_sonine_corrections_multiply_the_rates_to_first_order():
    first, second, _ = pairs(6)
    weight = sonine(reduced(first)) + sonine(reduced(second))
    g = np.linalg.norm(first - second, axis=1)
    e = 0.9
    a2 = theory.sonine_coefficient(e)
    assert ratio_agrees(g * weight, g, (theory.rate_correction(e) - 1.0) / a2)
    assert ratio_agrees(g**3 * weight, g**3, (theory.haff_correction(e) - 1.0) / a2)


@pytest.mark.parametrize("e", [0.3, 0.6, 0.9])
def test_the_sonine_coefficient_keeps_the_shape_of_the_distribution(e):
    # In the cooling state ⟨c⁴⟩ = 15/4(1 + a₂) stays, so collisions change Σc⁴ by 5(1 + a₂) times
    # what they change Σc², each to first order in a₂; of the product a₂² is dropped.
    first, second, n = pairs(7)
    approach = np.sum((first - second) * n, axis=1)
    kick = (0.5 * (1.0 + e) * approach)[:, None] * n
    before = reduced(first), reduced(second)
    after = reduced(first - kick), reduced(second + kick)
    change2 = np.abs(approach) * (sum(after) - sum(before))
    change4 = np.abs(approach) * (after[0] ** 2 + after[1] ** 2 - before[0] ** 2 - before[1] ** 2)
    weight = sonine(before[0]) + sonine(before[1])
    a2 = theory.sonine_coefficient(e)
    excess = change4 * (1.0 + a2 * weight) - 5.0 * change2 * (1.0 + a2 + a2 * weight)
    assert agrees(excess, 0.0)


def test_the_sonine_coefficient_vanishes_for_elastic_spheres_and_at_the_root_of_a_half():
    assert theory.sonine_coefficient(1.0) == 0.0
    assert theory.sonine_coefficient(math.sqrt(0.5)) == pytest.approx(0.0, abs=1e-15)


# velocities


@pytest.mark.parametrize("exact", [True, False])
def test_sampled_velocities_have_no_momentum_and_their_temperature(exact):
    generator = np.random.default_rng(8)
    mass = generator.uniform(0.5, 2.0, 5)
    energies = []
    for _ in range(5000):
        v = theory.maxwellian(mass, T, generator, exact=exact)
        assert np.max(np.abs(mass @ v)) < 1e-13 * mass.sum() * math.sqrt(T / mass.min())
        energies.append(0.5 * float(mass @ squared(v)))
    expected = 0.5 * (3 * 5 - 3) * T
    if exact:
        np.testing.assert_allclose(energies, expected, rtol=1e-13)
    else:
        assert agrees(np.array(energies), expected)


def test_the_two_temperatures_differ_by_the_momentum_that_is_not_free():
    v = theory.maxwellian(np.full(10, M), T, np.random.default_rng(9))
    assert theory.free_temperature(v, M) == pytest.approx(T, rel=1e-14)
    assert theory.temperature(v, M) == pytest.approx(0.9 * T, rel=1e-14)
    assert theory.temperature(v + np.array([1.0, 2.0, 3.0]), M) == pytest.approx(0.9 * T, rel=1e-12)
