from dataclasses import replace

from agglom_mpi.analysis.resimulation import COMPARED, samples_that_differ
from agglom_mpi.storage.reader import read_inversion
from agglom_mpi.storage.recorded_campaign import recorded_campaign


def test_samples_that_give_another_row_are_named_and_others_not(finished):
    data = read_inversion(finished)
    campaign = recorded_campaign(data)
    assert list(samples_that_differ(data, campaign)) == []
    other = replace(campaign, seed=campaign.seed + 1)
    lines = list(samples_that_differ(data, other))
    assert len(lines) == COMPARED
    assert all(line.startswith("samples: sample ") for line in lines)
