"""The same decisions, bit for bit, however many ranks there are."""

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

NO_LIBRARY = """
import sys

class Refuse:
    def find_spec(self, name, path=None, target=None):
        if name == "mpi4py.MPI":
            open("attempted", "a").close()
            raise RuntimeError("cannot load MPI library")

sys.meta_path.insert(0, Refuse())
"""


@pytest.mark.parametrize("ranks", [slow(1), slow(2), 3, slow(5), slow(8)])
def test_decisions_do_not_depend_on_the_number_of_ranks(small, tmp_path, ranks):
    need_mpirun()
    finish(small, "small.yaml", "-o", tmp_path / "ranks.h5", ranks=ranks)
    assert_same(tmp_path / "ranks.h5", decisions(small / "small.h5"))
    assert_sound(tmp_path / "ranks.h5")
    file = read_campaign(tmp_path / "ranks.h5")
    assert file.legs()["ranks"].tolist() == [ranks]
    assert set(file.all_sample_rows()["rank"]) == set(range(ranks))
    assert state(file.path) == ("finished", "all 3 generations are done")


@pytest.mark.parametrize(
    ("ranks", "stops"), [slow(2, 1), slow(1, 2), slow(2, 2), slow(3, 2), slow(5, 2), slow(8, 2)]
)
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


def test_a_plain_run_needs_no_mpi_library(tmp_path):
    write_campaign(tmp_path / "tiny.yaml", **TINY)
    folder = inject(tmp_path / "inject", NO_LIBRARY)
    finish(tmp_path, "tiny.yaml", inject=folder)
    assert not (tmp_path / "attempted").exists()
    assert state(tmp_path / "tiny.h5")[0] == "finished"


def test_ranks_without_an_mpi_library_are_told_so(tmp_path):
    write_campaign(tmp_path / "tiny.yaml", **TINY)
    folder = inject(tmp_path / "inject", NO_LIBRARY)
    done = invert(tmp_path, "tiny.yaml", inject=folder, PMI_SIZE="2", PMI_RANK="0")
    assert done.returncode == 2
    assert "launched as 2 MPI rank(s), but no MPI library" in done.stderr
    assert done.stderr.count("\n") == 1
    assert (tmp_path / "attempted").exists()
