"""Growth at imposed relative speeds: exact solutions, the barrier's exponent, bands, refusals."""

import math

import numpy as np
import pytest
from plain_python import PLAIN

from agglom_mpi.analysis import imposed_speeds
from agglom_mpi.analysis.collision_kernels import BlockSums, CollisionKernels
from agglom_mpi.analysis.imposed_speeds import imposed_growth, power_law
from agglom_mpi.config.campaign import Campaign
from agglom_mpi.errors import UserError
from agglom_mpi.simulation.collision_counts import ENERGY, HITS, MASS, NUMBER

NUMBER_OF_GRAINS = 1000.0
DENSITY, RADIUS, VOLUME = 2000.0, 0.5e-6, 1e-9
GRAIN = 4.0 / 3.0 * math.pi * DENSITY * RADIUS**3
ROUNDS = 8.0
"""Time in s in which a grain at 0.1 m/s meets some three others."""
SCENE = """\
scene:
  {particles: 1000, grain_radius: 0.5 um, heating: none, end_time: 1 ms, velocities: uniform_x,
   restitution: LAW, fragmentation: BREAKS}
variables: {relative_speed: 1, volume_fraction: 0.01, density: 2000, surface_energy: ENERGY}
"""
STICKS = "{law: constant, value: 0}"
DUST = "{law: adhesive, youngs_modulus: 54 GPa, dry: {law: constant, value: 0.9}}"


def counted(law, energy=0.1, breaks="none", bins=(3, 6), efficiency=1.3, spread=0.0):
    """Kernels of made-up counts: two masses, of which only the first has collided."""
    decades, per_decade = bins
    masses = GRAIN * 10.0 ** (np.arange(decades * per_decade + 1) / per_decade)
    count, blocks = len(masses), 4
    impacts, exposure = np.zeros((blocks, 1, count, count, 8)), np.zeros((blocks, 1, count, 3))
    start, pairs = np.zeros((blocks, count, 3)), np.zeros((blocks, 1, count, count))
    temperature = 1e-15
    exposure[..., 0, NUMBER] = start[:, 0, NUMBER] = NUMBER_OF_GRAINS
    exposure[..., 0, MASS] = start[:, 0, MASS] = NUMBER_OF_GRAINS * GRAIN
    exposure[..., 0, ENERGY] = 1.5 * temperature * NUMBER_OF_GRAINS
    pairs[..., 0, 0] = 0.5 * NUMBER_OF_GRAINS * (NUMBER_OF_GRAINS - 1.0)
    rate = 4.0 * math.pi * RADIUS**2 * math.sqrt(16.0 / math.pi * temperature / GRAIN)
    impacts[..., 0, 0, HITS] = efficiency * rate * pairs[..., 0, 0] / VOLUME
    impacts *= 1.0 + spread * np.linspace(-1.0, 1.0, blocks).reshape(-1, 1, 1, 1, 1)
    impacts *= 1e12  # times as many: enough collisions
    pairs *= 1e12
    sums = BlockSums(impacts, exposure, pairs, pairs, start, np.ones(blocks, np.int64))
    text = SCENE.replace("LAW", law).replace("BREAKS", breaks).replace("ENERGY", str(energy))
    if "adhesive" not in law and breaks == "none":
        text = text.replace(f", surface_energy: {energy}", "")
    campaign = Campaign.from_text(text)
    tests = campaign.impact_tests_at(campaign.parameters())
    times = np.array([0.0, 1.0])
    return CollisionKernels(sums, masses, times, VOLUME, DENSITY, GRAIN, 0, tests)


@PLAIN
def test_dust_that_always_sticks_grows_by_smoluchowskis_solution_of_a_constant_kernel():
    """Speeds that fall with the cross section give one rate K = 1.3 π(2r)²√(8/(3π)) Δv."""
    kernels = counted(STICKS)
    speed = 0.1

    def imposed(first, second):
        return speed * 4.0 / (np.cbrt(first / GRAIN) + np.cbrt(second / GRAIN)) ** 2

    rate = 1.3 * 4.0 * math.pi * RADIUS**2 * math.sqrt(8.0 / (3.0 * math.pi)) * speed
    rounds = 0.5 * rate * NUMBER_OF_GRAINS / VOLUME
    found = imposed_growth(kernels, imposed, 20.0 / rounds)
    assert found.efficiency == pytest.approx((1.3, 0.0), rel=1e-5, abs=1e-9)
    expected = 1.0 / (1.0 + rounds * found.times)
    for particles in found.particles:
        assert particles == pytest.approx(expected, rel=1e-4)
    # The fixed pivot widens the distribution by half of the square of a step of the grid.
    step = 10.0 ** (1.0 / 6.0) - 1.0
    assert found.mean_mass[1] == pytest.approx((1.0 + 2.0 * rounds * found.times) * GRAIN, rel=step)
    assert np.isnan(found.barrier)


@PLAIN
def test_the_band_of_growth_is_two_errors_of_the_counted_efficiency():
    kernels = counted(STICKS, spread=0.1)
    found = imposed_growth(kernels, power_law(kernels.grain_mass, 1.0, 0.0), 1e-2)
    error = kernels.efficiency.error[0, 0, 0] / 1.3
    assert 0.03 < error < 0.05
    slow, most, fast = 1.0 - found.particles[:, 0]
    assert most < 0.02  # so that almost all collisions are those of grains
    assert [slow / most, fast / most] == pytest.approx(
        [1.0 - 2.0 * error, 1.0 + 2.0 * error], abs=0.01
    )


@PLAIN
@pytest.mark.parametrize("exponent", [0.0, 0.5, 1.0])
def test_the_barrier_moves_with_the_surface_energy_as_theory_has_it(exponent):
    """Sticking speeds go as (γ/r)^(5/6), imposed ones as r^p: r ∝ γ^(5/6 / (5/6 + p))."""
    barriers = []
    for energy in (0.05, 0.2):
        kernels = counted(DUST, energy)
        speed = power_law(kernels.grain_mass, 0.1, exponent)
        barriers.append(imposed_growth(kernels, speed, 1e-9).barrier / GRAIN)
    found = math.log(barriers[1] / barriers[0]) / math.log(4.0) / 3.0
    assert found == pytest.approx(5.0 / 6.0 / (5.0 / 6.0 + exponent), rel=0.01)


@PLAIN
def test_beyond_the_barrier_sizes_grow_by_a_power_of_time():
    """From r' ∝ Δv (w/Δv)², w ∝ r^(−5/6) and Δv ∝ r^p: r ∝ t^(1/(8/3 + p))."""
    kernels = counted(DUST, 0.02)
    found = imposed_growth(kernels, power_law(kernels.grain_mass, 1.0, 0.5), 1e3)
    late = slice(-4, None)
    slope, _ = np.polyfit(np.log(found.times[late]), np.log(found.mean_mass[1, late]), 1)
    assert slope / 3.0 == pytest.approx(1.0 / (8.0 / 3.0 + 0.5), rel=0.02)
    assert np.all(np.diff(found.extrapolated) > -1e-12)
    assert found.extrapolated[-1] == pytest.approx(1.0)


@PLAIN
@pytest.mark.parametrize(
    ("kernels", "speed", "until"),
    [
        (counted(DUST, breaks="pair_energy"), 1.0, 1.0),
        (counted(STICKS, efficiency=0.0), 1.0, 1.0),
        (counted(STICKS), 1.0, 1e12),
    ],
    ids=["breaks", "no collisions", "endless"],
)
def test_growth_that_is_not_in_the_equations_is_one_message(kernels, speed, until):
    with pytest.raises(UserError) as error:
        imposed_growth(kernels, power_law(kernels.grain_mass, speed, 0.5), until)
    assert "\n" not in str(error.value)


@PLAIN
def test_growth_does_not_depend_on_the_first_length_of_the_grid(monkeypatch):
    """Rates that grow like the mass widen the distribution by decades."""
    kernels, found = counted(STICKS, bins=(1, 4)), []
    for margin in (10.0, 1e6):
        monkeypatch.setattr(imposed_speeds, "MARGIN", margin)
        found.append(imposed_growth(kernels, power_law(GRAIN, 0.1, 1.0), ROUNDS).mean_mass)
    assert found[0] == pytest.approx(found[1], rel=0.01)


@PLAIN
def test_particles_that_gel_are_one_message():
    """Rates that grow faster than the mass make one particle of all in a finite time."""
    with pytest.raises(UserError, match="must be less time"):
        imposed_growth(counted(STICKS, bins=(1, 4)), power_law(GRAIN, 0.1, 2.0), ROUNDS)


@PLAIN
def test_samples_may_have_more_bins_than_the_grid_beyond_them():
    kernels = counted(STICKS, bins=(3, 100))
    assert len(kernels.masses) > imposed_speeds.MOST_BINS
    found = imposed_growth(kernels, power_law(GRAIN, 0.1, 0.0), 1e-3)
    assert found.particles[:, -1] == pytest.approx(1.0, abs=0.01)
