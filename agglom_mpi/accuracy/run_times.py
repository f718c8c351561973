"""Median and quartiles of processor times in reports, and a warning about a busy machine."""

import math
from collections.abc import Iterable, Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike

from agglom_mpi.accuracy.document import ReportSection, TableColumn
from agglom_mpi.formatting import format_seconds
from agglom_mpi.stopwatch import BUSY_RATIO, TimeSpent

WALL_OVER_CPU: Final = "wall-clock over processor time"
"""Name of the column of timed loops that shows a busy machine."""


def time_name(of: str) -> str:
    """Return the name of the column with the median time of a `sample`, a `run` or an `impact`."""
    return f"processor time per {of} (s)"


def quartile_names(of: str) -> tuple[str, str]:
    """Return the names of the columns with the lower and the upper quartile of the time."""
    stem = time_name(of).removesuffix(" (s)")
    return f"{stem}, lower quartile (s)", f"{stem}, upper quartile (s)"


def time_columns(of: str, seconds: ArrayLike) -> dict[str, float]:
    """Return median and quartiles of times in s, shape (n,), n > 0, as columns of a frame.

    The median is the usual time of a sample. The few samples that an interruption made long would
    decide a mean.
    """
    times = np.asarray(seconds, float)
    low, high = quartile_names(of)
    return {
        time_name(of): float(np.median(times)),
        low: float(np.percentile(times, 25.0)),
        high: float(np.percentile(times, 75.0)),
    }


def time_text(row: Any, of: str) -> str:
    """Return median and quartiles of a row of a frame: `360 µs (340 µs to 410 µs)`."""
    median, low, high = (
        format_seconds(float(row[name])) for name in (time_name(of), *quartile_names(of))
    )
    return f"{median} ({low} to {high})"


def shown_time(of: str, heading: str | None = None) -> TableColumn:
    """Return the column of a document's table with median and quartiles of a time."""
    return TableColumn(heading or f"processor time per {of}", lambda row: time_text(row, of))


def ratio_of_clocks(times: Sequence[TimeSpent]) -> float:
    """Return the median ratio of wall-clock to processor time of timed loops."""
    return float(np.median([spent.wall / spent.cpu for spent in times]))


def busy_lines(samples: float, sections: Iterable[ReportSection]) -> list[str]:
    """Return a warning about a machine that was busy with other work; empty if it was not.

    Parameters
    ----------
    samples
        Ratio of wall-clock to processor time of all samples; nan where the latter is unknown.
    sections
        Sections of the report; the median of each column `WALL_OVER_CPU` in their tables counts.
    """
    if math.isnan(samples):
        return [
            "times of samples are wall-clock times: an earlier version of the package, which did "
            "not record processor times, has begun the file"
        ]
    frames = [table.frame for section in sections for table in section.tables]
    loops = [float(f[WALL_OVER_CPU].median()) for f in frames if WALL_OVER_CPU in f and len(f)]
    if max([samples, *loops]) <= BUSY_RATIO:
        return []
    found = f"samples took {samples:.2g} times their processor time"
    if loops:
        found += f", timed loops up to {max(loops):.2g} times theirs"
    return [
        f"**made on a busy machine**: {found}. All times are processor times, but these also grow "
        "where others use the caches and the clock rate of the same cores"
    ]
