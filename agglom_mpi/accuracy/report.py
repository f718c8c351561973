"""The report of `agglom accuracy`: sections as data, and the files that they become.

The sentences of a section are the blocks of a template, `NAME.md.j2`, which `Sentences` fills with
numbers; `report.md.j2` is the document around the sections. Times are processor times.
"""

import math
import os
import platform
import textwrap
from collections.abc import Iterator, Mapping, Sequence
from datetime import UTC, datetime
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from agglom_mpi.analysis.tables import csv_texts
from agglom_mpi.display.table import Column, Table
from agglom_mpi.errors import require_library
from agglom_mpi.formatting import (
    format_digits,
    format_duration,
    format_mean,
    format_percent,
    format_seconds,
)
from agglom_mpi.report.style import COLOURS, Drawing, write_drawing
from agglom_mpi.runtime.provenance import processor
from agglom_mpi.statistics import MeanEstimate
from agglom_mpi.stopwatch import BUSY_RATIO
from agglom_mpi.storage.files import replace_file
from agglom_mpi.version import __version__

if TYPE_CHECKING:
    import jinja2
    import matplotlib.figure
    import pandas as pd

REPORT_NAME: Final = "report.md"
REPORT_LIBRARIES: Final = {"matplotlib": "figures", "pandas": "tables", "jinja2": "documents"}
"""Optional libraries that a report needs, and what for."""
MARKERS: Final = "os^DvPX"
TIME: Final = "processor time per sample (s)"
"""Name of the column of the median time."""
QUARTILES: Final = tuple(
    f"processor time per sample, {which} quartile (s)" for which in ("lower", "upper")
)
"""Names of the columns of the quartiles of the time."""


class RowColumn(Column):
    """A column whose cells show several values of a row, which its format is called with."""

    def cell(self, row: Mapping[str, Any]) -> str:
        """Return the text of a row."""
        assert callable(self.format)
        return self.format(row)


def mean_column(heading: str, value: str, error: str, samples: str) -> RowColumn:
    """Return a column of means with their standard errors, from three values of a row."""
    return RowColumn(
        heading,
        format=lambda row: format_mean(MeanEstimate(row[value], row[error], row[samples])),
    )


def frame_table(
    frame: "pd.DataFrame", title: str, name: str, columns: Sequence[Column] = ()
) -> Table:
    """Return a table of the rows of a frame; without columns it is in a CSV file alone."""
    rows: list[Any] = frame.to_dict("records")
    return Table(columns, rows, title, name)


class ReportSection(NamedTuple):
    """A study as a document: problem, reference, set-ups, curves, failures, conclusions.

    Attributes
    ----------
    title : str
    problem, reference, setups : str
        What is asked, what errors are measured against, and what was run; Markdown paragraphs.
    figures : tuple of Drawing
    tables : tuple of Table
        Everything is in `NAME.csv`, unrounded; the document has those with columns.
    failures : tuple of str
        What did not work, one sentence each, computed from the data.
    conclusions : tuple of str
        What the numbers say, one sentence each, computed from the data.
    """

    title: str
    problem: str
    reference: str
    setups: str
    figures: tuple[Drawing, ...] = ()
    tables: tuple[Table, ...] = ()
    failures: tuple[str, ...] = ()
    conclusions: tuple[str, ...] = ()


class Sentences:
    """Sentences of a section, from the blocks of its template and the numbers of the study.

    Parameters
    ----------
    name
        Of the template, `NAME.md.j2` in this package.
    values
        What the template refers to.
    """

    def __init__(self, name: str, **values: Any) -> None:
        self._template = _templates().get_template(f"{name}.md.j2")
        self._values = values

    def paragraph(self, block: str) -> str:
        """Return a block as one line."""
        return " ".join(self._render(block).split())

    def items(self, block: str) -> tuple[str, ...]:
        """Return the list items of a block, each as one line; an item begins with `- `."""
        items: list[list[str]] = []
        for line in textwrap.dedent(self._render(block)).splitlines():
            if line.startswith("- "):
                items.append(line[2:].split())
            elif items:
                items[-1] += line.split()
        return tuple(" ".join(words) for words in items)

    def _render(self, block: str) -> str:
        return "".join(self._template.blocks[block](self._template.new_context(self._values)))

    def section(
        self, title: str, figures: Sequence[Drawing] = (), tables: Sequence[Table] = ()
    ) -> ReportSection:
        """Return a section whose texts are the blocks of their names."""
        return ReportSection(
            title,
            self.paragraph("problem"),
            self.paragraph("reference"),
            self.paragraph("setups"),
            tuple(figures),
            tuple(tables),
            self.items("failures"),
            self.items("conclusions"),
        )


@cache
def _templates() -> "jinja2.Environment":
    import jinja2

    templates = jinja2.Environment(
        loader=jinja2.FileSystemLoader(Path(__file__).parent),
        undefined=jinja2.StrictUndefined,
        autoescape=False,  # Markdown
        trim_blocks=True,
        lstrip_blocks=True,
    )
    templates.filters |= {
        "fmt": format,
        "initial_capital": lambda text: f"{text[:1].upper()}{text[1:]}",
        "digits": format_digits,
        "duration": format_duration,
        "mean": format_mean,
        "percent": format_percent,
        "seconds": format_seconds,
    }
    return templates


def require_report() -> None:
    """Raise a MissingLibraryError if a library that reports need is not installed."""
    for library, purpose in REPORT_LIBRARIES.items():
        require_library(library, "report", purpose)


def write_document(
    directory: Path,
    title: str,
    facts: Sequence[str],
    chapters: Mapping[str, Sequence[ReportSection]],
) -> Path:
    """Write `report.md` with its figures and CSV files into a directory; return its path.

    Every file is whole under its name or not there.

    Parameters
    ----------
    directory
    title
    facts
        The command that made the report, and facts on the run.
    chapters
        Sections by the heading that they have in common.
    """
    import pandas as pd

    for section in (section for sections in chapters.values() for section in sections):
        for figure in section.figures:
            write_drawing(directory, figure)
        for table in section.tables:
            text = csv_texts(pd.DataFrame(table.rows)).to_csv(index=False)
            replace_file(directory / f"{table.name}.csv", text.encode())
    text = (
        _templates()
        .get_template("report.md.j2")
        .render(title=title, facts=facts, chapters=chapters, machine=list(_machine()))
    )
    replace_file(directory / REPORT_NAME, (text.rstrip() + "\n").encode())
    return directory / REPORT_NAME


def _machine() -> Iterator[str]:
    from importlib.metadata import version

    libraries = ", ".join(f"{name} {version(name)}" for name in ("numpy", "numba", "h5py"))
    yield f"{processor()}, {os.cpu_count()} processors, {platform.system()} {platform.machine()}"
    yield f"agglom_mpi {__version__}, Python {platform.python_version()}, {libraries}"
    yield f"made {datetime.now(UTC).date().isoformat()}"


class Curve(NamedTuple):
    """Points of one method, all of the same shape: cost, error, and what surrounds them.

    Attributes
    ----------
    label
    cost, error
    low, high
        Confidence band of the error.
    cost_low, cost_high
        Spread of the cost.
    """

    label: str
    cost: ArrayLike
    error: ArrayLike
    low: ArrayLike | None = None
    high: ArrayLike | None = None
    cost_low: ArrayLike | None = None
    cost_high: ArrayLike | None = None


def draw_curves(
    figure: "matplotlib.figure.Figure",
    curves: Sequence[Curve],
    cost: str,
    error: str,
    *,
    scales: tuple[str, str] = ("log", "log"),
) -> Any:
    """Draw work-precision curves and return the axes.

    Points are joined in the order of their cost: measured times of steps that cost about the same
    come in any order, and a curve through these in another order would turn back.

    Parameters
    ----------
    cost, error
        Labels of the axes, with units.
    scales
        Of both axes: `log`, `linear`, `symlog`.
    """
    axes = figure.subplots()
    axes.set_xscale(scales[0])
    axes.set_yscale(scales[1])
    for index, curve in enumerate(curves):
        colour, marker = COLOURS[index % len(COLOURS)], MARKERS[index % len(MARKERS)]
        order = np.argsort(np.asarray(curve.cost, float), kind="stable")
        points: list[Any] = [
            None if each is None else np.asarray(each, float)[order] for each in curve[1:]
        ]
        x, y, low, high, x_low, x_high = points
        style: dict[str, Any] = {"color": colour, "marker": marker, "label": curve.label}
        axes.plot(x, y, markersize=4, linewidth=1.2, **style)
        if low is not None:
            axes.fill_between(x, low, high, color=colour, alpha=0.15, linewidth=0)
        if x_low is not None:
            axes.hlines(y, x_low, x_high, color=colour, linewidth=0.8)
    axes.set_xlabel(cost)
    axes.set_ylabel(error)
    if len(curves) > 1:
        axes.legend()
    return axes


def time_columns(seconds: ArrayLike) -> dict[str, float]:
    """Return median and quartiles of times of samples in s, shape (n,), n > 0, as columns.

    The median is the usual time of a sample. The few samples that an interruption made long would
    decide a mean.
    """
    values = np.percentile(np.asarray(seconds, float), (50.0, 25.0, 75.0))
    return dict(zip((TIME, *QUARTILES), values.tolist(), strict=True))


def time_text(row: Any) -> str:
    """Return median and quartiles of a row: `360 µs (340 µs to 410 µs)`."""
    median, low, high = (format_seconds(float(row[name])) for name in (TIME, *QUARTILES))
    return f"{median} ({low} to {high})"


TIME_COLUMN: Final = RowColumn("processor time per sample", format=time_text)


def busy_lines(ratio: float) -> list[str]:
    """Return a warning about a machine that was busy with other work; empty if it was not.

    The `ratio` is that of wall-clock to processor time of all samples; nan where the latter is
    unknown.
    """
    if math.isnan(ratio):
        return [
            "times of samples are wall-clock times: an earlier version of the package, which did "
            "not record processor times, has begun the file"
        ]
    if ratio <= BUSY_RATIO:
        return []
    return [
        f"**made on a busy machine**: samples took {ratio:.2g} times their processor time. All "
        "times are processor times, but these also grow where others use the caches and the clock "
        "rate of the same cores"
    ]
