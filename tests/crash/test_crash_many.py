"""Kills by the dozen, at every kind of moment, of random ranks: nothing that was final is lost.

`pytest tests/crash/test_crash_many.py --many 200` kills more often than the continuous integration;
with `-s` it says what the runs were doing with their file when they were killed.
"""

import itertools
import os
import random
import signal
import time
from collections import Counter

import h5py
import pytest
from campaign_runs import assert_same, assert_sound, finish, need_mpirun, running, state
from crash_processes import ranks_below
from crash_rows import final_rows
from held_runs import held
from kill_moments import ACTIVITIES, activity_of, reached, want
from processes import output_of, wait_for, wait_until_gone

PARALLEL = bool(h5py.get_config().mpi)
SETUPS = [3] if PARALLEL else [None]
"""Numbers of ranks: those that write."""
KILLS = 12 if PARALLEL else 8
PACE = 0.004
"""Seconds that every sample takes more, so that a run lasts some three seconds."""
EARLY = 0.3
"""Share of the kills at any time that may strike before there is anything to write."""
ANY_TIME = None, 0
LIFE = [
    ("creation", 60),
    ANY_TIME,
    ("growth", 60),
    ("samples", 6),
    ("decisions", 6),
    ("generation", 2),
    ANY_TIME,
    ("closing", 3),
]
"""When the runs of one campaign are killed: in an activity, at a random step of the first so many.

Until the file must grow the campaign has one generation.
"""
TELLS = "import kill_moments; kill_moments.install()"


def count_samples(rows):
    return sum(table == "samples" for table, _ in rows)


def wait_for_the_moment(process, folder, activity, before, chance):
    """Let a run come to the activity or, if that is None, to a random time; whether it goes on."""
    if activity is not None:
        wait_for(lambda: process.poll() is not None or reached(folder), activity)
    elif chance.random() < EARLY:
        time.sleep(chance.uniform(0.0, 1.5))
    else:
        path = folder / "small.h5"
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


def kill_once(folder, ranks, chance, moment, generations):
    """Start or continue the campaign and kill a rank; what the run was doing, None if it ended."""
    path, (activity, steps) = folder / "small.h5", moment
    before, victims = count_samples(final_rows(path)), []
    want(folder, activity, chance.randint(0, steps))
    words, inject = ["small.yaml", "--generations", str(generations)], held(folder, PACE, TELLS)
    with running(folder, *words, ranks=ranks, inject=inject) as process:
        if wait_for_the_moment(process, folder, activity, before, chance):
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
    if path.exists():
        assert_sound(path)
    return None if process.returncode == 0 else activity or activity_of(folder)


@(pytest.mark.parallel_hdf5 if PARALLEL else pytest.mark.slow)
@pytest.mark.parametrize("ranks", SETUPS)
def test_no_kill_loses_or_tears_a_final_row(folder, wanted, ranks, request, record_property):
    if ranks is not None:
        need_mpirun()
    chance, path, hit = random.Random(5 + (ranks or 0)), folder / "small.h5", Counter()
    kills, generations = request.config.getoption("--many") or KILLS, 1
    for moment in itertools.cycle(LIFE):
        if hit.total() == kills:
            break
        if moment[0] == "creation":
            path.unlink(missing_ok=True)
            generations = 1
        elif moment[0] == "growth":
            finish(folder, "small.yaml", "--generations", "1")
            generations = 3
        if struck := kill_once(folder, ranks, chance, moment, generations):
            hit[struck] += 1
        if moment is LIFE[-1]:
            finish(folder, "small.yaml", ranks=ranks)
            assert_same(path, wanted)
    finish(folder, "small.yaml", ranks=ranks)
    assert_same(path, wanted)
    assert state(path)[0] == "finished"
    record_property("killed", dict(hit))
    print(f"{ranks or 1} ranks, {kills} kills:", ", ".join(f"{n} {k}" for k, n in hit.items()))
    assert kills < len(LIFE) or set(ACTIVITIES) <= hit.keys()
