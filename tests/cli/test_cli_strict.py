"""Warnings go to standard error and change nothing; with --strict they are errors."""

import json

import pytest
from campaign_runs import TINY, write_campaign

from agglom_mpi.runtime.invert import InvertOptions, read_request

FUNCTION = 'objective: {law: function, call: "worth:worth"}'


@pytest.fixture
def unlikely(tmp_path):
    return write_campaign(tmp_path / "far.yaml", half_width=36600)


def test_check_warns_beside_what_it_prints(agglom, unlikely):
    done = agglom("check", unlikely)
    assert done.exit_code == 0
    assert done.stderr.startswith(f"warning: {unlikely}:")
    assert "scene.half_width: makes 100 grains of 126 m; usual are" in done.stderr
    assert "warning" not in done.stdout


@pytest.mark.parametrize("command", ["check", "simulate"])
def test_strict_makes_warnings_errors(mistaken, command, unlikely):
    said = mistaken(command, unlikely, "--strict")
    assert said.startswith(f"{unlikely}:")
    assert "scene.half_width: makes 100 grains of " in said


def test_check_prints_json(agglom, unlikely):
    done = agglom("check", unlikely, "--json")
    found = json.loads(done.stdout)
    assert done.stderr.count("\n") == len(found["warnings"]) == 1
    assert found["identity"]["scene.half_width"] == 366.0
    assert "particles: 100" in found["scene"]


def test_check_of_a_file_prints_json(agglom):
    found = json.loads(agglom("check", "tiny.h5", "--json").stdout)
    assert found["sound"] is True
    assert found["lines"]


def test_a_value_that_nothing_depends_on_is_warned_of(agglom):
    done = agglom("simulate", "tiny.yaml", "--set", "surface_energy=3", "--samples", 1)
    assert done.exit_code == 0
    assert done.stderr.startswith(
        "warning: tiny.yaml: surface_energy: is 3.0, but nothing depends on it: the scene has no "
        "fragmentation and no adhesion\n"
    )


def written(path, worth):
    text = write_campaign(path / "own.yaml").read_text().splitlines()
    [i] = [i for i, line in enumerate(text) if line.startswith("objective")]
    text[i] = FUNCTION
    (path / "own.yaml").write_text("\n".join(text) + "\n")
    (path / "worth.py").write_text(f"def worth(sample):\n    return {worth}\n")
    return path / "own.yaml"


def test_check_calls_a_function_once_where_it_may(agglom, tmp_path):
    own = written(tmp_path, "float(sample.parameters['density'])")
    assert "Function" not in agglom("check", own).stdout
    done = agglom("check", own, "--allow-code")
    assert done.exit_code == 0, done.stderr
    assert done.stdout.endswith("Function\n  a sample in the middle of the box is worth 6142\n")


def test_check_says_what_a_function_raises(mistaken, tmp_path):
    own = written(tmp_path, "sample.parameters['surface_energy']")
    said = mistaken("check", own, "--allow-code")
    assert "objective.call: is 'worth:worth', but of the middle of the box sample 0 failed" in said
    assert "KeyError: 'surface_energy'" in said


def test_constraints_that_allow_little_of_the_box_are_warned_of(agglom, mistaken, tmp_path):
    path = write_campaign(tmp_path / "little.yaml", **TINY)
    text = path.read_text()
    path.write_text(f"{text}\nconstraints: [relative_speed > 29.98 m/s]\n")  # of 0.1 to 30 m/s
    done = agglom("check", path)
    assert done.exit_code == 0
    assert f"warning: {path}:" in done.stderr
    assert " constraints: allow 0." in done.stderr
    assert " constraints: allow 0." in mistaken("check", path, "--strict")
    shown = []
    read_request(InvertOptions(str(path), output=str(tmp_path / "little.h5")), shown.append)
    assert any(" constraints: allow 0." in str(line) for line in shown)
