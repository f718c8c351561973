"""Rows that are either absent or final: done bytes, checksums, digests of generations."""

import hashlib
import time
import zlib
from collections.abc import Iterator, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any, Final, NamedTuple

import h5py
import numpy as np

from agglom_mpi.storage.room import TableSizes
from agglom_mpi.storage.rows import Rows, consecutive_numbers, same_type
from agglom_mpi.storage.schema import FORMAT_VERSION, RESULTS, SAMPLES, TableSchema

_ROWS_AT_ONCE: Final = 1 << 14
"""Number of rows that are copied at once to compute their checksums."""

REWRITE_SECONDS: Final = 0.1
"""Longer than a row that is rewritten in place takes to be whole again."""


def checksum_ok(rows: np.ndarray) -> np.ndarray:
    """Return whether each row has the right checksum, or its table has none, (n,) bool."""
    if "crc" not in (rows.dtype.names or ()):
        return np.ones(len(rows), bool)
    return checksums(rows) == rows["crc"]


def checksums(rows: np.ndarray) -> np.ndarray:
    """Return the CRC-32 of the bytes of each row with its `crc` zero, (n,) uint32."""
    if len(rows) > _ROWS_AT_ONCE:
        parts = range(0, len(rows), _ROWS_AT_ONCE)
        return np.concatenate([checksums(rows[at : at + _ROWS_AT_ONCE]) for at in parts])
    blank = rows.copy()
    blank["crc"] = 0
    raw = memoryview(blank.tobytes())
    size = rows.dtype.itemsize
    return np.array(
        [zlib.crc32(raw[at : at + size]) for at in range(0, len(raw), size)], dtype=np.uint32
    )


class ValidRows(NamedTuple):
    """The rows of a range that are final and have the right checksum."""

    rows: np.ndarray
    places: np.ndarray
    """Their numbers, ascending."""
    damaged: np.ndarray
    """Numbers of the final rows of the range whose checksum is wrong."""


class Table:
    """A dataset of rows with checksums, and the dataset of their done bytes.

    `direct` is that of `Rows`.

    Attributes
    ----------
    dtype
        Of the rows that are written and returned.
    rows
        The rows as the file has them: in one of an older format version they have fewer columns.
    done
        The done bytes.
    """

    def __init__(self, file: h5py.File, name: str, path: Path, *, direct: bool = False) -> None:
        self.rows = Rows(file[name], path, direct=direct)
        self.done = Rows(file[f"{name}_done"], path, direct=direct)
        self.dtype = self.rows.dtype
        if file.attrs["format_version"] < FORMAT_VERSION:
            now = TableSizes.of(file.attrs)._replace(version=FORMAT_VERSION)
            [self.dtype] = [table.dtype for table in now.tables() if table.name == name]

    @property
    def capacity(self) -> int:
        """Number of rows that there is room for."""
        return self.rows.capacity

    def write(self, first: int, rows: np.ndarray, *, checked: bool = False) -> None:
        """Make rows final: checksum, then the rows, then their done bytes.

        Parameters
        ----------
        first : int
            Number of the first row.
        rows : (n,) structured array
            Consecutive rows.
        checked : bool
            Whether they have their checksums, over the file's own row type, except those whose
            `crc` is 0. Other ones are replaced.
        """
        if not (checked and same_type(rows.dtype, self.rows.dtype) and rows["crc"].all()):
            rows = sealed(fitted(rows, self.rows.dtype))
        self.rows.write(first, rows)
        self.done.write(first, np.ones(len(rows), np.uint8))

    def mark_absent(self, first: int, count: int) -> None:
        """Clear the done bytes of rows."""
        self.done.write(first, np.zeros(count, np.uint8))

    def read(self, first: int = 0, count: int | None = None) -> ValidRows:
        """Return the valid rows among `count` from `first` on (by default all), in order."""
        return self.read_places(self.done.nonzero(first, count))

    def read_places(self, places: np.ndarray, *, patient: bool = False) -> ValidRows:
        """Return the valid rows among those with the numbers `places`, (n,), ascending.

        With `patient`, damaged rows are read once more, after the time in which a run that replaces
        them has done so; what it has made absent meanwhile is left out.
        """
        rows = self.rows.read_places(places)
        valid = checksum_ok(rows)
        wrong = np.flatnonzero(~valid)
        if patient and len(wrong):
            time.sleep(REWRITE_SECONDS)
            rows[wrong] = self.rows.read_places(places[wrong])
            valid[wrong] = checksum_ok(rows[wrong])
            wrong = wrong[~valid[wrong] & (self.done.read_places(places[wrong]) != 0)]
        damaged = places[wrong]
        if not valid.all():
            rows, places = rows_at(rows, valid), places[valid]
        return ValidRows(fitted(rows, self.dtype), places, damaged)

    def runs(self, first: int = 0, count: int | None = None) -> Iterator[tuple[int, int]]:
        """Yield start and length of each run of final rows in a range."""
        return consecutive_numbers(self.done.nonzero(first, count))

    def end(self) -> int:
        """Return the number after that of the last final row."""
        final = self.done.nonzero()
        return int(final[-1]) + 1 if len(final) else 0

    def append_place(self) -> int:
        """Return the number of the row to append: the next, or the last if there is no room."""
        return min(self.end(), self.capacity - 1)


def fitted(rows: np.ndarray, dtype: np.dtype) -> np.ndarray:
    """Return rows, (n,), with the columns of another row type, by name.

    What the rows lack is nan, 0 or empty.
    """
    if same_type(rows.dtype, dtype):
        return rows
    found = np.zeros(len(rows), dtype)
    for name in dtype.names or ():
        if name in (rows.dtype.names or ()):
            found[name] = rows[name]
        elif dtype[name].base.kind == "f":
            found[name] = np.nan
    return found


def make_row(dtype: np.dtype, **columns: Any) -> np.ndarray:
    """Return one row, (1,): texts cut to fit between characters, columns left out zero."""
    row = np.zeros(1, dtype)
    for name, value in columns.items():
        if isinstance(value, str):
            fitting = value.encode(errors="backslashreplace")[: dtype[name].itemsize]
            value = fitting.decode(errors="ignore").encode()
        row[name] = value
    return row


def sealed(rows: np.ndarray) -> np.ndarray:
    """Return the same rows with their checksums, if their table has any."""
    if "crc" in (rows.dtype.names or ()):
        rows["crc"] = checksums(rows)
    return rows


def concatenated(parts: Sequence[np.ndarray], dtype: np.dtype) -> np.ndarray:
    """Return the rows of all parts, one after the other; a single part is not copied.

    `numpy.concatenate` copies structured rows column by column and takes a hundred times as long.
    """
    if len(parts) == 1:
        return parts[0]
    return np.frombuffer(bytearray().join(part.tobytes() for part in parts), dtype)


def rows_at(rows: np.ndarray, where: np.ndarray) -> np.ndarray:
    """Return the rows, of some of shape (n,), at an array of places or flags.

    They are moved as plain bytes: NumPy moves structured rows column by column.
    """
    plain = np.ascontiguousarray(rows).view(np.dtype((np.void, rows.dtype.itemsize)))
    return plain[where].view(rows.dtype)


def consecutive_samples(rows: np.ndarray) -> Iterator[np.ndarray]:
    """Yield parts of rows, (n,), that are consecutive samples of one string."""
    ends = np.flatnonzero((np.diff(rows["sample"]) != 1) | (np.diff(rows["string"]) != 0)) + 1
    for begin, end in pairwise([0, *ends.tolist(), len(rows)]):
        if end > begin:
            yield rows[begin:end]


NOT_DETERMINED: Final = ("seconds", "cpu_seconds", "finished", "rank", "crc")
"""Columns that may differ between two runs of the same campaign."""


def generation_digest(
    parameters: np.ndarray,
    results: np.ndarray,
    samples: np.ndarray,
    version: int = FORMAT_VERSION,
    sample_schema: TableSchema = SAMPLES,
) -> int:
    """Return the 64-bit BLAKE2b digest of what a generation rests on (see `DIGEST_MEANING`).

    Parameters
    ----------
    parameters : (n, k) float64
        The strings judged in the generation, by number.
    results, samples : structured arrays
        Their rows of `/results` and, by string and sample, those of `/samples` that are used.
    version : int
        Format version of the file, whose columns count.
    sample_schema : TableSchema
        Columns of its `/samples`.
    """
    digest = hashlib.blake2b(digest_size=8)
    digest.update(parameters.astype("<f8").tobytes())
    digest.update(_packed(fitted(results, RESULTS.at(version).dtype)))
    digest.update(_packed(fitted(samples, sample_schema.at(version).dtype)))
    return int.from_bytes(digest.digest(), "little")


def used_samples(samples: np.ndarray, results: np.ndarray) -> np.ndarray:
    """Return the rows that the results rest on: each once, by string and sample."""
    return rows_at(samples, places_used(samples, results))


def places_used(samples: np.ndarray, results: np.ndarray) -> np.ndarray:
    """Return where the rows of `used_samples` are among all, (n,) int64."""
    used = np.flatnonzero(are_used(samples, results))
    strings, numbers = samples["string"][used], samples["sample"][used]
    places = strings * (1 + numbers.max(initial=0)) + numbers
    return used[np.unique(places, return_index=True)[1]]


def are_used(samples: np.ndarray, results: np.ndarray) -> np.ndarray:
    """Return which rows of `/samples` the results rest on, (n,) bool."""
    last = max(samples["string"].max(initial=0), results["string"].max(initial=0))
    used = np.zeros(1 + last, np.int64)
    used[results["string"]] = results["samples_used"]
    return np.asarray(samples["sample"] < used[samples["string"]])


def _packed(rows: np.ndarray) -> bytes:
    """Return the little-endian bytes of the deterministic columns, row after row."""
    names = [name for name in rows.dtype.names or () if name not in NOT_DETERMINED]
    dtype = np.dtype([(name, rows.dtype[name].newbyteorder("<")) for name in names])
    if all(rows.dtype.fields[name] == dtype.fields[name] for name in names):  # type: ignore[index]
        # They are the first bytes of each row.
        plain = np.ascontiguousarray(rows).view(np.uint8).reshape(len(rows), rows.dtype.itemsize)
        return plain[:, : dtype.itemsize].tobytes()
    packed = np.empty(len(rows), dtype)
    for name in names:
        packed[name] = rows[name]
    return packed.tobytes()
