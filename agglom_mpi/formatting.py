"""Text for people: numbers with errors and units, durations, plurals, any terminal."""

import codecs
import math
import sys
from typing import Final, Protocol


def pluralise(number: int, noun: str) -> str:
    """Write a number with its noun: `1 sample`, `2 samples`."""
    return f"{number} {noun}{'' if number == 1 else 's'}"


REPLACEMENTS: Final = {
    "±": "+-",
    "µ": "u",
    "×": "x",
    "·": "*",
    "−": "-",
    "–": "-",
    "—": "-",
    "…": "...",
    "≤": "<=",
    "≥": ">=",
    "°": "deg",
    "²": "^2",
    "³": "^3",
    "━": "#",
    "─": "-",
}
"""How the program's own characters are written where there is nothing but ASCII."""


def _spell(error: UnicodeError) -> tuple[str, int]:
    """Spell out what cannot be encoded; what is not ours is escaped as Python does."""
    if not isinstance(error, UnicodeEncodeError):
        raise error
    characters = error.object[error.start : error.end]
    escaped = (
        REPLACEMENTS.get(c) or c.encode("ascii", "backslashreplace").decode("ascii")
        for c in characters
    )
    return "".join(escaped), error.end


codecs.register_error("spelled", _spell)


def encodable(text: str, encoding: str) -> str:
    """Return the text as it can be written in an encoding."""
    return text.encode(encoding, "spelled").decode(encoding)


def replace_unencodable() -> None:
    """Let standard output and standard error take any text, whatever their encoding is."""
    for stream in (sys.stdout, sys.stderr):
        if hasattr(stream, "reconfigure"):  # else somebody has put something of his own there
            stream.reconfigure(errors="spelled")


ROUNDING: Final = 1e-14
"""Share of a mean that equal samples may differ by."""


def value_with_error(value: float, error: float) -> str:
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


def format_duration(seconds: float) -> str:
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


def value_with_prefix(value: float, unit: str) -> str:
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


class _Estimate(Protocol):
    """A mean of samples with its standard error."""

    @property
    def value(self) -> float: ...

    @property
    def error(self) -> float: ...

    @property
    def samples(self) -> int: ...


def format_mean(mean: _Estimate) -> str:
    """Mean ± standard error, `none` where nothing completed."""
    return value_with_error(mean.value, mean.error) if mean.samples else "none"


def format_seconds(seconds: float) -> str:
    """Time to two digits in the unit that suits it: `0.45 ms`."""
    if not math.isfinite(seconds):
        return "none"
    for scale, unit in ((1e-9, "ns"), (1e-6, "µs"), (1e-3, "ms"), (1.0, "s")):
        if seconds < 999.5 * scale or unit == "s":
            return f"{format_digits(seconds / scale)} {unit}"
    raise AssertionError


def format_digits(value: float, count: int = 2) -> str:
    """Return a number to so many digits, without an exponent: `0.45`, `12`, `1200`."""
    if value == 0.0 or not math.isfinite(value):
        return f"{value:g}"
    places = count - 1 - math.floor(math.log10(abs(value)))
    return f"{round(value, places):.{max(0, places)}f}"


def format_percent(share: float) -> str:
    """Share as a percentage to two digits: `4.8 %`."""
    return f"{format_digits(100.0 * share)} %"
