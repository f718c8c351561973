"""SIGKILL while larger volumes are simulated: what is there stays, the rest follows."""

import os
import random
import signal

import h5py
import numpy as np
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
from crash_rows import whole
from held_runs import allow, allow_all, held
from processes import output_of, wait_until_gone
from volume_runs import volume_bytes, volume_counts

STRINGS, SAMPLES, VOLUMES = 3, 20, (2, 4)
FINAL = f"{{strings: {STRINGS}, samples: {SAMPLES}, volumes: [1, 2, 4]}}"


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory):
    folder = tmp_path_factory.mktemp("volumes")
    write_campaign(folder / "final.yaml", **TINY, final=FINAL)
    finish(folder, "final.yaml", "-q")
    return folder / "final.h5"


def final_bytes(path):
    """Bytes of every final row of larger volumes, by volume and place; all must be whole."""
    found = {}
    with h5py.File(path, "r", locking=False) as file:
        for volume in VOLUMES:
            rows = file[f"samples_volume_{volume}"]
            for place in np.flatnonzero(file[f"samples_volume_{volume}_done"][:]).tolist():
                assert whole(rows[place])
                found[volume, place] = rows[place].tobytes()
    return found


KILLED = "crash/test_crash_kill.py"


@pytest.mark.parametrize(
    ("ranks", "database"),
    [
        pytest.param(2, "gathered", marks=pytest.mark.slow(guard=KILLED)),
        pytest.param(2, "parallel", marks=pytest.mark.parallel_hdf5),
    ],
)
def test_a_kill_among_larger_volumes_leads_to_the_same_bytes(
    undisturbed, tmp_path, ranks, database
):
    if ranks is not None:
        need_mpirun()
    if database == "parallel":
        need_parallel_hdf5()
    write_campaign(tmp_path / "final.yaml", **TINY, final=FINAL)
    path, chance = tmp_path / "final.h5", random.Random(7)
    options = [] if database is None else ["--database", database]
    enough = chance.randint(1, 20)
    # Those of the search and of the first string, and as many as are waited for.
    allow(tmp_path, 20 + SAMPLES + 2 * 20)
    inject = held(tmp_path, 0.005)
    with running(tmp_path, "final.yaml", *options, ranks=ranks, inject=inject) as process:
        wait_until(lambda: sum(volume_counts(path).values()) >= enough, process)
        living = [process.pid] if ranks is None else ranks_below(process)
        os.kill(chance.choice(living), signal.SIGKILL)
        output_of(process)
    wait_until_gone(living)
    assert_killed(path)
    before = final_bytes(path)
    assert enough <= len(before) < len(VOLUMES) * STRINGS * SAMPLES
    assert_sound(path)
    allow_all(tmp_path)
    finish(tmp_path, "final.yaml", *options, ranks=ranks)
    after = final_bytes(path)
    assert {key: after[key] for key in before} == before
    assert volume_bytes(path) == volume_bytes(undisturbed)
    assert_same(path, decisions(undisturbed))
    assert_sound(path)
