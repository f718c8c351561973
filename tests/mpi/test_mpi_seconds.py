"""A sample that takes longer than `max_seconds` fails, and may be tried again by another run."""

import re

import pytest
from campaign_runs import (
    HANGS,
    HANGS_REPLACES,
    SMALL,
    assert_same,
    assert_sound,
    decisions,
    finish,
    inject,
    injected,
    invert,
    need_mpirun,
    state,
    write_campaign,
)
from mpi_injections import of_ranks

from agglom_mpi.storage.reader import read_campaign

PAIRS = [(2, 1), (5, 0)]
BY_ONE = "mpi/test_mpi_seconds.py::test_a_sample_that_takes_too_long_is_failed_and_has_no_row"


def hangs(pairs=PAIRS):
    return HANGS.replace("PAIRS", str(set(pairs)))


def write(path, **numbers):
    write_campaign(path, **SMALL | numbers)
    path.write_text(f"{path.read_text().rstrip()}\n  max_seconds: 1000 s\n")


@pytest.mark.parametrize("ranks", [None, of_ranks(2, guard=BY_ONE)])
def test_a_sample_that_takes_too_long_is_failed_and_has_no_row(tmp_path, ranks):
    if ranks:
        need_mpirun()
    write(tmp_path / "small.yaml", generations=2)
    if ranks:
        folder = inject(tmp_path / "inject", hangs())
        done = finish(tmp_path, "small.yaml", ranks=ranks, inject=folder)
    else:
        with injected(hangs(), *HANGS_REPLACES):
            done = finish(tmp_path, "small.yaml")
    for string, sample in PAIRS:
        text = rf"string {string} sample {sample} took longer than max_seconds, 1000 s"
        assert re.search(text, done.stderr)
    file = read_campaign(tmp_path / "small.h5")
    failures, rows, results = file.failures(), file.all_sample_rows(), file.result_rows()
    assert sorted(failures[["string", "sample"]].tolist()) == PAIRS
    assert not set(PAIRS) & set(rows[["string", "sample"]].tolist())
    assert [results["failed"][string] for string, _ in PAIRS] == [1, 1]
    assert_sound(file.path)
    before = decisions(file.path)
    again = finish(tmp_path, "small.yaml")  # what is decided stays
    assert "nothing to do" in again.stderr
    write(tmp_path / "small.yaml", generations=3)
    finish(tmp_path, "small.yaml")
    assert_sound(file.path)
    for name, values in decisions(file.path).items():
        assert values.startswith(before[name]) or name.startswith("samples.")


TWO_AT_ONCE = """
import agglom_mpi.scheduling.scheduler as scheduler

scheduler.MOST_JUDGED = 2
"""
"""Ends the run before the string of the sample is decided by others."""


@pytest.mark.slow
def test_a_sample_of_an_undecided_string_is_tried_again(tmp_path):
    write(tmp_path / "small.yaml")
    path = tmp_path / "small.yaml"
    path.write_text(path.read_text() + "  max_failures: 1\n")
    most = "agglom_mpi.scheduling.scheduler.MOST_JUDGED"
    with injected(hangs([(0, 1)]) + TWO_AT_ONCE, *HANGS_REPLACES, most):
        assert invert(tmp_path, "small.yaml").returncode == 1
    assert state(tmp_path / "small.h5")[0] == "failed"
    finish(tmp_path, "small.yaml")
    write(tmp_path / "other.yaml")
    finish(tmp_path, "other.yaml")
    assert_same(tmp_path / "small.h5", decisions(tmp_path / "other.h5"))
    assert_sound(tmp_path / "small.h5")


ROOM_FOR_ONE = """
import agglom_mpi.storage.room as room

room.FAILURE_CAPACITY = 1
"""


def test_a_run_ends_before_it_judges_by_a_sample_that_the_file_cannot_tell_of(tmp_path):
    write(tmp_path / "small.yaml", generations=2)
    capacity = "agglom_mpi.storage.room.FAILURE_CAPACITY"
    with injected(hangs() + ROOM_FOR_ONE, *HANGS_REPLACES, capacity):
        done = invert(tmp_path, "small.yaml")
    assert done.returncode == 1
    why = "samples took too long, and the file has no room left to tell of them"
    assert state(tmp_path / "small.h5") == ("failed", why)
    [told] = read_campaign(tmp_path / "small.h5").failures()[["string", "sample"]].tolist()
    assert told in PAIRS
    assert_sound(tmp_path / "small.h5")
    finish(tmp_path, "small.yaml")  # on a machine that has the time
    assert_sound(tmp_path / "small.h5")


def test_without_max_seconds_nothing_is_cut_short(tmp_path):
    write_campaign(tmp_path / "small.yaml", **SMALL | {"generations": 1})
    with injected(hangs(), *HANGS_REPLACES):
        done = finish(tmp_path, "small.yaml")
    assert "took longer" not in done.stderr
    assert len(read_campaign(tmp_path / "small.h5").failures()) == 0
