"""A law that is added is asked, and never taken for one of those that are there."""

import math
from typing import ClassVar

import pytest

from agglom_mpi import load_campaign
from agglom_mpi.accuracy.maps.law_references import grain_of, linear_limit
from agglom_mpi.config.describe import missing_fields
from agglom_mpi.physics import scales
from agglom_mpi.physics.contact import CompressionRecoveryDuration, Duration
from agglom_mpi.physics.cooling import Cooling, EulerCooling, ExactCooling
from agglom_mpi.physics.hardness import ConstantHardness, Hardness
from agglom_mpi.physics.velocities import Velocities
from agglom_mpi.variables import TEN

FACTOR = 9.0
JOB = "jobs/accretion_2003.yaml"


class HarderHardness(Hardness):
    """H = 9 H₀, without a file that names it."""

    in_files: ClassVar[bool] = False

    def exponent(self, value):
        """ln 9."""
        return math.log(FACTOR)


class WideVelocities(Velocities):
    """Velocities with a variance of 9 v⁰²."""

    in_files: ClassVar[bool] = False

    def variance(self, speed):
        """9 v⁰²."""
        return FACTOR * speed**2


class SquareDuration(Duration):
    """The duration of [B] with a length of one radius, without its closed form."""

    in_files: ClassVar[bool] = False

    def force_scale(self, pair):
        """m*w²/(2b)."""
        return pair.reduced_mass * pair.approach_speed**2 / (2.0 * pair.radius)


class NewtonianCooling(Cooling):
    """θ' = −(θ − 300 K)/(2 s), which has no Euler steps."""

    in_files: ClassVar[bool] = False

    def rest_temperature(self):
        """300 K."""
        return 300.0

    def rate_slope(self, temperature, surface, capacity):
        """1/(2 s)."""
        return 0.5


@pytest.fixture(scope="module")
def campaign():
    return load_campaign(JOB)


@pytest.fixture(scope="module")
def value(campaign):
    return TEN.values_by_name(campaign.parameters())


def with_law(campaign, **laws):
    return campaign.scene.model_copy(update=laws)


def test_the_end_time_and_the_bonding_speed_follow_a_hardness_law_that_is_added(campaign, value):
    softer = with_law(campaign, hardness=ConstantHardness())
    harder = with_law(campaign, hardness=HarderHardness())
    ratio = scales.critical_speed(harder, value) / scales.critical_speed(softer, value)
    assert ratio == pytest.approx(math.sqrt(FACTOR), rel=1e-14)
    ratio = scales.end_time(softer, value) / scales.end_time(harder, value)
    assert ratio == pytest.approx(math.sqrt(FACTOR), rel=1e-14)


def test_the_collision_rate_follows_velocities_that_are_added(campaign, value):
    wide = with_law(campaign, velocities=WideVelocities())
    ratio = scales.collision_rate(wide, value) / scales.collision_rate(campaign.scene, value)
    own = campaign.scene.velocities.variance(value["relative_speed"])
    expected = math.sqrt(FACTOR * value["relative_speed"] ** 2 / own)
    assert ratio == pytest.approx(expected, rel=1e-13)


@pytest.mark.parametrize("hardness", [1e3, 1e11])
@pytest.mark.parametrize("density", [20.0, 2e4])
def test_the_bonding_speed_without_a_closed_form_is_that_with_one(density, hardness):
    closed = CompressionRecoveryDuration(length_ratio=1.0)
    found = SquareDuration().bonding_speed(0.7, hardness, density)
    assert found == pytest.approx(closed.bonding_speed(0.7, hardness, density), rel=1e-12)


def test_a_cooling_law_without_euler_steps_is_exact_with_every_engine(campaign, value):
    law = NewtonianCooling()
    assert type(law.integrated(value, has_steps=True)) is ExactCooling
    assert type(law.integrated(value, has_steps=False)) is ExactCooling
    assert law.stepped() is law
    stepped = campaign.scene.cooling.stepped()
    assert stepped.is_absent or type(stepped.integrated(value, has_steps=True)) is EulerCooling
    assert "time of last cooling" not in missing_fields(with_law(campaign, cooling=law))


def test_the_study_of_cooling_asks_a_law_for_its_rest_and_its_longest_step(campaign):
    scene = with_law(campaign, cooling=NewtonianCooling()).build(campaign.parameters())
    grain = grain_of(scene)
    assert grain.rest == 300.0
    assert linear_limit(grain, 400.0) == 2.0
