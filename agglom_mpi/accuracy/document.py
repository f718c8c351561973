"""The accuracy report: sections as data, and the Markdown, figures and CSV files they become.

The sentences of a section are the blocks of a template beside its module, `NAME.md.j2`; a section
fills them with numbers by `Sentences`. `report.md.j2` is the document around the sections.
"""

import os
import platform
import textwrap
from collections.abc import Callable, Iterator, Sequence
from datetime import UTC, datetime
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from agglom_mpi.analysis.tables import csv_texts
from agglom_mpi.formatting import (
    format_digits,
    format_duration,
    format_mean,
    format_percent,
    format_seconds,
)
from agglom_mpi.report.drawing import COLOURS, Drawing, log_ticks, write_drawing
from agglom_mpi.runtime.provenance import processor
from agglom_mpi.statistics import MeanEstimate
from agglom_mpi.storage.files import replace_file
from agglom_mpi.version import __version__

if TYPE_CHECKING:
    import jinja2
    import matplotlib.figure
    import pandas as pd

NAME: Final = "report.md"
MARKERS: Final = "os^DvPX"


class TableColumn(NamedTuple):
    """A column of a table in the document: its heading, and the text of a row of the frame."""

    heading: str
    text: Callable[[Any], str]

    @classmethod
    def number(cls, name: str, spec: str, heading: str = "") -> "TableColumn":
        """Return a column of a frame in a format; its heading is its name, if none is given."""
        return cls(heading or name, lambda row: format(row[name], spec))

    @classmethod
    def mean(cls, heading: str, value: str, error: str, samples: str) -> "TableColumn":
        """Return means with their standard errors, from three columns of a frame."""
        return cls(
            heading, lambda row: format_mean(MeanEstimate(row[value], row[error], row[samples]))
        )


class ReportTable(NamedTuple):
    """Numbers of one study: all of them as `NAME.csv`, some as a table in the document.

    Attributes
    ----------
    name : str
        File stem of the CSV.
    caption : str
        One sentence: what a row is.
    frame : pandas.DataFrame
        Everything, unrounded; units in the column names as `seconds per sample (s)`.
    shown : tuple of TableColumn
        Columns of the document's table, each called with the rows of `frame`; none: CSV alone.
    """

    name: str
    caption: str
    frame: "pd.DataFrame"
    shown: tuple[TableColumn, ...] = ()


class ReportSection(NamedTuple):
    """A study as a document: problem, reference, set-ups, curves, failures, conclusions.

    Attributes
    ----------
    title : str
    problem, reference, setups : str
        What is asked, what errors are measured against, and what was run; Markdown paragraphs.
    figures : tuple of Drawing
    tables : tuple of ReportTable
    failures : tuple of str
        What did not work, one sentence each, computed from the data.
    conclusions : tuple of str
        What the numbers say, one sentence each, computed from the data.
    """

    title: str
    problem: str
    reference: str
    setups: str
    figures: tuple[Drawing, ...]
    tables: tuple[ReportTable, ...]
    failures: tuple[str, ...]
    conclusions: tuple[str, ...]


class Chapter(NamedTuple):
    """Sections under a common heading."""

    title: str
    sections: tuple[ReportSection, ...]


class Header(NamedTuple):
    """What the report is of: its title, the command that made it, and facts on the run."""

    title: str
    command: str
    facts: tuple[str, ...]


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

    def paragraph(self, block: str, **values: Any) -> str:
        """Return a block as one line, filled with further values."""
        return " ".join(self._render(block, values).split())

    def items(self, block: str, **values: Any) -> tuple[str, ...]:
        """Return the list items of a block, each as one line; an item begins with `- `."""
        items: list[list[str]] = []
        for line in textwrap.dedent(self._render(block, values)).splitlines():
            if line.startswith("- "):
                items.append(line[2:].split())
            elif items:
                items[-1] += line.split()
        return tuple(" ".join(words) for words in items)

    def section(
        self,
        title: str,
        figures: tuple[Drawing, ...] = (),
        tables: tuple[ReportTable, ...] = (),
        **values: Any,
    ) -> ReportSection:
        """Return a section whose texts are the blocks of their names, with further values."""
        problem, reference, setups = (
            self.paragraph(block, **values) for block in ("problem", "reference", "setups")
        )
        failures, conclusions = (
            self.items(block, **values) for block in ("failures", "conclusions")
        )
        return ReportSection(
            title, problem, reference, setups, figures, tables, failures, conclusions
        )

    def _render(self, block: str, values: dict[str, Any]) -> str:
        context = self._template.new_context({**self._values, **values})
        return "".join(self._template.blocks[block](context))


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


def write_document(directory: Path, header: Header, chapters: Sequence[Chapter]) -> Path:
    """Write `report.md` with its figures and CSV files into a directory; return its path.

    Every file is whole under its name or not there.
    """
    for section in (section for chapter in chapters for section in chapter.sections):
        for figure in section.figures:
            write_drawing(directory, figure)
        for table in section.tables:
            replace_file(
                directory / f"{table.name}.csv", csv_texts(table.frame).to_csv(index=False).encode()
            )
    template = _templates().get_template("report.md.j2")
    text = template.render(header=header, chapters=chapters, rows=_rows, machine=list(_machine()))
    replace_file(directory / NAME, (text.rstrip() + "\n").encode())
    return directory / NAME


def _rows(table: ReportTable) -> Iterator[str]:
    """Yield the rows of the document's table as Markdown."""
    for _, row in table.frame.iterrows():
        yield " | ".join(column.text(row).replace("|", "¦") for column in table.shown)


def _machine() -> Iterator[str]:
    """Yield facts on the machine and the libraries that the report was made with."""
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
    zero: bool = False,
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
    zero
        Draw a line where the error is zero, for signed errors on a linear scale.
    """
    axes = figure.subplots()
    axes.set_xscale(scales[0])
    axes.set_yscale(scales[1])
    for index, curve in enumerate(curves):
        _add_curve(axes, curve, index)
    if zero:
        axes.axhline(0.0, color="0.5", linewidth=0.8)
    if scales[0] == "log":
        log_ticks(axes.xaxis)
    axes.set_xlabel(cost)
    axes.set_ylabel(error)
    axes.grid(True, which="major", color="0.9", linewidth=0.6)
    if len(curves) > 1:
        axes.legend(frameon=False, fontsize="small")
    return axes


def _add_curve(axes: Any, curve: Curve, index: int) -> None:
    """Add one curve with its band to axes; `index` picks colour and marker."""
    colour = COLOURS[index % len(COLOURS)]
    order = np.argsort(np.asarray(curve.cost, float), kind="stable")
    cost, error, *around = (
        None if values is None else np.asarray(values, float)[order] for values in curve[1:]
    )
    assert cost is not None
    assert error is not None
    low, high, cost_low, cost_high = around
    axes.plot(
        cost,
        error,
        color=colour,
        marker=MARKERS[index % len(MARKERS)],
        markersize=4,
        linewidth=1.2,
        label=curve.label,
    )
    if low is not None and high is not None:
        axes.fill_between(cost, low, high, color=colour, alpha=0.15, linewidth=0)
    if cost_low is not None and cost_high is not None:
        axes.hlines(error, cost_low, cost_high, color=colour, linewidth=0.8)
