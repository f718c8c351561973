"""A campaign that learned from another decides the same however it is run, without that file."""

import signal

import pytest
from campaign_runs import (
    STOPS,
    assert_same,
    assert_sound,
    decisions,
    finish,
    inject,
    invert,
    need_mpirun,
    state,
    stop,
    stop_here,
)
from search_runs import write_search

from agglom_mpi.storage.reader import read_campaign

SEARCH = "{method: surrogate, initial: 9, batch: 5, %s learn_from: one.h5}"


def write_next(folder, more=""):
    """Write a campaign that learns from one.h5 and has another target."""
    path = write_search(folder / "next.yaml", SEARCH % more, samples=2, generations=4)
    path.write_text(path.read_text().replace("ratio: 2", "ratio: 1.5"))


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """Return a folder with a campaign, and one that learned from it in one leg."""
    folder = tmp_path_factory.mktemp("whole")
    write_search(folder / "one.yaml", "{method: sobol, population: 7}", samples=2, generations=2)
    finish(folder, "one.yaml")
    write_next(folder)
    finish(folder, "next.yaml")
    return folder


@pytest.fixture
def begun(whole, tmp_path):
    """Return a folder with the same campaign, to be run otherwise."""
    (tmp_path / "one.h5").write_bytes((whole / "one.h5").read_bytes())
    write_next(tmp_path)
    return tmp_path


def test_a_stopped_campaign_goes_on_without_the_file_it_learned_from(whole, begun):
    stop_here(begun, "next", after=12)
    (begun / "one.h5").unlink()
    assert_sound(begun / "next.h5")
    finish(begun, "next.yaml")
    assert_same(begun / "next.h5", decisions(whole / "next.h5"))
    assert_sound(begun / "next.h5")


def test_a_longer_campaign_keeps_what_it_learned(whole, begun):
    finish(begun, "next.yaml", "--generations", "2")
    (begun / "one.h5").unlink()
    finish(begun, "next.yaml")
    assert_same(begun / "next.h5", decisions(whole / "next.h5"))
    theirs, ours = (read_campaign(f / "next.h5").learned_rows() for f in (whole, begun))
    assert ours.tobytes() == theirs.tobytes()


def test_the_earlier_file_may_go_on_meanwhile(whole, begun):
    finish(begun, "next.yaml", "--generations", "2")
    write_search(begun / "one.yaml", "{method: sobol, population: 7}", samples=2, generations=4)
    finish(begun, "one.yaml")
    assert len(read_campaign(begun / "one.h5").string_rows()) == 28
    finish(begun, "next.yaml")
    assert_same(begun / "next.h5", decisions(whole / "next.h5"))


def test_a_campaign_that_learned_is_not_continued_by_one_that_does_not(whole, begun):
    finish(begun, "next.yaml", "--generations", "1")
    text = (begun / "next.yaml").read_text()
    (begun / "next.yaml").write_text(text.replace(",  learn_from: one.h5", ""))
    done = invert(begun, "next.yaml")
    assert done.returncode == 2
    assert "search.learn_from: one.h5 in the file" in done.stderr


def test_a_search_for_a_set_learns_too(begun):
    write_next(begun, "aim: set, tolerance: 0.2,")
    finish(begun, "next.yaml")
    assert_sound(begun / "next.h5")
    assert set(read_campaign(begun / "next.h5").string_rows()["origin"].tolist()) == {2}


@pytest.mark.slow
def test_a_killed_campaign_goes_on_to_the_same_decisions(whole, begun):
    text = STOPS.replace("AFTER", "12").replace("NUMBER", str(int(signal.SIGKILL)))
    done = invert(begun, "next.yaml", inject=inject(begun / "inject", text))
    assert done.returncode == -signal.SIGKILL
    (begun / "one.h5").unlink()
    finish(begun, "next.yaml")
    assert_same(begun / "next.h5", decisions(whole / "next.h5"))
    assert_sound(begun / "next.h5")


@pytest.mark.ranks(guard="runtime/test_learning_runs.py")
def test_two_ranks_decide_as_one_process_does(whole, begun):
    need_mpirun()
    code, said = stop(begun, "next", ranks=2)
    assert code == 75, said
    (begun / "one.h5").unlink()
    finish(begun, "next.yaml", ranks=2)
    assert_same(begun / "next.h5", decisions(whole / "next.h5"))
    assert state(begun / "next.h5")[0] == "finished"
