"""A campaign that can be run from Python: in this process, or by ranks of their own."""

import os
from dataclasses import fields
from typing import TYPE_CHECKING

from agglom_mpi.config import loading
from agglom_mpi.config.arguments import read_count
from agglom_mpi.config.campaign import Campaign

if TYPE_CHECKING:
    from agglom_mpi.campaign_file import CampaignFile

__all__ = ["RunnableCampaign", "load_campaign"]


class RunnableCampaign(Campaign):
    """A validated campaign; equal campaigns have equal `identity`.

    `agglom_mpi.load_campaign(path)` returns it.

    Attributes
    ----------
    title : str
        Title of the campaign.
    seed : int
        Seed of all random streams.
    text, name : str
        Text of the file, and its name in errors.

    Examples
    --------
    >>> from agglom_mpi import load_campaign
    >>> campaign = load_campaign("jobs/quickstart.yaml")
    >>> outcome = campaign.simulate({"relative_speed": 4.3, "hardness": "67 MPa"}, sample=0)
    >>> outcome.particles < 100, outcome.mean_radius_ratio > 1.0
    (True, True)
    """

    def run(
        self,
        output: str | os.PathLike[str] | None = None,
        ranks: int | None = None,
        progress: bool = True,
        max_walltime: float | None = None,
    ) -> "CampaignFile":
        """Run the campaign, or continue it where its file ends, as `agglom-invert` does.

        Ctrl-C, or an interrupted kernel, stops it cleanly: the file then has the status `stopped`,
        and the next call goes on.

        Parameters
        ----------
        output
            File to write; None: that of the campaign.
        ranks
            Number of ranks, started by the installed `mpirun`; None: this process simulates.
        progress
            Whether to show how the run goes, on standard error.
        max_walltime
            Time after which to stop cleanly, in s.

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
            path = run_by_ranks(self, options, _number_of_ranks(ranks))
        return open_campaign(path, options.allow_code)

    @property
    def _has_code(self) -> bool:
        """Whether code of the user's was allowed to run when the campaign was loaded."""
        own = any(each.law.own is not None for each in self.scene.laws())
        plan = () if self.plan is None else self.plan
        return (
            own
            or any(each.own is not None for each in (self.objective, *plan[:2]))
            or (self.user_function is not None)
        )


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


def _number_of_ranks(ranks: int) -> int:
    try:
        return read_count(ranks, least=1)
    except ValueError as error:
        raise ValueError(f"ranks: {error}") from None
