import pytest
from campaign_runs import need_mpirun
from slurm_daemons import Slurm, need_slurm


@pytest.fixture(scope="session")
def slurm(tmp_path_factory):
    """Return a Slurm that runs jobs on this machine."""
    need_slurm()
    need_mpirun()
    daemons = Slurm(tmp_path_factory.mktemp("slurm"))
    yield daemons
    daemons.stop()
