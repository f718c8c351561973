"""A user's own function on several ranks: its text travels, its file need not be there."""

import pytest
from campaign_runs import (
    assert_same,
    assert_sound,
    decisions,
    finish,
    inject,
    need_mpirun,
    need_parallel_hdf5,
)
from mpi_injections import RANK, of_ranks
from user_function_runs import write_own, write_quantities

OTHER_RANKS_CANNOT_READ = f"""{RANK}
import pathlib

read_bytes = pathlib.Path.read_bytes

def guarded(path):
    assert rank == "0" or path.name != "shape.py", "read on another rank"
    return read_bytes(path)

pathlib.Path.read_bytes = guarded
"""


@pytest.mark.ranks(guard="runtime/test_user_function_runs.py")
def test_ranks_decide_as_one_does_and_read_no_source(tmp_path):
    need_mpirun()
    for name in ("one", "two"):
        (tmp_path / name).mkdir()
        write_own(tmp_path / name)
    finish(tmp_path / "one", "own.yaml", "--allow-code")
    guard = inject(tmp_path / "guard", OTHER_RANKS_CANNOT_READ)
    finish(tmp_path / "two", "own.yaml", "--allow-code", ranks=2, inject=guard)
    assert_same(tmp_path / "two" / "own.h5", decisions(tmp_path / "one" / "own.h5"))


@pytest.mark.parametrize(
    "database",
    [
        of_ranks("gathered", guard="runtime/test_quantity_runs.py"),
        pytest.param("parallel", marks=pytest.mark.parallel_hdf5),
    ],
)
def test_ranks_send_and_store_named_quantities(tmp_path, database):
    need_mpirun()
    if database == "parallel":
        need_parallel_hdf5()
    for name in ("one", "three"):
        (tmp_path / name).mkdir()
        write_quantities(tmp_path / name, final="{strings: 2, samples: 4}")
    finish(tmp_path / "one", "own.yaml", "--allow-code")
    options = ("--allow-code", "--database", database)
    finish(tmp_path / "three", "own.yaml", *options, ranks=3)
    assert_same(tmp_path / "three" / "own.h5", decisions(tmp_path / "one" / "own.h5"))
    assert_sound(tmp_path / "three" / "own.h5")
