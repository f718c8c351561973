"""A search in which no string has a result has failed: one line, one traceback, exit code 1."""

import json

import pytest
from campaign_runs import TINY, finish, invert, state, write_campaign
from click.testing import CliRunner
from user_function_runs import write_own

from agglom_mpi.analysis.failed_samples import (
    NO_RESULT,
    cause_of,
    failure_lines,
    message_of,
    no_result,
)
from agglom_mpi.analysis.file_check import check_file
from agglom_mpi.campaign_file import open_campaign
from agglom_mpi.cli import main
from agglom_mpi.storage.reader import read_campaign
from agglom_mpi.storage.writer import CampaignWriter

RAISES = """
def worth(sample):
    raise ValueError(f"no worth of {sample.mean_radius_ratio}")
"""
"""The message differs from sample to sample."""

RAISES_OFTEN = """
seen = []
def worth(sample):
    seen.append(0)
    if len(seen) % 4 == 1:
        raise ValueError("one in four")
    if len(seen) % 4 == 2:
        return sample.mean_radius_ratio / 0
    return 1.0 + len(seen) % 3
"""
TINY_OWN = {"generations": 1, "max_samples": 5}


def lines_of(errors, beginning):
    return [line for line in errors.splitlines() if line.startswith(beginning)]


@pytest.fixture(scope="module")
def failed(tmp_path_factory):
    """Return the folder of a run whose samples all raised, and what it printed."""
    folder = tmp_path_factory.mktemp("failed")
    write_own(folder, RAISES, **TINY_OWN)
    return folder, invert(folder, "own.yaml", "--allow-code")


def test_a_run_whose_samples_all_raise_has_failed(failed):
    folder, done = failed
    assert done.returncode == 1
    assert done.stdout == ""
    assert done.stderr.count("Traceback") == 1
    [line] = lines_of(done.stderr, NO_RESULT)
    results = read_campaign(folder / "own.h5").result_rows()
    count = int(results["samples_used"].sum())
    assert count == int(results["failed"].sum()) == 20
    assert "20 of 20 samples failed; commonest reason (20 samples): ValueError: no worth" in line
    assert line.endswith("own.h5")
    reached, reason = state(folder / "own.h5")
    assert reached == "failed"
    assert reason.startswith(NO_RESULT)
    assert read_campaign(folder / "own.h5").legs()["exit_code"].tolist() == [1]


def test_the_same_command_again_fails_with_the_same_line(failed):
    folder, done = failed
    again = invert(folder, "own.yaml", "--allow-code")
    assert again.returncode == 1
    assert lines_of(again.stderr, NO_RESULT) == lines_of(done.stderr, NO_RESULT)
    assert "Traceback" not in again.stderr
    assert state(folder / "own.h5")[0] == "failed"


def test_the_report_counts_failures_by_reason_and_names_one_to_repeat(failed):
    data = read_campaign(failed[0] / "own.h5")
    count, command = failure_lines(data)
    rows = data.all_sample_rows()
    assert count.startswith(f"{len(rows)} samples failed ({len(rows)} by exception)")
    assert f"own.h5 --string {rows[0]['string']} --sample {rows[0]['sample']}" in command


def test_report_and_check_say_it_in_full(failed):
    path = failed[0] / "own.h5"
    wanted = no_result(read_campaign(path))
    said = CliRunner().invoke(main, ["report", str(path)])
    assert said.exit_code == 0, said.output
    assert f"failed: {wanted}" in said.stdout.splitlines()
    assert "objective" not in said.stdout
    found = json.loads(CliRunner().invoke(main, ["report", str(path), "--json"]).stdout)
    assert (found["state"], found["no_result"], found["best"]) == ("failed", wanted, [])
    text, code = check_file(str(path))
    assert code == 0, text
    assert f"failed: {wanted}" in text
    both = CliRunner().invoke(main, ["report", str(path), str(path)])
    assert both.stdout.count("no result") == 2


def test_more_generations_may_follow_and_fail_again(failed, tmp_path):
    write_own(tmp_path, RAISES, **TINY_OWN)
    assert invert(tmp_path, "own.yaml", "--allow-code").returncode == 1
    more = invert(tmp_path, "own.yaml", "--allow-code", "--generations", "2")
    assert more.returncode == 1
    assert "30 of 30 samples failed" in more.stderr
    assert len(read_campaign(tmp_path / "own.h5").generation_rows()) == 2


def test_a_file_that_an_earlier_version_called_finished_is_seen_through(tmp_path):
    write_own(tmp_path, RAISES, **TINY_OWN)
    invert(tmp_path, "own.yaml", "--allow-code")
    path = tmp_path / "own.h5"
    with CampaignWriter(path) as writer:
        writer.set_status("finished", "the 1 generation is done")
    wanted = no_result(read_campaign(path))
    assert wanted.startswith(NO_RESULT)
    said = CliRunner().invoke(main, ["report", str(path)]).stdout.splitlines()
    assert {wanted, "finished: the 1 generation is done"} <= set(said)
    assert wanted in check_file(str(path))[0]
    assert invert(tmp_path, "own.yaml", "--allow-code").returncode == 1


def test_each_cause_is_shown_once_and_the_commonest_is_named(tmp_path):
    write_own(tmp_path, RAISES_OFTEN, generations=1, max_samples=8)
    done = invert(tmp_path, "own.yaml", "--allow-code")
    assert done.returncode == 1
    assert done.stderr.count("Traceback") == 2
    assert "at most 10 % of those of a string may" in done.stderr
    [line] = lines_of(done.stderr, NO_RESULT)
    failures = read_campaign(tmp_path / "own.h5").failures()
    assert len({cause_of(row["text"].decode()) for row in failures}) == 2
    assert "ValueError: one in four" in line or "ZeroDivisionError: " in line


def test_samples_that_all_exceed_the_budget_are_a_failure(tmp_path):
    path = write_campaign(tmp_path / "budget.yaml", **TINY)
    engine = "end_time: characteristic\n  engine: {law: event, budget: 1}"
    path.write_text(path.read_text().replace("end_time: characteristic", engine))
    done = invert(tmp_path, "budget.yaml", "-q")
    assert done.returncode == 1
    [line] = done.stderr.splitlines()
    assert "20 of 20 samples failed; commonest reason (20 samples): budget of steps" in line


def test_objectives_that_are_all_infinite_are_a_failure(tmp_path):
    path = write_campaign(tmp_path / "even.yaml", **TINY)
    law = "{law: moments, targets: {skewness: 1}}"
    text = path.read_text().replace("{law: growth_target, ratio: 2}", law)
    path.write_text(text.replace("[10 MPa, 200 MPa]", "[1e20, 1e21]"))
    done = invert(tmp_path, "even.yaml", "-q")
    assert done.returncode == 1
    assert "20 samples completed, but particles of equal radii have no skewness" in done.stderr
    assert state(tmp_path / "even.h5")[0] == "failed"


def test_one_string_with_a_result_is_enough(tmp_path):
    source = """
def worth(sample):
    if sample.parameters["size_ratio"] > LIMIT:
        raise ValueError("too dense")
    return sample.mean_radius_ratio
"""
    # The random numbers may be others: the limit is that of the densest string but one.
    write_own(tmp_path, "def worth(sample):\n    return 1.0\n", "first", **TINY_OWN)
    finish(tmp_path, "first.yaml", "--allow-code")
    sizes = sorted(open_campaign(tmp_path / "first.h5").strings["size_ratio"])
    write_own(tmp_path, source.replace("LIMIT", repr(sizes[0] + 1e-9)), **TINY_OWN)
    done = finish(tmp_path, "own.yaml", "--allow-code")
    assert state(tmp_path / "own.h5")[0] == "finished"
    assert NO_RESULT not in done.stderr + done.stdout
    assert len(open_campaign(tmp_path / "own.h5").best(9)) == 4


TRACE = """Traceback (most recent call last):
  File "a.py", line 3, in worth
    return 1 / 0
           ~~^~~
ZeroDivisionError: division by zero
"""
CHAINED = f"""{TRACE}
During handling of the above exception, another exception occurred:

Traceback (most recent call last):
  File "a.py", line 5, in worth
    raise ValueError("one\\ntwo")
ValueError: one
two
"""


@pytest.mark.parametrize(
    ("text", "message", "cause"),
    [
        (TRACE, "ZeroDivisionError: division by zero", "line 3, in worth: ZeroDivisionError"),
        (CHAINED, "ValueError: one", "line 5, in worth: ValueError"),
        ("took longer than max_seconds, 3 s", "took longer than max_seconds, 3 s", "3 s"),
        ("", "", ""),
        ("the end of a long message\n", "the end of a long message", "message"),
    ],
)
def test_a_cause_is_a_place_and_a_type(text, message, cause):
    assert message_of(text) == message
    assert cause_of(text).endswith(cause)
