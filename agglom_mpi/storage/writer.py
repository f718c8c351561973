"""Writing a campaign file: raw data in rows laid out beforehand, no metadata."""

import os
import time
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import h5py
import numpy as np
from numpy.typing import ArrayLike

from agglom_mpi.storage.access import NotACampaign, open_file, with_path
from agglom_mpi.storage.fingerprint import AlteredFileError, Fingerprint, redirect_writes
from agglom_mpi.storage.particle_tables import valid_frame_keys
from agglom_mpi.storage.rows import Rows
from agglom_mpi.storage.sample_writer import RowBuffer, SampleWriter, WriteClock, sync_descriptor
from agglom_mpi.storage.schema import CAMPAIGN_STATES, TOOK_TOO_LONG, VERSIONS
from agglom_mpi.storage.table import Table, fitted, make_row
from agglom_mpi.variables import NAMES

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
        self._open(open_file(self.path, write=True))

    def _open(self, file: h5py.File) -> None:
        self._file = file
        self._fingerprint = Fingerprint(file, self.path, self._descriptor)
        self.samples = SampleWriter(file, self.path, self.clock, self._check_file)
        self._tables = {
            name: Table(file, name, self.path)
            for name in ("strings", "results", "failures", "generations", "legs")
        }
        results = self._tables["results"]
        self._results = RowBuffer({"string": results.capacity}, results.dtype)
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
            Place in the generation, and index in `schema.ORIGINS`.
        parents : (n, 2) int
            Numbers of the parents, -1 for none.
        parameters : (n, 10) float64
            The strings, SI units, in the order of `variables.VARIABLES`.
        """
        values = np.asarray(parameters, dtype=float)
        rows = np.zeros(len(values), self._tables["strings"].dtype)
        rows["string"] = first_id + np.arange(len(values))
        rows["generation"], rows["slot"] = generation, slots
        rows["origin"], rows["parents"] = origins, parents
        for column, name in enumerate(NAMES):
            rows[name] = values[:, column]
        self._check_file()
        with self.clock:
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

    def put_frames(self, first: int, rows: np.ndarray) -> None:
        """Write frames, (n,) rows of `/frames` without `crc`, in place of those there are."""
        self._check_file()
        with self.clock:
            table = Table(self._file, "frames", self.path)
            table.mark_absent(first, len(rows))
            table.write(first, rows)

    def frame_keys(self) -> dict[int, tuple[int, int, int]]:
        """Return (string, sample, frame) of the frames there are, by row."""
        return valid_frame_keys(self._file, self.path)

    @property
    def frame_count(self) -> int:
        """Number of frames there are."""
        return (
            len(Rows(self._file["frames_done"], self.path).nonzero())
            if "frames" in self._file
            else 0
        )

    def forget_frames(self) -> None:
        """Make all frames absent."""
        self._check_file()
        with self.clock:
            table = Table(self._file, "frames", self.path)
            table.mark_absent(0, table.capacity)

    def put_result(self, row: np.ndarray) -> None:
        """Buffer the result of a string, a row of `/results`, (1,), without `crc`."""
        self._tables["results"].rows.check(int(row["string"][0]), 1)
        self._results.add(row, time.monotonic())

    @property
    def has_room_for_failures(self) -> bool:
        """Whether the next failure overwrites none."""
        table = self._tables["failures"]
        return table.end() < table.capacity

    def put_failure(self, string: int, sample: int, *, rank: int, host: str, text: str) -> bool:
        """Write the exception of a failed sample, of a long text the end, which names the error.

        Where the table is full the last row is overwritten, unless it is of a sample that took too
        long: nothing else tells of such a one. Return whether this one was written.
        """
        table = self._tables["failures"]
        place = table.append_place()
        if any(row["text"].startswith(TOOK_TOO_LONG.encode()) for row in table.read(place, 1).rows):
            return False
        end = text.encode()[-table.dtype["text"].itemsize :].decode(errors="ignore")
        self._put("failures", place, string=string, sample=sample, rank=rank, host=host, text=end)
        return True

    def put_generation(
        self,
        generation: int,
        *,
        best_string: int,
        best_objective: float,
        best_standard_error: float,
        mean_of_top: float,
        top: int,
        evaluations: int,
        samples_used: int,
        samples_simulated: int,
        seconds: float,
        population: ArrayLike,
        digest: int,
    ) -> None:
        """Write the state of the search after a generation, after all that is buffered.

        The columns are those of `/generations`: `population`, (population,), has string numbers,
        the best first; `seconds` are summed over legs; `digest` is from `generation_digest`.
        """
        self.flush()
        self._put(
            "generations",
            generation,
            generation=generation,
            best_string=best_string,
            best_objective=best_objective,
            best_standard_error=best_standard_error,
            mean_of_top=mean_of_top,
            top=top,
            evaluations=evaluations,
            samples_used=samples_used,
            samples_simulated=samples_simulated,
            seconds=seconds,
            population=population,
            digest=digest,
        )

    def begin_leg(
        self,
        *,
        started: float,
        ranks: int,
        nodes: int,
        database: str,
        host: str,
        processor: str,
        code_version: str,
        sources_sha256: str,
        git_revision: str,
        versions: Mapping[str, str],
    ) -> int:
        """Write a start of the program; return the number of this leg.

        Parameters
        ----------
        started : float
            Unix time, s.
        ranks, nodes : int
            MPI ranks, and the machines that they are on.
        database : str
            Who writes samples: `gathered` or `parallel`.
        host, processor : str
            Machine of rank 0, and its kind of processor.
        versions : mapping
            Library versions by the names of `schema.VERSIONS`; those left out stay empty.
        """
        index = self._tables["legs"].append_place()
        self._put(
            "legs",
            index,
            started=started,
            stopped=np.nan,
            ranks=ranks,
            nodes=nodes,
            database=database,
            exit_code=-1,
            host=host,
            processor=processor,
            code_version=code_version,
            sources_sha256=sources_sha256,
            git_revision=git_revision,
            **{name: versions.get(name, "") for name in VERSIONS},
        )
        return index

    def end_leg(
        self,
        index: int,
        *,
        stopped: float,
        exit_code: int,
        samples: int,
        busy_seconds: float,
        cpu_seconds: float,
        database_seconds: float,
    ) -> None:
        """Write the end of a leg.

        `stopped` is Unix time, s; `busy_seconds`, wall-clock time, and `cpu_seconds` are summed
        over samples, `database_seconds` over ranks. A file of format version 1 or 2 has no
        `cpu_seconds`.
        """
        legs = self._tables["legs"]
        row = fitted(legs.rows.read(index, 1), legs.dtype)
        row["stopped"], row["exit_code"] = stopped, exit_code
        row["samples"], row["database_seconds"] = samples, database_seconds
        row["busy_seconds"], row["cpu_seconds"] = busy_seconds, cpu_seconds
        self._check_file()
        with self.clock:
            legs.write(index, row)

    def set_status(self, state: str, reason: str = "") -> None:
        """Write what the campaign is doing, one of `CAMPAIGN_STATES`, and why."""
        if state not in CAMPAIGN_STATES:
            raise ValueError(f"state {state!r} is none of {', '.join(CAMPAIGN_STATES)}")
        self._check_file()
        self._write_status(state, reason)

    def _write_status(self, state: str, reason: str) -> None:
        row = make_row(self._status.dtype, state=state, updated=time.time(), reason=reason)
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

    def _put(self, table: str, number: int, **fields: Any) -> None:
        rows = self._tables[table]
        self._check_file()
        with self.clock:
            rows.write(number, make_row(rows.dtype, **fields))
