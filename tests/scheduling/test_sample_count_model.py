"""How likely a sample is to be needed, after what other strings needed."""

from itertools import pairwise

import numpy as np
import pytest
from examples import examples
from hypothesis import strategies as st

from agglom_mpi.scheduling.estimators import SampleCountModel

USED = st.lists(st.integers(1, 40), max_size=60)


def model_of(used):
    model = SampleCountModel()
    for count in used:
        model.learn(count)
    return model


@examples(200, USED, st.integers(0, 50))
def test_the_chance_is_one_for_the_next_sample_and_falls_from_there(used, judged):
    model = model_of(used)
    probabilities = [model.probability(judged, sample) for sample in range(judged, judged + 60)]
    assert probabilities[0] == 1.0
    assert all(later < before for before, later in pairwise(probabilities))
    assert min(probabilities) > 0.0


@examples(200, USED, st.integers(0, 30), st.integers(0, 30))
def test_the_more_samples_were_not_enough_the_likelier_is_one_further_on(used, judged, ahead):
    model = model_of(used)
    sample = judged + 1 + ahead
    assert model.probability(judged + 1, sample) >= model.probability(judged, sample)


@examples(50, USED)
def test_the_order_of_experiences_does_not_matter(used):
    one, other = model_of(used), model_of(sorted(used, reverse=True))
    for judged in range(0, 20, 3):
        assert one.probability(judged, judged + 5) == other.probability(judged, judged + 5)
    assert one.mean == other.mean == (pytest.approx(np.mean(used)) if used else 0.0)


def test_without_experience_twice_the_samples_are_as_likely_as_not():
    model = SampleCountModel()
    for judged in (0, 1, 9, 99):
        assert model.probability(judged, 2 * (judged + 1) - 1) == 0.5


def test_the_chance_approaches_how_often_strings_needed_it():
    used = np.random.default_rng(3).geometric(0.1, 1000)
    model = model_of(used.tolist())
    for judged, sample in ((0, 5), (0, 30), (4, 10), (10, 11)):
        survivors = int(np.sum(used > judged))
        share = np.sum(used > sample) / survivors
        # The guess, between 0 and 1, counts as one string more.
        assert abs(model.probability(judged, sample) - share) <= 1 / (survivors + 1)


def test_a_string_beyond_all_experience_goes_by_the_guess():
    model = model_of([3] * 1000)
    assert model.probability(9, 19) == 0.5
    assert model.probability(0, 5) == pytest.approx(0.0, abs=1e-3)
