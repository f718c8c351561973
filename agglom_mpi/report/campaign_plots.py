"""Plots of a campaign file that is open for reading: the figures of its report."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

from agglom_mpi.config.arguments import read_count
from agglom_mpi.errors import require_library
from agglom_mpi.public_face import PublicFace
from agglom_mpi.storage.reader import CampaignData, read_campaign

if TYPE_CHECKING:
    from agglom_mpi.inference.posterior import Posterior

__all__ = ["CampaignPlots"]


class CampaignPlots(metaclass=PublicFace):
    """The plots of a campaign file; every one reads the file again.

    Each takes matplotlib axes to draw into, or makes a new pyplot figure, and returns the axes;
    those with several panels take a figure or subfigure and return an array of axes. Where there
    is nothing to show yet, the axes say so. An ImportError says how to install matplotlib where it
    is missing.

    Parameters
    ----------
    data
        The campaign file.
    """

    def __init__(self, data: CampaignData) -> None:
        self._opened = data

    def _snapshot(self, with_unused: bool = False) -> CampaignData:
        """Return the rows as they are now; the file of a running campaign grows on."""
        opened = self._opened
        data = CampaignData(self.path, opened.attributes, allow_code=opened.allow_code)
        data.with_unused = with_unused or opened.with_unused
        return data

    def __reduce__(self) -> tuple[Any, ...]:
        """Return the path and the permission: a copy opens the file again."""
        return _opened_again, (type(self), self.path.absolute(), self._opened.allow_code)

    @property
    def path(self) -> Path:
        """Path of the file."""
        return self._opened.path

    def plot_convergence(self, ax: Any = None) -> Any:
        """Draw best and mean-of-top objective against generation, with 95 % bands.

        Parameters
        ----------
        ax : matplotlib.axes.Axes, optional
            Where to draw; by default a new figure.

        Returns
        -------
        matplotlib.axes.Axes

        Notes
        -----
        As [A] fig. 4 and [B] fig. 4a–b.

        Examples
        --------
        >>> import agglom_mpi
        >>> file = agglom_mpi.open_campaign("quickstart.h5")
        >>> ax = file.plot_convergence()
        >>> ax.get_xlabel(), ax.get_ylabel()
        ('generation', 'objective Λ')

        Into axes of your own:

        >>> from matplotlib import pyplot
        >>> figure, (left, right) = pyplot.subplots(1, 2, figsize=(12, 5), layout="constrained")
        >>> file.plot_convergence(left) is left
        True
        >>> ax = file.plot_cost(right)
        >>> figure.savefig("search.png")
        """
        return self._plot("convergence", ax)

    def plot_cost(self, ax: Any = None) -> Any:
        """Draw the error of the best objective against run time; see `plot_convergence`.

        Examples
        --------
        >>> import agglom_mpi
        >>> ax = agglom_mpi.open_campaign("quickstart.h5").plot_cost()
        >>> ax.get_xlabel()
        'wall-clock time, all legs (s)'
        """
        return self._plot("cost", ax)

    def plot_radii(self, string: int | None = None, ax: Any = None) -> Any:
        """Draw how the final radii of a string are distributed, with their moments ([A] fig. 5).

        Radii that are not stored are resimulated, for a second of processor time at most; if no
        sample is that fast, the mean radii of the samples are shown, and the axis says so.

        Parameters
        ----------
        string : int, optional
            Number of a judged string; by default the best.
        ax : matplotlib.axes.Axes, optional

        Returns
        -------
        matplotlib.axes.Axes

        Raises
        ------
        ValueError
            If the string is not judged.

        Examples
        --------
        >>> import agglom_mpi
        >>> ax = agglom_mpi.open_campaign("quickstart.h5").plot_radii()
        >>> ax.get_title().startswith("mean ")
        True
        """
        return self._plot("radii", ax, string)

    def plot_cloud(self, string: int | None = None, figure: Any = None) -> Any:
        """Draw the particles of a sample at successive times ([B] fig. 5).

        Frames that are not stored are resimulated; the first time on a machine, the kind of scene
        is compiled, which takes 10 s or more, and 3 s where campaigns of it were run.

        Parameters
        ----------
        string : int, optional
            Number of a judged string; by default the best.
        figure : matplotlib.figure.Figure or SubFigure, optional

        Returns
        -------
        numpy.ndarray
            The axes, one for each time.

        Raises
        ------
        ValueError
            If the string is not judged, or its samples are too long to be simulated again.

        Examples
        --------
        >>> import agglom_mpi
        >>> axes = agglom_mpi.open_campaign("quickstart.h5").plot_cloud()
        >>> axes[0].get_title()
        't = 0 s, 100 particles'
        """
        return self._plot("cloud", figure, string)

    def plot_search_paths(self, figure: Any = None) -> Any:
        """Draw each variable of the best strings against generation, one panel each.

        Parameters
        ----------
        figure : matplotlib.figure.Figure or SubFigure, optional

        Returns
        -------
        numpy.ndarray
            The axes, one for each variable that is searched.

        Examples
        --------
        >>> import agglom_mpi
        >>> axes = agglom_mpi.open_campaign("quickstart.h5").plot_search_paths()
        >>> [ax.get_ylabel() for ax in axes]
        ['relative speed (m/s)', 'size ratio', 'hardness (MPa)']
        """
        return self._plot("search_paths", figure)

    def plot_best(self, ax: Any = None) -> Any:
        """Draw the best strings as lines over the search box; see `plot_convergence`.

        Examples
        --------
        >>> import agglom_mpi
        >>> ax = agglom_mpi.open_campaign("quickstart.h5").plot_best()
        >>> [label.get_text().split() for label in ax.get_xticklabels()][0]
        ['relative', 'speed', '(m/s)']
        """
        return self._plot("best_strings", ax)

    def plot_data_fit(self, string: int | None = None, figure: Any = None) -> Any:
        """Draw measured data beside the best strings, or one; see `plot_convergence`.

        Each size curve has a cumulative and a density panel; all other data have one of residuals.

        Examples
        --------
        >>> import agglom_mpi
        >>> [ax] = agglom_mpi.open_campaign("quickstart.h5").plot_data_fit()  # has no data
        >>> len(ax.lines)
        0
        """
        return self._plot("data_fit", figure, string)

    def plot_growth(self, string: int | None = None, figure: Any = None) -> Any:
        """Draw sizes of the best strings, or of one, over time, with data; see `plot_convergence`.

        The times are those of the measured data; data at a single time show no growth.

        Examples
        --------
        >>> import agglom_mpi
        >>> [ax] = agglom_mpi.open_campaign("quickstart.h5").plot_growth()  # has no data
        >>> len(ax.lines)
        0
        """
        return self._plot("growth", figure, string)

    def plot_posterior(
        self,
        truth: "dict[str, float | str] | None" = None,
        figure: Any = None,
        posterior: "Posterior | None" = None,
    ) -> Any:
        """Draw the posterior given all measured data as a corner plot: `posterior()`, drawn.

        Parameters
        ----------
        truth : dict, optional
            Values of searched variables that are marked, as numbers in SI units or texts.
        figure : matplotlib.figure.Figure or SubFigure, optional
        posterior : Posterior, optional
            What `posterior()` returned; by default it is computed, which takes seconds.

        Returns
        -------
        numpy.ndarray
            The axes, shape (m, m); those above the diagonal are not shown.

        Raises
        ------
        PosteriorError
            If the campaign has no data, or too few strings.
        CampaignError
            If `truth` names no searched variable, or its value has another unit.

        Examples
        --------
        >>> import agglom_mpi
        >>> file = agglom_mpi.open_campaign("quickstart.h5")
        >>> file.plot_posterior(truth={"hardness": "60 MPa"})  # has no data
        Traceback (most recent call last):
            ...
        agglom_mpi.inference.posterior.PosteriorError: quickstart.h5: ...
        """
        require_library("matplotlib", "report", "figures")
        from agglom_mpi.report.figures import posterior_figures

        found = self._posterior(posterior)
        return posterior_figures.plot_posterior(self._snapshot(), found, truth or {}, figure)

    def plot_predictive(self, figure: Any = None, posterior: "Posterior | None" = None) -> Any:
        """Draw all measured data beside what the posterior predicts for them.

        Parameters and errors are those of `plot_posterior`. Panels are those of `plot_data_fit`;
        each datum has a p-value, which is near 0 where it disagrees.

        Returns
        -------
        numpy.ndarray
            The axes, one for each panel.

        Examples
        --------
        >>> import agglom_mpi
        >>> agglom_mpi.open_campaign("quickstart.h5").plot_predictive()  # has no data
        Traceback (most recent call last):
            ...
        agglom_mpi.inference.posterior.PosteriorError: quickstart.h5: ...
        """
        require_library("matplotlib", "report", "figures")
        from agglom_mpi.report.figures import posterior_figures

        found = self._posterior(posterior)
        return posterior_figures.plot_predictive(self._snapshot(), found, figure)

    def plot_finite_size(self, ax: Any = None) -> Any:
        """Draw the growth of the best strings against 1/N, with limits; see `plot_convergence`.

        Examples
        --------
        >>> import agglom_mpi
        >>> ax = agglom_mpi.open_campaign("quickstart.h5").plot_finite_size()
        >>> len(ax.lines)  # no larger volumes were asked for
        0
        """
        return self._plot("finite_size", ax)

    def plot_ensembles(self, ax: Any = None) -> Any:
        """Draw running objectives of the best strings and where stopping rules end them.

        See `plot_convergence`.

        Examples
        --------
        >>> import agglom_mpi
        >>> ax = agglom_mpi.open_campaign("quickstart.h5").plot_ensembles()
        >>> ax.get_xlabel()
        'completed samples of the string'
        """
        return self._plot("ensembles", ax)

    def plot_finalists(self, ax: Any = None) -> Any:
        """Draw the best strings as searched and on fresh samples; see `plot_convergence`.

        Examples
        --------
        >>> import agglom_mpi
        >>> ax = agglom_mpi.open_campaign("quickstart.h5").plot_finalists()
        >>> len(ax.get_yticks())
        6
        """
        return self._plot("finalists", ax)

    def plot_samples(self, ax: Any = None) -> Any:
        """Draw how many samples strings took; see `plot_convergence`.

        Examples
        --------
        >>> import agglom_mpi
        >>> ax = agglom_mpi.open_campaign("quickstart.h5").plot_samples()
        >>> ax.get_xlabel()
        'samples of a string'
        """
        return self._plot("samples_per_string", ax)

    def plot_busy(self, ax: Any = None) -> Any:
        """Draw the share of the time in which the ranks simulated; see `plot_convergence`.

        Examples
        --------
        >>> import agglom_mpi
        >>> ax = agglom_mpi.open_campaign("quickstart.h5").plot_busy()
        >>> ax.get_ylabel()
        'time in which ranks simulate (%)'
        """
        return self._plot("busy", ax)

    def plot_next_measurement(self, ax: Any = None, posterior: "Posterior | None" = None) -> Any:
        """Draw what each further measurement would leave of the box; takes a minute.

        Parameters
        ----------
        ax : matplotlib.axes.Axes, optional
        posterior : Posterior, optional
            What `posterior()` returned; by default it is computed. Its `what_to_measure_next` has
            the numbers.

        Returns
        -------
        matplotlib.axes.Axes

        Raises
        ------
        PosteriorError
            If the campaign has no data, or too few strings.

        Examples
        --------
        >>> import agglom_mpi
        >>> agglom_mpi.open_campaign("quickstart.h5").plot_next_measurement()  # has no data
        Traceback (most recent call last):
            ...
        agglom_mpi.inference.posterior.PosteriorError: quickstart.h5: ...
        """
        require_library("matplotlib", "report", "figures")
        from matplotlib import pyplot

        from agglom_mpi.report.figures.next_measurement import draw_next

        found = self._posterior(posterior).next_measurements()
        return draw_next(pyplot.subplots()[1] if ax is None else ax, found)

    def _posterior(self, known: "Posterior | None") -> "Posterior":
        """Return the posterior of the data, which is computed unless it is known."""
        from agglom_mpi.inference.data_posterior import data_posterior

        return data_posterior(self._snapshot()) if known is None else known

    def _count(self, field: str, value: int, least: int = 0) -> int:
        """Return a whole number that is an argument; raise an ArgumentError for anything else."""
        # Imported here: reading a file does not need what reads a campaign's text.
        from agglom_mpi.config.yaml_source import ArgumentError

        try:
            return read_count(value, least)
        except ValueError as error:
            raise ArgumentError.of(self.path, field, error) from None

    def _plot(self, name: str, target: Any, string: int | None = None) -> Any:
        """Draw a figure of the report into axes or a figure, and return the axes."""
        if string is not None:
            string = self._count("string", string)
        require_library("matplotlib", "report", "figures")
        from agglom_mpi.report.figures import FIGURES
        from agglom_mpi.report.figures.figure import FigureOptions

        return FIGURES[name].plot(self._snapshot(), target, FigureOptions(string))


def _opened_again(kind: type[CampaignPlots], path: Path, allow_code: bool) -> CampaignPlots:
    return kind(read_campaign(path, allow_code=allow_code))
