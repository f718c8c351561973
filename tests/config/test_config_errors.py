"""Every error names the file, the line, the field, what is wrong and what is allowed."""

import pickle
from pathlib import Path

import pytest
from campaign_text import TEXT, campaign, edited

from agglom_mpi.config.campaign import Campaign, load_campaign
from agglom_mpi.config.yaml_source import CampaignError


def message(*edits: tuple[str, str]) -> str:
    with pytest.raises(CampaignError) as caught:
        campaign(*edits)
    return str(caught.value)


def test_the_unedited_text_is_valid() -> None:
    assert campaign().title == "A test"


SCENE = [
    ("  hardness: a", "  hardness: {}", "9: scene.hardness.law: is missing; allowed: arrhenius, "),
    ("  particles", "  particles: '100'", "4: scene.particles: is '100'; must be a whole number"),
    ("  particles", "  particles: 100.5", "4: scene.particles: is 100.5; must be a whole number"),
    ("  particles", "  particles: true", "4: scene.particles: is true; must be a whole number"),
    ("  particles", "  particles: 0", "4: scene.particles: is 0; at least 2 are needed for a coll"),
    ("  particles", "  particles: 1", "4: scene.particles: is 1; at least 2 are needed for a coll"),
    ("  particles", "  particles: -5", "4: scene.particles: is -5; must be at least 2"),
    ("  particles", "  particles: 10000001", "must be at most 10000000"),
    ("  half_width", "  half_width: -1 cm", "5: scene.half_width: is '-1 cm'; must be greater tha"),
    ("  half_width", "  half_width: .inf", "5: scene.half_width: is inf; must be a finite number"),
    ("  half_width", "  half_width: .nan", "5: scene.half_width: is nan; must be a finite number"),
    ("  half_width", "  half_width: 1e999 m", "is '1e999 m'; must be a finite number"),
    (
        "  half_width",
        "  half_width: 1e101",
        "5: scene.half_width: is 1e+101; must be 0 or in size between 1e-100 and 1e+100 m",
    ),
    ("  half_width", "  half_width: 1e-200 km", "is '1e-200 km'; must be 0 or in size between"),
    ("  half_width", "  half_width: yes", "is the text 'yes'; must be a number in m, or a text wi"),
    ("  half_width", "  half_width: true", "is true; must be a number in m, or a text with a unit"),
    ("  half_width", "  half_width: [1, 2]", "is [1, 2]; must be a number in m"),
    ("  half_width", "  half_width:", "5: scene.half_width: is empty; must be a number in m"),
    ("  half_width", "", "3: scene.half_width: is missing; half the cube's edge, like '1 cm'"),
    (
        "  half_width",
        "  half_widht: 1",
        "5: scene.half_widht: unknown key 'half_widht'; did you mean 'half_width'?",
    ),
    (
        "  half_width",
        "  half_width: 1\n  zzz: 1",
        "6: scene.zzz: unknown key 'zzz'; allowed: particles, half_width, escape, velocities",
    ),
    (
        "  velocities",
        "  velocities: uniform_y",
        "6: scene.velocities: is 'uniform_y'; allowed: uniform_x, spread",
    ),
    ("  velocities", "", "3: scene.velocities: is missing; allowed: uniform_x, spread"),
    (
        "  velocities",
        "  velocities: {law: spread, mean: [1, 2, 3 km]}",
        "6: scene.velocities.mean.2: wrong unit: 'km' is length, expected speed like 'm/s'",
    ),
    ("  velocities", "  velocities: {law: spread, mean: [1]}", "is [1]; has too few entries"),
    ("  velocities", "  velocities: {law: spread, mean: 1}", "mean: is 1; must be a list"),
    (
        "  velocities",
        "  velocities: uniform_x\n  escape: open",
        "7: scene.escape: is 'open'; allowed: periodic, reentry",
    ),
    (
        "  restitution",
        "  restitution: {law: constant, value: 1.5}",
        "7: scene.restitution.value: is 1.5; must be at most 1",
    ),
    ("  restitution", "  restitution: constant", "7: scene.restitution.value: is missing; the re"),
    (
        "  restitution",
        "  restitution: {law: constant, value: 0.9, contact_time: -1 us}",
        "7: scene.restitution.contact_time: is '-1 us'; must be at least 0",
    ),
    (
        "  restitution",
        "  restitution: {law: constant, value: 0.9, contact_time: 1 um}",
        "7: scene.restitution.contact_time: wrong unit: 'um' is length, expected time like 's'",
    ),
    (
        "  restitution",
        "  restitution: {law: constant, value: 0, contact_time: 1 us}",
        "7: scene.restitution.contact_time: is 1e-06 s; must be 0 with value 0, where nothing bou",
    ),
    (
        "  restitution",
        "  restitution: {law: pressure, contact_time: 1 us}",
        "7: scene.restitution.contact_time: unknown key 'contact_time'; allowed: law",
    ),
    (
        "  contact_area",
        "  contact_area: {initial: 2, final: 1}",
        "8: scene.contact_area.initial: is 2; must be at most final, which is 1",
    ),
    ("  contact_area", "  contact_area: {final: 0}", "final: is 0; must be greater than 0"),
    (
        "  hardness: a",
        "  hardness: steel",
        "scene.hardness: is 'steel'; allowed: arrhenius, constant",
    ),
    (
        "  friction: c",
        "  friction: 5",
        "10: scene.friction: is 5; must be the name of a law or a map",
    ),
    (
        "  cooling",
        "  cooling:\n    integration: exact\n    law: quartik",
        "15: scene.cooling.law: is 'quartik'; allowed: none, radiation, quartic",
    ),
    (
        "  cooling",
        "  cooling: {integration: exact}",
        "13: scene.cooling.law: is missing; allowed: none, radiation, quartic",
    ),
    ("  cooling", "  cooling: radiation", "13: scene.cooling.emissivity: is missing; 0 to 1"),
    (
        "  cooling",
        "  cooling: {law: quartic, emissivity: 1}",
        "13: scene.cooling.emissivity: unknown key 'emissivity'; allowed: law, integration",
    ),
    (
        "  cooling",
        "  cooling: {law: radiation, emissivity: 0.5, surroundings: 0 K, convection: 1}",
        "13: scene.cooling.ambient: is missing; the temperature that convection cools to",
    ),
    ("  end_time", "  end_time: soon", "14: scene.end_time: is 'soon'; must be `characteristic`"),
    ("  end_time", "  end_time: 0 s", "14: scene.end_time: is '0 s'; must be greater than 0 s"),
    (
        "  engine",
        "  engine: leapfrog",
        "15: scene.engine: is 'leapfrog'; allowed: event, fixed, adaptive",
    ),
    (
        "  engine",
        "  engine: {steps: 50}",
        "15: scene.engine.law: is missing; allowed: event, fixed, adaptive",
    ),
    (
        "  engine",
        "  engine: {law: event, budget: 0}",
        "15: scene.engine.budget: is 0; must be at least 1",
    ),
    (
        "  engine",
        "  engine: {law: event, budget: 10000000000}",
        "15: scene.engine.budget: is 10000000000; must be at most 1000000000",
    ),
    (
        "  engine",
        "  engine: {law: event, budget: 1e3}",
        "15: scene.engine.budget: is 1000.0; must be a whole number",
    ),
    (
        "  engine",
        "  engine: {law: event, steps: 5}",
        "15: scene.engine.steps: unknown key 'steps'; allowed: law, budget",
    ),
    (
        "  engine",
        "  engine: {law: fixed, steps: 0}",
        "15: scene.engine.steps: is 0; must be at le",
    ),
    (
        "  engine",
        "  engine: {law: adaptive, steps: 5}",
        "15: scene.engine.steps: unknown key 'steps'; allowed: law, floor, ceiling",
    ),
    (
        "  engine",
        "  engine: {law: adaptive, floor: 1 s}",
        "15: scene.engine.floor: is 1 s; must be at most ceiling, which is 0.001 s",
    ),
    (
        "  heating",
        "  heating: none",
        "12: scene.reaction: is 'contact_area', but heating is",
    ),
]

VARIABLES = [
    ("  density", "  density: [1, 2, 3]", "19: variables.density: is [1, 2, 3]; must be one value"),
    ("  density", "  density: [5, 5]", "is [5, 5]; the lower end must be less than the upper"),
    ("  density", "  density: [5, 4]", "is [5, 4]; the lower end must be less than the upper"),
    ("  density", "  density: 1e-320", "is 1e-320; must be 0 or in size between 1e-100 and 1e+100"),
    ("  density", "  density: 0", "19: variables.density: is 0; must be greater than 0 kg/m^3"),
    ("  relative_speed", "  relative_speed: [-1, 1]", "is -1; must be 0 m/s or more"),
    (
        "  temperature",
        "  temperature: 0",
        "23: variables.temperature: is 0; must be above",
    ),
    ("  temperature", "  temperature: -273.15 degC", "is '-273.15 degC'; must be above absolute"),
    ("  friction: 0", "  friction: 1 Pa", "wrong unit: 'Pa' is pressure, expected a pure number"),
    (
        "  hardness: [",
        "  hardness: [10 J, 200 MPa]",
        "20: variables.hardness: wrong unit: 'J' is energy, expected pressure like 'Pa'",
    ),
    ("  friction: 0", "  friction: 3 dB", "is '3 dB'; cannot be converted to '1'"),
    ("  hardness: [", "  hardness: 3 MPA", "20: variables.hardness: unknown unit 'MPA'"),
    ("  hardness: [", "  hardness: 3 MPa)", "20: variables.hardness: 'MPa)' is not a unit"),
    ("  hardness: [", "  hardness: '1e6'", "is the text '1e6', a number in quotes; leave out the"),
    (
        "  hardness: [",
        "",
        "16: variables.hardness: is missing; needed by restitution: pressure; a value or a range",
    ),
    ("  friction: 0", "", "16: variables.friction: is missing; needed by friction: constant"),
    ("  activation", "", "variables.activation_energy: is missing; needed by hardness: arrhenius"),
    (
        "  reaction_heat",
        "",
        "variables.reaction_heat: is missing; needed by reaction: contact",
    ),
    ("  heat_capacity", "", "variables.heat_capacity: is missing; needed by heating: pair_split"),
    ("  size_ratio", "", "variables.size_ratio: is missing; needed by every scene"),
    ("  density", "  densty: 1", "variables.densty: unknown key 'densty'; did you mean 'density'?"),
    (
        "  reaction_heat",
        "  reaction_heat: 1\n  surface_energy: [1, 2]",
        "26: variables.surface_energy: is a range, but the scene has no fragmentation; nothing",
    ),
    (
        "  size_ratio",
        "  size_ratio: [0.4, 0.95]",
        "18: variables.size_ratio: is 0.95, a volume fraction of 0.449; random placement jams near "
        "0.38, so at most 0.8986",
    ),
    ("  size_ratio", "  size_ratio: 1e60", "is 1e+60, a volume fraction of 5.24e+179; random"),
]

PLAN = [
    ("seed", "seed: -1", "2: seed: is -1; must be at least 0"),
    ("seed", "seed: 9223372036854775808", "2: seed: is 9223372036854775808; must be less than"),
    ("title", "title: 3", "1: title: is 3; must be a text; put it in quotes"),
    ("objective", "objective: best", "26: objective: is 'best'; allowed: growth_target, maximum_"),
    (
        "objective",
        "objective: {law: growth_target, ratio: 5}",
        "26: objective.ratio: is 5; 100 grains in one give 4.642, which is the most",
    ),
    (
        "search",
        "search: {population: 12, parents: 8}",
        "27: search.parents: is 8; parents and as many offspring must fit into the population of "
        "12, so at most 6",
    ),
    ("search", "search: {parents: 3}", "27: search.parents: is 3; must be a multiple of 2"),
    ("search", "search: {population: 5}", "27: search.parents: is 6; parents and as many"),
    ("search", "search: {blend: [1, 0]}", "27: search.blend: is [1, 0]; the lower end must"),
    ("search", "search: {rescale: {every: 4}}", "27: search.rescale.factor: is missing; between"),
    (
        "search",
        "search: {rescale: {every: 4, factor: 1}}",
        "27: search.rescale.factor: is 1; must be less than 1",
    ),
    ("  rule", "  rule: luck", "29: ensemble.rule: is 'luck'; allowed: successive_difference, mom"),
    ("  rule", "", "28: ensemble.rule: is missing; allowed: successive_difference, moments, stan"),
    ("  rule", "  rule: successive_difference\n  order: 3", "30: ensemble.order: unknown key"),
    ("  rule", "  rule: moments\n  order: 5", "30: ensemble.order: is 5; must be at most 4"),
    ("  max_samples", "", "28: ensemble.max_samples: is missing; the most samples of a string"),
    ("  max_samples", "  max_samples: 1", "31: ensemble.max_samples: is 1; must be at least 2"),
    (
        "  max_samples",
        "  max_samples: 4\n  min_samples: 5",
        "32: ensemble.min_samples: is 5; must be at most max_samples, 4",
    ),
    ("  tolerance", "  tolerance: 0", "30: ensemble.tolerance: is 0; must be greater than 0"),
    ("  generations", "  generations: 0", "33: stopping.generations: is 0; must be at least 1"),
    (
        "  target",
        "  target: {top: 13, objective: 1e-3}",
        "34: stopping.target.top: is 13; must be at most the population, 12",
    ),
    ("  target", "  target: 5", "34: stopping.target: is 5; must be a mapping"),
    ("title", "outputs: {file: a.h5}", "1: outputs: unknown key 'outputs'; did you mean 'output'?"),
    ("title", "output: a.h5", "1: output: is 'a.h5'; must be a mapping"),
    *(
        ("title", f"output: {{{entry}}}", f"1: output.{expected}")
        for entry, expected in (
            ("final_particles: 1", "final_particles: is 1; must be true or false"),
            ("final_particles: yes", "final_particles: is 'yes'; must be true or false"),
            ("final_particles: {}", "final_particles: is a mapping; must be true or false"),
            ("frames: 5", "frames: is 5; must be a mapping"),
            ("frames: true", "frames: is true; must be a mapping"),
            ("frames: {}", "frames.count: is missing; pictures of each sample"),
            ("frames: {count: 0}", "frames.count: is 0; must be at least 1"),
            ("frames: {count: 2.5}", "frames.count: is 2.5; must be a whole number"),
            ("frames: {count: 100001}", "frames.count: is 100001; must be at most 100000"),
            ("frames: {count: 5, strings: 0}", "frames.strings: is 0; must be at least 1"),
            ("frames: {count: 5, samples: -1}", "frames.samples: is -1; must be at least 1"),
            ("frames: {count: 5, strings: none}", "frames.strings: is 'none'; must be a whole n"),
            (
                "frames: {count: 5, sample: 1}",
                "frames.sample: unknown key 'sample'; did you mean 'samples'?",
            ),
            ("frame: {count: 5}", "frame: unknown key 'frame'; did you mean 'frames'?"),
        )
    ),
]


@pytest.mark.parametrize(("begin", "replacement", "expected"), SCENE + VARIABLES + PLAN)
def test_a_wrong_entry_is_located_and_explained(
    begin: str, replacement: str, expected: str
) -> None:
    lines = message((begin, replacement)).splitlines()
    assert any(line.startswith("campaign.yaml:") and expected in line for line in lines), lines


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("", "campaign.yaml: is empty; a campaign needs a scene"),
        ("# only a comment\n", "campaign.yaml: is empty; a campaign needs a scene"),
        ("- a\n- b\n", "campaign.yaml:1: must be a mapping of sections such as `scene:`"),
        ("a: [1, 2\nb: 3\n", "campaign.yaml:2: not valid YAML: expected ',' or ']', but got ':'"),
        ("a: 1\n\tb: 2\n", "campaign.yaml:2: not valid YAML: "),
        ("title: a\x01\n", "campaign.yaml:1: not valid YAML: the character U+0001 is not allowed"),
        ("a: 1\n---\nb: 2\n", "campaign.yaml:2: not valid YAML: but found another document"),
        ("a: &x [*x]\n", "is nested too deeply or too long"),
        ("[" * 5000, "campaign.yaml: is nested too deeply"),
        ("1: 2\n", "campaign.yaml:1: has a key that is not a word"),
        ("a: !!python/object:os.system x\n", "campaign.yaml:1: a: cannot read 'x'"),
        (TEXT + "seed: 8\n", "campaign.yaml:35: duplicate key 'seed'; it is already given in line"),
        (
            edited(("  friction: c", "  friction: none\n  particles: 2")),
            "campaign.yaml:11: scene: duplicate key 'particles'; it is already given in line 4",
        ),
        ("title: a\n", "campaign.yaml:1: scene: is missing; the section on what is simulated"),
    ],
)
def test_a_text_that_is_no_campaign_is_one_message(text: str, expected: str) -> None:
    with pytest.raises(CampaignError) as caught:
        Campaign.from_text(text)
    assert expected in str(caught.value)


def test_an_alias_that_multiplies_without_end_is_refused() -> None:
    levels = [f"k{n}: &k{n} [{', '.join([f'*k{n - 1}'] * 9)}]" for n in range(1, 9)]
    with pytest.raises(CampaignError, match="too long"):
        Campaign.from_text("\n".join(["k0: &k0 1", *levels]))


def test_all_problems_are_reported_in_the_order_of_the_file() -> None:
    edits = (
        ("seed", "seed: x"),
        ("  density", "  density: 1 J"),
        ("  particles", "  particles: 1"),
    )
    places = [line.split(": ")[0:2] for line in message(*edits).splitlines()]
    assert places == [
        ["campaign.yaml:2", "seed"],
        ["campaign.yaml:4", "scene.particles"],
        ["campaign.yaml:19", "variables.density"],
    ]


def test_missing_variables_are_reported_beside_errors_elsewhere() -> None:
    text = message(("  density", ""), ("  generations", "  generations: 0"))
    assert "variables.density" in text
    assert "stopping.generations" in text


def test_constant_restitution_refuses_what_needs_the_hardness() -> None:
    text = message(("  restitution", "  restitution: {law: constant, value: 0.9}"))
    assert "9: scene.hardness: is 'arrhenius', but constant restitution has no hardness" in text
    assert "14: scene.end_time: is 'characteristic', which needs the critical speed" in text


EULER = "cooling: {law: quartic, integration: euler}"


@pytest.mark.parametrize("engine", ["  engine: event", "  engine: {law: event, budget: 9}", ""])
def test_the_event_engine_has_no_steps_to_cool_by(engine: str) -> None:
    assert message(("  cooling", f"  {EULER}"), ("  engine", engine)) == (
        "campaign.yaml:13: scene.cooling.integration: is 'euler', which needs time steps, but the "
        "engine is 'event'; allowed: exact, or euler with engine fixed or adaptive"
    )


@pytest.mark.parametrize("engine", ["fixed", "adaptive"])
def test_steppers_may_cool_by_steps(engine: str) -> None:
    loaded = campaign(("  cooling", f"  {EULER}"), ("  engine", f"  engine: {engine}"))
    assert loaded.scene.cooling.model_dump() == {"law": "quartic", "integration": "euler"}


@pytest.mark.parametrize("cooling", ["quartic", "{law: quartic, integration: exact}", "none"])
def test_the_event_engine_cools_exactly(cooling: str) -> None:
    campaign(("  cooling", f"  cooling: {cooling}"), ("  engine", "  engine: event"))


def test_a_message_stays_on_one_line_and_short() -> None:
    text = message(("  half_width", '  half_width: "a\\nb' + "x" * 500 + '"'))
    assert len(text.splitlines()) == 1
    assert len(text) < 250


def test_file_problems_are_one_message(tmp_path: Path) -> None:
    with pytest.raises(CampaignError, match=r"gone\.yaml: no such file$"):
        load_campaign(tmp_path / "gone.yaml")
    with pytest.raises(CampaignError, match="is a directory"):
        load_campaign(tmp_path)
    (tmp_path / "latin.yaml").write_bytes(b"seed: 1\ntitle: \xe9\n")
    with pytest.raises(CampaignError, match=r"latin\.yaml:2: is not UTF-8 text: byte 0xe9"):
        load_campaign(tmp_path / "latin.yaml")


def test_an_error_survives_pickling() -> None:
    with pytest.raises(CampaignError) as caught:
        campaign(("seed", "seed: x"))
    assert str(pickle.loads(pickle.dumps(caught.value))) == str(caught.value)


@pytest.mark.parametrize("escape", [r"\0", r"\n", r"\ud83d"])
def test_a_title_that_cannot_be_printed_is_one_message(escape: str) -> None:
    said = message(("title: A test", f'title: "a{escape}b"'))
    assert "title: " in said
    assert "cannot be printed" in said
    assert "\n" not in said
