"""Structure and checksums of a campaign file: which rows are valid, which are damaged.

Rows refer to rows that were written before them. So the tables are read against the order of
writing: whatever a row refers to is then there, also while a run goes on.
"""

import os
from collections import defaultdict
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import h5py
import numpy as np

from agglom_mpi.errors import CodeNotAllowedError
from agglom_mpi.formatting import printable
from agglom_mpi.search.proposals import ORIGINS
from agglom_mpi.storage.access import (
    open_file,
    read_attributes,
    report_damage,
    tables_in_chunks,
)
from agglom_mpi.storage.attributes import altered_parts
from agglom_mpi.storage.reader import CampaignData
from agglom_mpi.storage.recorded_campaign import recorded_search
from agglom_mpi.storage.rows import Rows
from agglom_mpi.storage.schema import CAMPAIGN_STATES, LEARNED, volume_table
from agglom_mpi.storage.snapshot import read_status, status_of
from agglom_mpi.storage.table import Table, ValidRows, checksum_ok, rows_at

Key = int | tuple[int, int]
"""Number of a string, generation, leg or failure, or string and number of a sample."""

RECOMPUTED: Final = ("strings", "results", "samples", "generations", "frames", "status")
"""Tables whose lost rows a resume makes again."""
MAX_LISTED: Final = 8
"""Rows that a message lists at most."""


_READ_BYTES: Final = 1 << 25
_READ: Final = ("generations", "results", "samples", "strings", "failures", "legs")
_LOSABLE: Final = (*_READ, "final_particles", "frames", "status")


@dataclass
class VerificationReport:
    """Faults of a campaign file, and its valid rows."""

    data: CampaignData
    """The rows that are final, have the right checksum and lie in their own places."""
    lost: defaultdict[str, set[Key]] = field(
        default_factory=lambda: defaultdict(set, {name: set() for name in _LOSABLE})
    )
    """Numbers of rows, by table, that are needed but absent or damaged. To a resume they are
    absent: it makes those of `RECOMPUTED` again as far as it needs them."""
    losses: list[str] = field(default_factory=list)
    faults: list[str] = field(default_factory=list)
    """Messages: on rows that a resume makes again, and on all else."""
    counts: dict[str, int] = field(default_factory=dict)
    """Valid rows of the tables of particles, by table."""
    generations: set[int] = field(default_factory=set)
    """Generations that were final when all other tables had been read."""
    room: dict[str, int] = field(default_factory=dict)
    """Rows that there is room for, by table."""
    settled: bool = False
    """Whether no run was writing while the file was read, and the last one ended in order."""
    estimates: set[Key] = field(default_factory=set)
    """Fresh samples that a finished campaign lacks, though a resume makes them again."""

    def numbers(self, table: str) -> set[int]:
        """Return the strings or generations that a table has rows of."""
        column = "generation" if table == "generations" else "string"
        numbers = self.data.rows(table)[column]
        return set(numbers[np.diff(numbers, prepend=-1) > 0].tolist())  # they are in order

    def add_absent(self, table: str, keys: Iterable[Key], why: str) -> None:
        """Record that rows are absent which others need, unless they are known to be lost."""
        missing = set(keys) - self.lost[table]
        if missing:
            self.add_lost(table, missing, f"absent, {why}")

    @property
    def volume_tables(self) -> list[str]:
        """Names of the tables of samples of larger control volumes."""
        return [volume_table(volume) for volume in self.data.volumes]

    def add_lost(self, table: str, keys: set[Key], why: str) -> None:
        """Record that rows are lost."""
        self.lost[table] |= keys
        is_recomputed = table in RECOMPUTED or table in self.volume_tables
        messages = self.losses if is_recomputed else self.faults
        messages.append(f"{table}: {row_list(keys)} {why}")

    @property
    def ranked_by_model(self) -> bool:
        """Whether a regression proposes and ranks strings.

        It need not give the same bits on another machine, so what it gave cannot be compared. Nor
        can it where the search may be one's own, whose code may not run.
        """
        try:
            search = recorded_search(self.data)
            return search is not None and search.ranks_by_model
        except CodeNotAllowedError:
            return True
        except ValueError:  # it cannot be read, which others find
            return False

    @property
    def bred_strings(self) -> np.ndarray:
        """Rows of strings that are offspring, or parents again: their generations have begun.

        Random strings of coming generations may be stored, too, whose samples are simulated ahead.
        """
        strings = self.data.string_rows()
        bred = [ORIGINS.index(origin) for origin in ("offspring", "again")]
        by_these_data = strings["string"] >= self.data.strings_of_earlier_data
        return strings[np.isin(strings["origin"], bred) & by_these_data]

    @property
    def unused_samples(self) -> set[Key]:
        """Lost samples that no result rests on, fresh ones included."""
        used = self.data.samples_used
        pairs = (key for key in self.lost["samples"] if isinstance(key, tuple))
        lost = {pair for pair in pairs if pair not in self.estimates}
        return {pair for pair in lost if pair[1] >= used.get(pair[0], pair[1] + 1)}

    @property
    def lost_strings(self) -> set[int]:
        """Strings with a lost row that their generation rests on."""
        samples = self.lost["samples"] - self.unused_samples - self.estimates
        lost = self.lost["strings"] | self.lost["results"] | samples
        return {key[0] if isinstance(key, tuple) else key for key in lost}


def verify_rows(path: str | os.PathLike[str], allow_code: bool = False) -> VerificationReport:
    """Read everything that is final, and find out which rows are damaged.

    `allow_code` as for `CampaignData`.

    Raises
    ------
    NotACampaign
        If it is something else, or so badly damaged that no resume would open it
        (`DamagedCampaign`).
    OSError
        If it is missing or cannot be read.
    """
    path = Path(path)
    with open_file(path) as file, report_damage(path):
        return _verify(file, path, allow_code)


def _verify(file: h5py.File, path: Path, allow_code: bool) -> VerificationReport:
    attributes, status = read_attributes(file, path), read_status(file, path)
    tables: dict[str, np.ndarray] = {"status": status}
    report = VerificationReport(CampaignData.of_rows(path, attributes, tables, allow_code))
    report.room = {schema.name: len(file[schema.name]) for schema in report.data.sizes.tables()}
    learned = [LEARNED] if report.data.sizes.learned else []
    for name in (*_READ, *report.volume_tables, *learned):
        tables[name] = _valid_rows(Table(file, name, path), report)
    if learned and len(tables[LEARNED]) + len(report.lost[LEARNED]) < report.data.sizes.learned:
        report.faults.append("learned: rows are absent, on which the search rests")
    tables["variables"] = Rows(file["variables"], path).read_all()
    report.data = CampaignData.of_rows(path, attributes, tables, allow_code)
    if altered := altered_parts(file):
        report.faults.append(f"wrong checksums: {printable(', '.join(altered))}")
    if file["samples"].chunks is None and (chunked := tables_in_chunks(file)):  # no compact copy
        report.faults.append(f"layout: {chunked[0]} lies in chunks, so no run continues the file")
    if not checksum_ok(status).all():
        report.add_lost("status", {0}, "with a wrong checksum")
    check_particles(file, report)
    generations = Table(file, "generations", path)
    report.generations = set(generations.done.nonzero().tolist())
    state = report.data.status().state
    report.settled = state in ("stopped", "finished") and report.data.status() == status_of(
        Rows(file["status"], path).read_all()
    )
    if state not in CAMPAIGN_STATES:
        report.faults.append(f"status: unknown state {state!r}")
    return report


def _valid_rows(table: Table, report: VerificationReport) -> np.ndarray:
    """Return the rows of a table that have the right checksum and lie in their own places."""
    name = table.rows.name.removeprefix("/")
    places = table.done.nonzero()
    odd = places[table.done.read_places(places) != 1]
    if len(odd):
        keys = [_key(name, place, report) for place in odd.tolist()]
        report.faults.append(f"{name}_done: neither 0 nor 1 for {row_list(keys)}")
    rows, valid, damaged = table.read_places(places, patient=True)
    if len(damaged):
        lost = {_key(name, place, report) for place in damaged.tolist()}
        report.add_lost(name, lost, "with a wrong checksum")
    own = _own_places(name, rows, report)
    misplaced = (np.searchsorted(places, valid) if own is None else own) != valid
    if not misplaced.any():
        return rows
    displaced = {_key(name, place, report) for place in valid[misplaced].tolist()}
    report.lost[name] |= displaced  # a resume would trust the numbers in the row
    report.faults.append(f"{name}: numbers of another row in {row_list(displaced)}")
    return rows_at(rows, ~misplaced)


def _own_places(name: str, rows: np.ndarray, report: VerificationReport) -> np.ndarray | None:
    """Return the places where rows belong by the numbers in them; None: one after the other."""
    if name in ("strings", "results"):
        return rows["string"]
    if name == "generations":
        return rows["generation"]
    if name == "samples":
        return rows["string"] * report.data.max_samples + rows["sample"]
    if name in report.volume_tables:
        data = report.data
        own = (rows["sample"] >= data.fresh_from) & (rows["sample"] < data.max_samples)
        place = rows["string"] * data.sizes.fresh + rows["sample"] - data.fresh_from
        return np.where(own, place, -1)
    return None


def _key(name: str, place: int, report: VerificationReport) -> Key:
    data = report.data
    if name in report.volume_tables:
        string, sample = divmod(place, data.sizes.fresh)
        return string, data.fresh_from + sample
    return divmod(place, data.max_samples) if name == "samples" else place


def check_particles(file: h5py.File, report: VerificationReport) -> None:
    """Verify the rows of `/final_particles` and `/frames`: checksums, and numbers for their places.

    A final state must have as many particles as its sample states, and a frame its place among
    the frames of its sample. An absent final state is no fault: a leg need not have stored any.
    """
    if "final_particles" in file:
        rows = report.data.all_sample_rows()[["string", "sample", "particles"]].tolist()
        left = {(string, sample): particles for string, sample, particles in rows}
        _check_finals(Table(file, "final_particles", report.data.path), left, report)
    if "frames" in file:
        _check_frames(Table(file, "frames", report.data.path), report)


def _check_finals(
    table: Table, left: dict[tuple[int, int], int], report: VerificationReport
) -> None:
    damaged: set[Key] = set()
    misplaced: set[Key] = set()
    most = report.data.max_samples
    for found in _parts(table):
        damaged |= {divmod(place, most) for place in found.damaged.tolist()}
        rows = found.rows[["string", "sample", "particles"]].tolist()
        for place, (string, sample, particles) in zip(found.places.tolist(), rows, strict=True):
            key = divmod(place, most)
            if (string, sample) != key or left.get(key, particles) != particles:
                misplaced.add(key)
    _record(table, "final_particles", damaged, misplaced, report)


def _check_frames(table: Table, report: VerificationReport) -> None:
    damaged: set[Key] = set()
    stored: dict[int, tuple[int, ...]] = {}
    for found in _parts(table):
        damaged |= {*found.damaged.tolist()}
        rows = found.rows[["string", "sample", "frame"]].tolist()
        stored |= zip(found.places.tolist(), rows, strict=True)
    settled = report.data.status().state == "finished"  # before, others may be taking their places
    count = 1 + max((row[2] for row in stored.values()), default=0)
    first = {place // count: row[:2] for place, row in reversed(stored.items())}
    misplaced: set[Key] = {
        place
        for place, (string, sample, frame) in stored.items()
        if settled and (place % count != frame or first[place // count] != (string, sample))
    }
    _record(table, "frames", damaged, misplaced, report)
    all_of = {block * count + frame for block in first for frame in range(count)}
    if settled:
        report.add_absent(
            "frames", all_of - stored.keys(), "though others of their samples are there"
        )


def _parts(table: Table) -> Iterator[ValidRows]:
    """Yield the rows of a table, some at a time: those of particles are large."""
    places, step = table.done.nonzero(), max(1, _READ_BYTES // table.rows.dtype.itemsize)
    for at in range(0, len(places), step):
        yield table.read_places(places[at : at + step], patient=True)


def _record(
    table: Table, name: str, damaged: set[Key], misplaced: set[Key], report: VerificationReport
) -> None:
    report.counts[name] = len(table.done.nonzero()) - len(damaged)
    if damaged:
        report.add_lost(name, damaged, "with a wrong checksum")
    if misplaced:
        report.faults.append(f"{name}: wrong content in {row_list(misplaced)}")


def row_list(keys: Iterable[Key]) -> str:
    """Return numbers of rows as text: `3, 7`, or for samples `sample 7 of string 3`."""
    ordered = sorted(set(keys), key=lambda key: key if isinstance(key, tuple) else (key, 0))
    shown = [
        f"sample {key[1]} of string {key[0]}" if isinstance(key, tuple) else str(key)
        for key in ordered[:MAX_LISTED]
    ]
    more = len(ordered) - len(shown)
    return ", ".join(shown) + (f" and {more} more" if more else "")
