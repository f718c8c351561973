"""Files that somebody names: their kind by the first bytes, and reading and quoting from them.

A campaign may come from others and name any file of this machine. A message quotes at most the
start of the field that is wrong.
"""

import errno
import os
import re
import stat
from pathlib import Path
from typing import Final

SIGNATURE: Final = b"\x89HDF\r\n\x1a\n"
"""First bytes of an HDF5 file."""

HEAD: Final = 1 << 16
"""Number of bytes at the beginning of a text that are searched for a section of a campaign."""

_SECTION: Final = re.compile(rb"^(\xef\xbb\xbf)?(scene|variables):", re.MULTILINE)

HDF5_IS_NO_YAML: Final = (
    "is an HDF5 file, not YAML; agglom report, check, simulate and export read campaign files"
)
YAML_IS_NO_HDF5: Final = (
    "it reads like a campaign in YAML: agglom-invert runs it, and agglom check, plan and simulate "
    "read it"
)


KERNEL_FOLDERS: Final = ("/proc", "/sys")
"""Where the kernel shows itself as files; some of them block a reader for ever."""


def is_kernel_file(path: str | os.PathLike[str]) -> bool:
    """Whether a path is a regular file or a folder below `KERNEL_FOLDERS`, whatever its name.

    A link in `/proc/self/fd` to another file or to a pipe is not.

    Raises
    ------
    OSError
        If there is no such file.
    """
    found = os.stat(path)
    if not (stat.S_ISREG(found.st_mode) or stat.S_ISDIR(found.st_mode)):
        return False
    real = os.path.realpath(path)
    folders = [folder for folder in KERNEL_FOLDERS if os.path.isdir(folder)]
    return any(
        found.st_dev == os.stat(folder).st_dev or real.startswith(f"{folder}/")
        for folder in folders
    )


def is_hdf5(path: str | os.PathLike[str]) -> bool:
    """Return whether to read a path as HDF5, by its name or its first bytes."""
    return Path(path).suffix == ".h5" or begins_as_hdf5(path)


def begins_as_hdf5(path: str | os.PathLike[str]) -> bool:
    """Return whether a file begins as HDF5 does, whatever its size and its name."""
    return _head(path, len(SIGNATURE)) == SIGNATURE


def reads_like_a_campaign(path: str | os.PathLike[str]) -> bool:
    """Return whether a file is a text with a section of a campaign."""
    return _SECTION.search(_head(path, HEAD)) is not None


def _head(path: str | os.PathLike[str], size: int) -> bytes:
    """Return the first bytes of a regular file, and no bytes of anything else.

    A pipe is not opened: it can be read only once, and HDF5 cannot be read from it.
    """
    try:
        if not Path(path).is_file() or is_kernel_file(path):
            return b""
        with Path(path).open("rb") as file:
            return file.read(size)
    except (OSError, ValueError):  # ValueError: a null byte in the name
        return b""


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
