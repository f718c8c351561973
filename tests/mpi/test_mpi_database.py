"""Who writes samples, rank 0 or every rank its own, changes no byte of what is decided."""

import os
from pathlib import Path

import h5py
import numpy as np
import pytest
from campaign_runs import (
    SLOWLY,
    SMALL,
    TINY,
    assert_same,
    assert_sound,
    decisions,
    finish,
    inject,
    invert,
    need_parallel_hdf5,
    state,
    stop,
    write_campaign,
)
from mpi_injections import SENDS_WAIT_TO_BE_RECEIVED, slow

from agglom_mpi.runtime.file_setup import OutputError
from agglom_mpi.runtime.launch import GATHERED, PARALLEL, choose_database
from agglom_mpi.storage.reader import read_campaign

TWO_NODES = """
from agglom_mpi.runtime import launch, leg, run

def pretend(world):
    return launch.Nodes(2, world.rank == 1)

run.find_nodes = leg.find_nodes = pretend

import os
from agglom_mpi.storage import row_buffer as samples

synced = samples.RankWriter.sync

def sync(self):
    # Before it is done: a disc may take long.
    if self._descriptor is not None:
        with open("synced", "a") as file:
            file.write("x")
    synced(self)

samples.RankWriter.sync = sync
"""


NOT_OPENED = """
import h5py.h5f as h5f
from agglom_mpi.storage import access

class Files:
    ACC_RDWR, ACC_RDONLY, ACC_TRUNC = h5f.ACC_RDWR, h5f.ACC_RDONLY, h5f.ACC_TRUNC
    LIBVER_EARLIEST, LIBVER_LATEST = h5f.LIBVER_EARLIEST, h5f.LIBVER_LATEST
    create = h5f.create

    @staticmethod
    def open(name, flags, fapl):
        if fapl.get_driver() == access.h5py.h5fd.MPIO:
            raise OSError("MPI_ERR_NO_SUCH_FILE: no such file or directory")
        return h5f.open(name, flags, fapl=fapl)

access.h5f = Files
"""


@pytest.fixture
def parallel():
    """Go on only if HDF5 can write in parallel."""
    need_parallel_hdf5()


class World:
    def __init__(self, size):
        self.size = size


def test_the_choice_follows_the_build(monkeypatch):
    able = type("Configuration", (), {"mpi": True})
    serial = type("Configuration", (), {"mpi": False})
    monkeypatch.setattr(h5py, "get_config", lambda: able)
    assert choose_database(None, World(2)) == PARALLEL
    assert choose_database(GATHERED, World(2)) == GATHERED
    assert choose_database(None, World(1)) == choose_database(None, None) == GATHERED
    assert choose_database(PARALLEL, World(1)) == PARALLEL
    with pytest.raises(OutputError, match="mpirun"):
        choose_database(PARALLEL, None)
    monkeypatch.setattr(h5py, "get_config", lambda: serial)
    assert choose_database(None, World(2)) == GATHERED
    with pytest.raises(OutputError, match=r"built without MPI.*allowed is gathered"):
        choose_database(PARALLEL, World(2))


def test_what_this_build_cannot_do_is_one_message_and_no_file(tmp_path):
    write_campaign(tmp_path / "tiny.yaml", **TINY)
    done = invert(tmp_path, "tiny.yaml", "--database", "parallel")
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.startswith("--database parallel: ")
    assert done.stderr.count("\n") == 1
    assert not (tmp_path / "tiny.h5").exists()


@pytest.mark.parametrize("ranks", [3, slow(5)])
@pytest.mark.parallel_hdf5
def test_ranks_that_write_themselves_leave_the_same_rows(small, tmp_path, parallel, ranks):
    for database in (PARALLEL, GATHERED):
        path = tmp_path / f"{database}.h5"
        about = ("-o", path, "--database", database, "--quiet")
        done = finish(small, "small.yaml", *about, ranks=ranks)
        assert done.stdout == done.stderr == ""
        assert_same(path, decisions(small / "small.h5"))
        assert_sound(path)
        file = read_campaign(path)
        assert set(file.all_sample_rows()["rank"]) == set(range(ranks))
        leg = file.legs()[0]
        assert (leg["database"].decode(), leg["ranks"], leg["nodes"]) == (database, ranks, 1)
        assert leg["samples"] == len(file.all_sample_rows())
        assert 0.0 < leg["database_seconds"] < leg["ranks"] * (leg["stopped"] - leg["started"])


@pytest.mark.parallel_hdf5
def test_the_start_says_who_writes(small, tmp_path, parallel):
    done = finish(small, "small.yaml", "-o", tmp_path / "a.h5", ranks=2)
    assert "2 ranks, parallel database, into " in done.stderr
    done = finish(small, "small.yaml", "-o", tmp_path / "b.h5", "--database", "gathered", ranks=2)
    assert "2 ranks, gathered database, into " in done.stderr


@pytest.mark.parallel_hdf5
def test_the_layout_does_not_depend_on_who_writes(small, tmp_path, parallel):
    sizes = []
    for database in (PARALLEL, GATHERED):
        path = tmp_path / f"{database}.h5"
        finish(small, "small.yaml", "-o", path, "--database", database, ranks=2)
        with h5py.File(path, "r") as file:
            places = {name: dataset.id.get_offset() for name, dataset in file.items()}
            sizes.append((path.stat().st_size, places))
    assert sizes[0] == sizes[1]


@pytest.mark.parallel_hdf5
def test_a_leg_may_be_written_otherwise_than_the_last(small, tmp_path, parallel):
    write_campaign(tmp_path / "slow.yaml", **SMALL)
    for database, ranks in [("parallel", 2), ("gathered", 3), ("parallel", 3)]:
        code, said = stop(tmp_path, "slow", "--database", database, ranks=ranks)
        assert code == 75, said
    finish(tmp_path, "slow.yaml")
    assert_same(tmp_path / "slow.h5", decisions(small / "small.h5"))
    assert_sound(tmp_path / "slow.h5")
    legs = read_campaign(tmp_path / "slow.h5").legs()
    assert legs["database"].tolist() == [b"parallel", b"gathered", b"parallel", b"gathered"]
    assert min(legs["samples"]) > 0


@pytest.mark.slow
@pytest.mark.parallel_hdf5
def test_a_leg_may_run_on_the_other_build(small, tmp_path, parallel):
    if "AGGLOM_OTHER_BUILD" not in os.environ:
        assert "CI" not in os.environ
        pytest.skip("AGGLOM_OTHER_BUILD names no folder bin with the other build")
    other = Path(os.environ["AGGLOM_OTHER_BUILD"])
    write_campaign(tmp_path / "slow.yaml", **SMALL)
    for options in ({"build": other, "ranks": 2}, {"ranks": 2}, {"build": other}):
        code, said = stop(tmp_path, "slow", **options)
        assert code == 75, said
    finish(tmp_path, "slow.yaml", ranks=3)
    assert_same(tmp_path / "slow.h5", decisions(small / "small.h5"))
    assert_sound(tmp_path / "slow.h5")
    legs = read_campaign(tmp_path / "slow.h5").legs()
    assert legs["database"].tolist() == [b"gathered", b"parallel", b"gathered", b"parallel"]
    assert min(legs["samples"]) > 0
    assert len(set(legs["hdf5"].tolist())) == 2


@pytest.mark.parallel_hdf5
def test_a_node_of_its_own_is_asked_to_sync(tmp_path, parallel):
    write_campaign(tmp_path / "slow.yaml", **SMALL)
    # A generation must take longer than rows may wait to be written.
    folder = inject(tmp_path / "inject", SLOWLY + TWO_NODES)
    printed = finish(tmp_path, "slow.yaml", ranks=3, inject=folder).stderr
    said = (tmp_path / "synced").read_text()
    generations = len(read_campaign(tmp_path / "slow.h5").generation_rows())
    # After each generation but perhaps the last, and at the end, by the first rank of that node.
    assert said.count("x") in (generations, generations + 1), printed
    assert state(tmp_path / "slow.h5")[0] == "finished"
    assert np.all(read_campaign(tmp_path / "slow.h5").legs()["nodes"] == 2)


@pytest.mark.parallel_hdf5
def test_nobody_is_asked_to_sync_who_has_left(tmp_path, parallel):
    """Where a send waits to be received, one to a rank that has left would wait for ever."""
    write_campaign(tmp_path / "slow.yaml", **SMALL)
    folder = inject(tmp_path / "inject", SLOWLY + TWO_NODES + SENDS_WAIT_TO_BE_RECEIVED)
    code, said = stop(tmp_path, "slow", ranks=3, inject=folder)
    assert code == 75, said
    finish(tmp_path, "slow.yaml", ranks=3, inject=folder)
    assert_sound(tmp_path / "slow.h5")


@pytest.mark.parallel_hdf5
def test_a_file_that_ranks_do_not_find_is_one_message_and_a_way_out(tmp_path, parallel):
    write_campaign(tmp_path / "tiny.yaml", **TINY)
    folder = inject(tmp_path / "inject", NOT_OPENED)
    done = invert(tmp_path, "tiny.yaml", ranks=3, inject=folder)
    assert done.returncode == 1
    assert "tiny.h5: cannot be opened by all ranks together (MPI_ERR_NO_SUCH_FILE" in done.stderr
    assert "--database gathered" in done.stderr
    assert "Traceback" not in done.stderr
    finish(tmp_path, "tiny.yaml", "--database", "gathered", ranks=3, inject=folder)
    assert_sound(tmp_path / "tiny.h5")
