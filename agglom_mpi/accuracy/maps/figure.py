"""The figure of a map: a panel for each method, cells coloured by the error, marks of failures."""

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    import matplotlib.figure

PANEL_SIZE: Final = (3.1, 2.9)
"""Width and height of a panel, inches."""

TROUBLE_COLOURS: Final = (
    *("#D55E00", "#CC79A7", "#000000", "#E69F00", "#8C564B", "#7F7F7F", "#B22222"),
)
"""Colours of kinds of trouble, in the order in which they are met."""

TROUBLE_MARKERS: Final = "sXv^oDP*"
POINT_STYLES: Final[Mapping[bool, Mapping[str, Any]]] = {
    False: {"marker": "o", "markersize": 3.5, "markerfacecolor": "white", "markeredgewidth": 0.8},
    True: {"marker": "*", "markersize": 6.0, "markerfacecolor": "#F0E442", "markeredgewidth": 0.6},
}
"""How scenes are marked, and rows of a paper, whose names are like `[A] row 1`."""


ERROR_LABEL: Final = "relative error of mean b/b⁰"
ERROR_ENDS: Final = (1e-3, 1.0)
"""Ends of the scale of the errors."""


class Axis(NamedTuple):
    """An axis of a map: its label, and the decimal logarithms of its ends."""

    label: str
    low: float
    high: float

    def value(self, share: float) -> float:
        """Return the number at a share of the axis, 0 to 1."""
        return float(10.0 ** (self.low + share * (self.high - self.low)))


class MapPanel(NamedTuple):
    """A method on a map, by its n leaves.

    Attributes
    ----------
    title
    squares
        Left end, middle and right end across, and the same from below, shape (n, 2, 3).
    levels
        Shape (n,).
    errors
        Magnitude of the errors; nan where none is shown, shape (n,).
    troubles
        What is wrong in each leaf; empty where it is sound.
    hatched
        Whether the method may fail there, shape (n,).
    """

    title: str
    squares: NDArray[np.float64]
    levels: NDArray[np.int64]
    errors: NDArray[np.float64]
    troubles: Sequence[str]
    hatched: NDArray[np.bool_]


def map_size(panels: int) -> tuple[float, float]:
    """Return width and height of a figure of some panels, inches."""
    rows, columns = _layout(panels)
    return columns * PANEL_SIZE[0] + 0.9, rows * PANEL_SIZE[1] + 0.6


def _layout(panels: int) -> tuple[int, int]:
    """Return the numbers of rows and columns of some panels."""
    columns = 2 if panels == 4 else min(panels, 3)
    return math.ceil(panels / columns), columns


def draw_map(
    figure: "matplotlib.figure.Figure",
    sides: tuple[Axis, Axis],
    panels: Sequence[MapPanel],
    points: Mapping[str, NDArray[np.float64]],
) -> None:
    """Draw a map.

    Parameters
    ----------
    sides
        Its axes across and up, logarithmic.
    panels
        One for each method.
    points
        Scenes to be marked where they lie on the map, by name, (2,).
    """
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import LogNorm

    rows, columns = _layout(len(panels))
    axes = figure.subplots(rows, columns, sharex=True, sharey=True, squeeze=False)
    colours = ScalarMappable(LogNorm(*ERROR_ENDS), "Blues")
    low, high = (np.array([side.value(end) for side in sides]) for end in (0.0, 1.0))
    shown = {n: at for n, at in points.items() if (low <= at).all() and (at <= high).all()}
    kinds = list(dict.fromkeys(k for panel in panels for k in panel.troubles if k))
    for ax, panel in zip(axes.flat, panels, strict=False):
        _draw_panel(ax, panel, kinds, colours)
        for name, place in shown.items():
            style = POINT_STYLES[name.startswith("[")]
            ax.plot(*place, **style, c="k", ls="none", mec="black", zorder=4, clip_on=False)
        ax.set(xscale="log", yscale="log", xlim=(low[0], high[0]), ylim=(low[1], high[1]))
        _plain_ticks(ax)
    for ax in axes.flat[len(panels) :]:
        ax.set_visible(False)
    for column in range(columns):  # shared axes have their labels in the last row alone
        axes[(len(panels) - 1 - column) // columns, column].tick_params(labelbottom=True)
    figure.supxlabel(sides[0].label, fontsize="medium")
    figure.supylabel(sides[1].label, fontsize="medium")
    figure.colorbar(colours, ax=axes, label=ERROR_LABEL, extend="both", shrink=0.8)
    _add_legend(figure, kinds, shown, any(panel.hatched.any() for panel in panels))


def _plain_ticks(ax: Any) -> None:
    from matplotlib.ticker import NullFormatter

    for axis in (ax.xaxis, ax.yaxis):
        axis.set_minor_formatter(NullFormatter())
    ax.tick_params(labelsize="small")


def _draw_panel(ax: Any, panel: MapPanel, kinds: Sequence[str], colours: Any) -> None:
    """Draw the cells of a method; all of a kind at once, as single patches take long."""
    from matplotlib.collections import PolyCollection

    errors = panel.errors
    shown = np.where(np.isnan(errors)[:, None], 1.0, colours.to_rgba(np.nan_to_num(errors)))
    x, y = panel.squares[:, 0][:, [0, 2, 2, 0]], panel.squares[:, 1][:, [0, 0, 2, 2]]
    corners: Any = np.stack([x, y], axis=-1)
    widths = np.where(panel.levels == 0, 0.3, 0.0)
    ax.add_collection(
        PolyCollection(corners, facecolors=shown, edgecolors="0.85", linewidths=widths, zorder=1)
    )
    if panel.hatched.any():
        edge: dict[str, Any] = {"facecolors": "none", "edgecolors": "0.4", "linewidths": 0.0}
        ax.add_collection(PolyCollection(corners[panel.hatched], **edge, hatch="/////", zorder=3))
    marks = dict.fromkeys(zip(panel.troubles, panel.levels.tolist(), strict=True))
    for kind, level in marks:
        if kind:
            is_one = (np.array(panel.troubles) == kind) & (panel.levels == level)
            style = _mark(kinds.index(kind)) | {"markersize": 4.5 / 2**level + 0.3}
            ax.plot(*panel.squares[is_one, :, 1].T, **style, zorder=2)
    ax.set_title(panel.title, fontsize="small")


def _mark(place: int) -> dict[str, Any]:
    """Return how a kind of trouble is marked, by its place among those of the figure."""
    colour = TROUBLE_COLOURS[place % len(TROUBLE_COLOURS)]
    marker = TROUBLE_MARKERS[place]
    return {"marker": marker, "color": colour, "linestyle": "none", "markeredgewidth": 0.0}


def _add_legend(
    figure: "matplotlib.figure.Figure",
    kinds: Sequence[str],
    points: Mapping[str, Any],
    hatched: bool,
) -> None:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    handles: list[Any] = [
        Line2D([], [], label=kind, **_mark(place)) for place, kind in enumerate(kinds)
    ]
    handles.append(Patch(facecolor="white", edgecolor="0.85", label="not resolved"))
    if hatched:
        handles.append(Patch(facecolor="white", edgecolor="0.4", hatch="/////", label="documented"))
    for label, published in (("scenes", False), ("rows of the papers", True)):
        if any(name.startswith("[") == published for name in points):
            style = POINT_STYLES[published]
            handles.append(Line2D([], [], ls="none", mec="black", label=label, **style))
    figure.legend(
        handles=handles,
        loc="outside upper center",
        ncols=min(6, len(handles)),
        frameon=False,
        fontsize="small",
    )
