"""Numbers as a person reads them."""

import math
from typing import Final

ROUNDING: Final = 1e-14
"""Share of a mean that equal samples may differ by."""


def with_error(value: float, error: float) -> str:
    """Value ± standard error, both to two digits of the error: `0.0123 ± 0.0045`.

    An error that is nothing but rounding is none.
    """
    if not math.isfinite(value):
        return "no result"
    if not math.isfinite(error) or error <= ROUNDING * abs(value):
        return f"{value:.4g}"
    digits = max(0, 1 - math.floor(math.log10(error)))
    if digits > 12:
        return f"{value:.6g} ± {error:.1e}"
    return f"{value:.{digits}f} ± {error:.{digits}f}"


def duration(seconds: float) -> str:
    """Time in s, min or h."""
    if seconds < 120.0:
        return f"{seconds:.1f} s"
    if seconds < 7200.0:
        return f"{seconds / 60.0:.1f} min"
    return f"{seconds / 3600.0:.1f} h"


def forecast_time(seconds: float) -> str:
    """Time to three digits in the unit that suits it, µs to days."""
    for unit, size, most in (
        ("µs", 1e-6, 1e-3),
        ("ms", 1e-3, 1.0),
        ("s", 1.0, 120.0),
        ("min", 60.0, 7200.0),
        ("h", 3600.0, 172_800.0),
    ):
        if seconds < most:
            return f"{seconds / size:.3g} {unit}"
    return f"{seconds / 86400.0:,.1f} days"


def with_prefix(value: float, unit: str) -> str:
    """Three digits of a quantity in the decimal multiple of its unit that suits it: `12.3 µs`."""
    if value == 0.0 or not math.isfinite(value):
        return f"{value:g} {unit}"
    thousands = math.floor(math.log10(abs(float(f"{value:.3g}"))) / 3.0 + 1e-9)
    if not -len(_SMALL) <= thousands <= len(_LARGE):
        return f"{value:.3g} {unit}"
    prefix = "" if thousands == 0 else (_LARGE if thousands > 0 else _SMALL)[abs(thousands) - 1]
    return f"{value / 1000.0**thousands:.3g} {prefix}{unit}"


_SMALL: Final = "mµnpf"
_LARGE: Final = "kMG"
