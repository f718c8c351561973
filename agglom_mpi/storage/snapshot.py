"""The tables of a campaign file as they were at one time, also while it is being written."""

import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final, NamedTuple

import h5py
import numpy as np

from agglom_mpi.formatting import printable
from agglom_mpi.storage.access import open_file, report_damage
from agglom_mpi.storage.particle_tables import count_frames
from agglom_mpi.storage.rows import Rows
from agglom_mpi.storage.table import REWRITE_SECONDS, Table, checksum_ok

READ_TOGETHER: Final = ("generations", "results", "strings", "legs", "failures")
"""Tables in the order in which they are read: a row is there before those that refer to it, so no
row of a growing file is read without those that it rests on. Samples are read last, and only those
of strings that were there."""


class TableSnapshot:
    """Rows of the tables of a file: all but samples are read together, samples when needed.

    Parameters
    ----------
    path
        The file.
    sample_columns
        Columns of `/samples` to keep, in that order; None keeps all.

    Attributes
    ----------
    generation_capacity
        Generations that there is room for.
    frame_count
        Number of frames there are, of all samples.
    """

    def __init__(self, path: Path, sample_columns: Sequence[str] | None = None) -> None:
        self.generation_capacity = 0
        self.frame_count = 0
        self._path = path
        self._sample_columns = sample_columns
        self._kept: dict[str, np.ndarray] = {}
        self._damaged: dict[str, int] = {}
        self._strings_end = 0
        self._seen = np.zeros(0, np.int64)  # places in /samples of the rows that are kept

    def keep(self, tables: Mapping[str, np.ndarray]) -> None:
        """Keep rows that have been read already, by table."""
        self._kept.update(tables)

    def rows(self, table: str) -> np.ndarray:
        """Return the rows of a table, (n,), in the order of their places."""
        if table not in self._kept:
            with open_file(self._path, thorough=False) as file, report_damage(self._path):
                if not self._kept:
                    self._read_tables(file)
                if table == "samples":
                    self._read_samples(file)
                elif table not in self._kept:
                    self._read_whole(file, table)
        return self._kept[table]

    def refresh(self) -> None:
        """Read the tables again; of `/samples`, if they have been read, only rows that are new."""
        with open_file(self._path, thorough=False) as file, report_damage(self._path):
            others = self._kept.keys() - {"samples", "status", "variables", *READ_TOGETHER}
            self._read_tables(file)
            if self.has_samples:
                self._read_samples(file)
            for table in others:
                self._read_whole(file, table)

    @property
    def has_samples(self) -> bool:
        """Whether samples have been read."""
        return "samples" in self._kept

    @property
    def damaged(self) -> int:
        """Number of rows read that are marked final but have a wrong checksum."""
        return sum(self._damaged.values())

    def _read_tables(self, file: h5py.File) -> None:
        """Read all tables but `/samples`, the status before the rows that it describes."""
        status = read_status(file, self._path)
        for name in READ_TOGETHER:
            if name == "strings":
                self._strings_end = Table(file, name, self._path).end()
            self._read_whole(file, name)
        self.generation_capacity = len(file["generations"])
        self.frame_count = count_frames(file, self._path)
        self._kept["variables"] = read_only(Rows(file["variables"], self._path).read_all())
        self._kept["status"] = read_only(status)
        self._damaged["status"] = int((~checksum_ok(status)).sum())

    def _read_whole(self, file: h5py.File, name: str) -> None:
        """Read all rows of a table."""
        found = Table(file, name, self._path).read()
        self._kept[name], self._damaged[name] = read_only(found.rows), len(found.damaged)

    def _read_samples(self, file: h5py.File) -> None:
        """Read the samples that are not kept yet, of strings that are."""
        table, each = Table(file, "samples", self._path), int(file.attrs["max_samples"])
        before, final = self._seen, table.done.nonzero(0, self._strings_end * each)
        found = table.read_places(np.setdiff1d(final, before, assume_unique=True))
        rows = self._with_columns(found.rows)
        if self.has_samples:
            rows = np.insert(self._kept["samples"], np.searchsorted(before, found.places), rows)
        self._kept["samples"], self._damaged["samples"] = read_only(rows), len(found.damaged)
        self._seen = np.sort(np.concatenate([before, found.places]))

    def _with_columns(self, rows: np.ndarray) -> np.ndarray:
        """Return rows of `/samples` with the columns to keep alone."""
        if self._sample_columns is None:
            return rows
        kept = np.empty(len(rows), [(name, rows.dtype[name]) for name in self._sample_columns])
        for name in self._sample_columns:
            kept[name] = rows[name]
        return kept


def read_only(rows: np.ndarray) -> np.ndarray:
    """Return the same rows, which cannot be written any more."""
    rows.flags.writeable = False
    return rows


class Status(NamedTuple):
    """State of a campaign, time of the last change (Unix, s), and the reason."""

    state: str
    updated: float
    reason: str


def status_of(rows: np.ndarray) -> Status:
    """Return the row of `/status`, (1,), as text and numbers."""
    [row] = rows
    state, reason = (printable(row[n].decode(errors="replace")) for n in ("state", "reason"))
    return Status(state, float(row["updated"]), reason)


def read_status(file: h5py.File, path: Path) -> np.ndarray:
    """Return the row of `/status`, (1,), once a run that may be rewriting it has done so."""
    rows = Rows(file["status"], path)
    status = rows.read_all()
    if not checksum_ok(status).all():
        time.sleep(REWRITE_SECONDS)
        status = rows.read_all()
    return status
