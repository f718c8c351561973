"""Posterior of the variables of a campaign, given one measured mean."""

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from agglom_mpi.config.arguments import read_error, read_number, shown
from agglom_mpi.config.yaml_source import ArgumentError
from agglom_mpi.emulation.gaussian_process import Floats
from agglom_mpi.inference.draw_groups import Observed, Predicted
from agglom_mpi.inference.membership import EmulatedBox, KnownStrings
from agglom_mpi.inference.posterior import Posterior, PosteriorError
from agglom_mpi.inference.posterior_sampling import PRIOR_POINTS, sample_posterior

if TYPE_CHECKING:
    from agglom_mpi.config.campaign import Campaign

MAX_AWAY: Final = 6.0
"""Distance from the measured mean, in standard deviations, beyond which a string has no weight."""
MAX_AWAY_OF_NEAREST: Final = 4.0
"""Maximum distance of the nearest mean in the box from the measured one, in standard deviations."""
POSITIVE_QUANTITIES: Final = frozenset({"mean_radius_ratio", "mean"})
"""Quantities that are positive, so that their error is a fraction of them."""


@dataclass(frozen=True, eq=False, repr=False)
class MeanPosterior(Posterior[EmulatedBox]):
    """Weighted strings that stand for the posterior, given one measured mean.

    Attributes
    ----------
    measured, error
        The measured mean and its standard error.
    """

    measured: float
    error: float

    @property
    def given(self) -> str:
        """The measurement, in a few words."""
        return "a measured mean"

    def predicted(self, random: np.random.Generator) -> Predicted:
        """Return the measured quantity, and what predicts measurements of it.

        The error of the emulator at a string is the same for every measurement, so that a measured
        mean narrows it down, too.
        """
        name = self.of.criterion.quantities[0]
        label = "mean b/b0" if name == "mean_radius_ratio" else name
        values, errors = np.array([self.measured]), np.array([self.error])
        observed = Observed(name, "measurement", values, errors, {"units": "1", "long_name": label})

        def measurements(strings: Floats, given: bool) -> list[Floats]:
            known = self.of.known(strings)
            mean, deviation = known.mean, known.deviation
            if given:
                share = deviation**2 / (deviation**2 + self.error**2)
                mean = mean + share * (self.measured - mean)
                deviation = self.error * np.sqrt(share)
            return [random.normal(mean, np.hypot(deviation, self.error))[:, None]]

        return Predicted([observed], measurements)

    def attributes(self) -> dict[str, Any]:
        """Return the attributes of an ArviZ file as a whole."""
        return self._root_attributes(self.of.criterion.text)

    def as_dict(self) -> dict[str, Any]:
        """Return the posterior without its draws as plain values; see `Posterior.as_dict`.

        `measured` and `error` are the measured mean and its standard error.
        """
        return {"measured": self.measured, "error": self.error} | super().as_dict()


class MeasuredMean:
    """Density of a measured mean, given the string.

    Its variance is the square of the error plus that of the emulated mean. The noise of samples is
    in the error already.

    Parameters
    ----------
    emulated
        The emulated box.
    measured, error
        The measured mean and its standard error.
    reach
        Distance of an emulated mean from the measured one beyond which a string has no weight.
    """

    def __init__(self, emulated: EmulatedBox, measured: float, error: float, reach: float) -> None:
        self._emulated, self._measured, self._error = emulated, measured, error
        self._reach = reach

    def log_density(self, strings: Floats) -> Floats:
        """Return the logarithm of the density given strings, (n, k), but for a constant, (n,)."""
        return self.log_density_at(self._emulated.known(strings))

    def log_density_at(self, at: KnownStrings) -> Floats:
        """Return the same of strings that are known already, (n,)."""
        variance, alive = self._error**2 + at.deviation**2, 1.0 - at.failing
        with np.errstate(divide="ignore"):
            return np.asarray(
                np.log(alive)
                - 0.5 * (self._measured - at.mean) ** 2 / variance
                - 0.5 * np.log(variance)
            )

    def near(self, strings: Floats) -> Floats:
        """Return those of strings, (n, k), whose emulated mean is within reach."""
        means = self._emulated.mean_only(strings)[:, 0]
        return strings[np.abs(means - self._measured) <= self._reach]


def mean_posterior(
    emulated: EmulatedBox, measured: float | str, error: float | str
) -> MeanPosterior:
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
    prior = emulated.known_box(PRIOR_POINTS)
    _check_possible(prior, measured, error)
    reach = MAX_AWAY * math.hypot(error, float(prior.deviation.max()))
    likelihood = MeasuredMean(emulated, measured, error, reach)
    first = likelihood.log_density_at(prior)
    count = len(prior.strings)
    drawn = sample_posterior(likelihood, emulated.box, prior.strings, first, count)
    return MeanPosterior(emulated, drawn, measured, error)


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


def _check_possible(prior: KnownStrings, measured: float, error: float) -> None:
    """Raise a PosteriorError if no string has the measured mean."""
    mean = prior.mean
    away = np.abs(measured - mean) / np.hypot(error, prior.deviation)
    if away.min(initial=np.inf) > MAX_AWAY_OF_NEAREST:
        raise PosteriorError(
            f"measured is {measured:g} ± {error:g}, which no string of the box can give: by the "
            f"emulator they reach {mean.min():.4g} to {mean.max():.4g}"
        )
