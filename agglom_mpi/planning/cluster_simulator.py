"""The real decisions and scheduler of a campaign on simulated ranks, in simulated time."""

import heapq
import math
from collections import deque
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from agglom_mpi.planning.forecast import FREE, MAX_SIMULATED, Forecast, MessageCosts
from agglom_mpi.planning.workload import DrawnSamples, Workload
from agglom_mpi.scheduling.interface import ReturnedPart, means_of
from agglom_mpi.scheduling.scheduler import Scheduler
from agglom_mpi.search.inversion import Inversion
from agglom_mpi.search.proposals import (
    AGAIN,
    MODEL,
    OFFSPRING,
    Decision,
    StringEvaluated,
    StringsProposed,
)

PROGRESS_MESSAGES: Final = 500
"""Number of messages between two reports of the progress."""


@dataclass(slots=True)
class TaskInFlight:
    """A task in flight on a simulated rank."""

    string: int
    first: int
    """Its string, and the number of its first sample."""
    seconds: list[float]
    """Times of its samples, s, and of one that is withdrawn while it is under way."""
    done: int
    """How many of them are returned."""
    left_out: bool = False
    """Whether those after them are left out."""
    begin: float = 0.0
    """Time that the rank takes before the first, s."""


class SimulatedRank:
    """Batches in flight on a simulated rank, which processes them in order of arrival.

    Attributes
    ----------
    free_at
        Time at which the rank has finished its earlier batches, s.
    batches
        Arrival time (s) and tasks of each batch.
    """

    def __init__(self) -> None:
        self.free_at = 0.0
        self.batches: deque[tuple[float, list[TaskInFlight]]] = deque()

    def put(self, now: float, tasks: list[TaskInFlight]) -> None:
        """Add a batch that arrives at time `now`, s."""
        self.batches.append((now, tasks))

    @property
    def end(self) -> float:
        """Time at which the first batch is finished, s."""
        received, tasks = self.batches[0]
        spent = sum(seconds for task in tasks for seconds in _steps(task))
        return max(self.free_at, received) + spent

    def take(self) -> list[TaskInFlight]:
        """Remove and return the first batch, which is finished."""
        self.free_at = self.end
        return self.batches.popleft()[1]

    def cancel(self, now: float, strings: Collection[int]) -> None:
        """Drop samples of some strings that are not finished at time `now`, s."""
        for task, ends in list(self.schedule()):
            done = sum(end <= now for end in ends) if task.string in strings else len(ends)
            if done < len(ends):
                spent = max(0.0, now - (ends[done] - task.seconds[done]))
                task.seconds[done:] = [spent]
                task.done, task.left_out = done, True

    def schedule(self) -> Iterator[tuple[TaskInFlight, list[float]]]:
        """Yield every task in flight, and the times at which its samples end, s."""
        end = self.free_at
        for received, tasks in self.batches:
            end = max(end, received)
            for task in tasks:
                ends = [end := end + seconds for seconds in _steps(task)]
                yield task, ends


def _steps(task: TaskInFlight) -> list[float]:
    """Return the times that a rank takes for the samples of a task, s."""
    first, *others = task.seconds
    return [task.begin + first, *others]


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

    def seconds(self, needed: Mapping[int, Sequence[float]]) -> float:
        """Return the length of the path, s, from the times of the used samples of each string."""
        decided: list[float] = []
        for generation, strings in enumerate(self.dependent):
            longest = (max(needed.get(string, ()), default=0.0) for string in strings)
            seconds = max(longest, default=0.0)
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
            self._ranks[rank].put(now + self._costs.latency, [*map(self._begun, tasks)])
            if len(self._ranks[rank].batches) == 1:
                self._expect(rank)
        return now

    def _serve(self, now: float, seconds: float) -> float:
        """Add `seconds` to the busy time of rank 0; return the time afterwards, s."""
        self._served += seconds
        return now + seconds

    def _receive(self, scheduler: Scheduler, now: float, rank: int) -> float:
        """Complete the first batch of a rank on rank 0; return the time afterwards, s."""
        tasks = self._ranks[rank].take()
        self._expect(rank)
        done = [seconds for task in tasks for seconds in task.seconds[: task.done]]
        scheduler.in_flight.heartbeat(rank, now)
        scheduler.batch_sizer.learn(done)
        for task in tasks:
            part = ReturnedPart(task.string, task.first, task.done, task.left_out)
            scheduler.returned(rank, part)
            if part.size:
                rows = self._drawn[part.string].rows(part.first, part.size)
                self.path.record(self.inversion.complete(part.string, part.first, rows))
            scheduler.update(part.string)
        self._simulated += len(done)
        self._work += sum(seconds for task in tasks for seconds in task.seconds)
        costs, parts = self._costs, sum(task.done > 0 for task in tasks)
        now = self._serve(now, costs.message + costs.part * parts + costs.sample * len(done))
        scheduler.batch_sizer.learn_cost(self._served - self._learnt, 1, len(done))
        self._learnt = self._served
        return now

    def _begun(self, task: np.void) -> TaskInFlight:
        """Return what a rank simulates of a task, a record of `task_type`."""
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
        return TaskInFlight(string, first, seconds, count, count < most, self._costs.task)

    def _count_in_flight(self, end: float) -> None:
        """Count the work done by time `end` on batches that are still in flight."""
        for rank in self._ranks:
            for task, ends in rank.schedule():
                self._simulated += sum(each <= end for each in ends[: task.done])
                for seconds, its_end in zip(task.seconds, ends, strict=True):
                    self._work += max(0.0, seconds - max(0.0, its_end - end))

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
            chain=self.path.seconds(needed),
            master=self._served / seconds,
        )
