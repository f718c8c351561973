"""Files of single impacts: a speed, the radii of the pair, and the coefficient of restitution.

A heading is one of `IMPACT_HEADINGS` with its unit, such as `speed (cm/s)`; what others mean, an
entry of `data` states under `headings`. Other columns are left out.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np

from agglom_mpi.declaration.declared import FieldError
from agglom_mpi.declaration.spelling import MAX_MAGNITUDE
from agglom_mpi.declaration.units import quoted, to_si
from agglom_mpi.file_kinds import quoted_start
from agglom_mpi.measurements.files.size_columns import CurveKeys
from agglom_mpi.measurements.files.size_table import read_content
from agglom_mpi.measurements.files.text_table import (
    TableError,
    TextTable,
    parse_heading,
    read_table,
)
from agglom_mpi.statistics import Floats

MAX_IMPACTS: Final = 300
"""Maximum number of impacts of a file."""
MAX_COEFFICIENT: Final = 1.2
"""Largest measured coefficient: that of an elastic impact with a large error."""
WALL: Final = "wall"
"""Field of the second radius where a grain meets a flat wall of the same material."""
WALL_RATIO: Final = 1e6
"""Radius of the sphere that stands for a wall, over that of the grain."""

_SPEEDS: Final = ("speed", "velocity", "approach speed", "impact speed", "impact velocity")
_COEFFICIENTS: Final = ("coefficient", "coefficient of restitution", "restitution")
IMPACT_HEADINGS: Final[Mapping[str, tuple[str, str, float]]] = {
    **dict.fromkeys(_SPEEDS, ("speed", "m/s", 1.0)),
    **dict.fromkeys(("radius", "radius 1"), ("radius", "m", 1.0)),
    **dict.fromkeys(("diameter", "diameter 1"), ("radius", "m", 0.5)),
    **{"radius 2": ("radius 2", "m", 1.0), "diameter 2": ("radius 2", "m", 0.5)},
    "temperature": ("temperature", "K", 1.0),
    **dict.fromkeys(_COEFFICIENTS, ("coefficient", "1", 1.0)),
    **dict.fromkeys(("error", "sd", "std"), ("error", "1", 1.0)),
}
"""Role, SI unit, and factor of a column by its heading in lower case without the unit."""
_SI: Final = {role: si_unit for role, si_unit, _ in IMPACT_HEADINGS.values()}
IMPACT_EXAMPLE: Final = "speed (m/s)"
"""Heading that messages give as an example."""
_NEEDED: Final = {"speed": "speed (m/s)", "radius": "radius (mm)", "coefficient": "coefficient"}


class MeasuredImpacts(NamedTuple):
    """Impacts of pairs without slip, and their measured coefficients of restitution.

    Attributes
    ----------
    speeds
        Approach speeds in m/s, shape (q,), as all others.
    radii, other_radii
        Of the two spheres in m.
    temperatures
        In K; nan where the file states none.
    coefficients, errors
        Measured coefficients, 0 where the pair stuck, and their independent standard errors.
    """

    speeds: tuple[float, ...]
    radii: tuple[float, ...]
    other_radii: tuple[float, ...]
    temperatures: tuple[float, ...]
    coefficients: tuple[float, ...]
    errors: tuple[float, ...]

    @property
    def is_possible(self) -> bool:
        """Whether there are impacts, all with possible numbers."""
        positive = *self.speeds, *self.radii, *self.other_radii, *self.errors
        fit = all(0.0 <= each <= MAX_COEFFICIENT for each in self.coefficients)
        return fit and min(positive, default=0.0) > 0.0 and max(positive) < MAX_MAGNITUDE

    @property
    def conditions(self) -> Floats:
        """Speeds, both radii and temperatures, shape (q, 4)."""
        return np.column_stack(self[:4])


def read_impacts(folder: Path, name: str, keys: CurveKeys) -> MeasuredImpacts:
    """Return the impacts of a file; errors as of `curve_file.read_size_curve`."""
    headings, error = keys.headings, keys.error
    content = read_content(folder, name)
    titles = {*IMPACT_HEADINGS, *(parse_heading(own).title.lower() for own in headings)}
    try:
        table = read_table(content, titles, IMPACT_EXAMPLE, MAX_IMPACTS)
        if not table.rows:
            raise TableError("has no impacts below its headings")
        columns = _columns(table, headings)
        if (error is None) != ("error" in columns):
            has = "is missing; give" if error is None else f"is {error:g}, but the file has"
            raise FieldError((("error",), f"{has} a column 'error'; it must be given once"))
        return MeasuredImpacts(*zip(*_rows(table, columns, error), strict=True))
    except FieldError:
        raise
    except ValueError as problem:
        raise ValueError(f"is {quoted(name)}: {problem}") from None


def _columns(table: TextTable, headings: Mapping[str, str]) -> dict[str, tuple[int, str, float]]:
    """Return place, unit as it is written, and factor of the columns by their role."""
    stated = {parse_heading(own): parse_heading(text) for own, text in headings.items()}
    if not set(stated) <= set(table.headings):
        message = "must give headings of the file known ones, like `v: speed (m/s)`"
        raise FieldError((("headings",), message))
    found: dict[str, tuple[int, str, float]] = {}
    for place, own in enumerate(table.headings):
        known = stated.get(own, own)
        role, si_unit, factor = IMPACT_HEADINGS.get(known.title.lower(), ("", "", 1.0))
        if not role:
            continue
        title, unit = quoted_start(own.title), known.unit or own.unit or ""
        if role in found:
            raise TableError(f"column {title}: is a second {role}; must be the only one")
        try:
            if unit or si_unit != "1":
                to_si(f"1 {unit}", si_unit)
        except ValueError:
            given = f"the unit of the {role} is {quoted(unit or None)}"
            raise TableError(f"column {title}: {given}; must be one like {si_unit}") from None
        found[role] = place, unit, factor
    for role, example in _NEEDED.items():
        if role not in found:
            raise TableError(f"has no column of the {role}; must have a heading like '{example}'")
    return found


def _rows(
    table: TextTable, columns: dict[str, tuple[int, str, float]], error: float | None
) -> list[tuple[float, ...]]:
    """Return the numbers of `MeasuredImpacts` of each row; raise a TableError."""

    def read(row: int, role: str, low: float, high: float = np.inf) -> float:
        place, unit, factor = columns[role]
        number = table.number(row, place)
        value = factor * to_si(f"{number!r} {unit}", _SI[role]) if unit else number
        least = value > 0.0 if low == 0.0 else value >= 0.0
        if not (least and value <= high):
            most = f" and at most {high:g}" if np.isfinite(high) else ""
            must = f"greater than 0{most}" if low == 0.0 else f"from 0 to {high:g}"
            raise TableError(f"{table.shown(row, place)}; must be {must}")
        return value

    found: list[tuple[float, ...]] = []
    for row in range(len(table.rows)):
        speed, radius = read(row, "speed", 0.0), read(row, "radius", 0.0)
        other = radius
        if "radius 2" in columns:
            is_wall = table.cell(row, columns["radius 2"][0]).lower() == WALL
            other = WALL_RATIO * radius if is_wall else read(row, "radius 2", 0.0)
        temperature = read(row, "temperature", 0.0) if "temperature" in columns else np.nan
        coefficient = read(row, "coefficient", -1.0, MAX_COEFFICIENT)
        own = read(row, "error", 0.0, 1.0) if error is None else error
        found.append((speed, radius, other, temperature, coefficient, own))
    return found
