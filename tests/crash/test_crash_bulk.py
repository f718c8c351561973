"""A kill leaves no sample without its particles, and no half picture."""

import os
import random
import signal

import h5py
import pytest
from bulk_runs import (
    assert_particles_are_those_of_the_samples,
    pairs_of,
    pictures_wanted,
    write_bulk_campaign,
)
from crash_processes import ranks_below, wait_until_gone
from farm_runs import SMALL, assert_same, decisions, finish, need_mpirun, start, wait_until

from agglom_mpi.database.reader import open_campaign
from agglom_mpi.farm.check import check_file

KILLS = 2


@pytest.mark.parametrize("database", ["gathered", "parallel"])
def test_a_killed_rank_leaves_no_sample_without_its_particles(tmp_path, database):
    need_mpirun()
    if database == "parallel" and not h5py.get_config().mpi:
        assert "AGGLOM_NEEDS_PARALLEL_HDF5" not in os.environ
        pytest.skip("this build of h5py is serial; the other one runs these tests")
    chance, path = random.Random(12), tmp_path / "kept.h5"
    campaign = write_bulk_campaign(tmp_path / "kept.yaml", **SMALL)
    for kill in range(KILLS):
        judged = len(open_campaign(path).result_rows()) if kill else 0
        process = start(tmp_path, "kept.yaml", "--database", database, ranks=2)
        wait_until(
            lambda judged=judged: path.exists() and len(open_campaign(path).result_rows()) > judged,
            process,
        )
        ranks = ranks_below(process.pid)
        os.kill(chance.choice(ranks), signal.SIGKILL)
        process.communicate(timeout=30)
        wait_until_gone(ranks)
        finals, _ = assert_particles_are_those_of_the_samples(path, campaign)
        assert finals == pairs_of(open_campaign(path).all_sample_rows()) != []
        text, code = check_file(str(path))
        assert code == 0, text
    finish(tmp_path, "kept.yaml", "--database", database, ranks=2)
    finals, framed = assert_particles_are_those_of_the_samples(path, campaign)
    assert finals == pairs_of(open_campaign(path).all_sample_rows())
    assert framed == pictures_wanted(path)
    write_bulk_campaign(tmp_path / "bare.yaml", "", **SMALL)
    finish(tmp_path, "bare.yaml", "-q")
    assert_same(path, decisions(tmp_path / "bare.h5"))
