"""Components of one's own on several ranks: their bytes travel, their file need not be there."""

import pytest
from campaign_runs import (
    assert_same,
    decisions,
    finish,
    inject,
    need_mpirun,
    need_parallel_hdf5,
)
from mpi_injections import RANK, of_ranks
from own_components import NUMBERS_OF_COPIES, write_copies

GATHERED = of_ranks("gathered", guard="runtime/test_own_component_runs.py")
PARALLEL = pytest.param("parallel", marks=pytest.mark.parallel_hdf5)

OTHER_RANKS_CANNOT_READ = f"""{RANK}
import pathlib

open_file = pathlib.Path.open

def guarded(path, *arguments, **named):
    assert rank == "0" or path.name != "mine.py", "read on another rank"
    return open_file(path, *arguments, **named)

pathlib.Path.open = guarded
"""


@pytest.fixture(scope="module")
def alone(tmp_path_factory):
    """Return the decisions of one process."""
    folder = tmp_path_factory.mktemp("alone")
    write_copies(folder, "own", **NUMBERS_OF_COPIES)
    finish(folder, "own.yaml", "--allow-code")
    return decisions(folder / "own.h5")


def need(database):
    need_mpirun()
    if database == "parallel":
        need_parallel_hdf5()


@pytest.mark.parametrize("database", [GATHERED, PARALLEL])
def test_ranks_decide_as_one_does_and_read_no_module(alone, tmp_path, database):
    need(database)
    write_copies(tmp_path, "own", **NUMBERS_OF_COPIES)
    guard = inject(tmp_path / "guard", OTHER_RANKS_CANNOT_READ)
    arguments = ("own.yaml", "--allow-code", "--database", database)
    finish(tmp_path, *arguments, ranks=3, inject=guard)
    assert_same(tmp_path / "own.h5", alone)
