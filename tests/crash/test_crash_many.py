"""Kills by the dozen, at random moments, of random ranks: nothing that was final is lost.

`pytest tests/crash/test_crash_many.py --many 200` kills more often than the continuous integration.
"""

import os
import random
import signal
import time

import h5py
import pytest
from crash_processes import ranks_below, wait_until_gone
from crash_rows import final_rows
from farm_runs import assert_same, finish, need_mpirun, running, state

from agglom_mpi.farm.check import check_file

PARALLEL = bool(h5py.get_config().mpi)
SETUPS = [2, 3] if PARALLEL else [None, 2, 3]
"""Numbers of ranks; with parallel HDF5 all of them write."""
KILLS = 12 if PARALLEL else 10
ANY_TIME = 0.2
"""Share of kills that strike at any time, also before there is anything to write."""


def count_samples(rows):
    return sum(table == "samples" for table, _ in rows)


def wait_for_the_moment(process, path, before, chance):
    """Let a run come to a random point; whether it is still running."""
    if chance.random() < ANY_TIME:
        time.sleep(chance.uniform(0.0, 1.5))
        return process.poll() is None
    end = time.monotonic() + 60.0
    while process.poll() is None and count_samples(final_rows(path)) <= before:
        assert time.monotonic() < end, "no sample in a minute"
        time.sleep(0.005)
    time.sleep(chance.uniform(0.0, 0.5))
    return process.poll() is None


def kill_once(folder, ranks, chance):
    """Start or continue the campaign and kill a rank; whether that was before its end."""
    path = folder / "slow.h5"
    before = count_samples(final_rows(path))
    victims = []
    with running(folder, "slow.yaml", ranks=ranks, inject=None) as process:
        if wait_for_the_moment(process, path, before, chance):
            victims = [process.pid] if ranks is None else ranks_below(process.pid)
        seen = final_rows(path)
        if victims:
            os.kill(chance.choice(victims), signal.SIGKILL)
        said = process.communicate(timeout=60)
    wait_until_gone(victims)
    if process.returncode != 0:
        assert victims, said
        assert process.returncode not in (2, 75), said
    after = final_rows(path)
    lost = [key for key, row in seen.items() if after.get(key) != row]
    assert lost == []
    return process.returncode != 0


@pytest.mark.parametrize("ranks", SETUPS)
def test_no_kill_loses_or_tears_a_final_row(folder, wanted, ranks, request):
    if ranks is not None:
        need_mpirun()
    chance = random.Random(5 + (ranks or 0))
    path = folder / "slow.h5"
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
    finish(folder, "slow.yaml", ranks=ranks)
    assert_same(path, wanted)
    assert state(path)[0] == "finished"
