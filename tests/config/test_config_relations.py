"""Derived quantities and constraints: what they are worth, and every mistake in them."""

import numpy as np
import pytest
from campaign_text import campaign, edited

from agglom_mpi.analysis.estimates import Estimate
from agglom_mpi.config.campaign import Campaign
from agglom_mpi.config.expressions import evaluate
from agglom_mpi.config.quantities import CONSTANTS, QUANTITIES
from agglom_mpi.config.relations import COLUMNS, MAX_ENTRIES
from agglom_mpi.config.searchable import check_searchable, log_narrow
from agglom_mpi.config.yaml_source import CampaignError
from agglom_mpi.physics import scales
from agglom_mpi.storage.schema import RESULTS, SAMPLES, generations_schema, strings_schema
from agglom_mpi.variables import TEN

DERIVED = "derived: {pressure: density * relative_speed^2, power: pressure / end_time}"
CONSTRAINT = "constraints: [pressure < 0.1 * hardness]"


def with_relations(*lines):
    return campaign(("objective", "\n".join([*lines, "objective: {law: growth_target, ratio: 2}"])))


def message(*lines, edits=()):
    text = edited(("objective", "\n".join([*lines, "objective: growth_target"])), *edits)
    with pytest.raises(CampaignError) as caught:
        Campaign.from_text(text)
    return str(caught.value)


def test_derived_quantities_are_worth_what_they_say():
    loaded = with_relations(DERIVED)
    string = loaded.parameters({"relative_speed": 7})
    value = TEN.values_by_name(string)
    found = loaded.derived_values(string[None])
    assert found["pressure"] == 6000 * 49
    end = scales.end_time(loaded.scene, value)
    assert found["power"] == pytest.approx(6000 * 49 / end, rel=1e-14)
    assert [each.unit for each in loaded.relations.derived] == ["Pa", "W/m^3"]


def test_every_quantity_of_a_scene_may_be_named():
    names = [*(quantity.name for quantity in QUANTITIES), *CONSTANTS]
    entries = ", ".join(f"twice_{name}: 2 * {name}" for name in names)
    loaded = with_relations(f"derived: {{{entries}}}")
    found = loaded.derived_values(np.tile(loaded.parameters(), (3, 1)))
    value = TEN.values_by_name(loaded.parameters())
    assert found["twice_grain_diameter"] == pytest.approx(
        4.0 * scales.grain_radius(loaded.scene, value)
    )
    assert found["twice_grain_mass"] == pytest.approx(2.0 * scales.grain_mass(loaded.scene, value))
    assert found["twice_expected_collisions"] == pytest.approx(
        2.0 * scales.expected_collisions(loaded.scene, value)
    )
    assert all(values.shape == (3,) and np.all(values > 0.0) for values in found.values())


def test_a_constant_may_be_a_plain_number_or_have_a_unit():
    loaded = with_relations("derived: {most: 5 MPa, half: 0.5, count: 3, scaled: most * half}")
    found = {name: float(v[0]) for name, v in loaded.derived_values(np.ones((1, 10))).items()}
    assert found == {"most": 5e6, "half": 0.5, "count": 3.0, "scaled": 2.5e6}


def test_strings_are_allowed_by_all_constraints_whatever_the_names():
    loaded = with_relations(DERIVED, "constraints: [pressure < 0.1 * hardness, hardness > 50 MPa]")
    speed, hardness = np.array([1.0, 30.0, 1.0]), np.array([1e8, 1e8, 1e7])
    allowed = loaded.allowed({"relative_speed": speed, "hardness": hardness})
    assert allowed.tolist() == [True, True, False]
    assert loaded.allowed({"relative_speed": 50.0, "hardness": 1e8}).tolist() == [False]
    with pytest.raises(CampaignError, match=r"speed: .* did you mean 'relative_speed'"):
        loaded.allowed({"speed": speed})


def test_the_identity_holds_the_constraints_but_not_how_they_are_spelled():
    plain = campaign().identity()
    assert with_relations(DERIVED).identity() == plain
    loaded = with_relations(DERIVED, CONSTRAINT).identity()
    other = with_relations(
        "derived: {p: density * (relative_speed**2)}", "constraints: ['p < 0.10*hardness']"
    )
    assert other.identity() == loaded
    assert {key for key in loaded if key not in plain} == {"constraints.0"}
    assert loaded["constraints.0"] == "(density * (relative_speed ** 2.0)) < (0.1 * hardness)"


@pytest.mark.parametrize(
    ("lines", "said"),
    [
        (["derived: [1]"], "derived: is [1]; must be a mapping like {pressure: density * speed^2}"),
        (["derived: {density: 1}"], "derived.density: is the name of a variable; choose another"),
        (["derived: {volume_fraction: 1}"], "is the name of a variable; choose another"),
        (["derived: {end_time: 1}"], "is the name of a quantity that every scene has; choose"),
        (["derived: {pi: 3}"], "is the name of a quantity that every scene has; choose another"),
        (["derived: {objective: 1}"], "is the name of a column of the tables; choose another"),
        (
            ["derived: {Pressure: 1}"],
            "is no name for a quantity; must be small letters, digits and _, a letter first",
        ),
        (["derived: {p: [1]}"], "derived.p: is [1]; must be a text like '0.5 * density'"),
        (["constraints: [null]"], "must be a text like 'pressure < 0.1 * hardness'"),
        (["derived: {p: }"], "derived.p: is empty; must be a text like '0.5 * density'"),
        (["derived: {p: densty}"], "has the unknown name 'densty'; did you mean 'density'?"),
        (["derived: {p: 2 * surface_energy}"], "names 'surface_energy', on which this scene does"),
        (["derived: {p: q, q: 2 * p}"], "is defined by itself: p -> q -> p"),
        (["derived: {p: p}"], "derived.p: is defined by itself: p -> p"),
        (
            ["derived: {p: density + hardness}"],
            "does not fit together in 'density + hardness': 'density' is density, 'hardness' is",
        ),
        (["derived: {p: exp(density)}"], "which has 'exp(density)'"),
        (["constraints: pressure < 1"], "constraints: is 'pressure < 1'; must be a list of texts"),
        (["constraints: []"], "constraints: is []; must be a list of texts like ['pressure"),
        (["constraints: [3]"], "constraints.0: is '3'; must compare two quantities by <"),
        (["constraints: [density]"], "constraints.0: is 'density'; must compare two quantities"),
        (["constraints: [density < 5]"], "'5' is a pure number; write a number with its unit"),
        (["constraints: [2 < 3]"], "constraints.0: is '2 < 3', which depends on nothing"),
        (["constraints: [surface_energy > 0]"], "names 'surface_energy', on which this scene"),
        (
            ["constraints: [relative_speed > 0, relative_speed < 1 km]"],
            "constraints.1: does not fit together in a comparison: 'relative_speed' is speed, "
            "'1 km' is length",
        ),
    ],
)
def test_a_mistake_is_located_and_explained(lines, said):
    text = message(*lines)
    assert said in text
    assert text.startswith("campaign.yaml:26: ")
    assert len(text.splitlines()) == 1


def test_too_many_entries_and_too_large_ones_are_refused():
    many = ", ".join(f"x{i}: 1" for i in range(MAX_ENTRIES + 1))
    assert "has 31 entries; must be at most 30" in message(f"derived: {{{many}}}")
    doubled = ", ".join(f"x{i}: x{i - 1} + x{i - 1}" for i in range(1, 29))
    said = message(f"derived: {{x0: density, {doubled}}}")
    assert "derived.x9: is too long; at most 1000 terms with all written out" in said
    assert "has 31 entries" in message(f"constraints: [{', '.join(['density > 0'] * 31)}]")


def test_a_mistake_in_the_scene_is_not_taken_for_one_in_what_is_derived():
    text = message(DERIVED, CONSTRAINT, edits=[("  particles", "  particles: 0")])
    assert "scene.particles" in text
    assert len(text.splitlines()) == 1


def test_given_strings_satisfy_the_constraints():
    start = [("search", "search:\n  start:\n    - {hardness: 2e8}\n    - {relative_speed: 30}")]
    said = message(DERIVED, "constraints: [relative_speed < 20 m/s]", edits=start)
    assert "search.start.1: does not satisfy the constraint 'relative_speed < 20 m/s'" in said


def test_constraints_that_allow_nothing_are_refused_and_those_that_allow_little_warn():
    nothing = with_relations("constraints: [relative_speed > 31 m/s]")
    with pytest.raises(CampaignError) as caught:
        check_searchable(nothing)
    said = "constraints: allow no string of 262,144 of the box; must allow at least 0.01% of it"
    assert said in str(caught.value)
    little = with_relations("constraints: [relative_speed > 29.98 m/s]")
    warning = str(*check_searchable(little))
    assert warning.startswith("campaign.yaml:26: constraints: allow 0.0")
    assert warning.endswith("of the box; a narrower box is searched better")
    assert check_searchable(with_relations("constraints: [relative_speed > 29 m/s]")) == []


def test_that_constraints_allow_little_is_logged_for_commands_without_a_check(caplog):
    log_narrow(with_relations("constraints: [relative_speed > 29.98 m/s]"))
    [line] = [record.getMessage() for record in caplog.records]
    assert line.startswith("warning: campaign.yaml:26: constraints: allow 0.0")


def test_the_share_that_is_said_is_the_share():
    text = with_relations("constraints: [relative_speed > 22.525 m/s]").describe()  # a quarter
    [line] = [line for line in text.splitlines() if "allowed:" in line]
    share, error = (float(word) for word in line.replace("(±", "").split()[1:4:2])
    assert abs(share - 25.0) < 4.0 * error
    assert error == 0.3


def test_no_derived_quantity_has_the_name_of_a_column():
    tables = (strings_schema(), RESULTS, SAMPLES, generations_schema(1))
    columns = {field.name for table in tables for field in table.fields} | set(Estimate._fields)
    reserved = COLUMNS | set(TEN.names) | {"particles", "end_time"}
    assert columns - reserved == set()


def test_a_wide_tree_of_names_takes_no_time():
    doubled = ", ".join(f"x{i}: x{i - 1} + x{i - 1}" for i in range(1, 7))
    loaded = with_relations(f"derived: {{x0: density, {doubled}}}")
    assert loaded.derived_values(np.ones((1, 10)))["x6"] == 64.0
    assert evaluate(loaded.relations.derived[0].tree, {"density": 3.0}) == 3.0
