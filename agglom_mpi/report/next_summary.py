"""What to measure next, as text, as plain values for JSON, and as a CSV table."""

from pathlib import Path
from typing import Any, Final, NamedTuple

from rich.console import Group, RenderableType

from agglom_mpi.analysis.shown_units import shown_unit
from agglom_mpi.display.table import Column, Table
from agglom_mpi.formatting import format_digits, in_unit, pluralise, without_nan
from agglom_mpi.inference.next_measurement import NextMeasurement, NextMeasurements
from agglom_mpi.inference.posterior import Posterior
from agglom_mpi.report.set_files import check_new, write_table


class PosteriorRequest(NamedTuple):
    """Options of a report on the posterior of all data.

    Attributes
    ----------
    what_next
        Whether to show what to measure next.
    table
        CSV file to write with all measurements that could be made; None: do not.
    """

    what_next: bool = False
    table: Path | None = None

    def check(self, made: Path | None = None) -> None:
        """Refuse a file that cannot be written, before anything is computed.

        Parameters
        ----------
        made
            A folder that will be made for files to be written into.

        Raises
        ------
        OSError
            If the file exists already, or its folder cannot be written.
        """
        check_new(self.table, made)

    def found(self, posterior: Posterior) -> NextMeasurements | None:
        """Return what to measure next, if that is asked for, and write the table."""
        if not self.what_next:
            return None
        found = posterior.next_measurements()
        if self.table is not None:
            write_table(self.table, found.table)
        return found


MAX_SHOWN: Final = 12
"""Maximum number of measurements in the table of the terminal."""


def next_text(found: NextMeasurements, text: str) -> RenderableType:
    """Return the measurements that leave least of the box as a table, in units of the campaign."""
    volume = format_digits(100.0 * found.volume, 3)
    heading = (
        f"what to measure next: 90 % of the posterior fill {volume} % of the box; expected share "
        "after one more measurement"
    )
    rows = [
        {
            "measurement": each.name,
            "value": _value(each, text),
            "error": each.error_text,
            "volume": each.volume_text,
        }
        for each in found.ranked[:MAX_SHOWN]
    ]
    left = len(found.ranked) - MAX_SHOWN
    more = [f"and {pluralise(left, 'measurement')} that would leave more"] if left > 0 else []
    return Group(heading, Table(NEXT_COLUMNS, rows), *more)


NEXT_COLUMNS: Final = (
    Column("measurement"),
    Column("value", "expected value"),
    Column("error"),
    Column("volume", "share of the box"),
)


def _value(each: NextMeasurement, text: str) -> str:
    """Return the value that is expected; nothing for shares of sizes."""
    if len(each.datum.values) > 1:
        return ""
    factor, unit = shown_unit(text, each.datum.quantity, each.datum.kind.unit, each.predicted)
    return in_unit(f"{each.predicted / factor:.4g}", unit)


def next_as_list(found: NextMeasurements) -> list[dict[str, Any]]:
    """Return all measurements as plain values for JSON; `time` is null at the end."""
    return list(without_nan(found.records()))
