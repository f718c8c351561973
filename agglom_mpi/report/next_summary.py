"""What to measure next, as text, as plain values for JSON, and as a CSV table."""

from pathlib import Path
from typing import Any, Final

from rich.console import Group, RenderableType

from agglom_mpi.display.fitted_table import FittedTable
from agglom_mpi.formatting import format_digits, in_unit, pluralise, value_with_prefix
from agglom_mpi.inference.next_measurement import NextMeasurement, NextMeasurements
from agglom_mpi.measurements.datum import QUANTITIES
from agglom_mpi.report.set_files import write_table

MAX_SHOWN: Final = 12
"""Maximum number of measurements in the table of the terminal."""


def next_text(found: NextMeasurements) -> RenderableType:
    """Return the measurements that leave least of the box as a table."""
    volume = format_digits(100.0 * found.volume, 3)
    heading = (
        f"what to measure next: 90 % of the posterior fill {volume} % of the box; expected share "
        "after one more measurement"
    )
    table = FittedTable("measurement", "expected value", "error", "share of the box", left=(0,))
    for each in found.ranked[:MAX_SHOWN]:
        table.add_row(each.name, _value(each), f"± {each.error_text}", each.volume_text)
    left = len(found.ranked) - MAX_SHOWN
    more = [f"and {pluralise(left, 'measurement')} that would leave more"] if left > 0 else []
    return Group(heading, table, *more)


def _value(each: NextMeasurement) -> str:
    """Return the value that is expected; nothing for shares of sizes."""
    if len(each.datum.values) > 1:
        return ""
    unit = QUANTITIES[each.datum.quantity].unit
    if unit == "m":
        return value_with_prefix(each.predicted, unit)
    return in_unit(f"{each.predicted:.4g}", unit)


def next_as_list(found: NextMeasurements) -> list[dict[str, Any]]:
    """Return all measurements as plain values for JSON; `time` is null at the end."""
    return [
        row | {"time": row["time"] if row["time"] < float("inf") else None}
        for row in found.records()
    ]


def write_next(path: Path, found: NextMeasurements) -> None:
    """Write all measurements as CSV; complete under its name, or absent."""
    write_table(path, found.table)
