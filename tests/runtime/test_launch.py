import os
import socket
import sys
from types import ModuleType, SimpleNamespace

import pytest

from agglom_mpi.launcher import (
    compiles_for_node,
    is_first_rank,
    launched_size,
    rank_variables,
    started_by_a_rank,
    unread_input,
)
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


def test_input_that_the_launcher_has_read_is_counted():
    read, write = os.pipe()
    assert unread_input(read) == 0
    os.write(write, b"second.yaml\n")
    assert unread_input(read) == 12
    os.close(write)
    assert unread_input(read) == 12
    os.read(read, 100)
    assert unread_input(read) == 0
    os.close(read)
    assert unread_input(read) == 0
    with open(os.devnull) as null:
        assert unread_input(null.fileno()) == 0


def process(proc, pid, name, parent, variables=b"", maps=b"libc.so"):
    folder = proc / str(pid)
    folder.mkdir()
    (folder / "comm").write_text(f"{name}\n")
    (folder / "stat").write_text(f"{pid} ({name}) (x) S {parent} 1 1\n")
    (folder / "environ").write_bytes(variables)
    (folder / "maps").write_bytes(maps)


RANK = b"HOME=/root\0PMI_RANK=0\0"
LIBRARY = b"7f r-xp /opt/lib/libmpi.so.12\n"


@pytest.mark.parametrize(
    ("parent", "found"),
    [
        (("python", RANK, LIBRARY), True),
        (("python", b"OMPI_COMM_WORLD_RANK=1\0", LIBRARY), True),
        (("python", b"HOME=/root\0", LIBRARY), False),  # an interactive one, which is no rank
        (("bash", RANK, b"libc.so"), False),
        (("hydra_pmi_proxy", RANK, LIBRARY), False),
        (("slurmstepd", RANK, LIBRARY), False),
    ],
)
def test_a_rank_that_another_rank_has_started_is_recognised(tmp_path, parent, found):
    process(tmp_path, os.getpid(), "agglom (1) x", 20, RANK)
    process(tmp_path, 20, "sh", 10, RANK)
    process(tmp_path, 10, parent[0], 5, *parent[1:])
    process(tmp_path, 5, "mpirun", 3)
    process(tmp_path, 3, "python", 1, RANK, LIBRARY)  # has started that mpirun
    assert started_by_a_rank({"PMI_RANK": "0"}, tmp_path) is found


def test_a_closed_connection_to_the_launcher_is_that_of_another_process(tmp_path):
    one, other = socket.socketpair()
    assert not started_by_a_rank({"PMI_FD": str(one.fileno())}, tmp_path)
    number = one.fileno()
    one.close()
    other.close()
    assert started_by_a_rank({"PMI_FD": str(number)}, tmp_path)


def test_a_plain_program_is_what_remains_without_the_variables():
    for variables in (MPICH, OPEN_MPI, SRUN):
        names = rank_variables(variables)
        rest = {name: value for name, value in variables.items() if name not in names}
        assert launched_size(rest) is None
        assert is_first_rank(rest)


@pytest.fixture
def mpi(monkeypatch):
    """Replace the MPI library by one that sees a world of one process."""
    package, module = ModuleType("mpi4py"), ModuleType("mpi4py.MPI")
    package.rc, package.MPI = SimpleNamespace(initialize=True), module
    module.COMM_WORLD = SimpleNamespace(size=1)
    module.get_vendor = lambda: ("MPICH", (4, 3, 0))
    module.Get_library_version = lambda: "MPICH configure: --with-pm=hydra"
    module.Is_initialized, module.THREAD_SERIALIZED, module.started = lambda: False, 2, []
    module.Init_thread = module.started.append
    monkeypatch.setitem(sys.modules, "mpi4py", package)
    monkeypatch.setitem(sys.modules, "mpi4py.MPI", module)
    return module


def test_a_plain_run_has_no_world(mpi):
    assert connect({}) is None


def test_a_world_as_large_as_promised_is_taken(mpi):
    assert connect({"PMI_SIZE": "1"}) is mpi.COMM_WORLD
    assert not sys.modules["mpi4py"].rc.initialize
    assert mpi.started == [mpi.THREAD_SERIALIZED]


def test_a_world_of_another_size_is_refused(mpi):
    with pytest.raises(LaunchError, match=r"started 4 processes, but MPICH sees 1"):
        connect({"OMPI_COMM_WORLD_SIZE": "4"})


BY_PMIX = {"OMPI_COMM_WORLD_SIZE": "1", "PMIX_NAMESPACE": "prterun-1@1"}


def test_a_library_that_does_not_speak_the_launchers_language_is_not_started(mpi):
    with pytest.raises(LaunchError, match="do not belong together"):
        connect(BY_PMIX)
    assert mpi.started == []


@pytest.mark.parametrize(
    ("vendor", "about", "more"),
    [
        ("MPICH", "MPICH configure: --with-pmi=pmix", {}),
        ("MPICH", "MPICH configure: --with-pm=hydra", {"PMI_FD": "7", "PMI_SIZE": "1"}),
        ("Open MPI", "Open MPI v5.0.11", {}),
    ],
)
def test_a_library_that_may_speak_it_is_started(mpi, monkeypatch, vendor, about, more):
    monkeypatch.setattr(mpi, "get_vendor", lambda: (vendor, (5, 0, 2)))
    monkeypatch.setattr(mpi, "Get_library_version", lambda: about)
    monkeypatch.setattr("agglom_mpi.runtime.launch.started_by_a_rank", lambda environment: False)
    assert connect(BY_PMIX | more) is mpi.COMM_WORLD


def test_a_missing_library_is_named_when_it_is_needed(monkeypatch):
    class WithoutLibrary(ModuleType):
        rc = SimpleNamespace()

        @property
        def MPI(self):  # noqa: N802
            raise RuntimeError("cannot load MPI library")

    monkeypatch.setitem(sys.modules, "mpi4py", WithoutLibrary("mpi4py"))
    with pytest.raises(LaunchError, match=r"2 MPI rank\(s\), but no MPI library"):
        connect({"PMI_SIZE": "2"})
