"""Where the search went: each variable of the best strings against generation."""

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.analysis.tables import searched_variables
from agglom_mpi.report.figures.axes import grid, in_unit, label, whole_numbers
from agglom_mpi.report.picture import COLOURS, Picture
from agglom_mpi.storage.reader import CampaignData

if TYPE_CHECKING:
    import matplotlib.figure

Floats = NDArray[np.float64]

PANEL: Final = (2.7, 2.0)
"""Inches of a panel."""


class Path(NamedTuple):
    """The course of one variable over G generations, in SI units.

    Attributes
    ----------
    name, unit
    lower, upper
        Of the search box.
    logarithmic
        Whether it is searched by its logarithm.
    best, least, most
        Value of the best string after each generation, and the range of the best `top` strings,
        shape (G,).
    tried, when
        Values of all strings, and the generation of each, from 1, shape (n,).
    """

    name: str
    unit: str
    lower: float
    upper: float
    logarithmic: bool
    best: Floats
    least: Floats
    most: Floats
    tried: Floats
    when: Floats


def paths(data: CampaignData) -> list[Path]:
    """Return the course of each variable that is searched."""
    rows, found = data.generation_rows(), []
    judged = np.isin(data.string_rows()["string"], data.result_rows()["string"])
    strings = data.string_rows()[judged]
    for variable, lower, upper, logarithmic in searched_variables(data):
        tops = [data.values(row["population"][: row["top"]], variable.name) for row in rows]
        tops = [values[np.isfinite(values)] for values in tops]
        found.append(
            Path(
                variable.name,
                variable.unit,
                lower,
                upper,
                logarithmic,
                data.values(rows["best_string"], variable.name),
                np.array([v.min() if len(v) else np.nan for v in tops]),
                np.array([v.max() if len(v) else np.nan for v in tops]),
                strings[variable.name],
                strings["generation"] + 1.0,
            )
        )
    return found


def paths_size(count: int) -> tuple[float, float]:
    """Width and height in inches of the figure of so many variables."""
    columns = _columns(count)
    return PANEL[0] * columns, PANEL[1] * -(-count // columns) + 0.7


def _columns(count: int) -> int:
    """Panels in a row: three, or five where there are ten variables."""
    return min(count, 3 if count <= 9 else 5) or 1


def draw_paths(figure: "matplotlib.figure.Figure", found: Sequence[Path]) -> Any:
    """Draw one panel for each of n variables into a figure, and return their axes, shape (n,)."""
    columns = _columns(len(found))
    rows = -(-len(found) // columns)
    axes = figure.subplots(rows, columns, sharex=True, squeeze=False).ravel()
    for unused in axes[len(found) :]:
        unused.remove()
    axes = axes[: len(found)]
    for place, (ax, path) in enumerate(zip(axes, found, strict=True)):
        _draw_path(ax, path)
        if place + columns >= len(found):
            ax.set_xlabel("generation")
            ax.xaxis.set_tick_params(labelbottom=True)
    figure.legend(
        *axes[0].get_legend_handles_labels(),
        loc="outside lower center",
        ncols=3,
        frameon=False,
        fontsize="small",
    )
    return axes


def _draw_path(ax: Any, path: Path) -> None:
    size, unit = in_unit(path.unit, path.upper)
    generation = np.arange(1, len(path.best) + 1)
    grid(ax)
    ax.plot(
        path.when, path.tried / size, ".", color="0.75", markersize=2.5, label="all strings judged"
    )
    ax.fill_between(
        generation,
        path.least / size,
        path.most / size,
        color=COLOURS[5],
        alpha=0.45,
        linewidth=0,
        label="range of the best strings",
    )
    marker = "o" if len(generation) < 30 else ""
    ax.plot(
        generation,
        path.best / size,
        color=COLOURS[0],
        marker=marker,
        markersize=2.5,
        label="best string",
    )
    ax.set_yscale("log" if path.logarithmic else "linear")
    ax.set_ylim(path.lower / size, path.upper / size)
    ax.set_ylabel(label(path.name, unit), fontsize=8.5)
    ax.tick_params(labelsize=8)
    whole_numbers(ax.xaxis)


def pictures(data: CampaignData) -> Iterator[Picture]:
    """Yield the picture of a campaign, if a generation is done and something is searched."""
    found = paths(data)
    if not found or not len(data.generation_rows()):
        return
    yield Picture(
        "search_paths",
        "Variables of the best string after each generation, over the range of the best strings "
        "(their spread at the end is that of the answer) and all strings that were judged. The "
        "panels are as high as the search box.",
        lambda figure: draw_paths(figure, found),
        paths_size(len(found)),
    )
