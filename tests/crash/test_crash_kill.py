"""SIGKILL at any moment: nothing final is lost, and the same command goes on to the same end."""

import os
import random
import signal

import h5py
import numpy as np
import pytest
from campaign_runs import (
    assert_killed,
    assert_same,
    decisions,
    finish,
    need_mpirun,
    running,
    samples_in,
    state,
    wait_until,
)
from crash_processes import ranks_below
from held_runs import allow, allow_all, held
from processes import output_of, wait_until_gone
from storage_rows import put_status

from agglom_mpi.campaign_file import open_campaign
from agglom_mpi.storage.reader import read_campaign


def kill_in_mid_campaign(folder, chance, ranks):
    """Run until some more samples are in the file, and kill; the rows that were there before."""
    path = folder / "small.h5"
    before = samples_in(path)
    more = chance.randint(1, 80)
    allow(folder, more + 20)  # the campaign has more than two ranks do of it until the third kill
    with running(folder, "small.yaml", ranks=ranks, inject=held(folder, 0.005)) as process:
        wait_until(lambda: samples_in(path) >= before + more, process)
        rows = read_campaign(path).all_sample_rows()
        living = [process.pid] if ranks is None else ranks_below(process)
        os.kill(chance.choice(living), signal.SIGKILL)
        output_of(process)
    wait_until_gone(living)
    assert process.returncode not in (0, 2, 75)
    allow_all(folder)
    return rows


def assert_nothing_is_lost(path, rows):
    with h5py.File(path, "r") as file:
        assert file["samples_done"][:].sum() >= len(rows)
    campaign = read_campaign(path)
    assert campaign.damaged == 0
    now = campaign.all_sample_rows()
    places = {(row["string"], row["sample"]): row.tobytes() for row in now}
    for row in rows:
        assert places[row["string"], row["sample"]] == row.tobytes()


@pytest.mark.parametrize(
    ("ranks", "kills"),
    [
        (None, 1),
        pytest.param(2, 3, marks=pytest.mark.ranks(guard="crash/test_crash_kill.py")),
    ],
)
def test_a_killed_campaign_goes_on_to_the_same_end(folder, wanted, ranks, kills):
    if ranks is not None:
        need_mpirun()
    chance = random.Random(2003 if ranks is None else 2004)
    path = folder / "small.h5"
    kept = np.zeros(0)
    for kill in range(kills):
        rows = kill_in_mid_campaign(folder, chance, ranks)
        assert len(rows) > len(kept)
        kept = rows
        assert_nothing_is_lost(path, rows)
        assert_killed(path)
        assert len(read_campaign(path).legs()) == kill + 1
    finish(folder, "small.yaml", ranks=ranks)
    assert_nothing_is_lost(path, kept)
    assert_same(path, wanted)
    assert state(path)[0] == "finished"
    assert read_campaign(path).legs()["exit_code"].tolist() == [-1] * kills + [0]


@pytest.mark.slow
def test_a_campaign_begun_with_ranks_may_be_ended_without(folder, wanted):
    need_mpirun()
    rows = kill_in_mid_campaign(folder, random.Random(7), ranks=2)
    finish(folder, "small.yaml")
    assert_nothing_is_lost(folder / "small.h5", rows)
    assert_same(folder / "small.h5", wanted)


def test_a_torn_sample_is_absent_and_computed_again(undisturbed, folder, wanted):
    path = folder / "small.h5"
    path.write_bytes((undisturbed / "small.h5").read_bytes())
    used = read_campaign(path).max_samples * 2 + 1  # sample 1 of string 2
    with h5py.File(path, "r+") as file:
        row = file["samples"][used]
        assert (row["string"], row["sample"]) == (2, 1)
        row["mean_radius_ratio"] += 1.0
        file["samples"][used] = row
    assert open_campaign(path).damaged == 1
    assert decisions(path) != wanted
    finish(folder, "small.yaml")
    assert open_campaign(path).damaged == 0
    assert_same(path, wanted)
    assert read_campaign(path).legs()["samples"].tolist()[1] >= 1


def test_a_kill_after_the_last_generation_leaves_only_the_status_to_set(undisturbed, folder):
    path = folder / "small.h5"
    path.write_bytes((undisturbed / "small.h5").read_bytes())
    with h5py.File(path, "r+") as file:
        put_status(file, state=b"running", reason=b"")
    done = finish(folder, "small.yaml")
    assert "is finished already" in done.stderr
    assert state(path) == ("finished", "all 3 generations are done")
