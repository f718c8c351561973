"""Scales of a scene: the speeds that it starts with, and the collisions that Enskog expects."""

import math

import numpy as np
import pytest

from agglom_mpi.config.campaign import Campaign
from agglom_mpi.config.loading import load_campaign
from agglom_mpi.physics import scales
from agglom_mpi.physics.kinetic_theory import contact_value
from agglom_mpi.physics.velocities import draw_velocities
from agglom_mpi.variables import TEN
from agglom_mpi.verbs.simulate import simulate

SPREAD = "{law: spread, mean: [10, 0, 3], transverse: 0.4}"


def elastic(law, end_time="1 s"):
    return Campaign.from_text(f"""
scene:
  particles: 100
  half_width: 1 cm
  velocities: {law}
  restitution: {{law: constant, value: 1}}
  friction: none
  heating: none
  end_time: {end_time}
variables: {{relative_speed: 5, size_ratio: 0.6, density: 2500}}
""")


def at(campaign, **values):
    return TEN.values_by_name(campaign.parameters(values))


@pytest.mark.parametrize("law", ["uniform_x", SPREAD])
def test_the_speed_variance_is_that_of_the_drawn_velocities(law):
    campaign = elastic(law)
    value = at(campaign, relative_speed=5)
    velocity = np.empty((3, 100_000))
    draw_velocities(campaign.scene.velocities.build(value), np.random.default_rng(1), velocity)
    squares = np.sum((velocity.T - velocity.mean(axis=1)) ** 2, axis=1)
    error = np.std(squares) / math.sqrt(len(squares))
    assert abs(squares.mean() - scales.speed_variance(campaign.scene, value)) < 4.0 * error


def test_the_rate_of_collisions_is_that_of_the_mean_relative_speed():
    # Per grain n χ π σ² ⟨g⟩, and a Maxwellian has ⟨g⟩² = 16/(3π) of the variance of a grain.
    campaign = elastic("uniform_x", "1 ms")
    value = at(campaign, relative_speed=6, size_ratio=0.6)
    number, volume = campaign.scene.particles, (2.0 * campaign.scene.half_width) ** 3
    diameter = 2.0 * scales.grain_radius(campaign.scene, value)
    fraction = number * math.pi / 6.0 * diameter**3 / volume
    relative = math.sqrt(16.0 / (3.0 * math.pi) * 6.0**2 / 12.0)
    swept = number / volume * contact_value(fraction) * math.pi * diameter**2 * relative
    assert scales.collision_rate(campaign.scene, value) == pytest.approx(swept, rel=1e-12)
    assert scales.expected_collisions(campaign.scene, value) == pytest.approx(1e-3 * swept)


@pytest.mark.slow
@pytest.mark.parametrize("ratio", [0.4, 0.6])
def test_elastic_grains_collide_as_often_as_expected(ratio):
    campaign = elastic("uniform_x")
    values = {"size_ratio": ratio, "relative_speed": 2}
    outcomes = [simulate(campaign, values, sample) for sample in range(100)]
    counts = np.array([2.0 * outcome.collisions / 100 for outcome in outcomes])
    error = np.std(counts) / math.sqrt(len(counts))
    # A grain has N - 1 partners, and some collisions pass before the velocities are Maxwellian.
    expected = scales.expected_collisions(campaign.scene, at(campaign, **values))
    assert abs(np.mean(counts) / expected - 0.99) < 0.005 + 4.0 * error / expected


def test_an_end_time_that_vanishes_is_refused():
    campaign = load_campaign("jobs/quickstart.yaml")
    value = TEN.values_by_name(campaign.variables.at(0.5))
    assert 0.0 < scales.end_time(campaign.scene, value) < math.inf
    with pytest.raises(ValueError, match="vanishes"):
        scales.end_time(campaign.scene, {**value, "activation_energy": 1e9})
