"""A fingerprint of the bytes of a campaign file that do not change while rows are written.

A program that truncates the file, or copies another one over it, leaves the name and the open
descriptor as they are: rows would be written into what is left, and the run would end as if all
were stored.
"""

import errno
import os
from collections.abc import Iterator
from pathlib import Path
from typing import Final

import h5py

from agglom_mpi.storage.files import require_in_place
from agglom_mpi.storage.room import TableSizes
from agglom_mpi.storage.rows import Rows
from agglom_mpi.storage.schema import STATUS

_MOST_COMPARED: Final = 1 << 22
"""Maximum number of HDF5's own bytes that are compared; most files have less than 100 kB."""


class AlteredFileError(OSError):
    """Another program has truncated or overwritten a file that is being written."""


class Fingerprint:
    """Size of a campaign file and HDF5's own bytes; neither changes while rows are written.

    A comparison takes some 50 µs.

    Parameters
    ----------
    file
        The campaign file, open.
    path
        Its name.
    descriptor
        Of the same file, for reading; the caller closes it.
    """

    def __init__(self, file: h5py.File, path: Path, descriptor: int) -> None:
        self._path, self._descriptor = path, descriptor
        self._size = os.fstat(descriptor).st_size
        self._known: list[tuple[int, bytes]] = []
        self._status = Rows(file[STATUS.name], path)
        left = _MOST_COMPARED
        for begin, end in _outside_rows(file, self._size):
            content = os.pread(descriptor, min(end - begin, left), begin)
            self._known.append((begin, content))
            left -= len(content)

    def check(self, status: bytes | None = None) -> None:
        """Raise an error unless the file is in its place and unaltered.

        Parameters
        ----------
        status
            The row of `/status` as it was written last; an older copy of the file has another.

        Raises
        ------
        FileNotFoundError
            If it was removed or replaced.
        AlteredFileError
            If it was truncated or overwritten.
        """
        require_in_place(self._path, self._descriptor)
        size = os.fstat(self._descriptor).st_size
        if size != self._size:
            raise self._error(f"it has {size:,} bytes instead of {self._size:,}")
        for begin, content in self._known:
            if os.pread(self._descriptor, len(content), begin) != content:
                raise self._error("it has other bytes")
        if status not in (None, self._status.read(0, 1).tobytes()):
            raise self._error("it has another status")

    def _error(self, what: str) -> AlteredFileError:
        message = (
            f"was truncated or overwritten by another program during the run ({what}); what it "
            "held may be lost: restore a copy, or start afresh with --output"
        )
        return AlteredFileError(errno.EIO, message, str(self._path))


def _outside_rows(file: h5py.File, size: int) -> Iterator[tuple[int, int]]:
    """Yield begin and end of the parts of a file of `size` bytes that hold no rows."""
    tables = TableSizes.of(file.attrs).tables()
    datasets = [file[name].id for table in tables for name in table.datasets]
    at = 0
    for begin, length in sorted((d.get_offset(), d.get_storage_size()) for d in datasets):
        if begin > at:
            yield at, begin
        at = max(at, begin + length)
    if at < size:
        yield at, size


def redirect_writes(file: h5py.File) -> None:
    """Let HDF5 write what it still writes into memory: the file may be somebody else's now.

    Even closing it would write its first block, and lengthen it.
    """
    if file.driver == "sec2":
        nothing = os.memfd_create("altered")
        os.dup2(nothing, file.id.get_vfd_handle(), inheritable=False)
        os.close(nothing)
