"""Text of numbers with errors and units, of durations and plurals; text for any encoding."""

import codecs
import math
import re
from typing import Any, Final, Protocol

_CONTROL: Final = re.compile(
    r"[\x00-\x08\x0b-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069]"
)
"""Control characters, but for tabs and ends of lines, and those that turn the order of others."""
LONGEST_SHOWN: Final = 500
"""Maximum number of characters that are shown of a title or another line of a file."""
_NUMBER: Final = re.compile(r"[-+]?([\d.,]+(e[-+]?\d+)?|inf|nan)( ± [\d.,]+(e[-+]?\d+)?)?( ?%)?")


def printable(text: str) -> str:
    """Return a text with control characters replaced, which would command a terminal."""
    return _CONTROL.sub("\N{REPLACEMENT CHARACTER}", text)


def shortened(text: str, longest: int = LONGEST_SHOWN) -> str:
    """Return the printable start of a text that may be somebody else's, with … if it is cut."""
    return printable(text if len(text) <= longest else f"{text[: longest - 1]}…")


def csv_cell(text: str) -> str:
    """Return a printable text that no spreadsheet takes for a formula: with ' before = + - @."""
    is_formula = text.startswith(("=", "+", "-", "@", "\t")) and not _NUMBER.fullmatch(text)
    return printable(f"'{text}" if is_formula else text)


def pluralise(number: int, noun: str) -> str:
    """Return a number with its noun: `1 sample`, `2 samples`."""
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
    "ρ": "rho",
    "θ": "theta",
    "κ": "kappa",
    "γ": "gamma",
    "━": "#",
    "─": "-",
}
"""ASCII replacements of the characters that this program prints."""


def with_article(noun: str) -> str:
    """Return a noun after `a` or `an`."""
    return f"{'an' if noun[:1] in 'aeiou' else 'a'} {noun}"


def _replace(error: UnicodeError) -> tuple[str, int]:
    """Replace what cannot be encoded, or escape it as Python does if there is no replacement."""
    if not isinstance(error, UnicodeEncodeError):
        raise error
    characters = error.object[error.start : error.end]
    escaped = (
        REPLACEMENTS.get(c) or c.encode("ascii", "backslashreplace").decode("ascii")
        for c in characters
    )
    return "".join(escaped), error.end


ASCII_REPLACEMENT: Final = "ascii_replacement"
"""Name of the way in which streams encode what their encoding lacks."""

codecs.register_error(ASCII_REPLACEMENT, _replace)


def encodable(text: str, encoding: str) -> str:
    """Return a text with what the encoding lacks replaced."""
    return text.encode(encoding, ASCII_REPLACEMENT).decode(encoding)


ROUNDING: Final = 1e-14
"""Relative error of a mean that is only rounding of equal samples."""


def value_with_error(value: float, error: float) -> str:
    """Return value ± standard error, both to two digits of the error: `0.0123 ± 0.0045`.

    An error that is only rounding is left out.
    """
    if not math.isfinite(value):
        return "no result"
    if not math.isfinite(error) or error <= ROUNDING * abs(value):
        return f"{value:.4g}"
    digits = max(0, 1 - math.floor(math.log10(error)))
    if digits > 12:
        return f"{value:.6g} ± {error:.1e}"
    return f"{value:.{digits}f} ± {error:.{digits}f}"


def number_or_none(value: float | None, style: str) -> str:
    """Return a number in a format; `none` where there is none, as the error of a single sample."""
    return "none" if value is None or math.isnan(value) else format(value, style)


_LONG_UNITS: Final = (("min", 60.0, 7200.0), ("h", 3600.0, 172_800.0))
"""Units of long times, their size in s, and the time up to which they are used, s."""


def format_duration(seconds: float) -> str:
    """Return a duration to three digits, in ns to days: `150 µs`, `74.4 s`, `2.5 h`."""
    if seconds < 120.0:
        return value_with_prefix(seconds, "s")
    for unit, size, limit in _LONG_UNITS:
        if seconds < limit:
            return f"{seconds / size:.3g} {unit}"
    return f"{seconds / 86400.0:,.1f} days"


def in_unit(text: object, unit: str) -> str:
    """Return a number or a name with the unit behind it: `3 m/s`; alone where the unit is 1."""
    return str(text) if unit == "1" else f"{text} {unit}"


SMALL_PREFIXES: Final = ((1e-3, "m"), (1e-6, "µ"), (1e-9, "n"))
"""Factors of the units of small lengths and times, and their prefixes."""
POWER: Final = re.compile(r"(?:\^|\*\*|(?<=[A-Za-z]))([23])(?![\w.])")
"""A power of a unit: `m^2`, `m**2` or `m2`."""
SUPERSCRIPTS: Final = {"2": "²", "3": "³"}
MICRO: Final = re.compile(r"\bu(?=(?:m|s|g|N|J|Pa|W|K|C|L|l|mol)\b)")
"""The prefix u of a unit."""


def scaled_unit(unit: str, largest: float) -> tuple[float, str]:
    """Return the factor and the name of the decimal multiple of a unit that suits values.

    Parameters
    ----------
    unit
        An SI unit in ASCII; Pa and J get the prefix of large multiples, m and s that of small ones.
    largest
        The largest value that is shown, in this unit.

    Examples
    --------
    >>> scaled_unit("Pa", 2e8)
    (1000000.0, 'MPa')
    >>> scaled_unit("m", 2e-4)
    (1e-06, 'µm')
    >>> scaled_unit("kg/m^3", 1e4)
    (1.0, 'kg/m³')
    """
    name = typeset_unit(unit)
    if unit.startswith(("Pa", "J")):
        for factor, prefix in ((1e15, "P"), (1e12, "T"), (1e9, "G"), (1e6, "M"), (1e3, "k")):
            if largest >= 1.5 * factor:
                return factor, f"{prefix}{name}"
    if unit in ("m", "s") and 0.0 < largest < 1.0:
        for factor, prefix in SMALL_PREFIXES:
            if largest >= factor:
                return factor, f"{prefix}{name}"
    return 1.0, name


def typeset_unit(unit: str) -> str:
    """Return a unit in ASCII as labels show it.

    Examples
    --------
    >>> typeset_unit("kg/m^3"), typeset_unit("g/cm3"), typeset_unit("um"), typeset_unit("mPa*s")
    ('kg/m³', 'g/cm³', 'µm', 'mPa·s')
    """
    unit = POWER.sub(lambda power: SUPERSCRIPTS[power.group(1)], unit)
    return MICRO.sub("µ", unit.replace("*", "·"))


def value_with_prefix(value: float, unit: str) -> str:
    """Return a quantity to three digits with the decimal prefix that suits it: `12.3 µs`."""
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
    """Return mean ± standard error, `none` where no sample completed."""
    return value_with_error(mean.value, mean.error) if mean.samples else "none"


def format_seconds(seconds: float) -> str:
    """Return a time to two digits, in ns to s: `0.45 ms`; `none` if it is not finite."""
    if not math.isfinite(seconds):
        return "none"
    for scale, unit in ((1e-9, "ns"), (1e-6, "µs"), (1e-3, "ms"), (1.0, "s")):
        if seconds < 999.5 * scale or unit == "s":
            return f"{format_digits(seconds / scale)} {unit}"
    raise AssertionError


def format_digits(value: float, count: int = 2) -> str:
    """Return a number to `count` significant digits, without an exponent: `0.45`, `12`, `1200`."""
    if value == 0.0 or not math.isfinite(value):
        return f"{value:g}"
    places = count - 1 - math.floor(math.log10(abs(value)))
    return f"{round(value, places):.{max(0, places)}f}"


def format_percent(share: float, digits: int = 2) -> str:
    """Return a share as a percentage to some digits: `4.8 %`."""
    return f"{format_digits(100.0 * share, digits)} %"


def label_of(name: str) -> str:
    """Return a name as labels show it: `relative speed`; a path such as `sizes.spread` as it is."""
    return name if "." in name else name.replace("_", " ")


def axis_label(name: str, unit: str) -> str:
    """Return the label of an axis: `density (kg/m³)`, or `size ratio` where the unit is 1."""
    return label_of(name) if unit == "1" else f"{label_of(name)} ({unit})"


def without_nan(value: Any) -> Any:
    """Return plain values with None in place of nan and inf, which JSON cannot express."""
    if isinstance(value, dict):
        return {key: without_nan(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [without_nan(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
