"""What messages cost rank 0 on this machine, measured with ranks that answer at once.

The decisions, the scheduler, the coordinator and the campaign file are those of a run. Only the
ranks are not: `InstantRanks` returns rows of a workload instead of simulating.
"""

import tempfile
import time
from collections import deque
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Final, NamedTuple, cast

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls

from agglom_mpi.display.run_display import Display
from agglom_mpi.planning.forecast import MessageCosts
from agglom_mpi.planning.workload import DrawnSamples, Workload
from agglom_mpi.runtime.coordinator import Coordinator
from agglom_mpi.runtime.experiment import Experiment
from agglom_mpi.runtime.file_setup import prepare
from agglom_mpi.runtime.messages import PART, RankMessage
from agglom_mpi.runtime.silence import GoneRanks
from agglom_mpi.runtime.stop_request import StopRequest
from agglom_mpi.runtime.worker_pool import WorkerPool
from agglom_mpi.scheduling.estimators import RANGE_SECONDS, ROUND_TRIP_SECONDS
from agglom_mpi.scheduling.interface import means_of
from agglom_mpi.search.ensemble import judge_of
from agglom_mpi.search.inversion import Inversion
from agglom_mpi.storage.schema import samples_schema
from agglom_mpi.storage.table import checksums, fitted
from agglom_mpi.storage.writer import CampaignWriter

LATENCY: Final = 2e-3
"""Time until a message is read, s: a rank polls every 4 ms, more often while messages arrive."""

MPI_SECONDS: Final = 8e-6
"""Time of MPI to send or to receive a message, s: two ranks on one machine exchange 120 000 to
380 000 raw buffers per second. Measuring it would take a second rank."""

ARRIVED_TOGETHER: Final = 4
"""Number of messages that rank 0 finds when it polls."""

SHORT_SECONDS: Final = 4e-4
"""Stated time of a sample, s: one rank gets up to fifty in a batch."""

INSTANT_RANKS: Final = (64, 4, 1)
"""Numbers of ranks that answer at once. The fewer there are, the longer are the batches that the
scheduler makes: it divides a generation among them."""

MEASURED_SECONDS: Final = 0.5
"""Time for each number of ranks, s."""


OUTLIER: Final = 4.0
"""Maximum excess of a poll's cost over the fit, relative to the median deviation from it."""

REFITS: Final = 3
"""Number of fits without the polls that are outliers of the one before."""

ROUNDING: Final = 1e-6
"""Excess relative to a cost that is only rounding."""


WARM_UP_POLLS: Final = 8
"""Number of polls that are not measured: at its start, rank 0 proposes strings of several
generations and puts them into its queues."""

LEAST_POLLS: Final = 20
"""Minimum number of measured polls of a campaign, or all polls count: it has few samples."""


class PollCost(NamedTuple):
    """Processor time of rank 0, s, for what one poll has brought, and how much that was."""

    seconds: float
    messages: int
    parts: int
    samples: int
    generations: int


class InstantRanks:
    """Stands in for a `WorkerPool`: ranks whose samples take no time.

    It measures the time that the coordinator spends between two polls.

    Parameters
    ----------
    experiment
        What is simulated.
    workload
        Results of the samples.
    inversion
        The decisions of the coordinator.
    dtype
        Row type of the results.
    ranks
        Number of ranks.
    drawn
        Samples by string, which later measurements of the same campaign use again.

    Attributes
    ----------
    costs
        One for each poll that brought something.
    """

    round_trip = ROUND_TRIP_SECONDS
    database_seconds = 0.0

    def __init__(
        self,
        experiment: Experiment,
        workload: Workload,
        inversion: Inversion,
        dtype: np.dtype,
        ranks: int,
        drawn: dict[int, DrawnSamples],
    ) -> None:
        self.size = ranks
        self.hosts: dict[int, str] = {}
        self.missing, self.deserted = set[int](), set[int]()
        self.gone = GoneRanks()
        self.costs: list[PollCost] = []
        self._experiment = experiment
        self._workload = workload
        self._inversion = inversion
        self._dtype = dtype
        self._drawn = drawn
        self._held: deque[tuple[int, NDArray[np.void]]] = deque()
        self._brought: tuple[int, int, int] = 0, 0, 0
        self._generation = 0
        self._begun = time.thread_time()

    def send(self, rank: int, tasks: NDArray[np.void]) -> None:
        """Take a batch for a rank."""
        self._held.append((rank, tasks))

    def cancel(self, rank: int, strings: NDArray[np.int64]) -> None:
        """Take a message on unnecessary samples; it changes nothing."""

    def sync(self) -> None:
        """Nobody else writes the file."""

    def shut_down(self, code: int, silent: object = ()) -> Iterator[RankMessage]:
        """Return no more messages."""
        return iter(())

    def poll(self) -> Iterator[RankMessage]:
        """Return the results of some batches."""
        spent = time.thread_time() - self._begun  # by rank 0, since the last poll
        generations = self._inversion.generation - self._generation
        self._generation += generations
        if self._brought[0]:
            self.costs.append(PollCost(spent, *self._brought, generations))
        held = [self._held.popleft() for _ in range(min(ARRIVED_TOGETHER, len(self._held)))]
        messages = [self._report(rank, tasks) for rank, tasks in held]
        parts = sum(len(message.parts) for message in messages)
        self._brought = len(messages), parts, sum(len(message.results) for message in messages)
        if not held:
            time.sleep(1e-3)  # a search proposes in a thread of its own
        self._begun = time.thread_time()
        return iter(messages)

    def _report(self, rank: int, tasks: NDArray[np.void]) -> RankMessage:
        """Return the samples of a batch, with the checksums that a rank gives them."""
        parts = np.zeros(len(tasks), PART)
        found = [self._rows(task, part) for task, part in zip(tasks, parts, strict=True)]
        rows = fitted(np.concatenate(found), self._dtype)
        rows["rank"] = rank
        rows["seconds"] = rows["cpu_seconds"] = SHORT_SECONDS
        rows["crc"] = checksums(rows)
        return RankMessage(rank, rows, parts)

    def _rows(self, task: np.void, part: np.void) -> NDArray[np.void]:
        """Return rows of the samples of a task, and fill the record of what is done of it."""
        string, first, count = (int(task[name]) for name in ("string", "first", "count"))
        drawn = self._drawn.get(string)
        if drawn is None:
            drawn = self._drawn[string] = DrawnSamples(self._workload, task["parameters"].copy())
        size = count
        if task["judged"]:
            campaign = self._experiment.setup(string).campaign
            objective = campaign.objective_at(task["parameters"])
            particles = campaign.scene.particles
            judge = judge_of(campaign.ensemble, objective, particles, means_of(task), count)
            size = drawn.needed(first, count, judge)
        rows = drawn.rows(first, size).copy()
        rows["string"], rows["sample"] = string, np.arange(first, first + size)
        part["string"], part["first"], part["size"] = string, first, size
        part["left_out"] = size < count
        return rows


class _Limit(StopRequest):
    """Ends a measurement some time after the first polls, or when all is decided."""

    def __init__(self, inversion: Inversion, ranks: InstantRanks) -> None:
        super().__init__()
        self._inversion = inversion
        self._ranks = ranks
        self._begun: float | None = None

    @property
    def reason(self) -> str:
        """The reason to stop, as text."""
        if self._inversion.finished:
            return "all is decided"
        if self._begun is None and len(self._ranks.costs) >= WARM_UP_POLLS:
            self._begun = time.monotonic()
        late = self._begun is not None and time.monotonic() - self._begun > MEASURED_SECONDS
        return "enough is measured" if late else ""


def measured_costs(
    experiment: Experiment, workload: Workload, show: Callable[[str], None] = lambda text: None
) -> MessageCosts:
    """Return the costs of messages, measured in a second or two.

    Parameters
    ----------
    experiment
        Work to forecast.
    workload
        Results of its samples.
    show
        Called with a line on the progress.

    Raises
    ------
    CampaignError, OSError
        If there is no room for a temporary campaign file.
    """
    costs: list[PollCost] = []
    drawn: dict[int, DrawnSamples] = {}
    for ranks in INSTANT_RANKS:
        show("measuring what messages cost rank 0")
        costs += poll_costs(experiment, workload, ranks, drawn)
    return fitted_costs(costs)


def poll_costs(
    experiment: Experiment, workload: Workload, ranks: int, drawn: dict[int, DrawnSamples]
) -> list[PollCost]:
    """Return what each poll costs rank 0, with a number of ranks that answer at once."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "costs.h5"
        file = prepare(path, experiment, accept_code_change=False)
        with CampaignWriter(path) as writer:
            coordinator = Coordinator(experiment, file, writer, Display(quiet=True))
            inversion, dtype = (
                coordinator.inversion,
                samples_schema(file.sizes.quantities, file.sizes.census).dtype,
            )
            coordinator.replay(StopRequest())
            pool = InstantRanks(experiment, workload, inversion, dtype, ranks, drawn)
            coordinator.run(cast(WorkerPool, pool), _Limit(inversion, pool))
    measured = pool.costs[WARM_UP_POLLS:]
    return measured if len(measured) >= LEAST_POLLS else pool.costs


def fitted_costs(costs: list[PollCost]) -> MessageCosts:
    """Return the costs that explain those of polls best, none of them negative.

    What a generation costs is no part of them: it does not depend on messages.
    """
    table = np.array(costs, float).reshape(-1, len(PollCost._fields))
    found, _ = nnls(table[:, 1:], table[:, 0])
    for _ in range(REFITS):  # without what cost much once, as what is loaded for the first time
        excess = table[:, 0] - table[:, 1:] @ found
        table = table[excess <= OUTLIER * np.median(np.abs(excess)) + ROUNDING * table[:, 0]]
        found, _ = nnls(table[:, 1:], table[:, 0])
    message, part, sample, _ = found.tolist()
    return MessageCosts(LATENCY, message / 2.0 + MPI_SECONDS, sample, part, RANGE_SECONDS)
