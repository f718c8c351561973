"""Rows that are either absent or final: checksums, done bytes and the order of writing."""

import zlib
from collections.abc import Iterator, Sequence
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

import h5py
import numpy as np
from h5py import h5s

from agglom_mpi.storage.access import with_path
from agglom_mpi.storage.columns import fitted
from agglom_mpi.storage.schema import FORMAT_VERSION, layouts


class Rows:
    """Plain reading and writing of ranges of one dataset.

    The low-level calls take a fifteenth of the time of `dataset[a:b] = rows`.
    """

    def __init__(self, dataset: h5py.Dataset, path: Path) -> None:
        self.name: str = dataset.name
        self.dtype: np.dtype = dataset.dtype
        self.capacity: int = dataset.shape[0]
        self._path = path
        self._id = dataset.id
        self._type = dataset.id.get_type()
        self._space = dataset.id.get_space()

    def read(self, first: int, count: int) -> np.ndarray:
        """`count` elements from `first` on; raises IndexError outside, OSError with the path."""
        self._select(first, count)
        rows = np.empty(count, self.dtype)
        try:
            self._id.read(h5s.create_simple((count,)), self._space, rows, self._type)
        except OSError as error:
            raise with_path(error, self._path) from error
        return rows

    def read_all(self) -> np.ndarray:
        """All elements."""
        return self.read(0, self.capacity)

    def write(self, first: int, rows: np.ndarray) -> None:
        """Write elements from `first` on; raises IndexError outside, OSError with the path."""
        self._select(first, len(rows))
        try:
            self._id.write(h5s.create_simple((len(rows),)), self._space, rows, self._type)
        except OSError as error:
            raise with_path(error, self._path) from error

    def check(self, first: int, count: int) -> None:
        """Raise an IndexError if these elements do not exist."""
        if not 0 <= first <= first + count <= self.capacity:
            raise IndexError(
                f"{self._path}: rows {first} to {first + count - 1} of {self.name} "
                f"do not exist; it has room for {self.capacity}"
            )

    def _select(self, first: int, count: int) -> None:
        self.check(first, count)
        self._space.select_hyperslab((first,), (count,))


class ValidRows(NamedTuple):
    """The rows of a range that are final and whole, and how many final ones are not whole."""

    rows: np.ndarray
    damaged: int


class Table:
    """A dataset of checksummed rows and the one of their done bytes.

    Attributes
    ----------
    dtype
        Of the rows that are taken and given.
    rows
        The rows as the file has them: in one of an older format version they have fewer columns.
    done
        The done bytes.
    """

    def __init__(self, file: h5py.File, name: str, path: Path) -> None:
        self.rows = Rows(file[name], path)
        self.done = Rows(file[f"{name}_done"], path)
        self.dtype = self.rows.dtype
        if file.attrs["format_version"] < FORMAT_VERSION:
            now = layouts({**file.attrs, "format_version": FORMAT_VERSION})
            [self.dtype] = [table.dtype for table in now if table.name == name]

    @property
    def capacity(self) -> int:
        """Rows that there is room for."""
        return self.rows.capacity

    def write(self, first: int, rows: np.ndarray) -> None:
        """Make rows final: checksum, then the rows, then their done bytes.

        Parameters
        ----------
        first : int
            Number of the first row.
        rows : (n,) structured array
            Consecutive rows.
        """
        rows = fitted(rows, self.rows.dtype)
        rows["crc"] = checksums(rows)
        self.rows.write(first, rows)
        self.done.write(first, np.ones(len(rows), np.uint8))

    def forget(self, first: int, count: int) -> None:
        """Make rows absent."""
        self.done.write(first, np.zeros(count, np.uint8))

    def read(self, first: int = 0, count: int | None = None) -> ValidRows:
        """Rows of a range (by default all) that are final and whole, in order."""
        parts = [self.rows.read(*run) for run in self.runs(first, count)]
        rows = concatenated(parts, self.rows.dtype)
        whole = checksum_ok(rows)
        return ValidRows(fitted(rows[whole], self.dtype), int(len(rows) - whole.sum()))

    def runs(self, first: int = 0, count: int | None = None) -> Iterator[tuple[int, int]]:
        """Start and length of each unbroken run of final rows in a range."""
        done = self.done.read(first, self.capacity - first if count is None else count)
        for start, length in runs_of(done):
            yield first + start, length

    def end(self) -> int:
        """Find the number after that of the last final row."""
        final = np.flatnonzero(self.done.read_all())
        return int(final[-1]) + 1 if len(final) else 0

    def following(self) -> int:
        """Find the row to append: the next one, or the last if there is no more room."""
        return min(self.end(), self.capacity - 1)


def concatenated(parts: Sequence[np.ndarray], dtype: np.dtype) -> np.ndarray:
    """Rows of all parts, one after the other; a single part itself.

    `numpy.concatenate` copies structured rows column by column, which takes a hundred times as
    long.
    """
    if len(parts) == 1:
        return parts[0]
    return np.frombuffer(bytearray(b"".join(part.tobytes() for part in parts)), dtype)


def runs_of(done: np.ndarray) -> Iterator[tuple[int, int]]:
    """Start and length of each run of done bytes that are set."""
    if len(done) and done.all():  # nearly always, among what ranks return
        yield 0, len(done)
        return
    edges = np.flatnonzero(np.diff(done != 0, prepend=False, append=False))
    for start, stop in edges.reshape(-1, 2).tolist():
        yield start, stop - start


def consecutive_samples(rows: np.ndarray) -> Iterator[np.ndarray]:
    """Parts of rows, (n,), that are consecutive samples of one string."""
    ends = np.flatnonzero((np.diff(rows["sample"]) != 1) | (np.diff(rows["string"]) != 0)) + 1
    for begin, end in pairwise([0, *ends.tolist(), len(rows)]):
        if end > begin:
            yield rows[begin:end]


def checksum_ok(rows: np.ndarray) -> np.ndarray:
    """Whether each row has its right checksum, (n,) bool."""
    return checksums(rows) == rows["crc"]


def checksums(rows: np.ndarray) -> np.ndarray:
    """CRC-32 of the bytes of each row with its `crc` zero, (n,) uint32."""
    blank = rows.copy()
    blank["crc"] = 0
    raw = memoryview(blank.tobytes())
    size = rows.dtype.itemsize
    return np.array(
        [zlib.crc32(raw[at : at + size]) for at in range(0, len(raw), size)], dtype=np.uint32
    )
