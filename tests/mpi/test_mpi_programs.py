"""Ranks of one job that do not run the same program."""

import pytest
from campaign_runs import inject, invert, need_mpirun, write_campaign
from mpi_injections import RANK

from agglom_mpi.errors import BAD_INPUT
from agglom_mpi.runtime.launch import LaunchError, refuse_others
from agglom_mpi.version import __version__

OLD_VERSION = f"""{RANK}
import agglom_mpi.version

if rank == "1":
    agglom_mpi.version.__version__ = "0.0.9"
"""

OTHER_SOURCES = f"""{RANK}
import agglom_mpi.runtime.file_setup as file_setup

if rank == "1":
    file_setup.sources_digest = lambda: 64 * "f"
"""


@pytest.mark.parametrize(
    ("program", "named"),
    [
        pytest.param(OLD_VERSION, ["rank 1 on ", "0.0.9", __version__], id="version"),
        pytest.param(
            OTHER_SOURCES,
            ["rank 1 on ", "sources ffffffffffff"],
            id="sources",
            marks=pytest.mark.slow,
        ),
    ],
)
def test_a_rank_of_another_program_is_refused_before_anything_is_written(tmp_path, program, named):
    need_mpirun()
    write_campaign(tmp_path / "small.yaml")
    done = invert(tmp_path, "small.yaml", ranks=2, inject=inject(tmp_path / "inject", program))
    assert done.returncode == BAD_INPUT
    said = done.stderr.partition("-----")[0]  # Open MPI's launcher adds words of its own
    assert said.count("\n") == 1
    assert all(word in said for word in named)
    assert not (tmp_path / "small.h5").exists()


def test_many_other_ranks_are_counted():
    programs = ["1.0 abc node0"] * 2 + ["1.1 abc node1"] * 5000
    with pytest.raises(LaunchError, match=r"rank 2 on node1, and 4999 more ranks .* 1\.1 .* 1\.0"):
        refuse_others(programs)
    refuse_others(["1.0 abc node0", "1.0 abc node 1"])
