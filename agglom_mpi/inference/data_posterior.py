"""Posterior of the variables of a campaign, given all of its measured data."""

from dataclasses import replace
from typing import TYPE_CHECKING, Final

import numpy as np

from agglom_mpi.emulation.blas_threads import single_threaded
from agglom_mpi.inference.data_calibration import calibrate_posterior
from agglom_mpi.inference.data_emulator import EmulatedData
from agglom_mpi.inference.posterior import Posterior, PosteriorError
from agglom_mpi.inference.posterior_sampling import PRIOR_POINTS, sample_posterior
from agglom_mpi.inference.searched_box import SearchedBox
from agglom_mpi.inference.stored_samples import (
    MIN_STRINGS,
    stored_samples,
    string_values,
    why_not_emulated,
)
from agglom_mpi.measurements.datum import exact_values
from agglom_mpi.storage.recorded_campaign import recorded_campaign

if TYPE_CHECKING:
    from agglom_mpi.storage.reader import CampaignData

MIN_POINTS: Final = 50
"""Minimum number of points with weight of a posterior."""


@single_threaded
def data_posterior(file: "CampaignData") -> Posterior:
    """Return the posterior of the variables, given all data of a campaign.

    Raises
    ------
    PosteriorError
        If the campaign has no data, or its strings cannot be emulated, with the reason.
    """
    campaign = recorded_campaign(file)
    if not campaign.data or file.sizes.census is None:
        raise PosteriorError(
            f"{file.path}: the campaign has no section data; for the posterior of one measured "
            "mean, use feasible_set(tolerance).posterior(measured, error), or agglom report "
            "--feasible-set with --measured and --error"
        )
    if reason := why_not_emulated(campaign):
        raise PosteriorError(f"{file.path}: {reason}")
    stored = stored_samples(file)
    values = string_values(file, campaign.data, stored)
    count = len(np.unique(np.nan_to_num(values.strings), axis=0))
    if count < MIN_STRINGS and not exact_values(campaign.data).all():
        raise PosteriorError(
            f"{file.path}: predictions of {count} different strings; at least {MIN_STRINGS} are "
            "needed for a posterior"
        )
    emulated = EmulatedData(SearchedBox(campaign), campaign.data, values, stored)
    return replace(posterior_of(emulated), file=file)


def posterior_of(emulated: EmulatedData) -> Posterior:
    """Return the posterior of the data of an emulator, with its calibration."""
    box = emulated.box
    prior = box.even_strings(PRIOR_POINTS)
    strings = emulated.near(prior)
    first = emulated.log_density(strings)
    drawn = sample_posterior(emulated, strings, first, len(prior))
    if len(drawn.weights) < MIN_POINTS:
        raise PosteriorError(
            f"{box.campaign.name}: the data leave so little of the box that {len(drawn.weights)} "
            "points of it have any weight; pip install emcee for a Markov chain, or search a "
            "narrower box"
        )
    calibration = calibrate_posterior(emulated, drawn)
    return Posterior(**vars(drawn), of=emulated, calibration=calibration)
