"""Posteriors of the variables of a campaign, given one measured mean or all of its data."""

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from agglom_mpi.config.arguments import read_error, read_number, shown
from agglom_mpi.config.yaml_source import ArgumentError
from agglom_mpi.emulation.blas_threads import single_threaded
from agglom_mpi.inference.data_calibration import calibrate_posterior
from agglom_mpi.inference.data_emulator import EmulatedData
from agglom_mpi.inference.emulated_set import EmulatedSet
from agglom_mpi.inference.posterior import Posterior, PosteriorError
from agglom_mpi.inference.posterior_sampling import PRIOR_POINTS, Observed, sample_posterior
from agglom_mpi.inference.searched_box import EmulatedStrings, SearchedBox
from agglom_mpi.inference.stored_samples import (
    require_emulated,
    require_strings,
    stored_samples,
    string_values,
)
from agglom_mpi.measurements.datum import exact_values
from agglom_mpi.statistics import Floats
from agglom_mpi.storage.recorded_campaign import recorded_campaign

if TYPE_CHECKING:
    from agglom_mpi.config.campaign import Campaign
    from agglom_mpi.storage.reader import CampaignData

MIN_POINTS: Final = 50
"""Minimum number of points with weight of a posterior."""
MAX_AWAY: Final = 6.0
"""Distance from the measured mean, in standard deviations, beyond which a string has no weight."""
MAX_AWAY_OF_NEAREST: Final = 4.0
"""Maximum distance of the nearest mean in the box from the measured one, in standard deviations."""
POSITIVE_QUANTITIES: Final = frozenset({"mean_radius_ratio", "mean"})
"""Quantities that are positive, so that their error is a fraction of them."""


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
    require_emulated(file, PosteriorError)
    stored = stored_samples(file)
    values = string_values(file, campaign.data, stored)
    if not exact_values(campaign.data).all():
        require_strings(file, values.strings, "a posterior", PosteriorError)
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


class MeasuredMean:
    """A `Measurement` of the one number that a set compares.

    That number is emulated as it is, by the emulator of the set, so it has formulas of its own. Its
    variance is the square of the error plus that of the emulated mean; the noise of samples is in
    the error.

    Parameters
    ----------
    emulated
        The emulated set.
    measured, error
        The measured mean and its standard error.
    """

    given = "a measured mean"

    def __init__(self, emulated: EmulatedSet, measured: float, error: float) -> None:
        self.box, self.coordinates = emulated.box, emulated.coordinates
        [self.quantity], self.criterion_text = (
            emulated.criterion.quantities,
            emulated.criterion.text,
        )
        self.measured, self.error = measured, error
        self._emulated = emulated
        self._reach = MAX_AWAY * math.hypot(error, float(emulated.prior[1].deviations.max()))

    def log_density(self, strings: Floats) -> Floats:
        """Return the logarithm of the density of the mean given strings, (n, k): (n,)."""
        return self.log_density_at(self._emulated.at(strings))

    def log_density_at(self, at: EmulatedStrings) -> Floats:
        """Return the same of emulated strings, (n,)."""
        variance, alive = self.error**2 + at.deviations[:, 0] ** 2, 1.0 - at.failing
        with np.errstate(divide="ignore"):
            return np.asarray(
                np.log(alive)
                - 0.5 * (self.measured - at.means[:, 0]) ** 2 / variance
                - 0.5 * np.log(variance)
            )

    def near(self, strings: Floats) -> Floats:
        """Return those of strings, (n, k), whose emulated mean is within reach."""
        means = self._emulated.mean_only(strings)[:, 0]
        return strings[np.abs(means - self.measured) <= self._reach]

    def entries(self) -> dict[str, Any]:
        """Return what was measured as plain values."""
        return {"measured": self.measured, "error": self.error}

    def observed(self) -> Iterator[Observed]:
        """Yield the measured mean for an ArviZ file."""
        label = "mean b/b0" if self.quantity == "mean_radius_ratio" else self.quantity
        values, errors = np.array([self.measured]), np.array([self.error])
        meaning = {"units": "1", "long_name": label}
        yield Observed(self.quantity, "measurement", values, errors, meaning)

    def measurements(
        self, strings: Floats, random: np.random.Generator, given: bool
    ) -> list[Floats]:
        """Return one further measurement for strings, (n, k): a list of one (n, 1)."""
        known = self._emulated.at(strings)
        mean, deviation = known.means[:, 0], known.deviations[:, 0]
        if given:
            share = deviation**2 / (deviation**2 + self.error**2)
            mean = mean + share * (self.measured - mean)
            deviation = self.error * np.sqrt(share)
        return [random.normal(mean, np.hypot(deviation, self.error))[:, None]]


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
    drawn = sample_posterior(of, strings, first, len(strings))
    return Posterior(**vars(drawn), of=of)


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
