"""Who simulates what next: a pure state machine, without MPI, files or a clock.

Events go in (`returned`, `judged`, `heard`, `clock`), assignments and withdrawals come out.
"""

import heapq
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.scheduling.estimators import BatchSizer, PriorityQueue, SampleCountModel
from agglom_mpi.scheduling.in_flight import InFlightTable, SampleRange
from agglom_mpi.scheduling.interface import TASK, Progress, SampleDemand

TAIL_SHARE: Final = 0.01
"""Share of all samples that known strings need which one batch of each rank may add up to."""

URGENCY: Final = 1.5
"""A sample that decisions wait for comes before one of a coming generation that is at most so many
times as likely to be needed, on many ranks."""

URGENCY_PER_RANK: Final = 0.02
"""What each rank adds to an urgency of 1: few ranks lose little by waiting for the last strings of
a generation, and more by samples that turn out not to be needed."""

HOPELESS: Final = 0.02
"""Samples less likely than this to be needed are not simulated."""

SURE: Final = 0.95
"""A batch takes samples of a string that are this much as likely to be needed as the first."""

GENERATIONS_AHEAD: Final = 4
"""Coming generations of which samples may be simulated."""


@dataclass(slots=True)
class DuplicateSample:
    """A sample that a rank fell silent with: who still holds it, and whether it was returned."""

    holders: int = 1
    returned: bool = False


class Scheduler:
    """Hand out samples to ranks, those first that are most likely to be needed soonest.

    A string gets its samples in order. Strings that are not judged yet go before those of coming
    generations, which go before samples that are hardly needed. What a rank that fell silent holds
    is given to others, too, and the first result counts.

    Parameters
    ----------
    needs
        The campaign's decisions.
    ranks
        Number of ranks.
    known
        (string, sample) pairs that need no simulation, from an earlier leg.
    experience
        Samples that strings judged before needed.

    Attributes
    ----------
    held
        What every rank holds.
    pace
        How long samples take, and messages.
    """

    def __init__(
        self,
        needs: SampleDemand,
        ranks: int,
        known: Iterable[tuple[int, int]] = (),
        experience: Iterable[int] = (),
    ) -> None:
        self.held = InFlightTable(ranks)
        self._needs = needs
        self._ranks = ranks
        self._urgency = min(URGENCY, 1.0 + URGENCY_PER_RANK * ranks)
        self._experience = SampleCountModel()
        self._known: dict[int, set[int]] = {}
        self._generation = -1
        self._live: set[int] = set()
        self._next: dict[int, int] = {}
        self._urgent, self._early = (
            PriorityQueue(),
            PriorityQueue(),
        )  # of this generation, and of coming ones
        self._lost: dict[int, list[int]] = {}  # heaps of samples that silent ranks hold
        self._doubled: dict[tuple[int, int], DuplicateSample] = {}  # as long as a rank holds them
        self._settled: list[int] = []  # strings of which ranks may hold what nobody needs
        self.pace = BatchSizer()
        self._most_judged = 0
        for string, sample in known:
            self._known.setdefault(string, set()).add(sample)
        for used in experience:
            self._experience.learn(used)

    def assignments(self, now: float) -> Iterator[tuple[int, NDArray[np.void]]]:
        """Ranks and what to send them, arrays of `TASK`, at the time `now` in s."""
        self._meet_generation()
        for batches in range(self.pace.in_flight(self._batch_size())):
            while (rank := self.held.next_with(batches)) is not None:
                pieces = self._choose(self._least(batches))
                if not pieces:
                    return
                self.held.give(rank, pieces, now)
                yield rank, self._tasks(pieces)

    def withdrawals(self) -> list[tuple[int, NDArray[np.int64]]]:
        """Ranks that hold samples which turned out not to be needed, and of which strings.

        Those that would be done before a message arrives are not worth one.
        """
        self._meet_generation()
        if self._needs.unjudged < len(self._live):  # a race has dropped some
            for string in [i for i in self._live if self._needs.progress(i) is None]:
                self._forget(string)
        told: dict[int, list[int]] = {}
        for string in self._settled:
            for rank, samples in self.held.settle(string):
                if samples * self.pace.mean_seconds > self.pace.turnround:
                    told.setdefault(rank, []).append(string)
        self._settled.clear()
        return [(rank, np.array(strings)) for rank, strings in told.items()]

    def finish(self) -> None:
        """Take note that all is decided, so that nobody needs what ranks hold."""
        self._settled.extend(self._next)

    def returned(
        self, rank: int, done: Sequence[bool]
    ) -> list[tuple[SampleRange, NDArray[np.bool_]]]:
        """Take the next samples that a rank was to simulate, `done` or left out each.

        Returns
        -------
        list
            What they are, and which of each piece were done by nobody before, shape (size,).
        """
        pieces, begin = [], 0
        for piece in self.held.returned(rank, len(done)):
            pieces.append((piece, self._fresh(piece, done[begin : begin + piece.size])))
            begin += piece.size
        return pieces

    def _fresh(self, piece: SampleRange, done: Sequence[bool]) -> NDArray[np.bool_]:
        fresh = np.array(done)
        for place in range(piece.size) if self._doubled else ():
            pair = piece.string, piece.first + place
            doubled = self._doubled.get(pair)
            if doubled is not None:
                fresh[place] = done[place] and not doubled.returned
                doubled.returned |= done[place]
                doubled.holders -= 1
                if not doubled.holders:
                    del self._doubled[pair]
        return fresh

    def judged(self, string: int) -> None:
        """Take note that samples of a string have been judged."""
        if string not in self._next:
            return
        self._rank_anew(string)

    def _forget(self, string: int) -> None:
        """Learn from a string that needs no more samples, and forget it."""
        self._experience.learn(self._needs.used(string))
        self._settled.append(string)
        self._live.discard(string)
        for kept in (self._next, self._known, self._lost):
            kept.pop(string, None)
        self._urgent.drop(string)
        self._early.drop(string)

    def heard(self, rank: int, now: float) -> bool:
        """Take a sign of life of a rank; whether it had fallen silent."""
        return self.held.heard(rank, now)

    def clock(self, now: float, patience: float) -> list[int]:
        """Ranks that have work and were not heard for so many seconds; others do it, too."""
        fallen = self.held.fall_silent(now - patience)
        for rank in fallen:
            for piece in self.held.held(rank):
                self._lose(piece)
        return fallen

    def _lose(self, piece: SampleRange) -> None:
        """Let the samples of a silent rank wait for another one, if they are still needed."""
        samples = range(piece.first, piece.first + piece.size)
        for sample in samples:
            self._doubled.setdefault((piece.string, sample), DuplicateSample())
        if piece.string in self._next:
            lost = self._lost.setdefault(piece.string, [])
            for sample in samples:
                heapq.heappush(lost, sample)
            self._rank_anew(piece.string)

    def _meet_generation(self) -> None:
        if self._needs.generation == self._generation:
            return
        self._generation = self._needs.generation
        self._live = set(self._needs.live)
        for string in [string for string in self._next if self._needs.progress(string) is None]:
            self._forget(string)
        for string in sorted(self._live):
            self._next.setdefault(string, 0)
        # What is out of date sinks to the bottom, and would stay there.
        self._urgent, self._early = PriorityQueue(), PriorityQueue()
        for string in list(self._next):
            self._rank_anew(string)

    def _rank_anew(self, string: int) -> None:
        """Give a string its place among those that wait for a rank, if it needs samples yet.

        Others may have decided that it does not.
        """
        progress = self._needs.progress(string)
        if progress is None:
            self._forget(string)
            return
        ranking = self._urgent if string in self._live else self._early
        lost = self._first_lost(string)
        sample = self._skip_known(string, progress.next_sample) if lost is None else lost
        if sample >= progress.max_samples:
            ranking.drop(string)
            return
        self._most_judged = max(self._most_judged, progress.next_sample)
        ranking.put(string, self._chance(string, progress, sample))

    def _chance(self, string: int, progress: Progress, sample: int) -> float:
        """Probability that a sample is needed; 1 is said of the next one alone."""
        return self._experience.chance(progress.next_sample, sample)

    def _skip_known(self, string: int, judged: int) -> int:
        sample, known = max(self._next[string], judged), self._known.get(string, ())
        while sample in known:
            sample += 1
        self._next[string] = sample
        return sample

    def _choose(self, least: float) -> list[SampleRange]:
        """Pieces for one batch; none that is not worth at least so much."""
        room = self._batch_size()
        pieces: list[SampleRange] = []
        while room > 0:
            piece = self._best(room, least)
            if piece is None:
                break
            pieces.append(piece)
            room -= piece.size
        return pieces

    def _best(self, room: int, least: float) -> SampleRange | None:
        """Take samples of the string that is worth most."""
        string = self._string(least)
        if string is None:
            return None
        self._urgent.drop(string)
        self._early.drop(string)
        lost = self._first_lost(string) is not None
        piece = self._once_more(string, room) if lost else self._piece(string, room)
        self._next[string] = max(self._next[string], piece.first + piece.size)
        self._rank_anew(string)
        return piece

    def _string(self, least: float) -> int | None:
        """Pick the string that is worth most of those that are at least so likely to be needed."""
        chance, live = self._likeliest(self._urgent)
        urgent = self._urgency * chance if chance >= least else 0.0
        if urgent >= 1.0:
            return live
        early, coming = self._likeliest(self._early)
        while early < 1.0 and (strings := self._needs.announce(GENERATIONS_AHEAD)):
            for string in strings:
                self._next[string] = 0
                self.judged(string)
            early, coming = self._likeliest(self._early)
        if max(urgent, early) < least:
            return None
        return live if urgent >= early else coming

    def _likeliest(self, ranking: PriorityQueue) -> tuple[float, int]:
        """Return the likeliest string of a ranking after its chance, which is 0 if there is none.

        As experience grows, chances do.
        """
        while first := ranking.first():
            self._rank_anew(first[1])
            if ranking.first() == first:
                return first
        return 0.0, -1

    def _piece(self, string: int, room: int) -> SampleRange:
        progress = self._needs.progress(string)
        assert progress is not None
        first, judged = self._next[string], progress.next_sample
        count = min(room, progress.max_samples - first)
        if string in self._live:
            count = min(count, self._share(judged))
        known = self._known.get(string)
        if known:
            count = next((n for n in range(1, count) if first + n in known), count)
        worth = self._experience.chance(judged, first)
        while count > 1 and self._experience.chance(judged, first + count - 1) < SURE * worth:
            count //= 2
        return SampleRange(string, first, count)

    def _share(self, judged: int) -> int:
        """Most samples of one string for one rank, so that all can help to judge it soon."""
        need = max(self._experience.mean, judged + 1.0)
        return max(1, int(need * len(self._live) / (2 * self._ranks)))

    def _first_lost(self, string: int) -> int | None:
        """Sample that a rank fell silent with and that is still missing, the first of a string."""
        lost = self._lost.get(string, [])
        while lost and self._is_back(string, lost[0]):
            heapq.heappop(lost)
        return lost[0] if lost else None

    def _is_back(self, string: int, sample: int) -> bool:
        """Whether a sample that a rank fell silent with was returned."""
        doubled = self._doubled.get((string, sample))
        return doubled is None or doubled.returned

    def _once_more(self, string: int, room: int) -> SampleRange:
        """Consecutive samples of ranks that fell silent, each once if several ranks had them."""
        lost = self._lost[string]
        first, count = heapq.heappop(lost), 1
        while lost and lost[0] <= first + count:
            if lost[0] == first + count:
                if count == room or self._is_back(string, lost[0]):
                    break
                count += 1
            heapq.heappop(lost)
        for sample in range(first, first + count):
            self._doubled[string, sample].holders += 1
        return SampleRange(string, first, count)

    def _least(self, batches: int) -> float:
        """Least likely samples that a rank may be given which holds so many batches."""
        return self.pace.queued(self._batch_size()) if batches else HOPELESS

    def _batch_size(self) -> int:
        """Size of a message in samples: no less work than pays, no more than is surely needed."""
        return self.pace.batch(self._surely_needed())

    def _surely_needed(self) -> float:
        """Estimate how many samples for each rank known strings will hardly do without."""
        need = max(self._experience.mean, self._most_judged)
        return TAIL_SHARE * len(self._next) * need / self._ranks

    def _tasks(self, pieces: list[SampleRange]) -> NDArray[np.void]:
        tasks = np.zeros(len(pieces), TASK)
        for task, piece in zip(tasks, pieces, strict=True):
            task["string"], task["first"], task["count"] = piece
            task["parameters"] = self._needs.parameters(piece.string)
        return tasks
