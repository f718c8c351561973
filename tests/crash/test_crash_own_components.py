"""A run with components of one's own that is killed goes on as one that was not."""

import os
import signal

import pytest
from campaign_runs import (
    Gate,
    assert_same,
    assert_sound,
    decisions,
    finish,
    need_mpirun,
    need_parallel_hdf5,
    running,
    wait_until,
)
from crash_processes import ranks_below
from own_components import NUMBERS_OF_COPIES, write_copies
from own_deciders import write_deciders
from processes import output_of, wait_until_gone

PARALLEL = pytest.param("parallel", marks=pytest.mark.parallel_hdf5)


def copies(folder):
    """Write a campaign whose components are copies of the package's."""
    write_copies(folder, "own", **NUMBERS_OF_COPIES)


@pytest.mark.slow
@pytest.mark.parametrize("database", ["gathered", PARALLEL])
@pytest.mark.parametrize(("write", "after"), [(copies, 6), (write_deciders, 15)])
def test_a_killed_run_goes_on_as_one_that_was_not(tmp_path, write, after, database):
    need_mpirun()
    if database == "parallel":
        need_parallel_hdf5()
    (tmp_path / "alone").mkdir()
    write(tmp_path / "alone")
    finish(tmp_path / "alone", "own.yaml", "--allow-code")
    write(tmp_path)
    arguments = ("own.yaml", "--allow-code", "--database", database)
    gate = Gate(tmp_path / "gate", after)
    with running(tmp_path, *arguments, ranks=3, inject=gate.folder) as process:
        wait_until(gate.held_any, process)
        ranks = ranks_below(process)
        os.kill(ranks[-1], signal.SIGKILL)
        output_of(process)
    wait_until_gone(ranks)
    assert_sound(tmp_path / "own.h5")
    finish(tmp_path, *arguments, ranks=3)
    assert_same(tmp_path / "own.h5", decisions(tmp_path / "alone" / "own.h5"))
