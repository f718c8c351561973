import errno
import fcntl
import os
import signal
import socket
import subprocess
import sys

import h5py
import pytest

from agglom_mpi.storage import lock as module
from agglom_mpi.storage.lock import CampaignInUse, CampaignLock, is_locked

HOLD = """
import sys
from agglom_mpi.storage.lock import CampaignLock
CampaignLock(sys.argv[1]).acquire()
"""


def test_a_second_holder_is_refused_and_told_who_has_it(tmp_path):
    path = tmp_path / "grains.h5"
    with CampaignLock(path) as lock:
        assert lock.lock_path == tmp_path / ".grains.h5.lock"
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


def test_whether_a_file_is_locked_is_asked_without_taking_the_lock(tmp_path, monkeypatch):
    path = tmp_path / "grains.h5"
    path.touch()
    assert not is_locked(path)
    with CampaignLock(path):
        assert is_locked(path)
    path.chmod(0o444)
    assert not is_locked(path)

    def without_locks(*_):
        raise OSError(errno.ENOLCK, "No locks available")

    monkeypatch.setattr(module.fcntl, "fcntl", without_locks)
    assert is_locked(path), "it may be"


def test_a_second_name_of_the_file_does_not_help(tmp_path):
    (tmp_path / "real.h5").touch()
    (tmp_path / "link.h5").symlink_to("real.h5")
    with CampaignLock(tmp_path / "real.h5"), pytest.raises(CampaignInUse):
        CampaignLock(tmp_path / "link.h5").acquire()


def test_a_hard_link_does_not_help(tmp_path):
    (tmp_path / "real.h5").touch()
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "elsewhere" / "link.h5").hardlink_to(tmp_path / "real.h5")
    with CampaignLock(tmp_path / "real.h5"):
        with pytest.raises(CampaignInUse, match="another name"):
            CampaignLock(tmp_path / "elsewhere" / "link.h5").acquire()
        with CampaignLock(tmp_path / "elsewhere" / "other.h5"):
            pass
    with CampaignLock(tmp_path / "elsewhere" / "link.h5"):
        pass


def test_a_new_name_does_not_help(tmp_path):
    path = tmp_path / "real.h5"
    path.touch()
    with CampaignLock(path):
        path.rename(tmp_path / "moved.h5")
        with pytest.raises(CampaignInUse, match="another name"):
            CampaignLock(tmp_path / "moved.h5").acquire()


def test_a_file_that_is_made_or_replaced_is_locked_again(tmp_path):
    path, link = tmp_path / "real.h5", tmp_path / "link.h5"
    with CampaignLock(path) as lock:
        for _ in range(2):
            (tmp_path / "new").touch()
            (tmp_path / "new").replace(path)
            link.unlink(missing_ok=True)
            link.hardlink_to(path)
            with CampaignLock(link):
                pass  # not yet
            lock.lock_file()
            lock.lock_file()
            with pytest.raises(CampaignInUse):
                CampaignLock(link).acquire()


def test_names_that_differ_after_their_last_point_are_two_files(tmp_path):
    with CampaignLock(tmp_path / "out.1"), CampaignLock(tmp_path / "out.2"):
        pass


def test_other_programs_read_and_close_a_locked_file(path, tmp_path):
    code = "import h5py, sys; print(len(h5py.File(sys.argv[1], 'r', locking=True)['samples']))"
    (tmp_path / "link.h5").hardlink_to(path)
    with CampaignLock(path):
        done = subprocess.run([sys.executable, "-c", code, path], capture_output=True, text=True)
        assert (done.returncode, done.stderr) == (0, "")
        with h5py.File(path, "r+", locking=True):
            pass
        with pytest.raises(CampaignInUse):
            CampaignLock(tmp_path / "link.h5").acquire()


@pytest.mark.parametrize("one_kind", [False, True])
def test_mpi_is_not_kept_waiting_where_all_locks_are_one_kind(
    path, tmp_path, monkeypatch, one_kind
):
    (tmp_path / "link.h5").hardlink_to(path)

    def flock(descriptor, operation):
        raise BlockingIOError(errno.EAGAIN, "Resource temporarily unavailable")

    with CampaignLock(path) as lock:
        with monkeypatch.context() as patched:
            if one_kind:
                patched.setattr(fcntl, "flock", flock)
            lock.leave_to_mpi()
        second = CampaignLock(tmp_path / "link.h5")
        if one_kind:
            second.acquire()
            second.release()
        else:
            with pytest.raises(CampaignInUse):
                second.acquire()


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
    with pytest.raises(OSError, match=r"\.grains\.h5\.lock"):
        CampaignLock(tmp_path / "grains.h5").acquire()
    with pytest.raises(FileNotFoundError, match=r"\.grains\.h5\.lock"):
        CampaignLock(tmp_path / "nowhere" / "grains.h5").acquire()
