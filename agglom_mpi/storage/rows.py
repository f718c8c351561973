"""Rows of one dataset: ranges of them, and those that are not zero, without reading holes."""

import errno
import os
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import pairwise
from pathlib import Path
from typing import Final

import h5py
import numpy as np
from h5py import h5s

from agglom_mpi.storage.access import with_path

_BLOCK: Final = 1 << 20
"""Number of elements read at once."""
_SHORT: Final = 1 << 16
"""Number of elements of a range that is read at once; in longer ones, holes are skipped."""


class Rows:
    """Reading and writing of ranges of one dataset.

    HDF5's low-level calls take a fifteenth of the time of `dataset[a:b] = rows`.

    Parameters
    ----------
    dataset, path
        The dataset, and the name of its file.
    direct
        Read and write through HDF5's descriptor, but past HDF5, which takes ten times as long to
        find that it has nothing to convert. Only in a file that this process alone has open for
        writing: to find the driver of a file that ranks have open together is a collective call.
    """

    def __init__(self, dataset: h5py.Dataset, path: Path, *, direct: bool = False) -> None:
        self.name: str = dataset.name
        self.dtype: np.dtype = dataset.dtype
        self.capacity: int = dataset.shape[0]
        self._path = path
        self._dataset = dataset
        self._id = dataset.id
        self._type = dataset.id.get_type()
        self._space = dataset.id.get_space()
        self._begin = _offset(dataset) if direct else None
        self._descriptor = -1 if self._begin is None else dataset.file.id.get_vfd_handle()

    def read(self, first: int, count: int) -> np.ndarray:
        """Read `count` elements from `first` on; raises IndexError, and OSError with the path."""
        rows = np.empty(count, self.dtype)
        self.read_into(first, rows)
        return rows

    def read_into(self, first: int, rows: np.ndarray) -> None:
        """Fill `rows`, (n,), with the elements from `first` on; raises errors as `read`."""
        count = len(rows)
        self.check(first, count)
        try:
            if self._begin is not None:
                self._read_bytes(self._begin + first * self.dtype.itemsize, rows)
                return
            self._space.select_hyperslab((first,), (count,))
            self._id.read(h5s.create_simple((count,)), self._space, rows, self._type)
        except OSError as error:
            raise with_path(error, self._path) from error

    def read_places(self, places: np.ndarray) -> np.ndarray:
        """Read the elements with the numbers `places`, (n,), ascending: into one array, once."""
        rows, begin = np.empty(len(places), self.dtype), 0
        for first, count in consecutive_numbers(places):
            self.read_into(first, rows[begin : begin + count])
            begin += count
        return rows

    def read_all(self) -> np.ndarray:
        """Read all elements."""
        return self.read(0, self.capacity)

    def nonzero(self, first: int = 0, count: int | None = None) -> np.ndarray:
        """Return the numbers of the elements of a range that are not 0, ascending, (n,) int64.

        Time and memory follow what has been written of the dataset, not its length.
        """
        end = self.capacity if count is None else first + count
        self.check(first, end - first)
        found = [np.zeros(0, np.int64)]
        for begin, stop in self._written(first, end):
            for at in range(begin, stop, _BLOCK):
                values = self.read(at, min(_BLOCK, stop - at))
                found.append(at + np.flatnonzero(values))
        return np.concatenate(found)

    def _written(self, first: int, end: int) -> Iterator[tuple[int, int]]:
        """Yield begin and end of parts of a range outside which nothing has been written."""
        if end - first <= _SHORT:
            yield first, end
            return
        size = self.dtype.itemsize
        offset = _offset(self._dataset)
        with _reopened(self._dataset.file) as descriptor:
            if offset is None or descriptor is None:
                yield first, end
                return
            for begin, stop in _data_parts(descriptor, offset + first * size, offset + end * size):
                yield (begin - offset) // size, -((offset - stop) // size)

    def write(self, first: int, rows: np.ndarray) -> None:
        """Write elements from `first` on; raises IndexError, and OSError with the path."""
        self.check(first, len(rows))
        try:
            if self._begin is not None and same_type(rows.dtype, self.dtype):
                self._write_bytes(self._begin + first * self.dtype.itemsize, rows.tobytes())
            else:
                self._space.select_hyperslab((first,), (len(rows),))
                self._id.write(h5s.create_simple((len(rows),)), self._space, rows, self._type)
        except OSError as error:
            raise with_path(error, self._path) from error

    def _read_bytes(self, at: int, rows: np.ndarray) -> None:
        """Fill rows from a place of the file; raises OSError where the file ends before."""
        self._require_open()
        content = rows.view(np.uint8).data
        while content:
            count = os.preadv(self._descriptor, [content], at)
            if not count:
                raise OSError(errno.EIO, f"{self.name} is cut off")
            at, content = at + count, content[count:]

    def _write_bytes(self, at: int, content: bytes) -> None:
        self._require_open()
        while content:
            written = os.pwrite(self._descriptor, content, at)
            at, content = at + written, content[written:]

    def _require_open(self) -> None:
        """Raise a ValueError if the file is closed: its descriptor may be another file's by now."""
        if not self._id.valid:
            raise ValueError(f"{self._path} is closed")

    def check(self, first: int, count: int) -> None:
        """Raise an IndexError if these elements do not exist."""
        if not 0 <= first <= first + count <= self.capacity:
            raise IndexError(
                f"{self._path}: rows {first} to {first + count - 1} of {self.name} "
                f"do not exist; it has room for {self.capacity}"
            )


def consecutive_numbers(numbers: np.ndarray) -> Iterator[tuple[int, int]]:
    """Yield first and length of each run of consecutive numbers among some, (n,), ascending."""
    ends = np.flatnonzero(np.diff(numbers) != 1) + 1
    for begin, end in pairwise([0, *ends.tolist(), len(numbers)]):
        if end > begin:
            yield int(numbers[begin]), end - begin


def same_type(one: np.dtype, other: np.dtype) -> bool:
    """Return whether two row types are equal; a comparison by columns takes some microseconds."""
    return one is other or one == other


def _offset(dataset: h5py.Dataset) -> int | None:
    """Return where the data of a dataset begin in its file; None unless they lie there in a row."""
    if dataset.file.driver != "sec2" or dataset.file.userblock_size:
        return None
    return dataset.id.get_offset()


@contextmanager
def _reopened(file: h5py.File) -> Iterator[int | None]:
    """Yield a descriptor of an open file with a position of its own; None if there is none.

    The name may belong to another file by now.
    """
    try:
        descriptor = os.open(f"/proc/self/fd/{file.id.get_vfd_handle()}", os.O_RDONLY)
    except (OSError, NotImplementedError):
        yield None
        return
    try:
        yield descriptor
    finally:
        os.close(descriptor)


def _data_parts(descriptor: int, begin: int, end: int) -> Iterator[tuple[int, int]]:
    """Yield begin and end of the parts of a range of bytes that are no holes of the file.

    A file system that does not know of holes has one part.
    """
    at = begin
    while at < end:
        try:
            start = os.lseek(descriptor, at, os.SEEK_DATA)
            stop = os.lseek(descriptor, start, os.SEEK_HOLE)
        except OSError as error:
            if error.errno != errno.ENXIO:  # which means that only a hole follows
                yield at, end
            return
        if start < end:
            yield start, min(stop, end)
        at = stop
