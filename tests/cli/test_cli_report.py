import json
import re

from campaign_runs import TINY

from agglom_mpi import open_campaign
from agglom_mpi.formatting import value_with_error


def test_the_best_strings_are_shown_with_the_end_of_the_run(agglom):
    done = agglom("report", "tiny.h5")
    assert done.exit_code == 0
    assert all(line.startswith("warning: ") for line in done.stderr.splitlines())
    best = open_campaign("tiny.h5").best(4)
    label = "objective, as searched"
    row = next(line for line in done.stdout.splitlines() if line.startswith(label))
    numbers = zip(best["objective"], best["standard_error"], strict=True)
    assert row.split()[3:] == " ".join(value_with_error(*each) for each in numbers).split()
    assert "finished: the 1 generation is done" in done.stdout
    assert "1 generation, 4 strings, " in done.stdout


def test_of_one_thing_no_plural_is_shown(agglom, tmp_path):
    shown = [
        agglom("report", "tiny.h5").stdout,
        agglom("check", "tiny.h5").stdout,
        agglom("export", "tiny.h5", "--csv", tmp_path / "csv").stdout,
        agglom("simulate", "tiny.h5", "--string", 0, "--sample", 0).stdout,
    ]
    nouns = "samples|strings|generations|rows|figures|pictures|frames|pairs|files|ranks|fresh ones"
    assert re.findall(rf"(?<![\d.,])1 (?:{nouns})\b.*", "\n".join(shown)) == []


def test_json_holds_the_same_figures(agglom):
    report = json.loads(agglom("report", "tiny.h5", "--json").stdout)
    file = open_campaign("tiny.h5")
    assert report["state"] == "finished"
    assert report["strings"] == TINY["population"]
    assert report["samples_simulated"] == len(file.samples)
    assert [entry["string"] for entry in report["best"]] == file.best(6)["string"].tolist()
    assert report["best"][0]["objective"] == file.best()["objective"][0]


def test_what_is_no_campaign_file_is_said_in_one_line(mistaken, tmp_path):
    (tmp_path / "text.h5").write_text("no database")
    (tmp_path / "empty.h5").touch()
    assert mistaken("report", "nothing.h5") == "nothing.h5: No such file or directory"
    assert mistaken("report", tmp_path) == f"{tmp_path}: Is a directory"
    assert mistaken("report", tmp_path / "text.h5").endswith("text.h5: not an HDF5 file")
    assert "it is empty" in mistaken("report", tmp_path / "empty.h5")


def test_sensitivity_of_too_few_strings_is_said_to_be_unknown(agglom):
    done = agglom("report", "tiny.h5", "--sensitivity")
    assert done.exit_code == 0
    assert "sensitivity: too few strings" in done.stdout
    assert (
        json.loads(agglom("report", "tiny.h5", "--sensitivity", "--json").stdout)["sensitivity"]
        is None
    )
