"""A campaign that is simulated and run from Python: in this process, or by its own ranks."""

import os
from collections.abc import Mapping, Sequence
from dataclasses import fields
from typing import TYPE_CHECKING, Final

import numpy as np
import numpy.typing as npt

from agglom_mpi.config import loading
from agglom_mpi.config.campaign import Campaign
from agglom_mpi.config.given_strings import Parameters
from agglom_mpi.config.own_components import own_of
from agglom_mpi.config.yaml_source import ArgumentError
from agglom_mpi.simulation.engines import Engine

if TYPE_CHECKING:
    from agglom_mpi.analysis.collision_kernels import CollisionKernels
    from agglom_mpi.campaign_file import CampaignFile
    from agglom_mpi.simulation.sample import Outcome
    from agglom_mpi.verbs.estimate import StringEstimate
    from agglom_mpi.verbs.searcher import Searcher
    from agglom_mpi.verbs.simulate_many import SimulatedSamples

RANKS_PER_CORE: Final = 4
"""Maximum number of ranks per core that `run` starts, unless it is asked to oversubscribe."""

__all__ = ["RunnableCampaign", "load_campaign"]


class RunnableCampaign(Campaign):
    """A validated campaign that can be simulated and run; `agglom_mpi.load_campaign` returns it.

    Examples
    --------
    >>> from agglom_mpi import load_campaign
    >>> campaign = load_campaign("jobs/quickstart.yaml")
    >>> outcome = campaign.simulate({"relative_speed": 4.3, "hardness": "67 MPa"}, sample=0)
    >>> outcome.particles < 100, outcome.mean_radius_ratio > 1.0
    (True, True)
    """

    def simulate(
        self,
        parameters: Mapping[str, float | str] | npt.ArrayLike,
        sample: int = 0,
        engine: str | Engine | None = None,
        frames: int | Sequence[float] | npt.NDArray[np.float64] | None = None,
    ) -> "Outcome":
        """Simulate one sample exactly as a rank of the campaign does.

        Parameters
        ----------
        parameters
            Values by name, as for `parameters`, or all of them in SI units, shape (k,).
        sample
            Sample number from 0.
        engine
            Another engine than the campaign's: `event`, `fixed`, `fixed:STEPS` or `adaptive`.
            `event` cools exactly, whatever the campaign's `integration` is.
        frames
            Number of frames of the particles to record, evenly spaced from 0 to the end time, or
            their times in s, ascending; recording does not change the outcome. The first use in a
            kind of scene compiles a small kernel more.

        Returns
        -------
        Outcome

        Raises
        ------
        CampaignError
            If parameters, engine or frames are not possible.
        RuntimeError
            If the sample fails, with the reason.
        """
        from agglom_mpi.verbs.simulate import simulate

        return simulate(self, parameters, sample, engine, frames)

    def experiment(self, name: str) -> "RunnableCampaign":
        """Return an experiment of the section `experiments` as a campaign of its own.

        Its samples are those of the whole campaign: sample k of the same values is bit for bit the
        part of sample k that belongs to this experiment.

        Parameters
        ----------
        name
            Its name.

        Raises
        ------
        CampaignError
            If there is none of this name.
        """
        return _runnable(self.of_experiment(name).campaign)

    def estimate(
        self,
        parameters: Mapping[str, float | str] | npt.ArrayLike,
        samples: int = 100,
        engine: str | Engine | None = None,
    ) -> "StringEstimate":
        """Simulate samples 0, 1, … of a string; return the mean ± standard error of what they give.

        Parameters
        ----------
        parameters, engine
            As for `simulate`.
        samples
            Number of samples, at least 1. Of a single one there is no standard error.

        Returns
        -------
        StringEstimate
            `print` shows it as `agglom simulate` does. Samples that fail are left out and counted.

        Raises
        ------
        CampaignError
            If parameters, samples or engine are not possible.
        RuntimeError
            If all samples fail, with the reason of the first.

        Examples
        --------
        >>> from agglom_mpi import load_campaign
        >>> campaign = load_campaign("jobs/quickstart.yaml")
        >>> estimate = campaign.estimate({"hardness": "67 MPa"}, samples=30)
        >>> estimate.samples, 1.0 < estimate.mean_radius_ratio.value < 100 ** (1 / 3)
        (30, True)
        """
        from agglom_mpi.verbs.estimate import estimate

        return estimate(self, parameters, samples, engine)

    def collision_kernels(
        self,
        parameters: Mapping[str, float | str] | npt.ArrayLike,
        samples: int = 200,
        bins: int = 12,
        times: Sequence[float] = (),
        first_sample: int = 0,
    ) -> "CollisionKernels":
        """Count collisions in samples of a string: the kernels of population balances.

        Parameters
        ----------
        parameters
            As for `simulate`.
        samples
            Number of samples, at least 3.
        bins
            Bins a decade of mass.
        times
            Between 0 and the end time in s, ascending: windows in which counts are kept apart.
        first_sample
            Number of the first sample, which is simulated again.

        Returns
        -------
        CollisionKernels
            Rate coefficients, collision efficiencies, sticking and breakage probabilities by pairs
            of masses, each with its standard error.

        Raises
        ------
        CampaignError
            If an argument is not possible, or the box is sheared.
        RuntimeError
            If samples fail, and too few are left for standard errors.
        """
        from agglom_mpi.analysis.counted_samples import collision_kernels

        return collision_kernels(self, parameters, samples, bins, times, first_sample)

    def simulate_many(
        self,
        parameters: Parameters,
        samples: int = 1,
        workers: int | None = None,
        engine: str | Engine | None = None,
        first_sample: int = 0,
    ) -> "SimulatedSamples":
        """Simulate samples of many strings on all cores, each bit for bit as `simulate` does.

        For a sampler or an optimiser of your own. The shapes are those of a simulator of sbi or of
        BoTorch: m strings in, m values of each sample out; `dict(zip(names, theta.T))` names the
        columns of an array or tensor theta of shape (m, d).

        Parameters
        ----------
        parameters
            Values by name, a mapping or a DataFrame: numbers in SI units or texts with units, each
            (m,) or one for all; what is not given is fixed, or the middle of its range. Or all
            variables of the campaign in SI units, shape (k,) or (m, k).
        samples
            Number of samples of each string, at least 1.
        workers
            Number of threads; None: one for each core that this process may use. The results are
            the same.
        engine
            As for `simulate`.
        first_sample
            Number of the first sample of each string. A sampler whose calls need independent noise
            counts it up.

        Returns
        -------
        SimulatedSamples
            Columns of shape (m, samples), such as `mean_radius_ratio` and `objective`. A sample
            that raises, or whose string a law refuses, is a failed one.

        Raises
        ------
        CampaignError
            If a name is unknown, a value impossible, or another argument wrong.

        Notes
        -----
        Each string takes the interpreter, which threads share, some 0.3 ms. Where all samples of a
        string take less than that times the number of cores, not all cores are busy.

        Examples
        --------
        >>> from agglom_mpi import load_campaign
        >>> campaign = load_campaign("jobs/quickstart.yaml")
        >>> found = campaign.simulate_many({"hardness": ["30 MPa", "150 MPa"]}, samples=20)
        >>> found.mean_radius_ratio.shape, int(found.failed.sum())
        ((2, 20), 0)
        >>> soft, hard = found.mean_radius_ratio.mean(axis=1)
        >>> bool(soft > hard)
        True
        """
        from agglom_mpi.verbs.simulate_many import simulate_many

        return simulate_many(self, parameters, samples, workers, engine, first_sample)

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
        from agglom_mpi.runtime.invert import InvertOptions, run_by_ranks, run_here

        name = None if output is None else os.fspath(output)
        options = InvertOptions(
            self.name,
            name,
            max_walltime=max_walltime,
            quiet=not progress,
            allow_code=self.user_function is not None or any(own_of(self)),
        )
        if ranks is None:
            path = run_here(self, options)
        else:
            ranks = self.count("ranks", ranks, least=1)
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
        from agglom_mpi.analysis.warm_start import evaluated, warm_start
        from agglom_mpi.config.searchable import check_search_library, log_narrow
        from agglom_mpi.verbs.searcher import Searcher

        log_narrow(self)
        check_search_library(self)
        start = warm_start(self)
        learned = None if start.learned is None else evaluated(self, start.learned.rows)
        return Searcher(self, start.strings, learned)


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
    return _runnable(loading.load_campaign(path, allow_code))


def _runnable(campaign: Campaign) -> RunnableCampaign:
    return RunnableCampaign(
        **{each.name: getattr(campaign, each.name) for each in fields(campaign) if each.init}
    )
