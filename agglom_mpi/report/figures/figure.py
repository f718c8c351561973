"""A figure of a campaign file, for the page and for the `plot_*` methods."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from agglom_mpi.analysis.estimates import objective_of
from agglom_mpi.report.drawing import SIZE, Drawing, axes_or_new, figure_or_new, note, style_axes
from agglom_mpi.report.sample_particles import RESIMULATION_SECONDS
from agglom_mpi.storage.reader import CampaignData


def objective_label(data: CampaignData) -> str:
    """Return the name of a campaign's objective on an axis; it has no unit."""
    symbol = objective_of(data).symbol if "objective.law" in data.identity else ""
    return f"objective {symbol}" if symbol else "objective"


class FigureOptions(NamedTuple):
    """Choices of a figure; most figures depend on neither.

    Attributes
    ----------
    string
        Number of a judged string; None: the best.
    seconds
        Processor time for resimulating particles that are not stored, s.
    """

    string: int | None = None
    seconds: float = RESIMULATION_SECONDS


@dataclass(frozen=True)
class Figure:
    """A figure of a campaign file: where it is shown, what it shows, and how it is drawn.

    Attributes
    ----------
    name
        File stem, and key of `FIGURES`.
    section
        Section of the page that shows it; a key of the template `report.html.j2`.
    data
        Returns what `draw` takes as its second argument; None if there is nothing to show.
    draw
        Draws data into axes, or into a figure if `panels`, and returns the axes.
    caption
        What is seen, in one or two sentences; or a function of the data.
    size
        Width and height, inches; or a function of the data.
    empty
        What the axes of a plot say if there is nothing to show.
    panels
        Whether it has several axes.
    on_request
        Whether the page shows it only if it is asked for.
    """

    name: str
    section: str
    data: Callable[[CampaignData, FigureOptions], Any]
    draw: Callable[[Any, Any], Any]
    caption: str | Callable[[Any], str]
    size: tuple[float, float] | Callable[[Any], tuple[float, float]] = SIZE
    empty: str = "nothing to show yet"
    panels: bool = False
    on_request: bool = False

    def drawing(self, data: CampaignData, options: FigureOptions) -> Drawing | None:
        """Return the figure of a campaign, ready to be written; None if there is nothing to show.

        Raises
        ------
        FramesUnavailableError
            If it shows particle frames, and there are none.
        """
        data = self.data(data, options)
        if data is None:
            return None
        caption = self.caption if isinstance(self.caption, str) else self.caption(data)

        def draw(figure: Any) -> Any:
            return self.draw(figure if self.panels else figure.subplots(), data)

        return Drawing(self.name, caption, draw, self._size(data))

    def plot(self, data: CampaignData, target: Any, options: FigureOptions) -> Any:
        """Draw the figure of a campaign into existing axes or a new pyplot figure.

        Parameters
        ----------
        data
        target
            Axes to draw into, or a figure if `panels`; None: a new one.
        options

        Returns
        -------
        matplotlib.axes.Axes or numpy.ndarray of them
            An array, shape (number of panels,), if `panels`.
        """
        data = self.data(data, options)
        size = SIZE if data is None and callable(self.size) else self._size(data)
        if self.panels:
            figure = figure_or_new(target, size)
            if data is not None:
                return self.draw(figure, data)
            ax = figure.subplots()
            note(ax, self.empty)
            return np.array([ax])
        ax = axes_or_new(target, size)
        if data is not None:
            return self.draw(ax, data)
        style_axes(ax)
        note(ax, self.empty)
        return ax

    def _size(self, data: Any) -> tuple[float, float]:
        return self.size(data) if callable(self.size) else self.size
