"""HDF5 files on a disc that may fill up: a failed write is told by us, not by HDF5."""

import errno
import io
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import h5py
from h5py import h5f, h5fd, h5p


class Disc(io.FileIO):
    """A new file that remembers the first failed write and ignores what follows.

    HDF5 cannot flush its cache of chunks once a write has failed: closing the file fails, and the
    next file that the process opens may crash it. So it is told that all went well.
    """

    def __init__(self, path: Path) -> None:
        super().__init__(os.fspath(path), "w+")
        self._error = 0

    def check(self) -> None:
        """Raise an OSError if a write has failed."""
        if self._error:
            raise OSError(self._error, os.strerror(self._error), self.name)

    def write(self, data: Any) -> int:
        """Write all of it, or pretend to."""
        view = memoryview(data).cast("B")
        written = 0
        try:
            while not self._error and written < len(view):
                written += super().write(view[written:]) or 0
        except OSError as error:
            self._error = error.errno or errno.EIO
        return len(view)

    def truncate(self, size: int | None = None) -> int:
        """Cut or lengthen the file, or pretend to."""
        try:
            if not self._error:
                return super().truncate(size)
        except OSError as error:
            self._error = error.errno or errno.EIO
        return size or 0


@contextmanager
def new_file(path: Path) -> Iterator[tuple[h5py.File, Disc]]:
    """Yield an empty HDF5 file in the oldest format and the disc that it is written to.

    Raises
    ------
    OSError
        At the end, if a write failed; `Disc.check` says so before.
    """
    with Disc(path) as disc:
        with h5py.File(h5f.create(os.fsencode(path), fapl=_access_list(disc))) as file:
            yield file, disc
        disc.check()


def _access_list(disc: Disc) -> h5p.PropFAID:
    # Not to be kept: it holds the disc, and HDF5 lets go of it after Python has ended.
    access = h5p.create(h5p.FILE_ACCESS)
    access.set_fileobj_driver(h5fd.fileobj_driver, disc)
    access.set_libver_bounds(h5f.LIBVER_EARLIEST, h5f.LIBVER_LATEST)
    return access
