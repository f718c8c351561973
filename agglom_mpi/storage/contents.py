"""What was read from a campaign file to verify it: whole rows, and what is wrong with others."""

import json
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np

from agglom_mpi.storage.reader import Status
from agglom_mpi.storage.schema import ORIGINS, fresh_from
from agglom_mpi.storage.timeouts import judged_as_timed_out
from agglom_mpi.variables import NAMES

Key = int | tuple[int, int]
"""Number of a string, generation, leg or failure, or string and number of a sample."""

MADE_AGAIN: Final = ("strings", "results", "samples", "generations", "frames")
"""Tables whose lost rows a resume makes again."""
NAMES_SHOWN: Final = 8
"""Rows that one line names at most."""


@dataclass
class VerificationReport:
    """The rows of a campaign file that are final and whole, and what is wrong with others.

    Attributes
    ----------
    rows
        By table, in the order of their places.
    lost
        Numbers of rows, by table, that are needed but absent or not whole. To a resume they are
        absent: it makes those of `MADE_AGAIN` again as far as it needs them.
    losses, faults
        What is wrong, in words: rows that a resume makes again, and all else.
    counts
        Whole rows of the tables of particles, by table.
    recorded
        Generations that were final when all else had been read.
    settled
        Whether all had been written: nobody was writing, or had been kept from it.
    """

    path: Path
    attributes: dict[str, Any]
    status: Status
    rows: dict[str, np.ndarray]
    lost: dict[str, set[Key]]
    losses: list[str] = field(default_factory=list)
    faults: list[str] = field(default_factory=list)
    counts: dict[str, int] = field(default_factory=dict)
    recorded: set[int] = field(default_factory=set)
    room: dict[str, int] = field(default_factory=dict)
    settled: bool = False

    @property
    def identity(self) -> dict[str, Any]:
        """What makes the campaign what it is; raises ValueError if it cannot be read."""
        return dict(json.loads(self.attributes["identity"]))

    @property
    def format_version(self) -> int:
        """Format version of the file."""
        return int(self.attributes["format_version"])

    @property
    def fresh_from(self) -> int:
        """Number of the first sample of each string that no decision sees."""
        return fresh_from(self.attributes)

    @property
    def searched(self) -> np.ndarray:
        """Rows of samples that decisions may see."""
        samples = self.rows["samples"]
        return samples[samples["sample"] < self.fresh_from]

    def numbers(self, table: str) -> set[int]:
        """Strings or generations that a table has rows of."""
        return set(self.rows[table]["generation" if table == "generations" else "string"].tolist())

    def miss(self, table: str, keys: Iterable[Key], why: str) -> None:
        """Take note that rows are absent which others need, unless they are known to be lost."""
        missing = set(keys) - self.lost[table]
        if missing:
            self.lose(table, missing, f"absent, {why}")

    def lose(self, table: str, keys: set[Key], why: str) -> None:
        """Take note that rows are lost."""
        self.lost[table] |= keys
        said = self.losses if table in MADE_AGAIN else self.faults
        said.append(f"{table}: {row_list(keys)} {why}")

    @property
    def ranked_by_model(self) -> bool:
        """Whether a regression proposes and ranks strings.

        It need not give the same bits on another machine; what it gave is believed.
        """
        try:
            return self.identity.get("search.method") == "surrogate"
        except ValueError:  # it cannot be read, which others find
            return False

    @property
    def bred(self) -> np.ndarray:
        """Rows of strings that are offspring, or parents again: their generations have begun.

        Random strings of coming generations may be stored, too, whose samples are simulated ahead.
        """
        strings = self.rows["strings"]
        bred = [ORIGINS.index(origin) for origin in ("offspring", "again")]
        return strings[np.isin(strings["origin"], bred)]

    @property
    def given(self) -> np.ndarray:
        """Rows of strings that the search was given to begin with."""
        return given_rows(self.rows["strings"])

    @property
    def timed_out(self) -> list[tuple[int, int]]:
        """Samples without a row, because they took too long, that results rest on."""
        return judged_as_timed_out(*(self.rows[n] for n in ("failures", "samples", "results")))

    @property
    def unused(self) -> set[Key]:
        """Lost samples that no result rests on, fresh ones too."""
        used = {int(row["string"]): int(row["samples_used"]) for row in self.rows["results"]}
        pairs = (key for key in self.lost["samples"] if isinstance(key, tuple))
        return {pair for pair in pairs if pair[1] >= used.get(pair[0], pair[1] + 1)}

    @property
    def lost_strings(self) -> set[int]:
        """Strings of which a row is lost that their generation rests on."""
        samples = self.lost["samples"] - self.unused
        lost = self.lost["strings"] | self.lost["results"] | samples
        return {key[0] if isinstance(key, tuple) else key for key in lost}


def given_rows(strings: np.ndarray) -> np.ndarray:
    """Return those rows of `/strings` that a search was given to begin with."""
    return strings[strings["origin"] == ORIGINS.index("given")]


def parameters_of(rows: np.ndarray) -> np.ndarray:
    """Return the strings of rows of `/strings`, shape (n, 10)."""
    return np.column_stack([rows[name] for name in NAMES])


def row_list(keys: Iterable[Key]) -> str:
    """Rows in words: `3, 7` or, for samples, `sample 7 of string 3`; of many the first."""
    ordered = sorted(set(keys), key=lambda key: key if isinstance(key, tuple) else (key, 0))
    shown = [
        f"sample {key[1]} of string {key[0]}" if isinstance(key, tuple) else str(key)
        for key in ordered[:NAMES_SHOWN]
    ]
    more = len(ordered) - len(shown)
    return ", ".join(shown) + (f" and {more} more" if more else "")
