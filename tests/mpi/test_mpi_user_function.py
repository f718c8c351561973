"""A user's own function on several ranks: its text travels, its file need not be there."""

from campaign_runs import assert_same, decisions, finish, inject, need_mpirun
from mpi_injections import RANK
from user_function_runs import write_own

OTHER_RANKS_CANNOT_READ = f"""{RANK}
import pathlib

read_bytes = pathlib.Path.read_bytes

def guarded(path):
    assert rank == "0" or path.name != "shape.py", "read on another rank"
    return read_bytes(path)

pathlib.Path.read_bytes = guarded
"""


def test_ranks_decide_as_one_does_and_read_no_source(tmp_path):
    need_mpirun()
    for name in ("one", "two"):
        (tmp_path / name).mkdir()
        write_own(tmp_path / name)
    finish(tmp_path / "one", "own.yaml", "--allow-code")
    guard = inject(tmp_path / "guard", OTHER_RANKS_CANNOT_READ)
    finish(tmp_path / "two", "own.yaml", "--allow-code", ranks=2, inject=guard)
    assert_same(tmp_path / "two" / "own.h5", decisions(tmp_path / "one" / "own.h5"))
