"""A kill leaves no sample without its particles, and no half picture."""

import os
import random
import signal

import pytest
from campaign_runs import (
    SMALL,
    assert_same,
    decisions,
    finish,
    need_mpirun,
    need_parallel_hdf5,
    running,
    wait_until,
)
from crash_processes import ranks_below
from held_runs import allow, allow_all, held
from particle_runs import (
    assert_particles_are_those_of_the_samples,
    pairs_of,
    pictures_wanted,
    write_bulk_campaign,
)
from processes import output_of, wait_until_gone

from agglom_mpi.analysis.file_check import check_file
from agglom_mpi.storage.reader import read_campaign

KILLS = 2
PARALLEL = pytest.param("parallel", marks=pytest.mark.parallel_hdf5)


@pytest.mark.slow
@pytest.mark.parametrize("database", ["gathered", PARALLEL])
def test_a_killed_rank_leaves_no_sample_without_its_particles(tmp_path, database):
    need_mpirun()
    if database == "parallel":
        need_parallel_hdf5()
    chance, path = random.Random(12), tmp_path / "kept.h5"
    campaign = write_bulk_campaign(tmp_path / "kept.yaml", **SMALL)
    for kill in range(KILLS):
        judged = len(read_campaign(path).result_rows()) if kill else 0
        allow(tmp_path, 150)
        options = {"ranks": 2, "inject": held(tmp_path, 0.02)}
        with running(tmp_path, "kept.yaml", "--database", database, **options) as process:
            wait_until(
                lambda judged=judged: (
                    path.exists() and len(read_campaign(path).result_rows()) > judged
                ),
                process,
            )
            ranks = ranks_below(process)
            os.kill(chance.choice(ranks), signal.SIGKILL)
            output_of(process)
        wait_until_gone(ranks)
        finals, _ = assert_particles_are_those_of_the_samples(path, campaign)
        assert finals == pairs_of(read_campaign(path).all_sample_rows()) != []
        text, code = check_file(str(path))
        assert code == 0, text
    allow_all(tmp_path)
    finish(tmp_path, "kept.yaml", "--database", database, ranks=2)
    finals, framed = assert_particles_are_those_of_the_samples(path, campaign)
    assert finals == pairs_of(read_campaign(path).all_sample_rows())
    assert framed == pictures_wanted(path)
    write_bulk_campaign(tmp_path / "bare.yaml", "", **SMALL)
    finish(tmp_path, "bare.yaml", "-q")
    assert_same(path, decisions(tmp_path / "bare.h5"))
