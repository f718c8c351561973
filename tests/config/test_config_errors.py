"""Every error names the file, the line, the field, what is wrong and what is allowed."""

import pickle
from pathlib import Path

import pytest
from campaign_text import TEXT, campaign, edited

from agglom_mpi.config.campaign import Campaign
from agglom_mpi.config.loading import load_campaign
from agglom_mpi.config.yaml_source import CampaignError


def message(*edits: tuple[str, str]) -> str:
    with pytest.raises(CampaignError) as caught:
        campaign(*edits)
    return str(caught.value)


def test_the_unedited_text_is_valid() -> None:
    assert campaign().title == "A test"


SCENE = [
    (
        "  hardness: a",
        "  hardness: {}",
        ("9: scene.hardness.law:", "is missing", "allowed: arrhenius"),
    ),
    ("  particles", "  particles: '100'", ("4: scene.particles:", "is '100'", "whole number")),
    ("  particles", "  particles: 100.5", ("4: scene.particles:", "is 100.5", "whole number")),
    ("  particles", "  particles: true", ("4: scene.particles:", "is true", "whole number")),
    ("  particles", "  particles: 0", ("4: scene.particles:", "is 0", "at least 2")),
    ("  particles", "  particles: 1", ("4: scene.particles:", "is 1", "at least 2")),
    ("  particles", "  particles: -5", ("4: scene.particles:", "is -5", "at least 2")),
    ("  particles", "  particles: 10000001", ("at most 10000000",)),
    ("  half_width", "  half_width: -1 cm", ("5: scene.half_width:", "is '-1 cm'")),
    ("  half_width", "  half_width: .inf", ("5: scene.half_width:", "is inf", "finite number")),
    ("  half_width", "  half_width: .nan", ("5: scene.half_width:", "is nan", "finite number")),
    ("  half_width", "  half_width: 1e999 m", ("is '1e999 m'", "finite number")),
    (
        "  half_width",
        "  half_width: 1e101",
        ("5: scene.half_width:", "is 1e+101", "1e+100", "between 1e-100"),
    ),
    ("  half_width", "  half_width: 1e-200 km", ("is '1e-200 km'", "between")),
    ("  half_width", "  half_width: yes", ("is the text 'yes'", "a number in m")),
    ("  half_width", "  half_width: true", ("is true", "a number in m")),
    ("  half_width", "  half_width: [1, 2]", ("is [1, 2]", "a number in m")),
    ("  half_width", "  half_width:", ("5: scene.half_width:", "is empty", "a number in m")),
    ("  half_width", "", ("3: scene.half_width:", "is missing", "'1 cm'")),
    (
        "  half_width",
        "  half_widht: 1",
        ("5: scene.half_widht:", "unknown key 'half_widht'", "'half_width'"),
    ),
    (
        "  half_width",
        "  half_width: 1\n  zzz: 1",
        ("6: scene.zzz:", "unknown key 'zzz'", "allowed: particles, half_width, grain_diameter"),
    ),
    (
        "  velocities",
        "  velocities: uniform_y",
        ("6: scene.velocities:", "is 'uniform_y'", "allowed: uniform_x, spread"),
    ),
    ("  velocities", "", ("3: scene.velocities:", "is missing", "allowed: uniform_x, spread")),
    (
        "  velocities",
        "  velocities: {law: spread, mean: [1, 2, 3 km]}",
        ("6: scene.velocities.mean.2:", "wrong unit", "'km'", "'m/s'"),
    ),
    ("  velocities", "  velocities: {law: spread, mean: [1]}", ("is [1]", "must have 3 entries")),
    ("  velocities", "  velocities: {law: spread, mean: 1}", ("mean:", "is 1", "a list")),
    (
        "  velocities",
        "  velocities: uniform_x\n  escape: open",
        ("7: scene.escape:", "is 'open'", "allowed: periodic, shear, reentry"),
    ),
    (
        "  restitution",
        "  restitution: {law: constant, value: 1.5}",
        ("7: scene.restitution.value:", "is 1.5", "at most 1"),
    ),
    ("  restitution", "  restitution: constant", ("7: scene.restitution.value:", "is missing")),
    (
        "  restitution",
        "  restitution: {law: constant, value: 0.9, contact_time: -1 us}",
        ("7: scene.restitution.contact_time:", "is '-1 us'", "at least 0"),
    ),
    (
        "  restitution",
        "  restitution: {law: constant, value: 0.9, contact_time: 1 um}",
        ("7: scene.restitution.contact_time:", "wrong unit", "'um'", "'s'"),
    ),
    (
        "  restitution",
        "  restitution: {law: constant, value: 0, contact_time: 1 us}",
        ("7: scene.restitution.contact_time:", "is 1e-06 s"),
    ),
    (
        "  restitution",
        "  restitution: {law: pressure, contact_time: 1 us}",
        ("7: scene.restitution.contact_time:", "unknown key 'contact_time'", "allowed: law"),
    ),
    (
        "  contact_area",
        "  contact_area: {initial: 2, final: 1}",
        ("8: scene.contact_area.initial:", "is 2", "1", "at most"),
    ),
    ("  contact_area", "  contact_area: {final: 0}", ("final:", "is 0", "greater than 0")),
    (
        "  hardness: a",
        "  hardness: steel",
        ("scene.hardness:", "is 'steel'", "allowed: arrhenius, constant"),
    ),
    (
        "  friction: c",
        "  friction: 5",
        ("10: scene.friction:", "is 5"),
    ),
    (
        "  cooling",
        "  cooling:\n    integration: exact\n    law: quartik",
        ("15: scene.cooling.law:", "is 'quartik'", "allowed: none, radiation, quartic"),
    ),
    (
        "  cooling",
        "  cooling: {integration: exact}",
        ("13: scene.cooling.law:", "is missing", "allowed: none, radiation, quartic"),
    ),
    (
        "  cooling",
        "  cooling: radiation",
        ("13: scene.cooling.emissivity:", "is missing", "0", "1"),
    ),
    (
        "  cooling",
        "  cooling: {law: quartic, emissivity: 1}",
        ("13: scene.cooling.emissivity:", "unknown key 'emissivity'", "allowed: law, integration"),
    ),
    (
        "  cooling",
        "  cooling: {law: radiation, emissivity: 0.5, surroundings: 0 K, convection: 1}",
        ("13: scene.cooling.ambient:", "is missing"),
    ),
    ("  end_time", "  end_time: soon", ("14: scene.end_time:", "is 'soon'", "`characteristic`")),
    ("  end_time", "  end_time: 0 s", ("14: scene.end_time:", "is '0 s'", "greater than 0")),
    (
        "  engine",
        "  engine: leapfrog",
        ("15: scene.engine:", "is 'leapfrog'", "allowed: event, fixed, adaptive"),
    ),
    (
        "  engine",
        "  engine: {steps: 50}",
        ("15: scene.engine.law:", "is missing", "allowed: event, fixed, adaptive"),
    ),
    (
        "  engine",
        "  engine: {law: event, budget: 0}",
        ("15: scene.engine.budget:", "is 0", "at least 1"),
    ),
    (
        "  engine",
        "  engine: {law: event, budget: 10000000000}",
        ("15: scene.engine.budget:", "is 10000000000", "at most 1000000000"),
    ),
    (
        "  engine",
        "  engine: {law: event, budget: 1e30}",
        ("15: scene.engine.budget:", "is 1e+30", "whole number"),
    ),
    (
        "  engine",
        "  engine: {law: event, steps: 5}",
        ("15: scene.engine.steps:", "unknown key 'steps'", "allowed: law, budget"),
    ),
    (
        "  engine",
        "  engine: {law: fixed, steps: 0}",
        ("15: scene.engine.steps:", "is 0"),
    ),
    (
        "  engine",
        "  engine: {law: adaptive, steps: 5}",
        ("15: scene.engine.steps:", "unknown key 'steps'", "allowed: law, floor, ceiling"),
    ),
    (
        "  engine",
        "  engine: {law: adaptive, floor: 1 s}",
        ("15: scene.engine.floor:", "is 1 s", "0.001", "at most"),
    ),
    (
        "  heating",
        "  heating: none",
        ("12: scene.reaction:", "is 'contact_area'"),
    ),
]

VARIABLES = [
    ("  density", "  density: [1, 2, 3]", ("19: variables.density:", "is [1, 2, 3]")),
    *(
        (
            "  density",
            f"  density: {entry}",
            ("19: variables.density: is a mapping", "[lower, upper]"),
        )
        for entry in ("{range: [1, 2], scale: log}", "{min: 1 g/cm3, max: 2 g/cm3}", "{from: 1}")
    ),
    (
        "  relative_speed",
        "  speed: 1",
        ("17: variables.speed: unknown key 'speed'; did you mean 'relative_speed'?",),
    ),
    ("  density", "  density: 3 kg/mm5", ("19: variables.density: wrong unit: 'kg/mm5'",)),
    ("  density", "  density: [5, 5]", ("is [5, 5]", "less than", "lower end")),
    ("  density", "  density: [5, 4]", ("is [5, 4]", "less than", "lower end")),
    ("  density", "  density: 1e-320", ("is 1e-320", "1e+100", "between 1e-100")),
    ("  density", "  density: 0", ("19: variables.density:", "is 0", "greater than 0")),
    ("  relative_speed", "  relative_speed: [-1, 1]", ("is -1", "0")),
    (
        "  temperature",
        "  temperature: 0",
        ("23: variables.temperature:", "is 0"),
    ),
    ("  temperature", "  temperature: -273.15 degC", ("is '-273.15 degC'",)),
    ("  friction: 0", "  friction: 1 Pa", ("wrong unit", "'Pa'")),
    (
        "  hardness: [",
        "  hardness: [10 J, 200 MPa]",
        ("20: variables.hardness:", "wrong unit", "'J'", "'Pa'"),
    ),
    ("  friction: 0", "  friction: 3 dB", ("unit 'decibel' in 'dB' is logarithmic",)),
    ("  hardness: [", "  hardness: 3 MPA", ("20: variables.hardness:", "unknown unit", "'MPA'")),
    ("  hardness: [", "  hardness: 3 MPa)", ("20: variables.hardness:", "'MPa)'")),
    ("  hardness: [", "  hardness: '1e6'", ("is the text '1e6'",)),
    (
        "  hardness: [",
        "",
        ("16: variables.hardness:", "is missing", "needed by restitution: pressure"),
    ),
    (
        "  friction: 0",
        "",
        ("16: variables.friction:", "is missing", "needed by friction: constant"),
    ),
    (
        "  activation",
        "",
        ("variables.activation_energy:", "is missing", "needed by hardness: arrhenius"),
    ),
    (
        "  reaction_heat",
        "",
        ("variables.reaction_heat:", "is missing", "needed by reaction: contact"),
    ),
    (
        "  heat_capacity",
        "",
        ("variables.heat_capacity:", "is missing", "needed by heating: pair_split"),
    ),
    ("  size_ratio", "", ("variables.size_ratio:", "is missing", "needed by every")),
    ("  density", "  densty: 1", ("variables.densty:", "unknown key 'densty'", "'density'")),
    (
        "  reaction_heat",
        "  reaction_heat: 1\n  surface_energy: [1, 2]",
        ("26: variables.surface_energy:", "no fragmentation"),
    ),
    (
        "  size_ratio",
        "  size_ratio: [0.4, 0.95]",
        ("18: variables.size_ratio:", "is 0.95", "0.38", "at most 0.8986"),
    ),
    ("  size_ratio", "  size_ratio: 1e60", ("is 1e+60", "at most 0.8986")),
]

PLAN = [
    ("seed", "seed: -1", ("2: seed:", "is -1", "at least 0")),
    ("seed", "seed: 9223372036854775808", ("2: seed:", "is 9223372036854775808", "at most")),
    ("title", "title: 3", ("1: title:", "is 3")),
    (
        "objective",
        "objective: best",
        ("26: objective:", "is 'best'", "allowed: growth_target, maximum_"),
    ),
    (
        "objective",
        "objective: {law: growth_target, ratio: 5}",
        ("26: objective.ratio:", "is 5", "100", "4.642"),
    ),
    (
        "search",
        "search: {population: 12, parents: 8}",
        ("27: search.parents:", "is 8", "12", "at most 6"),
    ),
    ("search", "search: {parents: 3}", ("27: search.parents:", "is 3", "multiple of 2")),
    ("search", "search: {population: 5}", ("27: search.parents:", "is 6")),
    ("search", "search: {blend: [1, 0]}", ("27: search.blend:", "is [1, 0]", "lower end")),
    (
        "search",
        "search: {rescale: {every: 4}}",
        ("27: search.rescale.factor:", "is missing", "between"),
    ),
    (
        "search",
        "search: {rescale: {every: 4, factor: 1}}",
        ("27: search.rescale.factor:", "is 1", "less than 1"),
    ),
    (
        "  rule",
        "  rule: luck",
        ("29: ensemble.rule:", "is 'luck'", "allowed: successive_difference, mom"),
    ),
    (
        "  rule",
        "",
        ("28: ensemble.rule:", "is missing", "allowed: successive_difference, moments, stan"),
    ),
    ("  rule", "  rule: successive_difference\n  order: 3", ("30: ensemble.order:", "unknown key")),
    ("  rule", "  rule: moments\n  order: 5", ("30: ensemble.order:", "is 5", "at most 4")),
    ("  max_samples", "", ("28: ensemble.max_samples:", "is missing")),
    ("  max_samples", "  max_samples: 1", ("31: ensemble.max_samples:", "is 1", "at least 2")),
    (
        "  max_samples",
        "  max_samples: 4\n  min_samples: 5",
        ("32: ensemble.min_samples:", "is 5", "4", "at most"),
    ),
    ("  tolerance", "  tolerance: 0", ("30: ensemble.tolerance:", "is 0", "greater than 0")),
    ("  generations", "  generations: 0", ("33: stopping.generations:", "is 0", "at least 1")),
    (
        "  target",
        "  target: {top: 13, objective: 1e-3}",
        ("34: stopping.target.top:", "is 13", "12", "at most"),
    ),
    ("  target", "  target: 5", ("34: stopping.target:", "is 5", "a mapping")),
    ("title", "outputs: {file: a.h5}", ("1: outputs:", "unknown key 'outputs'", "'output'")),
    ("title", "output: a.h5", ("1: output:", "is 'a.h5'", "a mapping")),
    *(
        ("title", f"output: {{{entry}}}", (f"1: output.{expected}",))
        for entry, expected in (
            ("final_particles: 1", "final_particles: is 1; must be true or false"),
            ("final_particles: yes", "final_particles: is 'yes'; must be true or false"),
            ("final_particles: {}", "final_particles: is a mapping; must be true or false"),
            ("frames: 5", "frames: is 5; must be a mapping"),
            ("frames: true", "frames: is true; must be a mapping"),
            ("frames: {}", "frames.count: is missing"),
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
    begin: str, replacement: str, expected: tuple[str, ...]
) -> None:
    lines = message((begin, replacement)).splitlines()
    parts = ("campaign.yaml:", *expected)
    assert any(all(part in line for part in parts) for line in lines), lines


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("", "campaign.yaml: is empty; a campaign needs a scene"),
        ("# only a comment\n", "campaign.yaml: is empty; a campaign needs a scene"),
        ("diameter (um)\n40\n", "campaign.yaml:1: is one text; must be a mapping of sections"),
        (
            "- a\n- b\n",
            "campaign.yaml:1: is a list; must be a mapping of sections such as `scene:`",
        ),
        ("a: [1, 2\nb: 3\n", "campaign.yaml:2: not valid YAML: expected ',' or ']', but got ':'"),
        ("a: 1\n\tb: 2\n", "campaign.yaml:2: not valid YAML: "),
        ("title: a\x01\n", "campaign.yaml:1: not valid YAML: the character U+0001 is not allowed"),
        ("a: 1\n---\nb: 2\n", "campaign.yaml:2: not valid YAML: but found another document"),
        ("a: &x [*x]\n", "is nested too deeply or too long"),
        ("[" * 5000, "campaign.yaml:1: is nested too deeply or too long"),
        # What is counted when all is parsed takes the parser minutes.
        ("a: [" + "1," * 400_000, "campaign.yaml:1: is nested too deeply or too long"),
        (("- " + "[" * 200 + "]" * 200 + "\n") * 2500, "campaign.yaml:1: is nested too deeply"),
        ("%YAML 1.9\n---\na: 1\n", "campaign.yaml: not valid YAML, or of another version than 1"),
        ("a:\n%YAML 9.9\n---\n b: 1\n", "campaign.yaml: not valid YAML, or of another version"),
        ("a: !!bool 7\n", "campaign.yaml:1: a: cannot read '7'"),
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
    assert "9: scene.hardness: is 'arrhenius'" in text
    assert "14: scene.end_time: is 'characteristic'" in text


EULER = "cooling: {law: quartic, integration: euler}"


@pytest.mark.parametrize("engine", ["  engine: event", "  engine: {law: event, budget: 9}", ""])
def test_the_event_engine_has_no_steps_to_cool_by(engine: str) -> None:
    said = message(("  cooling", f"  {EULER}"), ("  engine", engine))
    assert said.startswith("campaign.yaml:13: scene.cooling.integration: is 'euler'")
    assert "'event'" in said
    assert "allowed: exact" in said


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


def test_many_mistakes_are_counted_and_long_ones_cut():
    with pytest.raises(CampaignError) as raised:
        Campaign.from_text(TEXT + "".join(f"{'k' * 600}{i}: 1\n" for i in range(100)))
    lines = str(raised.value).splitlines()
    assert len(raised.value.problems) == 100
    assert len(lines) == 21
    assert lines[-1] == "campaign.yaml: 80 more problems"
    assert max(map(len, lines)) == 500
