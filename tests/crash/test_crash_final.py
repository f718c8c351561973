"""SIGKILL while the best strings are estimated again: what is there stays, the rest follows."""

import os
import random
import signal

import pytest
from campaign_runs import (
    TINY,
    assert_killed,
    assert_same,
    assert_sound,
    decisions,
    finish,
    need_mpirun,
    need_parallel_hdf5,
    running,
    wait_until,
    write_campaign,
)
from crash_processes import ranks_below
from crash_rows import final_rows
from held_runs import allow, allow_all, held
from processes import output_of, wait_until_gone
from reestimation_runs import fresh_bytes, fresh_rows

STRINGS, SAMPLES = 4, 60
FINAL = f"{{strings: {STRINGS}, samples: {SAMPLES}}}"


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory):
    folder = tmp_path_factory.mktemp("estimated")
    write_campaign(folder / "final.yaml", **TINY, final=FINAL)
    finish(folder, "final.yaml", "-q")
    return folder / "final.h5"


KILLED = "crash/test_crash_kill.py"


@pytest.mark.parametrize(
    ("ranks", "database"),
    [
        pytest.param(2, "gathered", marks=pytest.mark.slow(guard=KILLED)),
        pytest.param(2, "parallel", marks=pytest.mark.parallel_hdf5),
    ],
)
def test_a_kill_among_fresh_samples_leads_to_the_same_bytes(undisturbed, tmp_path, ranks, database):
    if ranks is not None:
        need_mpirun()
    if database == "parallel":
        need_parallel_hdf5()
    write_campaign(tmp_path / "final.yaml", **TINY, final=FINAL)
    path, chance = tmp_path / "final.h5", random.Random(7)
    options = [] if database is None else ["--database", database]
    enough = chance.randint(1, 60)
    allow(tmp_path, 20 + 60)  # those of the search, and as many as are waited for
    inject = held(tmp_path, 0.005)
    with running(tmp_path, "final.yaml", *options, ranks=ranks, inject=inject) as process:
        wait_until(lambda: len(fresh_rows(path)) >= enough, process)
        living = [process.pid] if ranks is None else ranks_below(process)
        os.kill(chance.choice(living), signal.SIGKILL)
        output_of(process)
    wait_until_gone(living)
    assert_killed(path)
    assert enough <= len(fresh_rows(path)) < STRINGS * SAMPLES
    before = final_rows(path)
    assert_sound(path)
    allow_all(tmp_path)
    finish(tmp_path, "final.yaml", *options, ranks=ranks)
    after, samples = final_rows(path), [key for key in before if key[0] == "samples"]
    assert {key: after[key] for key in samples} == {key: before[key] for key in samples}
    assert fresh_bytes(path) == fresh_bytes(undisturbed)
    assert_same(path, decisions(undisturbed))
