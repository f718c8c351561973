"""Reading a campaign file, finished or not, also while it is being written."""

import os
import socket
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple, Self, TypeVar

import numpy as np

from agglom_mpi.formatting import printable, shortened
from agglom_mpi.scheduling.interface import number_in_volume
from agglom_mpi.search.proposals import ORIGINS, Proposals, restored
from agglom_mpi.storage.access import NotACampaign, open_file, read_attributes, report_damage
from agglom_mpi.storage.header import Allowed, CampaignHeader, altered_parts
from agglom_mpi.storage.lock import is_locked
from agglom_mpi.storage.particle_tables import StoredParticles
from agglom_mpi.storage.rows import Rows
from agglom_mpi.storage.schema import INVERSION, TOOK_TOO_LONG, parameters_of, volume_table
from agglom_mpi.storage.snapshot import REWRITE_SECONDS, TableSnapshot, read_only
from agglom_mpi.storage.table import Table

__all__ = ["CampaignData", "NotACampaign", "Status", "read_campaign", "read_inversion"]

T = TypeVar("T")


class Status(NamedTuple):
    """State of a campaign, time of the last change (Unix, s), and the reason."""

    state: str
    updated: float
    reason: str


KILLED: Final = "the run was killed: no process holds the file"
"""Reason of the state of a run that could not write one."""

UNUSED_NOTE: Final = (
    "samples that ran ahead unused are counted, too, so results depend on the number of ranks and "
    "on timing"
)
"""Note on what is computed of a file that was opened `with_unused`."""


class CampaignData(CampaignHeader):
    """The rows of a campaign file as they were when they were first asked for, or refreshed.

    Nothing is read before it is needed: all tables but `/samples` together at the first use of one,
    samples at theirs, and particles at each call. A row counts only if it is final and its checksum
    is right. Arrays are structured and read-only, with the columns in `schema`.

    Parameters
    ----------
    path
        The file.
    attributes
        Its attributes.
    sample_columns
        Columns of `/samples` to keep, in that order; all by default. They need `string` and
        `sample`.
    allow_code
        As for `CampaignHeader`.

    Attributes
    ----------
    with_unused
        Whether analyses count samples that ran ahead unused, too: how many there are depends on the
        number of ranks and on timing, and so do the results. False until it is set.
    particles
        Reads particles of samples.
    """

    def __init__(
        self,
        path: Path,
        attributes: dict[str, Any],
        sample_columns: Sequence[str] | None = None,
        allow_code: Allowed = False,
    ) -> None:
        super().__init__(path, attributes, allow_code)
        self.with_unused = False
        self._snapshot = TableSnapshot(path, sample_columns)
        self._derived: dict[Callable[..., Any], Any] = {}
        self.particles = StoredParticles(path, lambda: self.has_temperature)

    @classmethod
    def of_rows(
        cls,
        path: Path,
        attributes: dict[str, Any],
        tables: Mapping[str, np.ndarray],
        allow_code: Allowed = False,
    ) -> Self:
        """Return data of rows that have been read already, by table."""
        data = cls(path, attributes, allow_code=allow_code)
        data._snapshot.keep(tables)
        return data

    def rows(self, table: str) -> np.ndarray:
        """Return the rows of a table, (n,), in the order of their places."""
        return self._snapshot.rows(table)

    def refresh(self) -> None:
        """Read the tables that have been read again; of `/samples` only rows that are new."""
        self._derived.clear()
        self._snapshot.refresh()

    def derived(self, compute: Callable[["CampaignData"], T]) -> T:
        """Return `compute(self)`, which is computed once for the rows as they are."""
        if compute not in self._derived:
            self._derived[compute] = compute(self)
        value: T = self._derived[compute]
        return value

    @property
    def generation_capacity(self) -> int:
        """Generations that there is room for."""
        self.rows("generations")
        return self._snapshot.generation_capacity

    # Rows

    def status(self) -> Status:
        """Return the state of the campaign at the time of the snapshot; it is read first."""
        return status_of(self.rows("status"))

    def live_status(self) -> Status:
        """Return the state of the campaign; `stopped` if the run was killed, as its lock shows.

        With `--database parallel` MPI may need the lock, and another machine may not see it.
        """
        status, legs = self.status(), self.legs()
        if status.state != "running" or not len(legs) or legs[-1]["database"] != b"gathered":
            return status
        # A run that ends just now writes its status first, and one that begins takes the lock.
        if is_locked(self.path):
            return status
        with open_file(self.path, thorough=False) as file:
            now = status_of(Rows(file["status"], self.path).read_all())
        if now.state != "running" or is_locked(self.path):
            return status
        if legs[-1]["host"].decode() == (here := socket.gethostname())[:64]:
            return now._replace(state="stopped", reason=KILLED)
        return now._replace(reason=f"no lock is seen on {here}: the run may have been killed")

    def variable_rows(self) -> np.ndarray:
        """Return the variables and their box, (k,); nan bounds where one is unused."""
        return self.rows("variables")

    @property
    def has_temperature(self) -> bool:
        """Whether grains have a temperature; where no law needs one, rows hold 0 K."""
        return not np.isnan(self.variable_rows()["lower"][self.variables.index("temperature")])

    def string_rows(self) -> np.ndarray:
        """Return the strings stored so far, by number."""
        return self.rows("strings")

    def result_rows(self) -> np.ndarray:
        """Return the results of strings so far, by string."""
        return self.rows("results")

    def generation_rows(self) -> np.ndarray:
        """Return the generations so far, in order."""
        return self.rows("generations")

    def legs(self) -> np.ndarray:
        """Return the starts of the program, in order."""
        return self.rows("legs")

    def failures(self) -> np.ndarray:
        """Return the exceptions of failed samples, in order of arrival."""
        return self.rows("failures")

    def all_sample_rows(self) -> np.ndarray:
        """Return all samples so far, by string and number; holes are skipped."""
        return self.rows("samples")

    def sample_rows(self, string: int) -> np.ndarray:
        """Return the samples of one string, by number; they alone are read if none have been."""
        if self._snapshot.has_samples:
            rows = self.rows("samples")
            return rows[slice(*np.searchsorted(rows["string"], [string, string + 1]))]
        with open_file(self.path, thorough=False) as file:
            table = Table(file, "samples", self.path)
            return table.read(string * self.max_samples, self.max_samples).rows

    @property
    def damaged(self) -> int:
        """Number of rows that are marked final but have a wrong checksum; they count as absent."""
        self.rows("samples")
        return self._snapshot.damaged

    def settle(self) -> None:
        """Read again if a row is damaged that a run may just be rewriting, as those of `/legs`."""
        if self.damaged and self.status().state == "running":
            time.sleep(REWRITE_SECONDS)
            self.refresh()

    # Views of the rows

    @property
    def parameters(self) -> dict[int, np.ndarray]:
        """Parameter strings by number, each of shape (k,), in SI units."""
        return self.derived(_parameters_by_string)

    def values(self, strings: Sequence[int] | np.ndarray, variable: str) -> np.ndarray:
        """Return a variable of strings, (n,), in SI units; nan where a string's row is damaged."""
        column, known = self.variables.index(variable), self.parameters
        return np.array([known[int(i)][column] if int(i) in known else np.nan for i in strings])

    def restore(self, batch: Proposals, first: int) -> Proposals:
        """Return proposals, numbered from `first`, with the stored parameters where there are any.

        Computed again on another machine they might differ in the last bits.
        """
        return restored(batch, first, self.parameters)

    @property
    def samples_used(self) -> dict[int, int]:
        """Number of samples that the result of each string rests on, by string."""
        return self.derived(_samples_used_by_string)

    def are_used(self, rows: np.ndarray) -> np.ndarray:
        """Return which rows of `/samples`, (n,), a result rests on, (n,) bool."""
        used = self.samples_used
        return rows["sample"] < [used.get(string, 0) for string in rows["string"].tolist()]

    def counted(self, rows: np.ndarray) -> np.ndarray:
        """Return those of some rows of `/samples` that analyses rest on: used and fresh ones.

        All of them, `with_unused`.
        """
        fresh = rows["sample"] >= self.fresh_from
        return rows if self.with_unused else rows[fresh | self.are_used(rows)]

    @property
    def counted_samples(self) -> np.ndarray:
        """Rows of the samples that analyses rest on; see `counted`."""
        return self.derived(_counted_samples)

    @property
    def unused_notes(self) -> list[str]:
        """A line on what is counted, `with_unused`; else none."""
        return [UNUSED_NOTE] if self.with_unused else []

    @property
    def searched_samples(self) -> np.ndarray:
        """Rows of the samples that decisions may see."""
        return self.derived(_searched_samples)

    @property
    def fresh_samples(self) -> np.ndarray:
        """Rows of the samples that no decision sees."""
        rows = self.all_sample_rows()
        return rows[rows["sample"] >= self.fresh_from]

    def volume_rows(self, volume: int) -> np.ndarray:
        """Return the fresh samples of a larger control volume, by string and number.

        None if the file has no table for it.
        """
        if volume not in self.volumes:
            return self.fresh_samples[:0]
        return self.rows(volume_table(volume))

    @property
    def fresh_keys(self) -> np.ndarray:
        """String and number of all fresh samples that need no simulation, shape (n, 2).

        Those of larger volumes have the numbers of `scheduling.volume_strings`. Timed-out samples
        are among them.
        """
        keys = [_keys(self.fresh_samples, 1)]
        keys += [_keys(self.volume_rows(volume), volume) for volume in self.volumes]
        late = np.array([*self.fresh_timed_out], np.int64).reshape(-1, 2)
        return np.concatenate([*keys, late])

    @property
    def volume_count(self) -> int:
        """Number of samples of larger control volumes."""
        return sum(len(self.volume_rows(volume)) for volume in self.volumes)

    @property
    def timed_out(self) -> set[tuple[int, int]]:
        """Samples, as (string, sample), that have no row because they took too long.

        Those of larger volumes have the string numbers of `scheduling.volume_strings`.
        """
        return self.derived(_timed_out)

    @property
    def judged_timed_out(self) -> list[tuple[int, int]]:
        """Timed-out samples that results rest on, as (string, sample), in order."""
        late = self.timed_out
        used = self.samples_used if late else {}
        return sorted((string, sample) for string, sample in late if sample < used.get(string, 0))

    @property
    def fresh_timed_out(self) -> set[tuple[int, int]]:
        """Timed-out samples that are fresh, as (string, sample)."""
        return {pair for pair in self.timed_out if pair[1] >= self.fresh_from}

    @property
    def frame_count(self) -> int:
        """Number of frames there are, of all samples."""
        self.rows("status")
        return self._snapshot.frame_count


def read_campaign(path: str | os.PathLike[str], allow_code: Allowed = False) -> CampaignData:
    """Open a campaign file for reading; no rows are read yet.

    With `allow_code`, the code of components of one's own that the file has may be executed.

    Raises
    ------
    NotACampaign
        If it is something else, truncated, damaged or of a newer format version.
    OSError
        If it is missing or cannot be read.
    """
    path = Path(path)
    with open_file(path) as file, report_damage(path):
        data = CampaignData(path, read_attributes(file, path), allow_code=allow_code)
        data.note_altered(altered_parts(file))
        return data


def read_inversion(path: str | os.PathLike[str], allow_code: Allowed = False) -> CampaignData:
    """Open the file of a campaign that searched, for what only such a one has.

    `allow_code` as for `read_campaign`.

    Raises
    ------
    NotACampaign
        As from `read_campaign`, and if the strings are for something else.
    OSError
        If it is missing or cannot be read.
    """
    data = read_campaign(path, allow_code)
    purpose = data.attributes.get("purpose", INVERSION)
    if purpose != INVERSION:
        raise NotACampaign(
            f"{path}: holds the samples of an {shortened(purpose)}, not an inversion's"
        )
    return data


def status_of(rows: np.ndarray) -> Status:
    """Return the row of `/status`, (1,), as text and numbers."""
    [row] = rows
    state, reason = (printable(row[n].decode(errors="replace")) for n in ("state", "reason"))
    return Status(state, float(row["updated"]), reason)


def given_strings(strings: np.ndarray) -> np.ndarray:
    """Return those rows of `/strings` that a search was given to begin with."""
    return strings[strings["origin"] == ORIGINS.index("given")]


def _parameters_by_string(data: CampaignData) -> dict[int, np.ndarray]:
    rows = data.string_rows()
    return dict(zip(rows["string"].tolist(), parameters_of(rows), strict=True))


def _samples_used_by_string(data: CampaignData) -> dict[int, int]:
    rows = data.result_rows()
    return dict(zip(rows["string"].tolist(), rows["samples_used"].tolist(), strict=True))


def _counted_samples(data: CampaignData) -> np.ndarray:
    return read_only(data.counted(data.all_sample_rows()))


def _searched_samples(data: CampaignData) -> np.ndarray:
    rows = data.all_sample_rows()
    searched = rows["sample"] < data.fresh_from
    return rows if searched.all() else read_only(rows[searched])


def _timed_out(data: CampaignData) -> set[tuple[int, int]]:
    """Find them by the texts of failures; a later attempt may have stored a row after all."""
    failures, mark = data.failures(), TOOK_TOO_LONG.encode()
    late = np.array([text.startswith(mark) for text in failures["text"]], bool)
    if not late.any():
        return set()
    pairs = set(failures[["string", "sample"]][late].tolist())
    pairs -= set(data.all_sample_rows()[["string", "sample"]].tolist())
    for volume in data.volumes:
        pairs -= set(map(tuple, _keys(data.volume_rows(volume), volume).tolist()))
    return pairs


def _keys(rows: np.ndarray, volume: int) -> np.ndarray:
    """Return string and number of samples of a volume, (n, 2), as they are in flight."""
    return np.column_stack([rows["string"] + number_in_volume(0, volume), rows["sample"]])
