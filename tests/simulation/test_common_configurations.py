"""Sample k of all strings from the same random numbers, where a campaign asks for it."""

import numpy as np
from campaign_runs import QUICKSTART

from agglom_mpi.config.campaign import Campaign
from agglom_mpi.random_streams import sample_stream
from agglom_mpi.verbs.simulate import simulate

TEXT = QUICKSTART.read_text()
OWN = Campaign.from_text(TEXT)
COMMON = Campaign.from_text(
    TEXT.replace("max_samples: 150", "max_samples: 150\n  common_configurations: true")
)
SAMPLES = range(12)


def ratios(of, **values):
    return [simulate(of, values, k).mean_radius_ratio for k in SAMPLES]


def test_strings_that_hardly_differ_end_alike_only_with_common_configurations():
    near, far = {"friction": 0.3}, {"friction": 0.3 * (1.0 + 1e-9)}
    # Chaos multiplies what they differ by, in a sample of some hundred collisions.
    shared = np.isclose(ratios(COMMON, **near), ratios(COMMON, **far), rtol=1e-3)
    assert shared.mean() > 0.5
    own = np.isclose(ratios(OWN, **near), ratios(OWN, **far), rtol=1e-3)
    assert own.mean() < 0.25  # as few by chance


def test_samples_of_one_string_differ():
    assert len(set(ratios(COMMON))) > 6


def test_the_stream_has_nothing_of_the_string_but_all_of_seed_and_sample():
    strings = np.random.default_rng(0).random((2, 10))
    first, second = (sample_stream(3, string, 4, common=True) for string in strings)
    assert first.random() == second.random()
    drawn = {
        sample_stream(seed, strings[0], sample, common=common).random()
        for seed in (3, 4)
        for sample in (4, 5)
        for common in (False, True)
    }
    assert len(drawn) == 8


def test_a_campaign_with_common_configurations_is_another_one():
    assert COMMON.identity()["ensemble.common_configurations"] is True
    assert "ensemble.common_configurations" not in OWN.identity()
