import numpy as np
import pytest

from agglom_mpi.config.arguments import (
    read_amount,
    read_count,
    read_error,
    read_fraction,
    read_number,
)


@pytest.mark.parametrize("value", [0.05, "0.05", "5%", " 5 % ", "5e-2", np.float32(0.05), "+5%"])
def test_fractions_and_percentages_are_the_same_number(value):
    assert read_fraction(value) == pytest.approx(0.05, rel=1e-6)


@pytest.mark.parametrize(
    ("value", "said"),
    [
        (5, "is 5; must be .* did you mean '5%'"),
        ("5", "is 5; must be .* did you mean '5%'"),
        (1, "is 1; must be greater than 0 and less than 1.*'1%'"),
        ("500%", "is 500%; must be greater than 0 and less than 1, .*'5%'$"),
        (-1, "is -1; must be greater than 0"),
        (0.0, "is 0.0; must be greater than 0"),
        ("0%", "is 0%; must be greater than 0"),
        (np.nan, "is nan; must be greater than 0"),
        ("inf", "is 'inf'; must be greater than 0"),
        ("1e999", "is '1e999'; must be"),
        (True, "is True; must be"),
        (None, "is None; must be"),
        ([0.05], "is .0.05.; must be"),
        ("5%%", "is '5%%'; must be"),
        ("%", "is '%'; must be"),
        ("", "is ''; must be"),
        ("x" * 500, "is 'xxx.*[.]{3}; must be"),
        (10**400, "must be greater than 0"),
    ],
)
def test_what_is_no_fraction_is_refused_with_what_is_allowed(value, said):
    with pytest.raises(ValueError, match=said):
        read_fraction(value)


def test_amounts_know_that_they_are_percentages():
    assert read_amount("5%") == (0.05, True)
    assert read_amount("-5") == (-5.0, False)
    with pytest.raises(ValueError, match=r"is 'wide'; must be a number like 0.05"):
        read_amount("wide")


def test_numbers_are_finite():
    assert read_number("2.5") == read_number(2.5) == 2.5
    for wrong in (np.nan, "inf", "two", None, True, "5%"):
        with pytest.raises(ValueError, match="must be a finite number"):
            read_number(wrong)


def test_counts_are_whole_numbers():
    assert read_count(np.int64(3), least=1) == 3
    for wrong in (0, -1, 1.0, 1.5, True, "3", None, np.nan):
        with pytest.raises(ValueError, match="must be a whole number of at least 1"):
            read_count(wrong, least=1)


@pytest.mark.parametrize(
    ("value", "measured", "positive", "wanted"),
    [(0.04, 2.0, True, 0.04), ("2%", 2.0, True, 0.04), ("2%", -0.5, False, 0.01), (5, 2, False, 5)],
)
def test_an_error_in_percent_is_of_what_was_measured(value, measured, positive, wanted):
    assert read_error(value, measured, positive) == pytest.approx(wanted)


@pytest.mark.parametrize(
    ("value", "measured", "said"),
    [
        (5, 2.0, "less than the measured 2, .*did you mean '5%'"),
        ("150%", 2.0, "less than the measured 2, like '2%' of it$"),
        (0, 2.0, "greater than 0, like 0.05 or '2%'"),
        ("-2%", 2.0, "greater than 0"),
        ("2%", 0.0, "greater than 0, like 0.05$"),
        (np.inf, 2.0, "must be a number"),
    ],
)
def test_impossible_errors_are_refused(value, measured, said):
    with pytest.raises(ValueError, match=said):
        read_error(value, measured, positive=True)


def test_numbers_of_fortran_are_read_and_decimal_commas_get_a_remedy():
    assert read_number("1.0D-1") == 0.1
    assert read_amount("2.5D0%") == (0.025, True)
    for read in (read_number, read_amount):
        with pytest.raises(ValueError, match="a decimal point, and no comma"):
            read("2,5")


@pytest.mark.parametrize("value", [1e300, "1e300", "-1e101", 1e-101])
def test_squares_of_numbers_fit_into_a_float(value):
    for read in (read_number, read_amount):
        with pytest.raises(ValueError, match=r"must be 0 or in size between 1e-100 and 1e\+100"):
            read(value)
