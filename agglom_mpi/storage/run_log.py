"""Writing what happened while a campaign ran: starts of the program, and samples that failed."""

from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager
from pathlib import Path
from typing import NamedTuple

import h5py
import numpy as np

from agglom_mpi.storage.schema import TOOK_TOO_LONG, VERSIONS
from agglom_mpi.storage.table import Table, fitted, make_row


class LegStart(NamedTuple):
    """Columns of `/legs` that are known when the program starts.

    Attributes
    ----------
    started
        Unix time, s.
    ranks, nodes
        MPI ranks, and the machines that they are on.
    database
        Who writes samples: `gathered` or `parallel`.
    host, processor
        Machine of rank 0, and its kind of processor.
    versions
        Library versions by the names of `schema.VERSIONS`; those left out stay empty.
    """

    started: float
    ranks: int
    nodes: int
    database: str
    host: str
    processor: str
    code_version: str
    sources_sha256: str
    git_revision: str
    versions: Mapping[str, str]


class LegEnd(NamedTuple):
    """Columns of `/legs` that are known when the program stops.

    Attributes
    ----------
    stopped
        Unix time, s.
    samples
        Samples simulated.
    busy_seconds, cpu_seconds
        Wall-clock and processor time, s, summed over samples. A file of format version 1 or 2 has
        no `cpu_seconds`.
    database_seconds
        Time spent on writing, s, summed over ranks.
    """

    stopped: float
    exit_code: int
    samples: int
    busy_seconds: float
    cpu_seconds: float
    database_seconds: float


class RunLog:
    """Writer of `/legs` and `/failures`; a row is in the file when a method returns.

    Parameters
    ----------
    file
        The campaign file, open for writing.
    path
        Its name.
    writing
        Returns a context in which rows may be written.
    """

    def __init__(
        self, file: h5py.File, path: Path, writing: Callable[[], AbstractContextManager[None]]
    ) -> None:
        self._writing = writing
        self._legs = Table(file, "legs", path)
        self._failures = Table(file, "failures", path)

    def begin_leg(self, start: LegStart) -> int:
        """Write a start of the program; return the number of this leg."""
        columns = start._asdict()
        versions = columns.pop("versions")
        columns |= {name: versions.get(name, "") for name in VERSIONS}
        index = self._legs.append_place()
        row = make_row(self._legs.dtype, stopped=np.nan, exit_code=-1, **columns)
        with self._writing():
            self._legs.write(index, row)
        return index

    def end_leg(self, index: int, end: LegEnd) -> None:
        """Write the end of a leg."""
        row = fitted(self._legs.rows.read(index, 1), self._legs.dtype)
        for name, value in end._asdict().items():
            row[name] = value
        with self._writing():
            self._legs.write(index, row)

    @property
    def has_room_for_failures(self) -> bool:
        """Whether the next failure overwrites none."""
        return self._failures.end() < self._failures.capacity

    def put_failure(self, string: int, sample: int, *, rank: int, host: str, text: str) -> bool:
        """Write the exception of a failed sample, of a long text the end, which names the error.

        Where the table is full the last row is overwritten, unless it is of a sample that took too
        long: nothing else records such a sample. Return whether this one was written.
        """
        table = self._failures
        place = table.append_place()
        if any(row["text"].startswith(TOOK_TOO_LONG.encode()) for row in table.read(place, 1).rows):
            return False
        end = text.encode()[-table.dtype["text"].itemsize :].decode(errors="ignore")
        row = make_row(table.dtype, string=string, sample=sample, rank=rank, host=host, text=end)
        with self._writing():
            table.write(place, row)
        return True
