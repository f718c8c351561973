"""What people know of their grains: a diameter in place of the half-width, a volume fraction."""

import numpy as np
import pytest
from campaign_text import campaign, edited

from agglom_mpi.config.campaign import Campaign
from agglom_mpi.config.yaml_source import CampaignError
from agglom_mpi.variables import size_ratio, volume_fraction

DIAMETER = ("  half_width", "  grain_diameter: 50 um")
FRACTION = ("  size_ratio", "  volume_fraction: [0.02, 0.2]")


def message(*edits):
    with pytest.raises(CampaignError) as caught:
        Campaign.from_text(edited(*edits))
    return str(caught.value)


def test_the_box_follows_from_the_diameter_of_the_grains():
    loaded = campaign(DIAMETER)
    for fraction in (0.02, 0.05, 0.3):
        scene = loaded.scene.build(loaded.parameters({"volume_fraction": fraction}))
        assert scene.radius == 25e-6
        grains = 100 * 4.0 / 3.0 * np.pi * scene.radius**3
        assert grains / (2.0 * scene.half_width) ** 3 == pytest.approx(fraction, rel=1e-14)
        assert scene.mass == pytest.approx(6000 * grains / 100, rel=1e-14)


def test_a_diameter_is_the_scene_of_the_half_width_that_follows():
    by_width, by_size = campaign(), campaign(("  half_width", "  grain_diameter: 1 mm"))
    string = by_size.parameters({"size_ratio": 0.5})
    scene = by_size.scene.build(string)
    text = f"  half_width: {scene.half_width!r}"
    other = campaign(("  half_width", text)).scene.build(string)
    assert other.radius == pytest.approx(scene.radius, rel=1e-14)
    assert other.end_time == pytest.approx(scene.end_time, rel=1e-12)
    assert by_width.scene.diameter is None


def test_a_radius_is_half_a_diameter_and_the_same_campaign():
    diameter, radius = campaign(DIAMETER), campaign(("  half_width", "  grain_radius: 25 um"))
    assert radius.identity() == diameter.identity()
    assert diameter.identity()["scene.grain_diameter"] == 50e-6
    assert "scene.half_width" not in diameter.identity()
    assert "scene.grain_diameter" not in campaign().identity()


def test_a_fixed_volume_fraction_is_the_campaign_of_its_size_ratio():
    ratio = size_ratio(0.05)
    by_ratio = campaign(("  size_ratio", f"  size_ratio: {ratio!r}"))
    by_fraction = campaign(("  size_ratio", "  volume_fraction: 5 percent"))
    assert by_fraction.identity() == by_ratio.identity()
    assert by_fraction.parameters()[1] == ratio


@pytest.mark.parametrize("log", ["", ", log"])
def test_a_searched_volume_fraction_is_uniform_as_it_is_written(log):
    loaded = campaign(("  size_ratio", f"  volume_fraction: [0.02, 0.2{log}]"))
    space, random = loaded.space(), np.random.default_rng(1)
    strings = space.from_unit(random.random((4000, space.dimensions)))
    fractions = volume_fraction(strings[:, 1])
    scale = np.log if log else np.asarray
    share = (scale(fractions) - scale(0.02)) / (scale(0.2) - scale(0.02))
    assert np.all((share > -1e-12) & (share < 1.0 + 1e-12))
    assert abs(share.mean() - 0.5) < 4.0 / np.sqrt(12.0 * len(share))
    assert abs((share**2).mean() - 1.0 / 3.0) < 4.0 * np.sqrt(4.0 / 45.0 / len(share))
    third = loaded.identity()["variables.size_ratio.2"]
    assert third == ("log" if log else "cubic")


def test_the_middle_and_a_given_string_may_be_by_volume_fraction():
    loaded = campaign(FRACTION, ("search", "search: {start: [{volume_fraction: 0.1}]}"))
    assert volume_fraction(loaded.parameters()[1]) == pytest.approx(0.11, rel=1e-14)
    assert volume_fraction(loaded.given_strings()[0][1]) == pytest.approx(0.1, rel=1e-14)
    assert loaded.parameters({"volume_fraction": 0.05})[1] == size_ratio(0.05)


@pytest.mark.parametrize(
    ("edits", "said"),
    [
        (
            [("  half_width", "  half_width: 1 cm\n  grain_diameter: 50 um")],
            "6: scene.grain_diameter: is given beside half_width; give one of half_width, "
            "grain_diameter, grain_radius",
        ),
        (
            [("  half_width", "  grain_diameter: 50 um\n  grain_radius: 25 um")],
            "6: scene.grain_radius: is given beside grain_diameter; give one of half_width",
        ),
        (
            [("  half_width", "")],
            "scene.half_width: is missing; half the edge, like '1 cm', or grain_diameter, "
            "like '50 um'",
        ),
        ([("  half_width", "  grain_diameter: 50 s")], "scene.grain_diameter: wrong unit: 's'"),
        ([("  half_width", "  grain_diameter: 0")], "is 0; must be greater than 0"),
        ([("  half_width", "  grain_diameter:")], "scene.grain_diameter: is empty; must be a numb"),
        (
            [("  size_ratio", "  size_ratio: 0.5\n  volume_fraction: 0.1")],
            "19: variables.volume_fraction: is given beside size_ratio; give one of size_ratio, "
            "volume_fraction",
        ),
        (
            [("  size_ratio", "")],
            "variables.size_ratio: is missing; needed by every scene; a value or a range "
            "[lower, upper], or volume_fraction in its place",
        ),
        (
            [("  size_ratio", "  volume_fraction: 0.5")],
            "variables.volume_fraction: is 0.5; must be at most 0.38; random placement jams",
        ),
        ([("  size_ratio", "  volume_fraction: [0.2, 0.1]")], "the lower end must be less than"),
        ([("  size_ratio", "  volume_fraction: 0")], "is 0; must be greater than 0"),
        (
            [FRACTION, ("search", "search: {start: [{volume_fraction: 0.3}]}")],
            "search.start.0.volume_fraction: is 0.3; must be within its range, 0.02 to 0.2",
        ),
    ],
)
def test_a_mistake_is_located_and_explained(edits, said):
    text = message(*edits)
    assert said in text
    assert len(text.splitlines()) == 1


def test_one_value_of_the_fraction_is_given_to_a_string():
    with pytest.raises(CampaignError, match="volume_fraction: is given beside size_ratio"):
        campaign().parameters({"size_ratio": 0.5, "volume_fraction": 0.1})


def test_check_says_what_follows_with_units():
    text = campaign(DIAMETER, FRACTION, ("  end_time", "  end_time: 2 ms")).describe()
    assert "\n  grains: diameter 50 µm; the box follows from it\n" in text
    assert "\n  volume_fraction           0.02 .. 0.2\n" in text
    [line] = [line for line in text.splitlines() if line.startswith("  edge of the box")]
    ends = [50e-6 * (100 * np.pi / 6.0 / fraction) ** (1.0 / 3.0) for fraction in (0.2, 0.02)]
    assert (
        line.split() == f"edge of the box {ends[0] * 1e6:.0f} µm .. {ends[1] * 1e6:.0f} µm".split()
    )
    for label in ("mean free path", "collisions per grain", "grain mass", "impact pressure/hardn"):
        assert f"\n  {label}" in text
    alone = campaign(("  size_ratio", "  size_ratio: 0.6"), ("  end_time", "  end_time: 2 ms"))
    assert "\n  volume fraction           0.113\n" in alone.describe()
