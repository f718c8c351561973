"""SIGKILL while the best strings are estimated again: what is there stays, the rest follows."""

import os
import random
import signal

import h5py
import pytest
from crash_processes import ranks_below, wait_until_gone
from crash_rows import final_rows
from farm_runs import (
    assert_same,
    assert_sound,
    decisions,
    finish,
    need_mpirun,
    running,
    state,
    wait_until,
    write_campaign,
)
from final_runs import fresh_bytes, fresh_rows

STRINGS, SAMPLES = 4, 60
SIZE = {"generations": 1, "max_samples": 5, "population": 4, "parents": 2, "steps": 20_000}
FINAL = f"{{strings: {STRINGS}, samples: {SAMPLES}}}"


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory):
    folder = tmp_path_factory.mktemp("estimated")
    write_campaign(folder / "final.yaml", **SIZE, final=FINAL)
    finish(folder, "final.yaml", "-q")
    return folder / "final.h5"


@pytest.mark.parametrize(("ranks", "database"), [(None, None), (2, "gathered"), (2, "parallel")])
def test_a_kill_among_fresh_samples_leads_to_the_same_bytes(undisturbed, tmp_path, ranks, database):
    if ranks is not None:
        need_mpirun()
    if database == "parallel" and not h5py.get_config().mpi:
        assert "AGGLOM_NEEDS_PARALLEL_HDF5" not in os.environ
        pytest.skip("this build of h5py is serial; the other one runs these tests")
    write_campaign(tmp_path / "final.yaml", **SIZE, final=FINAL)
    path, chance = tmp_path / "final.h5", random.Random(7)
    options = [] if database is None else ["--database", database]
    enough = chance.randint(1, 60)
    with running(tmp_path, "final.yaml", *options, ranks=ranks) as process:
        wait_until(lambda: len(fresh_rows(path)) >= enough, process)
        living = [process.pid] if ranks is None else ranks_below(process.pid)
        os.kill(chance.choice(living), signal.SIGKILL)
        process.communicate(timeout=30)
    wait_until_gone(living)
    assert state(path)[0] == "running"
    assert enough <= len(fresh_rows(path)) < STRINGS * SAMPLES
    before = final_rows(path)
    assert_sound(path)
    finish(tmp_path, "final.yaml", *options, ranks=ranks)
    after, samples = final_rows(path), [key for key in before if key[0] == "samples"]
    assert {key: after[key] for key in samples} == {key: before[key] for key in samples}
    assert fresh_bytes(path) == fresh_bytes(undisturbed)
    assert_same(path, decisions(undisturbed))
