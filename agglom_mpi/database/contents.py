"""What was read from a campaign file to verify it: whole rows, and what is wrong with others."""

import json
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np

from agglom_mpi.database.reader import Status
from agglom_mpi.database.schema import ORIGINS, TOOK_TOO_LONG

Key = int | tuple[int, int]
"""Number of a string, generation, leg or failure, or string and number of a sample."""

MADE_AGAIN: Final = ("strings", "results", "samples", "generations", "frames")
"""Tables whose lost rows a resume makes again."""
NAMES_SHOWN: Final = 8
"""Rows that one line names at most."""


@dataclass
class Contents:
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
        said.append(f"{table}: {named(keys)} {why}")

    @property
    def bred(self) -> np.ndarray:
        """Rows of strings that are offspring: their generations have begun.

        Random strings of coming generations may be stored, too, whose samples are simulated ahead.
        """
        strings = self.rows["strings"]
        return strings[strings["origin"] == ORIGINS.index("offspring")]

    @property
    def timed_out(self) -> list[tuple[int, int]]:
        """Samples without a row, because they took too long, that results rest on."""
        return judged_as_timed_out(*(self.rows[n] for n in ("failures", "samples", "results")))

    @property
    def unused(self) -> set[Key]:
        """Lost samples that no result rests on."""
        used = {int(row["string"]): int(row["samples_used"]) for row in self.rows["results"]}
        pairs = (key for key in self.lost["samples"] if isinstance(key, tuple))
        return {pair for pair in pairs if pair[1] >= used.get(pair[0], pair[1] + 1)}

    @property
    def lost_strings(self) -> set[int]:
        """Strings of which a row is lost that their generation rests on."""
        samples = self.lost["samples"] - self.unused
        lost = self.lost["strings"] | self.lost["results"] | samples
        return {key[0] if isinstance(key, tuple) else key for key in lost}


def timed_out(failures: np.ndarray, samples: np.ndarray) -> set[tuple[int, int]]:
    """Return (string, sample) that have no row because they took too long."""
    late = np.array([text.startswith(TOOK_TOO_LONG.encode()) for text in failures["text"]], bool)
    if not late.any():
        return set()
    pairs = set(failures[["string", "sample"]][late].tolist())
    return pairs - set(samples[["string", "sample"]].tolist())


def judged_as_timed_out(
    failures: np.ndarray, samples: np.ndarray, results: np.ndarray
) -> list[tuple[int, int]]:
    """Return those samples without a row, because they took too long, that results rest on."""
    late = timed_out(failures, samples)
    used = dict(results[["string", "samples_used"]].tolist()) if late else {}
    return sorted((string, sample) for string, sample in late if sample < used.get(string, 0))


def named(keys: Iterable[Key]) -> str:
    """Rows in words: `3, 7` or, for samples, `sample 7 of string 3`; of many the first."""
    ordered = sorted(set(keys), key=lambda key: key if isinstance(key, tuple) else (key, 0))
    shown = [
        f"sample {key[1]} of string {key[0]}" if isinstance(key, tuple) else str(key)
        for key in ordered[:NAMES_SHOWN]
    ]
    more = len(ordered) - len(shown)
    return ", ".join(shown) + (f" and {more} more" if more else "")
