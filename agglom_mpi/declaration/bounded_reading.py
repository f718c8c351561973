"""Reading of files that somebody names, up to a size that takes a moment, and quoting from them.

A campaign may come from others and name any file of this machine. A message quotes at most the
start of the field that is wrong.
"""

import errno
import os
import re
import stat
from pathlib import Path
from typing import Final

from agglom_mpi.file_kinds import is_kernel_file

PIPES: Final = ("/dev/fd/", "/dev/stdin", "/proc/self/fd/")
"""Names under which a process has the ends of pipes that it was started with."""

SHOWN_CHARACTERS: Final = 20
"""Maximum number of characters of a file's field in a message."""
_LONG_WORD: Final = re.compile(rf"\S{{{SHOWN_CHARACTERS + 1},}}")


def quoted_start(text: str) -> str:
    """Return the start of a text in quotation marks, its printable characters alone."""
    found = "".join(filter(str.isprintable, text[: 2 * SHOWN_CHARACTERS]))
    cut = len(found) > SHOWN_CHARACTERS or len(text) > 2 * SHOWN_CHARACTERS
    return f"'{found[: SHOWN_CHARACTERS - 3]}...'" if cut else f"'{found}'"


def clipped(message: object) -> str:
    """Return another program's message about a file with long words, which may be its, cut off."""
    return _LONG_WORD.sub(lambda word: f"{word[0][: SHOWN_CHARACTERS - 3]}...", str(message))


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
        If it cannot be read, is larger, or is something that may never end: a device, a socket, a
        file of the kernel in /proc or /sys, or a named pipe, which waits for whoever writes to it.
    """
    found = os.stat(path)
    inherited = stat.S_ISFIFO(found.st_mode) and os.fspath(path).startswith(PIPES)
    if not (stat.S_ISREG(found.st_mode) or stat.S_ISDIR(found.st_mode) or inherited):
        raise OSError(errno.EINVAL, "is not a regular file", os.fspath(path))
    if is_kernel_file(path):
        raise OSError(errno.EINVAL, "is in /proc or /sys, which are not read", os.fspath(path))
    if stat.S_ISREG(found.st_mode) and found.st_size > limit:
        raise _too_large(path, limit)
    with Path(path).open("rb") as file:
        content = file.read(limit + 1)
    if len(content) > limit:
        raise _too_large(path, limit)
    return content


def _too_large(path: str | os.PathLike[str], limit: int) -> OSError:
    return OSError(errno.EFBIG, f"is larger than {limit >> 20} MiB", os.fspath(path))
