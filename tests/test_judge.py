"""Whoever simulates a string ends it at the sample where the ensemble does, bit for bit."""

import numpy as np
import pytest
from examples import examples
from goals import growth_target, maximum_growth
from hypothesis import strategies as st
from rules import difference, half_width, settled_moments

from agglom_mpi.judge import take_samples
from agglom_mpi.outcome import FAILED_SUMMARY
from agglom_mpi.search.ensemble import Ensemble, can_be_judged
from agglom_mpi.search.racing import Racing

MOST = 40
RULES = [
    *(difference(tolerance, quantity, max_samples=MOST) for tolerance in (1e-12, 1e-3, 1.0)
      for quantity in ("mean_radius", "objective")),
    *(half_width(tolerance, max_samples=MOST) for tolerance in (0.02, 0.3)),
]  # fmt: skip
OBJECTIVES = [growth_target(), growth_target(1.25), maximum_growth(100.0)]


def outcome(ratio, left):
    return FAILED_SUMMARY._replace(completed=True, mean_radius_ratio=ratio, particles=left)


def judge_from(ensemble):
    """Return a judge that goes on where an ensemble is."""
    return ensemble.judge(ensemble.means, MOST)


@examples(
    300,
    st.sampled_from(RULES),
    st.sampled_from(OBJECTIVES),
    st.lists(st.floats(1.0, 4.5), min_size=1, max_size=12),
    st.integers(0, MOST - 1),
)
def test_a_judge_ends_a_string_where_its_ensemble_does(rule, objective, values, begin):
    ratios = np.resize(values, MOST)
    left = np.arange(MOST) % 7 + 1
    ensemble, judge = Ensemble(rule, objective, 100), None
    for sample, ratio in enumerate(ratios.tolist()):
        if ensemble.finished:
            break
        if sample == begin:
            judge = judge_from(ensemble)
        ensemble.add(outcome(ratio, int(left[sample])))
    used = ensemble.samples_used
    if judge is not None:
        taken = take_samples(judge, np.full(MOST - begin, True), ratios[begin:], left[begin:])
        assert begin + taken == used
        assert judge.is_decided == ensemble._converged
        assert judge.state[0].item()[: len(ensemble.means)] == ensemble.means


def test_after_a_failed_sample_a_judge_ends_nothing():
    judge = judge_from(Ensemble(RULES[-1], OBJECTIVES[0], 100))
    completed = np.arange(MOST) != 3
    assert take_samples(judge, completed, np.ones(MOST), np.ones(MOST, int)) == MOST
    assert judge.state["completed"][0] == 3


@pytest.mark.parametrize(
    ("rule", "objective"),
    [
        (settled_moments(1e-2, 4), OBJECTIVES[0]),
        (difference(0.1, racing=Racing()), OBJECTIVES[0]),
    ],
)
def test_what_means_do_not_decide_alone_has_no_judge(rule, objective):
    assert can_be_judged(RULES[0], objective)
    assert not can_be_judged(rule, objective)
