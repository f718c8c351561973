import math

import pytest

from agglom_mpi.formatting import (
    LONGEST_SHOWN,
    csv_cell,
    format_digits,
    format_duration,
    format_mean,
    format_percent,
    format_seconds,
    in_unit,
    number_or_none,
    printable,
    shortened,
    value_with_error,
    without_nan,
)
from agglom_mpi.statistics import mean_of


@pytest.mark.parametrize(
    ("value", "error", "text"),
    [
        (0.01234, 0.0045, "0.0123 ± 0.0045"),
        (1.23456, 0.5, "1.23 ± 0.50"),
        (123.456, 1.5, "123.5 ± 1.5"),
        (123.456, 12.0, "123 ± 12"),
        (98765.4, 1234.0, "98765 ± 1234"),
        (-0.5, 0.01, "-0.500 ± 0.010"),
        (1.23456, math.nan, "1.235"),
        (1.23456, 0.0, "1.235"),
        (1.23456, math.inf, "1.235"),
        (4.64159, 3e-16, "4.642"),
        (math.inf, 0.1, "no result"),
        (math.nan, math.nan, "no result"),
        (1e-20, 1e-22, "1e-20 ± 1.0e-22"),
    ],
)
def test_a_value_has_two_digits_of_its_error(value, error, text):
    assert value_with_error(value, error) == text


def test_a_pure_number_has_no_unit():
    assert [in_unit(0, "m/s"), in_unit("1.5", "1"), in_unit("depth", "m")] == [
        "0 m/s",
        "1.5",
        "depth m",
    ]


@pytest.mark.parametrize(
    ("seconds", "text"),
    [
        (0.0, "0 s"),
        (40e-6, "40 µs"),
        (1e-3, "1 ms"),
        (0.8312, "831 ms"),
        (26.6, "26.6 s"),
        (120.0, "2 min"),
        (9000.0, "2.5 h"),
        (172_800.0, "2.0 days"),
        (1e9, "11,574.1 days"),
    ],
)
def test_a_duration_has_three_digits_in_the_unit_that_suits_it(seconds, text):
    assert format_duration(seconds) == text


def test_no_sample_is_no_measurement():
    assert format_mean(mean_of([])) == "none"


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


@pytest.mark.parametrize(
    ("value", "text"), [(0.01234, "0.0123"), (0.0, "0.0000"), (math.nan, "none"), (None, "none")]
)
def test_a_number_that_is_not_there_is_none(value, text):
    assert number_or_none(value, ".4f") == text


def test_plain_values_for_json_have_none_in_place_of_nan_and_inf():
    values = {"a": [1.0, math.nan], "b": (math.inf, 2), "c": {"d": -math.inf, "e": "nan"}}
    assert without_nan(values) == {"a": [1.0, None], "b": [None, 2], "c": {"d": None, "e": "nan"}}


@pytest.mark.parametrize(
    ("text", "cell"),
    [
        ("=1+1.h5", "'=1+1.h5"),
        ("@sum(a1)", "'@sum(a1)"),
        ("+cmd", "'+cmd"),
        ("-2+3|x", "'-2+3|x"),
        ("-1.5e-07", "-1.5e-07"),
        ("+2", "+2"),
        ("-0.500 ± 0.010", "-0.500 ± 0.010"),
        ("-12.5 %", "-12.5 %"),
        ("-inf", "-inf"),
        ("dust=ash.h5", "dust=ash.h5"),
        ("\x1b]0;a\u200f", "\ufffd]0;a\ufffd"),
        ("", ""),
    ],
)
def test_no_cell_of_a_csv_file_is_a_formula_and_numbers_stay(text, cell):
    assert csv_cell(text) == cell


@pytest.mark.parametrize("mark", "\u061c\u200e\u200f\u2028\u2029\u202e\u2066\x1b\x9b\r")
def test_what_turns_or_commands_others_is_replaced(mark):
    assert printable(f"a{mark}b\tc\n") == "a\ufffdb\tc\n"


def test_a_long_text_is_cut_to_what_is_shown():
    assert shortened("a" * LONGEST_SHOWN) == "a" * LONGEST_SHOWN
    assert shortened("a" * 10**6) == "a" * (LONGEST_SHOWN - 1) + "…"
