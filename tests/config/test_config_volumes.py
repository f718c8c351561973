"""Control volumes of the final estimate: what a file may ask for, and the scene in each."""

import numpy as np
import pytest
from campaign_text import campaign
from path_campaigns import COLD, COLD_VARIABLES, campaign_of
from plain_python import PLAIN_ALONE

from agglom_mpi.config.yaml_source import CampaignError
from agglom_mpi.variables import volume_fraction
from agglom_mpi.verbs.simulate import random_numbers, simulate

LENGTHS = [
    ("half_width", {**COLD, "half_width": None}, "[5 mm, 2 cm, log]"),
    ("grain_diameter", {**COLD, "half_width": None}, "[50 um, 200 um]"),
    ("sizes.spread", {**COLD, "sizes": "{law: lognormal}"}, "[1.1, 1.4]"),
]
"""Path of a length or of the sizes, a scene that leaves it to the strings, and its range."""


def final(text):
    return campaign(("title", f"final: {{{text}}}"))


def test_volumes_are_read_in_ascending_order_and_are_no_part_of_the_identity():
    assert final("volumes: [4, 1, 2e0]").final.volumes == (1, 2, 4)
    assert final("volumes: [4, 1, 2]").final.larger == (2, 4)
    assert campaign().final.volumes == (1,)
    assert final("volumes: [1, 2, 4]").sha256() == campaign().sha256()


@pytest.mark.parametrize(
    "text",
    [
        *("[]", "[2, 4]", "[1, 2, 2]", "[1, 1.5]", "[1, .inf]", "[1, .nan]", "[1, true]"),
        *("[1, '2']", "[1, 0]", "[1, -2]", "[1, 1001]", "[1, 2, 3, 4, 5, 6, 7, 8, 9]", "2", "none"),
    ],
)
def test_a_mistake_names_the_line_the_field_the_value_and_what_is_allowed(text):
    with pytest.raises(CampaignError) as caught:
        final(f"volumes: {text}")
    assert "campaign.yaml:1: final.volumes: is " in str(caught.value)
    assert "at most 8 different whole numbers from 1 to 1000" in str(caught.value)


def test_a_volume_with_too_many_grains_is_refused():
    many = ("  particles: 100", "  particles: 100000")
    with pytest.raises(CampaignError) as caught:
        campaign(("title", "final: {volumes: [1, 200]}"), many)
    assert "final.volumes: has 200" in str(caught.value)
    assert "at most 100" in str(caught.value)
    assert campaign(("title", "final: {volumes: [1, 100]}"), many).final.larger == (100,)


def test_the_description_says_how_many_grains_each_volume_has():
    assert "200, 400 grains" in final("volumes: [1, 2, 4]").describe()


def same_grains(own, larger, volume):
    """Compare the scenes of a string in two volumes as kernels see them."""
    assert larger.particles == volume * own.particles
    assert larger.half_width == pytest.approx(volume ** (1 / 3) * own.half_width, rel=1e-14)
    assert larger.radius == pytest.approx(own.radius, rel=1e-14)
    assert larger.mass == pytest.approx(own.mass, rel=1e-13)
    assert larger.end_time == pytest.approx(own.end_time, rel=1e-12)
    for scene in (own, larger):
        ratio = scene.radius / (scene.half_width / scene.particles ** (1 / 3))
        assert volume_fraction(ratio) == pytest.approx(
            volume_fraction(own.radius / (own.half_width / own.particles ** (1 / 3))), rel=1e-12
        )


@pytest.mark.parametrize("volume", [2, 3, 1000])
def test_grains_and_volume_fraction_stay_the_same(volume):
    own = campaign()
    string = own.parameters({"size_ratio": 0.7})
    same_grains(own.at(string).build(), own.in_volume(volume).at(string).build(), volume)


@pytest.mark.parametrize(("path", "scene", "ends"), LENGTHS)
def test_they_do_where_the_string_gives_a_length_or_the_sizes(path, scene, ends):
    own = campaign_of(scene, {**COLD_VARIABLES, path: ends})
    for fill in ("lower", "centre", "upper"):
        string = own.parameters({}, fill)
        same_grains(own.at(string).build(), own.in_volume(4).at(string).build(), 4)


def test_the_objective_keeps_the_campaigns_own_number_of_grains():
    own = campaign(("objective", "objective: maximum_growth"))
    string = own.parameters()
    for volume in (1, 2, 8):
        larger = own.in_volume(volume)
        assert larger.objective_at(string).deviation(1.0) == own.objective.deviation(1.0)


@pytest.mark.parametrize("common", ["false", "true"])
def test_each_volume_has_random_numbers_of_its_own(common):
    own = campaign(("ensemble", f"ensemble:\n  common_configurations: {common}"))
    string = own.parameters()
    drawn = {
        random_numbers(own.in_volume(volume), string, sample).random()
        for volume in (1, 2, 4)
        for sample in (0, 1)
    }
    assert len(drawn) == 6
    again = random_numbers(own.in_volume(2), string, 1).random()
    assert again in drawn


def test_a_larger_volume_has_the_text_and_the_identity_of_the_campaign():
    own = campaign()
    assert own.in_volume(4).identity() == own.identity()
    assert own.in_volume(1).at(own.parameters()).section is own.scene
    with pytest.raises(CampaignError):
        own.in_volume(0)


@PLAIN_ALONE
def test_a_sample_of_a_larger_volume_starts_with_as_many_times_the_grains():
    own = campaign(("  end_time", "  end_time: 1e-9 s"))
    outcome = simulate(own.in_volume(3), own.parameters())
    assert outcome.particles == 3 * simulate(own, own.parameters()).particles
    assert np.allclose(outcome.radii, 1.0)
