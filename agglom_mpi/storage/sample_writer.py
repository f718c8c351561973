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

from agglom_mpi.scheduling.interface import number_in_volume, volumes_of
from agglom_mpi.storage.access import open_file, with_path
from agglom_mpi.storage.rows import same_type
from agglom_mpi.storage.schema import (
    fresh_from,
    fresh_room,
    sample_dtype,
    volume_table,
    volumes_of_file,
)
from agglom_mpi.storage.table import Table, checksum_ok, rows_at, runs_of

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
    room
        Number of strings, and of samples of each, by the columns of the table that give a row's
        place: `string`, and `sample` if there is one.
    dtype
        Of a row.
    """

    def __init__(self, room: Mapping[str, int], dtype: np.dtype = sample_dtype) -> None:
        self._room = room
        self._dtype = dtype
        self.clear()

    def clear(self) -> None:
        """Remove all rows."""
        self._waiting: list[bytes] = []
        self._count = 0
        self._since = 0.0

    @property
    def count(self) -> int:
        """Number of rows in the buffer."""
        return self._count

    @property
    def full(self) -> bool:
        """Whether the buffer has reached its limit."""
        return self._count >= min(FLUSH_ROWS, max(1, FLUSH_BYTES // self._dtype.itemsize))

    def due(self, now: float) -> bool:
        """Return whether the oldest row is older than `FLUSH_AGE` at `time.monotonic()` = now."""
        return self._count > 0 and now - self._since >= FLUSH_AGE

    def add(self, records: np.ndarray, now: float) -> None:
        """Add a copy of rows, (n,); raises IndexError if the table has no place for them."""
        if not len(records):
            return
        for name, room in self._room.items():
            numbers = records[name]
            # Without their sign, negative numbers are the largest.
            if numbers.view(np.uint64).max() >= room:
                wrong = next(number for number in numbers.tolist() if not 0 <= number < room)
                raise IndexError(f"{name} {wrong}: there is room for 0 to {room - 1}")
        if not self._count:
            self._since = now
        rows = records if same_type(records.dtype, self._dtype) else records.astype(self._dtype)
        self._waiting.append(rows.tobytes())
        self._count += len(records)

    def runs(self) -> Iterator[tuple[int, np.ndarray]]:
        """Yield row number and rows of each consecutive run; of rows for one place the first."""
        if not self._count:
            return
        rows = np.frombuffer(b"".join(self._waiting), self._dtype)
        numbers = [rows[name] for name in self._room]
        places = np.ravel_multi_index(numbers, tuple(self._room.values()))
        places, first = np.unique(places, return_index=True)
        ordered = rows_at(rows, first)
        ends = [*(np.flatnonzero(np.diff(places) != 1) + 1).tolist(), len(places)]
        for begin, end in pairwise([0, *ends]):
            yield int(places[begin]), ordered[begin:end]


class VolumeRows:
    """Buffered rows of the samples of one larger control volume, and their table.

    Parameters
    ----------
    file, path, direct
        As for `SampleWriter`.
    volume
        The control volume.
    """

    def __init__(self, file: h5py.File, path: Path, volume: int, *, direct: bool) -> None:
        self._volume = volume
        self._first = fresh_from(file.attrs)
        self._table = Table(file, volume_table(volume), path, direct=direct)
        room = {"string": int(file.attrs["strings"]), "sample": fresh_room(file.attrs)}
        self.buffer = RowBuffer(room, self._table.dtype)

    def add(self, records: np.ndarray) -> None:
        """Add samples in flight, (n,), whose string numbers are those of the volume."""
        rows = records.copy()
        rows["string"] -= number_in_volume(0, self._volume)
        rows["sample"] -= self._first  # numbers of places in the table, until they are written
        rows["crc"] = 0
        self.buffer.add(rows, time.monotonic())

    def flush(self) -> None:
        """Write the buffered rows that are not in the file."""
        for first, rows in self.buffer.runs():
            rows = rows.copy()
            rows["sample"] += self._first
            for begin, count in runs_of(~stored(self._table, first, len(rows))):
                self._table.write(first + begin, rows[begin : begin + count])
        self.buffer.clear()


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
        room = {"string": int(file.attrs["strings"]), "sample": int(file.attrs["max_samples"])}
        self._table = Table(file, "samples", path, direct=direct)
        self._buffer = RowBuffer(room, self._table.dtype)
        self._finals: Table | None = None
        if "final_particles" in file:
            self._finals = Table(file, "final_particles", path, direct=direct)
            self._waiting_finals = RowBuffer(room, self._finals.dtype)
        self._volumes = {
            volume: VolumeRows(file, path, volume, direct=direct)
            for volume in volumes_of_file(file.attrs)
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
            self._buffer.add(records, time.monotonic())
            full = any(buffer.full for buffer in self._buffers)
            if self._finals is not None and finals is not None:
                self._waiting_finals.add(finals, time.monotonic())
                full |= self._waiting_finals.full
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
        return [self._buffer, *(rows.buffer for rows in self._volumes.values())]

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
                for first, rows in self._waiting_finals.runs():
                    # Where a run was killed between a sample's particles and the sample.
                    if self._finals.done.read(first, len(rows)).any():
                        self._finals.mark_absent(first, len(rows))
                    self._finals.write(first, rows)
                self._waiting_finals.clear()
            for first, rows in self._buffer.runs():
                for begin, count in runs_of(~stored(self._table, first, len(rows))):
                    self._table.write(first + begin, rows[begin : begin + count], checked=True)
            self.written += self._buffer.count
            self._buffer.clear()
            for volume in self._volumes.values():
                count = volume.buffer.count
                volume.flush()
                self.written += count

    def discard(self) -> None:
        """Remove the buffered samples without writing them."""
        for buffer in self._buffers:
            buffer.clear()
        if self._finals is not None:
            self._waiting_finals.clear()


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
