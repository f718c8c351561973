"""The real decisions and scheduler of a campaign on simulated ranks, in simulated time."""

import heapq
import math
from collections import deque
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from functools import partial
from typing import Final, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.judge import Judge, samples_needed
from agglom_mpi.outcome import COMPLETED
from agglom_mpi.planning.forecast import FREE, MAX_SIMULATED, Forecast, MessageCosts
from agglom_mpi.scheduling.interface import ReturnedPart, means_of
from agglom_mpi.scheduling.scheduler import Scheduler
from agglom_mpi.search.decisions import Decision, StringEvaluated, StringsProposed
from agglom_mpi.search.inversion import Inversion
from agglom_mpi.search.proposals import AGAIN, MODEL, OFFSPRING

BLOCK: Final = 16
"""Minimum number of samples of a string that are drawn from a workload at once."""

PROGRESS_MESSAGES: Final = 500
"""Number of messages between two reports of the progress."""


class SampleInFlight(NamedTuple):
    """A sample in flight on a simulated rank.

    Attributes
    ----------
    string
        Its string.
    seconds
        Its time, s.
    needed
        Whether it is not withdrawn.
    sample
        Its number.
    ends
        Whether it is the last one of its task.
    leaves_out
        Whether those after it in the task were left out.
    begin
        Time in s that the rank takes before it: it is the first one of its task.
    """

    string: int
    seconds: float
    needed: bool = True
    sample: int = 0
    ends: bool = False
    leaves_out: bool = False
    begin: float = 0.0


def returned_parts(samples: Iterable[SampleInFlight]) -> Iterator[ReturnedPart]:
    """Yield what a rank returns of its tasks."""
    task: list[SampleInFlight] = []
    for sample in samples:
        task.append(sample)
        if sample.ends:
            done = sum(each.needed for each in task)
            left_out = sample.leaves_out or done < len(task)
            yield ReturnedPart(sample.string, task[0].sample, done, left_out)
            task.clear()


class SimulatedRank:
    """Batches in flight on a simulated rank, which processes them in order of arrival.

    Attributes
    ----------
    free_at
        Time at which the rank has finished its earlier batches, s.
    batches
        Arrival time (s) and samples of each batch.
    """

    def __init__(self) -> None:
        self.free_at = 0.0
        self.batches: deque[tuple[float, list[SampleInFlight]]] = deque()

    def put(self, now: float, samples: list[SampleInFlight]) -> None:
        """Add a batch that arrives at time `now`, s."""
        self.batches.append((now, samples))

    @property
    def end(self) -> float:
        """Time at which the first batch is finished, s."""
        received, samples = self.batches[0]
        spent = sum(sample.begin + sample.seconds for sample in samples)
        return max(self.free_at, received) + spent

    def take(self) -> list[SampleInFlight]:
        """Remove and return the first batch, which is finished."""
        self.free_at = self.end
        return self.batches.popleft()[1]

    def cancel(self, now: float, strings: Collection[int]) -> None:
        """Drop samples of some strings that are not finished at time `now`, s."""
        for samples, place, end in list(self.schedule()):
            sample = samples[place]
            if sample.string in strings and end > now:
                spent = max(0.0, now - (end - sample.seconds))
                samples[place] = sample._replace(seconds=spent, needed=False)

    def schedule(self) -> Iterator[tuple[list[SampleInFlight], int, float]]:
        """Yield batch, index in it, and end time (s) of every sample in flight."""
        end = self.free_at
        for received, samples in self.batches:
            end = max(end, received)
            for place, sample in enumerate(samples):
                end += sample.begin + sample.seconds
                yield samples, place, end


class Workload(Protocol):
    """Results and durations of samples."""

    def samples(
        self, parameters: NDArray[np.float64], first: int, count: int
    ) -> tuple[NDArray[np.void], NDArray[np.float64]]:
        """Return rows with the columns of `OUTCOME`, and times in s, (count,) each.

        Both are always the same for the same string, (k,), and sample.
        """


class DrawnSamples:
    """Samples of a string, drawn from a workload in blocks.

    Attributes
    ----------
    seconds
        Times of the samples drawn so far, s.
    """

    def __init__(self, workload: Workload, parameters: NDArray[np.float64]) -> None:
        self._draw = partial(workload.samples, parameters)
        self._rows: list[NDArray[np.void]] = []
        self.seconds: list[float] = []

    def rows(self, first: int, count: int) -> NDArray[np.void]:
        """Return rows, (count,), of samples from `first` on."""
        self.draw(first + count)
        return self._rows[0][first : first + count]

    def needed(self, first: int, count: int, judge: Judge) -> int:
        """Return how many of `count` samples from `first` on a judge asks for."""
        taken = 0
        while taken < count and not judge.is_decided:
            rows = self.rows(first + taken, min(count - taken, max(BLOCK, taken)))
            completed = rows["state"] == COMPLETED
            numbers = rows["mean_radius_ratio"], rows["particles"]
            taken += samples_needed(judge, completed, *numbers)
        return taken

    def draw(self, count: int) -> None:
        """Draw the first `count` samples, if they are not yet."""
        known = len(self.seconds)
        if count > known:
            rows, seconds = self._draw(known, max(count - known, known, BLOCK))
            self._rows = [np.concatenate([*self._rows, rows])]
            self.seconds.extend(seconds.tolist())


class TooManySamples(Exception):  # noqa: N818  (a condition, as StopIteration)
    """A forecast takes more than `MAX_SIMULATED` samples."""


class CriticalPath:
    """Strings that depend on results of earlier generations, and samples that all strings used.

    Parameters
    ----------
    lag
        Generation g depends on the results of generations up to g - `lag`.

    Attributes
    ----------
    dependent
        Dependent strings of each generation.
    used
        Number of samples used of each string.
    """

    def __init__(self, lag: int) -> None:
        self.dependent: list[list[int]] = []
        self.used: dict[int, int] = {}
        self._lag = lag

    def seconds(self, longest: list[float]) -> float:
        """Return the length of the path, s, from the longest time of each generation, s."""
        decided: list[float] = []
        for generation, seconds in enumerate(longest):
            begin = decided[generation - self._lag] if generation >= self._lag else 0.0
            decided.append(max([begin + seconds, *decided[-1:]]))
        return decided[-1]

    def record(self, decisions: Iterable[Decision]) -> None:
        """Record the dependent strings of a generation, and samples used of evaluated strings."""
        for decision in decisions:
            match decision:
                case StringsProposed(proposals, strings, ahead=False):
                    learnt = np.isin(proposals.origin, (OFFSPRING, MODEL, AGAIN))
                    learnt |= proposals.generation == 0
                    self.dependent.append(strings[learnt].tolist())
                case StringEvaluated(string, result):
                    self.used[string] = result.samples_used


class ClusterSimulator:
    """Discrete-event simulation of a campaign on a number of ranks.

    Rank 0 simulates samples beside handling messages, as in a run.

    Parameters
    ----------
    inversion
        The inversion, before its first generation.
    workload
        Results and durations of samples.
    ranks
        Number of ranks; all of them simulate.
    costs
        Costs of messages and decisions; a lone rank does not wait for messages.
    lag
        Generation g depends on the results of generations up to g - `lag`.
    known
        Samples that strings have used before, from which the scheduler has learnt.

    Attributes
    ----------
    inversion
        The inversion.
    path
        The critical path, as observed.
    first
        The forecast at the end of the first generation; None before.
    """

    def __init__(
        self,
        inversion: Inversion,
        workload: Workload,
        ranks: int,
        costs: MessageCosts = FREE,
        lag: int = 1,
        known: Sequence[int] = (),
    ) -> None:
        self.path = CriticalPath(lag)
        self.first: Forecast | None = None
        self._known = known
        self.inversion = inversion
        self._workload = workload
        self._costs = costs if ranks > 1 else costs._replace(latency=0.0)
        self._ranks = [SimulatedRank() for _ in range(ranks)]
        self._arrivals: list[tuple[float, int, int]] = []  # a heap: time, number, rank
        self._expected = [0] * ranks  # number of the valid arrival of each rank
        self._number = 0
        self._drawn: dict[int, DrawnSamples] = {}
        self._assigned = 0
        self._simulated = 0
        self._work = 0.0
        self._served = self._learnt = 0.0

    def run(
        self,
        most: float = math.inf,
        show: Callable[[int, int], None] = lambda generation, samples: None,
    ) -> Forecast:
        """Run the campaign and return the forecast; may raise TooManySamples.

        Parameters
        ----------
        most
            Number of samples after which the run ends early, with at least one string complete.
        show
            Called with the generation and the number of samples from time to time.
        """
        self.path.record(self.inversion.start())
        ranks = len(self._ranks)
        scheduler = Scheduler(self.inversion, self._propose_ahead, ranks, used=self._known)
        scheduler.batch_sizer.round_trip = 2.0 * (self._costs.latency + self._costs.message)
        now = 0.0
        while not self.inversion.finished:
            arrival, rank = self._next_arrival()
            if arrival > now:
                now = self._assign(scheduler, now)
                arrival, rank = self._next_arrival()
            now = self._receive(scheduler, max(now, arrival), rank)
            if self.first is None and self.inversion.generation and not self.inversion.finished:
                self.first = self._forecast(now)
            if self._simulated > most and self.path.used:
                break
            if self._number % PROGRESS_MESSAGES == 0:
                show(self.inversion.generation, self._assigned)
        return self._forecast(now)

    @property
    def samples_used(self) -> int:
        """Number of samples used, those of strings under way included."""
        return sum(self._used().values())

    def _propose_ahead(self, generations: int) -> Sequence[int]:
        proposed = self.inversion.propose_ahead(generations)
        return () if proposed is None else proposed.strings.tolist()

    def _next_arrival(self) -> tuple[float, int]:
        """Return time (s) and rank of the next arrival at rank 0; infinity if there is none."""
        while self._arrivals:
            arrival, number, rank = self._arrivals[0]
            if self._expected[rank] == number:
                return arrival, rank
            heapq.heappop(self._arrivals)
        return math.inf, -1

    def _expect(self, rank: int) -> None:
        """Reschedule the arrival of a rank's first batch."""
        self._number += 1
        self._expected[rank] = self._number
        if self._ranks[rank].batches:
            arrival = self._ranks[rank].end + self._costs.latency
            heapq.heappush(self._arrivals, (arrival, self._number, rank))

    def _assign(self, scheduler: Scheduler, now: float) -> float:
        """Send cancellations and assignments from rank 0; return the time when all are sent, s."""
        for rank, strings in scheduler.cancellations():
            now = self._serve(now, self._costs.message)
            self._ranks[rank].cancel(now + self._costs.latency, strings.tolist())
            self._expect(rank)
        for rank, tasks in scheduler.assignments(now):
            now = self._serve(now, self._costs.message)
            samples = [sample for task in tasks for sample in self._samples(task)]
            self._ranks[rank].put(now + self._costs.latency, samples)
            if len(self._ranks[rank].batches) == 1:
                self._expect(rank)
        return now

    def _serve(self, now: float, seconds: float) -> float:
        """Add `seconds` to the busy time of rank 0; return the time afterwards, s."""
        self._served += seconds
        return now + seconds

    def _receive(self, scheduler: Scheduler, now: float, rank: int) -> float:
        """Complete the first batch of a rank on rank 0; return the time afterwards, s."""
        samples = self._ranks[rank].take()
        spent = sum(sample.seconds for sample in samples)
        self._expect(rank)
        done = [sample for sample in samples if sample.needed]
        scheduler.heartbeat(rank, now)
        scheduler.batch_sizer.learn([sample.seconds for sample in done])
        parts = 0
        for part in returned_parts(samples):
            scheduler.returned(rank, part)
            if part.size:
                parts += 1
                rows = self._drawn[part.string].rows(part.first, part.size)
                self.path.record(self.inversion.complete(part.string, part.first, rows))
            scheduler.update(part.string)
        self._simulated += len(done)
        self._work += spent
        costs = self._costs
        now = self._serve(now, costs.message + costs.part * parts + costs.sample * len(done))
        scheduler.batch_sizer.learn_cost(self._served - self._learnt, 1, len(done))
        self._learnt = self._served
        return now

    def _samples(self, task: np.void) -> list[SampleInFlight]:
        """Return the samples of a task, a record of `task_type`, that its rank simulates."""
        string, first, count = (int(task[name]) for name in ("string", "first", "count"))
        drawn = self._drawn.get(string)
        if drawn is None:
            parameters = self.inversion.parameters(string)
            drawn = self._drawn[string] = DrawnSamples(self._workload, parameters)
        most = count
        if task["judged"]:
            judge = self.inversion.judge(string, means_of(task), count)
            count = drawn.needed(first, count, judge)
        drawn.draw(first + count)
        self._assigned += count
        if self._assigned > MAX_SIMULATED:
            raise TooManySamples
        seconds = drawn.seconds[first : first + count]
        samples = [SampleInFlight(string, each, sample=first + i) for i, each in enumerate(seconds)]
        samples[0] = samples[0]._replace(begin=self._costs.task)
        samples[-1] = samples[-1]._replace(ends=True, leaves_out=count < most)
        return samples

    def _count_in_flight(self, end: float) -> None:
        """Count the work done by time `end` on batches that are still in flight."""
        for rank in self._ranks:
            for samples, place, ends in rank.schedule():
                spent = samples[place].seconds - max(0.0, ends - end)
                self._simulated += samples[place].needed and ends <= end
                self._work += max(0.0, spent)

    def _used(self) -> dict[int, int]:
        """Return the number of samples used of each string, those under way included."""
        under_way = self.inversion.open_strings.items()
        begun = {string: progress.next_sample for string, progress in under_way}
        return self.path.used | {string: count for string, count in begun.items() if count}

    def _forecast(self, seconds: float) -> Forecast:
        if self.inversion.finished:  # of a part, what is in flight belongs to the rest
            self._count_in_flight(seconds)
        used = self._used()
        needed = {string: self._drawn[string].seconds[: used[string]] for string in used}
        return Forecast(
            ranks=len(self._ranks),
            seconds=seconds,
            busy=self._work / (seconds * len(self._ranks)),
            simulated=self._simulated,
            used=sum(used.values()),
            work=sum(map(sum, needed.values())),
            chain=self.path.seconds(
                [
                    max(
                        (max(needed.get(string, ()), default=0.0) for string in strings),
                        default=0.0,
                    )
                    for strings in self.path.dependent
                ]
            ),
            master=self._served / seconds,
        )
