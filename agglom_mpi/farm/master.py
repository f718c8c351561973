"""The loop of rank 0: hand out samples, judge what comes back, store it, stop in time."""

import time
from typing import Final, NamedTuple

from agglom_mpi.campaign import Campaign
from agglom_mpi.database.reader import CampaignFile
from agglom_mpi.database.writer import CampaignWriter
from agglom_mpi.exit_codes import FAILURE, FINISHED, STOPPED
from agglom_mpi.farm.books import Books, Stored, Watcher
from agglom_mpi.farm.clock import StopRequest
from agglom_mpi.farm.crew import Crew, Delivery
from agglom_mpi.farm.messages import POLL
from agglom_mpi.farm.scheduler import Scheduler
from agglom_mpi.search import (
    Ensemble,
    GeneticSearch,
    Inversion,
    SearchSpace,
    Target,
    make_objective,
    make_rule,
)
from agglom_mpi.simulation.outcome import EXCEPTION, FAILED, REASONS

TICK: Final = 0.5
"""Seconds between updates of the display."""


class End(NamedTuple):
    """How a run ended: exit code, state for the file, and why in words."""

    code: int
    state: str
    reason: str


def make_inversion(campaign: Campaign, stored: Stored, books: Books) -> Inversion:
    """Set up the search of a campaign, at its very beginning."""
    search, stopping = campaign.search, campaign.stopping
    rescale = search.rescale
    objective = make_objective(campaign.objective, campaign.scene.particles)
    rule = make_rule(campaign.ensemble)
    return Inversion(
        GeneticSearch(
            SearchSpace(campaign.variables.lower, campaign.variables.upper),
            campaign.seed,
            population=search.population,
            parents=search.parents,
            blend=search.blend,
            rescale=None if rescale is None else (rescale.every, rescale.factor),
        ),
        lambda: Ensemble(
            rule,
            objective,
            campaign.scene.particles,
            campaign.ensemble.min_samples,
            campaign.ensemble.max_samples,
        ),
        stopping.generations,
        None if stopping.target is None else Target(stopping.target.top, stopping.target.objective),
        stored.restore,
        books,
    )


class Master:
    """One leg of a campaign.

    Parameters
    ----------
    campaign, file, writer
        What to run, and where it is kept.
    watcher
        Shown how it goes.
    """

    def __init__(
        self, campaign: Campaign, file: CampaignFile, writer: CampaignWriter, watcher: Watcher
    ) -> None:
        self._campaign = campaign
        self._writer = writer
        self._watcher = watcher
        self._stored = Stored(file)
        self._failing: set[int] = set()
        top = campaign.stopping.target.top if campaign.stopping.target else campaign.search.parents
        self.books = Books(writer, self._stored, watcher, top)
        self.inversion = make_inversion(campaign, self._stored, self.books)

    def replay(self) -> bool:
        """Decide again what the stored samples decide; whether that finishes the campaign."""
        for row in self._stored.samples:
            self.inversion.accept(int(row["string"]), int(row["sample"]), row)
        self.books.failures = int((self._stored.samples["reason"] == EXCEPTION).sum())
        self.inversion.start()
        return self.inversion.finished

    def run(self, crew: Crew, stop: StopRequest) -> End:
        """Simulate until the campaign is finished or something asks to stop."""
        pairs = self._stored.samples[["string", "sample"]].tolist()
        scheduler = Scheduler(self.inversion, crew.size, pairs)
        self.books.begun = time.monotonic()
        shown = time.monotonic()
        while not self.inversion.finished:
            if stop.reason:
                return End(STOPPED, "stopped", stop.reason)
            if self.books.failures >= self._campaign.stopping.max_failures:
                return End(FAILURE, "failed", f"{self.books.failures} samples raised errors")
            self._hand_out(crew, scheduler)
            for delivery in crew.deliveries(POLL):
                self._take(scheduler, delivery)
            self._writer.flush_due()
            if time.monotonic() - shown > TICK:
                shown = time.monotonic()
                self._tick(crew, shown)
        return End(FINISHED, "finished", self.finished_because)

    def _hand_out(self, crew: Crew, scheduler: Scheduler) -> None:
        for _ in range(2):
            for rank in range(crew.size):
                tasks = scheduler.assign(rank)
                if len(tasks):
                    crew.send(rank, tasks)

    def _take(self, scheduler: Scheduler, delivery: Delivery) -> None:
        for failure in delivery.failures:
            self._report_exception(failure)
        if len(delivery.results):
            self.books.simulated(delivery.results)
        for row in delivery.results:
            string, sample = int(row["string"]), int(row["sample"])
            scheduler.returned(delivery.rank, string, sample, float(row["seconds"]))
            if row["state"] == FAILED:
                self._count_failure(row)
            self.inversion.accept(string, sample, row)

    def _count_failure(self, row) -> None:  # type: ignore[no-untyped-def]
        if row["reason"] == EXCEPTION:
            self.books.failures += 1
        elif row["string"] not in self._failing:
            self._failing.add(int(row["string"]))
            self._watcher.message(
                f"string {row['string']} sample {row['sample']} failed: {REASONS[row['reason']]}; "
                "more of this string are counted, not shown"
            )

    def _report_exception(self, failure) -> None:  # type: ignore[no-untyped-def]
        host, text = failure["host"].decode(), failure["text"].decode()
        self._writer.put_failure(
            int(failure["string"]),
            int(failure["sample"]),
            rank=int(failure["rank"]),
            host=host,
            text=text,
        )
        self._watcher.error(
            f"rank {failure['rank']} on {host}: string {failure['string']} sample "
            f"{failure['sample']} raised\n{text}"
        )

    def _tick(self, crew: Crew, now: float) -> None:
        elapsed = now - self.books.begun
        busy = self.books.busy_seconds / (elapsed * crew.size)
        samples = len(self._stored.samples) + self.books.samples
        self._watcher.tick(samples, self.books.rate, busy, len(self.inversion.live))

    @property
    def finished_because(self) -> str:
        """Why the search ended, in words."""
        if self.inversion.stop_reason == "target" and self._campaign.stopping.target is not None:
            target = self._campaign.stopping.target
            return f"the mean objective of the best {target.top} is at most {target.objective:g}"
        return f"all {self._campaign.stopping.generations} generations are done"
