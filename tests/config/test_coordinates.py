import numpy as np
import pytest

from agglom_mpi.config.coordinates import coordinates_of, groups_of
from agglom_mpi.config.loading import load_campaign
from agglom_mpi.search.space import SearchSpace
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
