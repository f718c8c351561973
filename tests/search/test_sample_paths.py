"""Ensembles that are given many samples at once do, bit for bit, what they do one by one."""

import numpy as np
import pytest
from examples import examples
from goals import growth_target, maximum_growth
from hypothesis import strategies as st
from rules import difference, ensemble_of, fixed, half_width, settled_moments
from search_fakes import PARTICLES, completed, failed
from summary_rows import rows_of

from agglom_mpi.config.loading import load_campaign
from agglom_mpi.outcome import summaries
from agglom_mpi.search.ensemble import Ensemble, can_be_judged
from agglom_mpi.search.sample_paths import SampleBatch, SamplePart, extend

RULES = (
    difference(1e-3),
    difference(1e-2, "mean_radius"),
    half_width(0.05),
    settled_moments(0.05, 3),
    fixed(17),
)
OBJECTIVES = growth_target(2.0), maximum_growth(PARTICLES)


def ensemble_by(rule, objective, most):
    if rule in (RULES[-1],):
        return Ensemble(rule, objective, PARTICLES)
    return ensemble_of(rule, objective, PARTICLES, 2, most)


def outcomes_of(seed, count, failing):
    """Return outcomes of samples, of which a share fails; many repeat, so that rules hold."""
    chance = np.random.default_rng(seed)
    ratios = chance.choice(chance.normal(2.0, 0.2, 5), count)
    left = chance.integers(1, PARTICLES, count)
    fails = chance.random(count) < failing
    return [
        failed() if fail else completed(ratio, int(particles), (0.1, 0.01, 0.03))
        for ratio, particles, fail in zip(ratios, left, fails, strict=True)
    ]


def one_by_one(ensemble, outcomes):
    for outcome in outcomes:
        if ensemble.finished:
            break
        ensemble.add(outcome)
    return ensemble


def in_parts(ensembles, outcomes, sizes):
    """Give each ensemble its outcomes in parts of these sizes, all ensembles together."""
    rows = [rows_of(each) for each in outcomes]
    begin = 0
    for size in sizes:
        batch = SampleBatch(
            np.concatenate([each[begin : begin + size] for each in rows]), summaries
        )
        starts = np.cumsum([0, *(len(each[begin : begin + size]) for each in rows)]).tolist()
        extend(
            [
                (ensemble, [SamplePart(batch, start, stop)])
                for ensemble, start, stop in zip(ensembles, starts, starts[1:], strict=False)
                if not ensemble.finished and stop > start
            ]
        )
        begin += size
    return ensembles


@examples(
    200,
    st.integers(0, 10**6),
    st.sampled_from(RULES),
    st.sampled_from(OBJECTIVES),
    st.sampled_from([0.0, 0.0, 0.03, 0.2]),
    st.lists(st.integers(1, 30), min_size=1, max_size=8),
    st.integers(3, 80),
)
def test_many_samples_at_once_give_the_bits_of_one_by_one(
    seed, rule, objective, failing, sizes, most
):
    outcomes = [outcomes_of(seed + string, sum(sizes), failing) for string in range(3)]
    singly = [one_by_one(ensemble_by(rule, objective, most), each) for each in outcomes]
    together = in_parts([ensemble_by(rule, objective, most) for _ in outcomes], outcomes, sizes)
    for one, other in zip(singly, together, strict=True):
        assert repr(one.result()) == repr(other.result())
        assert (one.finished, one.completed) == (other.finished, other.completed)


@examples(50, st.integers(0, 10**6), st.integers(1, 20), st.sampled_from(RULES))
def test_an_ensemble_goes_on_one_by_one_after_a_path(seed, first, rule):
    outcomes = outcomes_of(seed, 60, 0.0)
    single = one_by_one(ensemble_by(rule, OBJECTIVES[0], 50), outcomes)
    [ensemble] = in_parts([ensemble_by(rule, OBJECTIVES[0], 50)], [outcomes], [first])
    assert repr(one_by_one(ensemble, outcomes[first:]).result()) == repr(single.result())


def test_a_resampled_ensemble_follows_paths_from_where_it_was():
    outcomes, more = outcomes_of(1, 20, 0.0), outcomes_of(2, 9, 0.0)
    rule = fixed(len(outcomes))
    single = one_by_one(Ensemble(rule, OBJECTIVES[0], PARTICLES), outcomes).resample(9)
    many = one_by_one(Ensemble(rule, OBJECTIVES[0], PARTICLES), outcomes).resample(9)
    in_parts([many], [more], [4, 5])
    assert repr(many.result()) == repr(one_by_one(single, more).result())


OWN = """
from agglom_mpi.search.objectives.growth import GrowthTarget
from agglom_mpi.search.stopping import SuccessiveDifference

class Seven(SuccessiveDifference):
    rule = "seven"
    summary = "seven samples"

    def holds(self, before, after):
        return after.samples >= 7

class Cubic(GrowthTarget):
    law = "cubic"
    summary = "cubes"

    def deviation(self, ratio):
        return (ratio / 2.0) ** 3 - 1.0
"""


@pytest.mark.parametrize(
    "edit",
    [
        ("successive_difference", "mine.py:Seven"),
        ("law: growth_target", "law: mine.py:Cubic"),
    ],
)
def test_rules_and_objectives_of_ones_own_decide_by_their_own_formulas(tmp_path, edit):
    (tmp_path / "mine.py").write_text(OWN)
    text = """
scene: {particles: 100, half_width: 1 cm, velocities: spread, heating: none, end_time: 1 s,
  restitution: {law: constant, value: 0.5}}
variables: {relative_speed: [1, 2], size_ratio: 0.5, density: 2500}
objective: {law: growth_target, ratio: 2}
ensemble: {rule: successive_difference, tolerance: 1e-3, max_samples: 20}
stopping: {generations: 1}
"""
    path = tmp_path / "own.yaml"
    path.write_text(text.replace(*edit))
    campaign = load_campaign(path, allow_code=True)
    rule, objective = campaign.ensemble, campaign.objective
    assert not can_be_judged(rule, objective)
    outcomes = [outcomes_of(3, 20, 0.0)]
    single = one_by_one(Ensemble(rule, objective, PARTICLES), outcomes[0])
    [ensemble] = in_parts([Ensemble(rule, objective, PARTICLES)], outcomes, [20])
    assert repr(ensemble.result()) == repr(single.result())
    if "Seven" in edit[1]:
        assert ensemble.samples_used == 7


def test_completed_samples_without_particles_are_an_error_and_failed_ones_have_none():
    rows = rows_of([completed(2.0, 40, (0.1, 0.01, 0.03)), failed()])
    rows["particles"][1] = 0
    assert SampleBatch(rows, summaries).columns(0, 2)[0].tolist() == [True, False]
    rows["particles"][0] = 0
    with pytest.raises(ZeroDivisionError, match="completed"):
        SampleBatch(rows, summaries).columns(0, 2)
