"""New files that get their name when they are whole, and never replace another."""

import errno
import fcntl
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from agglom_mpi.database.access import located
from agglom_mpi.database.create import sync


def refuse_existing(path: Path) -> None:
    """Raise FileExistsError if there is something under this name."""
    if os.path.lexists(path):
        raise FileExistsError(errno.EEXIST, "exists already and is not overwritten", str(path))


@contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """Yield a name beside `path`; what has been written there at the end is renamed to `path`.

    A kill leaves at most the hidden file of that name, which the next attempt replaces.

    Raises
    ------
    FileExistsError
        If there is a file already, before or after writing.
    OSError
        If it cannot be written, or another process is doing so; nothing is left behind.
    """
    refuse_existing(path)
    temporary = path.with_name(f".{path.name}.new")
    with _sole_writer(temporary, path):
        try:
            yield temporary
            sync(temporary)
            refuse_existing(path)
            os.rename(temporary, path)
            sync(path.parent)
        except BaseException as error:
            temporary.unlink(missing_ok=True)
            known = isinstance(error, OSError) and error.filename not in (None, str(temporary))
            if isinstance(error, (OSError, RuntimeError)) and not known:
                raise located(error, path) from error
            raise


@contextmanager
def _sole_writer(temporary: Path, path: Path) -> Iterator[None]:
    """Hold a lock on the temporary file, which the kernel drops however the process ends."""
    try:
        descriptor = os.open(temporary, os.O_RDWR | os.O_CREAT, 0o666)
    except OSError as error:
        raise located(error, path) from error
    try:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            message = "is being written by another process"
            raise OSError(errno.EBUSY, message, str(path)) from None
        except OSError:
            pass  # a file system without locks
        yield
    finally:
        os.close(descriptor)
