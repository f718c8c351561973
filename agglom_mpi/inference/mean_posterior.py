"""Posterior of the variables of a campaign, given one measured mean."""

from typing import TYPE_CHECKING, Final

import numpy as np

from agglom_mpi.config.arguments import read_error, read_number, shown
from agglom_mpi.config.yaml_source import ArgumentError
from agglom_mpi.inference.emulated_set import EmulatedSet
from agglom_mpi.inference.measured_mean import MeasuredMean
from agglom_mpi.inference.posterior import Posterior, PosteriorError
from agglom_mpi.inference.posterior_sampling import sample_posterior

if TYPE_CHECKING:
    from agglom_mpi.config.campaign import Campaign

MAX_AWAY_OF_NEAREST: Final = 4.0
"""Maximum distance of the nearest mean in the box from the measured one, in standard deviations."""
POSITIVE_QUANTITIES: Final = frozenset({"mean_radius_ratio", "mean"})
"""Quantities that are positive, so that their error is a fraction of them."""


def mean_posterior(emulated: EmulatedSet, measured: float | str, error: float | str) -> Posterior:
    """Return the posterior; see `FeasibleSet.posterior`.

    Raises
    ------
    PosteriorError
        If several numbers are compared, or the measured mean is nowhere in the box.
    ArgumentError
        If the measured mean or its error is impossible.
    """
    campaign, quantities = emulated.box.campaign, emulated.criterion.quantities
    measured, error = measurement_of(campaign, quantities, measured, error)
    strings, known = emulated.prior
    mean, deviation = known.means[:, 0], known.deviations[:, 0]
    away = np.abs(measured - mean) / np.hypot(error, deviation)
    if away.min(initial=np.inf) > MAX_AWAY_OF_NEAREST:
        raise PosteriorError(
            f"measured is {measured:g} ± {error:g}, which no string of the box can give: by the "
            f"emulator they reach {mean.min():.4g} to {mean.max():.4g}"
        )
    of = MeasuredMean(emulated, measured, error)
    first = of.log_density_at(known)
    return Posterior(of, sample_posterior(of, emulated.box, strings, first, len(strings)))


def measurement_of(
    campaign: "Campaign", quantities: tuple[str, ...], measured: float | str, error: float | str
) -> tuple[float, float]:
    """Return a measured value and its standard error, if the campaign can have a posterior of it.

    Parameters
    ----------
    campaign
    quantities
        What its objective compares.
    measured, error
        As for `mean_posterior`.

    Raises
    ------
    PosteriorError
        If several numbers are compared.
    ArgumentError
        If one of them is impossible.
    """
    if len(quantities) > 1:
        raise PosteriorError(
            f"the objective compares {', '.join(quantities)}; a posterior needs a measured number "
            "that is compared alone"
        )
    field: str = "measured"
    is_radius = quantities[0] in POSITIVE_QUANTITIES
    try:
        value = read_number(measured)
        if is_radius and value <= 0.0:
            raise ValueError(f"is {shown(measured)}; must be greater than 0, a mean b/b0")
        field = "error"
        deviation = read_error(error, value, positive=is_radius)
        field = "measured"
        largest = campaign.most_grains ** (1.0 / 3.0)
        if is_radius and value - MAX_AWAY_OF_NEAREST * deviation > largest:
            raise ValueError(
                f"is {shown(measured)}; {campaign.scene.particles} grains in one give "
                f"{largest:.4g}, which is the most"
            )
    except ValueError as problem:
        raise ArgumentError.of(campaign.name, field, problem) from None
    return value, deviation
