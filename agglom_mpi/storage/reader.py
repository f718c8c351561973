"""Reading a campaign file, finished or not, also while it is being written."""

import logging
import os
import time
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Self, TypeVar

import numpy as np

from agglom_mpi.formatting import shortened, with_article
from agglom_mpi.scheduling.interface import number_in_volume
from agglom_mpi.search.proposals import ORIGINS, Proposals, restored
from agglom_mpi.storage.access import NotACampaign, open_file, read_attributes, report_damage
from agglom_mpi.storage.attributes import altered_parts, earlier_data, identity_of
from agglom_mpi.storage.particle_tables import StoredParticles
from agglom_mpi.storage.room import TableSizes
from agglom_mpi.storage.schema import INVERSION, LEARNED, TOOK_TOO_LONG, parameters_of, volume_table
from agglom_mpi.storage.snapshot import Status, TableSnapshot, read_only, status_of
from agglom_mpi.storage.table import REWRITE_SECONDS, Table, are_used, rows_at
from agglom_mpi.variables import VariableTable

if TYPE_CHECKING:
    from agglom_mpi.declaration.reading import Reading

Allowed = bool | Collection[tuple[str, str]]
"""Whether code of one's own in a file may be executed: all, none, or modules by name and digest."""

LOG: Final = logging.getLogger(__name__)

T = TypeVar("T")


UNUSED_NOTE: Final = (
    "samples that ran ahead unused are counted, too, so results depend on the number of ranks and "
    "on timing"
)
"""Note on what is computed of a file that was opened `with_unused`."""


class CampaignData:
    """A campaign file: its attributes, and its rows as they were when first asked for or refreshed.

    Nothing is read before it is needed: all tables but `/samples` together at the first use of one,
    samples at theirs, and particles at each call. A row counts only if it is final and its checksum
    is right. Arrays are structured and read-only, with the columns in `schema`.

    Parameters
    ----------
    path
        The file.
    attributes
        As h5py reads them, numbers as those of Python.
    sample_columns
        Columns of `/samples` to keep, in that order; all by default. They need `string` and
        `sample`.
    allow_code
        Whether code of one's own that the file has may be executed.

    Attributes
    ----------
    with_unused
        Whether analyses count samples that ran ahead unused, too: how many there are depends on the
        number of ranks and on timing, and so do the results. False until it is set.
    pooled
        Files of the same question with other seeds, whose samples sets and posteriors rest on, too.
    altered
        Attributes and tables that are not as they were written.
    reading
        How the campaign is read; None before `recorded_reading` was called.
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
        self.path = path
        self.attributes = attributes
        self.allow_code = allow_code
        self.with_unused = False
        self.pooled: tuple[CampaignData, ...] = ()
        self.altered: list[str] = []
        self.reading: Reading | None = None
        self._snapshot = TableSnapshot(path, sample_columns)
        self._derived: dict[Callable[..., Any], Any] = {}
        self.particles = StoredParticles(path, lambda: self.has_temperature)

    def __repr__(self) -> str:
        return f"<{type(self).__name__} {str(self.path)!r}: {self.title}>"

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

    # Attributes

    @property
    def campaign_text(self) -> str:
        """The campaign, as YAML."""
        return str(self.attributes["campaign"])

    @property
    def title(self) -> str:
        """The title of the campaign, printable and of a bounded length."""
        return shortened(self.attributes["title"])

    @cached_property
    def identity(self) -> dict[str, Any]:
        """Identity of the campaign, flat: `scene.particles` -> 100, in SI units."""
        return identity_of(self.attributes)

    @cached_property
    def strings_of_earlier_data(self) -> int:
        """Number of strings that were chosen by other data than the file has now; 0: none."""
        return max((each["strings"] for each in earlier_data(self.attributes)), default=0)

    @cached_property
    def sizes(self) -> TableSizes:
        """Sizes of the tables, and what their columns depend on; `generations` is 0."""
        return TableSizes.of(self.attributes)

    @property
    def variables(self) -> VariableTable:
        """The variables of its strings."""
        return self.sizes.variables

    @property
    def volumes(self) -> tuple[int, ...]:
        """Larger control volumes that the file has tables of samples for, ascending."""
        return self.sizes.volumes

    @property
    def max_samples(self) -> int:
        """Samples that there is room for of each string, fresh ones included."""
        return self.sizes.sample_room

    @property
    def fresh_from(self) -> int:
        """Number of the first fresh sample of each string: decisions see only those before it."""
        return self.sizes.max_samples

    def note_altered(self, names: Iterable[str]) -> None:
        """Record, and log as a warning, attributes and tables that are altered."""
        if new := [name for name in names if name not in self.altered]:
            self.altered += new
            LOG.warning("%s: a damaged campaign file (%s altered)", self.path, ", ".join(new))

    # Rows

    def rows(self, table: str) -> np.ndarray:
        """Return the rows of a table, (n,), in the order of their places."""
        return self._snapshot.rows(table)

    def refresh(self) -> None:
        """Read the tables that have been read again; of `/samples` only rows that are new."""
        self._derived.clear()
        for name, kind in vars(CampaignData).items():
            if isinstance(kind, cached_property):
                self.__dict__.pop(name, None)
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

    def status(self) -> Status:
        """Return the state of the campaign at the time of the snapshot; it is read first."""
        return status_of(self.rows("status"))

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

    def learned_rows(self) -> np.ndarray | None:
        """Return the samples of another campaign that the search learns from; None: of none."""
        return self.rows(LEARNED) if self.sizes.learned else None

    def result_rows(self) -> np.ndarray:
        """Return the results of strings so far, by string."""
        return self.rows("results")

    def generation_rows(self) -> np.ndarray:
        """Return the generations so far, in order."""
        return self.rows("generations")

    def legs(self) -> np.ndarray:
        """Return the starts of the program, in order."""
        return self.rows("legs")

    @property
    def last_sources(self) -> str:
        """Digest of the sources of the last leg, or of the creation of the file."""
        legs = self.legs()
        if len(legs):
            return str(legs[-1]["sources_sha256"].decode())
        return str(self.attributes["sources_sha256"])

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

    @cached_property
    def parameters(self) -> dict[int, np.ndarray]:
        """Parameter strings by number, each of shape (k,), in SI units."""
        rows = self.string_rows()
        return dict(zip(rows["string"].tolist(), parameters_of(rows), strict=True))

    def values(self, strings: Sequence[int] | np.ndarray, variable: str) -> np.ndarray:
        """Return a variable of strings, (n,), in SI units; nan where a string's row is damaged."""
        column, known = self.variables.index(variable), self.parameters
        return np.array([known[int(i)][column] if int(i) in known else np.nan for i in strings])

    def restore(self, batch: Proposals, first: int) -> Proposals:
        """Return proposals, numbered from `first`, with the stored parameters where there are any.

        Computed again on another machine they might differ in the last bits.
        """
        return restored(batch, first, self.parameters)

    @cached_property
    def samples_used(self) -> dict[int, int]:
        """Number of samples that the result of each string rests on, by string."""
        rows = self.result_rows()
        return dict(zip(rows["string"].tolist(), rows["samples_used"].tolist(), strict=True))

    def are_used(self, rows: np.ndarray) -> np.ndarray:
        """Return which rows of `/samples`, (n,), a result rests on, (n,) bool."""
        return are_used(rows, self.result_rows())

    def counted(self, rows: np.ndarray) -> np.ndarray:
        """Return those of some rows of `/samples` that analyses rest on: used and fresh ones.

        All of them, `with_unused`.
        """
        counted = self.with_unused | (rows["sample"] >= self.fresh_from) | self.are_used(rows)
        return rows if counted.all() else rows_at(rows, counted)

    @cached_property
    def counted_samples(self) -> np.ndarray:
        """Rows of the samples that analyses rest on; see `counted`."""
        return read_only(self.counted(self.all_sample_rows()))

    @property
    def unused_notes(self) -> list[str]:
        """A line on what is counted, `with_unused`; else none."""
        return [UNUSED_NOTE] if self.with_unused else []

    @cached_property
    def searched_samples(self) -> np.ndarray:
        """Rows of the samples that decisions may see."""
        rows = self.all_sample_rows()
        searched = rows["sample"] < self.fresh_from
        return rows if searched.all() else read_only(rows_at(rows, searched))

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

    @cached_property
    def timed_out(self) -> set[tuple[int, int]]:
        """Samples, as (string, sample), that have no row because they took too long.

        Those of larger volumes have the string numbers of `scheduling.volume_strings`. The texts of
        failures name them; a later attempt may have stored a row after all.
        """
        failures, mark = self.failures(), TOOK_TOO_LONG.encode()
        late = np.array([text.startswith(mark) for text in failures["text"]], bool)
        if not late.any():
            return set()
        pairs = set(failures[["string", "sample"]][late].tolist())
        pairs -= set(self.all_sample_rows()[["string", "sample"]].tolist())
        for volume in self.volumes:
            pairs -= set(map(tuple, _keys(self.volume_rows(volume), volume).tolist()))
        return pairs

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
            f"{path}: holds the samples of {with_article(shortened(purpose))}, not an inversion's"
        )
    return data


def given_strings(strings: np.ndarray) -> np.ndarray:
    """Return those rows of `/strings` that a search was given to begin with."""
    return strings[strings["origin"] == ORIGINS.index("given")]


def _keys(rows: np.ndarray, volume: int) -> np.ndarray:
    """Return string and number of samples of a volume, (n, 2), as they are in flight."""
    return np.column_stack([rows["string"] + number_in_volume(0, volume), rows["sample"]])
