"""The same decisions, bit for bit, however many ranks there are."""

import sys

import pytest
from campaign_runs import (
    SMALL,
    TINY,
    assert_same,
    assert_sound,
    decisions,
    finish,
    inject,
    invert,
    need_mpirun,
    state,
    stop,
    write_campaign,
)
from mpi_injections import slow

from agglom_mpi.storage.reader import read_campaign

HARDLY_LOOKS = """
import agglom_mpi.runtime.wakeup as waiting

waiting.QUIET = 60.0
"""


@pytest.mark.parametrize("ranks", [3, slow(8)])
def test_decisions_do_not_depend_on_the_number_of_ranks(small, tmp_path, ranks):
    """A message that nobody rings for is read a minute later here: a few are too many."""
    need_mpirun()
    folder = inject(tmp_path / "inject", HARDLY_LOOKS)
    finish(small, "small.yaml", "-o", tmp_path / "ranks.h5", ranks=ranks, inject=folder)
    assert_same(tmp_path / "ranks.h5", decisions(small / "small.h5"))
    assert_sound(tmp_path / "ranks.h5")
    file = read_campaign(tmp_path / "ranks.h5")
    assert file.legs()["ranks"].tolist() == [ranks]
    assert set(file.all_sample_rows()["rank"]) == set(range(ranks))
    assert state(file.path) == ("finished", "all 3 generations are done")


@pytest.mark.parametrize(("ranks", "stops"), [slow(3, 2)])
def test_decisions_do_not_depend_on_interruptions_with_any_number_of_ranks(
    small, tmp_path, ranks, stops
):
    need_mpirun()
    path = tmp_path / "small.h5"
    write_campaign(tmp_path / "small.yaml", **SMALL)
    for _ in range(stops):
        code, said = stop(tmp_path, "small", ranks=ranks)
        assert code == 75, said
        assert_sound(path)
    finish(tmp_path, "small.yaml", ranks=ranks)
    assert_same(path, decisions(small / "small.h5"))
    assert_sound(path)
    assert read_campaign(path).legs()["exit_code"].tolist() == [75] * stops + [0]


@pytest.mark.slow
def test_more_ranks_than_work_finish(tmp_path):
    need_mpirun()
    write_campaign(tmp_path / "tiny.yaml", **TINY)
    finish(tmp_path, "tiny.yaml", ranks=5)
    finish(tmp_path, "tiny.yaml", "-o", "plain.h5")
    assert_same(tmp_path / "tiny.h5", decisions(tmp_path / "plain.h5"))


@pytest.fixture
def no_library(monkeypatch):
    """See to it that no MPI library can be loaded in this process; a list of who tried."""
    attempted = []

    class Refuse:
        def find_spec(self, name, path=None, target=None):
            if name == "mpi4py.MPI":
                attempted.append(name)
                raise RuntimeError("cannot load MPI library")

    monkeypatch.setattr(sys, "meta_path", [Refuse(), *sys.meta_path])
    monkeypatch.delitem(sys.modules, "mpi4py.MPI", raising=False)
    if "mpi4py" in sys.modules:  # a test before may have loaded the library
        monkeypatch.delattr(sys.modules["mpi4py"], "MPI", raising=False)
    return attempted


def test_a_plain_run_needs_no_mpi_library(tmp_path, no_library):
    write_campaign(tmp_path / "tiny.yaml", **TINY)
    finish(tmp_path, "tiny.yaml")
    assert not no_library
    assert state(tmp_path / "tiny.h5")[0] == "finished"


def test_ranks_without_an_mpi_library_are_told_so(tmp_path, no_library, monkeypatch):
    write_campaign(tmp_path / "tiny.yaml", **TINY)
    monkeypatch.setenv("PMI_SIZE", "2")
    monkeypatch.setenv("PMI_RANK", "0")
    done = invert(tmp_path, "tiny.yaml")
    assert done.returncode == 2
    assert "launched as 2 MPI rank(s), but no MPI library" in done.stderr
    assert done.stderr.count("\n") == 1
    assert no_library
