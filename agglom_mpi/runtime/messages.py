"""What travels between ranks: fixed-size typed records, never pickles."""

import socket
from typing import Final

import numpy as np

from agglom_mpi.outcome import TIMED_OUT
from agglom_mpi.storage.schema import sample_dtype

TASKS: Final = 1
RESULTS: Final = 2
FAILURE: Final = 3
STOP: Final = 4
WRITTEN: Final = 5
UNWRITTEN: Final = 6
SYNC: Final = 7
FINALS: Final = 8
FRAMES: Final = 9
ALIVE: Final = 10
WITHDRAWN: Final = 11
"""Message tags."""

RESULT: Final = sample_dtype
"""One simulated sample, as it stands in the campaign file."""

NOT_NEEDED: Final = 255
"""The `reason` of a result that is none: its string needs no more samples, and was `WITHDRAWN`."""

_NOT_FINAL: Final = frozenset((TIMED_OUT, NOT_NEEDED))

FAILED_SAMPLE: Final = np.dtype(
    [
        ("string", "i8"),
        ("sample", "i8"),
        ("frames", "i8"),
        ("rank", "i4"),
        ("host", "S64"),
        ("text", "S1000"),
    ]
)
"""The traceback of a sample that raised, `frames` as in its task."""

HEARTBEAT: Final = np.dtype([("host", "S64"), ("wakeup", "S64")])
"""A sign of life: the machine of a rank, and the name that it is woken by. Rank 0 sends its own to
those that it can wake."""

ALIVE_EVERY: Final = 5.0
"""Seconds after which a rank that has nothing to say gives a sign of life."""

SILENT_AFTER: Final = 30.0
"""Seconds without a sign of life after which a rank's work is given to others, too."""

GOODBYE: Final = np.dtype([("database_seconds", "f8")])
"""The last word of a rank that has stopped: time that it spent on the campaign file, s."""


def heartbeat(wakeup: bytes) -> np.ndarray:
    """Make the record, shape (1,), by which this rank shows that it is there."""
    return np.array([(_host(), wakeup)], HEARTBEAT)


def failed_sample(string: int, sample: int, rank: int, text: str, frames: int = 0) -> np.ndarray:
    """Make the record, shape (1,), that tells of an exception; of a long text the end is kept."""
    record = np.zeros(1, FAILED_SAMPLE)
    record["string"], record["sample"], record["rank"] = string, sample, rank
    record["frames"] = frames
    record["host"] = _host()
    record["text"] = (
        text.encode()[-FAILED_SAMPLE["text"].itemsize :].decode(errors="ignore").encode()
    )
    return record


def _host() -> bytes:
    return socket.gethostname().encode()[:64]


def storable(results: np.ndarray) -> np.ndarray:
    """Return those results, (n,), that are kept.

    A sample that took too long may be tried again, and one that was left out is none.
    """
    if _NOT_FINAL.isdisjoint(results["reason"].tolist()):
        return results
    return results[~np.isin(results["reason"], list(_NOT_FINAL))]
