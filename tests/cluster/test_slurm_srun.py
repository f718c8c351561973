"""Ranks that Slurm starts itself: a world where it and the MPI library understand each other."""

import h5py
import pytest
from campaign_runs import (
    TINY,
    assert_same,
    assert_sound,
    decisions,
    mpirun_is_hydra,
    write_campaign,
)
from campaign_runs import finish as finish_alone

from agglom_mpi.storage.reader import read_campaign

# Both builds understand Slurm in their own way.
pytestmark = pytest.mark.parallel_hdf5 if h5py.get_config().mpi else pytest.mark.slow


@pytest.fixture
def launch(slurm, tmp_path):
    """Return a function that runs the campaign by srun; how that ended, and what was said."""
    write_campaign(tmp_path / "tiny.yaml", **TINY)

    def launched(kind):
        command = f"srun --mpi={kind} -n2 agglom-invert tiny.yaml"
        job = slurm.submit(tmp_path, "-n2", f"--wrap={command}")
        slurm.wait(lambda: slurm.has_ended(job), "does not end", 300.0)
        return slurm.state(job), (tmp_path / f"slurm-{job}.out").read_text()

    return launched


def test_srun_makes_one_world_of_all_ranks(launch, tmp_path):
    ended, said = launch("pmi2" if mpirun_is_hydra() else "pmix")
    assert ended == "COMPLETED", said
    path = tmp_path / "tiny.h5"
    assert read_campaign(path).legs()["ranks"].tolist() == [2]
    assert_sound(path)
    finish_alone(tmp_path, "tiny.yaml", "-o", "alone.h5")
    assert_same(path, decisions(tmp_path / "alone.h5"))


def test_srun_without_a_common_language_is_refused_with_what_to_do(launch, tmp_path):
    ended, said = launch("none")
    assert ended == "FAILED", said
    assert not (tmp_path / "tiny.h5").exists()
    if mpirun_is_hydra():
        assert "the launcher started 2 processes, but MPICH sees 1" in said
        assert "srun --mpi=pmi2 for MPICH" in said
        assert said.count("the launcher started") == 1
    else:  # it says so itself
        assert "PMI support" in said
