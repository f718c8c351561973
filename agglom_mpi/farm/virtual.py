"""A cluster that is not there: the real scheduler and the real decisions, imaginary ranks."""

import heapq
from collections.abc import Callable
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.farm.scheduler import Scheduler
from agglom_mpi.search import OFFSPRING, Batch, EnsembleResult, GenerationSummary, Inversion
from agglom_mpi.search.inversion import Observer
from agglom_mpi.simulation.outcome import Measured


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

    latency: float = 0.0
    message: float = 0.0
    sample: float = 0.0


class Forecast(NamedTuple):
    """How a campaign would go.

    Attributes
    ----------
    ranks : int
    seconds
        From the first sample to the last decision.
    busy
        Share of the ranks' time in which they simulate.
    simulated, used
        Samples.
    bound
        Seconds that no scheduler could beat: all samples that are used, spread evenly; or one
        generation after the other, each as long as the longest sample of its offspring.
    chain
        The second of these two.
    master
        Share of the time in which rank 0 serves messages.
    """

    ranks: int
    seconds: float
    busy: float
    simulated: int
    used: int
    bound: float
    chain: float
    master: float


class Chain:
    """Observer that remembers which strings had to wait for the generation before theirs."""

    def __init__(self) -> None:
        self.waiting: list[list[int]] = []
        self.used: dict[int, int] = {}

    def announced(self, batch: Batch, ids: NDArray[np.int64]) -> None:
        """They wait for nothing."""

    def proposed(self, batch: Batch, ids: NDArray[np.int64]) -> None:
        """Take a generation."""
        bred = (batch.origin == OFFSPRING) | (batch.generation == 0)
        self.waiting.append(ids[bred].tolist())

    def judged(self, string: int, result: EnsembleResult) -> None:
        """Take the number of samples of a string."""
        self.used[string] = result.samples_used

    def generation_done(self, summary: GenerationSummary) -> None:
        """Nothing is to be remembered."""


class VirtualCluster:
    """Runs a campaign on ranks that only take time.

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
    """

    def __init__(
        self,
        make_inversion: Callable[[Observer], Inversion],
        workload: Workload,
        ranks: int,
        costs: Costs = Costs(),
    ) -> None:
        self._chain = Chain()
        self._inversion = make_inversion(self._chain)
        self._workload = workload
        self._ranks = ranks
        self._costs = costs
        self._arrivals: list[tuple[float, int, int, list[tuple[int, int, int]]]] = []
        self._free = [0.0] * ranks
        self._seconds: dict[int, list[float]] = {}
        self._outcomes: dict[int, list[Measured]] = {}
        self._sent = 0
        self._served = 0.0

    def run(self) -> Forecast:
        """Let time pass until all is decided."""
        self._inversion.start()
        scheduler = Scheduler(self._inversion, self._ranks)
        now = self._hand_out(scheduler, 0.0)
        while not self._inversion.finished:
            arrival, _, rank, pieces = heapq.heappop(self._arrivals)
            now = self._take(scheduler, max(now, arrival), rank, pieces)
            waits = bool(self._arrivals) and self._arrivals[0][0] <= now
            if not (waits or self._inversion.finished):
                now = self._hand_out(scheduler, now)
        return self._forecast(now)

    def _hand_out(self, scheduler: Scheduler, now: float) -> float:
        for rank, tasks in scheduler.assignments(now):
            now += self._costs.message
            self._served += self._costs.message
            pieces = tasks[["string", "first", "count"]].tolist()
            work = sum(sum(self._simulate(*piece)) for piece in pieces)
            self._free[rank] = max(self._free[rank], now + self._costs.latency) + work
            self._sent += 1
            arrival = self._free[rank] + self._costs.latency
            heapq.heappush(self._arrivals, (arrival, self._sent, rank, pieces))
        return now

    def _take(
        self, scheduler: Scheduler, now: float, rank: int, pieces: list[tuple[int, int, int]]
    ) -> float:
        scheduler.heard(rank, now)
        seconds = [self._seconds[i][first : first + count] for i, first, count in pieces]
        scheduler.returned(rank, sum(seconds, []))
        for string, first, count in pieces:
            outcomes = self._outcomes[string][first : first + count]
            self._inversion.accept(string, first, outcomes)
            scheduler.judged(string)
        cost = self._costs.message + self._costs.sample * sum(count for _, _, count in pieces)
        self._served += cost
        return now + cost

    def _simulate(self, string: int, first: int, count: int) -> list[float]:
        parameters = self._inversion.parameters(string)
        outcomes = self._outcomes.setdefault(string, [])
        seconds = self._seconds.setdefault(string, [])
        for sample in range(first, first + count):
            outcome, duration = self._workload.sample(string, parameters, sample)
            outcomes.append(outcome)
            seconds.append(duration)
        return seconds[first : first + count]

    def _forecast(self, seconds: float) -> Forecast:
        used = self._chain.used
        needed = {string: self._seconds[string][: used[string]] for string in used}
        chain = sum(
            max((max(needed[string]) for string in strings if string in needed), default=0.0)
            for strings in self._chain.waiting
        )
        work = sum(map(sum, needed.values()))
        simulated = sum(map(len, self._seconds.values()))
        return Forecast(
            self._ranks,
            seconds,
            sum(map(sum, self._seconds.values())) / (seconds * self._ranks),
            simulated,
            sum(used.values()),
            max(work / self._ranks, chain),
            chain,
            self._served / seconds,
        )
