"""A cluster that is not there: the real scheduler and the real decisions, imaginary ranks."""

import heapq
from collections.abc import Callable, Iterator
from itertools import accumulate
from typing import Final, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.farm.forecast import Forecast
from agglom_mpi.farm.scheduler import Scheduler
from agglom_mpi.search import Batch, EnsembleResult, GenerationSummary, Inversion
from agglom_mpi.search.inversion import Observer
from agglom_mpi.search.proposals import AGAIN, MODEL, OFFSPRING
from agglom_mpi.simulation.outcome import Measured

LATENCY: Final = 2e-3
"""Seconds until a message is read: a rank looks at its mail every 4 ms, more often if there is."""

MESSAGE_SECONDS: Final = 150e-6
"""Time that rank 0 needs to send or to take a message, s."""

SAMPLE_SECONDS: Final = 40e-6
"""Time that rank 0 needs to judge and to store a sample, s."""

MOST_SIMULATED: Final = 2_000_000
"""Samples after which a forecast is given up, some minutes."""


class Workload(Protocol):
    """What samples would give, and how long they would take."""

    def sample(
        self, string: int, parameters: NDArray[np.float64], sample: int
    ) -> tuple[Measured, float]:
        """Outcome of a sample and its time in s; the same whenever it is asked for."""


class Costs(NamedTuple):
    """What there is besides simulating, all in s.

    Attributes
    ----------
    latency
        From one rank to another.
    message
        Time that rank 0 needs to send or to take a message.
    sample
        Time that rank 0 needs to judge and to store a sample.
    """

    latency: float = LATENCY
    message: float = MESSAGE_SECONDS
    sample: float = SAMPLE_SECONDS


FREE: Final = Costs(0.0, 0.0, 0.0)
"""Messages and decisions that take no time."""


class TooManySamples(Exception):  # noqa: N818  (it says what is the matter, like StopIteration)
    """A forecast would take more than `MOST_SIMULATED` samples."""


class Chain:
    """Observer that remembers which strings had to wait for results of generations before theirs.

    Parameters
    ----------
    lag
        They had to wait for all generations but the last `lag` - 1 before their own.
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

    def announced(self, batch: Batch, ids: NDArray[np.int64]) -> None:
        """They wait for nothing."""

    def proposed(self, batch: Batch, ids: NDArray[np.int64]) -> None:
        """Take a generation."""
        learnt = np.isin(batch.origin, (OFFSPRING, MODEL, AGAIN)) | (batch.generation == 0)
        self.waiting.append(ids[learnt].tolist())

    def judged(self, string: int, result: EnsembleResult) -> None:
        """Take the number of samples of a string."""
        self.used[string] = result.samples_used

    def generation_done(self, summary: GenerationSummary) -> None:
        """Nothing is to be remembered."""


class Load(NamedTuple):
    """A batch on an imaginary rank, by the time when its results arrive at rank 0, in s."""

    arrival: float
    number: int
    """In the order of sending, which decides between loads that arrive together."""
    rank: int
    begin: float
    pieces: list[tuple[int, int, int]]
    """String, first sample and number of samples."""


class VirtualCluster:
    """Runs a campaign on ranks that only take time.

    Rank 0 simulates beside its messages, as it does in its thread.

    Parameters
    ----------
    make_inversion
        Sets up the decisions, which are told to an observer.
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
    inversion
        The decisions.
    """

    def __init__(
        self,
        make_inversion: Callable[[Observer], Inversion],
        workload: Workload,
        ranks: int,
        costs: Costs = FREE,
        lag: int = 1,
    ) -> None:
        self.chain = Chain(lag)
        self.inversion = make_inversion(self.chain)
        self._workload = workload
        self._ranks = ranks
        self._costs = costs
        self._loads: list[Load] = []
        self._free = [0.0] * ranks
        self._seconds: dict[int, list[float]] = {}
        self._outcomes: dict[int, list[Measured]] = {}
        self._sent = 0
        self._simulated = 0
        self._work = 0.0
        self._served = 0.0

    def run(self) -> Forecast:
        """Let time pass until all is decided; raises TooManySamples."""
        self.inversion.start()
        scheduler = Scheduler(self.inversion, self._ranks)
        scheduler.pace.turnround = 2.0 * (self._costs.latency + self._costs.message)
        now = self._hand_out(scheduler, 0.0)
        while not self.inversion.finished:
            load = heapq.heappop(self._loads)
            now = self._take(scheduler, max(now, load.arrival), load)
            waits = bool(self._loads) and self._loads[0].arrival <= now
            if not (waits or self.inversion.finished):
                now = self._hand_out(scheduler, now)
        return self._forecast(now)

    def _hand_out(self, scheduler: Scheduler, now: float) -> float:
        latency, message, _ = self._costs
        for rank, tasks in scheduler.assignments(now):
            now += message
            self._served += message
            columns = (tasks[name].tolist() for name in ("string", "first", "count"))
            pieces = list(zip(*columns, strict=True))
            begin = max(self._free[rank], now + latency)
            self._free[rank] = end = begin + sum(sum(self._simulate(*piece)) for piece in pieces)
            self._sent += 1
            heapq.heappush(self._loads, Load(end + latency, self._sent, rank, begin, pieces))
        return now

    def _take(self, scheduler: Scheduler, now: float, load: Load) -> float:
        """Let rank 0 judge what a rank has simulated; when it is done."""
        scheduler.heard(load.rank, now)
        seconds = list(self._times(load))
        scheduler.returned(load.rank, seconds)
        for string, first, count in load.pieces:
            outcomes = self._outcomes[string][first : first + count]
            self.inversion.accept(string, first, outcomes)
            scheduler.judged(string)
        self._simulated += len(seconds)
        self._work += sum(seconds)
        cost = self._costs.message + self._costs.sample * len(seconds)
        self._served += cost
        return now + cost

    def _times(self, load: Load) -> Iterator[float]:
        """Seconds that the samples of a batch take."""
        for string, first, count in load.pieces:
            yield from self._seconds[string][first : first + count]

    def _simulate(self, string: int, first: int, count: int) -> list[float]:
        """Seconds that samples take, the next ones of a string."""
        parameters = self.inversion.parameters(string)
        outcomes = self._outcomes.setdefault(string, [])
        seconds = self._seconds.setdefault(string, [])
        for sample in range(first, first + count):
            outcome, duration = self._workload.sample(string, parameters, sample)
            outcomes.append(outcome)
            seconds.append(duration)
        if self._simulated > MOST_SIMULATED:
            raise TooManySamples
        return seconds[first : first + count]

    def _abandon(self, end: float) -> None:
        """Count what ranks have done of the batches that they hold at the end."""
        for load in self._loads:
            times = list(accumulate(self._times(load), initial=load.begin))
            self._simulated += sum(time <= end for time in times[1:])
            self._work += max(0.0, min(end, times[-1]) - load.begin)

    def _forecast(self, seconds: float) -> Forecast:
        self._abandon(seconds)
        used = self.chain.used
        needed = {string: self._seconds[string][: used[string]] for string in used}
        return Forecast(
            ranks=self._ranks,
            seconds=seconds,
            busy=self._work / (seconds * self._ranks),
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
