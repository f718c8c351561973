"""What a campaign file holds now, of which each look reads little more than what is new."""

from typing import Final

import numpy as np

from agglom_mpi.storage.access import open_file
from agglom_mpi.storage.reader import CampaignData
from agglom_mpi.storage.table import Table, checksum_ok, concatenated, runs_of

KEPT: Final = ("string", "sample", "state", "seconds", "finished")
"""Columns of `/samples` that are kept."""


class News:
    """The tables of a campaign file as of the last look.

    Attributes
    ----------
    status
        What the campaign was doing when the look began: what that says was in the file by then.
    samples
        (n,) with the columns `KEPT`, as float64, in order of being found.
    strings, results, generations, legs, failures
        Rows as they are stored.
    pictures
        Final rows of `/frames`.
    room
        Most generations that there is room for.
    """

    def __init__(self, file: CampaignData) -> None:
        self._file = file
        self._seen = np.zeros(0, bool)
        self.samples = np.zeros(0, np.dtype([(name, "f8") for name in KEPT]))
        self.look()

    def look(self) -> None:
        """Read what is new."""
        file = self._file
        self.status = file.status()
        with open_file(file.path, thorough=False) as opened:
            names = ("generations", "results", "strings", "legs", "failures")
            tables = {name: Table(opened, name, file.path) for name in names}
            self.room = tables["generations"].capacity
            self.generations, self.results, self.strings, self.legs, self.failures = (
                table.read().rows for table in tables.values()
            )
            self.pictures = 0
            if "frames" in opened:
                frames = Table(opened, "frames", file.path)
                self.pictures = int(np.count_nonzero(frames.done.read_all()))
            self._look_at_samples(Table(opened, "samples", file.path), tables["strings"].end())

    def _look_at_samples(self, table: Table, strings: int) -> None:
        done = table.done.read(0, strings * self._file.max_samples) != 0
        new = done.copy()
        new[: len(self._seen)] &= ~self._seen[: len(new)]
        found = concatenated([table.rows.read(*run) for run in runs_of(new)], table.rows.dtype)
        kept = np.empty(len(found), self.samples.dtype)
        for name in KEPT:
            kept[name] = found[name]
        self._seen = done
        self.samples = np.concatenate([self.samples, kept[checksum_ok(found)]])
