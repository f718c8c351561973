"""Means extrapolated in 1/N: exact laws exactly, and errors as a Monte Carlo has them."""

import numpy as np
import pytest

from agglom_mpi.analysis.extrapolation import extrapolated
from agglom_mpi.analysis.finite_size import enough_grains
from agglom_mpi.statistics import MeanEstimate, mean_of

GRAINS = (100, 200, 400)
ERRORS = (0.02, 0.015, 0.01)


def means(values, errors=ERRORS):
    return [MeanEstimate(v, e, 100) for v, e in zip(values, errors, strict=True)]


@pytest.mark.parametrize("grains", [GRAINS, GRAINS[:2], (50, 100, 300, 10**6)])
def test_a_law_linear_in_inverse_n_is_extrapolated_exactly(grains):
    errors = np.linspace(0.02, 0.01, len(grains))
    fit = extrapolated(grains, means([1.8 + 7.0 / n for n in grains], errors))
    assert fit.limit.value == pytest.approx(1.8, rel=1e-12)
    assert fit.slope.value == pytest.approx(7.0, rel=1e-11)
    assert fit.shift.value == pytest.approx(7.0 / grains[0], rel=1e-11)
    if len(grains) > 2:
        assert fit.chi_square == pytest.approx(0.0, abs=1e-20)
        assert fit.p_value == pytest.approx(1.0)
        assert fit.curvature.value == pytest.approx(0.0, abs=1e-9)
        assert fit.is_linear


def test_two_volumes_have_no_goodness_of_fit():
    fit = extrapolated(GRAINS[:2], means([2.0, 1.9], ERRORS[:2]))
    assert np.isnan([fit.chi_square, fit.p_value, *fit.curvature[:2]]).all()
    assert fit.is_linear
    assert fit.limit.value == pytest.approx(1.8)
    # limit = 2 y(2N) - y(N)
    assert fit.limit.error == pytest.approx(np.hypot(2 * ERRORS[1], ERRORS[0]))
    assert fit.shift.error == pytest.approx(2 * np.hypot(*ERRORS[:2]))


@pytest.mark.parametrize("order", [1, 2])
def test_errors_are_those_of_repeated_measurements(order):
    runs = 3000
    random = np.random.default_rng(5)
    drawn = random.normal([1.8 + 7.0 / n for n in GRAINS], ERRORS, (runs, 3))
    fits = [extrapolated(GRAINS, means(values), order) for values in drawn]
    for name in ("limit", "slope", "shift", "curvature"):
        values = np.array([getattr(fit, name).value for fit in fits])
        stated = getattr(fits[0], name).error
        # The standard deviation of a normal sample has the relative error 1/sqrt(2 n).
        assert values.std() == pytest.approx(stated, rel=4.0 / np.sqrt(2 * runs))
    limits = np.array([fit.limit.value for fit in fits])
    assert abs(limits.mean() - 1.8) < 4.0 * fits[0].limit.error / np.sqrt(runs)
    for share in (0.1, 0.5):
        found = np.mean([fit.p_value < share for fit in fits])
        assert abs(found - share) < 4.0 * np.sqrt(share * (1 - share) / runs)


@pytest.mark.parametrize("samples", [100, 10_000])
@pytest.mark.parametrize("square", [0.0, -800.0], ids=["straight", "curved"])
def test_intervals_of_limit_and_shift_contain_the_truth_in_95_percent(square, samples):
    """The curved law and the spreads are those of [A] row 1; straight or not is not known."""
    runs = 2000
    truth = np.array([1.851 + 16.8 / n + square / n**2 for n in GRAINS])
    errors = np.array([0.209, 0.148, 0.100]) / np.sqrt(samples)
    drawn = np.random.default_rng(samples).normal(truth, errors, (runs, 3))
    fits = [extrapolated(GRAINS, means(values, errors)) for values in drawn]
    for name, true in (("limit", 1.851), ("shift", truth[0] - 1.851)):
        pulls = [(getattr(fit, name).value - true) / getattr(fit, name).error for fit in fits]
        covered = np.mean(np.abs(pulls) < 1.96)
        assert abs(covered - 0.95) < 4.0 * np.sqrt(0.95 * 0.05 / runs)


def curved(n):
    return 1.8 + 7.0 / n - 300.0 / n**2


def test_the_curvature_is_what_a_curved_law_changes():
    line = extrapolated(GRAINS, means(map(curved, GRAINS), np.full(3, 1e-4)), order=1)
    assert line.quadratic[:2] == (0.0, 0.0)
    assert line.limit.value + line.curvature.value == pytest.approx(1.8, rel=1e-9)
    assert not line.is_linear


@pytest.mark.parametrize("grains", [GRAINS, (100, 200, 400, 800)])
@pytest.mark.parametrize("error", [1e-4, 1.0])
def test_a_curved_law_is_extrapolated_exactly_however_large_the_errors(grains, error):
    fit = extrapolated(grains, means(map(curved, grains), np.full(len(grains), error)))
    assert fit.limit.value == pytest.approx(1.8, rel=1e-9)
    assert fit.slope.value == pytest.approx(7.0, rel=1e-6)
    assert fit.quadratic.value == pytest.approx(-300.0, rel=1e-6)
    assert fit.shift.value == pytest.approx(curved(100) - 1.8, rel=1e-6)


def test_more_precise_means_count_more():
    values = (1.9, 1.85, 1.7)
    loose = extrapolated(GRAINS, means(values, (0.01, 0.01, 1.0)), order=1)
    exact = extrapolated(GRAINS[:2], means(values[:2], (0.01, 0.01)))
    assert loose.limit.value == pytest.approx(exact.limit.value, abs=1e-3)


def test_means_without_spread_have_a_limit_without_error():
    fit = extrapolated(GRAINS, means((1.0, 1.0, 1.0), (0.0, 0.0, 0.0)))
    assert fit.limit[:2] == pytest.approx((1.0, 0.0), abs=1e-12)
    assert np.isnan(fit.p_value)


@pytest.mark.parametrize("repeats", [2, 5])
@pytest.mark.parametrize("grains", [(100, 200), GRAINS, (100, 200, 400, 800)])
def test_intervals_of_few_repeats_contain_the_truth_in_95_percent(grains, repeats):
    runs, numbers = 1000, np.array(grains, float)
    square = -800.0 if len(grains) > 2 else 0.0
    truth = 1.851 + 16.8 / numbers + square / numbers**2
    random = np.random.default_rng(repeats)
    drawn = random.normal(truth, 2.09 / np.sqrt(numbers), (runs, repeats, len(grains)))
    fits = [extrapolated(grains, [mean_of(box) for box in each.T]) for each in drawn]
    # Four volumes reject a true parabola in 5 % of cases, and state no limit then.
    limits = [fit.limit for fit in fits if fit.has_limit]
    rejected = 0.05 if len(grains) > 3 else 0.0
    assert abs(1.0 - len(limits) / runs - rejected) <= 4.0 * np.sqrt(rejected * 0.95 / runs)
    covered = np.mean([abs(limit.value - 1.851) < limit.half_width for limit in limits])
    assert abs(covered - 0.95) < 4.0 * np.sqrt(0.95 * 0.05 / len(limits))


def test_means_of_four_volumes_that_are_no_parabola_have_no_limit():
    """The means are those of [A] row 1, where 3.7 of 25 grains are left."""
    grains = (25, 50, 100, 200)
    fit = extrapolated(grains, means((1.890, 1.946, 1.940, 1.912), np.full(4, 0.0025)))
    assert fit.parabola_p_value < 0.01
    assert not fit.has_limit
    assert np.isnan([fit.shift.value, fit.slope.value, fit.curvature.error]).any()
    assert not fit.shift.is_resolved


def test_means_that_are_left_out_change_no_limit_and_one_that_shifts_has_its_own():
    values, errors = (1.890, 1.946, 1.940, 1.912, 1.885), np.full(5, 0.004)
    fitted = [False, False, True, True, True]
    fit = extrapolated((25, 50, *GRAINS), means(values, errors), fitted=fitted)
    other = extrapolated(GRAINS, means(values[2:], errors[2:]))
    assert fit.limit[:2] == pytest.approx(other.limit[:2])
    assert fit.shift.value == pytest.approx(1.890 - other.limit.value)
    assert fit.shift.error == pytest.approx(np.hypot(0.004, other.limit.error))
    assert not extrapolated((25, 50, 100), means(values[:3]), fitted=[False, True, True]).has_limit


def test_enough_grains_make_the_shift_as_small_as_the_error():
    fit = extrapolated(GRAINS, means([1.8 + 7.0 / n for n in GRAINS]))
    assert enough_grains(100, fit, 0.01) == pytest.approx(700, abs=10)
    assert enough_grains(100, fit, 0.0099) == 710
    assert enough_grains(100, fit, 0.5) == 100
    assert enough_grains(100, fit, 0.0) == 100
