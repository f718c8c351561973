"""Named quantities of an objective's function: their declaration, and the function of means."""

import pickle

import pytest
from campaign_text import campaign, edited

from agglom_mpi.config.campaign import Campaign
from agglom_mpi.config.loading import check_campaign, load_campaign
from agglom_mpi.config.user_function import recorded_function
from agglom_mpi.config.yaml_source import CampaignError
from agglom_mpi.errors import CodeNotAllowedError
from agglom_mpi.outcome import FAILED_SUMMARY
from agglom_mpi.search.objectives.objective import Objective

CALL = "law: function, call: 'shape:worth'"
MEANS = "of_means: 'shape:value'"
LINE = edited().splitlines().index("objective: {law: growth_target, ratio: 2}") + 1


def declared(rest):
    return ("objective", f"objective: {{{CALL}, {rest}}}")


def message(rest, *edits):
    """The one message on an objective, without its file and line."""
    with pytest.raises(CampaignError) as caught:
        campaign(declared(rest), *edits)
    text = str(caught.value)
    assert "\n" not in text
    place = f"campaign.yaml:{LINE}: objective."
    assert text.startswith(place)
    return text.removeprefix(place)


def units(quantities):
    return campaign(declared(f"quantities: {quantities}, {MEANS}")).objective.quantity_units


def test_names_have_units_or_are_pure_numbers_and_are_sorted():
    assert list(units("{spread: 1, loss: kg}").items()) == [("loss", "kg"), ("spread", "1")]
    assert units("[spread, loss]") == {"loss": "1", "spread": "1"}
    assert units("{speed: m/s, power: W, flux: kg/m^2/s, torque: N*m}") == {
        "speed": "m/s",
        "power": "W",
        "flux": "kg/m^2/s",
        "torque": "N*m",
    }


WRONG = [
    ("quantities: {}", "quantities:", "is a mapping", "names"),
    ("quantities: []", "quantities:", "is []"),
    ("quantities: loss", "quantities:", "is 'loss'"),
    ("quantities: 3", "quantities:", "is 3"),
    ("quantities: ", "quantities:", "is empty"),
    ("quantities: [a, a]", "quantities:", "'a' twice"),
    ("quantities: [a, 3]", "quantities:", "is ['a', 3]"),
    ("quantities: {loss: g}", "quantities.loss:", "is 'g'", "kg"),
    ("quantities: {loss: degC}", "quantities.loss:", "is 'degC'"),
    ('quantities: {loss: ""}', "quantities.loss:", "is empty"),
    ("quantities: {loss: '%'}", "quantities.loss:", "is '%'"),
    ("quantities: {loss: kgs}", "quantities.loss:", "is 'kgs'", "unknown unit"),
    ("quantities: {loss: 2}", "quantities.loss:", "is 2"),
    ("quantities: {loss: true}", "quantities.loss:", "is true"),
    ("quantities: {loss: {unit: kg}}", "quantities.loss:", "is a mapping"),
    ("quantities: {Loss: kg}", "quantities.Loss:", "small letters"),
    ("quantities: {a-b: kg}", "quantities.a-b:", "small letters"),
    ("quantities: {objective: 1}", "quantities.objective:", "column"),
    ("quantities: {seconds: s}", "quantities.seconds:", "column"),
    ("quantities: {mean_radius_ratio: 1}", "quantities.mean_radius_ratio:", "column"),
    ("quantities: {hardness: Pa}", "quantities.hardness:", "variable"),
    ("quantities: {grain_radius: m}", "quantities.grain_radius:", "every scene has"),
]


@pytest.mark.parametrize(("rest", "field", "words"), [(r, f, w) for r, f, *w in WRONG])
def test_a_wrong_declaration_is_one_message_at_its_field(rest, field, words):
    said = message(f"{rest}, {MEANS}")
    assert said.startswith(field)
    assert all(word in said for word in words), said


def test_a_name_whose_columns_are_those_of_another_is_refused():
    with pytest.raises(CampaignError) as caught:
        campaign(declared(f"quantities: [loss, loss_standard_error], {MEANS}"))
    said = str(caught.value).splitlines()
    names = ("loss", "loss_standard_error")
    for line, name in zip(said, names, strict=True):
        place = f"campaign.yaml:{LINE}: objective.quantities.{name}: "
        assert line.startswith(f"{place}has a column loss_standard_error")
    key, line = declared(f"quantities: [loss], {MEANS}")
    derived = "derived: {loss: 2 * density}"
    with pytest.raises(CampaignError, match=r"objective.quantities.loss: has a column loss"):
        campaign((key, f"{derived}\n{line}"))


@pytest.mark.parametrize(
    ("rest", "field"),
    [
        ("quantities: [loss]", "of_means: is missing"),
        (MEANS, "of_means: is 'shape:value'; needs `quantities`"),
        ("quantities: [loss], of_means: value", "of_means: is 'value'; must be module:function"),
        ("quantities: [loss], of_means: 'other:value'", "of_means: is 'other:value'; must be a fu"),
    ],
)
def test_quantities_and_the_function_of_their_means_belong_together(rest, field):
    assert message(rest).startswith(field)


@pytest.fixture
def written(tmp_path):
    """A campaign file with quantities, and the module of its functions."""
    (tmp_path / "shape.py").write_text(
        "loaded = []\ndef worth(sample): return {'loss': 1.0}\ndef value(means): return 2.0\n"
    )
    rest = declared(f"quantities: {{loss: kg}}, {MEANS}")
    (tmp_path / "own.yaml").write_text(edited(rest))
    return tmp_path / "own.yaml"


def test_the_identity_has_units_and_function_and_a_recorded_campaign_is_the_same(written):
    allowed, checked = load_campaign(written, allow_code=True), check_campaign(written)
    identity = allowed.identity()
    assert {key: identity[key] for key in identity if key.startswith("objective")} == {
        "objective.law": "function",
        "objective.call": "shape:worth",
        "objective.quantities.loss": "kg",
        "objective.of_means": "shape:value",
        "objective.source_sha256": allowed.user_function.module.sha256,
    }
    assert checked.identity() == identity
    recorded = Campaign.from_text(allowed.text, "file.h5", recorded_function(identity))
    assert recorded.sha256() == allowed.sha256()
    one = FAILED_SUMMARY._replace(quantities=(1.0,))
    with pytest.raises(CodeNotAllowedError):
        recorded.objective.influence_values([one])
    assert allowed.objective.influence_values([one]).tolist() == [2.0]
    entries = {"law": "function", "call": "shape:worth", "quantities": {"loss": "kg"}}
    objective = Objective.of_entries(entries | {"of_means": "shape:value"})
    assert objective.entries() == recorded.objective.entries()
    assert objective.quantity_units == {"loss": "kg"}


def test_the_order_of_the_names_does_not_matter(written):
    text = written.read_text()
    both = [
        Campaign.from_text(text.replace("{loss: kg}", names), str(written)).objective
        for names in ("{loss: kg, spread: 1}", "{spread: 1, loss: kg}")
    ]
    assert both[0] == both[1]
    assert hash(both[0]) == hash(both[1])


def test_a_campaign_with_its_functions_can_be_sent_to_other_ranks(written):
    sent = pickle.loads(pickle.dumps(load_campaign(written, allow_code=True)))
    one = FAILED_SUMMARY._replace(quantities=(1.0,))
    assert sent.objective.influence_values([one]).tolist() == [2.0]


def test_functions_of_one_module_share_it_and_a_missing_one_is_named(written):
    load_campaign(written, allow_code=True)
    written.write_text(written.read_text().replace("shape:value", "shape:nothing"))
    with pytest.raises(CampaignError) as caught:
        load_campaign(written, allow_code=True)
    assert str(caught.value).startswith(f"{written}:{LINE}: objective.of_means: is 'shape:nothing'")
    assert "\n" not in str(caught.value)


def test_a_scene_alone_takes_quantities_too(written):
    lines = written.read_text().splitlines()
    objective = next(line for line in lines if line.startswith("objective"))
    from agglom_mpi.config.document import parse_campaign, read_document

    scene = "\n".join(lines[: lines.index(next(x for x in lines if x.startswith("variables")))])
    fixed = "variables: {relative_speed: 2, size_ratio: 0.5, density: 6000, hardness: 1e8,"
    fixed += " heat_capacity: 1000, friction: 0.3, temperature: 300, activation_energy: 700,"
    fixed += " reaction_heat: 5e6}"
    source = parse_campaign(f"{scene}\n{fixed}\n{objective}\n", "scene.yaml")
    document, *_ = read_document(source)
    assert document.objective.quantity_units == {"loss": "kg"}
    assert document.plan is None
