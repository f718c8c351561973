"""Samples into a campaign file: the one table that every rank may write to."""

import os
import time
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING

import h5py
import numpy as np
from numpy.typing import NDArray

from agglom_mpi.database.access import located, open_file
from agglom_mpi.database.buffer import RowBuffer
from agglom_mpi.database.stopwatch import Stopwatch
from agglom_mpi.database.table import Table, are_whole, unbroken

if TYPE_CHECKING:
    from mpi4py.MPI import Intracomm


class SampleWriter:
    """Writes samples in runs of consecutive rows; they are visible to readers after `flush`.

    Parameters
    ----------
    file
        The campaign file, open for writing.
    path
        Its name.
    clock
        Runs while rows are written.

    Attributes
    ----------
    written
        Rows written so far.
    """

    def __init__(self, file: h5py.File, path: Path, clock: Stopwatch) -> None:
        self.written = 0
        self._clock = clock
        room = {"string": int(file.attrs["strings"]), "sample": int(file.attrs["max_samples"])}
        self._table = Table(file, "samples", path)
        self._buffer = RowBuffer(room)
        self._finals: Table | None = None
        if "final_particles" in file:
            self._finals = Table(file, "final_particles", path)
            self._waiting_finals = RowBuffer(room, self._finals.rows.dtype)

    def put(self, records: np.ndarray, finals: np.ndarray | None = None) -> None:
        """Take rows, (n,) of `sample_dtype` without `crc`; they wait for `flush`.

        With them come their rows of `/final_particles`, if the file has that table. Of rows for
        the same sample that wait together, the first is kept. Flushes by itself when many wait.
        """
        with self._clock:
            self._buffer.add(records, time.monotonic())
            full = self._buffer.full
            if self._finals is not None and finals is not None:
                self._waiting_finals.add(finals, time.monotonic())
                full |= self._waiting_finals.full
        if full:
            self.flush()

    def due(self, now: float) -> bool:
        """Whether a sample has waited for long at `time.monotonic()` = now."""
        return self._buffer.due(now)

    def flush_due(self) -> None:
        """Flush if a sample has waited for long."""
        if self.due(time.monotonic()):
            self.flush()

    def flush(self) -> None:
        """Write the samples that wait; consecutive ones in one go, their particles before them."""
        with self._clock:
            if self._finals is not None:
                for first, rows in self._waiting_finals.runs():
                    # Where a run was killed between a sample's particles and the sample.
                    if self._finals.done.read(first, len(rows)).any():
                        self._finals.forget(first, len(rows))
                    self._finals.write(first, rows)
                self._waiting_finals.clear()
            for first, rows in self._buffer.runs():
                for begin, count in unbroken(~self._stored(first, len(rows))):
                    self._table.write(first + begin, rows[begin : begin + count])
        self.written += self._buffer.count
        self._buffer.clear()

    def _stored(self, first: int, count: int) -> NDArray[np.bool_]:
        """Which of these rows are in the file; two ranks may have been given the same sample."""
        stored = self._table.done.read(first, count) != 0
        if stored.any():
            stored &= are_whole(self._table.rows.read(first, count))
        return stored

    def forget(self) -> None:
        """Drop the samples that wait: writing has failed."""
        self._buffer.clear()
        if self._finals is not None:
            self._waiting_finals.clear()


class RankFile:
    """A campaign file as a rank other than 0 has it: open with all ranks, for samples.

    Opening and closing are collective. Between the two there is no call that waits for another
    rank: rows are raw data, and a plain descriptor puts them on the disc.

    Parameters
    ----------
    path
        The file, laid out already.
    world
        All ranks.
    syncs
        Whether `sync` is this rank's to do: one of a node does it for all.
    """

    def __init__(self, path: Path, world: "Intracomm", *, syncs: bool) -> None:
        self.clock = Stopwatch()
        self._path = path
        self._file = open_file(path, write=True, thorough=False, world=world)
        self._descriptor = os.open(path, os.O_RDONLY) if syncs else None
        self.samples = SampleWriter(self._file, path, self.clock)

    def sync(self) -> None:
        """Wait until everything that ranks of this node have flushed is on the disc."""
        if self._descriptor is not None:
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
    """Wait until a file is on the disc; raises OSError with its path."""
    try:
        os.fsync(descriptor)
    except OSError as error:
        raise located(error, path) from error
