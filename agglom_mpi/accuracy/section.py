"""One section of the accuracy report: what was asked, measured and found."""

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple

from agglom_mpi.report.drawing import Drawing

if TYPE_CHECKING:
    import pandas as pd


class Shown(NamedTuple):
    """A column of a table in the document: its heading, and the text of a row of the frame."""

    heading: str
    text: Callable[[Any], str]


class Table(NamedTuple):
    """Numbers of one study: all of them as `NAME.csv`, some as a table in the document.

    Attributes
    ----------
    name : str
        File stem of the CSV.
    caption : str
        One sentence: what a row is.
    frame : pandas.DataFrame
        Everything, unrounded; units in the column names as `seconds per sample (s)`.
    shown : tuple of Shown
        Columns of the document's table, each called with the rows of `frame`; none: CSV alone.
    """

    name: str
    caption: str
    frame: "pd.DataFrame"
    shown: tuple[Shown, ...] = ()


class Section(NamedTuple):
    """A study as a document: problem, reference, set-ups, curves, failures, conclusions.

    Attributes
    ----------
    title : str
    problem, reference, setups : str
        What is asked, what errors are measured against, and what was run; Markdown paragraphs.
    figures : tuple of Drawing
    tables : tuple of Table
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
    tables: tuple[Table, ...]
    failures: tuple[str, ...]
    conclusions: tuple[str, ...]
