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


def judged(test, mean, random, noise=NOISE):
    """Return the verdict of a string of a mean, by normal samples up to the look that decides."""
    samples = random.normal(mean, noise, (test.looks[-1], 1))
    for look in test.looks:
        verdict = test.verdict(samples[:look], failed=0)
        if verdict != Verdict.UNDECIDED:
            return verdict
    return verdict


def toy_means(share, count, random):
    """Return means of strings of which that share is in the band, the others just outside.

    Wrong strings at the very edge are the hardest: they are accepted as often as they can be.
    """
    right = random.random(count) < share
    return np.where(right, random.uniform(1.96, 2.04, count), 2.1 + 1e-9)


def toy_certificate(share, random, strings=60):
    test = MembershipTest(band(), looks_until(MOST))
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
    test = MembershipTest(band(), looks_until(MOST))
    verdicts = [judged(test, mean, random) for mean in random.uniform(2.2, 3.0, 40)]
    assert verdicts.count(Verdict.WRONG) >= 38
    assert least_share(verdicts.count(Verdict.RIGHT), 40, CONFIDENCE, DECISION_ERROR) < 0.2
    possible = 40 - verdicts.count(Verdict.WRONG)
    assert largest_share(possible, 40, CONFIDENCE, test.error_of_right) < 0.25


def test_a_string_at_the_edge_is_accepted_as_seldom_as_the_error_says():
    random, test, count = (
        np.random.default_rng(643),
        MembershipTest(band(), looks_until(MOST)),
        2000,
    )
    accepted = sum(judged(test, 2.1, random) is Verdict.RIGHT for _ in range(count))
    assert accepted / count < TEST_ERROR + 4.0 * math.sqrt(TEST_ERROR / count)


def test_skewed_samples_are_accepted_as_seldom_as_the_bounds_count():
    """Of a gamma distribution with the skewness 1 of [A]'s samples."""
    random, test, count = (
        np.random.default_rng(644),
        MembershipTest(band(), looks_until(MOST)),
        2000,
    )
    accepted = 0
    for _ in range(count):
        samples = 2.1 + 0.5 * NOISE * (random.gamma(4.0, 1.0, (MOST, 1)) - 4.0)
        verdicts = (test.verdict(samples[:look], 0) for look in test.looks)
        first = next((v for v in verdicts if v is not Verdict.UNDECIDED), Verdict.UNDECIDED)
        accepted += first is Verdict.RIGHT
    assert accepted / count < DECISION_ERROR + 4.0 * math.sqrt(DECISION_ERROR / count)


def test_nothing_is_decided_between_looks():
    test = MembershipTest(band(), looks_until(MOST))
    assert test.looks == (40, 80, 160)
    assert looks_until(100) == (40, 80, 100)
    assert looks_until(40) == (40,)
    samples = np.full((160, 1), 2.0)
    assert test.verdict(samples[:40], 0) is Verdict.RIGHT
    assert test.verdict(samples[:41], 0) is Verdict.UNDECIDED
    assert test.verdict(samples[:39], 1) is Verdict.RIGHT
    assert test.verdict(np.empty((0, 1)), 0) is Verdict.UNDECIDED


def test_a_string_with_more_than_a_tenth_of_failed_samples_is_wrong():
    test = MembershipTest(band(), looks_until(MOST))
    samples = np.full((36, 1), 2.0)
    assert test.verdict(samples, 4) is Verdict.RIGHT
    assert test.verdict(samples[:35], 5) is Verdict.WRONG
    assert test.verdict(samples[:8], 2) is Verdict.WRONG


def test_an_open_band_has_one_error_and_a_band_two():
    looks = looks_until(MOST)
    assert MembershipTest(band(), looks).error_of_right == pytest.approx(2 * DECISION_ERROR)
    assert MembershipTest(band(upper=math.inf), looks).error_of_right == DECISION_ERROR


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
    test = MembershipTest(band(), looks_until(MOST))
    assert test.factor(10**7) == pytest.approx(norm.isf(TEST_ERROR / 3), rel=1e-4)
