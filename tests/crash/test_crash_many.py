"""Kills by the dozen, at random moments, of random ranks: nothing that was final is lost.

`pytest tests/crash/test_crash_many.py --many 200` kills more often than the continuous integration.
"""

import os
import random
import signal
import time

import h5py
import pytest
from campaign_runs import assert_same, finish, need_mpirun, running, state
from crash_processes import ranks_below
from crash_rows import final_rows
from held_runs import held
from processes import output_of, wait_for, wait_until_gone

from agglom_mpi.analysis.replay import check_file

PARALLEL = bool(h5py.get_config().mpi)
SETUPS = [2, 3] if PARALLEL else [None, 2, 3]
"""Numbers of ranks; with parallel HDF5 all of them write."""
KILLS = 12 if PARALLEL else 10
PACE = 0.004
"""Seconds that every sample takes more, so that a run lasts some three seconds."""
ANY_TIME = 0.2
"""Share of kills that strike at any time, also before there is anything to write."""


def count_samples(rows):
    return sum(table == "samples" for table, _ in rows)


def wait_for_the_moment(process, path, before, chance):
    """Let a run come to a random point; whether it is still running."""
    if chance.random() < ANY_TIME:
        time.sleep(chance.uniform(0.0, 1.5))
        return process.poll() is None
    wait_for(
        lambda: process.poll() is not None or count_samples(final_rows(path)) > before, "sample"
    )
    time.sleep(chance.uniform(0.0, 0.5))
    return process.poll() is None


def kill(pid):
    """Kill a process; whether it had not ended by itself."""
    try:
        os.kill(pid, signal.SIGKILL)
    except ProcessLookupError:
        return False
    return True


def kill_once(folder, ranks, chance):
    """Start or continue the campaign and kill a rank; whether that was before its end."""
    path = folder / "small.h5"
    before = count_samples(final_rows(path))
    victims = []
    with running(folder, "small.yaml", ranks=ranks, inject=held(folder, PACE)) as process:
        if wait_for_the_moment(process, path, before, chance):
            victims = [process.pid] if ranks is None else ranks_below(process)
        seen = final_rows(path)
        killed = bool(victims) and kill(chance.choice(victims))
        said = output_of(process)
    wait_until_gone(victims)
    if process.returncode != 0:
        assert killed, said
        assert process.returncode not in (2, 75), said
    after = final_rows(path)
    lost = [key for key, row in seen.items() if after.get(key) != row]
    assert lost == []
    return process.returncode != 0


@(pytest.mark.parallel_hdf5 if PARALLEL else pytest.mark.slow)
@pytest.mark.parametrize("ranks", SETUPS)
def test_no_kill_loses_or_tears_a_final_row(folder, wanted, ranks, request):
    if ranks is not None:
        need_mpirun()
    chance = random.Random(5 + (ranks or 0))
    path = folder / "small.h5"
    left = request.config.getoption("--many") or KILLS
    while left:
        if kill_once(folder, ranks, chance):
            left -= 1
            if path.exists():
                text, code = check_file(str(path))
                assert code == 0, text
        else:
            assert_same(path, wanted)
            path.unlink()
    finish(folder, "small.yaml", ranks=ranks)
    assert_same(path, wanted)
    assert state(path)[0] == "finished"
