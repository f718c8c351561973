"""What share of the best possible speed the scheduler reaches, on ranks that are imagined.

Run with `pytest tests/benchmarks/bench_virtual.py -m benchmark -s`, or as a program with the
seconds to simulate samples of each campaign for. Beside the scheduler's own shares, without and
with the usual costs, stand those of perfect foresight: the same scheduler, told which samples will
be used.
"""

import re
import sys
import time
from pathlib import Path

import pytest

from agglom_mpi.analysis.tables import time_on_free_core
from agglom_mpi.config.campaign import Campaign
from agglom_mpi.config.loading import load_campaign
from agglom_mpi.planning import cluster_simulator as virtual
from agglom_mpi.planning.cluster_simulator import ClusterSimulator
from agglom_mpi.planning.forecast import FREE, MessageCosts
from agglom_mpi.planning.pilot import run_pilot
from agglom_mpi.planning.workload import EmpiricalWorkload
from agglom_mpi.runtime.experiment import InversionExperiment
from agglom_mpi.scheduling.scheduler import Scheduler

JOBS = Path(__file__).parents[2] / "jobs"

SIZES = {
    "accretion_2003": ((20, 6, 25), (200, 60, 4), (2000, 600, 1)),
    "agglomeration_2004": ((20, 6, 25), (200, 60, 25), (2000, 600, 6)),
}
"""Populations with their parents and so many generations that all takes minutes."""

RANKS = (10, 100, 1000, 10_000)
MEASURE = 60.0
"""Seconds to simulate samples of a campaign for."""

USUAL = MessageCosts(latency=2e-3, message=25e-6, sample=1e-6)
"""Aimed at: 50 µs of rank 0 for a message there and back, and 1 µs for a sample."""

ROUNDING = 1e-9


class Foresight(Scheduler):
    """Hands out all samples that will be used, and no others; those of this generation first."""

    used: dict[int, int]

    def _probability(self, string, progress, sample):
        return float(sample < self.used.get(string, 0))

    def _range_limit(self, used):
        return 1

    def _next_range(self, string, progress, limit):
        piece = super()._next_range(string, progress, limit)
        _, first, count = piece
        return piece.split(min(count, self.used[string] - first))[0]


def sized(campaign, population, parents, generations):
    """Return the campaign with another population."""
    text = campaign.text
    for name, value in (("population", population), ("parents", parents)):
        text, count = re.subn(rf"\b{name}: \d+", f"{name}: {value}", text)
        assert count == 1, name
    return Campaign.from_text(text, campaign.name).with_generations(generations)


def forecast(campaign, rehearsal, ranks, costs=FREE, used=None):
    """Let the campaign run; the forecast and the samples that strings used."""
    work = InversionExperiment(campaign)
    with pytest.MonkeyPatch.context() as patch:
        if used is not None:
            patch.setattr(virtual, "Scheduler", type("Told", (Foresight,), {"used": used}))
        cluster = ClusterSimulator(work.inversion(None), rehearsal, ranks, costs)
        return cluster.run(), cluster.path.used


def print_shares(job, seconds=MEASURE):
    """Print the table of one campaign; all shares."""
    campaign = load_campaign(JOBS / f"{job}.yaml")
    recorded = run_pilot(campaign, seconds, lambda text: None)
    rehearsal, costs = EmpiricalWorkload(recorded, campaign), USUAL
    times, shares = time_on_free_core(recorded.rows), []
    print(
        f"\n{job}: {len(times)} samples of {len(recorded.parameters)} strings, mean "
        f"{times.mean() * 1e3:.2f} ms, longest {times.max() * 1e3:.1f} ms; costs: latency "
        f"{costs.latency * 1e3:g} ms, message {costs.message * 1e6:g} µs, sample "
        f"{costs.sample * 1e6:g} µs"
    )
    print(
        "population generations  ranks     best/s   share  wasted  foresight   with costs  limit"
        "      µs/sample"
    )
    for population, parents, generations in SIZES[job]:
        larger = sized(campaign, population, parents, generations)
        for ranks in RANKS:
            begin = time.perf_counter()
            free, used = forecast(larger, rehearsal, ranks)
            speed = (time.perf_counter() - begin) / free.simulated
            told, _ = forecast(larger, rehearsal, ranks, used=used)
            dear, _ = forecast(larger, rehearsal, ranks, costs)
            print(
                f"{population:<10} {generations:<12} {ranks:<6} {free.bound:9.4f}   "
                f"{free.reached:.3f}  {free.wasted:6.1%}      {told.reached:.3f}       "
                f"{dear.reached:.3f}  {dear.limit:<8} {speed * 1e6:.0f}",
                flush=True,
            )
            shares += [free.reached, told.reached, dear.reached]
    return shares


@pytest.mark.benchmark
@pytest.mark.parametrize("job", SIZES)
def test_print_the_share_of_the_best_possible_speed(job):
    assert max(print_shares(job)) <= 1.0 + ROUNDING


if __name__ == "__main__":
    for job in SIZES:
        print_shares(job, *map(float, sys.argv[1:]))
