"""Building the inversion of a campaign: search method, ensembles and stopping."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.config.campaign import Campaign
from agglom_mpi.config.coordinates import coordinates_of
from agglom_mpi.search.ensemble import Ensemble, EnsembleResult
from agglom_mpi.search.inversion import Inversion
from agglom_mpi.search.methods.method import SearchInputs
from agglom_mpi.search.proposals import Proposals

Restore = Callable[[Proposals, int], Proposals]
"""Function of proposals and the number of their first string that returns stored ones."""


def inversion_of(
    campaign: Campaign,
    given: NDArray[np.float64],
    restore: Restore | None,
    background: bool = False,
) -> Inversion:
    """Return the inversion of a campaign before its first generation.

    Parameters
    ----------
    campaign
        The campaign.
    given
        Strings to start with, in SI units, shape (n, k).
    restore
        Replaces proposals by those an earlier leg has stored; None keeps them.
    background
        Whether long computations of the search may run in a thread.
    """
    ensemble = campaign.ensemble
    particles = campaign.scene.particles
    objective = campaign.objective
    coordinates = coordinates_of(campaign)
    inputs = SearchInputs(
        campaign.space(),
        campaign.seed,
        given,
        magnitude=objective.is_magnitude,
        background=background,
        coordinates=coordinates.of_strings,
        groups=len(coordinates.groups),
    )

    def signed(result: EnsembleResult) -> float:
        """Return the signed mean whose magnitude is a string's objective."""
        return objective.signed(result.objective, result.mean_radius_ratio)

    return Inversion(
        campaign.search.build(inputs),
        lambda string: Ensemble(ensemble, campaign.objective_at(string), particles),
        campaign.stopping.ending,
        restore=restore,
        signed=signed,
        racing=ensemble.racing,
        more_samples=campaign.search.added_samples or 1,
        summarise=objective.summaries,
    )
