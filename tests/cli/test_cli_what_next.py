"""What to measure next, as `agglom report --posterior --what-next` shows and writes it."""

import csv
import json

import pytest
from click.testing import CliRunner

from agglom_mpi.inference import next_measurement


@pytest.fixture
def run(measured_file, monkeypatch, remembered):
    """Return a function that reports on a campaign of few strings as if they sufficed."""
    monkeypatch.setattr("agglom_mpi.inference.stored_samples.MIN_STRINGS", 5)
    # Repetitions need no further emulators.
    monkeypatch.setattr(next_measurement, "_new_quantities", lambda *_: ())

    def run(*words):
        from agglom_mpi.cli import main

        return CliRunner().invoke(main, ["report", str(measured_file), *map(str, words)])

    return run


def refuse(name):
    raise AssertionError(name)


def test_table_json_and_csv_have_the_repetitions(run, tmp_path):
    done = run("--posterior", "--what-next", "--what-next-table", tmp_path / "next.csv")
    assert done.exit_code == 0, done.output
    shown = done.stdout.partition("what to measure next")[2]
    with (tmp_path / "next.csv").open() as file:
        table = list(csv.DictReader(file))
    assert len(table) == 3
    assert all(row["measurement"] in shown for row in table)
    done = run("--posterior", "--what-next", "--json")
    assert done.exit_code == 0, done.output
    found = json.loads(done.stdout, parse_constant=refuse)["posterior"]["next_measurements"]
    assert [row["measurement"] for row in found] == [row["measurement"] for row in table]
    assert found[0]["expected_volume"] == float(table[0]["expected_volume"])


def test_page_has_the_figure_beside_the_posterior(run, tmp_path):
    pytest.importorskip("matplotlib")
    pytest.importorskip("jinja2")
    done = run("--posterior", "--what-next", "--stored-only", "--out", tmp_path)
    assert done.exit_code == 0, done.output
    section = (tmp_path / "report.html").read_text().partition('id="posterior"')[2]
    section = section.partition("</section>")[0]
    assert "what to measure next" in section
    assert "next_measurement" in section
    assert (tmp_path / "next_measurement.png").stat().st_size > 1000


@pytest.mark.parametrize(
    ("words", "needed"),
    [
        (["--what-next"], "--posterior"),
        (["--posterior", "--what-next-table", "x.csv"], "--what-next"),
    ],
)
def test_options_without_their_own_are_refused(run, words, needed):
    done = run(*words)
    assert done.exit_code == 2
    assert needed in done.stderr


def test_several_files_are_left_to_the_command_that_compares_laws(run, measured_file):
    done = run(measured_file, "--posterior", "--what-next")
    assert done.exit_code == 2
    assert "agglom compare" in done.stderr


def test_a_table_that_is_there_already_is_not_overwritten(run, tmp_path):
    path = tmp_path / "next.csv"
    path.write_text("mine")
    done = run("--posterior", "--what-next", "--what-next-table", path)
    assert done.exit_code != 0
    assert path.read_text() == "mine"
