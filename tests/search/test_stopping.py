import itertools

import numpy as np
import pytest
from goals import growth_target, maximum_growth
from hypothesis import given, settings
from hypothesis import strategies as st
from rules import difference, ensemble_of, fixed, half_width, settled_moments
from scipy import stats
from search_fakes import PARTICLES, completed, of_radii

from agglom_mpi.accuracy.time_integration.stopping_study import STUDIED_RULES
from agglom_mpi.search.stopping import EnsembleState


def samples_until_end(rule, outcomes, objective, min_samples=2):
    """Feed an ensemble and return after how many samples it ends, None if it does not."""
    ensemble = ensemble_of(rule, objective, PARTICLES, min_samples, 10**6)
    for count, outcome in enumerate(outcomes, 1):
        ensemble.add(outcome)
        if ensemble.finished:
            return count
    return None


def first_settled(means, tolerance):
    """Return the first E + 1 with |m(E+1) - m(E)| <= TOL |m(E+1)|, straight from [A 27]."""
    for count, (before, after) in enumerate(itertools.pairwise(means), 2):
        if abs(after - before) <= tolerance * abs(after):
            return count
    return None


def running_means(values):
    return [float(np.mean(values[:count])) for count in range(1, len(values) + 1)]


def test_a_harmonic_series_stops_where_its_steps_fall_below_the_tolerance():
    # Samples 1, 2, 3, … have means (E+1)/2: successive difference 1/2, relative 1/(E+2), so
    # that it first is below 1/10.5 at E + 2 = 11.
    outcomes = [completed(float(ratio)) for ratio in range(1, 40)]
    rule = difference(1 / 10.5, "mean_radius")
    assert samples_until_end(rule, outcomes, growth_target()) == 10


def test_a_sample_that_hits_the_mean_stops_by_luck():
    outcomes = [completed(ratio) for ratio in (1.0, 3.0, 2.0, 5.0)]
    rule = difference(1e-9, "mean_radius")
    assert samples_until_end(rule, outcomes, growth_target()) == 3


def test_the_objective_and_the_mean_radius_can_stop_at_different_samples():
    outcomes = [completed(ratio) for ratio in (2.5, 2.4, 2.4, 2.4, 2.4, 2.4)]
    radius = difference(0.03, "mean_radius")
    objective = difference(0.03, "objective")
    # Means 2.5, 2.45, 2.433, 2.425, …; misses of 2 (doubled) 0.5, 0.45, 0.433, 0.425, …
    assert samples_until_end(radius, outcomes, growth_target(2.0)) == 2
    assert samples_until_end(objective, outcomes, growth_target(2.0)) == 4


@given(
    st.lists(st.floats(1.0, 4.0), min_size=1, max_size=40),
    st.sampled_from([0.1, 0.01, 0.001]),
    st.sampled_from(["mean_radius", "objective"]),
)
@settings(derandomize=True, deadline=None)
def test_successive_differences_stop_where_the_printed_formula_does(ratios, tolerance, quantity):
    objective = maximum_growth(PARTICLES)
    values = ratios if quantity == "mean_radius" else [objective.of_ratio(r) for r in ratios]
    means = running_means(values)
    margins = [abs(b - a) - tolerance * abs(b) for a, b in itertools.pairwise(means)]
    # Two roundings of the means may disagree only where the formula is undecided to their size.
    if any(0 < abs(margin) < 1e-12 for margin in margins):
        return
    rule = difference(tolerance, quantity)
    outcomes = [completed(ratio) for ratio in ratios]
    assert samples_until_end(rule, outcomes, objective) == first_settled(means, tolerance)


def test_an_objective_that_stays_at_zero_has_settled():
    outcomes = [completed(2.0)] * 3
    assert samples_until_end(difference(1e-5), outcomes, growth_target(2.0)) == 2


def test_the_least_number_of_samples_holds_the_rule_back():
    outcomes = [completed(1.5)] * 9
    rule = difference(1e-5)
    assert samples_until_end(rule, outcomes, growth_target(), min_samples=7) == 7


SLOW = pytest.mark.slow


def random_radii(seed, count):
    rng = np.random.default_rng(seed)
    return [1.0 + rng.exponential(0.5, rng.integers(5, 40)) for _ in range(count)]


@pytest.mark.parametrize("order", [1, *(pytest.param(r, marks=SLOW) for r in (2, 3)), 4])
@pytest.mark.parametrize("tolerance", [0.05, 0.01])
def test_moments_stop_where_those_of_all_particles_settle(order, tolerance):
    samples = random_radii(order, 400)

    def moments(count):
        everyone = np.concatenate(samples[:count])
        away = everyone - np.mean(everyone)
        mean = np.mean([np.mean(radii) for radii in samples[:count]])
        return np.array([mean, *(np.mean(away**r) for r in (2, 3, 4))][:order])

    direct = next(
        count
        for count, (a, b) in enumerate(itertools.pairwise(map(moments, range(1, 401))), 2)
        if np.all(abs(b - a) <= tolerance * abs(b))
    )
    outcomes = [of_radii(radii) for radii in samples]
    assert samples_until_end(settled_moments(tolerance, order), outcomes, growth_target()) == direct


def test_higher_orders_never_stop_earlier():
    outcomes = [of_radii(radii) for radii in random_radii(7, 400)]
    ends = [
        samples_until_end(settled_moments(0.01, r), outcomes, growth_target()) for r in (1, 2, 3, 4)
    ]
    assert ends == sorted(ends)
    assert ends[0] < ends[3]


def test_moments_that_are_zero_both_times_have_settled():
    outcomes = [of_radii(np.ones(100))] * 3
    assert samples_until_end(settled_moments(1e-5, 4), outcomes, growth_target()) == 2


def test_the_standard_error_rule_stops_at_the_first_narrow_interval():
    """An interval of some 100 samples has half a width of 0.02."""
    ratios = np.random.default_rng(0).normal(2.5, 0.2, 300)
    counts = np.arange(5, 301)
    factors = stats.t.ppf(0.975, counts - 1) / np.sqrt(counts)
    outcomes = [completed(ratio) for ratio in ratios]
    for objective, values in (
        (growth_target(2.0), ratios / 2.0),
        (maximum_growth(PARTICLES), 1 - ratios / np.cbrt(PARTICLES)),
    ):
        half_widths = factors * [values[:count].std(ddof=1) for count in counts]
        for tolerance in (0.1, 0.05, 0.02):
            direct = counts[np.argmax(half_widths <= tolerance)]
            assert samples_until_end(half_width(tolerance), outcomes, objective) == direct


def test_the_standard_error_rule_waits_for_its_least_number():
    outcomes = [completed(2.5)] * 9
    assert samples_until_end(half_width(0.1), outcomes, growth_target()) == 5
    assert samples_until_end(half_width(0.1, 3), outcomes, growth_target()) == 3
    with pytest.raises(ValueError, match="min_samples"):
        half_width(0.1, 2)


def test_rules_that_mean_nothing_are_refused():
    with pytest.raises(ValueError, match="order"):
        settled_moments(0.1, 5)
    with pytest.raises(ValueError, match="quantity"):
        difference(0.1, "median")


RULES = (
    *(
        make(tolerance=tolerance, max_samples=100)
        for _, make in STUDIED_RULES
        for tolerance in (1e-3, 0.1, 2.0)
    ),
    difference(5e-4, "objective"),
    half_width(0.01),
    settled_moments(0.1, 1),
    half_width(0.5, 3),
    fixed(100),
)
EDGES = st.sampled_from([0.0, -0.0, 1.0, np.inf, -np.inf, np.nan, 1e-308, 1e308, -1e308])
NUMBERS = st.one_of(EDGES, st.floats(), st.floats(0.99, 1.01))
# mean radius, objective, standard error, three central moments of 2 ensembles after 6 samples
PATHS = st.lists(NUMBERS, min_size=72, max_size=72)


@pytest.mark.parametrize("rule", RULES, ids=lambda rule: rule.label)
@given(numbers=PATHS)
@settings(derandomize=True, deadline=None, max_examples=6)
def test_decisions_on_whole_paths_are_those_after_each_sample(rule, numbers):
    values = np.array(numbers).reshape(6, 6, 2)
    mean, objective, error, *central = values
    paths = EnsembleState(np.arange(1, 7)[:, None], mean, objective, error, tuple(central))
    decided = rule.satisfied_paths(paths)
    assert decided.shape == (6, 2)
    assert not decided[0].any()
    for ensemble in range(2):
        states = []
        for k in range(6):
            mean, objective, error, *central = values[:, k, ensemble].tolist()
            states.append(EnsembleState(k + 1, mean, objective, error, tuple(central)))
        one_by_one = [rule.satisfied(*pair) for pair in itertools.pairwise(states)]
        assert decided[1:, ensemble].tolist() == one_by_one


def test_an_objective_that_stays_at_infinity_has_settled():
    same = EnsembleState(2, 2.0, np.inf, np.nan, None)
    assert difference(1e-5).satisfied(same, same)
    columns = (np.array([[number], [number]]) for number in (2.0, np.inf, np.nan))
    paths = EnsembleState(np.array([[1], [2]]), *columns, None)
    assert difference(1e-5).satisfied_paths(paths).ravel().tolist() == [False, True]


def test_an_objective_that_is_not_a_number_never_settles():
    unknown = EnsembleState(2, np.nan, np.nan, np.nan, (np.nan,) * 3)
    for rule in RULES:
        assert not rule.satisfied(unknown, unknown), rule
