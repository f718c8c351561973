"""What travels between ranks: fixed-size typed records, never pickles."""

import socket
from typing import Final

import numpy as np

from agglom_mpi.database.schema import sample_dtype
from agglom_mpi.variables import COUNT

TASKS: Final = 1
RESULTS: Final = 2
FAILURE: Final = 3
STOP: Final = 4
WRITTEN: Final = 5
UNWRITTEN: Final = 6
SYNC: Final = 7
FINALS: Final = 8
FRAMES: Final = 9
"""Message tags."""

POLL: Final = 0.001
"""Seconds between looks at the mail while nothing happens; a blocking receive burns a core."""

TASK: Final = np.dtype(
    [("string", "i8"), ("sample", "i8"), ("frames", "i8"), ("parameters", "f8", COUNT)]
)
"""One sample to simulate; or, if `frames` is not 0, to take so many pictures of."""

RESULT: Final = sample_dtype
"""One simulated sample, as it stands in the campaign file."""

FAILED_SAMPLE: Final = np.dtype(
    [("string", "i8"), ("sample", "i8"), ("rank", "i4"), ("host", "S64"), ("text", "S1000")]
)
"""The traceback of a sample that raised."""

FAREWELL: Final = np.dtype([("database_seconds", "f8")])
"""The last word of a rank that has stopped: time that it spent on the campaign file, s."""

MOST_TASKS: Final = 64
"""Tasks in one message at most."""


def failed_sample(string: int, sample: int, rank: int, text: str) -> np.ndarray:
    """Make the record, shape (1,), that tells of an exception; of a long text the end is kept."""
    record = np.zeros(1, FAILED_SAMPLE)
    record["string"], record["sample"], record["rank"] = string, sample, rank
    record["host"] = socket.gethostname().encode()[:64]
    record["text"] = (
        text.encode()[-FAILED_SAMPLE["text"].itemsize :].decode(errors="ignore").encode()
    )
    return record
