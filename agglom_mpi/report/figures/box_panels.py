"""Panels of weighted points of the search box: marginals, and pairs of variables as a corner plot.

Axes are the coordinates in which the campaign searches, with ticks in the unit of each variable.
"""

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any, Final, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.analysis.shown_units import unit_of_variable
from agglom_mpi.report.style import (
    COLOURS,
    PAGE,
    few_ticks,
    field_map,
    tick_text,
    variable_label,
)

if TYPE_CHECKING:
    import matplotlib.figure

    from agglom_mpi.inference.searched_box import SearchedBox
    from agglom_mpi.variables import Variable

Floats = NDArray[np.float64]

LINE_COLOUR: Final = COLOURS[1]
"""Colour of contours, which stands out from both ends of the panels' scale."""
LineStyle = Literal["dashed", "solid"]
REGIONS: Final[tuple[tuple[float, LineStyle], ...]] = ((0.9, "dashed"), (0.5, "solid"))
"""Shares of a distribution in the regions of a pair of variables, and how they are drawn."""
MARGINAL_BARS: Final = 24
"""Number of bars of a marginal."""
MAX_PLOTTED_VARIABLES: Final = 6
"""Maximum number of variables of a corner plot."""
PAIR_PANEL_SIZE: Final = 1.9
"""Width and height of a panel of a corner plot where a page has room for it, inches."""


class BoxPoints(NamedTuple):
    """Weighted points of the search box, and the variables that panels show.

    Attributes
    ----------
    box
    names
        The variables in the order of the panels.
    units
        Coordinates of the points on the scales of the search, in units of the box, (n, d).
    weights
        Shape (n,).
    lower, upper
        Range that panels span, in units of the box, (d,).
    """

    box: "SearchedBox"
    names: list[str]
    units: Floats
    weights: Floats
    lower: Floats
    upper: Floats

    def variable(self, name: str) -> "Variable":
        """Return a variable by its name."""
        return self.box.own[self.box.names.index(name)]

    def column(self, name: str) -> Floats:
        """Return the coordinate of a variable at each point, (n,)."""
        return self.units[:, self.box.names.index(name)]

    def ends(self, name: str) -> tuple[float, float]:
        """Return the range of a variable that panels span, in units of the box."""
        place = self.box.names.index(name)
        return float(self.lower[place]), float(self.upper[place])

    def coordinates(self, name: str, values: Sequence[float] | Floats) -> Floats:
        """Return the coordinates of values of a variable in SI units, (m,), the same shape."""
        place, variable = self.box.names.index(name), self.variable(name)
        marked = np.tile(self.box.space.from_unit(self.lower[None]), (len(values), 1))
        marked[:, variable.column] = variable.components(np.asarray(values, np.float64))
        return np.asarray(self.box.space.to_unit(marked)[:, place])


def corner_size(count: int) -> tuple[float, float]:
    """Return width and height of a corner plot of some variables, inches."""
    side = PAIR_PANEL_SIZE * min(count, MAX_PLOTTED_VARIABLES) + 0.6
    return min(max(side + 0.6, 4.4), PAGE), min(max(side, 3.8), PAGE - 0.4)


def draw_corner(
    figure: "matplotlib.figure.Figure",
    points: BoxPoints,
    draw_one: Callable[[Any, str], object],
    draw_pair: Callable[[Any, str, str], object],
) -> Any:
    """Draw a panel for each variable and each pair, and return the axes, shape (m, m).

    Parameters
    ----------
    figure
    points
    draw_one
        Draws a variable into axes.
    draw_pair
        Draws a pair of variables, that of the abscissa first, into axes.
    """
    names = points.names[:MAX_PLOTTED_VARIABLES]
    count = len(names)
    axes = figure.subplots(count, count, squeeze=False)
    for i, row in enumerate(names):
        for j, column in enumerate(names):
            ax = axes[i, j]
            if j > i:
                ax.remove()
                continue
            if i == j:
                draw_one(ax, row)
                _scale_density(ax)
            else:
                draw_pair(ax, column, row)
                ax.set_xlim(*points.ends(column))
                ax.set_ylim(*points.ends(row))
                scale_axis(ax.yaxis, points, row, label=j == 0)
            scale_axis(ax.xaxis, points, column, label=i == count - 1)
    return axes


def corner_legend(figure: "matplotlib.figure.Figure", handles: Sequence[Any]) -> None:
    """Put a legend into the upper right half of a corner plot, which is empty."""
    legend = figure.legend(
        handles=list(handles),
        loc="upper right",
        bbox_to_anchor=(0.93, 0.83),
    )
    legend.set_in_layout(False)


def contour_handle(style: LineStyle, label: str) -> Any:
    """Return the entry of a legend for contours."""
    from matplotlib.lines import Line2D

    return Line2D([], [], color=LINE_COLOUR, linestyle=style, label=label, linewidth=1.2)


def region_handles(of: str) -> list[Any]:
    """Return the entries of a legend for the regions of something: `90 % of the posterior`."""
    return [contour_handle(style, f"{100 * share:.0f} % of the {of}") for share, style in REGIONS]


def pair_edges(points: BoxPoints, column: str, row: str, cells: int) -> list[Floats]:
    """Return the edges of the cells of a pair's panel, (cells + 1,) along each side."""
    return [np.linspace(*points.ends(each), cells + 1) for each in (column, row)]


def draw_field(ax: Any, edges: Sequence[Floats], field: Floats, most: float) -> Any:
    """Draw a field, (m, m), in the cells of a pair's panel, from 0 to `most`; return the image."""
    style = {"cmap": field_map(), "vmin": 0.0, "vmax": most, "rasterized": True}
    return ax.pcolormesh(*edges, field.T, **style)


def draw_contour(
    ax: Any, edges: Sequence[Floats], field: Floats, level: float, style: LineStyle
) -> None:
    """Draw where a field, (m, m), in the cells of a panel has a level."""
    if field.min() < level < field.max():
        # Cells at the edge go on beyond it, so that lines end there.
        sides = [np.concatenate([e[:1], 0.5 * (e[:-1] + e[1:]), e[-1:]]) for e in edges]
        wide = np.pad(field, 1, mode="edge").T
        ax.contour(*sides, wide, [level], colors=LINE_COLOUR, linestyles=style, linewidths=1.0)


def draw_regions(ax: Any, edges: Sequence[Floats], density: Floats) -> None:
    """Draw the smallest regions of a pair's panel that hold the shares of `REGIONS`."""
    for share, style in REGIONS:
        draw_contour(ax, edges, density, region_level(density, share), style)


def region_level(density: Floats, share: float) -> float:
    """Return the density above which the smallest region with a share of it lies; equal cells."""
    descending = np.sort(density, axis=None)[::-1]
    reached = np.cumsum(descending)
    place = int(np.searchsorted(reached, share * reached[-1]))
    return float(descending[min(place, len(descending) - 1)])


def draw_marginal(ax: Any, points: BoxPoints, name: str, colour: str) -> None:
    """Draw the density of a variable over that of the prior, which is uniform over the box."""
    edges = np.linspace(*points.ends(name), MARGINAL_BARS + 1)
    mass = np.histogram(points.column(name), edges, weights=points.weights)[0]
    density = mass / mass.sum() / np.diff(edges)
    ax.stairs(density, edges, fill=True, color=colour)
    ax.axhline(1.0, color="0.3", linewidth=0.8, linestyle="--")
    ax.set_ylim(bottom=0.0)
    ax.set_xlim(edges[0], edges[-1])
    ax.spines[["top", "right"]].set_visible(False)


def _scale_density(ax: Any) -> None:
    """Label the densities of a marginal on the right, where a corner plot has room."""
    from matplotlib.ticker import MaxNLocator

    ax.yaxis.tick_right()
    ax.yaxis.set_label_position("right")
    ax.spines["right"].set_visible(True)
    ax.spines["left"].set_visible(False)
    ax.yaxis.set_major_locator(MaxNLocator(3))
    ax.set_ylabel("density over prior")


def scale_axis(axis: Any, points: BoxPoints, name: str, label: bool) -> None:
    """Label an axis of a variable's coordinate with its values, name and unit."""
    variable = points.variable(name)
    first, last = variable.values(
        points.box.space.from_unit(np.array([points.lower, points.upper]))
    )
    factor, unit = unit_of_variable(points.box.campaign.text, variable)
    ticks = few_ticks(first / factor, last / factor, variable.logarithmic)
    at = points.coordinates(name, ticks * factor)
    axis.set_ticks(at, [tick_text(tick) for tick in ticks] if label else [""] * len(ticks))
    if label:
        axis.set_label_text(variable_label(variable, unit))
