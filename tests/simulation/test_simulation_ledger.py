"""What must be conserved is conserved, and the ledger says so."""

import math

import numpy as np
import pytest
from scenes import (
    HALF,
    ball_mass,
    breaking_adaptive_reentry,
    breaking_fixed_periodic,
    fixed_periodic,
    kinetic_energy,
    merging_adaptive_periodic,
    merging_fixed_reentry,
    momentum,
    placed,
    run_from,
)
from scipy.integrate import solve_ivp

from agglom_mpi.physics.fragmentation import PairEnergyFragmentation
from agglom_mpi.simulation.particles import COLLISIONS, DISSIPATED, MERGES, REACTION
from agglom_mpi.simulation.sample import simulate_scene

BREAKING = {
    "fixed, periodic, exact cooling": breaking_fixed_periodic(
        400, particles=60, size_ratio=0.7, end_time=4e-3
    ),
    "adaptive, re-entry, Euler cooling": breaking_adaptive_reentry(
        2e-6, 2e-5, particles=60, size_ratio=0.7, end_time=4e-3
    ),
}


@pytest.mark.parametrize("name", BREAKING)
@pytest.mark.parametrize("seed", range(6))
def test_momentum_energy_mass_and_grains_are_kept_through_merges_and_breakups(name, seed):
    scene = BREAKING[name]
    record, particles = simulate_scene(scene, np.random.default_rng(seed))
    assert record["state"] == 1
    assert record["merges"] > 20
    assert record["breakups"] > 5
    assert record["collisions"] > record["merges"]
    assert record["momentum_error"] <= 1e-12
    assert abs(record["energy_error"]) <= 1e-10
    assert record["floored_temperatures"] == record["capped_iterations"] == 0
    left = int(record["particles"])
    assert particles.grains[:left].sum() == scene.particles
    assert particles.grains[:left].min() >= 1
    assert particles.mass[:left].sum() == pytest.approx(60 * scene.mass, rel=1e-13)
    volumes = particles.radius[:left] ** 3
    assert volumes.sum() == pytest.approx(60 * scene.radius**3, rel=1e-12)
    masses = [ball_mass(radius) for radius in particles.radius[:left]]
    np.testing.assert_allclose(particles.mass[:left], masses, rtol=1e-12)
    assert np.all(np.abs(particles.position[:, :left]) <= HALF)


@pytest.mark.parametrize("name", BREAKING)
def test_grains_too_tough_to_break_only_merge(name):
    laws = BREAKING[name].laws._replace(fragmentation=PairEnergyFragmentation(1e16))
    record, particles = simulate_scene(BREAKING[name]._replace(laws=laws), np.random.default_rng(1))
    assert record["breakups"] == 0
    assert record["particles"] == 60 - record["merges"]
    assert abs(record["energy_error"]) <= 1e-10
    assert record["momentum_error"] <= 1e-12
    assert particles.grains[: int(record["particles"])].sum() == 60


@pytest.mark.parametrize("seed", [1, 2])
def test_exact_cooling_runs_to_the_end_for_those_that_never_collide(seed):
    scene = breaking_fixed_periodic(7, particles=20, size_ratio=0.3, end_time=50.0, speed=0.0)
    record, particles = simulate_scene(scene, np.random.default_rng(seed))
    assert record["collisions"] == 0
    law = scene.cooling.law
    rate = 4.0 * math.pi * scene.radius**2 / (scene.mass * scene.laws.heat_capacity)

    def slope(_, theta):
        radiated = 5.670374419e-8 * law.emissivity * (theta**4 - law.surroundings**4)
        return -rate * (radiated + law.convection * (theta - law.ambient))

    reference = solve_ivp(slope, (0.0, 50.0), [400.0], method="DOP853", rtol=1e-12, atol=1e-9)
    assert reference.y[0, -1] < 399.0
    assert particles.temperature[:20] == pytest.approx(reference.y[0, -1], rel=1e-9)
    assert record["mean_temperature"] == pytest.approx(reference.y[0, -1], rel=1e-9)
    assert abs(record["energy_error"]) <= 1e-10


@pytest.mark.parametrize("make", ["fixed", "adaptive"])
def test_what_impacts_dissipate_and_react_is_found_as_heat(make):
    options = {"particles": 40, "size_ratio": 0.7, "end_time": 2e-3}
    if make == "fixed":
        scene = merging_fixed_reentry(4e10, 200, **options)
    else:
        scene = merging_adaptive_periodic(2e4, 2e-6, 2e-5, **options)
    particles = placed(scene, 4)
    energy, start = kinetic_energy(particles), momentum(particles)
    impetus = np.sum(particles.mass * np.linalg.norm(particles.velocity, axis=0))
    ledger, _ = run_from(scene, particles)
    assert ledger.tally[COLLISIONS] > ledger.tally[MERGES] > 3
    assert np.linalg.norm(momentum(particles) - start) <= 1e-12 * impetus
    lost = energy - kinetic_energy(particles)
    assert lost == pytest.approx(ledger.energy[DISSIPATED], rel=1e-12)
    n = int(particles.size[0])
    warmed = particles.mass[:n] @ (particles.temperature[:n] - scene.temperature)
    heat = warmed * scene.laws.heat_capacity
    flowed = lost + ledger.energy[REACTION]
    # Heat is a small difference of temperatures: its digits are those of the thermal energy.
    thermal = particles.mass[:n] @ particles.temperature[:n] * scene.laws.heat_capacity
    assert heat == pytest.approx(flowed, rel=1e-10, abs=1e-13 * thermal)


def test_a_million_elastic_collisions_keep_the_kinetic_energy():
    scene = fixed_periodic(1.0, 60_000, particles=150, size_ratio=0.8, end_time=1.5)
    particles = placed(scene, 6)
    energy, start = kinetic_energy(particles), momentum(particles)
    impetus = np.sum(particles.mass * np.linalg.norm(particles.velocity, axis=0))
    ledger, _ = run_from(scene, particles)
    assert ledger.tally[COLLISIONS] > 1_000_000
    assert kinetic_energy(particles) == pytest.approx(energy, rel=1e-10)
    assert np.linalg.norm(momentum(particles) - start) <= 1e-10 * impetus
    shares = np.sum(particles.velocity**2, axis=1) / np.sum(particles.velocity**2)
    # Equipartition over the axes: 2/(3N)^½ ½ relative spread of each share of 1/3
    assert np.all(np.abs(shares - 1.0 / 3.0) <= 4.0 * math.sqrt(2.0 / 150.0) / 3.0)
