import json
import re

import h5py
import numpy as np
import pytest
from campaign_runs import SMALL, write_campaign

from agglom_mpi.analysis.summary import collect_summary, summary_table, to_json
from agglom_mpi.campaign_file import open_campaign
from agglom_mpi.config.loading import load_campaign
from agglom_mpi.display.run_display import Display, print_wide
from agglom_mpi.runtime.experiment import InversionExperiment
from agglom_mpi.runtime.file_setup import prepare
from agglom_mpi.runtime.provenance import leg_start
from agglom_mpi.search.proposals import GenerationSummary
from agglom_mpi.storage.lock import KILLED, CampaignLock
from agglom_mpi.storage.reader import read_campaign
from agglom_mpi.storage.schema import RESULTS, sample_dtype
from agglom_mpi.storage.table import checksums, make_row
from agglom_mpi.storage.writer import CampaignWriter

TITLE = "A [bold] title [/no] of :bug: grains"


@pytest.fixture
def path(tmp_path):
    """Return the file of a campaign that has not begun, its name full of what rich could mean."""
    text = write_campaign(tmp_path / "small.yaml", **SMALL).read_text()
    (tmp_path / "small.yaml").write_text(
        "\n".join([f"title: '{TITLE}'", *text.splitlines()[2:]]) + "\n"
    )
    path = tmp_path / "out[red]:100:.h5"
    prepare(
        path, InversionExperiment(load_campaign(tmp_path / "small.yaml")), accept_code_change=False
    )
    return path


def put(writer, string, objective, **changes):
    fields = {
        "objective": objective,
        "standard_error": 0.01,
        "mean_radius_ratio": 1.9,
        "mean_grains": 7.0,
        "growth_number": 6.859,
        "samples_used": 10,
        "failed": 0,
        "hit_maximum": False,
    }
    writer.put_result(make_row(RESULTS.dtype, string=string, **(fields | changes)))


@pytest.fixture
def begun(path):
    """Return the file of a campaign that was killed: five strings, two judged, one of them bad."""
    parameters = np.full((5, 10), 2.0)
    parameters[:, 9] = np.nan
    with CampaignWriter(path) as writer:
        writer.log.begin_leg(**leg_start(1, ""))
        writer.set_status("running")
        writer.put_strings(0, 0, np.arange(5), np.zeros(5, int), np.full((5, 2), -1), parameters)
        rows = np.zeros(12, sample_dtype)
        rows["sample"], rows["state"] = np.arange(12), 1
        rows["state"][3] = 2
        rows["seconds"], rows["cpu_seconds"] = 0.25, 0.125
        writer.put_samples(rows)
        put(writer, 1, 0.25, standard_error=np.nan, hit_maximum=True)
        put(writer, 0, 0.125, failed=1)
        put(writer, 2, np.inf, standard_error=np.nan, mean_radius_ratio=np.nan)
    return path


def printed(content, monkeypatch, capsys):
    monkeypatch.setenv("COLUMNS", "60")
    print_wide(content)
    return capsys.readouterr().out


def test_a_run_that_was_killed_is_stopped_and_one_that_has_the_lock_is_not(begun):
    with CampaignLock(begun):
        assert collect_summary(read_campaign(begun))["state"] == "running"
    summary = collect_summary(read_campaign(begun))
    assert (summary["state"], summary["reason"]) == ("stopped", KILLED)
    assert open_campaign(begun).status().state == "stopped"
    with CampaignWriter(begun) as writer:
        writer.log.begin_leg(**leg_start(2, "", database="parallel"))
        writer.set_status("running")
    assert collect_summary(read_campaign(begun))["state"] == "running", "it may have no lock"


def test_another_machine_may_see_no_lock(begun, monkeypatch):
    monkeypatch.setattr("socket.gethostname", lambda: "elsewhere")
    status = open_campaign(begun).status()
    assert status.state == "running"
    assert "elsewhere" in status.reason


def test_a_campaign_that_has_not_begun_has_a_summary(path, monkeypatch, capsys):
    summary = collect_summary(read_campaign(path))
    assert (summary["state"], summary["reason"]) == ("stopped", "not started yet")
    assert (summary["strings"], summary["samples_simulated"], summary["best"]) == (0, 0, [])
    assert summary["samples_per_second"] == 0.0
    text = printed(summary_table(read_campaign(path)), monkeypatch, capsys)
    assert "stopped: not started yet" in text


def test_an_unfinished_file_shows_what_is_judged_best_first(begun):
    summary = collect_summary(read_campaign(begun))
    assert summary["state"] == "stopped"
    assert summary["strings"] == 3
    assert [entry["string"] for entry in summary["best"]] == [0, 1]
    assert summary["samples_used"] == 30
    assert summary["samples_simulated"] == 12
    assert (summary["failed"], summary["hit_maximum"]) == (1, 1)
    assert "surface_energy" not in summary["best"][0]


def test_a_string_is_shown_with_the_processor_time_of_its_samples(begun):
    file = read_campaign(begun)
    rows = file.all_sample_rows()
    for entry in collect_summary(file)["best"]:
        own = rows[rows["string"] == entry["string"]]
        assert entry["processor_seconds"] == 0.125 * len(own)
        assert entry["seconds"] == 0.25 * len(own)
        for column, key in (("cpu_seconds", "processor_seconds"), ("seconds", "seconds")):
            assert open_campaign(begun).strings[column][entry["string"]] == entry[key]


def test_wall_clock_time_is_shown_where_processor_time_was_not_recorded(begun, monkeypatch, capsys):
    def last_row():
        text = printed(summary_table(read_campaign(begun)), monkeypatch, capsys)
        return next(line.split() for line in text.splitlines() if line.split()[1:2] == ["time"])

    assert last_row() == ["processor", "time", "1.5", "s", "0", "s"]
    with h5py.File(begun, "r+") as file:
        rows = file["samples"][:12]
        rows["cpu_seconds"] = np.nan
        rows["crc"] = checksums(rows)
        file["samples"][:12] = rows
    assert last_row() == ["wall-clock", "time", "3", "s", "0", "s"]


def test_at_most_so_many_strings_are_shown(begun):
    assert len(collect_summary(read_campaign(begun), best=1)["best"]) == 1


def test_json_has_no_nan(begun):
    def refuse(constant):
        raise AssertionError(constant)

    report = json.loads(to_json(collect_summary(read_campaign(begun))), parse_constant=refuse)
    assert report["best"][1]["standard_error"] is None
    assert report["best"][0]["standard_error"] == 0.01


def test_a_title_and_a_path_are_shown_as_they_are_written(begun, monkeypatch, capsys):
    text = printed(summary_table(read_campaign(begun)), monkeypatch, capsys)
    assert text.splitlines()[0].strip() == TITLE
    assert text.splitlines()[-1].strip() == str(begun)
    assert "1 sample failed" in text
    assert "1 string ended at max_samples" in text


def test_a_table_is_not_squeezed_into_a_narrow_pipe(begun, monkeypatch, capsys):
    text = printed(summary_table(read_campaign(begun)), monkeypatch, capsys)
    rows = [re.split(" {2,}", line) for line in text.splitlines()]
    assert ["objective, as searched", "0.125 ± 0.010", "0.25"] in rows


def test_a_single_sample_has_no_standard_error(begun, monkeypatch, capsys):
    assert "nan" not in printed(summary_table(read_campaign(begun)), monkeypatch, capsys)


@pytest.mark.parametrize("text", ["x.yaml:100: scene: is [bold]", "[/red] :bug:"])
def test_a_message_is_shown_as_it_is_written(capsys, text):
    display = Display()
    display.message(text)
    display.error(text)
    Display(quiet=True).message("nothing")
    Display(quiet=True).error("an error")
    assert capsys.readouterr().err.splitlines() == [text, text, "an error"]


def test_a_generation_without_result_is_shown_too(capsys):
    summary = GenerationSummary(0, 3, np.inf, np.nan, np.inf, np.arange(4), 4, 20)
    Display().generation(summary, 9, 25, 100.0)
    assert "best no result (string 3)" in capsys.readouterr().err
