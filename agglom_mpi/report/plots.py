"""The figures of a campaign as methods of its file; drawn by `agglom_mpi.report.figures`."""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from agglom_mpi.storage.reader import CampaignData


class Plots:
    """Methods that draw what is in a campaign file now.

    Each takes matplotlib axes to draw into, or makes a new figure of pyplot's, and returns the
    axes; those with several panels take a figure (or a subfigure) and return an array of axes.
    Where there is nothing to show yet, the axes say so. An ImportError says how to install
    matplotlib where it is missing.
    """

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
        ('generation', 'objective Λ (1)')

        Into axes of your own:

        >>> from matplotlib import pyplot
        >>> figure, (left, right) = pyplot.subplots(1, 2, figsize=(12, 5), layout="constrained")
        >>> file.plot_convergence(left) is left
        True
        >>> ax = file.plot_cost(right)
        >>> figure.savefig("search.png")
        """
        from agglom_mpi.report.figures import axes, convergence

        ax, found = axes.axes_for(ax), self._data()
        again = convergence.fresh_best(found)
        return convergence.draw_convergence(
            ax, convergence.history(found), axes.objective_label(found), again
        )

    def plot_cost(self, ax: Any = None) -> Any:
        """Draw the error of the best objective against run time; see `plot_convergence`.

        Examples
        --------
        >>> import agglom_mpi
        >>> ax = agglom_mpi.open_campaign("quickstart.h5").plot_cost()
        >>> ax.get_xlabel()
        'wall-clock time, all legs (s)'
        """
        from agglom_mpi.report.figures import axes, convergence, cost

        return cost.draw_cost(axes.axes_for(ax), convergence.history(self._data()))

    def plot_radii(self, string: int | None = None, ax: Any = None) -> Any:
        """Draw how the final radii of a string are distributed, with their moments ([A] fig. 5).

        Radii that are not stored are simulated again, as far as a second goes; otherwise the mean
        radii of the samples are shown, and the axis says so.

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
        from agglom_mpi.analysis.ranking import judged_string
        from agglom_mpi.report import sample_frames
        from agglom_mpi.report.figures import axes, radii

        ax, found = axes.axes_for(ax), self._data()
        string = judged_string(found, string)
        shown = None if string is None else sample_frames.final_radii(found, string)
        return radii.draw_radii(ax, shown, radii.target_ratio(found))

    def plot_cloud(self, string: int | None = None, figure: Any = None) -> Any:
        """Draw the particles of a sample at successive times ([B] fig. 5).

        Pictures that are not stored are simulated again; the first time that a kind of scene is
        looked at, it is compiled, 20 s or more.

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
        from agglom_mpi.analysis.ranking import judged_string
        from agglom_mpi.report import sample_frames
        from agglom_mpi.report.figures import axes, cloud

        found = self._data()
        string = judged_string(found, string)
        film = None if string is None else sample_frames.frames_of(found, string)
        if film is None:
            raise ValueError(f"{self}: no pictures of a sample, and none can be made in a second")
        figure = axes.figure_for(
            figure, cloud.cloud_size(len(sample_frames.informative_frames(film.frames)))
        )
        return sample_frames.draw_frames(figure, film, float(found.identity["scene.half_width"]))

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
        ['relative speed (m/s)', 'size ratio (1)', 'hardness (MPa)']
        """
        from agglom_mpi.report.figures import axes, paths

        found = paths.paths(self._data())
        figure = axes.figure_for(figure, paths.paths_size(len(found)))
        return paths.draw_paths(figure, found)

    def plot_best(self, ax: Any = None) -> Any:
        """Draw the best strings as lines over the search box; see `plot_convergence`.

        Examples
        --------
        >>> import agglom_mpi
        >>> ax = agglom_mpi.open_campaign("quickstart.h5").plot_best()
        >>> [label.get_text().split() for label in ax.get_xticklabels()][0]
        ['relative', 'speed', '(m/s)']
        """
        from agglom_mpi.report.figures import axes, parallel

        return parallel.draw_parallel(
            axes.axes_for(ax, parallel.WIDE), *parallel.of_data(self._data())
        )

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
        from agglom_mpi.report.figures import axes, ensembles

        ax, found = axes.axes_for(ax, ensembles.TALL), self._data()
        return ensembles.draw_campaign(ax, found)

    def plot_finalists(self, ax: Any = None) -> Any:
        """Draw the best strings as searched and on fresh samples; see `plot_convergence`.

        Examples
        --------
        >>> import agglom_mpi
        >>> ax = agglom_mpi.open_campaign("quickstart.h5").plot_finalists()
        >>> len(ax.get_yticks())
        6
        """
        from agglom_mpi.report.figures import axes, finalists

        ax, found = axes.axes_for(ax), self._data()
        return finalists.draw_finalists(ax, *finalists.of_data(found), axes.objective_label(found))

    def plot_samples(self, ax: Any = None) -> Any:
        """Draw how many samples strings took; see `plot_convergence`.

        Examples
        --------
        >>> import agglom_mpi
        >>> ax = agglom_mpi.open_campaign("quickstart.h5").plot_samples()
        >>> ax.get_xlabel()
        'samples of a string'
        """
        from agglom_mpi.report.figures import axes, counts

        results = self._data().result_rows()
        used, at_maximum = results["samples_used"], results["hit_maximum"] == 1
        return counts.draw_counts(axes.axes_for(ax), used, at_maximum)

    def plot_busy(self, ax: Any = None) -> Any:
        """Draw the share of the time in which the ranks simulated; see `plot_convergence`.

        Examples
        --------
        >>> import agglom_mpi
        >>> ax = agglom_mpi.open_campaign("quickstart.h5").plot_busy()
        >>> ax.get_ylabel()
        'time in which ranks simulate (%)'
        """
        from agglom_mpi.report.figures import axes, busy

        return busy.draw_busy(axes.axes_for(ax), busy.of_data(self._data()))

    def snapshot(self) -> "CampaignData":
        """Return the rows as they are now."""
        raise NotImplementedError

    def _data(self) -> "CampaignData":
        from agglom_mpi.report.figures.axes import check_drawing

        check_drawing()
        return self.snapshot()
