"""Writing samples to a campaign file: buffered, in runs of rows, by any rank."""

import os
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Final, Self

import h5py
import numpy as np
from numpy.typing import NDArray

from agglom_mpi.scheduling.interface import number_in_volume, runs, volumes_of
from agglom_mpi.storage.access import open_file, with_path
from agglom_mpi.storage.room import TableSizes
from agglom_mpi.storage.rows import same_type
from agglom_mpi.storage.schema import volume_table
from agglom_mpi.storage.table import Table, checksum_ok, rows_at

if TYPE_CHECKING:
    from mpi4py.MPI import Intracomm


class WriteClock:
    """Sum of the wall-clock time inside `with` blocks, which may be nested.

    Attributes
    ----------
    seconds
        Time so far, s.
    """

    def __init__(self) -> None:
        self.seconds = 0.0
        self._depth = 0
        self._begun = 0.0

    def __enter__(self) -> Self:
        if not self._depth:
            self._begun = time.perf_counter()
        self._depth += 1
        return self

    def __exit__(self, *error: object) -> None:
        self._depth -= 1
        if not self._depth:
            self.seconds += time.perf_counter() - self._begun


FLUSH_ROWS: Final = 16384
"""Maximum number of rows that are buffered: many, so that samples of one string lie together."""
FLUSH_BYTES: Final = 1 << 22
"""Most bytes that are buffered."""
FLUSH_AGE: Final = 0.5
"""Longest time that a row is buffered, s."""


class RowBuffer:
    """Buffer of rows of one table, addressed by string, or by string and sample.

    Parameters
    ----------
    table
        The table.
    room
        Number of strings, and of samples of each, by the columns of the table that give a row's
        place: `string`, and `sample` if there is one.
    first
        Numbers of the first of these in rows that are added; by default 0.
    """

    def __init__(
        self, table: Table, room: Mapping[str, int], first: Mapping[str, int] | None = None
    ) -> None:
        self.table = table
        self._room = room
        self._first = first
        self.clear()

    def clear(self) -> None:
        """Remove all rows."""
        self._waiting: list[bytes] = []
        self.count = 0
        self._since = 0.0

    @property
    def full(self) -> bool:
        """Whether the buffer has reached its limit."""
        return self.count >= min(FLUSH_ROWS, max(1, FLUSH_BYTES // self.table.dtype.itemsize))

    def due(self, now: float) -> bool:
        """Return whether the oldest row is older than `FLUSH_AGE` at `time.monotonic()` = now."""
        return self.count > 0 and now - self._since >= FLUSH_AGE

    def add(self, records: np.ndarray) -> None:
        """Add a copy of rows, (n,); raises IndexError if the table has no place for them."""
        if not len(records):
            return
        for name, room in self._room.items():
            numbers = self._numbers(records, name)
            # Without their sign, negative numbers are the largest.
            if numbers.view(np.uint64).max() >= room:
                wrong = next(number for number in numbers.tolist() if not 0 <= number < room)
                raise IndexError(f"{name} {wrong}: there is room for 0 to {room - 1}")
        if not self.count:
            self._since = time.monotonic()
        dtype = self.table.dtype
        rows = records if same_type(records.dtype, dtype) else records.astype(dtype)
        self._waiting.append(rows.tobytes())
        self.count += len(records)

    def runs(self) -> Iterator[tuple[int, np.ndarray]]:
        """Yield row number and rows of each consecutive run; of rows for one place the first."""
        if not self.count:
            return
        rows = np.frombuffer(b"".join(self._waiting), self.table.dtype)
        numbers = [self._numbers(rows, name) for name in self._room]
        places = np.ravel_multi_index(numbers, tuple(self._room.values()))
        places, first = np.unique(places, return_index=True)
        ordered = rows_at(rows, first)
        if self._first:  # the table counts its strings from 0
            ordered["string"] -= self._first["string"]
            ordered["crc"] = 0
        ends = [*(np.flatnonzero(np.diff(places) != 1) + 1).tolist(), len(places)]
        for begin, end in pairwise([0, *ends]):
            yield int(places[begin]), ordered[begin:end]

    def write_absent(self) -> None:
        """Write the rows that are not in the file."""
        for first, rows in self.runs():
            for run in runs(~stored(self.table, first, len(rows))):
                self.table.write(first + run.start, rows[run], checked=True)
        self.clear()

    def _numbers(self, rows: np.ndarray, name: str) -> np.ndarray:
        return rows[name] - self._first[name] if self._first else rows[name]


def stored(table: Table, first: int, count: int) -> NDArray[np.bool_]:
    """Return which rows are in the file, (n,); two ranks may have simulated the same sample."""
    found = table.done.read(first, count) != 0
    if found.any():
        found &= checksum_ok(table.rows.read(first, count))
    return found


class SampleWriter:
    """Writer of `/samples`, `/final_particles` and the samples of larger control volumes.

    Rows are visible to readers after `flush`.

    Parameters
    ----------
    file
        The campaign file, open for writing.
    path
        Its name.
    clock
        Measures the time spent on writing.
    check
        Called before rows are written; may raise an OSError.
    direct
        Whether this process alone has the file open for writing; see `Rows`.

    Attributes
    ----------
    written
        Rows written so far.
    """

    def __init__(
        self,
        file: h5py.File,
        path: Path,
        clock: WriteClock,
        check: Callable[[], None] = lambda: None,
        *,
        direct: bool = False,
    ) -> None:
        self.written = 0
        self._check = check
        self._clock = clock
        sizes = TableSizes.of(file.attrs)
        room = {"string": sizes.strings, "sample": sizes.sample_room}
        self._samples = RowBuffer(Table(file, "samples", path, direct=direct), room)
        self._finals: RowBuffer | None = None
        if "final_particles" in file:
            self._finals = RowBuffer(Table(file, "final_particles", path, direct=direct), room)
        self._volumes = {
            volume: RowBuffer(
                Table(file, volume_table(volume), path, direct=direct),
                {"string": sizes.strings, "sample": sizes.fresh},
                {"string": number_in_volume(0, volume), "sample": sizes.max_samples},
            )
            for volume in sizes.volumes
        }

    def put(self, records: np.ndarray, finals: np.ndarray | None = None) -> None:
        """Buffer rows of samples until `flush`, which is called here if the buffer is full.

        Parameters
        ----------
        records : (n,) rows of `/samples`
            Without `crc`. Of several rows of one sample in the buffer, the first is kept. Those of
            a larger control volume have the string numbers of `scheduling.volume_strings`.
        finals : structured array, optional
            Their rows of `/final_particles`, if the file has that table.
        """
        with self._clock:
            if self._volumes:
                records = self._without_volumes(records)
            self._samples.add(records)
            full = any(buffer.full for buffer in self._buffers)
            if self._finals is not None and finals is not None:
                self._finals.add(finals)
                full |= self._finals.full
        if full:
            self.flush()

    def _without_volumes(self, records: np.ndarray) -> np.ndarray:
        """Buffer the samples of larger volumes, and return the others."""
        volumes = volumes_of(records["string"])
        for volume in np.unique(volumes[volumes > 1]).tolist():
            self._volumes[volume].add(records[volumes == volume])
        return records if (volumes == 1).all() else records[volumes == 1]

    @property
    def _buffers(self) -> list[RowBuffer]:
        return [self._samples, *self._volumes.values()]

    def due(self, now: float) -> bool:
        """Return whether a sample is older than `FLUSH_AGE` at `time.monotonic()` = now."""
        return any(buffer.due(now) for buffer in self._buffers)

    def flush_due(self) -> None:
        """Flush if a sample is older than `FLUSH_AGE`."""
        if self.due(time.monotonic()):
            self.flush()

    def flush(self) -> None:
        """Write the buffered samples, consecutive ones together, their particles first."""
        self._check()
        with self._clock:
            if self._finals is not None:
                for first, rows in self._finals.runs():
                    # Where a run was killed between a sample's particles and the sample.
                    if self._finals.table.done.read(first, len(rows)).any():
                        self._finals.table.mark_absent(first, len(rows))
                    self._finals.table.write(first, rows)
                self._finals.clear()
            for buffer in self._buffers:
                count = buffer.count
                buffer.write_absent()
                self.written += count

    def discard(self) -> None:
        """Remove the buffered samples without writing them."""
        for buffer in self._buffers:
            buffer.clear()
        if self._finals is not None:
            self._finals.clear()


class RankWriter:
    """Writer of samples on a rank other than 0, with the file opened by all ranks together.

    Opening and closing are collective. Between the two no call waits for another rank: rows are
    raw data, and `fsync` of a plain descriptor puts them on the disk.

    Parameters
    ----------
    path
        The file.
    world
        All ranks.
    syncs
        Whether this rank calls `fsync`: one rank of a node does so for all of them.

    Attributes
    ----------
    before_write
        Called before this rank writes, which may take long where the file system stalls.
    """

    def __init__(self, path: Path, world: "Intracomm", *, syncs: bool) -> None:
        self.clock = WriteClock()
        self.before_write: Callable[[], None] = lambda: None
        self._path = path
        self._file = open_file(path, write=True, thorough=False, world=world)
        self._descriptor = os.open(path, os.O_RDONLY) if syncs else None
        self.samples = SampleWriter(self._file, path, self.clock, lambda: self.before_write())

    def sync(self) -> None:
        """Wait until what all ranks of this node have flushed is on the disk."""
        if self._descriptor is not None:
            self.before_write()
            with self.clock:
                sync_descriptor(self._descriptor, self._path)

    def close(self) -> None:
        """Flush and close, together with all ranks."""
        self.samples.flush()
        self._file.close()
        if self._descriptor is not None:
            with suppress(OSError):
                os.close(self._descriptor)


def sync_descriptor(descriptor: int, path: Path) -> None:
    """Wait until a file is on the disk; raises OSError with its path."""
    try:
        os.fsync(descriptor)
    except OSError as error:
        raise with_path(error, path) from error
