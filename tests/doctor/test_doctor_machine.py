import os
import re
import tomllib
from pathlib import Path
from types import SimpleNamespace

import pytest
from click.testing import CliRunner

from agglom_mpi.cli import main
from agglom_mpi.cli.doctor import as_table
from agglom_mpi.doctor import machine
from agglom_mpi.doctor import ranks as mpi
from agglom_mpi.doctor.machine import Finding

MOUNTS = r"""/dev/vda / ext4 rw 0 0
server:/home /home nfs4 rw 0 0
tmpfs /home/local tmpfs rw 0 0
lustre@tcp:/big /my\040scratch lustre rw,flock 0 0
"""


@pytest.mark.parametrize(
    ("folder", "kind"),
    [
        ("/", "ext4"),
        ("/homework", "ext4"),
        ("/home", "nfs4"),
        ("/home/me/runs", "nfs4"),
        ("/home/local/runs", "tmpfs"),
        ("/my scratch/run", "lustre"),
    ],
)
def test_the_innermost_mount_says_which_file_system_it_is(tmp_path, folder, kind):
    (tmp_path / "mounts").write_text(MOUNTS)
    assert machine.file_system(Path(folder), tmp_path / "mounts") == kind


def test_without_a_list_of_mounts_nothing_is_claimed(tmp_path):
    assert machine.file_system(tmp_path, tmp_path / "none") == "unknown"


def test_a_file_system_that_two_machines_write_to_is_left_to_rank_0(tmp_path, monkeypatch):
    monkeypatch.setattr(machine, "file_system", lambda folder: "nfs4")
    output, kernels = machine.check_storage(tmp_path)
    assert "--database gathered" in output.advice
    assert "NUMBA_CACHE_DIR" in kernels.advice
    assert not list(tmp_path.iterdir())


def test_a_folder_that_cannot_be_written_is_broken():
    output, _ = machine.check_storage(Path("/proc"))
    assert output.broken
    assert "/proc (proc)" in output.found


def test_this_folder_is_timed_and_has_locks(tmp_path):
    seconds, locks = machine.measure_fsync(tmp_path)
    assert locks
    assert 0.0 < seconds < 60.0


def test_threads_that_only_cost_are_named():
    found = list(machine.check_processors({"OMP_NUM_THREADS": "8", "MKL_NUM_THREADS": "1"}))
    assert found[-1].found == "OMP_NUM_THREADS=8"


def test_more_ranks_than_processors_are_named():
    (found,) = machine.check_processors({"PMI_SIZE": str(10 * (os.cpu_count() or 1))})
    assert "no more than" in found.advice


@pytest.mark.parametrize(
    ("mebibytes", "ranks", "enough"),
    [(64, 11, 11), (64, 12, 11), (4, 1, 0), (8, 1, 1), (704, 8, 128)],
)
def test_shared_memory_is_compared_with_the_ranks(monkeypatch, mebibytes, ranks, enough):
    usage = SimpleNamespace(free=mebibytes * 2**20)
    monkeypatch.setattr(mpi.shutil, "disk_usage", lambda folder: usage)
    (found,) = mpi.check_shared_memory({"PMI_SIZE": str(ranks)})
    assert found.found.startswith(f"/dev/shm has room for {enough} rank")
    assert ("--shm-size" in found.advice) is (enough < max(ranks, 2))


def test_without_shared_memory_there_is_advice(monkeypatch, tmp_path):
    monkeypatch.setattr(mpi, "SHARED_MEMORY", tmp_path / "none")
    (found,) = mpi.check_shared_memory({})
    assert "0 ranks" in found.found
    assert "--shm-size" in found.advice


def test_a_missing_extra_is_named_with_what_it_is_for(monkeypatch):
    monkeypatch.setattr(machine, "is_installed", lambda name: name != "cmaes")
    found = {finding.topic: finding for finding in machine.check_libraries()}
    assert found["extra search"].found == "without cmaes"
    assert "pip install 'agglom_mpi[search]'" in found["extra search"].advice
    assert not found["extra report"].advice


@pytest.mark.parametrize("extra", machine.NEEDED_FOR)
def test_the_libraries_of_an_extra_are_those_of_the_project(extra):
    """By the metadata of the installed package: install it again where they differ."""
    project = tomllib.loads((Path(__file__).parents[2] / "pyproject.toml").read_text())["project"]
    listed = project["optional-dependencies"][extra]
    assert machine.libraries_of(extra) == tuple(re.match(r"[\w.-]+", line)[0] for line in listed)


@pytest.mark.parametrize("library", ["jinja2", "emcee", "pandas"])
def test_an_extra_without_one_of_its_libraries_is_not_complete(monkeypatch, library):
    monkeypatch.setattr(machine, "is_installed", lambda name: name != library)
    found = {finding.topic: finding for finding in machine.check_libraries()}
    assert found["extra report"].found == f"without {library}"


def test_of_a_package_that_is_not_installed_no_extra_is_called_complete(monkeypatch):
    def missing(name):
        raise machine.PackageNotFoundError

    monkeypatch.setattr(machine, "requires", missing)
    found = {finding.topic: finding.found for finding in machine.check_libraries()}
    assert "not known" in found["extra report"]


def test_slurm_is_asked_what_it_speaks(tmp_path):
    srun = tmp_path / "srun"
    srun.write_text("#!/bin/sh\necho 'MPI plugin types are...' none pmi2 pmix\n")
    srun.chmod(0o755)
    path = {"PATH": f"{tmp_path}:/bin"}
    assert [finding.found for finding in machine.check_batch_system(path)] == [
        "srun --mpi=pmix or pmi2"
    ]
    job = path | {"SLURM_JOB_ID": "7", "SLURM_NTASKS": "64", "SLURM_NNODES": "2"}
    assert next(machine.check_batch_system(job)).found == "7: 64 tasks on 2 nodes"
    assert list(machine.check_batch_system({"PATH": str(tmp_path / "none")})) == []


def test_what_is_to_do_stands_below_the_table():
    findings = [Finding("one", "well"), Finding("two", "ill", "take a pill", broken=True)]
    table, _, advice = as_table(findings).renderables
    assert advice == "two: take a pill"
    assert [label for label, _ in table.rows] == ["  one", "✗ two"]


def test_a_folder_that_is_not_there_is_one_message():
    done = CliRunner().invoke(main, ["doctor", "nowhere"])
    assert done.exit_code == 2
    assert "nowhere" in done.output
