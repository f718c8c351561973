"""Campaigns in YAML that somebody has mutated: valid, or refused in words that name the file."""

import pytest
from attacked_commands import PHASES
from hostile_yaml import JOBS, hostile_yaml
from hypothesis import given, settings

from agglom_mpi.errors import BAD_INPUT, FINISHED


@pytest.mark.parametrize("usual", [25, pytest.param(300, marks=pytest.mark.slow)])
def test_a_mutated_campaign_is_valid_or_refused_in_words(commands, cases, usual):
    file = commands.folder / "case.yaml"
    file.write_bytes((JOBS / "quickstart.yaml").read_bytes())
    commands.load("agglom", "check", "case.yaml")
    found = set()

    @settings(max_examples=cases(usual), database=None, phases=PHASES)
    @given(hostile_yaml())
    def attack(content):
        file.write_bytes(content)
        ended = commands.run("agglom", "check", "case.yaml")
        found.add(ended.code)
        if ended.code == BAD_INPUT:
            assert ended.said == ""
            assert all(line.startswith("case.yaml:") for line in ended.errors.splitlines())
        else:
            assert ended.code == FINISHED
            warned = ended.errors.splitlines()
            assert all(line.startswith("warning: case.yaml:") for line in warned)

    attack()
    assert found == {FINISHED, BAD_INPUT}
    assert [path.name for path in commands.folder.iterdir()] == ["case.yaml"]
