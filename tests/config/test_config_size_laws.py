"""The entry `sizes` of a scene: laws, files, what they combine with, and their identity."""

import json
import math
import re

import numpy as np
import pytest
from campaign_text import campaign, edited

from agglom_mpi.config.campaign import Campaign
from agglom_mpi.config.loading import campaign_of_record, load_campaign
from agglom_mpi.config.yaml_source import CampaignError
from agglom_mpi.physics.size_distributions import size_classes
from agglom_mpi.variables import volume_fraction

LOGNORMAL = "  sizes: {law: lognormal, median: 50 um, spread: 1.3}"
MEAN = 50e-6 * math.exp(0.5 * math.log(1.3) ** 2)
RATIO = ("  size_ratio", "  size_ratio: [0.2, 0.4]")
FRACTION = ("  size_ratio", "  volume_fraction: [0.02, 0.2]")


def with_sizes(entry, width="", *edits):
    """The campaign with an entry, and another line in place of the half-width."""
    return campaign(("  half_width", f"{width}\n{entry}" if width else entry), *edits)


def message(entry, width="", *edits):
    with pytest.raises(CampaignError) as caught:
        with_sizes(entry, width, *edits)
    return str(caught.value)


def test_a_law_of_lengths_says_how_large_the_grains_are():
    loaded = with_sizes(LOGNORMAL, "", FRACTION)
    scene = loaded.scene.build(loaded.parameters({"volume_fraction": 0.05}))
    assert scene.radius == pytest.approx(0.5 * MEAN, rel=1e-14)
    third = math.exp(3.0 * math.log(1.3) ** 2)
    grains = 100 * 4.0 / 3.0 * np.pi * scene.radius**3 * third
    assert grains / (2.0 * scene.half_width) ** 3 == pytest.approx(0.05, rel=1e-13)
    uniform = with_sizes("  sizes: {law: uniform, smallest: 40 um, largest: 0.06 mm}")
    assert uniform.scene.diameter == pytest.approx(50e-6, rel=1e-14)


@pytest.mark.parametrize(
    "entry",
    ["  sizes: {law: lognormal, spread: 1.3}", "  sizes: {law: uniform, ratio: 3}"],
)
def test_a_relative_law_leaves_the_mean_to_the_box_or_a_diameter(entry):
    by_box = with_sizes(entry, "  half_width: 0.01")
    by_size = with_sizes(entry, "  grain_diameter: 50 um")
    string = by_box.parameters()
    assert by_box.scene.build(string).radius == campaign().scene.build(string).radius
    assert by_size.scene.build(string).radius == 25e-6
    assert by_box.variables.fraction(0.5) == volume_fraction(0.5) * by_box.scene.third_moment


def test_how_a_campaign_without_sizes_is_identified_does_not_change():
    assert not [key for key in campaign().identity() if "sizes" in key]
    assert with_sizes(LOGNORMAL).identity()["scene.sizes.median"] == 50e-6
    assert not {"scene.half_width", "scene.grain_diameter"} & set(with_sizes(LOGNORMAL).identity())


@pytest.mark.parametrize(
    ("entry", "width", "said"),
    [
        (LOGNORMAL, "  half_width: 0.01", "half_width: is given beside sizes that are lengths; "),
        (LOGNORMAL, "  grain_radius: 1 mm", "grain_radius: is given beside sizes that are le"),
        ("  sizes: {law: lognormal, spread: 1.3}", "", "scene.half_width: is missing"),
        ("  sizes: {law: lognormal}", "  half_width: 0.01", "sizes.spread: is missing; like 1.3"),
        ("  sizes: {law: lognormal, spread: 0.7}", "", "spread: is 0.7; must be greater than 1"),
        ("  sizes: {law: lognormal, spread: 3.5}", "", "spread: is 3.5; must be at most 3"),
        ("  sizes: {law: normal}", "", "scene.sizes.law: is 'normal'; allowed: lognormal, uniform"),
        ("  sizes: {law: uniform}", "", "smallest: is missing; give smallest and largest, or"),
        ("  sizes: {law: uniform, smallest: 1 mm}", "", "largest: is missing; a diameter like"),
        (
            "  sizes: {law: uniform, smallest: 2 mm, largest: 1 mm}",
            "",
            "largest: is 0.001 m; must be greater than smallest, 0.002 m",
        ),
        (
            "  sizes: {law: uniform, smallest: 1 mm, largest: 2 mm, ratio: 2}",
            "",
            "ratio: is given beside lengths; give smallest and largest, or their ratio",
        ),
        (
            LOGNORMAL.replace("50 um", "50 kg"),
            "",
            "sizes.median: wrong unit: 'kg' is mass, expected length",
        ),
        ("  sizes: {file: s.csv}", "  half_width: 0.01", "is 's.csv', which is read beside a ca"),
        (
            "  sizes: {law: lognormal, spread: 1.3, basis: volume}",
            "  half_width: 0.01",
            "scene.sizes.basis: is 'volume', which says what a median is of; give median, or leave",
        ),
        (LOGNORMAL.replace("}", ", basis: mass}"), "", "basis: is 'mass'; allowed: number, vol"),
    ],
)
def test_a_mistake_is_said_in_a_line(entry, width, said):
    found = message(entry, width)
    assert said in found
    assert "campaign.yaml:" in found


def test_a_wide_law_may_fill_no_more_of_the_box_than_has_room():
    wide = "  sizes: {law: lognormal, spread: 2}"
    found = message(wide, "  half_width: 0.01")
    assert "variables.size_ratio: reaches 0.8, where the grains fill 1.13 of the box" in found
    limit = ("objective", "constraints: [relative_speed < 20 m/s]\nobjective: maximum_growth")
    assert "reaches 0.8, where" in message(wide, "  half_width: 0.01", limit)
    fits = with_sizes(wide, "  half_width: 0.01", ("  size_ratio", "  volume_fraction: 0.38"))
    assert fits.variables.fraction(fits.parameters()[1]) == pytest.approx(0.38, rel=1e-13)


def test_strings_to_start_with_may_give_the_volume_fraction_of_grains_with_sizes():
    start = ("search", "search: {population: 12, parents: 4, start: [{volume_fraction: 0.1}]}")
    campaign = with_sizes(LOGNORMAL, "", FRACTION, start)
    [string] = campaign.given_strings()
    assert campaign.variables.fraction(string[1]) == pytest.approx(0.1, rel=1e-13)
    outside = ("search", "search: {population: 12, parents: 4, start: [{volume_fraction: 0.3}]}")
    found = message(LOGNORMAL, "", FRACTION, outside)
    assert "search.start.0.volume_fraction: is 0.3; must be within its range, 0.02 to" in found


@pytest.fixture
def folder(tmp_path):
    text = edited(("  half_width", "  sizes: {file: sizes.csv}"))
    (tmp_path / "c.yaml").write_text(text)
    return tmp_path


def loaded(folder, content):
    (folder / "sizes.csv").write_text(content)
    return load_campaign(folder / "c.yaml")


def test_a_file_of_sizes_is_read_with_its_unit_beside_the_campaign(folder):
    for content in ("diameter (um)\n40\n60\n80\n", "# sieved\n\ndiameter (mm),\n0.04\n0.06\n0.08"):
        found = loaded(folder, content)
        assert found.scene.sizes.diameters == pytest.approx((40e-6, 60e-6, 80e-6), rel=1e-15)
        assert found.scene.diameter == pytest.approx(60e-6, rel=1e-15)


@pytest.mark.parametrize("content", ["2\n3\n4\n", "diameter\n2\n3\n4\n"])
def test_a_file_without_unit_is_of_relative_sizes(folder, content):
    text = (folder / "c.yaml").read_text().replace("  sizes", "  half_width: 1 cm\n  sizes")
    (folder / "c.yaml").write_text(text)
    found = loaded(folder, content)
    assert found.scene.diameter is None
    assert found.scene.size_law.ratios == pytest.approx([2 / 3, 1, 4 / 3], rel=1e-15)


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ("diameter (um)\n", "holds no number"),
        ("diameter (um)\n40\n-1\n", "line 3: '-1'; must be greater than 0"),
        ("diameter (um)\n40\n1e100\n", "line 3: '1e100'"),
        ("diameter (um)\nnan\n40\n", "line 2: 'nan'"),
        ("diameter (um)\n1\n101\n", "the largest must be at most 100 times the smallest"),
    ],
)
def test_a_mistake_in_a_file_of_sizes_is_said(folder, content, said):
    with pytest.raises(CampaignError) as caught:
        loaded(folder, content)
    assert said in str(caught.value)
    assert "c.yaml:5: scene.sizes.file: is " in str(caught.value)


def test_a_lacking_file_of_sizes_is_said(folder):
    with pytest.raises(
        CampaignError, match=r"is 'sizes\.csv', but .* cannot be read: No such file"
    ):
        load_campaign(folder / "c.yaml")


def test_what_is_read_of_a_file_cannot_be_given(folder):
    text = (folder / "c.yaml").read_text().replace("sizes.csv", "sizes.csv, diameters: [1]")
    (folder / "c.yaml").write_text(text)
    with pytest.raises(CampaignError, match="unknown key 'diameters'; allowed beside file: law, b"):
        loaded(folder, "1\n")


@pytest.mark.parametrize(
    ("entry", "said"),
    [
        ("{file: 3}", "sizes.file: is 3; must be a text"),
        ("{law: file}", "sizes.file: is missing"),
        ("{file: /dev/zero}", "is '/dev/zero', but /dev/zero cannot be read: is not a regular"),
        ("{file: .}", "cannot be read: Is a directory"),
        ("{file: /proc/self/status}", "cannot be read: is in /proc or /sys, which are not read"),
        ('{file: "a\\0b"}', "which holds a character that cannot be printed"),
        ("{file: sizes.csv, law: lognormal}", "sizes.file: unknown key 'file'; allowed: law, sp"),
        ("5", "scene.sizes: is 5; must be the name of a law"),
    ],
)
def test_an_entry_that_names_no_file_is_said(folder, entry, said):
    text = (folder / "c.yaml").read_text().replace("{file: sizes.csv}", entry)
    (folder / "c.yaml").write_text(text)
    with pytest.raises(CampaignError) as caught:
        loaded(folder, "1\n")
    assert said in str(caught.value)
    assert "diameters" not in str(caught.value)


def test_the_content_of_a_file_of_sizes_is_in_the_identity_and_comes_back(folder):
    first = loaded(folder, "diameter (um)\n40\n80\n")
    assert first.identity()["scene.sizes.diameters"] == "4e-05 8e-05"
    stored = json.loads(json.dumps(first.identity()))
    (folder / "sizes.csv").write_text("diameter (um)\n40\n81\n")
    assert load_campaign(folder / "c.yaml").sha256() != first.sha256()
    back = campaign_of_record(first.text, "c.h5", stored)
    assert back.identity() == stored
    assert back.scene.size_law.ratios.tolist() == first.scene.size_law.ratios.tolist()
    (folder / "other.csv").write_text("diameter (mm)\n0.04\n0.08\n")
    text = first.text.replace("sizes.csv", "other.csv")
    (folder / "c.yaml").write_text(text)
    assert load_campaign(folder / "c.yaml").sha256() == first.sha256()


CURVE = "sieve (um);passing (%)\n20;0\n32;12\n45;38\n63;71\n90;94\n125;100\n"


def with_keys(folder, keys):
    text = (folder / "c.yaml").read_text().replace("file: sizes.csv", f"file: sizes.csv, {keys}")
    text = re.sub(r"(?<=  )size_ratio.*", "volume_fraction: [0.02, 0.2]", text)
    (folder / "c.yaml").write_text(text)
    return folder


def test_a_sieve_curve_gives_the_sizes_at_the_start_and_comes_back(folder):
    found = loaded(with_keys(folder, "error: 2 percent"), CURVE)
    sizes, mean = found.scene.sizes, found.scene.diameter
    for size, share in ((32e-6, 0.12), (45e-6, 0.38), (63e-6, 0.71), (90e-6, 0.94)):
        assert sizes.size_law.quantile(share, by_volume=True) * mean == pytest.approx(size, 2e-3)
    assert 0.02 < sizes.mean_errors[0] < 0.04
    assert 0.01 < sizes.mean_errors[1] < 0.02
    stored = json.loads(json.dumps(found.identity()))
    back = campaign_of_record(found.text, "c.h5", stored)
    assert back.identity() == stored
    assert back.scene.diameter == mean


def test_the_error_of_a_sieve_curve_is_none_of_the_samples(folder):
    first = loaded(with_keys(folder, "error: 2 percent"), CURVE)
    text = first.text.replace("error: 2 percent", "error: 1 percent")
    (folder / "c.yaml").write_text(text)
    second = load_campaign(folder / "c.yaml")
    assert second.identity() == first.identity()
    assert second.scene.sizes.mean_errors == pytest.approx(
        [0.5 * error for error in first.scene.sizes.mean_errors]
    )
    assert "errors of the curve: mean diameter" in second.describe()


@pytest.mark.parametrize(
    ("keys", "content", "field"),
    [
        ("error: 200 percent", CURVE, "sizes.error"),
        ("error: 2 percent, counted: 100", CURVE, "sizes.counted"),
        ("error: 2 percent, basis: volume", CURVE, "sizes.basis"),
        ("error: 2 percent, headings: {x: size (um)}", CURVE, "sizes.headings"),
        ("error: 2 percent, headings: {a: 1}", CURVE, "sizes.headings.a"),
        ("error: 2 percent", CURVE.replace("20;0\n", ""), "sizes.file"),
        ("error: 2 percent", CURVE.replace("125;100\n", ""), "sizes.file"),
        ("error: 2 percent", CURVE.replace("20;0", "1;0"), "sizes.file"),
        ("error: 2 percent", CURVE.replace("passing", "area passing"), "sizes.file"),
        ("error: 2 percent", CURVE.replace("63;71", "63;17"), "sizes.file"),
        ("law: curve", CURVE, "sizes.error"),
        ("law: file", CURVE, "sizes.file"),
    ],
)
def test_a_mistake_in_a_sieve_curve_is_named(folder, keys, content, field):
    with pytest.raises(CampaignError) as caught:
        loaded(with_keys(folder, keys), content)
    [problem] = caught.value.problems
    assert (problem.line, problem.field) == (5, f"scene.{field}")


def test_growth_is_possible_up_to_one_grain_of_all():
    wide = "  sizes: {law: lognormal, spread: 2}"
    low = ("  size_ratio", "  volume_fraction: 0.1")
    target = ("objective", "objective: {law: growth_target, ratio: 6}")
    assert with_sizes(wide, "  half_width: 0.01", low, target).objective.ratio == 6
    with pytest.raises(CampaignError, match=r"100 grains in one give at most 4\.642"):
        Campaign.from_text(edited(target))
    most = ("objective", "objective: maximum_growth")
    objective = with_sizes(wide, "  half_width: 0.01", low, most)
    grains = objective.scene.equivalent_grains
    assert objective.objective.deviation(np.cbrt(grains)) == pytest.approx(0.0, abs=1e-15)


VOLUME = LOGNORMAL.replace("spread: 1.3", "spread: 1.8, basis: volume")


def test_a_median_by_volume_is_that_of_hatch_and_choate():
    loaded = with_sizes(VOLUME, "", FRACTION)
    by_number = 50e-6 * math.exp(-3.0 * math.log(1.8) ** 2)
    assert loaded.scene.diameter == pytest.approx(by_number * math.exp(0.5 * math.log(1.8) ** 2))
    assert (
        loaded.scene.size_law
        == with_sizes(VOLUME.replace(", basis: volume", ""), "", FRACTION).scene.size_law
    )
    assert loaded.scene.size_law.quantile(0.5, by_volume=True) * loaded.scene.diameter == (
        pytest.approx(50e-6, rel=1e-14)
    )


@pytest.mark.parametrize(
    "law", ["lognormal, median: 50 um, spread: 1.8", "uniform, smallest: 40 um, largest: 60 um"]
)
def test_a_law_by_number_is_the_campaign_without_a_basis(law):
    plain, number, volume = (
        with_sizes(f"  sizes: {{law: {law}{basis}}}", "", RATIO)
        for basis in ("", ", basis: number", ", basis: volume")
    )
    assert number.identity() == plain.identity()
    assert volume.identity() == {**plain.identity(), "scene.sizes.basis": "volume"}
    assert volume.scene.diameter < plain.scene.diameter


def test_sizes_uniform_by_volume_have_their_median_in_the_middle():
    loaded = with_sizes("  sizes: {law: uniform, smallest: 40 um, largest: 120 um, basis: volume}")
    law, mean = loaded.scene.size_law, loaded.scene.diameter
    assert mean == pytest.approx(2.0 * 40e-6 * 120e-6 / 160e-6, rel=1e-14)
    assert law.quantile(0.5, by_volume=True) * mean == pytest.approx(80e-6, rel=1e-14)
    assert law.quantile(0.0) * mean == pytest.approx(40e-6, rel=1e-14)
    assert law.quantile(1.0) * mean == pytest.approx(120e-6, rel=1e-14)


def test_rows_of_a_file_may_have_the_same_volume_of_grains_each(folder):
    text = (folder / "c.yaml").read_text().replace("sizes.csv", "sizes.csv, basis: volume")
    (folder / "c.yaml").write_text(text)
    found = loaded(folder, "diameter (um)\n20\n40\n")
    # For each grain of 40 µm there are eight of 20 µm.
    assert found.scene.diameter == pytest.approx((8 * 20e-6 + 40e-6) / 9, rel=1e-14)
    stored = json.loads(json.dumps(found.identity()))
    assert stored["scene.sizes.basis"] == "volume"
    back = campaign_of_record(found.text, "c.h5", stored)
    assert back.identity() == stored
    assert back.scene.diameter == found.scene.diameter


def test_check_says_quantiles_by_number_and_by_volume():
    lines = with_sizes(VOLUME, "", FRACTION).describe().splitlines()
    place = lines.index(
        "  sizes: lognormal, median 50 µm by volume, geometric standard deviation 1.8"
    )
    s, z = math.log(1.8), 1.2815515655446004
    ends = {
        name: [median * math.exp(s * x) for x in (-z, 0.0, z)]
        for name, median in (("number", 50.0 * math.exp(-3.0 * s * s)), ("volume", 50.0))
    }
    assert [float(x) for x in re.findall(r"([\d.]+) µm", lines[place + 1])] == pytest.approx(
        ends["number"], rel=5e-3
    )
    mean = 50.0 * math.exp(0.5 * s * s)
    assert [float(x) for x in re.findall(r"([\d.]+) µm", lines[place + 2])] == pytest.approx(
        [*ends["volume"], mean], rel=5e-3
    )
    relative = with_sizes("  sizes: {law: uniform, ratio: 3}", "  half_width: 0.01").describe()
    assert "diameters by number: d10 0.6, d50 1, d90 1.4, over the mean diameter" in relative


def test_what_follows_from_a_law_is_calculated_once(folder):
    scene = loaded(folder, "diameter (um)\n" + "40\n60\n80\n" * 100).scene
    assert scene.size_law is scene.size_law
    assert size_classes(scene.size_law) is size_classes(scene.size_law)
    again = scene.build(load_campaign(folder / "c.yaml").parameters()).sizes
    assert again is scene.size_law


def test_check_says_what_the_sizes_are():
    text = with_sizes(LOGNORMAL, "", FRACTION).describe()
    assert "sizes: lognormal, median 50 µm, geometric standard deviation 1.3" in text
    assert "grains: mean diameter 51.8 µm; the box follows from it" in text
    assert "Enskog's theory of mixtures" in text
    assert "number of grains" not in text.partition("particles do not record")[2]


def test_samples_whose_volume_varies_are_warned_of():
    def scatter(particles):
        loaded = campaign(
            ("  particles", f"  particles: {particles}"),
            ("  half_width", "  half_width: 0.01\n  sizes: {law: lognormal, spread: 2}"),
            ("  size_ratio", "  volume_fraction: [0.01, 0.02]"),
        )
        return [w for w in loaded.warnings() if "standard deviation" in w.message]

    needed = math.ceil((math.exp(9.0 * math.log(2.0) ** 2) - 1.0) / 0.2**2)
    assert scatter(needed) == []
    [warning] = scatter(200)
    assert warning.field == "scene.sizes"
    assert f"needs {needed:,} grains" in warning.message
    deviation = math.sqrt(needed * 0.2**2 / 200)
    assert f"deviation of {100 * deviation:.0f} % of what is asked" in warning.message
    low, high = map(float, re.search(r"them ([\d.]+) to ([\d.]+) times", warning.message).groups())
    assert 0.3 < low < 0.7
    assert 1.3 < high < 2.5


def drawn(spread, particles=50, fraction=0.2):
    """Share of samples in % that fail and volume fraction of the others, by a warning, or None."""
    loaded = campaign(
        ("  particles", f"  particles: {particles}"),
        ("  half_width", f"  half_width: 0.01\n  sizes: {{law: lognormal, spread: {spread}}}"),
        ("  size_ratio", f"  volume_fraction: [0.01, {fraction}]"),
    )
    found = [w for w in loaded.warnings() if w.field == "scene.sizes" and "fail" in w.message]
    if not found:
        return None
    assert found[0].line == 6
    numbers = re.search(r"about ([\d.]+) % of samples.* samples fill ([\d.]+) of", found[0].message)
    return float(numbers[1]), float(numbers[2])


def test_a_law_that_loses_its_large_draws_is_warned_of():
    # Of 300 samples 6 fail, and the others fill 0.181 +- 0.006 of the box, not 0.2.
    share, filled = drawn(2.0)
    assert 1.0 < share < 4.0
    assert 0.165 < filled < 0.191
    assert drawn(3.0)[1] < filled
    assert drawn(1.3) is drawn(1.7, fraction=0.02) is drawn(2.0, particles=5000) is None
