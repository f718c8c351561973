"""Numbers with units: SI numbers, or texts such as `10 MPa` that pint converts."""

import re
from decimal import Decimal
from functools import cache, lru_cache
from math import isfinite
from numbers import Real
from typing import TYPE_CHECKING, Any, Final

from agglom_mpi.declaration.spelling import (
    MAX_MAGNITUDE,
    MIN_MAGNITUDE,
    NUMBER,
    as_python,
    remedy,
    with_plain_minus,
)
from agglom_mpi.formatting import in_unit

if TYPE_CHECKING:
    from pint import UnitRegistry

KINDS: Final = {
    "1": "a pure number",
    "m": "length",
    "s": "time",
    "m/s": "speed",
    "kg/m^3": "density",
    "Pa": "pressure",
    "K": "temperature",
    "J/kg/K": "heat capacity per mass",
    "J/mol": "energy per amount of substance",
    "J/m^2": "energy per area",
    "W/m^2/K": "heat transfer coefficient",
    "J": "energy",
    "kg": "mass",
    "N": "force",
    "W": "power",
    "C": "electric charge",
    "mol": "amount of substance",
    "1/s": "frequency",
    "m^2": "area",
    "m^3": "volume",
    "m/s^2": "acceleration",
    "J/kg": "energy per mass",
    "W/m^2": "power per area",
    "W/m^3": "power per volume",
    "kg/s": "mass per time",
    "kg/m^2/s": "mass flux",
    "1/m": "inverse length",
    "1/m^3": "number per volume",
    "m^2/s": "diffusivity",
    "Pa*s": "viscosity",
    "W/m/K": "thermal conductivity",
    "J/K": "heat capacity",
}
"""Names of dimensions in messages, by SI unit."""

_EXPONENT = re.compile(r"(?<=[A-Za-zµΩ°])(-?[1-9])(?![\w.])")
_SECOND_NUMBER = re.compile(r"±|[\d.]+\s*[^\W\d_]")  # in `5 1/s` the 1 is part of the unit
_QUANTITY = re.compile(rf"\s*({NUMBER})\s*(.*?)\s*", re.DOTALL)


def to_si(value: Any, unit: str) -> float:
    """Return a value in SI units.

    Parameters
    ----------
    value
        A finite number in SI units, or a text of a number and a unit.
    unit
        The SI unit of the field, such as a key of `KINDS`.

    Raises
    ------
    ValueError
        If it is not possible; says what is allowed.
    """
    number = _convert(value, unit) if isinstance(value, str) else _plain(value, unit)
    if not isfinite(number):
        raise ValueError(f"is {quoted(value)}; must be a finite number")
    if number != 0.0 and not MIN_MAGNITUDE <= abs(number) <= MAX_MAGNITUDE:
        limits = in_unit(f"{MIN_MAGNITUDE:g} and {MAX_MAGNITUDE:g}", unit)
        raise ValueError(f"is {quoted(value)}; must be 0 or in size between {limits}")
    return number


def _plain(value: Any, unit: str) -> float:
    if isinstance(value, bool) or not isinstance(value, Real):
        raise ValueError(f"is {quoted(value)}; must be {_expectation(unit)}")
    try:
        return float(value)
    except OverflowError:
        return float("inf")


def quoted(value: Any) -> str:
    """Return a value as it is quoted in a message, at most 70 characters."""
    match value:
        case None:
            return "empty"
        case bool():
            return "true" if value else "false"
        case dict():
            return "a mapping"
        case str() if len(value) > 60:
            return repr(value[:57] + "...")
    text = repr(value) if isinstance(value, str | list) else str(value)
    return text if len(text) <= 70 else text[:67] + "..."


def _expectation(unit: str) -> str:
    if unit == "1":
        return "a number"
    return f"a number in {unit}, or a text with a unit like '10 {unit}'"


def _convert(text: str, unit: str) -> float:
    match = _QUANTITY.fullmatch(with_plain_minus(text))
    if match is None:
        raise ValueError(f"is the text {quoted(text)}; must be {_expectation(unit)}")
    number, given = match.groups()
    plain = as_python(number)
    if not given:
        if plain != number:
            return float(plain)
        raise ValueError(f"is the text {quoted(text)}, a number in quotes; leave out the quotes")
    if _SECOND_NUMBER.match(given):
        advice = remedy(text) or "; must be one number and its unit, no ± error"
        raise ValueError(f"is the text {quoted(text)}{advice}")
    registry = _registry()
    try:
        source = _unit(given)
    except ValueError:
        if advice := remedy(text):
            raise ValueError(f"is the text {quoted(text)}{advice}") from None
        raise
    target = registry.parse_units("" if unit == "1" else unit)
    if source.dimensionality != target.dimensionality:
        named = KINDS.get(unit, "a quantity")
        expected = named if unit == "1" else f"{named} like '{unit}'"
        kind = _kinds().get(source.dimensionality, str(source.dimensionality))
        raise ValueError(f"wrong unit: '{given}' is {kind}, expected {expected}")
    try:
        return float(registry.Quantity(Decimal(plain), source).to(target).magnitude)
    except (TypeError, ArithmeticError):  # exponents beyond Decimal's
        raise ValueError(f"is {quoted(text)}; cannot be converted to '{unit}'") from None


def unit_in(value: Any) -> str:
    """Return the unit in a text of a number and a unit; empty if there is none."""
    match = _QUANTITY.fullmatch(value) if isinstance(value, str) else None
    return match.group(2) if match else ""


@lru_cache(maxsize=1024)
def _unit(text: str) -> Any:
    """Return the unit of a text; in `kg/m3` and `J kg-1 K-1` a number behind a name is a power.

    Raises a ValueError of an unknown unit, and of a logarithmic one such as dB: it has no factor.
    """
    from pint.errors import UndefinedUnitError

    registry, spelled = _registry(), _EXPONENT.sub(r"^\1", text)
    try:
        parts = registry.parse_units_as_container(spelled, as_delta=False)
        unit = registry.parse_units(spelled)
    except UndefinedUnitError as error:
        names = error.unit_names
        unknown = names if isinstance(names, str) else ", ".join(names)
        raise ValueError(f"unknown unit '{unknown}' in '{text}'") from None
    except Exception:  # pint lets its tokenizer's and its assertions' errors through
        raise ValueError(f"'{quoted(text)[1:-1]}' is not a unit") from None
    for part in parts:
        try:
            registry.Quantity(Decimal(1), part).to_base_units()
        except Exception:
            message = f"unit '{part}' in '{text}' is logarithmic; give the plain number"
            raise ValueError(message) from None
    return unit


@cache
def _registry() -> "UnitRegistry":
    # Imported late because it takes a third of a second. Decimal, because 67.188 MPa must be
    # the same float64 as 67.188e6: the identity of a campaign depends on it.
    from pint import UnitRegistry

    return UnitRegistry(non_int_type=Decimal)


@cache
def _kinds() -> dict[Any, str]:
    registry = _registry()
    return {
        registry.parse_units("" if unit == "1" else unit).dimensionality: kind
        for unit, kind in KINDS.items()
    }


def is_si(unit: str) -> bool:
    """Return whether a unit is one of the SI, without prefix, factor or offset.

    Raises
    ------
    ValueError
        If pint knows no such unit.
    """
    return unit in KINDS or (in_base_units("1", unit) == 1.0 and not has_offset(unit))


def dimensions_of(unit: str) -> dict[str, float]:
    """Return the powers of the base dimensions of a unit: `m/s` gives [length] 1, [time] -1.

    Raises
    ------
    ValueError
        If pint knows no such unit.
    """
    source = _unit("" if unit == "1" else unit)
    return {name: float(power) for name, power in source.dimensionality.items()}


def in_base_units(number: str, unit: str) -> float:
    """Return a quantity in SI base units.

    Raises
    ------
    ValueError
        If pint knows no such unit, or it cannot be converted.
    """
    registry = _registry()
    try:
        quantity = registry.Quantity(Decimal(number), _unit(unit))
        return float(quantity.to_base_units().magnitude)
    except (TypeError, ArithmeticError):
        raise ValueError(f"'{number} {unit}' cannot be converted to SI units") from None


def has_offset(unit: str) -> bool:
    """Return whether 0 in a unit is another temperature than 0 K, as in degC."""
    return in_base_units("0", unit) != 0.0
