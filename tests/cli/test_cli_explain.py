"""`agglom explain`: every key of a campaign file, in words."""

import re
from pathlib import Path

import pytest
from click.testing import CliRunner

from agglom_mpi.cli.explain import WIDTH, explain
from agglom_mpi.config.explanation import topics


def run(*arguments):
    return CliRunner().invoke(explain, arguments)


def test_without_a_key_the_sections_are_listed():
    done = run()
    assert done.exit_code == 0
    for path in topics():
        assert len(path) > 1 or f"\n  {path[0]} " in f"\n{done.output}"


@pytest.mark.parametrize("path", topics(), ids=".".join)
def test_every_key_has_a_page_that_fits_a_terminal(path):
    done = run(".".join(path))
    assert done.exit_code == 0
    lines = done.output.splitlines()
    assert lines[0] == ".".join(path)
    topic = topics()[path]
    assert " ".join(topic.meaning.split()) in " ".join(done.output.split())
    assert topic.example in " ".join(done.output.split())
    assert all(len(line) <= WIDTH for line in lines)


def test_lines_are_as_wide_as_the_terminal(monkeypatch):
    for columns, most in (("70", 70), ("300", WIDTH), ("30", 70)):
        monkeypatch.setenv("COLUMNS", columns)
        widths = [len(line) for line in run("ensemble.standard_error").output.splitlines()]
        assert most - 20 < max(widths) <= most


def test_limits_read_as_people_write_numbers():
    assert "(whole number ≥ 0; default 0)" in run().output
    assert "≤ 1,000,000" in " ".join(run("ensemble.fixed").output.split())
    assert "(number > 0, < 1; default 0.05)" in " ".join(run("search.surrogate").output.split())


def test_a_key_of_laws_names_the_command_that_explains_one_of_them():
    (law,) = re.findall(r"`agglom explain (\S+)`", run("restitution").output)
    lines = run(law).output.splitlines()
    assert lines[0] == f"scene.{law}"
    assert any(line.startswith("  example ") for line in lines)


def test_several_keys_are_explained_one_after_another():
    done = run("density", "restitution.value")
    assert done.output.index("variables.density") < done.output.index("restitution.constant.value")


def test_a_name_of_many_keys_lists_them():
    assert len(run("tolerance").output.splitlines()) >= 5


def test_an_unknown_key_is_one_line_and_a_code():
    done = run("restitutoin")
    assert done.exit_code == 2
    assert len(done.output.splitlines()) == 1
    assert "restitution" in done.output


def test_markdown_has_a_row_for_every_key():
    done = run("--markdown")
    assert done.exit_code == 0
    for path in topics():
        assert f"`{path[-1]}`" in done.output


def test_the_page_of_the_reference_is_the_output_of_the_command():
    page = (Path(__file__).parents[2] / "jobs" / "REFERENCE.md").read_text()
    assert "`agglom explain --markdown`" in page.splitlines()[0]
    assert run("--markdown").output == page
