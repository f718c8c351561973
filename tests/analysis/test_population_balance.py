"""Smoluchowski's equations of numbers and energies: exact solutions, balances, direct samples."""

import math

import numpy as np
import pytest

from agglom_mpi import load_campaign
from agglom_mpi.analysis.population_balance import (
    POINTS,
    Grid,
    Impacts,
    PairRates,
    maxwellian_law,
    solve,
)
from agglom_mpi.physics.kinetic_theory import enskog_rate

PER_DECADE = 12
DUST = """\
scene:
  {particles: 1000, grain_radius: 1 um, heating: none, end_time: 700 us,
   velocities: {law: spread, mean: [0, 0, 0], transverse: 1},
   restitution: {law: adhesive, dry: {law: constant, value: 0.9}, youngs_modulus: 70 GPa}}
variables: {relative_speed: 1, volume_fraction: 0.01, density: 2500, surface_energy: 0.2}
"""


def kernel_law(grid, kernel):
    """Law of a kernel of both masses, which all pairs that meet obey; nothing moves."""
    first, second = grid.pairs
    factor = np.where(first == second, 0.5, 1.0) * kernel(grid.masses[first], grid.masses[second])
    nothing = np.zeros((2, len(factor)))

    def law(numbers, energies):
        return PairRates(factor * numbers[first] * numbers[second], nothing, nothing[0], nothing)

    return law


def grown(kernel, duration, decades=4):
    """Masses, and numbers over time from grains of mass 1 and density 1."""
    grid = Grid(10.0 ** (np.arange(decades * PER_DECADE + 1) / PER_DECADE))
    start = np.zeros(len(grid.masses))
    start[0] = 1.0
    numbers, _ = solve(grid, kernel_law(grid, kernel), start, np.zeros_like(start), duration)
    return grid.masses, numbers, np.linspace(0.0, duration, POINTS)


def test_a_constant_kernel_has_the_numbers_and_second_moment_of_smoluchowski():
    masses, numbers, times = grown(lambda x, y: np.ones_like(x), 20.0)
    assert numbers.sum(axis=0) == pytest.approx(1.0 / (1.0 + 0.5 * times), rel=1e-5)
    assert masses @ numbers == pytest.approx(np.ones(POINTS))
    # The fixed pivot widens the distribution by half of the square of a step of the grid.
    step = 10.0 ** (1.0 / PER_DECADE) - 1.0
    assert masses**2 @ numbers == pytest.approx(1.0 + times, rel=0.5 * step**2)


def test_an_additive_kernel_has_numbers_that_fall_exponentially():
    masses, numbers, times = grown(lambda x, y: x + y, 1.5)
    assert numbers.sum(axis=0) == pytest.approx(np.exp(-times), rel=1e-5)
    assert masses @ numbers == pytest.approx(np.ones(POINTS))


def test_a_multiplicative_kernel_has_numbers_that_fall_linearly_before_its_gel():
    masses, numbers, times = grown(lambda x, y: x * y, 0.5)
    assert numbers.sum(axis=0) == pytest.approx(1.0 - 0.5 * times, rel=1e-5)
    assert (masses @ numbers)[-1] == pytest.approx(1.0)


def impacts(grid, sticking=0.0, restitution=1.0, normal=2.0, relative=4.0):
    """Impacts of Maxwellian gases: ⟨w²⟩ = 2(a + b), ⟨g²⟩ = 4(a + b)."""
    values = (1.0, sticking, normal, relative, restitution)
    return Impacts(*(np.full(grid.pairs.shape[1], value) for value in values))


def test_equal_grains_that_only_bounce_cool_by_haffs_law():
    """With Enskog's rate ω, dT/dt = −(1 − e²)ωT/3."""
    e, density, volume, number, temperature = 0.8, 2500.0, 1e-3, 1000.0, 1e-6
    mass, radius = density * 4.0 / 3.0 * math.pi * 1e-9, 1e-3
    grid = Grid(np.array([mass, 2.0 * mass]))
    law = maxwellian_law(grid, impacts(grid, restitution=e), density, volume)
    rate = enskog_rate(number / volume, 2.0 * radius, temperature, mass)
    duration = 60.0 / ((1.0 - e * e) * rate)
    start = np.array([number, 0.0]), np.array([1.5 * temperature * number, 0.0])
    numbers, energies = solve(grid, law, *start, duration)
    times = np.linspace(0.0, duration, POINTS)
    found = energies[0] / (1.5 * number)
    assert found == pytest.approx(
        temperature / (1.0 + (1.0 - e * e) * rate * times / 6.0) ** 2, rel=1e-5
    )
    assert numbers[0] == pytest.approx(np.full(POINTS, number))


def partial_temperatures_stay_equal(kernel, ratio):
    """Law in which sticking pairs meet with ⟨g²⟩ = `ratio` (a + b); efficiencies make the kernel.

    All temperatures are T at first. Two grains that stick leave one of energy 3T/2, and take
    T/2 (3m + ratio m')/(m + m') each, so the temperature T of a mass m changes by

        dT/dt = -T (ratio/3 - 1) Σ K n' m'/(m + m'),

    the same for all masses if K is c(m + m')√T, or if the ratio is 3. Number and energy follow.
    """
    density, temperature, volume = 2500.0, 1e-9, 1e6
    grid = Grid(10.0 ** (np.arange(4 * PER_DECADE + 1) / PER_DECADE))
    first, second = grid.pairs
    mass, other = grid.masses[first], grid.masses[second]
    radii = np.cbrt(3.0 * grid.masses / (4.0 * math.pi * density))
    speed = np.sqrt(8.0 / math.pi * temperature * (1.0 / mass + 1.0 / other))
    maxwellian = math.pi * (radii[first] + radii[second]) ** 2 * speed
    factors = impacts(grid, sticking=1.0, relative=ratio)
    factors = factors._replace(efficiency=kernel(mass, other) / maxwellian)
    law = maxwellian_law(grid, factors, density, volume)
    numbers = np.zeros(len(grid.masses))
    numbers[0] = 1e3
    return grid, law, numbers, 1.5 * temperature * numbers, 1e3 / volume


def test_a_constant_kernel_at_a_constant_temperature_has_the_numbers_of_smoluchowski():
    start = partial_temperatures_stay_equal(lambda x, y: np.ones_like(x), 3.0)
    grid, law, numbers, energies, density = start
    found, energy = solve(grid, law, numbers, energies, 20.0 / density)
    times = np.linspace(0.0, 20.0, POINTS)
    assert found.sum(axis=0) == pytest.approx(numbers[0] / (1.0 + 0.5 * times), rel=1e-5)
    there = found > 1e-6
    expected = np.broadcast_to(energies[0] / numbers[0], there.shape)
    assert energy[there] / found[there] == pytest.approx(expected[there], rel=1e-4)


@pytest.mark.parametrize("ratio", [4.0, 5.0])
def test_a_kernel_that_cools_with_its_grains_has_powers_of_time_as_exact_solution(ratio):
    """With K = (m + m')√(T/T0) and k = (ratio/3 - 1)/2: √(T0/T) = 1 + kt, N ~ (1 + kt)^(-1/k)."""
    start = partial_temperatures_stay_equal(lambda x, y: x + y, ratio)
    grid, law, numbers, energies, density = start
    found, energy = solve(grid, law, numbers, energies, 2.0 / density)
    k = 0.5 * (ratio / 3.0 - 1.0)
    cooled = 1.0 + k * np.linspace(0.0, 2.0, POINTS)
    assert found.sum(axis=0) / numbers[0] == pytest.approx(cooled ** (-1.0 / k), rel=1e-4)
    expected = cooled ** (-1.0 / k - 2.0)
    assert energy.sum(axis=0) / energies[0] == pytest.approx(expected, rel=1e-4)
    assert grid.masses @ found == pytest.approx(np.full(POINTS, numbers[0]))


def test_equations_without_an_end_are_given_up(monkeypatch):
    monkeypatch.setattr("agglom_mpi.analysis.population_balance.MAX_EVALUATIONS", 10)
    with pytest.raises(RuntimeError):
        grown(lambda x, y: x + y, 1.5)


def test_elastic_grains_of_two_sizes_share_their_energy_and_keep_it():
    grid = Grid(np.array([1e-6, 1e-5]))
    law = maxwellian_law(grid, impacts(grid), 2500.0, 1e-4)
    _, energies = solve(grid, law, np.array([500.0, 50.0]), np.array([1e-4, 1e-3]), 100.0)
    assert energies.sum(axis=0) == pytest.approx(np.full(POINTS, 1.1e-3))
    assert energies[0, -1] / 500.0 == pytest.approx(energies[1, -1] / 50.0)


@pytest.mark.parametrize("sticking", [0.3, 1.0])
def test_what_energy_falls_by_is_what_impacts_lose(sticking):
    grid = Grid(1e-6 * 10.0 ** (np.arange(25) / PER_DECADE))
    e, volume = 0.6, 1e-4
    law = maxwellian_law(grid, impacts(grid, sticking, e), 2500.0, volume)
    random = np.random.default_rng(3)
    numbers, energies = random.uniform(1.0, 50.0, (2, 25)) * np.array([[1.0], [1e-5]])
    rates = law(numbers, energies)
    change, energy = grid.change(rates)
    first, second = grid.pairs
    mass, other = grid.masses[first], grid.masses[second]
    reduced = mass * other / (mass + other)
    per_mass = energies / (1.5 * numbers * grid.masses)
    total = per_mass[first] + per_mass[second]
    sticks = rates.sticking
    bounces = sticks * (1.0 - sticking) / sticking
    lost = sticks @ (0.5 * reduced * 4.0 * total)
    lost += bounces @ (0.5 * reduced * (1.0 - e * e) * 2.0 * total)
    assert energy.sum() == pytest.approx(-lost)
    assert change @ grid.masses == pytest.approx(0.0, abs=1e-12 * sticks @ (mass + other))


@pytest.mark.slow
def test_the_equations_give_the_numbers_and_energies_of_direct_samples(tmp_path):
    """While the mean mass grows fivefold: within 1 and 2 %, and 4.5 standard errors."""
    path = tmp_path / "dust.yaml"
    path.write_text(DUST)
    campaign, times = load_campaign(path), [3e-5, 1e-4, 2e-4, 4e-4]
    found = campaign.collision_kernels(campaign.parameters(), samples=60, times=times)
    (value, error), solved = found.means, found.balance()
    assert value[-1, 0] < 250.0
    for place, within in enumerate((0.01, 0.02)):
        away = np.abs(solved[:, place] - value[:, place])
        assert np.all(away < within * value[:, place] + 4.5 * error[:, place])
