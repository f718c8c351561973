"""What every rank holds: pieces of work in the order in which it does them."""

from collections import deque
from collections.abc import Iterator
from typing import Final, NamedTuple

MESSAGES_IN_FLIGHT: Final = 2
"""Batches a rank holds at most: one that it works on and one that it finds when it is done."""


class SampleRange(NamedTuple):
    """Samples `first` to `first + size - 1` of a string."""

    string: int
    first: int
    size: int

    def split(self, count: int) -> tuple["SampleRange", "SampleRange"]:
        """Return the first `count` samples, and the others."""
        rest = self.first + count
        return (
            SampleRange(self.string, self.first, count),
            SampleRange(self.string, rest, self.size - count),
        )


class InFlightTable:
    """Batches of pieces that ranks were given and have not returned, rank by rank.

    Parameters
    ----------
    ranks
        Number of ranks.

    Attributes
    ----------
    samples
        Samples that ranks hold.
    silent
        Ranks that are not heard of.
    """

    def __init__(self, ranks: int) -> None:
        self._batches: list[deque[deque[SampleRange]]] = [deque() for _ in range(ranks)]
        self._holders: dict[int, set[int]] = {}  # of samples of a string, now or before
        self._heard = [0.0] * ranks
        self.samples = 0
        self.silent: set[int] = set()
        # By the number of batches they hold; those first that have had them for longest.
        self._with = [dict.fromkeys(range(ranks))] + [{} for _ in range(MESSAGES_IN_FLIGHT)]

    def held(self, rank: int) -> Iterator[SampleRange]:
        """Pieces that a rank holds, in order."""
        for batch in self._batches[rank]:
            yield from batch

    def next_with(self, batches: int) -> int | None:
        """Rank that holds so many batches and is likely to be done with them first, or None."""
        return next(iter(self._with[batches]), None)

    def give(self, rank: int, pieces: list[SampleRange], now: float) -> None:
        """Let a rank hold one batch more."""
        if not self._batches[rank]:
            self._heard[rank] = now  # it had nothing to say before
        self._batches[rank].append(deque(pieces))
        self.samples += sum(piece.size for piece in pieces)
        for piece in pieces:
            self._holders.setdefault(piece.string, set()).add(rank)
        self._place(rank, len(self._batches[rank]) - 1)

    def returned(self, rank: int, count: int) -> list[SampleRange]:
        """Take so many samples, the next in turn, off what a rank holds; which they are."""
        batches, done = self._batches[rank], []
        self.samples -= count
        while count:
            piece = batches[0].popleft()
            if piece.size > count:
                piece, rest = piece.split(count)
                batches[0].appendleft(rest)
            elif not batches[0]:
                batches.popleft()
                self._place(rank, len(batches) + 1)
            done.append(piece)
            count -= piece.size
        return done

    def settle(self, string: int) -> list[tuple[int, int]]:
        """Take note that nobody is given more of a string.

        Returns
        -------
        list
            Ranks that are heard of and hold samples of it, and how many.
        """
        held = [
            (rank, sum(piece.size for piece in self.held(rank) if piece.string == string))
            for rank in sorted(self._holders.pop(string, set()) - self.silent)
        ]
        return [(rank, samples) for rank, samples in held if samples]

    def heard(self, rank: int, now: float) -> bool:
        """Take note of a sign of life; whether the rank was silent."""
        self._heard[rank] = now
        if rank not in self.silent:
            return False
        self.silent.discard(rank)
        self._with[len(self._batches[rank])][rank] = None
        return True

    def fall_silent(self, before: float) -> list[int]:
        """Ranks that work and have not been heard since `before`; they are given no more."""
        fallen = [
            rank
            for rank, batches in enumerate(self._batches)
            if batches and self._heard[rank] < before and rank not in self.silent
        ]
        for rank in fallen:
            self.silent.add(rank)
            self._with[len(self._batches[rank])].pop(rank)
        return fallen

    def _place(self, rank: int, before: int) -> None:
        if rank not in self.silent:
            self._with[before].pop(rank)
            self._with[len(self._batches[rank])][rank] = None
