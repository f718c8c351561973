"""Particles of samples are in the file whoever simulates and whoever writes."""

import pytest
from campaign_runs import (
    assert_same,
    assert_sound,
    decisions,
    finish,
    need_mpirun,
    need_parallel_hdf5,
)
from mpi_injections import of_ranks
from particle_runs import (
    assert_particles_are_those_of_the_samples,
    pairs_of,
    pictures_wanted,
    write_bulk_campaign,
)

from agglom_mpi.storage.reader import read_campaign

TWO = {"generations": 2, "max_samples": 12}
PARALLEL = pytest.param("parallel", 3, marks=pytest.mark.parallel_hdf5)
BY_ONE = "runtime/test_frame_stage_runs.py"
RANKS = [of_ranks("gathered", 3, guard=BY_ONE), PARALLEL]


@pytest.fixture
def bare(tmp_path_factory):
    """Return what a plain run without particles decides."""
    folder = tmp_path_factory.mktemp("bare")
    write_bulk_campaign(folder / "bare.yaml", "", **TWO)
    finish(folder, "bare.yaml")
    return decisions(folder / "bare.h5")


@pytest.fixture(autouse=True)
def able(database):
    """Go on only if this build can do it; the second one in the integration must."""
    need_mpirun()
    if database == "parallel":
        need_parallel_hdf5()


@pytest.mark.parametrize(("database", "ranks"), RANKS)
def test_ranks_leave_the_particles_that_the_campaign_computes(bare, tmp_path, database, ranks):
    campaign, path = write_bulk_campaign(tmp_path / "kept.yaml", **TWO), tmp_path / "kept.h5"
    finish(tmp_path, "kept.yaml", "--database", database, ranks=ranks)
    assert_same(path, bare)
    finals, framed = assert_particles_are_those_of_the_samples(path, campaign)
    rows = read_campaign(path).all_sample_rows()
    assert finals == pairs_of(rows)
    assert set(rows["rank"]) == set(range(ranks))
    assert framed == pictures_wanted(path)
    assert_sound(path)
    assert "finished already" in finish(tmp_path, "kept.yaml").stderr
