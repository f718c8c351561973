"""The scene of a string has the numbers that the string gives, and nothing else of it changes."""

import math
import pickle

import numpy as np
import pytest
from path_campaigns import COLD, COLD_VARIABLES, HOT, HOT_VARIABLES, campaign_of

from agglom_mpi.config.describe import as_dict
from agglom_mpi.variables import TEN, volume_fraction
from agglom_mpi.verbs.estimate import estimate
from agglom_mpi.verbs.simulate import random_numbers, simulate

CASES = {
    "restitution.value": (COLD, COLD_VARIABLES, "[0.2, 0.9]", 0.45, {}),
    "restitution.contact_time": (COLD, COLD_VARIABLES, "[1 us, 5 us]", 2e-6, {}),
    "velocities.transverse": (COLD, COLD_VARIABLES, "[0.5, 1.5]", 0.75, {}),
    "velocities.mean.1": (COLD, COLD_VARIABLES, "[1, 3]", 2.5, {}),
    "end_time": (COLD, COLD_VARIABLES, "[1 ms, 3 ms]", 1.5e-3, {}),
    "half_width": (COLD, COLD_VARIABLES, "[5 mm, 2 cm, log]", 8e-3, {}),
    "grain_diameter": (COLD, COLD_VARIABLES, "[50 um, 200 um]", 1.2e-4, {"half_width": None}),
    "grain_radius": (COLD, COLD_VARIABLES, "[50 um, 200 um]", 1.2e-4, {"half_width": None}),
    "sizes.spread": (COLD, COLD_VARIABLES, "[1.1, 1.4]", 1.3, {"sizes": "lognormal"}),
    "sizes.ratio": (COLD, COLD_VARIABLES, "[1.2, 2]", 1.7, {"sizes": "uniform"}),
    "duration.length_ratio": (HOT, HOT_VARIABLES, "[0.5, 2]", 0.8, {}),
    "contact_area.initial": (HOT, HOT_VARIABLES, "[0, 0.2]", 0.05, {}),
    "contact_area.final": (HOT, HOT_VARIABLES, "[0.5, 2]", 1.5, {}),
    "cooling.emissivity": (HOT, HOT_VARIABLES, "[0.1, 0.9]", 0.3, {}),
    "cooling.surroundings": (HOT, HOT_VARIABLES, "[200 K, 300 K]", 270.0, {}),
}
"""Path, scene and variables, range, value, and other lines of the scene."""


def with_entry(scene: dict, path: str, value: str | None) -> dict:
    """Return a scene with a number in it, or without it: `None`."""
    key, *rest = path.split(".")
    if not rest:
        return {**scene, key: value}
    numbers = {
        "restitution": {"law": "constant", "value": "0.7", "contact_time": "0"},
        "velocities": {"law": "spread", "mean": "[0, 0, 0]", "transverse": "1"},
        "sizes": {"law": scene.get("sizes")},
        "duration": {"law": "compression_recovery"},
        "contact_area": {},
        "cooling": {"law": "radiation", "emissivity": "0.5", "surroundings": "250 K"},
    }[key]
    if len(rest) == 2:
        places = ["0", "0", "0"]
        places[int(rest[1])] = "~" if value is None else value
        numbers |= {rest[0]: f"[{', '.join(places)}]"}
    elif value is None:
        numbers.pop(rest[0], None)
    else:
        numbers |= {rest[0]: value}
    entry = ", ".join(f"{name}: {number}" for name, number in numbers.items() if number)
    return {**scene, key: f"{{{entry}}}"}


SOME = ["restitution.value", "sizes.spread", "duration.length_ratio", "cooling.emissivity"]
SIMULATED = pytest.mark.parametrize("case", SOME, indirect=True, scope="module")
"""One of each part of the scene: what is built is the same for all of them."""


@pytest.fixture(params=CASES, scope="module")
def case(request):
    """Return path, value, a campaign that searches it, one that fixes it, and one in its scene."""
    path, (scene, variables, entry, value, more) = request.param, CASES[request.param]
    scene = scene | more
    without = with_entry(scene, path, None)
    searched = campaign_of(without, {**variables, path: entry}, common=True)
    fixed = campaign_of(without, {**variables, path: repr(value)})
    return path, value, searched, fixed, with_entry(scene, path, repr(value)), variables


def test_the_scene_of_a_string_is_that_with_the_number_in_it(case):
    path, value, searched, fixed, scene, variables = case
    own = campaign_of(scene, variables, common=True)
    string = searched.parameters({path: value, "relative_speed": 5.0})
    ten = own.parameters({"relative_speed": 5.0})
    assert np.array_equal(string[: TEN.count], ten, equal_nan=True)
    assert searched.at(string).build() == own.at(ten).build()
    assert fixed.at(fixed.parameters()).build() == own.at(own.parameters()).build()
    assert searched.at(searched.parameters()).build() != own.at(own.parameters()).build()


@SIMULATED
@pytest.mark.plain
def test_a_string_simulated_at_a_point_is_the_scene_with_that_number(case):
    """Strings share configurations, so that their random numbers are the same."""
    path, value, searched, _, scene, variables = case
    own = campaign_of(scene, variables, common=True)
    one = simulate(searched, {path: value}, 1)
    other = simulate(own, {}, 1)
    assert one.record == other.record
    assert np.array_equal(one.final.radii, other.final.radii)


@SIMULATED
@pytest.mark.plain
def test_a_number_that_variables_fix_gives_the_samples_of_the_scene_that_has_it(case):
    """Bit for bit, each string with random numbers of its own."""
    _, _, _, fixed, scene, variables = case
    own = campaign_of(scene, variables)
    for sample in range(3):
        one, other = simulate(fixed, {}, sample), simulate(own, {}, sample)
        assert one.record == other.record
        assert np.array_equal(one.final.radii, other.final.radii)


def test_the_campaign_itself_is_another_one_by_its_variables_alone(case):
    path, value, searched, fixed, scene, variables = case
    own = campaign_of(scene, variables).identity()
    entries = fixed.identity()
    assert f"scene.{path}" not in entries
    assert entries[f"variables.{path}.0"] == entries[f"variables.{path}.1"] == value
    other = {name for name in own.keys() ^ entries.keys() if path not in name}
    assert other <= {"scene.grain_diameter"}  # as which a radius is recorded
    assert all(own[name] == entries[name] for name in own.keys() & entries.keys())
    assert searched.identity()[f"variables.{path}.0"] < searched.identity()[f"variables.{path}.1"]


def test_the_description_does_not_show_the_middle_of_a_range_as_the_number(case):
    path, _, searched, _, _, _ = case
    found = as_dict(searched)
    assert any(line.split()[0] == path and ".." in line for line in found["variables"])
    key, *rest = path.split(".")
    law = [line for line in found["submodels"] if line.startswith(key)]
    assert not rest or not law or f"{rest[0]} as in variables" in law[0]


def test_random_numbers_depend_on_what_is_searched():
    """Strings that differ in a searched number of the scene have random numbers of their own."""
    scene = with_entry(COLD, "restitution.value", None)
    searched = campaign_of(scene, COLD_VARIABLES | {"restitution.value": "[0, 1]"})
    fixed = campaign_of(scene, COLD_VARIABLES | {"restitution.value": "0.5"})
    drawn = [
        random_numbers(campaign, campaign.parameters({"restitution.value": value}), 0).random()
        for campaign in (searched, fixed)
        for value in (0.5, 0.6)
    ]
    assert drawn[0] != drawn[1]
    assert drawn[2] == drawn[3]
    assert len({*drawn}) == 3


def test_a_volume_fraction_keeps_its_meaning_where_the_sizes_are_searched():
    """It is a variable of its own, and the size ratio follows by each string's third moment."""
    variables = COLD_VARIABLES | {
        "size_ratio": None,
        "volume_fraction": "[0.05, 0.2]",
        "sizes.spread": "[1.1, 1.5]",
    }
    campaign = campaign_of(COLD | {"sizes": "lognormal"}, variables)
    assert campaign.variables.searched == ("relative_speed", "sizes.spread", "volume_fraction")
    for spread in (1.1, 1.3, 1.5):
        string = campaign.parameters({"volume_fraction": 0.1, "sizes.spread": spread})
        section, values = campaign.at(string)
        cubes = math.exp(3.0 * math.log(spread) ** 2)
        assert section.third_moment == pytest.approx(cubes, rel=1e-14)
        assert volume_fraction(values["size_ratio"], cubes) == pytest.approx(0.1, rel=1e-14)
    assert math.isnan(string[TEN.index("size_ratio")])


def test_a_median_of_the_sizes_leaves_the_volume_fraction_a_size_ratio():
    scene = COLD | {"half_width": None, "sizes": "{law: lognormal, spread: 1.2}"}
    variables = COLD_VARIABLES | {
        "size_ratio": None,
        "volume_fraction": "0.1",
        "sizes.median": "[10 um, 30 um]",
    }
    campaign = campaign_of(scene, variables)
    assert campaign.variables.further_names == ("sizes.median",)
    assert campaign.variables.by_volume_fraction


@pytest.mark.plain
def test_the_objective_of_a_string_counts_its_own_grains():
    """b* of one aggregate is b⁰ (N ⟨b³⟩/⟨b⟩³)^⅓ [B 7.1] with the string's third moment."""
    campaign = campaign_of(
        COLD | {"sizes": "lognormal"}, COLD_VARIABLES | {"sizes.spread": "[1.1, 1.5]"}
    )
    text = campaign.text.replace("{law: growth_target, ratio: 1.5}", "maximum_growth")
    campaign = type(campaign).from_text(text)
    for spread in (1.1, 1.5):
        outcome = simulate(campaign, {"sizes.spread": spread})
        most = (30.0 * math.exp(3.0 * math.log(spread) ** 2)) ** (1.0 / 3.0)
        assert outcome.objective == pytest.approx(1.0 - outcome.mean_radius_ratio / most, rel=1e-12)
        found = estimate(campaign, {"sizes.spread": spread}, samples=1)
        assert found.objective.value == pytest.approx(outcome.objective, rel=1e-12)


def test_scenes_of_strings_are_kept_apart():
    campaign = campaign_of(
        with_entry(COLD, "restitution.value", None),
        COLD_VARIABLES | {"restitution.value": "[0, 1]"},
    )
    strings = [campaign.parameters({"restitution.value": e}) for e in (0.2, 0.8, 0.2)]
    assert [campaign.at(s).section.restitution.value for s in strings] == [0.2, 0.8, 0.2]
    again = pickle.loads(pickle.dumps(campaign))
    assert again.at(strings[1]).section.restitution.value == 0.8
    assert campaign.scene.restitution.value == 0.5


def test_a_law_that_refuses_its_numbers_together_is_named():
    scene = COLD | {"half_width": None, "sizes": "uniform"}
    sizes = {"sizes.smallest": "[10 um, 30 um]", "sizes.largest": "[40 um, 60 um]"}
    campaign = campaign_of(scene, COLD_VARIABLES | sizes)
    string = campaign.parameters({"sizes.smallest": 5e-5, "sizes.largest": 4e-5})
    with pytest.raises(ValueError, match=r"sizes\.largest"):
        campaign.at(string)
    [row] = campaign.scenes.rows(campaign.variables.columns_by_name(string[None]))
    assert row is None
