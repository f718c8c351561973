"""What a message costs rank 0, measured by the real path with ranks that answer at once."""

import random

import pytest
from campaign_runs import TINY, write_campaign

from agglom_mpi.config.loading import load_campaign
from agglom_mpi.planning.message_costs import (
    MPI_SECONDS,
    PollCost,
    fitted_costs,
    measured_costs,
    poll_costs,
)
from agglom_mpi.planning.pilot import run_pilot
from agglom_mpi.planning.workload import EmpiricalWorkload
from agglom_mpi.runtime.experiment import InversionExperiment


@pytest.fixture(scope="module")
def measured(tmp_path_factory):
    """A campaign, and results of some of its samples."""
    path = write_campaign(tmp_path_factory.mktemp("costs") / "tiny.yaml", **TINY)
    campaign = load_campaign(path)
    samples = run_pilot(campaign, 1.0, lambda text: None)
    return InversionExperiment(campaign), EmpiricalWorkload(samples, campaign)


def test_costs_are_those_that_polls_are_made_of():
    chance, polls = random.Random(1), []
    for _ in range(300):
        messages = chance.randint(1, 4)
        parts = sum(chance.randint(1, 5) for _ in range(messages))
        samples = sum(chance.randint(1, 30) for _ in range(parts))
        closed = int(chance.random() < 0.02)
        seconds = 40e-6 * messages + 5e-6 * parts + 1e-6 * samples + 0.1 * closed
        polls.append(PollCost(seconds, messages, parts, samples, closed))
    costs = fitted_costs(polls)
    assert 2.0 * (costs.message - MPI_SECONDS) == pytest.approx(40e-6, rel=1e-3)
    assert (costs.part, costs.sample) == pytest.approx((5e-6, 1e-6), rel=1e-3)


def test_polls_that_cost_much_once_hardly_count():
    chance = random.Random(2)
    lengths = [(chance.randint(1, 4), chance.randint(1, 100)) for _ in range(200)]
    polls = [PollCost(50e-6 * m + 1e-6 * m * n, m, m, m * n, 0) for m, n in lengths]
    noisy = [poll._replace(seconds=poll.seconds * chance.uniform(0.8, 1.2)) for poll in polls]
    noisy[0] = noisy[0]._replace(seconds=0.1)
    costs = fitted_costs(noisy)
    assert 2.0 * (costs.message - MPI_SECONDS) + costs.part == pytest.approx(50e-6, rel=0.2)
    assert costs.sample == pytest.approx(1e-6, rel=0.2)


def test_no_cost_is_negative():
    polls = [PollCost(1e-3 / n, n, n, n, 0) for n in range(1, 9)]
    assert min(fitted_costs(polls)) >= 0.0


def test_ranks_that_answer_at_once_take_a_campaign_to_its_end(measured):
    polls = poll_costs(*measured, ranks=3, drawn={})
    assert all(1 <= poll.messages <= poll.parts <= poll.samples for poll in polls)
    assert min(poll.seconds for poll in polls) >= 0.0
    table = measured[0].table_sizes
    assert sum(poll.generations for poll in polls) <= table.generations
    assert sum(poll.samples for poll in polls) <= table.strings * table.max_samples


def test_a_measurement_says_what_it_does(measured):
    shown = []
    costs = measured_costs(*measured, shown.append)
    assert costs.message + costs.part > MPI_SECONDS
    assert shown
