"""A finished file lacks a row: its done byte was cleared. `check` and `report` end with 1."""

import shutil

import h5py
import numpy as np
import pytest
from campaign_runs import assert_same, decisions, finish, write_campaign
from storage_rows import put_status

from agglom_mpi.analysis.completeness import FinishedCounts, finished_reason, lacks_rows
from agglom_mpi.analysis.file_check import check_file
from agglom_mpi.analysis.summary import collect_summary
from agglom_mpi.storage.compact import write_compact
from agglom_mpi.storage.reader import read_campaign


@pytest.fixture
def copy(finished, tmp_path):
    shutil.copy(finished.with_suffix(".yaml"), tmp_path)
    return shutil.copy(finished, tmp_path / finished.name)


def clear(path, table, *places):
    with h5py.File(path, "r+") as file:
        for place in places:
            assert file[f"{table}_done"][place]
            file[f"{table}_done"][place] = 0


def fresh_places(path):
    """Places of the fresh samples of the best string."""
    data = read_campaign(path)
    best = collect_summary(data)["best"][0]["string"]
    first = best * data.max_samples + data.fresh_from
    return [*range(first, (best + 1) * data.max_samples)]


def final_places(path, table):
    with h5py.File(path, "r") as file:
        return np.flatnonzero(file[f"{table}_done"][:]).tolist()


def set_status(path, **columns):
    with h5py.File(path, "r+") as file:
        put_status(file, **columns)


def add_leg(path):
    """Add a leg like the first, as if the campaign had been run twice."""
    with h5py.File(path, "r+") as file:
        file["legs"][1] = file["legs"][0]
        file["legs_done"][1] = 1


def test_the_whole_file_lacks_nothing(agglom, copy):
    counts = FinishedCounts.of_reason(read_campaign(copy).status().reason)
    assert counts == FinishedCounts(3, 6, 12, None)
    assert not lacks_rows(read_campaign(copy))
    assert check_file(copy)[1] == 0
    assert agglom("report", copy).exit_code == 0


# An older file with several legs may have been asked for fewer samples later: the last may lack.
@pytest.mark.parametrize(
    ("told", "which"),
    [
        *(("by the status", which) for which in (0, 5, -1)),
        *(("by the text", which) for which in (0, -1)),
        *(("by the others", which) for which in (0, 5)),
    ],
)
def test_a_cleared_fresh_sample_is_damage(agglom, copy, told, which):
    if told != "by the status":
        set_status(copy, reason=b"all 3 generations are done")
    if told == "by the others":
        add_leg(copy)
    places = fresh_places(copy)
    clear(copy, "samples", places[which])
    text, code = check_file(copy)
    assert code == 1
    assert f"sample {places[which] % 42} of string {places[which] // 42} absent" in text
    assert "a resume would simulate again" in text
    done = agglom("report", copy)
    assert (done.exit_code, done.stderr.count("agglom check")) == (1, 1)


def test_all_fresh_samples_of_a_string_and_of_a_compact_copy_are_missed(agglom, copy, tmp_path):
    places = fresh_places(copy)
    clear(copy, "samples", *places)
    text, code = check_file(copy)
    assert (code, text.count("absent")) == (1, 1)
    write_compact(copy, tmp_path / "compact.h5")
    assert agglom("report", tmp_path / "compact.h5").exit_code == 1


@pytest.mark.parametrize("place", [0, -1])
@pytest.mark.parametrize("table", ["strings", "results", "generations", "samples", "legs"])
def test_no_done_byte_of_a_finished_file_can_be_cleared(agglom, copy, table, place):
    places = final_places(copy, table)
    clear(copy, table, places[min(place, len(places) - 1)])
    assert check_file(copy)[1] == 1
    unused = table == "legs" or (table == "samples" and place == -1)
    assert unused or lacks_rows(read_campaign(copy))


def test_a_generation_with_all_it_rests_on_is_missed(copy):
    data = read_campaign(copy)
    strings = data.string_rows()["string"][data.string_rows()["generation"] == 2].tolist()
    most = data.max_samples
    clear(copy, "generations", 2)
    clear(copy, "results", *strings)
    clear(copy, "strings", *strings)
    clear(copy, "samples", *(p for p in final_places(copy, "samples") if p // most in strings))
    assert check_file(copy)[1] == 1
    assert lacks_rows(read_campaign(copy))


def test_a_resume_makes_them_again(finished, copy):
    clear(copy, "samples", *fresh_places(copy)[3:5])
    finish(copy.parent, copy.with_suffix(".yaml").name)
    assert_same(copy, decisions(finished))
    assert check_file(copy)[1] == 0
    assert len(read_campaign(copy).fresh_samples) == 6 * 12


def test_only_a_finished_campaign_must_have_them(agglom, copy):
    set_status(copy, state=b"stopped", reason=b"received SIGTERM")
    add_leg(copy)
    clear(copy, "samples", fresh_places(copy)[0])
    assert check_file(copy)[1] == 0
    assert agglom("report", copy).exit_code == 0


@pytest.mark.slow
def test_what_later_legs_ask_for_is_no_damage(tmp_path):
    asked = {"generations": 2, "max_samples": 20}
    for i, final in enumerate(("{strings: 3, samples: 9}", "{strings: 2, samples: 4}", "none")):
        write_campaign(tmp_path / "a.yaml", final=final, **asked | {"generations": 2 + i})
        finish(tmp_path, "a.yaml")
        assert check_file(tmp_path / "a.h5")[1] == 0
        assert not lacks_rows(read_campaign(tmp_path / "a.h5"))


@pytest.mark.parametrize(
    ("counts", "text"),
    [
        ((0, 0, 0), "all 3 generations are done"),
        ((6, 100, 0), "estimated again: 6 strings on 100 fresh samples each"),
        ((1, 2, 12), "12 frames stored"),
        ((0, 0, 1), "1 frame stored"),
    ],
)
def test_what_a_status_states_is_read_again(counts, text):
    reason = finished_reason("all 3 generations are done", *counts)
    assert text in reason
    strings, samples, frames = (count or None for count in counts)
    assert FinishedCounts.of_reason(reason) == FinishedCounts(3, strings, samples, frames)
    none = FinishedCounts.of_reason(finished_reason("all 3 generations are done", 0, 0, 0, room=9))
    assert none == FinishedCounts(3, 0, 0, None)
    long = finished_reason("all 1000000 generations are done", 10**5, 10**6, 10**7)
    assert len(long.encode()) <= 128
    assert FinishedCounts.of_reason(long) == FinishedCounts(10**6, 10**5, 10**6, 10**7)
