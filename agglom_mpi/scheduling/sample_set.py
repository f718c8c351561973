"""A set of samples that costs a byte each, however they are numbered."""

from collections.abc import Iterable, Iterator

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.scheduling.in_flight import SampleRange


class SampleSet:
    """Samples of strings; `len` is their number.

    Parameters
    ----------
    parts
        Ranges of samples that are in the set; a string may have several.
    """

    def __init__(self, parts: Iterable[SampleRange]) -> None:
        of_string: dict[int, list[SampleRange]] = {}
        for part in parts:
            of_string.setdefault(part.string, []).append(part)
        self._first: dict[int, int] = {}
        self._flags: dict[int, NDArray[np.bool_]] = {}
        for string, ranges in of_string.items():
            first = min(part.first for part in ranges)
            flags = np.zeros(max(part.first + part.size for part in ranges) - first, np.bool_)
            for part in ranges:
                flags[part.first - first :][: part.size] = True
            self._first[string], self._flags[string] = first, flags
        self._count = sum(int(np.count_nonzero(flags)) for flags in self._flags.values())

    def __len__(self) -> int:
        return self._count

    def discard(self, strings: NDArray[np.int64], samples: NDArray[np.int64]) -> None:
        """Take samples out, by string and number, (n,) each; those of no range are ignored."""
        for string in np.unique(strings).tolist():
            if string in self._flags:
                flags, places = self._flags[string], samples[strings == string]
                places = places - self._first[string]
                places = places[(places >= 0) & (places < len(flags))]
                self._count -= int(np.count_nonzero(flags[np.unique(places)]))
                flags[places] = False

    def take(self, part: SampleRange) -> NDArray[np.bool_]:
        """Take a range out that once was in the set; return which of it still were, (size,)."""
        flags = self._of(part)
        found = flags.copy()
        flags[:] = False
        self._count -= int(np.count_nonzero(found))
        return found

    def runs(self) -> Iterator[SampleRange]:
        """Yield ranges of consecutive samples, in the order in which their strings were given."""
        for string, flags in self._flags.items():
            yield from self.runs_in(SampleRange(string, self._first[string], len(flags)))

    def runs_in(self, part: SampleRange) -> Iterator[SampleRange]:
        """Yield the ranges of a range that are in the set; it must once have been."""
        edges = np.flatnonzero(np.diff(self._of(part), prepend=False, append=False))
        for start, stop in edges.reshape(-1, 2).tolist():
            yield SampleRange(part.string, part.first + start, stop - start)

    def _of(self, part: SampleRange) -> NDArray[np.bool_]:
        begin = part.first - self._first[part.string]
        return self._flags[part.string][begin : begin + part.size]
