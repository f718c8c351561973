"""Section `data`: what it takes, what it refuses, and what a stored campaign keeps of it."""

import json

import numpy as np
import pytest
from campaign_text import campaign, edited

from agglom_mpi.config.campaign import Campaign
from agglom_mpi.config.data_section import DatumEntry
from agglom_mpi.config.explanation import below, find, texts_of
from agglom_mpi.config.loading import campaign_of_record, check_campaign, load_campaign
from agglom_mpi.config.plausibility import implausible
from agglom_mpi.config.yaml_source import CampaignError
from agglom_mpi.declaration.reading import Reading
from agglom_mpi.measurements.quantities import QUANTITIES

SIEVES = "Sieve (mm);Passing (%)\n1;100\n0.5;90\n0.25;60\n0.125;25\n0.053;0\n"
DATA = """\
data:
  - {quantity: sizes, file: sieve.csv, time: 2 ms, error: 2 percent}
  - {quantity: mean_diameter, value: 120 um, error: 5 um, time: 5 ms}
  - {quantity: d50, weight: area, value: 140 um, error: 8 um}
  - {quantity: particles_left, value: 35 percent, error: 0.05, time: 5 ms}
  - {quantity: temperature, value: 136.85 degC, error: 10 K}
objective: {law: misfit}
"""
FIXED = [
    ("  rule: successive", "  rule: fixed"),
    ("  tolerance", "  samples: 20"),
    ("  max_samples", ""),
]
"""Edits of a campaign to a stopping rule that needs no objective of a sample."""


def text_of(*entries, end="6 ms"):
    lines = "".join(f"  - {entry}\n" for entry in entries)
    data = f"data:\n{lines}objective: {{law: misfit}}"
    return edited(("objective", data), ("  end_time", f"  end_time: {end}"), *FIXED)


@pytest.fixture
def folder(tmp_path):
    text = edited(("objective", DATA), ("  end_time", "  end_time: 6 ms"), *FIXED)
    (tmp_path / "c.yaml").write_text(text)
    (tmp_path / "sieve.csv").write_text(SIEVES)
    return tmp_path


def test_data_are_records_in_si_units(folder):
    sizes, mean, median, left, temperature = load_campaign(folder / "c.yaml").data
    assert sizes.weight == "mass"
    assert sizes.time == 2e-3
    assert sizes.edges == pytest.approx([53e-6, 125e-6, 250e-6, 500e-6, 1e-3])
    assert sizes.values == pytest.approx([0.25, 0.35, 0.3, 0.1])
    assert np.diag(sizes.covariance) == pytest.approx(4e-4 * np.array([1, 2, 2, 1]))
    assert (mean.weight, mean.values[0], mean.covariance[0, 0]) == ("number", 120e-6, (5e-6) ** 2)
    assert (median.weight, median.time) == ("area", None)
    assert (left.values[0], temperature.values[0]) == (0.35, pytest.approx(410.0))


def test_quantities_are_those_of_the_measurements():
    assert texts_of(DatumEntry.model_fields["quantity"].annotation) == tuple(QUANTITIES)


def test_diameters_are_by_mass_and_means_by_number_unless_stated():
    entries = [
        f"{{quantity: {name}, value: 1 mm, error: 1 um}}"
        for name, each in QUANTITIES.items()
        if each.unit == "m" and each.has_weight
    ]
    alone = [Campaign.from_text(text_of(entry)).data[0] for entry in entries]
    found = {datum.quantity: datum.weight for datum in alone}
    masses = {"d10", "d50", "d90"}
    assert {name for name, weight in found.items() if weight == "mass"} == masses
    assert {name for name, weight in found.items() if weight == "number"} == set(found) - masses


def test_a_campaign_without_data_keeps_its_identity():
    assert not [key for key in campaign().identity() if key.startswith("data")]
    empty = campaign(("objective", "data: []\nobjective: {law: growth_target, ratio: 2}"))
    assert empty.sha256() == campaign().sha256()
    assert empty.data == ()


def test_a_stored_campaign_needs_no_file(folder):
    loaded = load_campaign(folder / "c.yaml")
    identity = json.loads(json.dumps(loaded.identity()))
    stored = campaign_of_record(loaded.text, "stored", identity)
    assert stored.identity() == loaded.identity()
    for own, theirs in zip(stored.data, loaded.data, strict=True):
        assert np.array_equal(own.values, theirs.values)
        assert np.array_equal(own.covariance, theirs.covariance)
    with pytest.raises(CampaignError, match=r"data\.0\.file"):
        Campaign.from_text(loaded.text)


@pytest.mark.parametrize(
    ("key", "value"),
    [("shares", "0.5 0.5"), ("edges", None), ("errors", "x"), ("weight", "a"), ("errors_of", 1)],
)
def test_damaged_numbers_of_a_stored_campaign_are_noticed(folder, key, value):
    loaded = load_campaign(folder / "c.yaml")
    identity = loaded.identity() | {f"data.0.{key}": value}
    with pytest.raises(CampaignError, match=r"data\.0\.file"):
        campaign_of_record(loaded.text, "stored", identity)


def test_only_numbers_decide_the_identity(folder):
    first = load_campaign(folder / "c.yaml").identity()
    text = (folder / "c.yaml").read_text().replace("sieve.csv", "other.csv").replace("2 ms", "2e-3")
    (folder / "c.yaml").write_text(text)
    (folder / "other.csv").write_text(SIEVES.replace(";", ","))
    assert load_campaign(folder / "c.yaml").identity() == first
    (folder / "other.csv").write_text(SIEVES.replace("60", "61"))
    changed = load_campaign(folder / "c.yaml").identity()
    assert {key for key in first if first[key] != changed[key]} == {"data.0.shares"}


D50 = "quantity: d50, value: 140 um, error: 8 um"
REFUSED = {
    "a later time": (f"{{{D50}, time: 7 ms}}", "time", ("7 ms", "6 ms")),
    "a time of 0": (f"{{{D50}, time: 0}}", "time", ("0",)),
    "an error of 0": ("{quantity: d50, value: 140 um, error: 0}", "error", ("0 m",)),
    "no error": ("{quantity: d50, value: 140 um}", "error", ("missing",)),
    "no value": ("{quantity: d50, error: 8 um}", "value", ("missing",)),
    "a value without sense": ("{quantity: d50, value: -1 um, error: 8 um}", "value", ("-1 um",)),
    "a text": ("{quantity: d50, value: large, error: 8 um}", "value", ("large",)),
    "more than all": (
        "{quantity: particles_left, value: 35, error: 5 percent}",
        "value",
        ("35", "1"),
    ),
    "another unit": ("{quantity: temperature, value: 4 m, error: 1 K}", "value", ("'m'",)),
    "a difference in degC": (
        "{quantity: temperature, value: 400 K, error: 3 degC}",
        "error",
        ("3 degC", "K"),
    ),
    "an unknown quantity": ("{quantity: d60, value: 1 um, error: 1 um}", "quantity", ("d60",)),
    "no quantity": ("{value: 1 um, error: 1 um}", "quantity", ("missing", "d50")),
    "an unknown key": (f"{{{D50}, wieght: mass}}", "wieght", ("weight",)),
    "an unknown weight": (f"{{{D50}, weight: volume}}", "weight", ("volume", "mass")),
    "a weight without meaning": (
        "{quantity: d43, weight: mass, value: 1 um, error: 1 um}",
        "weight",
        ("d43",),
    ),
    "a file of a number": (f"{{{D50}, file: s.csv}}", "file", ("d50",)),
    "a number of sizes": ("{quantity: sizes, file: s.csv, value: 3}", "value", ("sizes",)),
    "sizes without a file": ("{quantity: sizes, error: 0.1}", "file", ("missing",)),
    "an error of sizes of 0": ("{quantity: sizes, file: s.csv, error: 0}", "error", ("0",)),
    "too few counted": ("{quantity: sizes, file: s.csv, counted: 3}", "counted", ("3", "10")),
}


@pytest.mark.parametrize(("entry", "field", "named"), REFUSED.values(), ids=REFUSED)
def test_an_entry_is_refused_with_line_and_field(entry, field, named):
    with pytest.raises(CampaignError) as caught:
        Campaign.from_text(text_of("{quantity: d43, value: 1 mm, error: 1 um}", entry))
    [problem] = caught.value.problems
    assert problem.field == f"data.1.{field}"
    assert problem.line == 28
    for part in named:
        assert part in problem.message


def test_a_datum_stands_once():
    with pytest.raises(CampaignError) as caught:
        Campaign.from_text(text_of(f"{{{D50}}}", "{quantity: d50, value: 1.4e-4, error: 8e-6}"))
    [problem] = caught.value.problems
    assert problem.field == "data.1"
    Campaign.from_text(text_of(f"{{{D50}}}", f"{{{D50}, time: 1 ms}}", f"{{{D50}, weight: area}}"))


@pytest.mark.parametrize(
    ("first", "again"),
    [
        ("quantity: mean_diameter, value: 140 um", "quantity: mean_radius, value: 71 um"),
        ("quantity: d43, value: 140 um", "quantity: mean_diameter, weight: mass, value: 141 um"),
        ("quantity: d32, value: 140 um", "quantity: mean_radius, weight: area, value: 70 um"),
        ("quantity: spread, value: 0.3", "time: 5 ms, quantity: spread, value: 0.3"),
    ],
)
def test_a_datum_does_not_stand_under_two_names(first, again):
    """Whichever stands first; a run that is recorded with both stays readable."""
    entries = [f"{{{each}, error: 2e-6}}" for each in (first, again)]
    for order in (entries, entries[::-1]):
        text = text_of(*order, end="5 ms")
        with pytest.raises(CampaignError) as caught:
            Campaign.from_text(text)
        assert [problem.field for problem in caught.value.problems] == ["data.1"]
        recorded = Campaign.from_text(text, "stored", None, Reading(recorded=True))
        assert len(recorded.data) == 2


def test_two_measurements_of_one_quantity_are_two_data():
    again = "{quantity: d50, value: 141 um, error: 2 um}"
    assert len(Campaign.from_text(text_of(f"{{{D50}}}", again)).data) == 2


NUMBERS = [
    f"{{{D50}}}",
    f"{{{D50}, time: 2 ms}}",
    "{quantity: d90, value: 210 um, error: 10 um}",
    "{quantity: temperature, value: 400 K, error: 2 K}",
]


def correlated(*entries, numbers=NUMBERS):
    lines = "".join(f"  - {{{entry}}}\n" for entry in entries)
    return text_of(*numbers) + f"correlations:\n{lines}"


def test_correlations_name_data_by_quantity_name_or_place():
    names = ("d90, 0", "d50 by mass at the end, d90", "2, 'd50 by mass at the end'")
    texts = [correlated(f"between: [{pair}], value: 60 %") for pair in names]
    plain, *found = (Campaign.from_text(text) for text in (text_of(*NUMBERS), *texts))
    assert len({each.sha256() for each in found}) == 1
    assert set(found[0].identity()) - set(plain.identity()) == {"data.2.correlations.0"}
    assert found[0].data[2].correlations == ((found[0].data[0], 0.6),)
    assert "0.6 with data.0" in found[0].describe()
    stored = campaign_of_record(found[0].text, "stored", found[0].identity())
    assert stored.identity() == found[0].identity()


def test_several_data_correlate_in_pairs():
    data = Campaign.from_text(correlated("between: [0, 1, 2, 3], value: 0.5")).data
    assert [len(datum.correlations) for datum in data] == [0, 1, 2, 3]


def test_correlations_of_nothing_are_no_other_campaign():
    plain = Campaign.from_text(text_of(*NUMBERS)).sha256()
    assert Campaign.from_text(correlated("between: [0, 1], value: 0")).sha256() == plain


@pytest.mark.parametrize(
    ("entries", "field", "named"),
    [
        (["between: [d90, d60], value: 0.5"], "0.between.1", ("d60", "d90 by mass at the end")),
        (["between: [d90, 4], value: 0.5"], "0.between.1", ("4", "3 (temp")),
        (["between: [d90, -1], value: 0.5"], "0.between.1", ("-1", "0 (d50")),
        (["between: [d90, d50], value: 0.5"], "0.between.1", ("d50", "several", "place")),
        (["between: [0, 2], value: 1"], "0.value", ("1",)),
        (["between: [0, 2], value: -1.5"], "0.value", ("-1.5", "-1")),
        (["between: [0, 2], value: 5 K"], "0.value", ("'K'",)),
        (["between: [0, 2]"], "0.value", ("missing",)),
        (["between: [0], value: 0.5"], "0.between", ("two",)),
        (["between: d90, value: 0.5"], "0.between", ("d90", "list")),
        (["between: [2, d90], value: 0.5"], "0.between", ("data.2",)),
        (["between: [0, 2], value: 0.5", "between: [d90, 0], value: 0.5"], "1.between", ("once",)),
        (["between: [0, 1], value: 0.9", "between: [1, 2], value: 0.9"], "", ("-0.27", "0")),
    ],
)
def test_impossible_correlations_are_refused_with_line_and_field(entries, field, named):
    with pytest.raises(CampaignError) as caught:
        Campaign.from_text(correlated(*entries))
    [problem] = caught.value.problems
    assert problem.field == f"correlations.{field}".rstrip(".")
    assert problem.line is not None
    for part in named:
        assert part in problem.message


def test_a_size_curve_correlates_with_no_number(folder):
    path = folder / "c.yaml"
    text = path.read_text()
    for pair, value, named in (("sizes, d50", 0.5, "curve"), ("sizes, sizes", 0, "different")):
        path.write_text(f"{text}correlations: [{{between: [{pair}], value: {value}}}]\n")
        with pytest.raises(CampaignError, match=rf"c\.yaml:\d+: correlations\.0.*{named}"):
            load_campaign(path)


@pytest.mark.parametrize(
    ("entry", "is_same"),
    [
        ("quantity: d50, value: 214 um, error: 8 um", True),  # 213 µm by logarithms, 219 linear
        ("quantity: d90, value: 0.5 mm, error: 8 um", True),
        ("quantity: d43, value: 260 um, error: 8 um", True),
        ("quantity: mean_radius, weight: mass, value: 130 um, error: 8 um", True),
        ("quantity: d50, value: 230 um, error: 8 um", False),
        ("quantity: d50, weight: number, value: 214 um, error: 8 um", False),
        ("quantity: spread, value: 0.5, error: 8 percent", False),
    ],
)
def test_a_diameter_of_a_size_curve_does_not_stand_beside_it(folder, entry, is_same):
    """Unless it is stated that the two are measurements of their own, at one time."""
    path = folder / "c.yaml"
    text = path.read_text()
    own = f"  - {{{entry}, time: 2 ms}}\n"
    path.write_text(text.replace("objective:", f"{own}objective:"))
    if not is_same:
        assert len(load_campaign(path).data) == 6
        return
    with pytest.raises(CampaignError, match=r"data\.5: .*data\.0, sizes.*correlations"):
        load_campaign(path)
    path.write_text(path.read_text() + "correlations: [{between: [0, 5], value: 0}]\n")
    assert len(load_campaign(path).data) == 6
    path.write_text(text.replace("objective:", f"{own.replace('2 ms', '3 ms')}objective:"))
    assert len(load_campaign(path).data) == 6


def test_one_measurement_under_two_names_may_correlate():
    numbers = [f"{{{D50}}}", f"{{{D50}}}"]
    text = correlated("between: [0, 1], value: 0.5", numbers=numbers)
    assert len(Campaign.from_text(text).data) == 2


def test_a_temperature_needs_heat():
    cold = text_of("{quantity: temperature, value: 400 K, error: 1 K}")
    cold = cold.replace("heating: pair_split", "heating: none")
    cold = cold.replace("reaction: contact_area", "reaction: none")
    with pytest.raises(CampaignError, match=r"data\.0\.quantity: .*heating"):
        Campaign.from_text(cold)


def test_a_time_needs_an_end_that_every_string_reaches():
    assert Campaign.from_text(text_of(f"{{{D50}}}", end="characteristic")).data
    with pytest.raises(CampaignError) as caught:
        Campaign.from_text(text_of(f"{{{D50}, time: 1 ms}}", end="characteristic"))
    [problem] = caught.value.problems
    assert problem.field == "data.0.time"


@pytest.mark.parametrize(
    ("edit", "field", "named"),
    [
        (("sieve.csv", "none.csv"), "file", "none.csv"),
        ((", error: 2 percent}", "}"), "error", "missing"),
        (("error: 2 percent", "error: 0.02, column: Retained"), "column", "Passing"),
        (("error: 2 percent", "error: 0.02, unit: mm"), "unit", "mm"),
    ],
)
def test_what_is_wrong_with_a_file_is_said_at_its_entry(folder, edit, field, named):
    path = folder / "c.yaml"
    path.write_text(path.read_text().replace(*edit))
    with pytest.raises(CampaignError, match=rf"c\.yaml:27: data\.0\.{field}: .*{named}"):
        check_campaign(path)


def test_a_wrong_line_of_a_file_is_named(folder):
    (folder / "sieve.csv").write_text(SIEVES.replace("60", "95"))
    with pytest.raises(CampaignError, match=r"c\.yaml:27: .*'sieve\.csv': line 3, column 'Pass"):
        check_campaign(folder / "c.yaml")


def test_check_has_a_line_for_each_datum(folder):
    text = load_campaign(folder / "c.yaml").describe()
    _, _, below_heading = text.partition("\nData\n")
    sizes, mean, median, left, temperature = below_heading.splitlines()[:5]
    assert sizes.split(": ")[1] == "4 classes, 53 µm to 1 mm, sieve.csv"
    assert mean.endswith("120 µm ± 5 µm")
    assert "area" in median
    assert left.endswith("0.35 ± 0.05")
    assert temperature.endswith("410 K ± 10 K")
    (folder / "sieve.csv").write_text("Sieve (mm);Passing (%)\n0.5;90\n0.25;60\n0.125;25\n")
    assert "below 125 µm to above 500 µm" in load_campaign(folder / "c.yaml").describe()
    assert "\nData\n" not in campaign().describe()


def test_the_section_and_its_keys_are_explained():
    assert [topic.path[-1] for topic in below(("data",))] == list(DatumEntry.model_fields)
    [quantity] = find("data.quantity")
    assert all(name in quantity.allowed for name in QUANTITIES)
    assert quantity.default is None
    [weight] = find("data.weight")
    assert "mass" in (weight.default or "")
    assert " s" in find("data.time")[0].allowed


def test_a_percentage_is_relative_to_a_value_with_a_unit():
    made = Campaign.from_text(text_of("{quantity: d50, value: 140 um, error: 5 %}"))
    assert made.data[0].covariance[0, 0] == pytest.approx((7e-6) ** 2)
    made = Campaign.from_text(text_of("{quantity: particles_left, value: 0.5, error: 5 %}"))
    assert made.data[0].covariance[0, 0] == pytest.approx(0.05**2)


def test_a_measured_diameter_of_140_m_is_warned_of():
    far, near = (
        implausible(Campaign.from_text(text_of(f"{{quantity: d50, value: {value}, error: 5 %}}")))
        for value in ("140", "140 um")
    )
    assert [each.field for each in far if "data" in each.field] == ["data.0.value"]
    assert not any("data" in each.field for each in near)


@pytest.mark.parametrize("value", ["27 ± 1 degC", "27 1 degC"])
def test_a_value_with_a_second_number_is_refused(value):
    with pytest.raises(CampaignError, match="one number and its unit"):
        Campaign.from_text(text_of(f"{{quantity: temperature, value: {value}, error: 1 K}}"))
