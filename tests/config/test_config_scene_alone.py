"""A scene with fixed variables needs no plan: it is checked and simulated, but not searched."""

import pytest
from campaign_text import TEXT, campaign, edited

from agglom_mpi.config.campaign import Campaign
from agglom_mpi.config.searchable import check_searchable
from agglom_mpi.config.yaml_source import CampaignError
from agglom_mpi.verbs.simulate import simulate

FIXED = (
    ("  relative_speed", "  relative_speed: 3"),
    ("  size_ratio", "  size_ratio: 0.6"),
    ("  hardness: [", "  hardness: 67 MPa"),
)
PLAN = ("objective", "search", "ensemble", "  rule", "  tolerance", "  max_samples", "stopping",
        "  generations", "  target")  # fmt: skip
ALONE = (*FIXED, *((line, "") for line in PLAN))


def message(*edits: tuple[str, str]) -> str:
    with pytest.raises(CampaignError) as caught:
        campaign(*edits)
    return str(caught.value)


def test_a_scene_alone_has_the_same_scene_and_values_as_in_a_campaign() -> None:
    alone, planned = campaign(*ALONE), campaign(*FIXED)
    assert alone.plan is None
    assert planned.plan is not None
    assert alone.scene == planned.scene
    assert alone.parameters().tobytes() == planned.parameters().tobytes()


def test_a_scene_alone_cannot_be_searched() -> None:
    alone = campaign(*ALONE)
    wanted = ("[lower, upper]", "objective", "ensemble", "stopping")
    for search in (
        lambda: check_searchable(alone),
        lambda: alone.with_generations(3),
        lambda: alone.max_strings,
        lambda: alone.search,
        lambda: alone.ensemble,
        lambda: alone.stopping,
    ):
        with pytest.raises(CampaignError) as caught:
            search()
        said = str(caught.value)
        assert said.startswith("campaign.yaml:16: variables: ")
        assert all(part in said for part in wanted)


def missing(*edits: tuple[str, str]) -> list[str]:
    """Sections that a message says are missing, each with the first line of the file."""
    lines = message(*edits).splitlines()
    assert all(line.startswith("campaign.yaml:1: ") and ": is missing" in line for line in lines)
    return [line.split(": ")[1] for line in lines]


def test_a_range_needs_the_whole_plan() -> None:
    assert missing(*ALONE[1:]) == ["objective", "ensemble", "stopping"]


def test_one_section_of_the_plan_needs_the_others() -> None:
    kept = ("  rule", "  tolerance", "  max_samples")
    given = [edit for edit in ALONE if edit[0] not in ("ensemble", *kept)]
    assert missing(*given) == ["objective", "stopping"]
    given = [*ALONE, ("seed", "search: {population: 8, parents: 2}")]
    assert missing(*given) == ["objective", "ensemble", "stopping"]


def test_an_empty_section_of_the_plan_is_none() -> None:
    assert campaign(*ALONE, ("seed", "ensemble:")).plan is None


def test_a_scene_alone_is_judged_by_its_growth_unless_it_says_otherwise() -> None:
    assert campaign(*ALONE).objective.law == "maximum_growth"
    given = [edit for edit in ALONE if edit[0] != "objective"]
    assert campaign(*given).plan is None
    assert campaign(*given).objective == campaign().objective
    assert message(*ALONE, ("title", "objective: {law: growth_target, ratio: 5}")) == (
        "campaign.yaml:1: objective.ratio: is 5; 100 grains in one give at most 4.642"
    )


def test_mistakes_of_a_scene_alone_are_not_followed_by_those_of_a_search() -> None:
    said = message(*ALONE, ("title", "titel: A test"))
    assert said.startswith("campaign.yaml:1: titel: unknown key 'titel'; did you mean 'title'?")
    assert len(said.splitlines()) == 1
    said = message(*ALONE, ("  density", "  density: -1"))
    assert said.startswith("campaign.yaml:19: variables.density: is -1")
    assert "0 kg/m^3" in said
    said = message(*ALONE, ("  density", ""))
    assert said.startswith("campaign.yaml:16: variables.density: is missing")
    with pytest.raises(CampaignError) as caught:
        Campaign.from_text(edited(*ALONE).partition("variables:")[0])
    assert str(caught.value).startswith("campaign.yaml:1: variables: is missing")


def test_the_identity_of_a_scene_alone_is_that_of_a_campaign_without_its_plan() -> None:
    plan = ("search", "ensemble", "stopping")
    planned = campaign(*FIXED).identity()
    alone = campaign(*(edit for edit in ALONE if edit[0] != "objective"))
    assert alone.identity() == {
        key: value for key, value in planned.items() if key.partition(".")[0] not in plan
    }
    assert campaign(*ALONE).sha256() != campaign(*FIXED).sha256()


def test_the_identity_of_a_campaign_is_what_it_was_before_scenes_stood_alone() -> None:
    """A running campaign is continued by its digest; this one was computed then."""
    digest = "01f795b36c25d0a3af7cc1e59e96a63a60fcf053aa4e096f649bdd16747384f8"
    assert campaign().sha256() == digest


def test_a_scene_alone_is_described_without_a_search() -> None:
    lines = campaign(*ALONE).describe().splitlines()
    assert lines[:5] == [
        "A test",
        "  seed: 7",
        "  objective: greatest growth, |1 - mean radius ratio / N^(1/3)| [B 7.1]",
        "  a scene: nothing is searched, `agglom simulate` runs it",
        "Scene",
    ]
    planned = campaign(*FIXED).describe().splitlines()
    assert planned.pop() == "  samples do not store: single particles, states before the end"
    assert lines[4:] == planned[planned.index("Scene") :]


GRAIN = "kg/m^3 has a mass that is not between 1e-100 and 1e+100 kg"


@pytest.mark.parametrize(
    ("edit", "expected"),
    [
        (
            ("  half_width", "  half_width: 1e-40"),
            f"a grain of radius 1.29e-41 m and density 6e+03 {GRAIN}",
        ),
        (("  half_width", "  half_width: 1e90"), f"radius 1.29e+89 m and density 6e+03 {GRAIN}"),
        (("  density", "  density: 1e-97"), f"radius 0.00129 m and density 1e-97 {GRAIN}"),
        (
            ("  activation", "  activation_energy: 1.5e6"),
            "14: scene.end_time: the characteristic end time vanishes where U/(R theta) is 601.4; "
            "must be at most 600, or give a time like '10 ms'",
        ),
        (
            ("  temperature", "  temperature: 1e-3"),
            "the characteristic end time vanishes where U/(R theta) is 6.014e+04; must be at most",
        ),
    ],
)
def test_a_scene_beyond_what_can_be_calculated_is_refused(
    edit: tuple[str, str], expected: str
) -> None:
    alone = campaign(*ALONE, edit)
    with pytest.raises(CampaignError) as caught:
        alone.check_scales(alone.parameters())
    assert expected in str(caught.value)
    assert str(caught.value).startswith("campaign.yaml:")
    with pytest.raises(CampaignError) as again:
        simulate(alone, {})
    assert str(again.value) == str(caught.value)


def test_what_is_beyond_is_a_matter_of_the_string() -> None:
    loaded = campaign()
    loaded.check_scales(loaded.parameters())
    with pytest.raises(CampaignError, match=r"U/\(R theta\) is 1\.203e\+04; must be at most 600"):
        simulate(loaded, {"activation_energy": 3e7})
    timed = campaign(("  end_time", "  end_time: 1 s"))
    timed.check_scales(timed.parameters({"activation_energy": 3e7}))


def test_a_range_that_makes_a_file_a_search_is_named_where_sections_are_missing() -> None:
    text = "\n".join(line for line in TEXT.splitlines() if not line.startswith("objective"))
    with pytest.raises(CampaignError) as caught:
        Campaign.from_text(text)
    [problem] = caught.value.problems
    assert problem.field == "objective"
    assert "variables.relative_speed, line 17, is a range to search" in problem.message


def test_a_section_that_makes_a_file_a_search_is_named_where_others_are_missing() -> None:
    lines = TEXT.replace("[0.1, 30]", "1").replace("[0.4, 0.8]", "0.5").replace("[1e7, 2e8]", "1e7")
    text = lines.partition("ensemble:")[0]
    with pytest.raises(CampaignError) as caught:
        Campaign.from_text(text)
    assert [problem.field for problem in caught.value.problems] == ["ensemble", "stopping"]
    assert all("section search, line 27," in p.message for p in caught.value.problems)


DEFAULTS = """
scene: {particles: 300, half_width: 1 cm, velocities: spread, end_time: 10 ms, heating: none}
variables:
  {relative_speed: 20, size_ratio: 0.5, density: 2500, hardness: 48 MPa, temperature: 300,
  activation_energy: 0}
"""


def test_defaults_of_laws_are_described_with_what_follows() -> None:
    lines = Campaign.from_text(DEFAULTS).describe().splitlines()
    followed = {line[2:28].strip(): line[28:54].strip() for line in lines}
    assert followed["mean flow"] == "101 m/s"  # |(10, 10, 100)|
    assert followed["fastest approach"] == "40.4 m/s"  # 2 v0 sqrt(1 + 2 0.1**2)
    assert followed["grains bond from"] == "339 m/s"  # sqrt(6 H/rho)
    [spread] = [line for line in lines if line.startswith("  velocities: spread")]
    assert "mean (10, 10, 100) m/s (default)" in spread
    assert any("length_ratio 1 (default)" in line for line in lines)
    given = DEFAULTS.replace("spread,", "{law: spread, mean: [0, 0, 0], transverse: 1},")
    lines = Campaign.from_text(given).describe().splitlines()
    assert not any("mean flow" in line for line in lines)
    [spread] = [line for line in lines if line.startswith("  velocities: spread")]
    assert spread.endswith("mean (0, 0, 0) m/s, transverse 1")
