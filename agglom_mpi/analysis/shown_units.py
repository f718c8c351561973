"""The unit in which tables and figures show a number: the one that the campaign file writes.

A campaign that gives `hardness: [10 MPa, 200 MPa]` is shown in MPa, and one whose data are in um in
µm. Where a number has no unit in the file, or several, `scaled_unit` chooses one by size.
"""

import re
from collections.abc import Iterator
from functools import lru_cache
from itertools import chain
from typing import TYPE_CHECKING, Any, Final

from agglom_mpi.declaration.units import has_offset, to_si, unit_in
from agglom_mpi.display.table import Column
from agglom_mpi.formatting import scaled_unit, typeset_unit
from agglom_mpi.measurements.datum import Datum
from agglom_mpi.measurements.quantities import QUANTITIES
from agglom_mpi.variables import Variable

if TYPE_CHECKING:
    from agglom_mpi.inference.set_directions import SetVariable

PREFIXES: Final = {"k": 1e3, "M": 1e6, "G": 1e9, "c": 1e-2, "m": 1e-3, "u": 1e-6, "µ": 1e-6}
"""Factors of decimal prefixes."""
PREFIXABLE: Final = re.compile(r"(?!kg)[A-Za-z]+(/.*)?")
"""Units whose first factor has no power, so that a prefix is a factor of the whole."""
TIME: Final = "time"
"""Name of the times of measured data."""


def shown_unit(text: str, name: str, unit: str, largest: float) -> tuple[float, str]:
    """Return the factor and the label of the unit in which a number of a campaign is shown.

    Parameters
    ----------
    text
        Text of the campaign.
    name
        Of a variable, of a derived or a measured quantity, or `TIME`.
    unit
        Its SI unit.
    largest
        The largest value that is shown, in this unit; it decides where the file writes no unit.

    Examples
    --------
    Shown values are those in SI units over the factor: 2e7 Pa over 1e6 is 20 MPa.
    """
    written = written_units(text).get(name, "")
    factor = _factor(written, unit)
    return scaled_unit(unit, largest) if factor is None else (factor, typeset_unit(written))


def unit_of_variable(text: str, variable: "Variable | SetVariable") -> tuple[float, str]:
    """Return factor and label of the unit in which a variable with its range is shown."""
    return shown_unit(text, variable.name, variable.unit, variable.upper)


def unit_of_datum(text: str, datum: Datum) -> tuple[float, str]:
    """Return factor and label of the unit of a datum, the sizes of a curve, or impacts' speeds."""
    largest = datum.values[0] if datum.edges is None else datum.edges[-2]
    largest = largest if datum.impacts is None else datum.impacts[:, 0].max()
    return shown_unit(text, datum.quantity, datum.kind.axis_unit, float(largest))


def column_of(text: str, name: str, unit: str, largest: float, note: str = "") -> Column:
    """Return the column of a variable or quantity in its shown unit; a `note` follows the unit."""
    factor, shown = shown_unit(text, name, unit, largest)
    shown = ", ".join(part for part in (shown, note) if part not in ("", "1"))
    return Column(name, unit=shown, format=".5g", size=factor)


def _factor(written: str, unit: str) -> float | None:
    """Return a written unit in an SI unit; None if there is none, or its zero is another."""
    if not written or written == unit:
        return 1.0 if written else None
    prefix = written.removesuffix(unit)
    if prefix in PREFIXES and PREFIXABLE.fullmatch(unit):
        return PREFIXES[prefix]  # pint, which knows all others, takes a third of a second
    try:
        return None if has_offset(written) else to_si(f"1 {written}", unit)
    except ValueError:
        return None


@lru_cache(maxsize=16)
def written_units(text: str) -> dict[str, str]:
    """Return the units that the text of a campaign writes, by the names of `shown_unit`."""
    # Imported here: JSON and exports need nothing that reads a campaign's text.
    from agglom_mpi.config.yaml_source import CampaignError, parse

    try:
        content = parse(text, "").data
    except CampaignError:
        return {}
    experiments = _mapping(content.get("experiments"))
    parts: list[Any] = [content, *experiments.values()]
    scene, variables = (
        {k: v for part in parts for k, v in _mapping(_mapping(part).get(key)).items()}
        for key in ("scene", "variables")
    )
    for name, part in experiments.items():
        given = _mapping(_mapping(part).get("variables"))
        variables |= {f"{name}.{key}": value for key, value in given.items()}
    found = {}
    for name, value in {**scene, **variables}.items():
        units = set(_units_of(value))  # such as those of the two ends of a range
        found[name] = units.pop() if len(units) == 1 else ""
    lists = [_mapping(part).get("data") for part in parts]
    some = [each for entries in lists if isinstance(entries, list) for each in entries]
    measured = [each for each in some if isinstance(each, dict)]
    for name in QUANTITIES:
        own = (each for each in measured if each.get("quantity") == name)
        alike = (each for each in measured if _si_unit(each.get("quantity")) == _si_unit(name))
        found[name] = _first(
            unit if isinstance(unit := each.get("unit"), str) else unit_in(each.get("value"))
            for each in chain(own, alike)
        )
    times = [*(each.get(TIME) for each in measured), scene.get("end_time")]
    found[TIME] = _first(unit_in(time) for time in times)
    return found


def _mapping(value: Any) -> dict[str, Any]:
    """Return a section; nothing of what is none."""
    return value if isinstance(value, dict) else {}


def _si_unit(quantity: Any) -> str:
    """Return the SI unit in which a measured quantity is given: m of a file of sizes."""
    kind = QUANTITIES.get(quantity) if isinstance(quantity, str) else None
    return "" if kind is None else kind.axis_unit


def _units_of(value: Any) -> Iterator[str]:
    """Yield the units of all texts of an entry, such as the two ends of a range."""
    if isinstance(value, list):
        for each in value:
            yield from _units_of(each)
    elif isinstance(value, dict):
        yield from _units_of(list(value.values()))
    elif unit := unit_in(value):
        yield unit


def _first(units: Iterator[str]) -> str:
    return next((unit for unit in units if unit), "")
