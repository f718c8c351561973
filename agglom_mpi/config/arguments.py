"""Numbers that people give as arguments: counts, amounts and percentages, within their limits.

Options of commands and arguments of Python methods are read here alike. Every reader raises a
ValueError that begins with `is` and says what is allowed; the caller names the field.
"""

import math
import sys
from numbers import Integral, Real
from typing import Any, Final

from agglom_mpi.declaration.spelling import MAX_MAGNITUDE, MIN_MAGNITUDE, read_plain, remedy

MAX_CHARACTERS: Final = 60
"""Longest value that is quoted in a message in full."""
FRACTION_RULE: Final = "must be greater than 0 and less than 1, like 0.05 or '5%'"


def read_count(value: Any, least: int = 0) -> int:
    """Return a whole number of at least `least`, of 64 bits; raise a ValueError for others."""
    is_whole = isinstance(value, Integral) and not isinstance(value, bool)
    if is_whole and least <= int(value) <= sys.maxsize:
        return int(value)
    most = f" and at most {sys.maxsize}" if is_whole and int(value) > sys.maxsize else ""
    text = f"the text {value!r}"[:MAX_CHARACTERS] if isinstance(value, str) else shown(value)
    raise ValueError(f"is {text}; must be a whole number of at least {least}{most}")


def count_argument(file: object, field: str, value: Any, least: int = 0) -> int:
    """Return a whole number that is an argument `field` of what comes from `file`.

    Raises
    ------
    ArgumentError
        If it is anything else, or less than `least`.
    """
    try:
        return read_count(value, least)
    except ValueError as error:
        raise mistaken_argument(file, field, error) from None


def mistaken_argument(file: object, field: str, message: object) -> ValueError:
    """Return an ArgumentError about an argument `field` of what comes from `file`."""
    # Imported here: a campaign file is read without what reads YAML.
    from agglom_mpi.config.yaml_source import ArgumentError

    return ArgumentError.of(file, field, message)


def read_number(value: Any) -> float:
    """Return a finite number, or that of a text; raise a ValueError for anything else."""
    return _checked(_number(value), value, "a finite number")


def read_amount(value: Any) -> tuple[float, bool]:
    """Return a finite number, or that of a text such as `0.05` or `5%`, and if it is in percent.

    Raises a ValueError for anything else.
    """
    plain = value.strip() if isinstance(value, str) else value
    percent = isinstance(plain, str) and plain.endswith("%")
    number = _number(plain[:-1] if percent else plain) / (100.0 if percent else 1.0)
    return _checked(number, value, "a number like 0.05 or a percentage like '5%'"), percent


def read_fraction(value: Any) -> float:
    """Return a fraction between 0 and 1, both excluded, given as `0.05` or `5%`.

    Raises
    ------
    ValueError
        If it is none; suggests a percentage for a number that may be meant as one.
    """
    try:
        amount, percent = read_amount(value)
    except ValueError:
        raise ValueError(f"is {shown(value)}; {FRACTION_RULE}") from None
    if not 0.0 < amount < 1.0:
        raise ValueError(f"is {shown(value)}; {FRACTION_RULE}{_meant(amount, percent)}")
    return amount


def read_error(value: Any, measured: float, positive: bool) -> float:
    """Return the standard error of a measured value; a percentage is relative to that value.

    Parameters
    ----------
    value
        Such as `0.05`, or `2%` of the measured value.
    measured
        The measured value.
    positive
        Whether what is measured is a positive quantity, whose error is less than itself.

    Raises
    ------
    ValueError
        If it is impossible; suggests a percentage for a number that may be meant as one.
    """
    amount, percent = read_amount(value)
    if amount <= 0.0 or (percent and measured == 0.0):
        rule = "greater than 0, like 0.05" + (" or '2%'" if measured else "")
        raise ValueError(f"is {shown(value)}; must be {rule}")
    error = amount * (abs(measured) if percent else 1.0)
    if positive and error >= measured > 0.0:
        raise ValueError(
            f"is {shown(value)}; must be less than the measured {measured:g}, like '2%' of it"
            f"{_meant(amount, percent)}"
        )
    return error


def _meant(amount: float, percent: bool) -> str:
    """Return `; did you mean '5%'?` of a plain number that may be one in percent, or nothing."""
    return f"; did you mean '{amount:g}%'?" if not percent and 1.0 <= amount < 100.0 else ""


def shown(value: Any) -> str:
    """Return a value as it is quoted in a message: numbers plain, texts in quotes, not too long."""
    if isinstance(value, str):
        is_number = math.isfinite(_number(value.strip().removesuffix("%")))
        text = value.strip() if is_number else repr(value)
    else:
        text = str(value) if isinstance(value, Real) else repr(value)
    return text if len(text) <= MAX_CHARACTERS else f"{text[: MAX_CHARACTERS - 3]}..."


def _checked(number: float, value: Any, kind: str) -> float:
    """Return a number; raise a ValueError if it, or its square in float64, is not finite."""
    if not math.isfinite(number):
        advice = remedy(value) if isinstance(value, str) else ""
        raise ValueError(f"is {shown(value)}; must be {kind}{advice}")
    if number != 0.0 and not MIN_MAGNITUDE <= abs(number) <= MAX_MAGNITUDE:
        limits = f"{MIN_MAGNITUDE:g} and {MAX_MAGNITUDE:g}"
        raise ValueError(f"is {shown(value)}; must be 0 or in size between {limits}")
    return number


def _number(value: Any) -> float:
    """Return a number or that of a text; nan where there is none."""
    if isinstance(value, bool) or not isinstance(value, Real | str):
        return math.nan
    try:
        return read_plain(value) if isinstance(value, str) else float(value)
    except (OverflowError, ValueError):
        return math.nan
