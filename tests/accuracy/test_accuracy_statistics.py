import math

import numpy as np
import pytest
from accuracy_rows import made_up

from agglom_mpi.accuracy.statistics import paired_difference
from agglom_mpi.formatting import format_digits, format_mean, format_percent, format_seconds
from agglom_mpi.statistics import mean_of


def test_paired_differences_cancel_what_samples_share():
    shared = np.random.default_rng(1).normal(size=50)
    difference = paired_difference(
        made_up(2.0 + shared + 0.25), made_up(2.0 + shared), "mean_radius_ratio"
    )
    assert difference.value == pytest.approx(0.25, rel=1e-13)
    assert difference.error < 1e-15


def test_samples_that_failed_on_either_side_have_no_pair():
    ours = made_up([1.0, 2.0, 3.0, 4.0], failed=[1])
    theirs = made_up([0.5, 0.0, 0.0, 3.0, 9.0], failed=[2])
    difference = paired_difference(ours, theirs, "mean_radius_ratio")
    assert (difference.value, difference.samples) == (0.75, 2)


def test_no_sample_is_no_measurement():
    assert format_mean(mean_of([])) == "none"


def test_a_long_reference_is_no_mismatch():
    difference = paired_difference(made_up([1.0, 1.0]), made_up([0.0] * 9), "mean_radius_ratio")
    assert difference.samples == 2


@pytest.mark.parametrize(
    ("value", "text"),
    [(4.5e-4, "450 µs"), (9.4e-3, "9.4 ms"), (12.34, "12 s"), (3e-8, "30 ns"), (math.nan, "none")],
)
def test_times_are_in_the_unit_that_suits_them(value, text):
    assert format_seconds(value) == text


def test_numbers_have_so_many_digits_and_no_exponent():
    assert [format_digits(value) for value in (0.0456, 1.26, 12.6, 1234.0)] == [
        "0.046",
        "1.3",
        "13",
        "1200",
    ]
    assert format_percent(0.0478) == "4.8 %"
