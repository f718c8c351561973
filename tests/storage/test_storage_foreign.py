"""Files that others have prepared: they lead nowhere, and nothing of theirs is overwritten."""

import os
import signal
import socket

import h5py
import numpy as np
import pytest
from storage_rows import make

from agglom_mpi.storage.access import NotACampaign, open_file
from agglom_mpi.storage.files import ForeignFileError, replace_file
from agglom_mpi.storage.lock import CampaignLock

PRIVATE = b"private\n" * 100


@pytest.fixture
def private(tmp_path):
    """Return a file of somebody else, which must neither be shown nor changed."""
    path = tmp_path / "private"
    path.write_bytes(PRIVATE)
    return path


@pytest.fixture(autouse=True)
def alarm():
    """End a test that waits for a pipe."""
    signal.alarm(60)
    yield
    signal.alarm(0)


def refuse_lock(path):
    with pytest.raises(ForeignFileError) as caught, CampaignLock(path):
        pass
    return str(caught.value)


def refuse_temporary(path):
    with pytest.raises(ForeignFileError) as caught:
        replace_file(path, b"new")
    assert not path.exists()
    return str(caught.value)


NAMES = {refuse_lock: ".grains.h5.lock", refuse_temporary: ".grains.h5.new"}


@pytest.fixture(params=NAMES.items(), ids=["lock", "temporary"])
def refused(request, tmp_path):
    """Return a file of the program's own beside a campaign's, and a function that is refused it."""
    refuse, name = request.param
    return tmp_path / name, lambda: refuse(tmp_path / "grains.h5")


def test_a_symbolic_link_is_not_followed(refused, private):
    own, refuse = refused
    own.symlink_to(private)
    assert refuse().startswith(f"{own}: is a symbolic link")
    assert private.read_bytes() == PRIVATE
    assert own.is_symlink()


def test_a_link_to_nothing_creates_nothing(refused, tmp_path):
    own, refuse = refused
    own.symlink_to(tmp_path / "new")
    refuse()
    assert not (tmp_path / "new").exists()


def test_a_hard_link_is_not_written_to(refused, private):
    own, refuse = refused
    own.hardlink_to(private)
    assert "a second name" in refuse()
    assert private.read_bytes() == PRIVATE


@pytest.mark.parametrize("kind", ["pipe", "directory", "socket"])
def test_only_a_regular_file_is_opened(refused, kind, monkeypatch):
    own, refuse = refused
    if kind == "pipe":
        os.mkfifo(own)
    elif kind == "directory":
        own.mkdir()
    else:
        monkeypatch.chdir(own.parent)  # the name of a socket is limited to some hundred bytes
        with socket.socket(socket.AF_UNIX) as opened:
            opened.bind(own.name)
    assert refuse().startswith(f"{own}: is not a regular file")


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can give a file away")
def test_a_file_of_another_user_is_refused_unless_the_folder_is_theirs(refused, tmp_path):
    own, refuse = refused
    own.touch()
    os.chown(own, 12345, -1)
    assert "belongs to another user, number 12345" in refuse()
    os.chown(tmp_path, 12345, -1)
    replace_file(tmp_path / "grains.h5", b"new")
    with CampaignLock(tmp_path / "grains.h5"):
        pass


def test_what_a_kill_left_is_replaced(tmp_path):
    (tmp_path / ".grains.h5.new").write_bytes(b"half of it")
    replace_file(tmp_path / "grains.h5", b"whole")
    assert (tmp_path / "grains.h5").read_bytes() == b"whole"


def replaced_by(path, make_dataset):
    """Put something else in the place of `/failures` of a campaign file."""
    with h5py.File(path, "r+") as file:
        dtype, shape = file["failures"].dtype, file["failures"].shape
        del file["failures"]
        make_dataset(file, dtype, shape)


def external_link(file, dtype, shape, target):
    file["failures"] = h5py.ExternalLink(target, "/failures")


def external_storage(file, dtype, shape, target):
    stored = dtype.itemsize * shape[0]
    file.create_dataset("failures", shape, dtype, external=[(target, 0, stored)])


def virtual_dataset(file, dtype, shape, target):
    layout = h5py.VirtualLayout(shape, dtype)
    layout[:] = h5py.VirtualSource(target, "failures", shape, dtype)
    file.create_virtual_dataset("failures", layout)


def in_a_group(file, dtype, shape, target):
    file["failures"] = np.zeros(shape, dtype)
    external_storage(file.create_group("a/b"), dtype, shape, target)


@pytest.mark.parametrize(
    "elsewhere", [external_link, external_storage, virtual_dataset, in_a_group]
)
@pytest.mark.parametrize("is_pipe", [False, True])
def test_tables_in_other_files_are_refused_before_they_are_read(path, private, elsewhere, is_pipe):
    if is_pipe:
        private.unlink()
        os.mkfifo(private)
    replaced_by(path, lambda *table: elsewhere(*table, os.fspath(private)))
    with pytest.raises(NotACampaign) as caught:
        open_file(path)
    assert "failures" in str(caught.value)
    assert "other file" in str(caught.value) or "another file" in str(caught.value)


def test_what_somebody_has_added_to_a_file_is_no_hindrance(path):
    with h5py.File(path, "r+") as file:
        file.create_group("notes")["numbers"] = np.arange(3)
        file["notes/all"] = file["/"]
        file["second_name"] = h5py.SoftLink("/samples")
    open_file(path).close()


@pytest.mark.parametrize("kind", ["pipe", "/dev/zero"])
def test_only_a_regular_file_is_read(tmp_path, kind):
    path = tmp_path / "grains.h5"
    if kind == "pipe":
        os.mkfifo(path)
    else:
        path.symlink_to(kind)
    with pytest.raises(NotACampaign, match="not a regular file"):
        open_file(path)


def test_a_second_campaign_beside_the_first_has_its_own_lock(tmp_path):
    with CampaignLock(make(tmp_path / "a.h5")), CampaignLock(make(tmp_path / "b.h5")):
        pass
