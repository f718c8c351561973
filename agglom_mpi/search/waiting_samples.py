"""Samples that wait for their turn: an ensemble takes those of its string in order."""

from collections.abc import Iterator, Mapping

from agglom_mpi.search.sample_paths import SamplePart


class WaitingSamples:
    """Runs of consecutive samples of strings; of several copies of a sample the first counts."""

    def __init__(self) -> None:
        self._runs: dict[int, dict[int, SamplePart]] = {}  # by string and first sample

    def add(self, string: int, first: int, part: SamplePart, used: int) -> None:
        """Add consecutive samples of a string, except those that are there or used already.

        Parameters
        ----------
        string, first
            Their string, and the number of the first one.
        part
            The samples.
        used
            Number of samples that the string has used.
        """
        runs = self._runs.setdefault(string, {})
        if runs or first < used:
            size = part.end - part.begin
            for start, stop in list(gaps(max(first, used), first + size, runs)):
                runs[start] = part.part(start - first, stop - first)
        else:
            runs[first] = part

    def take(self, string: int, used: int, limit: float) -> list[SamplePart]:
        """Remove and return the samples that follow the `used` ones without a gap, up to a limit.

        Parameters
        ----------
        string
            Their string.
        used
            Number of samples that it has used.
        limit
            Number of samples that it may have used then.
        """
        runs, parts = self._runs.get(string, {}), []
        while used < limit and (part := runs.pop(used, None)) is not None:
            size = part.end - part.begin
            if used + size > limit:
                allowed = int(limit) - used
                runs[int(limit)], part = part.part(allowed, size), part.part(0, allowed)
            parts.append(part)
            used += size
        return parts

    def drop(self, string: int) -> None:
        """Remove all samples of a string."""
        self._runs.pop(string, None)

    def clear(self) -> None:
        """Remove all samples."""
        self._runs.clear()


def gaps(begin: int, end: int, runs: Mapping[int, SamplePart]) -> Iterator[tuple[int, int]]:
    """Yield begin and end of the parts of a range of samples that no run, by its first, holds."""
    for first in sorted(runs):
        if first >= end:
            break
        if begin < first:
            yield begin, first
        begin = max(begin, first + runs[first].end - runs[first].begin)
    if begin < end:
        yield begin, end
