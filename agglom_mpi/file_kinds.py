"""Kinds of files that commands are given, recognised by their first bytes."""

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
