"""The scheduler on simulated ranks."""

import heapq
import math
from collections import deque
from collections.abc import Collection, Iterable, Iterator, Sequence
from typing import Final, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.planning.saturation import Forecast
from agglom_mpi.scheduling.scheduler import Scheduler
from agglom_mpi.search.decisions import Decision, StringEvaluated, StringsProposed
from agglom_mpi.search.inversion import Inversion
from agglom_mpi.search.proposals import AGAIN, MODEL, OFFSPRING

LATENCY: Final = 2e-3
"""Seconds until a message is read: a rank looks at its mail every 4 ms, more often if there is."""

MESSAGE_SECONDS: Final = 150e-6
"""Time that rank 0 needs to send or to take a message, s."""

SAMPLE_SECONDS: Final = 40e-6
"""Time that rank 0 needs to evaluate and to store a sample, s."""

MOST_SIMULATED: Final = 2_000_000
"""Samples after which a forecast is given up, some minutes."""


class Sample(NamedTuple):
    """A sample that an imaginary rank holds, and the time that it spends on it, in s."""

    string: int
    seconds: float
    needed: bool = True


class SimulatedRank:
    """Batches of an imaginary rank, which does them in the order in which they come.

    Attributes
    ----------
    free
        When the first of them can begin, for all that the rank has done before; s.
    batches
        Each after the time when it comes, in s.
    """

    def __init__(self) -> None:
        self.free = 0.0
        self.batches: deque[tuple[float, list[Sample]]] = deque()

    def put(self, now: float, samples: list[Sample]) -> None:
        """Give the rank a batch."""
        self.batches.append((now, samples))

    @property
    def end(self) -> float:
        """When it is done with its first batch, s."""
        received, samples = self.batches[0]
        return max(self.free, received) + sum(sample.seconds for sample in samples)

    def take(self) -> list[Sample]:
        """Its first batch, which is done."""
        self.free = self.end
        return self.batches.popleft()[1]

    def cancel(self, now: float, strings: Collection[int]) -> None:
        """Leave out what is not done of some strings from then on."""
        for samples, place, end in list(self.schedule()):
            sample = samples[place]
            if sample.string in strings and end > now:
                spent = max(0.0, now - (end - sample.seconds))
                samples[place] = sample._replace(seconds=spent, needed=False)

    def schedule(self) -> Iterator[tuple[list[Sample], int, float]]:
        """Batches, places in them, and when the sample there ends, s."""
        end = self.free
        for received, samples in self.batches:
            end = max(end, received)
            for place, sample in enumerate(samples):
                end += sample.seconds
                yield samples, place, end


class Workload(Protocol):
    """What samples would give, and how long they would take."""

    def sample(
        self, string: int, parameters: NDArray[np.float64], sample: int
    ) -> tuple[np.void, float]:
        """Return a row with the columns of `OUTCOME`, and the time of the sample in s.

        They are the same whenever they are asked for.
        """


class MessageCosts(NamedTuple):
    """What there is besides simulating, all in s.

    Attributes
    ----------
    latency
        From one rank to another.
    message
        Time that rank 0 needs to send or to take a message.
    sample
        Time that rank 0 needs to evaluate and to store a sample.
    """

    latency: float = LATENCY
    message: float = MESSAGE_SECONDS
    sample: float = SAMPLE_SECONDS


FREE: Final = MessageCosts(0.0, 0.0, 0.0)
"""Messages and decisions that take no time."""


class TooManySamples(Exception):  # noqa: N818  (it says what is the matter, like StopIteration)
    """A forecast would take more than `MOST_SIMULATED` samples."""


class CriticalPath:
    """Strings that had to wait for results of earlier generations, and samples that all used.

    Parameters
    ----------
    lag
        They had to wait for all generations but the last `lag` - 1 before their own.

    Attributes
    ----------
    waiting
        Those strings, by generation.
    used
        Number of samples that each evaluated string used.
    """

    def __init__(self, lag: int) -> None:
        self.waiting: list[list[int]] = []
        self.used: dict[int, int] = {}
        self._lag = lag

    def seconds(self, longest: list[float]) -> float:
        """Time until all is decided, if the waiting strings of each generation take so long, s."""
        decided: list[float] = []
        for generation, seconds in enumerate(longest):
            begin = decided[generation - self._lag] if generation >= self._lag else 0.0
            decided.append(max([begin + seconds, *decided[-1:]]))
        return decided[-1]

    def record(self, decisions: Iterable[Decision]) -> None:
        """Keep what decisions say of both."""
        for decision in decisions:
            match decision:
                case StringsProposed(proposals, strings, ahead=False):
                    learnt = np.isin(proposals.origin, (OFFSPRING, MODEL, AGAIN))
                    learnt |= proposals.generation == 0
                    self.waiting.append(strings[learnt].tolist())
                case StringEvaluated(string, result):
                    self.used[string] = result.samples_used


class ClusterSimulator:
    """Runs a campaign on ranks that only take time.

    Rank 0 simulates beside its messages, as it does in its thread.

    Parameters
    ----------
    inversion
        The decisions, at their start.
    workload
        What the samples give.
    ranks
        Number of ranks; all of them simulate.
    costs
        Of messages and decisions.
    lag
        Generations from one to the next that learns from it, as of a campaign's `search`.

    Attributes
    ----------
    chain
        What decided how long the campaign took at least.
    inversion
        The decisions.
    """

    def __init__(
        self,
        inversion: Inversion,
        workload: Workload,
        ranks: int,
        costs: MessageCosts = FREE,
        lag: int = 1,
    ) -> None:
        self.chain = CriticalPath(lag)
        self.inversion = inversion
        self._workload = workload
        self._costs = costs
        self._ranks = [SimulatedRank() for _ in range(ranks)]
        self._arrivals: list[tuple[float, int, int]] = []  # a heap: when, number, rank
        self._expected = [0] * ranks  # numbers of those that are still true
        self._number = 0
        self._seconds: dict[int, list[float]] = {}
        self._rows: dict[int, list[np.void]] = {}
        self._handed_out = 0
        self._simulated = 0
        self._work = 0.0
        self._served = 0.0

    def run(self) -> Forecast:
        """Let time pass until all is decided; raises TooManySamples."""
        self.chain.record(self.inversion.start())
        scheduler = Scheduler(self.inversion, self._propose_ahead, len(self._ranks))
        scheduler.batch_sizer.round_trip = 2.0 * (self._costs.latency + self._costs.message)
        now = 0.0
        while not self.inversion.finished:
            arrival, rank = self._next_arrival()
            if arrival > now:
                now = self._hand_out(scheduler, now)
                arrival, rank = self._next_arrival()
            now = self._take(scheduler, max(now, arrival), rank)
        return self._forecast(now)

    def _propose_ahead(self, generations: int) -> Sequence[int]:
        proposed = self.inversion.propose_ahead(generations)
        return () if proposed is None else proposed.strings.tolist()

    def _next_arrival(self) -> tuple[float, int]:
        """When the next batch arrives, s, and of which rank; never, if there is none."""
        while self._arrivals:
            arrival, number, rank = self._arrivals[0]
            if self._expected[rank] == number:
                return arrival, rank
            heapq.heappop(self._arrivals)
        return math.inf, -1

    def _expect(self, rank: int) -> None:
        """Let the first batch of a rank arrive when it is done, and not when that was thought."""
        self._number += 1
        self._expected[rank] = self._number
        if self._ranks[rank].batches:
            arrival = self._ranks[rank].end + self._costs.latency
            heapq.heappush(self._arrivals, (arrival, self._number, rank))

    def _hand_out(self, scheduler: Scheduler, now: float) -> float:
        """Let rank 0 send what ranks are to do and what they need not; when it is done."""
        for rank, strings in scheduler.cancellations():
            now = self._serve(now, self._costs.message)
            self._ranks[rank].cancel(now + self._costs.latency, strings.tolist())
            self._expect(rank)
        for rank, tasks in scheduler.assignments(now):
            now = self._serve(now, self._costs.message)
            columns = (tasks[name].tolist() for name in ("string", "first", "count"))
            samples = [
                sample for piece in zip(*columns, strict=True) for sample in self._samples(*piece)
            ]
            self._ranks[rank].put(now + self._costs.latency, samples)
            if len(self._ranks[rank].batches) == 1:
                self._expect(rank)
        return now

    def _serve(self, now: float, seconds: float) -> float:
        """Let rank 0 work for so long; when it is done."""
        self._served += seconds
        return now + seconds

    def _take(self, scheduler: Scheduler, now: float, rank: int) -> float:
        """Let rank 0 evaluate what a rank has simulated; return the time when it is done."""
        samples = self._ranks[rank].take()
        spent = sum(sample.seconds for sample in samples)
        self._expect(rank)
        done = [sample for sample in samples if sample.needed]
        scheduler.heartbeat(rank, now)
        scheduler.batch_sizer.learn([sample.seconds for sample in done])
        for part, _ in scheduler.returned(rank, [sample.needed for sample in samples]):
            taken, samples = samples[: part.size], samples[part.size :]
            count = sum(sample.needed for sample in taken)
            if count:
                rows = np.array(self._rows[part.string][part.first : part.first + count])
                self.chain.record(self.inversion.complete(part.string, part.first, rows))
            scheduler.update(part.string)
        self._simulated += len(done)
        self._work += spent
        return self._serve(now, self._costs.message + self._costs.sample * len(done))

    def _samples(self, string: int, first: int, count: int) -> list[Sample]:
        """Simulate samples of a string, the next ones."""
        parameters = self.inversion.parameters(string)
        rows = self._rows.setdefault(string, [])
        seconds = self._seconds.setdefault(string, [])
        for number in range(first, first + count):
            row, duration = self._workload.sample(string, parameters, number)
            rows.append(row)
            seconds.append(duration)
        self._handed_out += count
        if self._handed_out > MOST_SIMULATED:
            raise TooManySamples
        return [Sample(string, duration) for duration in seconds[first : first + count]]

    def _abandon(self, end: float) -> None:
        """Count what ranks have done of the batches that they hold at the end."""
        for rank in self._ranks:
            for samples, place, ends in rank.schedule():
                spent = samples[place].seconds - max(0.0, ends - end)
                self._simulated += samples[place].needed and ends <= end
                self._work += max(0.0, spent)

    def _forecast(self, seconds: float) -> Forecast:
        self._abandon(seconds)
        used = self.chain.used
        needed = {string: self._seconds[string][: used[string]] for string in used}
        return Forecast(
            ranks=len(self._ranks),
            seconds=seconds,
            busy=self._work / (seconds * len(self._ranks)),
            simulated=self._simulated,
            used=sum(used.values()),
            work=sum(map(sum, needed.values())),
            chain=self.chain.seconds(
                [
                    max((max(needed[string]) for string in strings if string in needed), default=0)
                    for strings in self.chain.waiting
                ]
            ),
            master=self._served / seconds,
        )
