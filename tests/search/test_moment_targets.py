"""Targets on moments: values from all particles at once, errors from repeated ensembles."""

import doctest
import itertools

import numpy as np
import pytest
from goals import FUNCTION_MEAN, growth_target, moment_targets
from rules import difference, ensemble_of, half_width
from scipy import stats
from search_fakes import PARTICLES, completed, of_radii

from agglom_mpi.outcome import COMPLETED, OUTCOME
from agglom_mpi.search.objectives import growth as growth_objectives
from agglom_mpi.search.objectives.moment_targets import MomentTarget, interval_notes
from agglom_mpi.search.objectives.objective import ReachedMoment
from agglom_mpi.statistics import PooledMoments

NAMES = ("mean", "spread", "skewness", "kurtosis", "second", "third", "fourth")


def samples_of_radii(seed, count):
    """Return samples whose sizes go with their radii, as where growth leaves fewer."""
    rng = np.random.default_rng(seed)
    scales = rng.uniform(1.0, 3.0, count)
    most = (5 + 13 * (3.0 - scales)).astype(int)
    sizes = rng.integers(4, most + 1)
    return [1.0 + s * rng.beta(2.0, 5.0, size) for s, size in zip(scales, sizes, strict=True)]


def directly(samples):
    """Return all moments by numpy and scipy from the samples' radii."""
    everyone = np.concatenate(samples)
    away = everyone - np.mean(everyone)
    return {
        "mean": np.mean([np.mean(radii) for radii in samples]),
        "spread": np.std(everyone),
        "skewness": stats.skew(everyone),
        "kurtosis": stats.kurtosis(everyone, fisher=False),
        "second": np.mean(away**2),
        "third": np.mean(away**3),
        "fourth": np.mean(away**4),
    }


def judged(terms, samples):
    return moment_targets(tuple(terms)).of_ensemble(map(of_radii, samples))


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("seed", range(3))
def test_a_moment_is_that_of_all_particles_together(name, seed):
    samples = samples_of_radii(seed, 40)
    wanted = directly(samples)[name]
    assert judged([MomentTarget(name, 0.0)], samples)[0] == pytest.approx(abs(wanted), rel=1e-11)
    assert judged([MomentTarget(name, 2.5)], samples)[0] == pytest.approx(
        abs(wanted / 2.5 - 1), rel=1e-10
    )


def test_misses_are_weighted_and_added_up():
    samples = samples_of_radii(5, 30)
    found = directly(samples)
    terms = [
        MomentTarget("mean", 2.0, 3.0),
        MomentTarget("spread", 0.4),
        MomentTarget("skewness", 0.0, 0.25),
    ]
    wanted = (
        3.0 * abs(found["mean"] / 2.0 - 1.0)
        + abs(found["spread"] / 0.4 - 1.0)
        + 0.25 * abs(found["skewness"])
    )
    assert judged(terms, samples)[0] == pytest.approx(wanted, rel=1e-12)


def test_a_negative_target_is_missed_by_a_share_of_itself():
    samples = samples_of_radii(6, 30)
    wanted = abs(directly(samples)["skewness"] / -2.0 - 1.0)
    assert judged([MomentTarget("skewness", -2.0)], samples)[0] == pytest.approx(wanted, rel=1e-12)


def test_the_order_of_samples_and_of_their_particles_does_not_matter():
    samples = samples_of_radii(7, 20)
    terms = [MomentTarget(name, 1.5) for name in NAMES]
    rng = np.random.default_rng(8)
    shuffled = [rng.permutation(radii) for radii in rng.permutation(np.array(samples, object))]
    again = [np.asarray(radii, float) for radii in shuffled]
    assert judged(terms, again) == pytest.approx(judged(terms, samples), rel=1e-10)


def test_a_mean_alone_is_the_growth_target():
    outcomes = [of_radii(radii) for radii in samples_of_radii(9, 25)]
    own = moment_targets((MomentTarget("mean", 2.0),)).of_ensemble(outcomes)
    assert own == pytest.approx(growth_target(2.0).of_ensemble(outcomes), rel=1e-12)


def test_a_sample_alone_has_the_objective_of_its_own_moments():
    samples = samples_of_radii(10, 6)
    rows = np.zeros(len(samples), OUTCOME)
    for row, radii in zip(rows, samples, strict=True):
        row["state"], row["particles"] = COMPLETED, len(radii)
        row["mean_radius_ratio"] = np.mean(radii)
        for order in (2, 3, 4):
            row[f"radius_moment_{order}"] = np.mean((radii - np.mean(radii)) ** order)
    terms = [MomentTarget("mean", 2.0), MomentTarget("kurtosis", 3.0, 0.5)]
    alone = [judged(terms, [radii])[0] for radii in samples]
    assert moment_targets(tuple(terms)).of_samples(rows) == pytest.approx(alone, rel=1e-12)


# All far from what ensembles of the pool have: near a target the objective bends.
MIXED = (
    MomentTarget("mean", 2.0),
    MomentTarget("spread", 0.6, 2.0),
    MomentTarget("skewness", 0.0),
    MomentTarget("kurtosis", 12.0),
)
ALONE = [pytest.param((MomentTarget(name, 0.5),), marks=pytest.mark.slow) for name in NAMES]
ERRORS = [*ALONE, MIXED]


@pytest.mark.parametrize("terms", ERRORS, ids=lambda terms: "-".join(t.name for t in terms))
def test_the_standard_error_is_the_scatter_of_repeated_ensembles(terms):
    """Many ensembles drawn from a pool, all moments from sums of powers; some by the tally.

    The tolerance is 4 standard errors of both estimates of the variance, and 5/E for what the
    delta method leaves out: its next order is the 1/E-th part of the first.
    """
    pool, size, repeats, some = samples_of_radii(11, 400), 400, 4000, 150
    rng = np.random.default_rng(12)
    draws = rng.integers(0, len(pool), (repeats, size))
    sums = np.array([[np.sum(radii**r) for r in range(5)] for radii in pool])[draws].sum(axis=1)
    n, *raw = sums.T
    a1, a2, a3, a4 = (power / n for power in raw)
    m2, m3 = a2 - a1**2, a3 - 3 * a1 * a2 + 2 * a1**3
    m4 = a4 - 4 * a1 * a3 + 6 * a1**2 * a2 - 3 * a1**4
    found = {
        "mean": np.array([np.mean(radii) for radii in pool])[draws].mean(axis=1),
        "spread": np.sqrt(m2),
        "skewness": m3 / m2**1.5,
        "kurtosis": m4 / m2**2,
        "second": m2,
        "third": m3,
        "fourth": m4,
    }
    values = sum(
        t.weight * abs(found[t.name] / t.target - 1 if t.target else found[t.name]) for t in terms
    )
    outcomes = [of_radii(radii) for radii in pool]
    objective = moment_targets(terms)
    own = np.array([objective.of_ensemble(outcomes[i] for i in row) for row in draws[:some]])
    assert own[:, 0] == pytest.approx(values[:some], rel=1e-7)
    squares, variances = (values - values.mean()) ** 2, own[:, 1] ** 2
    variance = squares.mean()
    slack = 4 * np.hypot(squares.std() / np.sqrt(repeats), variances.std() / np.sqrt(some))
    assert abs(variances.mean() - variance) < slack + 5 / size * variance
    assert slack < 0.15 * variance


@pytest.mark.parametrize("terms", ERRORS, ids=lambda terms: "-".join(t.name for t in terms))
def test_what_each_sample_adds_in_first_order_gives_value_and_error(terms):
    outcomes = [of_radii(radii) for radii in samples_of_radii(13, 60)]
    objective = moment_targets(terms)
    value, error = objective.of_ensemble(outcomes)
    numbers = objective.influence_values(outcomes)
    assert np.mean(numbers) == pytest.approx(value, rel=1e-10)
    assert stats.sem(numbers) == pytest.approx(error, rel=1e-9)


def test_particles_that_are_all_the_same_have_an_error_of_nothing_but_the_mean():
    outcomes = [completed(ratio, particles=1) for ratio in (4.0, 4.2, 4.4)]
    value, error = moment_targets((MomentTarget("mean", 2.0),)).of_ensemble(outcomes)
    assert value == pytest.approx(1.1)
    assert error == pytest.approx(0.1 / np.sqrt(3))


def test_one_particle_left_everywhere_has_no_spread_and_misses_all_of_that_target():
    value, error = moment_targets((MomentTarget("spread", 0.4),)).of_ensemble(
        [completed(4.6, 1)] * 5
    )
    assert (value, error) == (1.0, 0.0)
    assert moment_targets((MomentTarget("spread", 0.0),)).of_ensemble([completed(4.6, 1)] * 5) == (
        0.0,
        0.0,
    )


@pytest.mark.parametrize("name", ["skewness", "kurtosis"])
@pytest.mark.parametrize("target", [0.0, 3.0, -1.0])
@pytest.mark.parametrize("rounding", [0.0, 1e-15])
def test_radii_without_spread_have_no_shape_and_are_worth_inf(name, target, rounding):
    outcomes = [completed(4.6 * (1 + rounding * i), 1) for i in range(5)]
    objective = moment_targets((MomentTarget("mean", 2.0), MomentTarget(name, target)))
    assert objective.of_ensemble(outcomes) == (np.inf, 0.0)
    assert objective.of_ensemble([]) == (np.inf, pytest.approx(np.nan, nan_ok=True))


@pytest.mark.parametrize("rule", [difference(1e-3), half_width(0.01)])
def test_a_string_without_shape_ranks_last_and_takes_no_more_samples_than_it_must(rule):
    ensemble = ensemble_of(
        rule, moment_targets((MomentTarget("skewness", 0.0),)), PARTICLES, 2, 100
    )
    while not ensemble.finished:
        ensemble.add(completed(1.0))
    result = ensemble.result()
    assert result.objective == np.inf
    assert not result.hit_maximum
    assert result.samples_used <= 5


def test_one_merge_among_very_many_particles_is_a_spread():
    pooled = PooledMoments()
    pooled.add(10**12, 1.0, (0.0, 0.0, 0.0))
    pooled.add(1, 2 ** (1 / 3), (0.0, 0.0, 0.0))
    kurtosis = moment_targets((MomentTarget("kurtosis", 0.0),)).of_moments(
        pooled.mean, pooled.central
    )
    assert kurtosis == pytest.approx(1e12, rel=1e-3)  # n - 2 + 1/(n - 1) of one among n others


def test_the_standard_error_rule_stops_at_the_first_narrow_interval_of_moments():
    outcomes = [of_radii(radii) for radii in samples_of_radii(14, 300)]
    objective = moment_targets(MIXED)
    errors = [objective.of_ensemble(outcomes[:count])[1] for count in range(5, 301)]
    half_widths = stats.t.ppf(0.975, np.arange(4, 300)) * errors
    tolerance = 0.5 * (half_widths[0] + half_widths[-1])
    direct = 5 + int(np.argmax(half_widths <= tolerance))
    ensemble = ensemble_of(half_width(tolerance), objective, PARTICLES, 2, 10**6)
    while not ensemble.finished:
        ensemble.add(outcomes[ensemble.samples_used])
    assert ensemble.samples_used == direct


def test_the_mean_of_a_function_keeps_its_sign():
    numbers = [-3.0, 1.0, -2.5, 0.5]
    outcomes = [completed(1.0)._replace(objective=number) for number in numbers]
    value, error = FUNCTION_MEAN.of_ensemble(outcomes)
    assert value == -1.0
    assert error == pytest.approx(stats.sem(numbers), rel=1e-14)
    ensemble = ensemble_of(half_width(1e-9), FUNCTION_MEAN, PARTICLES, 2, 4)
    for outcome in outcomes:
        ensemble.add(outcome)
    assert ensemble.result().objective == -1.0
    assert list(itertools.accumulate(FUNCTION_MEAN.influence_values(outcomes)))[-1] == -4.0


def test_the_example_of_the_objectives_is_true():
    assert doctest.testmod(growth_objectives) == (0, 6)


@pytest.mark.parametrize("name", ["mean", "spread", "skewness", "second", "third"])
def test_intervals_of_lower_moments_need_no_note(name):
    assert interval_notes(["mean", name]) == []


@pytest.mark.parametrize("name", ["kurtosis", "fourth"])
def test_intervals_of_fourth_powers_are_said_to_be_too_narrow(name):
    [note] = interval_notes(["mean", name])
    assert "90 % of cases by 30 samples, 92 % by 100, 94 % by 300" in note


def test_what_is_not_finite_is_none_in_a_dictionary():
    reached = ReachedMoment("spread", 0.4, 2.0, 0.3, float("nan"), float("inf"))
    numbers = {"target": 0.4, "weight": 2.0, "value": 0.3, "error": None, "miss": None}
    assert reached.as_dict() == numbers
