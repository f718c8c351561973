"""The public campaign file: rows, tables, the best strings and plots."""

import os
from collections.abc import Callable, Mapping, Sequence
from functools import cache
from numbers import Integral
from pathlib import Path
from types import MethodType
from typing import TYPE_CHECKING, Any

from agglom_mpi.analysis import finite_size, tables
from agglom_mpi.config.arguments import count_argument
from agglom_mpi.errors import UserError
from agglom_mpi.formatting import pluralise
from agglom_mpi.outcome import FinalParticles
from agglom_mpi.public_face import PublicFace
from agglom_mpi.storage.access import NotACampaign
from agglom_mpi.storage.lock import live_status
from agglom_mpi.storage.reader import CampaignData, read_campaign
from agglom_mpi.storage.snapshot import Status

if TYPE_CHECKING:
    import pandas as pd

    from agglom_mpi.inference.feasible_set import FeasibleSet
    from agglom_mpi.inference.law_comparison import LawComparison
    from agglom_mpi.inference.posterior import Posterior
    from agglom_mpi.simulation.frames import Frames

__all__ = ["CampaignFile", "NotACampaign", "compare_laws", "open_campaign"]


class _PlotsFigures(PublicFace):
    """Class with a method for each figure that the report declares."""

    def __getattr__(self, name: str) -> Any:
        if name.startswith("plot_") and name in (known := _plots()):
            return known[name]
        raise AttributeError(f"type object {self.__name__!r} has no attribute {name!r}")

    def __dir__(self) -> list[str]:
        return sorted([*super().__dir__(), *_plots()])


class CampaignFile(metaclass=_PlotsFigures):
    """The contents of a campaign file, finished or not; every access reads the file again.

    `agglom_mpi.open_campaign(path)` returns it. Tables are pandas DataFrames, one row per string,
    sample or generation, with units in `.attrs["units"]`.

    Methods `plot_*` draw the figures of the report, such as `plot_convergence(ax)`. Each takes
    matplotlib axes to draw into, or makes a new pyplot figure, and returns the axes; those with
    several panels take a figure or subfigure, and return an array of axes. Where there is nothing
    to show yet, the axes say so.

    Parameters
    ----------
    data
        The campaign file.

    Examples
    --------
    >>> import agglom_mpi
    >>> file = agglom_mpi.open_campaign("quickstart.h5")
    >>> file.status().state
    'finished'
    >>> int(file.samples["used"].sum()) == int(file.strings["samples_used"].sum())
    True
    >>> file.best(3)["string"].nunique()
    3
    >>> ax = file.plot_convergence()
    >>> ax.get_xlabel(), ax.get_ylabel()
    ('generation', 'objective Λ')

    Into axes of your own:

    >>> from matplotlib import pyplot
    >>> figure, (left, right) = pyplot.subplots(1, 2, figsize=(12, 5), layout="constrained")
    >>> file.plot_best(left) is left
    True
    >>> ax = file.plot_cost(right)
    >>> figure.savefig("search.png")
    """

    def __init__(self, data: CampaignData) -> None:
        self._opened = data

    def __getattr__(self, name: str) -> Any:
        """Return the method that draws a figure of the report."""
        if name.startswith("plot_"):
            return MethodType(getattr(type(self), name), self)
        raise AttributeError(f"{type(self).__name__!r} object has no attribute {name!r}")

    def __reduce__(self) -> tuple[Any, ...]:
        """Return the path and the permission: a copy opens the file again."""
        return open_campaign, (self.path.absolute(), self._opened.allow_code)

    def _snapshot(self, with_unused: bool = False) -> CampaignData:
        """Return the rows as they are now; the file of a running campaign grows on."""
        opened = self._opened
        data = CampaignData(self.path, opened.attributes, allow_code=opened.allow_code)
        data.with_unused = with_unused or opened.with_unused
        return data

    @property
    def path(self) -> Path:
        """Path of the file."""
        return self._opened.path

    def __repr__(self) -> str:
        return f"<CampaignFile {str(self.path)!r}: {self.title}{self._stage()}>"

    def _stage(self) -> str:
        """Return the state of the campaign in a few words; nothing if the file cannot be read."""
        try:
            data = self._snapshot()
            counts = (
                (len(data.generation_rows()), "generation"),
                (len(data.string_rows()), "string"),
            )
            return ", ".join(
                [f"; {live_status(data).state}", *(pluralise(*each) for each in counts)]
            )
        except (OSError, UserError):
            return ""

    @property
    def title(self) -> str:
        """Title of the campaign."""
        return self._opened.title

    @property
    def seed(self) -> int:
        """Seed of all random streams."""
        return int(self._opened.attributes["seed"])

    @property
    def campaign_text(self) -> str:
        """Text of the campaign file that was run, YAML."""
        return self._opened.campaign_text

    def status(self) -> Status:
        """Return the state of the campaign, the time of the last change (Unix, s), and a reason."""
        return live_status(self._snapshot())

    @property
    def damaged(self) -> int:
        """Number of rows that are marked final but have a wrong checksum; they count as absent."""
        return self._snapshot().damaged

    @property
    def strings(self) -> "pd.DataFrame":
        """One row for each string: origin, parameters, judgement and times of its samples.

        Examples
        --------
        >>> import agglom_mpi
        >>> strings = agglom_mpi.open_campaign("quickstart.h5").strings
        >>> strings.attrs["units"]["hardness"]
        'Pa'
        >>> bool((strings["samples_used"] <= 30).all())
        True
        """
        return tables.table_of(self._snapshot(with_unused=True), "strings")

    @property
    def samples(self) -> "pd.DataFrame":
        """One row for each sample; `used` says whether it was judged, `fresh` if none ever is.

        Results rest on these two kinds. All others ran ahead unused; their number depends on the
        number of ranks and on timing.

        Examples
        --------
        >>> import agglom_mpi
        >>> samples = agglom_mpi.open_campaign("quickstart.h5").samples
        >>> sorted(set(samples["state"]))
        ['completed']
        >>> ratios = samples[samples["fresh"]].groupby("string")["mean_radius_ratio"]
        >>> len(ratios.mean())
        6
        """
        return tables.table_of(self._snapshot(with_unused=True), "samples")

    @property
    def estimates(self) -> "pd.DataFrame":
        """One row for each string that was estimated again on fresh samples, in order of rank.

        `objective`, `standard_error` and the 95 % interval `lower` to `upper` are of the fresh
        samples; those as searched are `searched_objective` and `searched_standard_error`.
        """
        return tables.table_of(self._snapshot(), "estimates")

    @property
    def volumes(self) -> "pd.DataFrame":
        """One row for each string and control volume in which it was estimated again.

        `volume` and `grains` say which; `mean_radius_ratio` and `objective` have their standard
        errors beside them, and `spread` is that of one sample. There are rows only if the campaign
        asks for `final: {volumes: …}`.
        """
        return finite_size.volumes_table(self._snapshot())

    @property
    def limits(self) -> "pd.DataFrame":
        """One row for each string that was estimated in several control volumes.

        `limit` is its mean b/b⁰ for infinitely many grains, `shift` what the campaign's own number
        adds to it, `why_no_limit` why they are nan, `exceeds` whether the shift is resolved and
        above the standard error, `curvature` what a term 1/N² would change, and `enough_grains` how
        many would make the shift as small as the standard error.
        """
        return finite_size.limits_table(self._snapshot())

    @property
    def generations(self) -> "pd.DataFrame":
        """One row for each generation.

        Examples
        --------
        >>> import agglom_mpi
        >>> generations = agglom_mpi.open_campaign("quickstart.h5").generations
        >>> generations["generation"].tolist()
        [0, 1, 2]
        """
        return tables.table_of(self._snapshot(), "generations")

    @property
    def variables(self) -> "pd.DataFrame":
        """One row for each variable that the campaign uses: its unit and box."""
        return tables.table_of(self._snapshot(), "variables")

    def best(self, k: int = 1) -> "pd.DataFrame":
        """Best k judged strings, by their re-estimates on fresh samples where there are any.

        Columns `estimate`, `estimate_standard_error` and `estimate_mean_radius_ratio` are of fresh
        samples, nan where a string was not estimated again; `objective`, `standard_error` and all
        other results are as searched, of the samples that strings were chosen by.

        Strings without a re-estimate follow in the order of the search; ties are broken by number.
        If the search has gone on, and its best string is not estimated again yet, the order is the
        search's own. There are fewer than k rows where fewer strings are judged.

        Raises
        ------
        ValueError
            If k is no whole number of at least 1.

        Examples
        --------
        >>> import agglom_mpi
        >>> best = agglom_mpi.open_campaign("quickstart.h5").best(6)
        >>> bool(best["estimate"].is_monotonic_increasing)
        True
        >>> best.attrs["units"]["relative_speed"]
        'm/s'
        """
        k = count_argument(self.path, "k", k, least=1)
        return tables.best(self._snapshot(), k)

    def feasible_set(
        self,
        tolerance: float | str = 0.05,
        robust: Mapping[str, float | str] | None = None,
    ) -> "FeasibleSet":
        """Return the set of strings that are compatible with the objective; takes seconds.

        Parameters
        ----------
        tolerance
            Relative to the target or to the maximum, between 0 and 1, as `0.05` or `"5%"`; of a
            user's function, its largest value.
        robust
            Tolerances of a process, such as `{"relative_speed": "5%"}`: probabilities are averaged
            over even deviations of variables by up to this share of themselves, not beyond the box.

        Returns
        -------
        FeasibleSet
            Its `probability(parameters)` says of any string how sure it is a member. Where it is
            `empty`, `nearest` is the best that can be reached.

        Raises
        ------
        NoFeasibleSetError
            If there are too few strings, the emulator is not calibrated, or the noise of strings is
            correlated; with the reason.
        ValueError
            If the tolerance or a deviation is impossible.
        """
        from agglom_mpi.inference.feasible_set import feasible_set

        return feasible_set(self._snapshot(), tolerance, robust)

    def posterior(self) -> "Posterior":
        """Return the posterior of the variables, given all measured data; takes some ten seconds.

        Returns
        -------
        Posterior
            Its `quantiles(name)`, `correlations`, `contraction` and `volume` say what is known of
            the variables; `predictions` compares it with each datum. `calibration` says whether it
            can be trusted on this question: see `warning`, which is empty if nothing is wrong.

        Raises
        ------
        PosteriorError
            If the campaign has no section `data`, or too few strings, or their noise is correlated.
            For one measured mean there is `feasible_set(…).posterior(measured, error)`.

        Examples
        --------
        >>> import agglom_mpi
        >>> agglom_mpi.open_campaign("quickstart.h5").posterior()  # has no data
        Traceback (most recent call last):
            ...
        agglom_mpi.inference.posterior.PosteriorError: quickstart.h5: ...
        """
        from agglom_mpi.inference.data_posterior import data_posterior

        return data_posterior(self._snapshot())

    def framed(self) -> list[tuple[int, int]]:
        """Return the samples with stored frames as (string, sample), those of the best first."""
        return self._snapshot().particles.framed()

    def frames(self, string: int, sample: int) -> "Frames | None":
        """Return the stored frames of a sample; None if there are none.

        Raises
        ------
        ValueError
            If a number is no whole number.
        """
        return self._snapshot().particles.frames(*self._numbers(string, sample))

    def final_particles(self, string: int, sample: int) -> FinalParticles | None:
        """Return the particles left at the end of a sample; None if they were not stored.

        Raises
        ------
        ValueError
            If a number is no whole number.
        """
        return self._snapshot().particles.final(*self._numbers(string, sample))

    def _numbers(self, string: int, sample: int) -> tuple[int, int]:
        """Return the numbers of a string and of a sample; raise an ArgumentError for others.

        A negative number is that of no sample.
        """
        numbers = {"string": string, "sample": sample}
        for field, number in numbers.items():
            if not isinstance(number, Integral) or isinstance(number, bool):
                count_argument(self.path, field, number)
        return int(string), int(sample)


@cache
def _plots() -> dict[str, Callable[..., Any]]:
    """Return the methods of a file that draw figures, by their names."""
    from agglom_mpi.report.figures.figure import figures  # most files are read without these

    snapshot, every = CampaignFile._snapshot, figures().values()
    return {figure.method: figure.method_of(snapshot) for figure in every if figure.method}


def open_campaign(path: str | os.PathLike[str], allow_code: bool = False) -> CampaignFile:
    """Open a campaign file for reading, also while a campaign is running.

    Parameters
    ----------
    path
        The HDF5 file.
    allow_code
        Whether components of one's own, whose code the file has, may be executed. Without them
        the file is its tables; all else raises a `CodeNotAllowedError`.

    Returns
    -------
    CampaignFile
        Tables, the best strings, the feasible set and plots.

    Raises
    ------
    NotACampaign
        If it is something else, truncated, damaged or of a newer format version.
    OSError
        If it is missing or cannot be read.

    Examples
    --------
    >>> import agglom_mpi
    >>> file = agglom_mpi.open_campaign("quickstart.h5")
    >>> file.status().state
    'finished'
    >>> len(file.best(3))
    3
    """
    return CampaignFile(read_campaign(path, allow_code))


def compare_laws(
    files: "Sequence[str | os.PathLike[str] | CampaignFile]", allow_code: bool = False
) -> "LawComparison":
    """Compare how campaigns with the same data and different laws or scenes explain these.

    Parameters
    ----------
    files
        At least two campaign files with the objective misfit, or their paths.
    allow_code
        Whether components of one's own, whose code the files have, may be executed.

    Returns
    -------
    LawComparison
        `verdict`, and as a `table` with one row for each law: its probability at equal odds, the
        logarithm of the evidence, the p-value of its fit, and with ArviZ the density of the data,
        each left out in turn; `deciding` and `deciding_experiment` are what decides. If nothing
        does, `next_measurements` ranks what could be measured next, which takes some minutes.

    Raises
    ------
    PosteriorError
        If their data or errors differ, or a posterior fails its own check.

    Examples
    --------
    >>> import agglom_mpi
    >>> agglom_mpi.compare_laws(["quickstart.h5", "quickstart.h5"])  # has no data
    Traceback (most recent call last):
        ...
    agglom_mpi.inference.posterior.PosteriorError: quickstart.h5: ...
    """
    from agglom_mpi.inference.law_comparison import compare_files

    opened = [f if isinstance(f, CampaignFile) else open_campaign(f, allow_code) for f in files]
    return compare_files([file._snapshot() for file in opened])
