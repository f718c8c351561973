"""A figure of a campaign file, for the page and for the `plot_*` methods, and the register of all.

A figure is declared by one `Figure` in a module of this package, which registers it.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from inspect import Parameter, Signature
from textwrap import fill
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np

from agglom_mpi.analysis.estimates import objective_of
from agglom_mpi.config.arguments import count_argument
from agglom_mpi.declaration.components import import_modules
from agglom_mpi.errors import require_library
from agglom_mpi.report.sample_particles import RESIMULATION_SECONDS
from agglom_mpi.report.style import SIZE, Drawing, finish, note, styled
from agglom_mpi.storage.reader import CampaignData

if TYPE_CHECKING:
    from agglom_mpi.inference.feasible_set import FeasibleSet
    from agglom_mpi.inference.next_measurement import NextMeasurements
    from agglom_mpi.inference.posterior import Posterior


def objective_label(data: CampaignData) -> str:
    """Return the name of a campaign's objective on an axis; it has no unit."""
    symbol = objective_of(data).symbol if "objective.law" in data.identity else ""
    return f"objective {symbol}" if symbol else "objective"


class FigureOptions(NamedTuple):
    """Choices of a figure, and what takes seconds and was asked for; most depend on none.

    Attributes
    ----------
    string
        Number of a judged string; None: the best.
    seconds
        Processor time for resimulating particles that are not stored, s.
    sensitivity
        Whether sensitivities are asked for.
    feasible_set, mean_posterior, posterior, further
        The feasible set, the posterior of a measured mean, that of all data, and what to measure
        next; None where they are not asked for.
    truth
        Values of searched variables that are marked in the posterior, by name.
    x, y
        Names of the variables of a single panel.
    plotted
        Whether it is plotted by itself, and not for the page.
    """

    string: int | None = None
    seconds: float = RESIMULATION_SECONDS
    sensitivity: bool = False
    feasible_set: "FeasibleSet | None" = None
    mean_posterior: "Posterior | None" = None
    posterior: "Posterior | None" = None
    further: "NextMeasurements | None" = None
    truth: Any = None
    x: str | None = None
    y: str | None = None
    plotted: bool = False


FIGURES: Final[dict[str, "Figure"]] = {}
"""All figures by name, which `figures` fills."""


@dataclass(frozen=True)
class Figure:
    """A figure of a campaign file: where it is shown, what it shows, and how it is drawn.

    Attributes
    ----------
    name
        File stem, and key of `figures`.
    section, place
        Section of the page that shows it, and its place among the figures there.
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
    method
        Name of the method of a campaign file that plots it; empty: none.
    meaning
        Documentation of that method.
    takes
        Arguments of that method: axes or a figure to draw into, and fields of `FigureOptions`.
    """

    name: str
    section: str
    place: int
    data: Callable[[CampaignData, FigureOptions], Any]
    draw: Callable[[Any, Any], Any]
    caption: str | Callable[[Any], str]
    size: tuple[float, float] | Callable[[Any], tuple[float, float]] = SIZE
    empty: str = "nothing to show yet"
    panels: bool = False
    method: str = ""
    meaning: str = ""
    takes: tuple[str, ...] = ("ax",)

    def __post_init__(self) -> None:
        FIGURES[self.name] = self

    def method_of(self, snapshot: Callable[[Any], CampaignData]) -> Callable[..., Any]:
        """Return the method that plots the figure of the rows of a campaign file as they are."""
        kind = Parameter.POSITIONAL_OR_KEYWORD
        taken = [Parameter(name, kind, default=None) for name in self.takes]
        signature = Signature([Parameter("self", kind), *taken])

        def plot(*args: Any, **options: Any) -> Any:
            require_library("matplotlib", "report", "figures")
            given = signature.bind(*args, **options).arguments
            data = snapshot(given.pop("self"))
            target = given.pop("figure" if self.panels else "ax", None)
            if given.get("string") is not None:
                given["string"] = count_argument(data.path, "string", given["string"])
            if "posterior" in self.takes and given.get("posterior") is None:
                from agglom_mpi.inference.data_posterior import data_posterior  # loads SciPy

                given["posterior"] = data_posterior(data)
            if "feasible_set" in self.takes and given.get("feasible_set") is None:
                from agglom_mpi.inference.feasible_set import feasible_set

                given["feasible_set"] = feasible_set(data)
            return self.plot(data, target, FigureOptions(plotted=True, **given))

        plot.__name__, plot.__doc__ = self.method, fill(self.meaning, 92)
        plot.__signature__ = signature  # type: ignore[attr-defined]
        return plot

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
        with styled():
            if target is None:
                from matplotlib import pyplot

                size = SIZE if data is None and callable(self.size) else self._size(data)
                figure = pyplot.figure(figsize=size, layout="constrained")
                target = figure if self.panels else figure.subplots()
            if data is not None:
                axes = self.draw(target, data)
                finish(axes)
                return axes
            ax = target.subplots() if self.panels else target
            note(ax, self.empty)
            return np.array([ax]) if self.panels else ax

    def _size(self, data: Any) -> tuple[float, float]:
        return self.size(data) if callable(self.size) else self.size


@cache
def figures() -> dict[str, Figure]:
    """Return all figures by name, in the order in which each section of the page shows them."""
    import_modules(__package__)
    return dict(sorted(FIGURES.items(), key=lambda each: each[1].place))
