"""Rows on their way to the file, so that neighbours can be written together."""

from collections.abc import Iterator, Mapping
from itertools import pairwise
from typing import Final

import numpy as np

from agglom_mpi.database.schema import sample_dtype

FLUSH_ROWS: Final = 1024
"""Rows that wait at most."""
FLUSH_BYTES: Final = 1 << 22
"""Bytes that wait at most."""
FLUSH_AGE: Final = 0.5
"""Seconds that a row waits at most."""


class RowBuffer:
    """Rows of samples, or of strings, that wait to be written; knows their places, not the file.

    Parameters
    ----------
    room
        Numbers that there is room for, by the columns that say where a row belongs: `string`, and
        `sample` for rows of samples.
    dtype
        Of a row.
    """

    def __init__(self, room: Mapping[str, int], dtype: np.dtype = sample_dtype) -> None:
        self._room = room
        self._dtype = dtype
        self.clear()

    def clear(self) -> None:
        """Forget all rows: they are written."""
        self._waiting: list[bytes] = []
        self._count = 0
        self._since = 0.0

    @property
    def count(self) -> int:
        """Rows that wait."""
        return self._count

    @property
    def full(self) -> bool:
        """Whether enough rows wait to be worth writing."""
        return self._count >= min(FLUSH_ROWS, max(1, FLUSH_BYTES // self._dtype.itemsize))

    def due(self, now: float) -> bool:
        """Whether the oldest row has waited for too long at monotonic time `now`."""
        return self._count > 0 and now - self._since >= FLUSH_AGE

    def add(self, records: np.ndarray, now: float) -> None:
        """Keep a copy of rows, (n,); raises IndexError if they have no place."""
        for name, room in self._room.items():
            for number in records[name].tolist():
                if not 0 <= number < room:
                    raise IndexError(f"{name} {number}: there is room for 0 to {room - 1}")
        if not len(records):
            return
        if not self._count:
            self._since = now
        self._waiting.append(records.astype(self._dtype, copy=False).tobytes())
        self._count += len(records)

    def runs(self) -> Iterator[tuple[int, np.ndarray]]:
        """Row numbers and rows of each consecutive run; of rows for one place the first added."""
        if not self._count:
            return
        rows = np.frombuffer(b"".join(self._waiting), self._dtype)
        numbers = [rows[name] for name in self._room]
        places = np.ravel_multi_index(numbers, tuple(self._room.values()))
        places, first = np.unique(places, return_index=True)
        # As plain bytes, for NumPy moves structured rows column by column.
        ordered = rows.view(np.uint8).reshape(len(rows), -1)[first].view(self._dtype)[:, 0]
        ends = [*(np.flatnonzero(np.diff(places) != 1) + 1).tolist(), len(places)]
        for begin, end in pairwise([0, *ends]):
            yield int(places[begin]), ordered[begin:end]
