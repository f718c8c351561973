"""A component of one's own, `FILE.py:Class`: its module is read once, and run if allowed."""

import copy
import pickle
import subprocess
import sys
from pathlib import Path

import pytest
from own_components import RESTITUTION_LINE, SCENE, SPEED, write_scene

from agglom_mpi import components, load_campaign
from agglom_mpi.compilation.stages import module_key
from agglom_mpi.config.loading import check_campaign
from agglom_mpi.config.own_components import RecordedModules, own_of, recorded_texts
from agglom_mpi.config.yaml_source import CampaignError
from agglom_mpi.declaration.own_modules import OwnModule, class_in
from agglom_mpi.errors import CodeNotAllowedError
from agglom_mpi.physics.restitution import Restitution
from agglom_mpi.runtime.file_setup import OutputError, check_same_campaign

NAME = "sticking.py:SpeedRestitution"


def problem(path, allow_code=True):
    """Return line, field and message of the only problem of a campaign."""
    with pytest.raises(CampaignError) as caught:
        load_campaign(path, allow_code)
    [found] = caught.value.problems
    assert found.file == str(path)
    assert "\n" not in str(found)
    return found.line, found.field, found.message


def test_its_numbers_have_units_limits_and_defaults(tmp_path):
    law = load_campaign(write_scene(tmp_path), allow_code=True).scene.restitution
    assert (law.name, law.speed, law.sticking) == (NAME, 3.0, 0.3)
    edits = [("speed: 3 m/s, sticking: 30 cm/s", "sticking: 1 mm/s")]
    law = load_campaign(write_scene(tmp_path, SPEED, *edits), allow_code=True).scene.restitution
    assert (law.speed, law.sticking) == (1.0, 1e-3)


@pytest.mark.parametrize(
    ("old", "new", "field", "quoted"),
    [
        ("speed: 3 m/s", "speed: 3 kg", "speed", "'kg'"),
        ("speed: 3 m/s", "speed: 0", "speed", "0"),
        ("speed: 3 m/s", "sped: 3", "sped", "'speed'"),
        (", sticking: 30 cm/s", "", "sticking", "'1 cm/s'"),
    ],
)
def test_what_is_wrong_with_them_is_said_with_line_and_field(tmp_path, old, new, field, quoted):
    line, path, message = problem(write_scene(tmp_path, SPEED, (old, new)))
    assert (line, path) == (RESTITUTION_LINE, f"scene.restitution.{field}")
    assert quoted in message


def test_its_numbers_are_searched_by_their_paths(tmp_path):
    numbers = "restitution.sticking: [1 cm/s, 1 m/s, log], "
    edits = [(", sticking: 30 cm/s", ""), ("variables: {", f"variables: {{{numbers}")]
    path = write_scene(tmp_path, SPEED, *edits)
    campaign = load_campaign(path, allow_code=True)
    variable = campaign.variables["restitution.sticking"]
    assert (variable.unit, variable.limits.at_least) == ("m/s", 0.0)
    string = campaign.parameters({"restitution.sticking": "50 cm/s"})
    assert campaign.at(string).section.restitution.sticking == 0.5
    assert campaign.at(string).build().laws.restitution.sticking == 0.5
    assert problem(path, allow_code=False)[:2] == (RESTITUTION_LINE, "scene.restitution.law")
    path.write_text(path.read_text().replace("restitution.sticking", "restitution.stick"))
    with pytest.raises(CampaignError) as caught:
        load_campaign(path, allow_code=True)
    assert [each.field for each in caught.value.problems] == [
        *("scene.restitution.sticking", "variables.restitution.stick")
    ]


def test_code_that_is_not_allowed_is_not_run(tmp_path):
    trace = tmp_path / "trace"
    path = write_scene(tmp_path, f"open({str(trace)!r}, 'w').write('x')\n{SPEED}")
    line, field, message = problem(path, allow_code=False)
    assert (line, field) == (RESTITUTION_LINE, "scene.restitution.law")
    assert "--allow-code" in message
    assert "allow_code=True" in message
    with pytest.raises(CampaignError, match="--allow-code"):
        check_campaign(path)
    assert not trace.exists()
    load_campaign(path, allow_code=True)
    assert trace.exists()


@pytest.mark.parametrize(
    ("source", "quoted"),
    [
        (None, "sticking.py cannot be read"),
        (SPEED.replace("):", ")", 1), "sticking.py:8: expected ':'"),
        ("\0", "sticking.py"),
        (SPEED.replace("class Speed", "class Sped"), "did you mean 'SpedRestitution'"),
        ("SpeedRestitution = 3\n", "sticking.py defines no class 'SpeedRestitution'"),
        ("from agglom_mpi.components import Friction as SpeedRestitution\n", "only imports"),
        ("class SpeedRestitution:\n    pass\n", "no subclass of Restitution"),
        (
            SPEED.replace("Restitution)", "Friction)").replace("In, ", "In, Friction, "),
            "no subclass",
        ),
        (f"{SPEED}\n1 / 0\n", "sticking.py:20 raises ZeroDivisionError"),
        (f"import neighbour\n{SPEED}", "sticking.py:1 raises ModuleNotFoundError"),
        (f"{SPEED}\nraise SystemExit(0)\n", "sticking.py raised SystemExit"),
        (f"import os\n{SPEED}\nos._exit(0)\n", "os._exit would end a rank"),
        (SPEED.replace('In("m/s"', 'In("furlong"'), "sticking.py"),
    ],
)
def test_a_module_that_cannot_be_used_is_one_line(tmp_path, source, quoted):
    (tmp_path / "neighbour.py").write_text("")
    line, field, message = problem(write_scene(tmp_path, source))
    assert (line, field) == (RESTITUTION_LINE, "scene.restitution.law")
    assert NAME in message
    assert quoted in message


@pytest.mark.parametrize(
    "name",
    [
        *("../sticking.py:A", "a.b.py:A", "sticking.py", "sticking.py:", "sticking.py:A.B"),
        "if.py:A",
    ],
)
def test_a_name_of_another_form_is_refused(tmp_path, name):
    line, field, message = problem(write_scene(tmp_path, SPEED, (NAME, name)))
    assert (line, field) == (RESTITUTION_LINE, "scene.restitution.law")
    assert "FILE.py:Class" in message


@pytest.mark.parametrize("key", ["escape", "engine", "solver"])
def test_a_kind_that_kernels_are_built_of_is_not_ones_own(tmp_path, key):
    edit = ("  end_time: 0.3 s", f'  end_time: 0.3 s\n  {key}: "sticking.py:SpeedRestitution"')
    line, field, message = problem(write_scene(tmp_path, SPEED, edit))
    assert (line, field) == (RESTITUTION_LINE + 3, f"scene.{key}")
    assert "allowed: " in message
    assert "FILE.py:Class" not in message


def test_the_identity_has_the_name_the_numbers_and_the_digest_of_the_bytes(tmp_path):
    path = write_scene(tmp_path)
    before = load_campaign(path, allow_code=True).identity()
    entries = {k: v for k, v in before.items() if k.startswith("scene.restitution.")}
    digest = OwnModule.of("sticking.py", (tmp_path / "sticking.py").read_bytes()).sha256
    assert entries == {
        "scene.restitution.law": NAME,
        "scene.restitution.speed": 3.0,
        "scene.restitution.sticking": 0.3,
        "scene.restitution.source_sha256": digest,
    }
    (tmp_path / "sticking.py").write_text(f"{SPEED}# a remark\n")
    after = load_campaign(path, allow_code=True).identity()
    assert {key for key in before if before[key] != after[key]} == {
        "scene.restitution.source_sha256"
    }


def test_two_versions_of_a_module_do_not_disturb_each_other(tmp_path):
    path = write_scene(tmp_path)
    first = load_campaign(path, allow_code=True).scene.restitution
    (tmp_path / "sticking.py").write_text(SPEED.replace("= 1.0", "= 2.0"))
    second = load_campaign(path, allow_code=True).scene.restitution
    assert type(first) is not type(second)
    assert type(first).model_fields["speed"].default == 1.0
    assert type(second).model_fields["speed"].default == 2.0
    assert type(load_campaign(write_scene(tmp_path), True).scene.restitution) is type(first)


def test_own_classes_are_no_components_of_the_package(tmp_path):
    found = load_campaign(write_scene(tmp_path), allow_code=True).scene.restitution
    assert NAME not in Restitution.components()
    assert type(found) not in Restitution.components().values()
    source = SPEED.replace("    speed:", '    law: Literal["constant"] = "constant"\n    speed:')
    source = source.replace("ClassVar\n", "ClassVar, Literal\n")
    own = load_campaign(write_scene(tmp_path, source), allow_code=True).scene.restitution
    assert (own.law, own.name) == (NAME, NAME)
    assert Restitution.components()["constant"].own is None


ELSEWHERE = """
import pickle, sys
law, numbers = pickle.load(sys.stdin.buffer)
assert numbers == law.build({}), numbers
print(law.name, law.sticking, type(numbers).__module__, len(law.own.source))
"""


def test_what_is_pickled_carries_the_module(tmp_path):
    path = write_scene(tmp_path)
    law = load_campaign(path, allow_code=True).scene.restitution
    text = pickle.dumps((law, law.build({})))
    (tmp_path / "sticking.py").unlink()
    done = subprocess.run(
        [sys.executable, "-c", ELSEWHERE], input=text, capture_output=True, check=True, cwd=tmp_path
    )
    name, sticking, module, length = done.stdout.decode().split()
    assert (name, float(sticking)) == (NAME, 0.3)
    assert module == type(law).__module__
    assert int(length) == len(SPEED.encode())
    assert copy.deepcopy(law) == law


def test_an_error_of_a_module_is_reported_once(tmp_path):
    edit = ("  heating: none", '  heating: none\n  friction: "sticking.py:Other"')
    path = write_scene(tmp_path, f"{SPEED}\n1 / 0\n", edit)
    with pytest.raises(CampaignError) as caught:
        load_campaign(path, allow_code=True)
    first, second = caught.value.problems
    assert (first.line, second.line) == (RESTITUTION_LINE, RESTITUTION_LINE + 2)
    assert "ZeroDivisionError" in first.message
    assert "ZeroDivisionError" not in second.message
    assert NAME in second.message


def test_every_name_of_the_interface_can_be_imported():
    assert [name for name in components.__all__ if getattr(components, name) is None] == []


def test_a_module_is_executed_once_in_a_process(tmp_path):
    trace = tmp_path / "trace"
    source = f"with open({str(trace)!r}, 'a') as file: file.write('x')\n{SPEED}"
    own = OwnModule.of("sticking.py", source.encode())
    assert class_in(own, "SpeedRestitution") is class_in(own, "SpeedRestitution")
    load_campaign(write_scene(tmp_path, source), allow_code=True)
    assert trace.read_text() == "x"


def test_the_example_of_the_readme_works(tmp_path):
    text = (Path(__file__).parents[2] / "jobs" / "README.md").read_text()
    section = text.partition("## Components of your own")[2]
    source = section.partition("```python\n")[2].partition("```")[0]
    line = section.partition("```yaml\n")[2].partition("```")[0].rstrip("\n")
    old = SCENE.splitlines()[RESTITUTION_LINE - 1]
    law = load_campaign(write_scene(tmp_path, source, (old, line)), True).scene.restitution
    assert (law.name, law.speed, law.sticking) == ("sticking.py:Speed", 3.0, 0.3)


READING_SPEED = SPEED.replace("from typing", "import os\nfrom typing").replace(
    "class SpeedRestitution", 'E_WALL = float(os.environ["E_WALL"])\n\n\nclass SpeedRestitution'
)
READING_SPEED = READING_SPEED.replace(
    "RestitutionSolution(deficit", "RestitutionSolution(E_WALL * deficit"
)


def test_what_a_law_has_read_is_another_campaign_and_other_machine_code(tmp_path, monkeypatch):
    found, keys = [], []
    for place, wall in enumerate(("0.9", "0.1")):
        monkeypatch.setenv("E_WALL", wall)
        # Another process would execute the same bytes; this one does so once, so they differ.
        path = write_scene(tmp_path, f"{READING_SPEED}# {place}\n")
        campaign = load_campaign(path, allow_code=True)
        found.append(campaign.identity())
        law = campaign.scene.restitution
        keys.append(module_key(type(law).__module__))
    values = [each.pop("scene.restitution.source_values.E_WALL") for each in found]
    assert values == ["0.9", "0.1"]
    assert [key.split(" ", 1)[1] for key in keys] == ["('E_WALL', '0.9')", "('E_WALL', '0.1')"]
    with pytest.raises(OutputError, match=r"source_values\.E_WALL: 0\.9 in the file, 0\.1 now"):
        check_same_campaign(
            tmp_path / "own.h5",
            found[0] | {"scene.restitution.source_values.E_WALL": "0.9"},
            found[0] | {"scene.restitution.source_values.E_WALL": "0.1"},
        )
    unrecorded = found[0] | {"scene.restitution.source_values.E_WALL": "0.9"}
    check_same_campaign(tmp_path / "own.h5", found[0], unrecorded)  # of an earlier version


def test_a_law_that_reads_nothing_has_no_such_entries(tmp_path):
    identity = load_campaign(write_scene(tmp_path), allow_code=True).identity()
    assert [name for name in identity if "source" in name] == ["scene.restitution.source_sha256"]


def test_a_module_that_changes_the_folder_does_not_move_the_run(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "elsewhere").mkdir()
    source = SPEED.replace("from typing", "import os\nos.chdir('elsewhere')\nfrom typing")
    load_campaign(write_scene(tmp_path, source), allow_code=True)
    assert Path.cwd() == tmp_path


def test_a_module_that_a_file_records_runs_with_leave_alone(tmp_path):
    campaign = load_campaign(write_scene(tmp_path), allow_code=True)
    [law] = own_of(campaign)
    # An identity of a stranger: it has the digest, and names no component that could be refused.
    identity = {"zzz.source_sha256": law.own.sha256}

    def recorded(leave):
        return RecordedModules(recorded_texts(campaign), identity, lambda *own: leave, tmp_path)

    with pytest.raises(CodeNotAllowedError, match="--allow-code"):
        recorded(False).find(NAME, Restitution)
    assert recorded(True).find(NAME, Restitution).__name__ == "SpeedRestitution"
