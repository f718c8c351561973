"""The best strings side by side: parallel coordinates over the search box."""

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.analysis.ranking import rank_strings
from agglom_mpi.analysis.tables import searched_variables
from agglom_mpi.report.figures.axes import in_unit, say
from agglom_mpi.report.picture import COLOURS, Picture
from agglom_mpi.storage.reader import CampaignData
from agglom_mpi.variables import Variable

if TYPE_CHECKING:
    import matplotlib.figure

Floats = NDArray[np.float64]
Searched = tuple[Variable, float, float, bool]

WIDE: Final = (8.6, 5.0)
"""Inches."""
BEST: Final = 6
FEW: Final = 5
"""Variables whose names have room side by side."""
OTHERS: Final = 40
"""Strings in colour, and those after them in grey."""


def draw_parallel(
    ax: Any, searched: Sequence[Searched], values: Floats, names: Sequence[str]
) -> Any:
    """Draw strings as lines over d variables, each from the bottom to the top of its box.

    Parameters
    ----------
    searched
        The variables, with lower and upper bound and whether they are searched by logarithms.
    values
        Shape (n, d), SI units, the best string first.
    names
        Of the first strings, for the legend; the others are grey.

    Returns
    -------
    matplotlib.axes.Axes
    """
    if not len(values) or not searched:
        say(ax, "no string is judged yet")
        return ax
    heights = np.column_stack([_height(values[:, i], entry) for i, entry in enumerate(searched)])
    across = np.arange(len(searched))
    for at in across:
        ax.axvline(at, color="0.8", linewidth=0.8, zorder=0)
    for place in reversed(range(len(values))):
        best = place < len(names)
        ax.plot(
            across,
            heights[place],
            color=COLOURS[place % len(COLOURS)] if best else "0.8",
            linewidth=1.6 if best else 0.7,
            marker="o" if best else "",
            markersize=4,
            label=names[place] if best else None,
            zorder=2.0 + (len(values) - place) / len(values) if best else 1.0,
        )
    _label(ax, searched)
    handles, labels = ax.get_legend_handles_labels()
    ax.legend(
        handles[::-1],
        labels[::-1],
        loc="lower center",
        bbox_to_anchor=(0.5, 1.1),
        ncols=3,
        frameon=False,
        fontsize="small",
    )
    return ax


def _height(values: Floats, entry: Searched) -> Floats:
    """Place within the box, 0 at the bottom and 1 at the top."""
    _, lower, upper, logarithmic = entry
    if logarithmic:
        return np.log(values / lower) / np.log(upper / lower)
    return (values - lower) / (upper - lower)


def _label(ax: Any, searched: Sequence[Searched]) -> None:
    """Write the ends of the box above and below each line, and names with units at the bottom."""
    ticks = []
    for at, (variable, lower, upper, logarithmic) in enumerate(searched):
        size, unit = in_unit(variable.unit, upper)
        ax.text(at, 1.03, f"{upper / size:.6g}", ha="center", va="bottom", fontsize=8)
        ax.text(at, -0.03, f"{lower / size:.6g}", ha="center", va="top", fontsize=8)
        scale = ", log" if logarithmic else ""
        ticks.append(f"{variable.name.replace('_', ' ')}\n({unit}{scale})")
    slanted = {"rotation": 40, "ha": "right", "rotation_mode": "anchor"}
    ax.set_xticks(range(len(searched)), ticks, **(slanted if len(searched) > FEW else {}))
    ax.tick_params(axis="x", length=0, pad=14, labelsize=9)
    ax.set_yticks([])
    ax.set_ylim(0.0, 1.0)
    ax.set_xlim(-0.4, len(searched) - 0.6)
    ax.spines[["top", "right", "left", "bottom"]].set_visible(False)


def of_data(data: CampaignData) -> tuple[list[Searched], Floats, list[str]]:
    """Return the best strings of a campaign, as `draw_parallel` takes them."""
    shown = rank_strings(data).order[: BEST + OTHERS]
    columns = [data.values(shown, entry[0].name) for entry in searched_variables(data)]
    again = {estimate.string: estimate.objective for estimate in rank_strings(data).estimates}
    names = [
        f"#{place} string {string}: "
        f"{again.get(string, float(rank_strings(data).results[string]['objective'])):.4g}"
        for place, string in enumerate(shown[:BEST], 1)
    ]
    return (
        searched_variables(data),
        np.array(columns, float).reshape(len(columns), len(shown)).T,
        names,
    )


def pictures(data: CampaignData) -> Iterator[Picture]:
    """Yield the picture of a campaign's best strings, if there are any."""
    searched, values, names = of_data(data)
    if not len(values) or not searched:
        return

    def draw(figure: "matplotlib.figure.Figure") -> None:
        draw_parallel(figure.subplots(), searched, values, names)

    more = f", the next {len(values) - len(names)} in grey" if len(values) > len(names) else ""
    yield Picture(
        "best_strings",
        f"The best {len(names)} strings with their objectives{more}. Every line is a variable from "
        "the bottom to the top of the search box.",
        draw,
        WIDE,
    )
