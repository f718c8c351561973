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
from own_deciders import write_deciders
from processes import output_of, wait_until_gone

PARALLEL = pytest.param("parallel", marks=pytest.mark.parallel_hdf5)


@pytest.mark.slow
@pytest.mark.parametrize("database", ["gathered", PARALLEL])
def test_a_killed_run_goes_on_as_one_that_was_not(tmp_path, database):
    need_mpirun()
    if database == "parallel":
        need_parallel_hdf5()
    (tmp_path / "alone").mkdir()
    write_deciders(tmp_path / "alone")
    finish(tmp_path / "alone", "own.yaml", "--allow-code")
    write_deciders(tmp_path)
    arguments = ("own.yaml", "--allow-code", "--database", database)
    gate = Gate(tmp_path / "gate", 15)
    with running(tmp_path, *arguments, ranks=3, inject=gate.folder) as process:
        wait_until(gate.held_any, process)
        ranks = ranks_below(process)
        os.kill(ranks[-1], signal.SIGKILL)
        output_of(process)
    wait_until_gone(ranks)
    assert_sound(tmp_path / "own.h5")
    finish(tmp_path, *arguments, ranks=3)
    assert_same(tmp_path / "own.h5", decisions(tmp_path / "alone" / "own.h5"))
