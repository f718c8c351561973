"""The event engine against kinetic theory: collision rates, Haff's law; and backwards in time."""

import math

import kinetic_theory as theory
import numpy as np
import pytest
from event_runs import bouncing, recorded, same_place, size_ratio
from scenes import HALF, kinetic_energy, place_spheres, state

from agglom_mpi.physics.kinetic_theory import contact_value

SLOW = pytest.mark.slow
NUMBER = 1000
VOLUME = (2.0 * HALF) ** 3


def gas(scene, seed):
    """Spheres at random places, Maxwellian at zero momentum with Θ = 1 at unit mass."""
    generator = np.random.default_rng(seed)
    position = np.empty((3, NUMBER))
    assert place_spheres(generator, scene.escape, position, 2.0 * scene.radius, HALF)
    return state(scene, position.T, theory.maxwellian(np.ones(NUMBER), 1.0, generator))


def elastic(fraction, end_time=1e9):
    return bouncing(
        1.0, budget=10**7, particles=NUMBER, size_ratio=size_ratio(fraction), end_time=end_time
    )


def expected_rate(scene):
    return theory.finite_rate(NUMBER, VOLUME, 2.0 * scene.radius, 1.0, 1.0)


def virial_correction(fraction):
    """What the virial coefficients of hard spheres add to Carnahan and Starling's χ.

    4φχ = Σ (n² + 3n)φⁿ in their formula. The coefficients of φ³ to φ⁷ are known better
    (Clisby & McCoy, J. Stat. Phys. 122, 15, 2006).
    """
    exact = {4: 18.3648, 5: 28.2245, 6: 39.815, 7: 53.34, 8: 68.54}
    excess = 0.0
    for order, value in exact.items():
        n = order - 1
        excess += (value - (n**2 + 3 * n)) * fraction**n
    return 1.0 + excess / (4.0 * fraction * contact_value(fraction))


@pytest.mark.parametrize(
    "fraction", [pytest.param(0.03, marks=SLOW), 0.2, pytest.param(0.27, marks=SLOW)]
)
def test_a_gas_in_equilibrium_collides_at_enskogs_rate(fraction):
    """Half a million collisions scatter by 0.14 %, as counts of independent ones do; eight runs.

    Carnahan and Starling are 0.2 and 0.3 % below the virial series at φ = 0.2 and 0.27.
    """
    scene, collisions = elastic(fraction), 500 * NUMBER
    measured = np.mean([rate_in_equilibrium(scene, seed, collisions) for seed in range(1, 9)])
    expected = expected_rate(scene)
    assert measured == pytest.approx(expected, rel=5e-3)
    assert measured == pytest.approx(
        expected * virial_correction(fraction), rel=4.0 / math.sqrt(8 * collisions)
    )


def rate_in_equilibrium(scene, seed, collisions):
    """Collisions of a sphere per s."""
    particles = gas(scene, seed)
    # Twenty collisions per sphere, since random sequential places are not those of a gas.
    recorded(scene, particles, 20 * NUMBER // 2)
    run = recorded(scene, particles, collisions)
    assert len(run.times) == collisions
    assert run.per_axis[0] >= 4
    assert run.oversize == (0, 0)
    # Energy drifts by roundings of 2^-53 per collision, at random.
    energy = kinetic_energy(particles) / particles.mass[0]
    rounding = 10.0 * math.sqrt(collisions) * 2.0**-53
    assert energy == pytest.approx(1.5 * (NUMBER - 1), rel=rounding)
    return 2.0 * collisions / NUMBER / run.time


def test_an_inelastic_gas_cools_by_haffs_law():
    """Forty collisions per sphere cool the gas twelvefold; eight runs scatter by 2 % each."""
    e, seeds = 0.9, 8
    loss = 1.0 - e**2
    scene = elastic(0.03)
    rate = expected_rate(scene)
    end_time = 6.0 / loss / rate * math.expm1(40.0 * loss / 6.0)
    assert theory.haff_collisions(end_time, e, rate) == pytest.approx(40.0)
    cooling = bouncing(
        e, budget=10**4, particles=NUMBER, size_ratio=size_ratio(0.03), end_time=end_time
    )
    temperatures, collisions = [], []
    for seed in range(seeds):
        particles = gas(scene, seed)
        recorded(scene, particles, 3 * NUMBER)
        run = recorded(cooling, particles)
        assert run.time == end_time
        temperatures.append(theory.free_temperature(particles.velocity.T, 1.0))
        collisions.append(2.0 * len(run.times) / NUMBER)
    expected = theory.haff_temperature(end_time, 1.0, e, rate)
    assert expected == pytest.approx(math.exp(-40.0 * loss / 3.0))
    assert np.mean(temperatures) == pytest.approx(expected, rel=0.02)
    assert np.mean(collisions) == pytest.approx(40.0, rel=0.02)
    # The first correction to Gaussian velocities is far below the scatter.
    assert abs(1.0 - theory.haff_correction(e)) * 40.0 * loss / 3.0 < 0.01
    assert np.std(temperatures, ddof=1) / expected < 0.04


def test_time_reversed_an_elastic_gas_finds_its_way_back():
    """Roundings of 1e-16 grow tenfold to a hundredfold per collision of a sphere."""
    scene = elastic(0.03)
    particles = gas(scene, 4)
    start, velocity = particles.position.copy(), particles.velocity.copy()
    there = recorded(scene, particles, 5 * NUMBER // 4)
    # 2.5 collisions per sphere, and on to half of the flight to the next
    particles.velocity[:] *= -1.0
    back = recorded(scene._replace(end_time=there.time), particles)
    np.testing.assert_array_equal(back.pairs[-len(there.pairs) + 1 :], there.pairs[-2::-1])
    assert same_place(particles.position - start, 1e-6 * 2.0 * HALF)
    np.testing.assert_allclose(particles.velocity, -velocity, atol=1e-5)
