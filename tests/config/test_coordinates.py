import re
from pathlib import Path

import numpy as np
import pytest

from agglom_mpi.config.campaign import Campaign
from agglom_mpi.config.coordinates import coordinates_of, covered_by_groups, groups_of
from agglom_mpi.config.loading import load_campaign
from agglom_mpi.search.space import SearchSpace
from agglom_mpi.simulation.sample import simulate_scene
from agglom_mpi.variables import TEN


@pytest.fixture(scope="module")
def whole():
    return load_campaign("jobs/accretion_2003.yaml")


@pytest.fixture(scope="module")
def three():
    return load_campaign("jobs/doubling_in_three.yaml")


def strings(campaign, count=50):
    space = SearchSpace.of(campaign.variables)
    return space.from_unit(np.random.default_rng(1).random((count, space.dimensions)))


def test_laws_name_the_groups_of_the_paper(whole):
    found = {group.symbol: group.powers for group in groups_of(whole.scene, TEN.names)}
    assert set(found) == {"ρv²/H", "U/(Rθ)", "v²/(Cθ)", "κ/(ρbCθ)"}
    assert found["ρv²/H"] == {"density": 1, "relative_speed": 2, "hardness": -1}
    # The half-width is given, so the radius of a grain follows from the size ratio.
    assert found["κ/(ρbCθ)"]["size_ratio"] == -1


def test_a_group_in_which_one_variable_is_searched_is_that_variable(three):
    groups = groups_of(three.scene, three.variables.searched)
    assert [group.symbol for group in groups] == ["ρv²/H"]


@pytest.mark.parametrize("name", ["whole", "three"])
def test_coordinates_go_from_0_to_1(name, request):
    campaign = request.getfixturevalue(name)
    coordinates = coordinates_of(campaign)
    points = coordinates.of_strings(strings(campaign))
    assert points.shape == (50, coordinates.dimensions)
    assert points.min() >= 0.0
    assert points.max() <= 1.0


def test_ends_of_a_group_are_corners_of_the_box(three):
    coordinates = coordinates_of(three)
    softest = three.parameters({"relative_speed": 30, "hardness": "10 MPa"})
    hardest = three.parameters({"relative_speed": 0.1, "hardness": "200 MPa"})
    ends = coordinates.of_strings(np.array([softest, hardest]))[:, -1]
    assert ends == pytest.approx([1.0, 0.0])


@pytest.mark.parametrize("name", ["whole", "three"])
def test_strings_are_found_again_from_their_coordinates(name, request):
    campaign = request.getfixturevalue(name)
    coordinates, some = coordinates_of(campaign), strings(campaign)
    assert coordinates.strings(coordinates.own(some)) == pytest.approx(some, nan_ok=True)


def test_a_group_moves_along_its_variables_as_its_logarithm_does(three):
    coordinates = coordinates_of(three)
    [along] = coordinates.group_directions
    spans = {"relative_speed": np.log(300), "hardness": np.log(20), "friction": 2 * 0.49 / 0.51}
    expected = [2 * spans["relative_speed"], -spans["hardness"], 0.0]
    assert along == pytest.approx(expected)
    assert coordinates.spans == pytest.approx(list(spans.values()))


def test_a_variable_from_0_is_a_coordinate_by_itself(whole):
    coordinates = coordinates_of(whole)
    some = np.tile(whole.parameters(), (3, 1))
    some[:, TEN.names.index("reaction_heat")] = 0.0, 5e6, 1e7
    place = coordinates.names.index("reaction_heat")
    assert coordinates.of_strings(some)[:, place] == pytest.approx([0.0, 0.5, 1.0])
    assert np.isfinite(coordinates.of_strings(some)).all()


def covered(campaign):
    return covered_by_groups(campaign.scene, campaign.variables.searched, campaign.variables)


def changed(**scene):
    """The campaign of three variables with other entries of its scene."""
    text = Path("jobs/doubling_in_three.yaml").read_text()
    for key, value in scene.items():
        text, count = re.subn(rf"(?m)^  {key}: .*$", f"  {key}: {value}", text, count=1)
        assert count == 1
    return Campaign.from_text(text)


COLD = {"cooling": "none", "heating": "none", "reaction": "none", "hardness": "constant"}


def test_a_ratio_has_no_coordinate_for_what_matters_through_groups_alone(whole, three):
    # The speed is alone in v²/(Cθ), and the quartic cooling has a constant that no group states.
    assert covered(three) == {"hardness"}
    assert covered(whole) == {"hardness", "activation_energy"}
    coordinates = coordinates_of(three, of_ratios=True)
    assert [n for n, k in zip(coordinates.names, coordinates.kept, strict=True) if k] == [
        "relative_speed",
        "friction",
    ]
    points, all_points = (
        each.of_strings(strings(three)) for each in (coordinates, coordinates_of(three))
    )
    assert np.array_equal(points, all_points[:, [0, 2, 3]])


@pytest.mark.parametrize("name", ["whole", "three"])
def test_coordinates_of_a_ratio_tell_all_strings_apart(name, request):
    """No more is left out than other coordinates say: their logarithms have full rank."""
    campaign = request.getfixturevalue(name)
    coordinates = coordinates_of(campaign, of_ratios=True)
    own = np.eye(len(coordinates.searched))[coordinates.kept]
    directions = np.vstack((own, coordinates.group_directions))
    assert np.linalg.matrix_rank(directions) == len(coordinates.searched)


def test_laws_with_other_dimensions_keep_their_variables():
    radiating = changed(cooling="{law: radiation, emissivity: 0.5, surroundings: 300 K}")
    assert covered(radiating) == set()
    assert covered(changed(**COLD, end_time="10 ms")) == {"hardness"}


def test_lengths_stay_where_the_end_time_is_compared_with_a_flight():
    """Two strings with equal groups, one with larger grains, have other numbers of collisions."""
    text = """
scene: {particles: 30, velocities: uniform_x, restitution: pressure, hardness: constant,
  duration: {law: mean_speed, length_ratio: 1e-6}, contact_area: {initial: 0.01, final: 1},
  fragmentation: pair_energy, heating: none, end_time: END}
variables:
  relative_speed: [1, 10]
  volume_fraction: 0.05
  grain_diameter: [20 um, 80 um]
  density: 2500
  hardness: [10 MPa, 100 MPa]
  surface_energy: [1, 4]
objective: {law: growth_target, ratio: 2}
ensemble: {rule: fixed, samples: 2}
stopping: {generations: 1}
"""
    fixed = Campaign.from_text(text.replace("END", "1 ms"))
    assert "grain_diameter" not in covered(fixed)
    whole = Campaign.from_text(text.replace("END", "characteristic"))
    assert "grain_diameter" in covered(whole)


@pytest.mark.plain
def test_strings_with_equal_coordinates_of_a_ratio_grow_equally():
    """Without heat, speed and hardness are one group; factors of two change no bit."""
    cold = changed(**COLD)
    assert covered(cold) == {"relative_speed", "hardness"}
    slow = cold.parameters({"relative_speed": 4, "hardness": "20 MPa", "friction": 0.3})
    fast = cold.parameters({"relative_speed": 8, "hardness": "80 MPa", "friction": 0.3})
    points = coordinates_of(cold, of_ratios=True).of_strings(np.array([slow, fast]))
    assert points[0] == pytest.approx(points[1])
    growth = [
        simulate_scene(cold.scene.build(string), np.random.default_rng(1))[0]["mean_radius_ratio"]
        for string in (slow, fast)
    ]
    assert growth[0] == growth[1] > 1.0
