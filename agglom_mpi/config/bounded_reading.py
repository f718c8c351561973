"""Reading of files that somebody names, up to a size that takes a moment."""

import errno
import os
import stat
from pathlib import Path
from typing import Final

PIPES: Final = ("/dev/fd/", "/dev/stdin", "/proc/self/fd/")
"""Names under which a process has the ends of pipes that it was started with."""


def read_bounded(path: str | os.PathLike[str], limit: int) -> bytes:
    """Return the content of a file, or of a pipe that this process was started with.

    Parameters
    ----------
    path
    limit
        Largest size in bytes.

    Raises
    ------
    OSError
        If it cannot be read, is larger, or is something that may never end: a device, a socket, or
        a named pipe, which waits for whoever writes to it.
    """
    found = os.stat(path)
    inherited = stat.S_ISFIFO(found.st_mode) and os.fspath(path).startswith(PIPES)
    if not (stat.S_ISREG(found.st_mode) or stat.S_ISDIR(found.st_mode) or inherited):
        raise OSError(errno.EINVAL, "is not a regular file", os.fspath(path))
    if stat.S_ISREG(found.st_mode) and found.st_size > limit:
        raise _too_large(path, limit)
    with Path(path).open("rb") as file:
        content = file.read(limit + 1)
    if len(content) > limit:
        raise _too_large(path, limit)
    return content


def _too_large(path: str | os.PathLike[str], limit: int) -> OSError:
    return OSError(errno.EFBIG, f"is larger than {limit >> 20} MiB", os.fspath(path))
