import pytest
from campaign_runs import SMALL, Gate, decisions, need_mpirun, wait_until, write_campaign
from slurm_daemons import Slurm, need_slurm
from two_host_runs import LAUNCHERS, Launch
from two_hosts import TwoHosts, need_two_hosts


@pytest.fixture(scope="session")
def slurm(tmp_path_factory):
    """Return a Slurm that runs jobs on this machine."""
    need_slurm()
    need_mpirun()
    daemons = Slurm(tmp_path_factory.mktemp("slurm"))
    yield daemons
    daemons.stop()


@pytest.fixture(scope="session")
def two_hosts(tmp_path_factory):
    """Return two hosts on this machine."""
    need_two_hosts()
    need_mpirun()
    hosts = TwoHosts(tmp_path_factory.mktemp("hosts") / "shared")
    yield hosts
    hosts.end()


@pytest.fixture(params=LAUNCHERS)
def launch(request, two_hosts, tmp_path):
    """Return how to start ranks on two hosts that run nothing else."""
    if request.param == "srun":
        need_slurm()
    return Launch(request.param, two_hosts, tmp_path)


@pytest.fixture
def undisturbed(shared_campaign):
    """Return what every run of the small campaign must decide."""
    return decisions(shared_campaign("small") / "small.h5")


@pytest.fixture
def held(launch, tmp_path):
    """Start the small campaign; return its process and gate when both ranks wait in a sample."""
    write_campaign(tmp_path / "small.yaml", **SMALL)
    gate = Gate(tmp_path / "gate")
    for host in launch.hosts:
        host.set_variables(inject=gate.folder)
    with launch.start("small.yaml") as process:
        wait_until(lambda: gate.held(0) and gate.held(1), process)
        yield process, gate
