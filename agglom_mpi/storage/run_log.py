"""Writing what happened while a campaign ran: starts of the program, and samples that failed."""

from collections.abc import Callable
from contextlib import AbstractContextManager
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from agglom_mpi.storage.schema import TOOK_TOO_LONG
from agglom_mpi.storage.table import Table, fitted, make_row


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

    def begin_leg(self, **columns: Any) -> int:
        """Write a start of the program by its columns of `/legs`; return the number of this leg."""
        index = self._legs.append_place()
        row = make_row(self._legs.dtype, stopped=np.nan, exit_code=-1, **columns)
        with self._writing():
            self._legs.write(index, row)
        return index

    def end_leg(self, index: int, **columns: Any) -> None:
        """Write the end of a leg by its columns; files of versions 1 and 2 lack `cpu_seconds`."""
        row = fitted(self._legs.rows.read(index, 1), self._legs.dtype)
        for name, value in columns.items():
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
