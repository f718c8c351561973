"""The objective of means of quantities: value, slopes and delta-method error, by closed forms."""

import copy
import math

import numpy as np
import pytest
from search_fakes import completed

from agglom_mpi.errors import CodeNotAllowedError
from agglom_mpi.search.objectives.function_of_means import MeansAccumulator, ObjectiveOfMeans
from agglom_mpi.search.objectives.own_function import MeanOfFunction, Quantities

NAMES = ("x", "y")


def law(of_means, names=NAMES):
    """Objective whose samples have these quantities, and a function of their means."""
    units = Quantities(tuple((name, "1") for name in names))
    objective = MeanOfFunction(call="shape:worth", quantities=units, of_means="shape:value")
    return objective.with_code(of_means)


def samples(*quantities):
    """Summaries of samples with the rows of (n, k) numbers."""
    return [completed(1.5)._replace(quantities=tuple(row)) for row in np.column_stack(quantities)]


def correlated(count, seed=3):
    """Two correlated quantities of `count` samples, of means near 3 and 5."""
    rng = np.random.default_rng(seed)
    x = rng.normal(3.0, 0.2, count)
    return x, 5.0 + 0.8 * (x - 3.0) + rng.normal(0.0, 0.3, count)


def test_a_linear_function_has_the_error_of_the_linear_combination():
    x, y = correlated(40)
    value, error = law(lambda m: 2.0 * m["x"] - 3.0 * m["y"] + 7.0).of_ensemble(samples(x, y))
    combined = 2.0 * x - 3.0 * y + 7.0
    assert value == pytest.approx(combined.mean(), rel=1e-12)
    assert error == pytest.approx(combined.std(ddof=1) / math.sqrt(40), rel=1e-7)


def test_the_square_of_a_mean_lacks_the_variance_that_the_mean_of_squares_has():
    [x, _] = correlated(200)
    value, error = law(lambda m: (m["x"] / 3.0 - 1.0) ** 2, ["x"]).of_ensemble(samples(x))
    squares = (x / 3.0 - 1.0) ** 2
    assert value == pytest.approx((x.mean() / 3.0 - 1.0) ** 2, rel=1e-12)
    assert squares.mean() - value == pytest.approx(np.var(x) / 9.0, rel=1e-9)
    slope = abs(2.0 / 3.0 * (x.mean() / 3.0 - 1.0))
    assert error == pytest.approx(slope * x.std(ddof=1) / math.sqrt(200), rel=1e-5)


def test_a_ratio_of_means_has_the_error_of_the_ratio_estimator():
    x, y = correlated(60)
    value, error = law(lambda m: m["x"] / m["y"]).of_ensemble(samples(x, y))
    ratio = x.mean() / y.mean()
    residuals = (x - ratio * y) / y.mean()
    assert value == pytest.approx(ratio, rel=1e-12)
    assert error == pytest.approx(residuals.std(ddof=1) / math.sqrt(60), rel=1e-6)


def test_influence_values_have_the_objective_as_mean_and_its_standard_error():
    x, y = correlated(60)
    objective, found = law(lambda m: m["x"] / m["y"]), samples(x, y)
    value, error = objective.of_ensemble(found)
    values = objective.influence_values(found)
    assert values.mean() == pytest.approx(value, rel=1e-12)
    assert values.std(ddof=1) / math.sqrt(60) == pytest.approx(error, rel=1e-9)


def test_the_standard_error_is_the_scatter_of_repeated_ensembles():
    count, repeats = 50, 800
    rng, objective = np.random.default_rng(11), law(lambda m: m["x"] / m["y"])
    found = []
    for _ in range(repeats):
        x = rng.normal(3.0, 0.2, count)
        found.append(objective.of_ensemble(samples(x, 5.0 + rng.normal(0.0, 0.3, count))))
    values, errors = np.array(found).T
    share = np.var(values, ddof=1) / np.mean(errors**2)
    assert abs(share - 1.0) < 4.0 * math.sqrt(2.0 / (repeats - 1))


@pytest.mark.parametrize("offset", [0.0, 1e-9, -1e-9, 0.3])
def test_at_a_kink_the_error_is_that_beside_it(offset):
    x, y = correlated(30)
    kink = (x - y).mean() + offset
    value, error = law(lambda m: abs(m["x"] - m["y"] - kink)).of_ensemble(samples(x, y))
    assert value == pytest.approx(abs(offset), abs=1e-12)
    assert error == pytest.approx((x - y).std(ddof=1) / math.sqrt(30), rel=1e-5)


def test_where_the_function_is_smooth_its_minimum_has_no_error():
    x, _ = correlated(30)
    wanted = float(x.mean())
    value, error = law(lambda m: (m["x"] - wanted) ** 2, ["x"]).of_ensemble(samples(x))
    assert value < 1e-20
    assert error < 1e-3 * x.std(ddof=1) ** 2 / 30


def test_a_side_on_which_the_function_is_not_defined_is_left_out():
    x = np.array([1.0, 3.0])
    edge = law(lambda m: math.sqrt(m["x"] - 2.0) * 0.0 + 4.0 * m["x"], ["x"])
    value, error = edge.of_ensemble(samples(x))
    assert (value, error) == (8.0, pytest.approx(4.0, rel=1e-9))


def raising(means):
    raise KeyError(means)


@pytest.mark.parametrize(
    "of_means", [raising, lambda m: 1.0 / 0.0, lambda m: math.log(-m["x"]), lambda m: m["z"]]
)
def test_a_function_that_raises_makes_the_string_rank_last(of_means):
    x, y = correlated(4)
    assert law(of_means).of_ensemble(samples(x, y)) == (math.inf, 0.0)
    assert law(of_means).influence_values(samples(x, y)).tolist() == [math.inf] * 4


def test_one_sample_has_no_error_and_equal_samples_have_none():
    objective = law(lambda m: m["x"] * m["y"])
    value, error = objective.of_ensemble(samples([2.0], [3.0]))
    assert value == 6.0
    assert math.isnan(error)
    assert objective.of_ensemble(samples([2.0] * 3, [3.0] * 3)) == (6.0, 0.0)
    assert objective.of_ensemble([])[0] == math.inf


def test_an_accumulator_goes_on_from_a_copy():
    x, y = correlated(9)
    found = samples(x, y)
    whole, first = (MeansAccumulator(ObjectiveOfMeans(NAMES, lambda m: m["x"])) for _ in "ab")
    for sample in found[:5]:
        first.add(sample)
    more = copy.deepcopy(first)
    before = first.value
    for sample in found[5:]:
        more.add(sample)
    for sample in found:
        whole.add(sample)
    assert more.value == whole.value
    assert more.standard_error == whole.standard_error
    assert first.value == before


def test_without_its_code_an_objective_of_means_is_refused_in_one_line():
    bare = law(None)
    for ask in (bare.accumulator, lambda: bare.influence_values([completed(1.5)])):
        with pytest.raises(CodeNotAllowedError) as caught:
            ask()
        assert "shape:value" in str(caught.value)
        assert "--allow-code" in str(caught.value)


def by_cases(means):
    """A function that takes no arrays."""
    return math.log(means["x"]) if means["x"] > 1.0 else 1.0 - means["y"]


def of_all(means):
    """A function that takes arrays, and mixes their elements up."""
    return means["x"] + 0.0 * means["y"] + np.max(means["x"]) - means["x"]


@pytest.mark.parametrize(
    "of_means", [lambda m: (m["x"] / 3.0 - 1.0) ** 2 + m["y"] / m["x"], by_cases, of_all, raising]
)
def test_objectives_of_many_means_are_those_of_single_ones(of_means):
    means = np.random.default_rng(5).normal(1.0, 0.5, (200, 2))
    means[7] = 0.0, 1.0  # a division by zero, in the first function
    objective = ObjectiveOfMeans(NAMES, of_means)
    alone = [objective.value(row) for row in means]
    assert objective.values(means) == pytest.approx(alone, rel=1e-12)
    assert objective.values(means[:3]) == pytest.approx(alone[:3], rel=1e-12)


def test_members_of_a_feasible_set_have_an_objective_of_at_most_the_tolerance():
    criterion = law(lambda m: abs(m["x"] - m["y"])).criterion(0.5)
    rows = np.zeros(3, [("y", "f8"), ("x", "f8")])
    rows["x"], rows["y"] = [1.0, 2.0, 3.0], [1.5, 2.6, -3.0]
    numbers = criterion.numbers(rows, 100)
    assert numbers.tolist() == [[1.0, 1.5], [2.0, 2.6], [3.0, -3.0]]
    compared = criterion.compared(numbers.reshape(1, 3, 2))
    assert compared.shape == (1, 3, 1)
    assert criterion.holds(compared).tolist() == [[True, False, False]]
    assert criterion.distance(compared)[0] == pytest.approx([0.0, 0.1, 5.5], abs=1e-12)
    assert criterion.bands() == [(-math.inf, 0.5)]
    with pytest.raises(CodeNotAllowedError):
        law(None).criterion(0.5)
