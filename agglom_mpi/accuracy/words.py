"""Numbers as the accuracy report writes them."""

import math

from agglom_mpi.report.numbers import with_error
from agglom_mpi.search.mean import Mean


def measured(mean: Mean) -> str:
    """Mean ± standard error, `none` where nothing completed."""
    return with_error(mean.value, mean.error) if mean.samples else "none"


def time(seconds: float) -> str:
    """Time to two digits in the unit that suits it: `0.45 ms`."""
    if not math.isfinite(seconds):
        return "none"
    for scale, unit in ((1e-9, "ns"), (1e-6, "µs"), (1e-3, "ms"), (1.0, "s")):
        if seconds < 999.5 * scale or unit == "s":
            return f"{digits(seconds / scale)} {unit}"
    raise AssertionError


def digits(value: float, count: int = 2) -> str:
    """Return a number to so many digits, without an exponent: `0.45`, `12`, `1200`."""
    if value == 0.0 or not math.isfinite(value):
        return f"{value:g}"
    places = count - 1 - math.floor(math.log10(abs(value)))
    return f"{round(value, places):.{max(0, places)}f}"


def percent(share: float) -> str:
    """Share as a percentage to two digits: `4.8 %`."""
    return f"{digits(100.0 * share)} %"
