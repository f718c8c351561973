"""Numbers of the scene under `variables`: how they are read, and what is said of wrong ones."""

import math

import numpy as np
import pytest
from path_campaigns import COLD, COLD_VARIABLES, HOT, HOT_VARIABLES, campaign_of, text_of

from agglom_mpi.config.campaign import Campaign
from agglom_mpi.config.yaml_source import CampaignError
from agglom_mpi.variables import TEN
from agglom_mpi.verbs.simulate import simulate

FREE = COLD | {"restitution": "constant"}
"""A scene without its restitution."""


def problems(scene: dict, variables: dict, more: str = "") -> list[tuple[str, str]]:
    """Return field and line of each problem of a campaign, the line as it is written."""
    text = text_of(scene, variables, more=more)
    with pytest.raises(CampaignError) as found:
        Campaign.from_text(text)
    lines = text.splitlines()
    return [(each.field, lines[(each.line or 1) - 1].strip()) for each in found.value.problems]


def message(scene: dict, variables: dict, more: str = "") -> str:
    with pytest.raises(CampaignError) as found:
        campaign_of(scene, variables, more=more)
    return str(found.value)


def test_strings_have_the_ten_first_and_then_paths_by_name():
    variables = COLD_VARIABLES | {"restitution.value": "[0.2, 0.8]", "end_time": "[1 ms, 2 ms]"}
    campaign = campaign_of(FREE | {"end_time": None}, variables)
    table = campaign.variables
    assert table.names == (*TEN.names, "end_time", "restitution.value")
    assert campaign.variables.searched == ("relative_speed", "end_time", "restitution.value")
    assert campaign.parameters()[-2:] == pytest.approx([1.5e-3, 0.5])
    assert [table[name].unit for name in table.further_names] == ["s", "1"]
    other = dict(reversed(variables.items()))
    assert campaign_of(FREE | {"end_time": None}, other).identity() == campaign.identity()


def test_a_range_by_its_logarithm_has_its_geometric_mean_in_the_scene():
    variables = COLD_VARIABLES | {"end_time": "[1 us, 1 ms, log]", "restitution.value": "0.5"}
    campaign = campaign_of(FREE | {"end_time": None}, variables)
    assert campaign.scene.end_time == pytest.approx(math.sqrt(1e-9), rel=1e-12)
    assert campaign.variables.logarithmic[campaign.variables.index("end_time")]
    assert campaign.identity()["variables.end_time.2"] == "log"


@pytest.mark.parametrize(
    ("path", "entry"),
    [
        ("restitution.value", "[0.5, 1.5]"),
        ("restitution.value", "-0.1"),
        ("restitution.value", "[0.5, 0.4]"),
        ("restitution.value", "0.5 kg"),
        ("restitution.value", "[0.1, 0.2, cubic]"),
        ("restitution.value", "{from: 0.1, to: 0.2}"),
        ("restitution.value", "constant"),
        ("end_time", "characteristic"),
        ("end_time", "-1 ms"),
        ("end_time", "[1, 2 ms]"),
        ("restitution.law", "[constant, pressure]"),
        ("restitution.valu", "0.5"),
        ("restitution", "0.5"),
        ("particles", "[10, 100]"),
        ("engine.budget", "[10, 100]"),
        ("solver.tolerance", "[1e-9, 1e-6]"),
        ("velocities.mean", "[0, 1]"),
        ("velocities.mean.7", "[0, 1]"),
        ("cooling.emissivity", "[0, 1]"),
        ("sizes.spread", "[1.1, 1.2]"),
        ("contact_area.final", "[0.1, 1]"),  # on which nothing depends
        ("duration.length_ratio", "[0.1, 1]"),
    ],
)
def test_a_mistake_is_reported_at_its_own_line(path, entry):
    scene = FREE | ({"end_time": None} if path == "end_time" else {})
    variables = COLD_VARIABLES | {"restitution.value": "0.5", path: entry}
    assert problems(scene, variables) == [(f"variables.{path}", f"{path}: {entry}")]


def test_all_mistakes_are_reported_at_once():
    variables = COLD_VARIABLES | {"restitution.value": "2", "end_time": "0 s", "sizes.x": "1"}
    found = problems(FREE | {"end_time": None}, variables | {"density": "-1"})
    assert [field for field, _ in found] == [
        *("variables.density", "variables.restitution.value"),
        *("variables.end_time", "variables.sizes.x"),
    ]


def test_a_number_stands_in_one_place():
    variables = COLD_VARIABLES | {"restitution.value": "[0.2, 0.9]", "half_width": "[1 mm, 1 cm]"}
    more = "constraints: [restitution.value > 0.3]\n"
    found = problems(COLD, variables, more)
    assert [field for field, _ in found] == ["variables.restitution.value", "variables.half_width"]
    text = text_of(COLD, variables).splitlines()
    for name in ("restitution", "half_width"):
        line = next(i for i, each in enumerate(text, 1) if each.startswith(f"  {name}: "))
        assert f"line {line};" in message(COLD, variables)


def test_a_number_of_a_list_leaves_its_place_in_the_scene_empty():
    variables = COLD_VARIABLES | {"velocities.mean.2": "[1, 3]"}
    free = COLD | {"velocities": "{law: spread, mean: [1, 2, ~], transverse: 1}"}
    assert campaign_of(free, variables).scene.velocities.mean == (1.0, 2.0, 2.0)
    assert problems(COLD, variables)[0][0] == "variables.velocities.mean.2"
    short = COLD | {"velocities": "{law: spread, mean: [1, 2], transverse: 1}"}
    assert problems(short, variables)[0][0].startswith("scene.velocities.mean")


def test_lengths_stand_in_place_of_one_another():
    found = problems(COLD, COLD_VARIABLES | {"grain_diameter": "[10 um, 20 um]"})
    assert found == [("variables.grain_diameter", "grain_diameter: [10 um, 20 um]")]
    both = COLD_VARIABLES | {"grain_diameter": "[10 um, 20 um]", "grain_radius": "5 um"}
    [(field, _)] = problems(COLD | {"half_width": None}, both)
    assert field == "variables.grain_radius"


@pytest.mark.parametrize(
    ("smallest", "largest", "wrong"),
    [
        ("[10 um, 30 um]", "[40 um, 60 um]", None),
        ("[10 um, 30 um]", "[20 um, 60 um]", "sizes.largest"),
        ("[10 um, 45 um]", "[40 um, 60 um]", None),  # each end fits the middle of the other
        ("[1 um, 30 um]", "45 um", "sizes.smallest"),  # more than ten times
        ("30 um", "[20 um, 60 um]", "sizes.largest"),
    ],
)
def test_the_ends_of_ranges_fit_together(smallest, largest, wrong):
    scene = COLD | {"half_width": None, "sizes": "uniform"}
    variables = COLD_VARIABLES | {"sizes.smallest": smallest, "sizes.largest": largest}
    if wrong is None:
        assert campaign_of(scene, variables).variables.of_scene
    else:
        assert [field for field, _ in problems(scene, variables)] == [f"variables.{wrong}"]


def test_ends_of_a_law_that_do_not_fit_together_are_warned_of():
    """Samples of strings there fail; a constraint excludes them."""
    scene = COLD | {"half_width": None, "sizes": "uniform"}
    ranges = {"sizes.smallest": "[10 um, 45 um]", "sizes.largest": "[40 um, 60 um]"}
    found = campaign_of(scene, COLD_VARIABLES | ranges).warnings()
    [field] = [each.field for each in found if "4.5e-05" in each.message]
    assert field == "variables.sizes.largest"
    more = "constraints: [sizes.largest > 1.2 * sizes.smallest]\n"
    campaign = campaign_of(scene, COLD_VARIABLES | ranges, more=more)
    assert not [each for each in campaign.warnings() if "4.5e-05" in each.message]


def test_a_number_that_takes_no_part_is_not_blamed():
    """The first number by name is restitution.value, which fits all sizes."""
    scene = COLD | {"half_width": None, "sizes": "uniform", "restitution": "constant"}
    other = COLD_VARIABLES | {"restitution.value": "[0.5, 0.9]"}
    [(field, _)] = problems(
        scene, other | {"sizes.smallest": "[1 um, 30 um]", "sizes.largest": "45 um"}
    )
    assert field == "variables.sizes.smallest"
    # Each end fits the middle of the other, and both lower ends together do not.
    together = {"sizes.smallest": "[2 um, 10 um]", "sizes.largest": "[25 um, 60 um]"}
    [(field, _)] = problems(scene, other | {key: together[key] for key in together})
    assert field.startswith("variables.sizes.")


def test_a_constraint_may_exclude_what_does_not_fit():
    scene = COLD | {"half_width": None, "sizes": "uniform"}
    variables = COLD_VARIABLES | {
        "sizes.smallest": "30 um",
        "sizes.largest": "[20 um, 60 um]",
    }
    more = "constraints: [sizes.largest > 1.2 * sizes.smallest]\n"
    campaign = campaign_of(scene, variables, more=more)
    strings = campaign.space().sample(np.random.default_rng(0))
    assert strings[campaign.variables.index("sizes.largest")] > 36e-6


def test_sizes_that_jam_at_an_end_are_refused():
    variables = COLD_VARIABLES | {"size_ratio": "0.8", "sizes.spread": "[1.05, 1.5]"}
    found = problems(COLD | {"sizes": "lognormal"}, variables)
    assert found == [("variables.sizes.spread", "sizes.spread: [1.05, 1.5]")]


@pytest.mark.parametrize(("ratio", "fits"), [(3.5, True), (4.0, False)])
def test_a_target_is_in_reach_of_some_string(ratio, fits):
    """N^⅓ is 3.1; with sizes it is (N ⟨b³⟩/⟨b⟩³)^⅓, of the widest 3.66."""
    variables = COLD_VARIABLES | {"sizes.spread": "[1.05, 1.5]", "size_ratio": "0.5"}
    text = text_of(COLD | {"sizes": "lognormal"}, variables)
    text = text.replace("ratio: 1.5", f"ratio: {ratio}")
    if fits:
        assert Campaign.from_text(text).most_grains ** (1 / 3) == pytest.approx(3.6624, rel=1e-4)
        return
    with pytest.raises(CampaignError) as found:
        Campaign.from_text(text)
    assert [each.field for each in found.value.problems] == ["objective.ratio"]


@pytest.mark.parametrize("law", ["bouncing", "{law: bouncing}", "own.py:Bouncing"])
def test_a_law_that_is_unknown_is_the_only_mistake(law):
    variables = COLD_VARIABLES | {"restitution.value": "[0.2, 0.8]"}
    [(field, _)] = problems(COLD | {"restitution": law}, variables)
    assert field.startswith("scene.restitution")


def test_start_and_values_by_name_take_paths():
    variables = COLD_VARIABLES | {"restitution.value": "[0.2, 0.9]"}
    start = (
        "\n  start: [{restitution.value: 0.3}, {relative_speed: 3 m/s, restitution.value: 4e-1}]"
    )
    text = text_of(FREE, variables).replace(
        "search: {population: 8, parents: 4}", f"search:\n  population: 8\n  parents: 4{start}"
    )
    given = Campaign.from_text(text).given_strings()
    assert given[:, -1].tolist() == [0.3, 0.4]
    for wrong in ("restitution.value: 0.95", "restitution.valu: 0.3", "restitution.value: 1 m"):
        with pytest.raises(CampaignError) as found:
            Campaign.from_text(text.replace("restitution.value: 0.3", wrong))
        name = wrong.split(":")[0]
        assert [each.field for each in found.value.problems] == [f"search.start.0.{name}"]
    later = variables | {"end_time": "[1 ms, 2 ms]"}
    campaign = campaign_of(FREE | {"end_time": None}, later)
    assert campaign.parameters({"end_time": "250 us", "restitution.value": 0.25})[-2:].tolist() == (
        [2.5e-4, 0.25]
    )
    for wrong in ({"restitution.value": 1.5}, {"restitution.valu": 0.5}, {"end_time": "1 m"}):
        with pytest.raises(CampaignError):
            campaign.parameters(wrong)
    whole = campaign.parameters()
    whole[-1] = 1.5
    with pytest.raises(CampaignError, match=r"restitution\.value"):
        simulate(campaign, whole)
    with pytest.raises(CampaignError, match="12"):
        simulate(campaign, whole[:-1])


def test_expressions_name_paths():
    variables = HOT_VARIABLES | {"cooling.surroundings": "[200, 300]", "end_time": "[1e-3, 3e-3]"}
    scene = HOT | {"cooling": "{law: radiation, emissivity: 0.5}", "end_time": None}
    more = (
        "derived: {excess: temperature - cooling.surroundings, span: 2 * end_time / 3 s}\n"
        "constraints: [cooling.surroundings > 220 K, -10 K < excess, end_time <= 2.5 ms]\n"
    )
    campaign = campaign_of(scene, variables, more=more)
    values = {"cooling.surroundings": np.array([210.0, 250.0, 250.0]), "end_time": 2e-3}
    assert campaign.allowed(values).tolist() == [False, True, True]
    assert campaign.allowed({"end_time": [2.5e-3, 2.6e-3]}).tolist() == [True, False]
    strings = np.array([campaign.parameters({"cooling.surroundings": 250.0, "end_time": 1.5e-3})])
    derived = campaign.derived_values(strings)
    assert (derived["excess"][0], derived["span"][0]) == pytest.approx((100.0, 1e-3))
    assert [each.unit for each in campaign.relations.derived] == ["K", "1"]
    assert "(cooling.surroundings > 220.0)".strip("()") in campaign.relations.canonical()[0]


@pytest.mark.parametrize(
    "expression",
    [
        "restitution.value > 0.1",
        "cooling.surrounding > 220 K",
        "cooling.surroundings > 220 s",
        "cooling > 3",
        "cooling.surroundings.real > 220 K",
        "end_time.real > 1 s",
    ],
)
def test_expressions_name_no_other_paths(expression):
    variables = HOT_VARIABLES | {"cooling.surroundings": "[200, 300]"}
    scene = HOT | {"cooling": "{law: radiation, emissivity: 0.5}"}
    found = problems(scene, variables, f"constraints: ['{expression}']\n")
    assert [field for field, _ in found] == ["constraints.0"]


def test_groups_and_coordinates_know_the_size_of_the_grains():
    """A variable that the mean radius is proportional to has the power of the radius."""
    from agglom_mpi.config.coordinates import coordinates_of

    variables = HOT_VARIABLES | {"surface_energy": "[1e-3, 1]"}
    scene = HOT | {"fragmentation": "pair_energy"}
    groups = {g.symbol: g.powers for g in coordinates_of(campaign_of(scene, variables)).groups}
    [(symbol, powers)] = [(s, p) for s, p in groups.items() if "size_ratio" in p]
    free = scene | {"half_width": None}
    sized = campaign_of(free, variables | {"grain_diameter": "[1 mm, 2 mm]"})
    own = {g.symbol: g.powers for g in coordinates_of(sized).groups}[symbol]
    assert own["grain_diameter"] == powers["size_ratio"]
    assert "size_ratio" not in own
    strings = np.array([sized.variables.lower, sized.variables.upper])
    assert coordinates_of(sized).of_strings(strings).shape[1] == 3 + len(
        coordinates_of(sized).groups
    )


def warned(scene: dict, variables: dict) -> list[str]:
    """Return the fields that a campaign is warned of."""
    return [each.field for each in campaign_of(scene, variables).warnings()]


def test_what_is_unlikely_is_warned_of_where_all_ends_of_a_number_are_so():
    """Grains bond from √(6 H β/ρ) on, β the length ratio: 1.5 m/s where it is 1e-3."""
    slow = HOT_VARIABLES | {"relative_speed": "[0.1, 1]"}
    hard = warned(HOT, slow | {"duration.length_ratio": "[0.1, 1]"})
    assert "variables.duration.length_ratio" in hard
    soft = warned(HOT, slow | {"duration.length_ratio": "[1e-5, 1]"})
    assert "variables.duration.length_ratio" not in soft
    own = HOT | {"duration": "{law: compression_recovery, length_ratio: 1}"}
    assert "scene.duration.length_ratio" in warned(own, slow)


def test_a_target_without_bonding_is_warned_of_unless_some_string_bonds():
    never = warned(FREE, COLD_VARIABLES | {"restitution.value": "[0.2, 0.9]"})
    assert "objective.ratio" in never
    some = warned(FREE, COLD_VARIABLES | {"restitution.value": "[0, 0.9]"})
    assert "objective.ratio" not in some


def test_a_size_that_no_grains_have_is_warned_of_at_its_variable():
    scene = FREE | {"half_width": None}
    large = COLD_VARIABLES | {"restitution.value": "0.5", "grain_diameter": "[20 cm, 30 cm]"}
    assert "variables.grain_diameter" in warned(scene, large)
