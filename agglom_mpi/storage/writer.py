"""Writing a campaign file: raw data in rows laid out beforehand, no metadata."""

import os
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import h5py
import numpy as np
from numpy.typing import ArrayLike

from agglom_mpi.storage.access import NotACampaign, open_file, with_path
from agglom_mpi.storage.files import AlteredFileError, Fingerprint, redirect_writes
from agglom_mpi.storage.particle_tables import FrameWriter
from agglom_mpi.storage.row_buffer import RowBuffer, SampleWriter, WriteClock, sync_descriptor
from agglom_mpi.storage.rows import Rows
from agglom_mpi.storage.schema import CAMPAIGN_STATES, TOOK_TOO_LONG, variable_names
from agglom_mpi.storage.table import Table, fitted, make_row, sealed

if TYPE_CHECKING:
    from mpi4py.MPI import Intracomm


class CampaignWriter:
    """Writer of a campaign file; the caller holds its `CampaignLock`.

    It is the only one, until `reopen_parallel` lets other ranks write their own samples.

    Samples and results are buffered until `flush`. All else is in the file, visible to readers and
    safe from a kill of the process, when its `put_` returns. Only `sync` guards against a
    crash of the machine. Failed writes raise OSError with the path, and can be repeated;
    numbers beyond the room in the file raise IndexError. Before each write the file is compared
    with what it was: an AlteredFileError means that another program has truncated or overwritten
    it.

    Attributes
    ----------
    clock
        Time spent on writing, s.
    samples
        Writer of samples.
    frames
        Writer of frames.
    log
        Writer of starts of the program and of failed samples.
    parallel
        Whether other ranks have the file open, too.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.path = Path(os.path.realpath(path))
        self.clock = WriteClock()
        self.parallel = False
        self._running = self._closed = self._altered = False
        self._written_status: bytes | None = None
        self._descriptor = os.open(self.path, os.O_RDONLY)
        file = open_file(self.path, write=True)
        file.flush()  # HDF5 cuts off now what others have appended, not during the run
        self._open(file)

    def _open(self, file: h5py.File) -> None:
        self._file = file
        self._fingerprint = Fingerprint(file, self.path, self._descriptor)
        alone = not self.parallel
        self.samples = SampleWriter(file, self.path, self.clock, self._check_file, direct=alone)
        self._tables = {
            name: Table(file, name, self.path, direct=alone)
            for name in ("strings", "results", "generations")
        }
        self.frames = FrameWriter(file, self.path, self._writing)
        self.log = RunLog(file, self.path, self._writing)
        results = self._tables["results"]
        self._results = RowBuffer(results, {"string": results.capacity})
        self._status = Rows(file["status"], self.path)

    def reopen_parallel(self, world: "Intracomm") -> None:
        """Close the file, and open it together with the `RankWriter` of all other ranks.

        From then on closing is collective.

        Raises
        ------
        OSError
            If some rank cannot open it.
        """
        self.flush()
        self._file.close()
        self.parallel = True
        try:
            self._open(open_file(self.path, write=True, thorough=False, world=world))
        except (OSError, NotACampaign) as error:  # it was open a moment ago
            reason = str(error.__cause__ or error)
            raise OSError(
                f"{self.path}: cannot be opened by all ranks together ({reason}); "
                "--database gathered lets rank 0 write for all"
            ) from error

    def put_strings(
        self,
        first_id: int,
        generation: ArrayLike,
        slots: ArrayLike,
        origins: ArrayLike,
        parents: ArrayLike,
        parameters: ArrayLike,
    ) -> None:
        """Store n consecutive strings from `first_id` on, before their samples are dispatched.

        Parameters
        ----------
        generation : int or (n,)
            Generation that they are proposed for.
        slots, origins : (n,) int
            Place in the generation, and index in `search.proposals.ORIGINS`.
        parents : (n, 2) int
            Numbers of the parents, -1 for none.
        parameters : (n, k) float64
            The strings, SI units, in the order of the campaign's variables.
        """
        values = np.asarray(parameters, dtype=float)
        rows = np.zeros(len(values), self._tables["strings"].dtype)
        rows["string"] = first_id + np.arange(len(values))
        rows["generation"], rows["slot"] = generation, slots
        rows["origin"], rows["parents"] = origins, parents
        for column, name in enumerate(variable_names(rows.dtype)):
            rows[name] = values[:, column]
        with self._writing():
            self._tables["strings"].write(first_id, rows)

    def flush_due(self, now: float | None = None) -> bool:
        """Flush if a row is older than `FLUSH_AGE` at `time.monotonic()` = now; return if so."""
        now = time.monotonic() if now is None else now
        due = self.samples.due(now) or self._results.due(now)
        if due:
            self.flush()
        return due

    def flush(self) -> None:
        """Write the buffered samples, and then the results."""
        self.samples.flush()
        with self.clock:
            for first, rows in self._results.runs():
                self._tables["results"].write(first, rows)
        self._results.clear()

    def put_samples(self, records: np.ndarray, finals: np.ndarray | None = None) -> None:
        """Buffer samples; see `SampleWriter.put`."""
        self.samples.put(records, finals)

    def put_result(self, row: np.ndarray) -> None:
        """Buffer the result of a string, a row of `/results`, (1,), without `crc`."""
        self._tables["results"].rows.check(int(row["string"][0]), 1)
        self._results.add(row)

    def put_generation(self, generation: int, **columns: Any) -> None:
        """Write a row of `/generations` by its columns, after all that is buffered."""
        self.flush()
        table = self._tables["generations"]
        with self._writing():
            table.write(generation, make_row(table.dtype, generation=generation, **columns))

    def set_status(self, state: str, reason: str = "") -> None:
        """Write what the campaign is doing, one of `CAMPAIGN_STATES`, and why."""
        if state not in CAMPAIGN_STATES:
            raise ValueError(f"state {state!r} is none of {', '.join(CAMPAIGN_STATES)}")
        self._check_file()
        self._write_status(state, reason)

    def _write_status(self, state: str, reason: str) -> None:
        row = make_row(self._status.dtype, state=state, updated=time.time(), reason=reason)
        row = sealed(row)
        with self.clock:
            self._status.write(0, row)
        self._written_status = row.tobytes()
        self._running = state == "running"

    def mark_running(self) -> None:
        """Set the status to running, unless that was done last."""
        if not self._running:
            self.set_status("running")

    def sync(self) -> None:
        """Flush, and wait until everything is on the disk."""
        self.flush()
        with self.clock:
            sync_descriptor(self._descriptor, self.path)

    @contextmanager
    def _writing(self) -> Iterator[None]:
        """Check the file, and measure the time that writing to it takes."""
        self._check_file()
        with self.clock:
            yield

    def _check_file(self) -> None:
        """Raise an OSError if the file is no longer in its place, or was altered by others.

        Once it was altered, nothing raises any more: what is written goes nowhere.
        """
        if self._altered:
            return
        try:
            with self.clock:
                self._fingerprint.check(self._written_status)
        except AlteredFileError:
            self._altered = True
            if not self.parallel:  # or all ranks are ended by force
                redirect_writes(self._file)
            raise

    def abandon(self, reason: str) -> None:
        """After a failed write: drop what is buffered, set the status if possible, and close."""
        self.samples.discard()
        self._results.clear()
        if not (self._altered and self.parallel):
            with suppress(OSError, RuntimeError, ValueError):  # or the file is no longer open
                self._write_status("failed", reason)
        if not self.parallel:
            with suppress(OSError):
                self.close()

    def close(self) -> None:
        """Flush and close, unless that has been tried; raises OSError with the path."""
        if self._closed:
            return
        self._closed = True
        try:
            with self._file:
                self.flush()
        except RuntimeError as error:  # HDF5 writes its first block once more
            raise with_path(error, self.path) from error
        finally:
            os.close(self._descriptor)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: object,
        error: BaseException | None,
        trace: object,
    ) -> None:
        # After an error the others would not join in closing: who catches it aborts the job.
        if error is None or not self.parallel:
            self.close()


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
