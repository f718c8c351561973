import errno
import fcntl
import os
import signal
import socket
import subprocess
import sys

import pytest

from agglom_mpi.storage.files import CampaignInUse, CampaignLock

HOLD = """
import sys
from agglom_mpi.storage.files import CampaignLock
CampaignLock(sys.argv[1]).acquire()
"""


def test_a_second_holder_is_refused_and_told_who_has_it(tmp_path):
    path = tmp_path / "grains.h5"
    with CampaignLock(path) as lock:
        assert lock.lock_path == tmp_path / ".grains.lock"
        with pytest.raises(CampaignInUse) as caught:
            CampaignLock(path).acquire()
    message = str(caught.value)
    assert str(path) in message
    assert f"process {os.getpid()} on {socket.gethostname()}" in message
    with CampaignLock(path):
        pass


def test_the_name_of_the_holder_leaves_its_machine_at_once(tmp_path, monkeypatch):
    told = []
    monkeypatch.setattr(os, "fsync", lambda descriptor: told.append(os.pread(descriptor, 400, 0)))
    with CampaignLock(tmp_path / "grains.h5"):
        assert told == [f"process {os.getpid()} on {socket.gethostname()}\n".encode()]


def test_a_second_name_of_the_file_does_not_help(tmp_path):
    (tmp_path / "real.h5").touch()
    (tmp_path / "link.h5").symlink_to("real.h5")
    with CampaignLock(tmp_path / "real.h5"), pytest.raises(CampaignInUse):
        CampaignLock(tmp_path / "link.h5").acquire()


def test_a_killed_holder_holds_no_more(tmp_path):
    path = tmp_path / "grains.h5"
    wait = HOLD + "print(flush=True); sys.stdin.read()"
    command = [sys.executable, "-c", wait, str(path)]
    pipe = subprocess.PIPE
    with subprocess.Popen(command, stdin=pipe, stdout=pipe) as holder:
        holder.stdout.readline()
        with pytest.raises(CampaignInUse, match=f"process {holder.pid} on"):
            CampaignLock(path).acquire()
        holder.send_signal(signal.SIGKILL)
        holder.wait()
    with CampaignLock(path) as lock:
        assert lock.lock_path.read_text().startswith(f"process {os.getpid()} ")


def test_releasing_twice_is_harmless(tmp_path):
    lock = CampaignLock(tmp_path / "grains.h5")
    lock.acquire()
    lock.release()
    lock.release()


def test_a_file_system_without_locks_gives_a_warning(tmp_path, monkeypatch):
    def flock(descriptor, operation):
        raise OSError(errno.ENOLCK, "No locks available")

    monkeypatch.setattr(fcntl, "flock", flock)
    with pytest.warns(UserWarning, match="no locks"), CampaignLock(tmp_path / "grains.h5"):
        pass


def test_other_errors_name_the_lock_file(tmp_path, monkeypatch):
    def flock(descriptor, operation):
        raise OSError(errno.EIO, "Input/output error")

    monkeypatch.setattr(fcntl, "flock", flock)
    with pytest.raises(OSError, match=r"\.grains\.lock"):
        CampaignLock(tmp_path / "grains.h5").acquire()
    with pytest.raises(FileNotFoundError, match=r"\.grains\.lock"):
        CampaignLock(tmp_path / "nowhere" / "grains.h5").acquire()
