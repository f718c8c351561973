"""What is said of the keys of a campaign file: all of them, and nothing that is not so."""

import pytest
from campaign_text import TEXT
from ruamel.yaml import YAML

from agglom_mpi.config.explanation import UnknownKeyError, below, component_kinds, find, topics
from agglom_mpi.config.loading import load_campaign
from agglom_mpi.variables import PAPER_VARIABLES

COMPONENTS = [topic for topic in topics().values() if topic.example]


def as_text(path):
    return ".".join(path)


@pytest.mark.parametrize("topic", topics().values(), ids=lambda topic: as_text(topic.path))
def test_a_sentence_is_said_of_every_key(topic):
    assert len(topic.meaning.split()) >= 2
    assert "\n" not in topic.meaning


def test_every_component_of_every_kind_is_explained():
    for key, kind in component_kinds().items():
        for name, component in kind.components().items():
            path = (*key, name)
            assert path in topics()
            hidden = (component.named_by, *component.not_in_files)
            own = [each for each in component.model_fields if each not in hidden]
            if path[0] != "stopping":  # a criterion may be the value itself
                assert [topic.path[-1] for topic in below(path)] == own


def test_every_variable_is_explained():
    names = [topic.path[-1] for topic in below(("variables",))]
    assert names == [*(variable.name for variable in PAPER_VARIABLES), "volume_fraction"]


@pytest.mark.parametrize("topic", COMPONENTS, ids=lambda topic: as_text(topic.path))
def test_an_example_is_a_part_of_a_valid_campaign(topic, tmp_path):
    (tmp_path / "diameters.csv").write_text("diameter\n1\n2\n")
    (tmp_path / "sieve.csv").write_text("sieve (um);passing (%)\n29;0\n30;40\n31;100\n")
    (tmp_path / "growth.py").write_text("def loss(radii, **others):\n    return 0.0\n")
    yaml = YAML(typ="safe", pure=True)
    document = yaml.load(TEXT)
    section = document["scene"] if topic.path[0] == "scene" else document
    section |= yaml.load(topic.example)
    if topic.path[:2] == ("scene", "restitution") and topic.path[2] != "pressure":
        section |= {"hardness": "constant", "end_time": "1 ms"}
        del document["variables"]["hardness"]
    if topic.path[1:] == ("heating", "none"):
        section["reaction"] = "none"
    if topic.path[1:2] == ("fragmentation",) or topic.path[2:] == ("adhesive",):
        document["variables"]["surface_energy"] = 1.0
    if topic.path[1:] == ("escape", "shear"):
        section["engine"] = "event"
    if topic.path[1:] == ("sizes", "curve"):
        del section["half_width"]
    if topic.path == ("objective", "misfit"):
        document["data"] = [{"quantity": "spread", "value": 0.3, "error": 0.1}]
        document["ensemble"] = {"rule": "fixed", "samples": 3}
    yaml.dump(document, tmp_path / "campaign.yaml")
    campaign = load_campaign(tmp_path / "campaign.yaml", allow_code=True)
    holder = campaign.scene if topic.path[0] == "scene" else campaign
    assert getattr(holder, topic.path[-2]).name == topic.path[-1]


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        ("restitution", ["scene.restitution"]),
        ("scene.restitution", ["scene.restitution"]),
        ("restitution.constant", ["scene.restitution.constant"]),
        ("restitution.value", ["scene.restitution.constant.value"]),
        ("emissivity", ["scene.cooling.radiation.emissivity"]),
        ("cooling.emissivity", ["scene.cooling.radiation.emissivity"]),
        ("density", ["variables.density"]),
        ("hardness", ["scene.hardness", "variables.hardness"]),
        ("final.strings", ["final.strings"]),
        ("target", ["stopping.target"]),
    ],
)
def test_a_key_is_found_by_what_it_ends_with(words, expected):
    assert [as_text(topic.path) for topic in find(words)] == expected


@pytest.mark.parametrize(
    ("words", "near"),
    [("restitutoin", "restitution"), ("cooling.emisivity", "emissivity"), ("", ""), ("x.", "")],
)
def test_an_unknown_key_is_refused_with_what_is_near(words, near):
    with pytest.raises(UnknownKeyError) as raised:
        find(words)
    assert str(raised.value).startswith(f"{words}: ")
    assert near in str(raised.value)


def test_limits_units_and_defaults_are_those_of_the_declarations():
    emissivity, convection = find("emissivity")[0], find("convection")[0]
    assert "0" in emissivity.allowed
    assert "1" in emissivity.allowed
    assert emissivity.default is None
    assert "W/m^2/K" in convection.allowed
    assert convection.default == "0"
    assert find("end_time")[0].allowed.endswith("`characteristic`")
    assert "`exact` or `euler`" in find("radiation.integration")[0].allowed
    assert find("final.samples")[0].default == "100"
    assert find("output.frames.count")[0].default is None
