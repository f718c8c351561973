from types import SimpleNamespace

from agglom_mpi.analysis.resimulation import COMPARED, samples_that_differ
from agglom_mpi.storage.reader import read_inversion
from agglom_mpi.storage.recorded_campaign import recorded_campaign
from agglom_mpi.verbs.simulate import simulate


def test_samples_that_give_another_row_are_named_and_others_not(finished):
    data = read_inversion(finished)
    campaign = recorded_campaign(data)
    assert list(samples_that_differ(data, campaign)) == []
    other = SimpleNamespace(
        first_sample=campaign.first_sample,
        user_function=None,
        simulate=lambda string, sample: simulate(campaign, string, sample + 1),
    )
    lines = list(samples_that_differ(data, other))
    assert len(lines) == COMPARED
    assert all(line.startswith("samples: sample ") for line in lines)
