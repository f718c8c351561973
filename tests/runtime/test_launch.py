import sys
from types import ModuleType, SimpleNamespace

import pytest

from agglom_mpi.launcher import compiles_for_node, is_first_rank, launched_size
from agglom_mpi.runtime.launch import LaunchError, connect

MPICH = {"PMI_SIZE": "4", "PMI_RANK": "3", "MPI_LOCALNRANKS": "4", "MPI_LOCALRANKID": "3"}
OPEN_MPI = {"OMPI_COMM_WORLD_SIZE": "6", "OMPI_COMM_WORLD_RANK": "0", "PMIX_RANK": "0"}
SRUN = {
    "SLURM_STEP_ID": "0",
    "SLURM_STEP_NUM_TASKS": "8",
    "SLURM_NTASKS": "8",
    "SLURM_PROCID": "5",
}
BATCH_SCRIPT = {"SLURM_JOB_ID": "17", "SLURM_NTASKS": "8", "SLURM_PROCID": "0"}
INTERACTIVE_STEP = {
    "SLURM_STEP_ID": "4294967290",
    "SLURM_STEP_NUM_TASKS": "1",
    "SLURM_NTASKS": "8",
}
ONE_TASK = {"SLURM_STEP_ID": "0", "SLURM_STEP_NUM_TASKS": "1", "SLURM_NTASKS": "1"}
MPIRUN_IN_A_STEP = {**SRUN, "PMI_SIZE": "2", "PMI_RANK": "0"}


@pytest.mark.parametrize(
    ("variables", "size", "first"),
    [
        ({}, None, True),
        ({"PATH": "/usr/bin", "OMPI_MCA_btl": "self"}, None, True),
        (MPICH, 4, False),
        (OPEN_MPI, 6, True),
        (SRUN, 8, False),
        (SRUN | {"SLURM_PROCID": "0"}, 8, True),
        (BATCH_SCRIPT, None, True),
        (INTERACTIVE_STEP, None, True),
        (ONE_TASK, None, True),
        (MPIRUN_IN_A_STEP, 2, True),
        ({"PMI_SIZE": "many"}, None, True),
    ],
)
def test_the_launcher_is_known_by_its_variables(variables, size, first):
    assert launched_size(variables) == size
    assert is_first_rank(variables) is first


def test_the_first_rank_of_each_node_compiles():
    assert compiles_for_node(0, {})
    assert not compiles_for_node(1, {})
    assert compiles_for_node(5, {"SLURM_LOCALID": "0"})
    assert not compiles_for_node(5, {"MPI_LOCALRANKID": "1"})


@pytest.fixture
def mpi(monkeypatch):
    """Replace the MPI library by one that sees a world of one process."""
    package, module = ModuleType("mpi4py"), ModuleType("mpi4py.MPI")
    package.rc, package.MPI = SimpleNamespace(thread_level="multiple"), module
    module.COMM_WORLD = SimpleNamespace(size=1)
    module.get_vendor = lambda: ("MPICH", (4, 3, 0))
    monkeypatch.setitem(sys.modules, "mpi4py", package)
    monkeypatch.setitem(sys.modules, "mpi4py.MPI", module)
    return module


def test_a_plain_run_has_no_world(mpi):
    assert connect({}) is None


def test_a_world_as_large_as_promised_is_taken(mpi):
    assert connect({"PMI_SIZE": "1"}) is mpi.COMM_WORLD
    assert sys.modules["mpi4py"].rc.thread_level == "funneled"


def test_a_world_of_another_size_is_refused(mpi):
    with pytest.raises(LaunchError, match=r"started 4 processes, but MPICH sees 1"):
        connect({"OMPI_COMM_WORLD_SIZE": "4"})


def test_a_missing_library_is_named_when_it_is_needed(monkeypatch):
    class WithoutLibrary(ModuleType):
        rc = SimpleNamespace()

        @property
        def MPI(self):  # noqa: N802
            raise RuntimeError("cannot load MPI library")

    monkeypatch.setitem(sys.modules, "mpi4py", WithoutLibrary("mpi4py"))
    with pytest.raises(LaunchError, match=r"2 MPI rank\(s\), but no MPI library"):
        connect({"PMI_SIZE": "2"})
