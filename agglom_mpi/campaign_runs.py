"""A campaign that can be run from Python: in this process, or by ranks of their own."""

import os
from dataclasses import fields
from typing import TYPE_CHECKING, Final

from agglom_mpi.config import loading
from agglom_mpi.config.campaign import Campaign
from agglom_mpi.config.own_components import own_of
from agglom_mpi.config.yaml_source import ArgumentError

if TYPE_CHECKING:
    from agglom_mpi.campaign_file import CampaignFile
    from agglom_mpi.config.searcher import Searcher

RANKS_PER_CORE: Final = 4
"""Maximum number of ranks per core that `run` starts, unless it is asked to oversubscribe."""

__all__ = ["RunnableCampaign", "load_campaign"]


class RunnableCampaign(Campaign):
    """A validated campaign that can be run, too; `agglom_mpi.load_campaign(path)` returns it."""

    def run(
        self,
        output: str | os.PathLike[str] | None = None,
        ranks: int | None = None,
        progress: bool = True,
        max_walltime: float | None = None,
        oversubscribe: bool = False,
    ) -> "CampaignFile":
        """Run the campaign, or continue it where its file ends, as `agglom-invert` does.

        Ctrl-C, or an interrupted kernel, stops it cleanly: the file then has the status `stopped`,
        and the next call goes on.

        Parameters
        ----------
        output
            File to write; None: that of the campaign.
        ranks
            Number of ranks, started by the installed `mpirun`; None: this process simulates. At
            most four for each core of this process.
        progress
            Whether to show how the run goes, on standard error.
        max_walltime
            Time after which to stop cleanly, in s.
        oversubscribe
            Whether more ranks may be started than the cores allow.

        Returns
        -------
        CampaignFile
            The open file, whatever its status.

        Raises
        ------
        RunFailedError
            If the run ends by an error.
        ValueError
            If there is nothing to search, or the file cannot be written.

        Examples
        --------
        >>> import agglom_mpi
        >>> campaign = agglom_mpi.load_campaign("jobs/quickstart.yaml")
        >>> file = campaign.run("quickstart.h5", progress=False)
        >>> file.status().state
        'finished'
        """
        from agglom_mpi.campaign_file import open_campaign
        from agglom_mpi.runtime.invert import InvertOptions
        from agglom_mpi.runtime.python_runs import run_by_ranks, run_here

        name = None if output is None else os.fspath(output)
        options = InvertOptions(
            self.name,
            name,
            max_walltime=max_walltime,
            quiet=not progress,
            allow_code=self._has_code,
        )
        if ranks is None:
            path = run_here(self, options)
        else:
            ranks = self._count("ranks", ranks, least=1)
            most = RANKS_PER_CORE * len(os.sched_getaffinity(0))
            if ranks > most and not oversubscribe:
                why = f"is {ranks}; must be at most {most}, {RANKS_PER_CORE} for each core here"
                allowed = ValueError(f"{why}; oversubscribe=True allows more")
                raise ArgumentError.of(self.name, "ranks", allowed)
            path = run_by_ranks(self, options, ranks)
        return open_campaign(path, options.allow_code)

    def searcher(self) -> "Searcher":
        """Return the search of the campaign, for a loop of your own: `ask`, judge, `tell`.

        Strings are judged by whatever you like: another simulator, an experiment, or this one with
        other numbers of samples. They are those that `run` proposes for the same values.
        (`campaign.search` is the section of the file that names the method.)

        Returns
        -------
        Searcher

        Raises
        ------
        CampaignError
            If there is nothing to search, or an optional library is missing.

        Examples
        --------
        >>> import agglom_mpi
        >>> searcher = agglom_mpi.load_campaign("jobs/quickstart.yaml").searcher()
        >>> strings = searcher.ask()
        >>> strings["string"].tolist() == list(range(12)), strings.units["hardness"]
        (True, 'Pa')
        >>> searcher.tell(strings["hardness"] / 67e6 - 1)
        >>> searcher.generation, searcher.is_finished
        (1, False)
        """
        from agglom_mpi.analysis.warm_start import warm_start
        from agglom_mpi.config.searchable import check_search_library, log_narrow
        from agglom_mpi.config.searcher import Searcher

        log_narrow(self)
        check_search_library(self)
        return Searcher(self, warm_start(self).strings)

    @property
    def _has_code(self) -> bool:
        """Whether code of the user's was allowed to run when the campaign was loaded."""
        return self.user_function is not None or any(own_of(self))


def load_campaign(path: str | os.PathLike[str], allow_code: bool = False) -> RunnableCampaign:
    """Read and validate a campaign file, which can then be simulated, run and described.

    Parameters
    ----------
    path
        The YAML file.
    allow_code
        Whether Python code that it names may be executed: the function of its objective, and
        components of one's own.

    Returns
    -------
    Campaign

    Raises
    ------
    CampaignError
        With everything that is wrong: file, line, field, value and what is allowed.

    Examples
    --------
    >>> import agglom_mpi
    >>> campaign = agglom_mpi.load_campaign("jobs/quickstart.yaml")
    >>> campaign.title
    'Quickstart - double the mean grain size'
    """
    campaign = loading.load_campaign(path, allow_code)
    return RunnableCampaign(
        **{each.name: getattr(campaign, each.name) for each in fields(campaign) if each.init}
    )
