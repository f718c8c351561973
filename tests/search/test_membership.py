import math

import numpy as np
import pytest
from scipy.stats import binom, norm

from agglom_mpi.search.criteria import Band, Criterion
from agglom_mpi.search.membership import (
    DECISION_ERROR,
    TEST_ERROR,
    MembershipTest,
    Verdict,
    chance_to_show,
    compared_means,
    extreme_numbers,
    failing_tails,
    largest_share,
    least_share,
    looks_until,
    right_needed,
    strings_needed,
)
from agglom_mpi.search.moments import MomentBands

CLAIM, CONFIDENCE = 0.9, 0.95
MOST = 160
NOISE = 0.1


def band(lower=1.9, upper=2.1):
    return Band("mean_radius_ratio", lower, upper, "a band")


def membership(criterion, most=MOST, extremes=()):
    """Return the test of a string, with the extreme numbers of other samples."""
    numbers = np.array(extremes, dtype=float).reshape(-1, 1)
    return MembershipTest(criterion, looks_until(most), numbers)


def first_verdict(test, samples):
    """Return the verdict of the samples of a string, (n,), at the look that decides."""
    for look in test.looks:
        verdict = test.verdict(samples[:look, None], failed=0)
        if verdict != Verdict.UNDECIDED:
            return verdict
    return verdict


def judged(test, mean, random, noise=NOISE):
    """Return the verdict of a string of a mean, by normal samples."""
    return first_verdict(test, random.normal(mean, noise, test.looks[-1]))


def most_of(share, count):
    """Return the share that a count of random events has at most, with four standard errors."""
    return share + 4.0 * math.sqrt(share * (1.0 - share) / count)


def toy_means(share, count, random):
    """Return means of strings of which that share is in the band, the others just outside.

    Wrong strings at the very edge are the hardest: they are accepted as often as they can be.
    """
    right = random.random(count) < share
    return np.where(right, random.uniform(1.96, 2.04, count), 2.1 + 1e-9)


def toy_certificate(share, random, strings=60):
    test = membership(band(), extremes=(1.0, 3.0))
    verdicts = [judged(test, mean, random) for mean in toy_means(share, strings, random)]
    right, wrong = verdicts.count(Verdict.RIGHT), verdicts.count(Verdict.WRONG)
    least = least_share(right, strings, CONFIDENCE, DECISION_ERROR)
    largest = largest_share(strings - wrong, strings, CONFIDENCE, test.error_of_right)
    return least, largest


def test_a_hundred_certificates_of_what_is_known_are_wrong_as_seldom_as_they_say():
    """Of which 0.899 is right, so that a claim of 0.9 is false, and of which more and less is."""
    allowed = 5.0 + 2.0 * math.sqrt(5.0 * 0.95)
    random = np.random.default_rng(641)
    for share in (0.85, 0.899, 0.95):
        bounds = np.array([toy_certificate(share, random) for _ in range(100)])
        assert (bounds[:, 0] > share).sum() <= allowed
        assert (bounds[:, 1] < share).sum() <= allowed
        if share < CLAIM:
            assert (bounds[:, 0] >= CLAIM).sum() <= allowed


def test_a_set_that_is_wholly_wrong_is_refuted():
    random = np.random.default_rng(642)
    test = membership(band())
    verdicts = [judged(test, mean, random) for mean in random.uniform(2.2, 3.0, 40)]
    assert verdicts.count(Verdict.WRONG) >= 38
    assert least_share(verdicts.count(Verdict.RIGHT), 40, CONFIDENCE, DECISION_ERROR) < 0.2
    possible = 40 - verdicts.count(Verdict.WRONG)
    assert largest_share(possible, 40, CONFIDENCE, test.error_of_right) < 0.25


def test_a_string_at_the_edge_is_accepted_as_seldom_as_the_error_says():
    random, test, count = (
        np.random.default_rng(643),
        membership(band()),
        2000,
    )
    accepted = sum(judged(test, 2.1, random) is Verdict.RIGHT for _ in range(count))
    assert accepted / count < TEST_ERROR + 4.0 * math.sqrt(TEST_ERROR / count)


def test_skewed_samples_are_accepted_as_seldom_as_the_bounds_count():
    """Of a gamma distribution with the skewness 1 of [A]'s samples."""
    random, test, count = (
        np.random.default_rng(644),
        membership(band()),
        2000,
    )
    accepted = 0
    for _ in range(count):
        samples = 2.1 + 0.5 * NOISE * (random.gamma(4.0, 1.0, MOST) - 4.0)
        accepted += first_verdict(test, samples) is Verdict.RIGHT
    assert accepted / count < most_of(DECISION_ERROR, count)


FEW_VALUES = {
    "3 of 100, where 2.5 are allowed": (0.0, 1.0, 0.03, -math.inf, 0.025),
    "5.1 of 100, where 5 are allowed": (0.0, 1.0, 0.051, -math.inf, 0.05),
    "6 of 100, where 5 are allowed": (0.0, 1.0, 0.06, -math.inf, 0.05),
    "two grains that seldom merge": (1.0, 1.26, 0.0775, 0.98, 1.02),
    "a rare smaller outcome": (1.0, 0.0, 0.051, 0.95, math.inf),
}


@pytest.mark.parametrize("case", FEW_VALUES)
@pytest.mark.parametrize("noise", [0.0, 0.01])
def test_wrong_strings_with_few_values_are_accepted_as_seldom_as_the_bounds_count(case, noise):
    """Student's test alone accepts 10 to 30 % of them: 40 samples may all be equal."""
    usual, rare, share, lower, upper = FEW_VALUES[case]
    random, count = np.random.default_rng(648), 500
    test = membership(band(lower, upper), 2560, (usual, rare))
    accepted = 0
    for _ in range(count):
        samples = np.where(random.random(2560) < share, rare, usual)
        samples += random.normal(0.0, noise, 2560)
        accepted += first_verdict(test, samples) is Verdict.RIGHT
    assert accepted / count < most_of(DECISION_ERROR, count)


def test_equal_samples_are_decided_once_an_unseen_outcome_cannot_matter():
    """One of the probability 5.6/n moves the mean by up to 5.6/n: of 1 here."""
    test = membership(band(), 2560, (1.0, 3.0))
    verdicts = [test.verdict(np.full((look, 1), 2.0), 0) for look in test.looks]
    assert verdicts == [Verdict.UNDECIDED] + 6 * [Verdict.RIGHT]
    verdicts = [test.verdict(np.full((look, 1), 2.2), 0) for look in test.looks]
    assert verdicts == [Verdict.UNDECIDED] + 6 * [Verdict.WRONG]


def test_ordinary_samples_are_decided_by_as_many_as_their_noise_needs():
    random = np.random.default_rng(649)
    test = membership(band(), 160, (1.0, 3.5))
    verdicts = [judged(test, 2.0, random) for _ in range(200)]
    assert verdicts.count(Verdict.RIGHT) == 200


def test_the_margin_is_the_distance_from_a_bound_that_is_decided():
    numbers = 2.0 + NOISE * np.tile([1.0, -1.0], 80)[:, None]
    test = membership(band(), MOST, (1.2, 3.0))
    noise, mean = np.array([NOISE]), np.array([2.0])
    low, high = test.interval(numbers)
    margin = test.margin(MOST, mean, noise)
    assert high - mean == pytest.approx(margin, rel=0.01)
    assert mean - low < margin


def test_extreme_samples_have_the_least_or_greatest_of_some_number():
    numbers = np.array([[0.0, 5.0], [1.0, 1.0], [2.0, 3.0], [math.inf, 0.0], [1.0, 4.0]])
    assert extreme_numbers(numbers).tolist() == [[0.0, 5.0], [1.0, 1.0], [2.0, 3.0]]
    assert extreme_numbers(np.empty((0, 2))).shape == (0, 2)


def test_nothing_is_decided_between_looks():
    test = membership(band())
    assert test.looks == (40, 80, 160)
    assert looks_until(100) == (40, 80, 100)
    assert looks_until(40) == (40,)
    samples = np.full((160, 1), 2.0)
    assert test.verdict(samples[:40], 0) is Verdict.RIGHT
    assert test.verdict(samples[:41], 0) is Verdict.UNDECIDED
    assert test.verdict(samples[:159], 1) is Verdict.RIGHT
    assert test.verdict(np.empty((0, 1)), 0) is Verdict.UNDECIDED


def test_failures_decide_by_their_binomial_distribution():
    test = membership(band())
    samples = np.full((160, 1), 2.0)
    found = [test.verdict(samples[: 40 - failed], failed) for failed in range(12)]
    undecided = 8 * [Verdict.UNDECIDED]
    assert found == [Verdict.RIGHT, *undecided, Verdict.WRONG, Verdict.WRONG, Verdict.WRONG]
    assert test.verdict(samples[:8], 2) is Verdict.UNDECIDED
    assert test.verdict(samples[:0], 40) is Verdict.WRONG
    for samples, failed in ((40, 0), (40, 9), (2560, 256)):
        at_most, at_least = binom.cdf(failed, samples, 0.1), binom.sf(failed - 1, samples, 0.1)
        assert failing_tails(failed, samples) == pytest.approx((at_most, at_least))


@pytest.mark.parametrize("most", [40, 100, 2560])
def test_errors_of_failures_over_all_looks_are_as_small_as_the_bounds_count(most):
    """Of strings that fail with the largest allowed probability, and all whose means are right."""
    random, count, test = np.random.default_rng(650), 1000, membership(band(), most)
    assert sum(test.error_at(look) for look in test.looks) == pytest.approx(DECISION_ERROR)
    right = np.full((most, 1), 2.0)
    verdicts = []
    for failing in random.random((count, most)) < 0.1:
        for look in test.looks:
            failed = int(failing[:look].sum())
            verdict = test.verdict(right[: look - failed], failed)
            if verdict is not Verdict.UNDECIDED:
                break
        verdicts.append(verdict)
    for error in (Verdict.RIGHT, Verdict.WRONG):
        assert verdicts.count(error) / count < most_of(DECISION_ERROR, count)


def test_a_string_that_fails_in_a_twentieth_of_its_samples_is_right():
    test = membership(band(), 2560)
    assert test.verdict(np.full((608, 1), 2.0), 32) is Verdict.RIGHT


def test_an_open_band_has_one_error_and_a_band_two():
    """Besides that of the failures."""
    assert membership(band()).error_of_right == pytest.approx(3 * DECISION_ERROR)
    assert membership(band(upper=math.inf)).error_of_right == pytest.approx(2 * DECISION_ERROR)


def test_the_mean_of_a_number_has_its_usual_error():
    numbers = np.random.default_rng(646).normal(2.0, NOISE, (50, 1))
    mean, error = compared_means(band(), numbers)
    assert mean == pytest.approx(numbers.mean(axis=0))
    assert error == pytest.approx(numbers.std(axis=0, ddof=1) / math.sqrt(50))


def test_moments_have_the_spread_of_repeated_ensembles():
    """Their spread over 400 ensembles of 80 samples against the mean of the errors."""
    random = np.random.default_rng(647)
    criterion: Criterion = MomentBands({"mean": 2.0, "spread": 0.5}, 0.1)
    dtype = [("mean_radius_ratio", "f8"), ("particles", "i8")]
    rows = np.zeros((400, 80), [*dtype, *((f"radius_moment_{r}", "f8") for r in (2, 3, 4))])
    rows["mean_radius_ratio"] = random.normal(2.0, 0.1, rows.shape)
    rows["particles"] = random.integers(8, 13, rows.shape)
    rows["radius_moment_2"] = random.uniform(0.2, 0.3, rows.shape)
    found = [compared_means(criterion, criterion.numbers(each, 100)) for each in rows]
    means, errors = (np.array(each) for each in zip(*found, strict=True))
    spread = means.std(axis=0, ddof=1)
    assert errors.mean(axis=0) == pytest.approx(spread, rel=4.5 / math.sqrt(2 * 399))


def test_bounds_are_those_of_clopper_and_pearson():
    """Where decisions have no error, the tails of the binomial distribution are α at the bounds."""
    least = least_share(59, 61, CONFIDENCE, 0.0)
    assert binom.sf(58, 61, least) == pytest.approx(0.05)
    largest = largest_share(59, 61, CONFIDENCE, 0.0)
    assert binom.cdf(59, 61, largest) == pytest.approx(0.05)
    assert least_share(0, 61, CONFIDENCE, 0.0) == 0.0
    assert largest_share(61, 61, CONFIDENCE, 0.0) == 1.0
    assert least_share(61, 61, CONFIDENCE, 0.0) == pytest.approx(0.05 ** (1 / 61))


def test_errors_of_decisions_lower_what_is_shown():
    exact, bound = least_share(97, 100, CONFIDENCE, 0.0), least_share(97, 100, CONFIDENCE, 0.02)
    assert bound == pytest.approx((exact - 0.02) / 0.98)
    assert largest_share(50, 100, CONFIDENCE, 0.04) > largest_share(50, 100, CONFIDENCE, 0.0)
    assert largest_share(5, 10, CONFIDENCE, 1.0) == 1.0


@pytest.mark.parametrize("strings", [31, 61, 100, 250])
def test_the_number_of_right_strings_that_is_needed_is_the_least_one(strings):
    needed = right_needed(strings, CLAIM, CONFIDENCE, DECISION_ERROR)
    assert least_share(needed, strings, CONFIDENCE, DECISION_ERROR) >= CLAIM
    assert least_share(needed - 1, strings, CONFIDENCE, DECISION_ERROR) < CLAIM


def test_thirty_strings_show_no_claim_of_nine_tenths():
    assert right_needed(30, CLAIM, CONFIDENCE, DECISION_ERROR) is None
    assert strings_needed(1.0, CLAIM, CONFIDENCE, DECISION_ERROR) == 31
    assert strings_needed(0.9, CLAIM, CONFIDENCE, DECISION_ERROR) is None
    more = strings_needed(0.95, CLAIM, CONFIDENCE, DECISION_ERROR)
    assert least_share(math.floor(0.95 * more), more, CONFIDENCE, DECISION_ERROR) >= CLAIM


def test_the_chance_to_show_a_claim_is_that_of_the_binomial_distribution():
    shares = np.array([0.5, 0.9, 0.99])
    assert chance_to_show(96, 100, shares) == pytest.approx(binom.sf(95, 100, shares))


def test_the_factor_is_that_of_the_error_over_the_looks():
    test = membership(band())
    assert test.factor(10**7) == pytest.approx(norm.isf(TEST_ERROR / 3), rel=1e-4)
