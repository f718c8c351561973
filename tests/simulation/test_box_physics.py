"""What a box keeps, what it does not see, and Haff's cooling curve."""

import doctest
import math
from pathlib import Path

import kinetic_theory as theory
import numpy as np
import pytest
from box_runs import BOXES, BREAKING, GAS, make
from plain_python import PLAIN, PLAIN_ALONE, cases
from scenes import HALF, image

from agglom_mpi import Box
from agglom_mpi.config.campaign import Campaign
from agglom_mpi.coupling import box as example

ROUGH = GAS.text.replace(
    "  heating: none",
    "  friction: {law: rough, coefficient: 0.5, tangential: 0.5}\n  heating: none",
)
HEAT_CAPACITY = {"merging": 1280.0, "breaking": 500.0}


def energies(state, capacity):
    """Kinetic energy about the mean flow and thermal energy, both per volume."""
    kinetic = 1.5 * state.mass_density * state.granular_temperature
    return kinetic, state.mass_density * capacity * state.mean_temperature


@pytest.mark.parametrize(
    "name",
    [
        *cases(["merging, event", "merging, fixed"], [], PLAIN_ALONE),
        pytest.param("breaking, event", marks=PLAIN),
        pytest.param("breaking, adaptive", marks=pytest.mark.slow),
    ],
)
def test_mass_momentum_and_energy_are_kept_across_steps(name):
    capacity, step = HEAT_CAPACITY[name.split(",")[0]], BOXES[name][2] / 5
    box = make(name)
    start = box.state
    impetus = np.sum(box.particles.masses * np.linalg.norm(box.particles.velocities, axis=1))
    kinetic, thermal = energies(start, capacity)
    # A few thousand roundings of 1e-16 of what is there.
    few = 1e-13 * (kinetic + thermal)
    released = cooled = 0.0
    for _ in range(6):
        state = box.advance(step)
        released += state.heat_release_rate
        cooled += state.cooling_rate
        assert state.mass_density == pytest.approx(start.mass_density, rel=1e-13)
        change = (state.momentum_density - start.momentum_density) * box.volume
        assert np.linalg.norm(change) < 1e-12 * impetus
        lost = kinetic - state.dissipation_rate * step
        gain = state.dissipation_rate + state.heat_release_rate
        gain -= state.cooling_rate + state.surface_energy_rate
        warmed = thermal + gain * step
        kinetic, thermal = energies(state, capacity)
        assert kinetic == pytest.approx(lost, rel=1e-11)
        assert thermal == pytest.approx(warmed, rel=0, abs=few)
        assert state.capped_iterations == state.floored_temperatures == 0
    assert released > 0.0
    assert (cooled > 0.0) == name.startswith("breaking")
    if name.startswith("breaking"):
        assert box.particles.grains.sum() == BREAKING.scene.particles


@pytest.mark.plain
def test_the_state_is_that_of_the_particles():
    box = make("breaking, event")
    state, rows = box.advance(BOXES["breaking, event"][2]), box.particles
    mass = rows.masses.sum()
    flow = rows.masses @ rows.velocities / mass
    spread = np.sum(rows.masses[:, None] * (rows.velocities - flow) ** 2)
    assert state.particles == len(rows.radii) == len(set(rows.labels.tolist()))
    assert state.mean_radius == pytest.approx(rows.radii.mean(), rel=1e-13)
    assert state.radius_deviation == pytest.approx(rows.radii.std(), rel=1e-12)
    assert state.mass_density == pytest.approx(mass / 0.02**3, rel=1e-13)
    np.testing.assert_allclose(state.momentum_density, flow * mass / 0.02**3, rtol=1e-12)
    assert state.granular_temperature == pytest.approx(spread / (3.0 * mass), rel=1e-12)
    assert state.mean_temperature == pytest.approx(rows.masses @ rows.temperatures / mass)
    assert np.all(np.abs(rows.positions) <= HALF)


@pytest.mark.plain
def test_a_mean_flow_carries_the_box_along_and_changes_nothing_in_it():
    # A rounding of 1e-13, of the flow, grows by travel over radius, ten at most, in each of
    # about three hits.
    random, flow = np.random.default_rng(5), np.array([1000.0, -300.0, 7.0])
    velocities = random.normal(size=(200, 3))
    rest = Box(GAS, velocities=velocities)
    moving = Box(GAS, velocities=velocities + flow)
    for _ in range(3):
        here, there = rest.advance(2.0**-9), moving.advance(2.0**-9)
        assert here.collisions == there.collisions > 20
        assert there.granular_temperature == pytest.approx(here.granular_temperature, rel=1e-8)
        assert there.dissipation_rate == pytest.approx(here.dissipation_rate, rel=1e-8)
        difference = (there.momentum_density - here.momentum_density) / here.mass_density
        np.testing.assert_allclose(difference, flow, rtol=1e-11)
    relative = moving.particles.velocities - flow - rest.particles.velocities
    assert np.max(np.abs(relative)) < 1e-8
    away = moving.particles.positions - flow * rest.time - rest.particles.positions
    assert np.max(np.abs(image(away, True))) < 1e-8 * HALF


@pytest.mark.plain
def test_the_order_in_which_particles_are_given_does_not_matter():
    random = np.random.default_rng(6)
    radii = random.uniform(0.5e-3, 1e-3, 100)
    first = Box(GAS, radii=radii, temperatures=random.uniform(300, 400, 100))
    given, order = first.particles, random.permutation(100)
    second = Box(
        GAS,
        radii=radii[order],
        positions=given.positions[order],
        velocities=given.velocities[order],
        temperatures=given.temperatures[order],
    )
    ends = first.advance(2.0**-8), second.advance(2.0**-8)
    assert ends[0].collisions == ends[1].collisions > 0
    for field in ("mean_radius", "granular_temperature", "mean_temperature", "dissipation_rate"):
        assert getattr(ends[1], field) == pytest.approx(getattr(ends[0], field), rel=1e-9)
    here, there = first.particles, second.particles
    np.testing.assert_allclose(there.velocities, here.velocities[order], rtol=0, atol=1e-9)


def test_a_box_cools_by_haffs_law():
    """Ten collisions per sphere leave 30 % of the granular temperature.

    Corrections to Gaussian velocities and random sequential places are a percent at most.
    """
    e, boxes, count = 0.8, 16, 200
    random, random_start = np.random.default_rng(7), np.full(count, 1.0)
    diameter, volume = 2.0 * Box(GAS).particles.radii[0], (2.0 * HALF) ** 3
    rate = theory.finite_rate(count, volume, diameter, 1.0, 1.0)
    end = 6.0 / (1.0 - e**2) / rate * math.expm1(10.0 * (1.0 - e**2) / 6.0)
    times = np.linspace(0.0, end, 6)
    measured = np.empty((boxes, len(times)))
    for k in range(boxes):
        start = theory.maxwellian(random_start, 1.0, random)
        box = Box(GAS, velocities=start, sample=k)
        states = [box.state, *(box.advance(times[1]) for _ in times[1:])]
        measured[k] = [state.granular_temperature * count / (count - 1) for state in states]
    mean, error = measured.mean(axis=0), measured.std(axis=0, ddof=1) / math.sqrt(boxes)
    expected = np.array([theory.haff_temperature(time, 1.0, e, rate) for time in times])
    for row in zip(1e3 * times, mean, error, expected, strict=True):
        print("{:6.2f} ms   {:.4f} ± {:.4f}   Haff {:.4f}".format(*row))
    assert abs(1.0 - theory.haff_correction(e)) * 10.0 * (1.0 - e**2) / 3.0 < 0.004
    assert expected[-1] == pytest.approx(math.exp(-20.0 * (1.0 - e**2) / 6.0))
    assert error[-1] < 0.02 * expected[-1]
    assert np.all(np.abs(mean - expected) <= 4.0 * error + 0.01 * expected)


@pytest.mark.slow(guard="simulation/test_box_steps.py")
def test_the_examples_of_the_box_are_true(monkeypatch):
    monkeypatch.chdir(Path(__file__).parents[2])
    tried = doctest.testmod(example)
    assert tried.failed == 0
    assert tried.attempted > 15


@pytest.mark.plain
def test_spins_stay_where_velocities_are_set():
    box = Box(Campaign.from_text(ROUGH), particles=20)
    box.advance(0.05)
    spins = box._observer.copy.spin[:, :20].copy()
    assert np.abs(spins).max() > 0.0
    box.set(velocities=box.particles.velocities)
    assert np.array_equal(box._particles.spin[:, :20], spins)


def test_a_box_refuses_spins_at_the_start():
    spinning = ROUGH.replace("tangential: 0.5", "tangential: 0.5, spin_temperature: 1")
    with pytest.raises(ValueError, match=r"friction\.spin_temperature: is given; must be left out"):
        Box(Campaign.from_text(spinning))
