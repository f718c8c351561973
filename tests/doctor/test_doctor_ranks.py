import os
import subprocess
import sys
import sysconfig
from pathlib import Path

import pytest
from campaign_runs import environment, need_mpirun
from processes import HANG

from agglom_mpi.doctor import ranks as doctor


@pytest.fixture(autouse=True)
def _patience(monkeypatch):
    """Give MPI all the time that a busy machine may take."""
    monkeypatch.setattr(doctor, "MPI_TIMEOUT", HANG)


@pytest.fixture
def launcher(tmp_path):
    """Return a function that makes a mpirun of a shell script; the environment that finds it."""

    def made(script):
        path = tmp_path / "mpirun"
        path.write_text(f"#!/bin/sh\n{script}\n")
        path.chmod(0o755)
        return environment() | {"PATH": f"{tmp_path}:/usr/bin:/bin"}

    need_mpirun()  # where there is a launcher there is a library
    return made


def last(environment):
    return list(doctor.check_mpi(environment))[-1]


def test_two_ranks_of_this_machine_find_each_other():
    need_mpirun()
    library, found = doctor.check_mpi(environment())
    assert "thread level" in library.found
    assert "2 ranks find each other" in found.found, found
    assert not found.advice


def test_a_launcher_of_another_library_is_recognised(launcher):
    alone = f'shift 2; {sys.executable} "$2" "$3" "$4"; exec {sys.executable} "$2" "$3" "$4"'
    found = last(launcher(alone))
    assert "2 processes that do not find each other" in found.found
    assert found.broken
    assert "first on PATH" in found.advice


def test_a_launcher_that_refuses_root_is_told_how(launcher):
    found = last(launcher("echo 'mpirun has detected an attempt to run as root.' >&2; exit 1"))
    assert found.broken
    assert "attempt to run as root" in found.found
    assert "OMPI_ALLOW_RUN_AS_ROOT=1" in found.advice


HYDRA = "echo '====' >&2; echo 'THE EXIT STRING: Bus error (signal 7)' >&2; exit 7"
OPEN_MPI = "echo 'mpirun noticed that process rank 1 exited on signal 7 (Bus error).' >&2; exit 135"


@pytest.mark.parametrize(("script", "room"), [(HYDRA, 0), (OPEN_MPI, 8), ("kill -BUS $$", 0)])
def test_a_signal_that_ends_ranks_is_named_and_shared_memory_where_it_is_short(
    launcher, monkeypatch, script, room
):
    monkeypatch.setattr(doctor, "shared_ranks", lambda: room)
    found = last(launcher(script))
    assert found.broken
    assert "SIGBUS (Bus error)" in found.found
    assert ("--shm-size" in found.advice) is (room == 0)


def test_a_signal_that_ends_the_library_is_not_a_missing_one(tmp_path, monkeypatch):
    monkeypatch.setattr(doctor, "shared_ranks", lambda: 0)
    (tmp_path / "mpi4py.py").write_text("import os, signal; os.kill(os.getpid(), signal.SIGBUS)")
    (found,) = doctor.check_mpi(environment(tmp_path))
    assert found.broken
    assert "ended by SIGBUS (Bus error)" in found.found
    assert "--shm-size" in found.advice


def test_a_launcher_that_hangs_is_given_up(launcher, monkeypatch):
    run, where = subprocess.run, launcher(f"exec sleep {HANG}")

    def impatient(words, timeout, **options):
        return run(words, timeout=0.1 if "mpirun" in words[0] else timeout, **options)

    monkeypatch.setattr(subprocess, "run", impatient)
    found = last(where)
    assert found.broken
    assert f"no answer in {HANG:.0f} s" in found.found


def test_the_launcher_of_an_environment_that_is_not_activated_is_found(launcher, monkeypatch):
    path = launcher("echo unlucky >&2; exit 1")["PATH"].split(":")[0]
    monkeypatch.setattr(sysconfig, "get_path", {"scripts": path}.get)
    found = last(environment() | {"PATH": os.devnull})
    assert found.found == f"{path}/mpirun fails: unlucky"


def test_no_launcher_is_told_where_to_get_one(tmp_path, monkeypatch):
    need_mpirun()
    monkeypatch.setattr(sysconfig, "get_path", {"scripts": str(tmp_path)}.get)
    found = last(environment() | {"PATH": os.devnull})
    assert (found.topic, found.found, found.broken) == ("mpirun", "not found", True)


def test_no_library_is_told_in_one_line(tmp_path):
    (tmp_path / "mpi4py.py").write_text("raise RuntimeError('cannot load MPI library')")
    (found,) = doctor.check_mpi(environment(tmp_path))
    assert found.broken
    assert found.found == "cannot be loaded: RuntimeError: cannot load MPI library"
    assert "agglom_mpi[mpi]" in found.advice


def test_a_rank_does_not_start_others():
    (found,) = doctor.check_mpi({"PMI_SIZE": "4", "PATH": str(Path(sys.executable).parent)})
    assert found.found == "4 ranks"
