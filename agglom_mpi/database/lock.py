"""One writer at a time: an advisory lock on a small file beside the campaign file."""

import errno
import fcntl
import os
import socket
import warnings
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import Self

_NO_LOCKS = {errno.ENOSYS, errno.ENOTSUP, errno.EOPNOTSUPP, errno.ENOLCK}


class CampaignInUse(RuntimeError):  # noqa: N818 - the name says what it is in a caller's code
    """Another process is writing to this campaign file."""


class CampaignLock:
    """The right to write to a campaign file, held from `acquire` to `release` or in a `with`.

    The kernel drops it when the process ends, however it ends. The lock file stays.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.path = Path(os.path.realpath(path))
        self.lock_path = self.path.with_name(f".{self.path.stem}.lock")
        self._descriptor: int | None = None

    def acquire(self) -> None:
        """Take the lock at once or not at all.

        Raises
        ------
        CampaignInUse
            If another process holds it.
        OSError
            If the lock file cannot be made.
        """
        descriptor = os.open(self.lock_path, os.O_RDWR | os.O_CREAT, 0o666)
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            holder = os.read(descriptor, 400).decode(errors="replace").strip()
            os.close(descriptor)
            raise CampaignInUse(
                f"{self.path}: in use by {holder or 'another process'} (lock {self.lock_path})"
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
        os.ftruncate(descriptor, 0)
        os.pwrite(descriptor, f"process {os.getpid()} on {socket.gethostname()}\n".encode(), 0)
        # Or NFS would keep the name on this machine, and a start on another could not tell it.
        with suppress(OSError):
            os.fsync(descriptor)
        self._descriptor = descriptor

    def release(self) -> None:
        """Give the lock back; does nothing if it is not held."""
        if self._descriptor is not None:
            os.close(self._descriptor)
            self._descriptor = None

    def __enter__(self) -> Self:
        self.acquire()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.release()
