"""The lock of a campaign file, by its name and of the file itself, and what it shows of a run."""

import errno
import fcntl
import os
import socket
import struct
import warnings
from contextlib import suppress
from pathlib import Path
from typing import Final, Self

from agglom_mpi.errors import UserError
from agglom_mpi.storage.access import open_file
from agglom_mpi.storage.files import open_own
from agglom_mpi.storage.reader import CampaignData
from agglom_mpi.storage.rows import Rows
from agglom_mpi.storage.snapshot import Status, status_of

_NO_LOCKS: Final = {errno.ENOSYS, errno.ENOTSUP, errno.EOPNOTSUPP, errno.ENOLCK}

_LOCKED_BYTE: Final = 1 << 62
"""Offset of the locked byte of a campaign file, far beyond its end: no lock of MPI-IO on data
includes it."""
NOTES_OFFSET: Final = 4096
"""Offset in the lock file at which ranks note their samples, behind the text on the holder."""
_DATA_LOCK: Final = struct.pack("@hhqqi4x", fcntl.F_WRLCK, os.SEEK_SET, _LOCKED_BYTE, 1, 0)
"""A `struct flock` for writing."""


KILLED: Final = "the run was killed: no process holds the file"
"""Reason of the state of a run that could not write one."""


def is_locked(path: Path) -> bool:
    """Return whether a process holds the lock of a campaign file itself, without taking it.

    It counts as held where the file system has no such locks.
    """
    try:
        with path.open("rb") as file:
            found = fcntl.fcntl(file, fcntl.F_OFD_GETLK, _DATA_LOCK)
    except OSError:
        return True
    return bool(struct.unpack_from("h", found)[0] != fcntl.F_UNLCK)


def live_status(data: CampaignData) -> Status:
    """Return the state of a campaign; `stopped` if the run was killed, as its lock shows.

    With `--database parallel` MPI may need the lock, and another machine may not see it.
    """
    status, legs, path = data.status(), data.legs(), data.path
    if status.state != "running" or not len(legs) or legs[-1]["database"] != b"gathered":
        return status
    # A run that ends just now writes its status first, and one that begins takes the lock.
    if is_locked(path):
        return status
    with open_file(path, thorough=False) as file:
        now = status_of(Rows(file["status"], path).read_all())
    if now.state != "running" or is_locked(path):
        return status
    if legs[-1]["host"].decode() == (here := socket.gethostname())[:64]:
        return now._replace(state="stopped", reason=KILLED)
    return now._replace(reason=f"no lock is seen on {here}: the run may have been killed")


class CampaignInUse(UserError, RuntimeError):  # noqa: N818 - the name states the condition
    """Another process is writing to this campaign file."""


class CampaignLock:
    """Lock of a campaign file against a second writer: `acquire` and `release`, or `with`.

    The file `.NAME.lock` beside the campaign file is locked, whose text names the holder, and the
    campaign file itself, which may have further names: hard links, or one that it is renamed to.
    The kernel releases both when the process ends, however it ends. The lock file stays.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.path = Path(os.path.realpath(path))
        self.lock_path = self.path.with_name(f".{self.path.name}.lock")
        self._descriptor: int | None = None
        self._data: int | None = None

    def acquire(self) -> None:
        """Take the lock, without waiting for it.

        Raises
        ------
        CampaignInUse
            If another process holds it.
        ForeignFileError
            If something else has the name of the lock file.
        OSError
            If the lock file cannot be made.
        """
        descriptor = open_own(self.lock_path, self.path)
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            holder = os.read(descriptor, NOTES_OFFSET).partition(b"\n")[0].decode(errors="replace")
            os.close(descriptor)
            raise CampaignInUse(
                f"{self.path}: in use by {holder or 'another process'} (lock {self.lock_path}); "
                "wait for its end, or stop it with everything saved: kill -TERM and its number"
            ) from None
        except OSError as error:
            if error.errno not in _NO_LOCKS:
                os.close(descriptor)
                raise OSError(error.errno, error.strerror, str(self.lock_path)) from error
            # Better a campaign that runs unprotected than none on such a file system.
            warnings.warn(
                f"{self.lock_path}: this file system has no locks ({error.strerror}); "
                "nothing keeps a second run from writing to the same campaign file",
                stacklevel=2,
            )
        self._descriptor = descriptor
        try:
            self.lock_file()
        except CampaignInUse:
            self.release()
            raise
        # A full disc leaves the lock without a name. The name is synced, or NFS would keep it on
        # this machine, and a start on another could not report it.
        with suppress(OSError):
            os.ftruncate(descriptor, 0)
            os.pwrite(descriptor, f"process {os.getpid()} on {socket.gethostname()}\n".encode(), 0)
            os.fsync(descriptor)

    def lock_file(self) -> None:
        """Lock the campaign file itself, if there is one; again after it was made or replaced.

        The lock belongs to the open file: it lasts until that is closed, whatever else of this
        process opens and closes the file. HDF5 uses locks of another kind, so that other programs
        can read the file meanwhile.

        Raises
        ------
        CampaignInUse
            If another process has locked it under another name.
        """
        try:
            descriptor = os.open(self.path, os.O_RDWR | os.O_NONBLOCK)
        except OSError:
            return  # there is none yet, or whoever opens it says why it cannot be used
        try:
            if self._data is not None and os.path.sameopenfile(descriptor, self._data):
                os.close(descriptor)
                return
            fcntl.fcntl(descriptor, fcntl.F_OFD_SETLK, _DATA_LOCK)
        except BlockingIOError:
            os.close(descriptor)
            raise CampaignInUse(
                f"{self.path}: in use by another process under another name: a hard link, or its "
                "name before it was moved"
            ) from None
        except OSError:
            pass  # a file system without such locks: that by name is left
        self.release_file()
        self._data = descriptor

    def leave_to_mpi(self) -> None:
        """Release the campaign file where MPI-IO would wait for its own lock for ever.

        Where all kinds of locks are one, as over NFS, MPI libraries may lock whole files.
        """
        if self._data is None:
            return
        probe = os.open(self.path, os.O_RDONLY)
        try:
            fcntl.flock(probe, fcntl.LOCK_SH | fcntl.LOCK_NB)
        except OSError:
            self.release_file()
        finally:
            os.close(probe)

    def release_file(self) -> None:
        """Release the campaign file, if it is locked; the lock by its name stays."""
        if self._data is not None:
            os.close(self._data)
            self._data = None

    def release(self) -> None:
        """Release the lock if it is held."""
        self.release_file()
        if self._descriptor is not None:
            os.close(self._descriptor)
            self._descriptor = None

    def __enter__(self) -> Self:
        self.acquire()
        return self

    def __exit__(self, *error: object) -> None:
        self.release()
