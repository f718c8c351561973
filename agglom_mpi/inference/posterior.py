"""Posterior of the variables of a campaign, given a measured mean."""

import math
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.config.arguments import read_error, read_number, shown
from agglom_mpi.config.yaml_source import ArgumentError
from agglom_mpi.declaration.spelling import suggestion
from agglom_mpi.emulation.gaussian_process import Floats
from agglom_mpi.errors import UserError
from agglom_mpi.inference.draw_groups import (
    DEFAULT_DRAWS,
    EqualDraws,
    Groups,
    Measurement,
    arviz_data,
    posterior_groups,
    root_attributes,
)
from agglom_mpi.inference.membership import EmulatedBox, KnownStrings
from agglom_mpi.statistics import weighted_quantiles

if TYPE_CHECKING:
    import pandas as pd

    from agglom_mpi.config.campaign import Campaign

PRIOR_POINTS: Final = 1 << 14
"""Number of points of the prior to begin with."""
MAX_PRIOR_POINTS: Final = 1 << 17
"""Number of points of the prior at which no more are added."""
SUFFICIENT_SIZE: Final = 1000.0
"""Stop adding points of the prior at this effective size."""
MIN_SIZE: Final = 200.0
"""Effective size below which a chain is run; without the library for it there is a warning."""
MAX_AWAY: Final = 6.0
"""Distance from the measured mean, in standard deviations, beyond which a string has no weight."""
MAX_AWAY_OF_NEAREST: Final = 4.0
"""Maximum distance of the nearest mean in the box from the measured one, in standard deviations."""
MIN_WALKERS, WALKERS_PER_VARIABLE = 32, 4
"""Minimum number of walkers of a chain, and their number per searched variable."""
CHAIN_STEPS: Final = 600
"""Number of steps of each walker; the first third is discarded."""
POSITIVE_QUANTITIES: Final = frozenset({"mean_radius_ratio", "mean"})
"""Quantities that are positive, so that their error is a fraction of them."""
REPORTED_QUANTILES: Final = (0.025, 0.25, 0.5, 0.75, 0.975)
"""Reported quantiles."""


class PosteriorError(UserError, ValueError):
    """A posterior that cannot be computed, with the reason."""


class Posterior(NamedTuple):
    """Weighted strings that stand for the posterior.

    Attributes
    ----------
    of
        The emulated box of the feasible set that it rests on.
    measured, error
        The measured mean and its standard error.
    strings
        Strings in SI units, shape (n, k).
    weights
        Their weights, whose sum is 1, shape (n,).
    effective_size
        Number of independent strings that would be as informative.
    method
        `importance weights` or `chain`.
    walkers
        Number of walkers of the chain, which alternate in the strings; 0 without a chain.
    """

    of: EmulatedBox
    measured: float
    error: float
    strings: Floats
    weights: Floats
    effective_size: float
    method: str
    walkers: int = 0

    @property
    def warning(self) -> str:
        """Reason for which the posterior is unreliable; empty if there is none."""
        if self.effective_size >= MIN_SIZE:
            return ""
        return (
            f"the effective size is {self.effective_size:.0f}, too small to trust the tails: the "
            "measurement leaves little of the box; pip install emcee for a Markov chain, or search "
            "a narrower box"
        )

    @property
    def draws(self) -> "pd.DataFrame":
        """The searched variables in SI units and the weight of each string, as a DataFrame."""
        return self.of.box.table(self.strings, weight=self.weights)

    def sample(self, n: int, seed: int = 0) -> "pd.DataFrame":
        """Draw n strings of equal weight, with replacement; raises ValueError for a wrong n."""
        return self.of.box.table(self.strings[self._chosen("n", n, seed)])

    def to_pandas(self) -> "pd.DataFrame":
        """Return the same as `draws`: units are in `.attrs["units"]`, and weights add up to 1."""
        return self.draws

    def to_arviz(self, draws: int = DEFAULT_DRAWS, seed: int = 0) -> Any:
        """Return the posterior as an `arviz.InferenceData`; as a DataTree from ArviZ 1 on.

        Groups, number of draws and seed are those of `groups`; raises MissingLibraryError without
        ArviZ.
        """
        return arviz_data(self.groups(draws, seed), root_attributes(self.of))

    def groups(self, draws: int = DEFAULT_DRAWS, seed: int = 0) -> Groups:
        """Return the groups of an ArviZ file as xarray Datasets by name.

        Weighted strings are drawn anew, with replacement, to `draws` of equal weight, of one chain;
        `sample_stats` has the `weight` that the string of each draw had. The steps of a Markov
        chain are of equal weight already, and all are kept: each walker is a chain. The effective
        size, which no number of draws can raise, is an attribute of `posterior`.
        """
        seed = self.of.box.count("seed", seed)
        if self.walkers:
            chosen = np.arange(len(self.weights)).reshape(-1, self.walkers).T
        else:
            chosen = self._chosen("draws", draws, seed)[None]
        meaning = "weight of the string before it was drawn; the draws need no weights"
        stats = {"weight": (self.weights[chosen], meaning)}
        measured = Measurement(self.of.criterion.quantities[0], self.measured, self.error)
        attributes = {
            "draws_are": "the posterior, given a measured mean",
            "effective_size": self.effective_size,
            "method": self.method,
            "warning": self.warning,
        }
        drawn = EqualDraws(self.strings[chosen], stats)
        return posterior_groups(self.of, drawn, measured, attributes, seed)

    def _chosen(self, field: str, n: int, seed: int) -> NDArray[np.int64]:
        """Return which strings are n draws of equal weight, with replacement, (n,)."""
        n, seed = self.of.box.count(field, n, least=1), self.of.box.count("seed", seed)
        return np.random.default_rng(seed).choice(len(self.weights), n, p=self.weights)

    def quantiles(self, name: str) -> tuple[float, ...]:
        """Return the `REPORTED_QUANTILES` quantiles of a searched variable, in SI units.

        Raises
        ------
        CampaignError
            If the campaign does not search a variable of that name.
        """
        if name not in self.of.box.names:
            hint = suggestion(name, self.of.box.names)
            raise self.of.box.mistaken(name, f"is no searched variable; {hint}")
        variable = self.of.box.own[self.of.box.names.index(name)]
        return weighted_quantiles(variable.values(self.strings), self.weights, REPORTED_QUANTILES)

    @property
    def correlations(self) -> Floats:
        """Correlations of the searched variables, in the coordinates of the emulator, (d, d)."""
        covariance = self._covariance
        scale = np.sqrt(np.diag(covariance))
        return np.asarray(covariance / np.outer(scale, scale))

    @property
    def partial_correlations(self) -> Floats:
        """Correlations of two searched variables, the others kept, (d, d)."""
        d = len(self.of.box.names)
        precision = np.linalg.inv(self._covariance + 1e-12 * np.eye(d))
        scale = np.sqrt(np.diag(precision))
        return np.asarray(2.0 * np.eye(d) - precision / np.outer(scale, scale))

    @property
    def _covariance(self) -> Floats:
        own = self.of.coordinates.own(self.strings)
        return np.atleast_2d(np.cov(own.T, aweights=self.weights))

    def as_dict(self) -> dict[str, Any]:
        """Return the posterior without its draws as plain values.

        `variables` has the `quantiles` of each variable in SI units, whose names are in `units`.
        Rows and columns of both matrices of correlations are in the order of `variables`.
        """
        names = self.of.box.names
        return {
            "measured": self.measured,
            "error": self.error,
            "effective_size": self.effective_size,
            "strings": len(self.weights),
            "method": self.method,
            "warning": self.warning or None,
            "quantiles": list(REPORTED_QUANTILES),
            "variables": {name: list(self.quantiles(name)) for name in names},
            "units": {each.name: each.unit for each in self.of.box.own},
            "correlations": self.correlations.tolist(),
            "partial_correlations": self.partial_correlations.tolist(),
        }


def posterior(emulated: EmulatedBox, measured: float | str, error: float | str) -> Posterior:
    """Return the posterior; see `FeasibleSet.posterior`.

    The weight of a string is the density of the measured mean, with a variance that is the square
    of its error plus that of the emulated mean. The noise of samples is in the error already.

    Raises
    ------
    PosteriorError
        If several numbers are compared, or the measured mean is nowhere in the box.
    ArgumentError
        If the measured mean or its error is impossible.
    """
    campaign, quantities = emulated.box.campaign, emulated.criterion.quantities
    measured, error = measurement_of(campaign, quantities, measured, error)
    prior, count = emulated.known_box(PRIOR_POINTS), PRIOR_POINTS
    _check_possible(prior, measured, error)
    # Where the mean is further away than this, weights are nothing to those elsewhere.
    reach = MAX_AWAY * math.hypot(error, float(prior.deviation.max()))
    while True:
        strings, logarithms = prior.strings, _log_weights(prior, measured, error)
        weights = np.exp(logarithms - logarithms.max())
        size = effective_size(weights)
        if size >= SUFFICIENT_SIZE or count >= MAX_PRIOR_POINTS:
            break
        count *= 2 if size > 0.5 * SUFFICIENT_SIZE else 4
        prior = _prior_near(emulated, count, measured, reach)
    if size < MIN_SIZE:
        chain = _chain(emulated, strings, weights, measured, error)
        if chain is not None:
            return chain
    some = weights > 1e-12 * weights.max()
    weights = weights[some] / weights[some].sum()
    return Posterior(emulated, measured, error, strings[some], weights, size, "importance weights")


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
        As for `posterior`.

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


def effective_size(weights: Floats) -> float:
    """Return the effective number of weighted strings (Kish 1965); 0 if there are none."""
    squares = float(weights @ weights)
    return float(weights.sum()) ** 2 / squares if squares > 0.0 else 0.0


def _prior_near(emulated: EmulatedBox, count: int, mean: float, reach: float) -> KnownStrings:
    """Return those of `count` points of the box whose emulated mean is within reach of a mean."""
    strings = emulated.box.even_strings(count)
    means = emulated.mean_only(strings)[:, 0]
    return emulated.known(strings[np.abs(means - mean) <= reach])


def _check_possible(prior: KnownStrings, measured: float, error: float) -> None:
    """Raise a PosteriorError if no string has the measured mean."""
    mean = prior.mean
    away = np.abs(measured - mean) / np.hypot(error, prior.deviation)
    if away.min(initial=np.inf) > MAX_AWAY_OF_NEAREST:
        raise PosteriorError(
            f"measured is {measured:g} ± {error:g}, which no string of the box can give: by the "
            f"emulator they reach {mean.min():.4g} to {mean.max():.4g}"
        )


def _log_weights(at: KnownStrings, measured: float, error: float) -> Floats:
    """Return the logarithms of the densities of a measured mean, (n,), but for a constant."""
    mean, variance = at.mean, error**2 + at.deviation**2
    alive = 1.0 - at.failing
    with np.errstate(divide="ignore"):
        return np.asarray(
            np.log(alive) - 0.5 * (measured - mean) ** 2 / variance - 0.5 * np.log(variance)
        )


def _chain(
    emulated: EmulatedBox, strings: Floats, weights: Floats, measured: float, error: float
) -> Posterior | None:
    """Return a posterior by an ensemble of Markov chains; None without the library emcee."""
    try:
        import emcee
    except ImportError:
        return None
    box, space = emulated.box, emulated.box.space
    d = len(box.names)
    walkers = max(MIN_WALKERS, WALKERS_PER_VARIABLE * d)

    def log_density(points: Floats) -> Floats:
        inside = ((points >= 0.0) & (points <= 1.0)).all(axis=1)
        found = np.full(len(points), -np.inf)
        chosen = space.from_unit(np.clip(points[inside], 0.0, 1.0))
        values = _log_weights(emulated.known(chosen), measured, error)
        found[inside] = np.where(box.allowed(chosen), values, -np.inf)
        return found

    random = np.random.default_rng(box.campaign.seed)
    chosen = random.choice(len(weights), walkers, p=weights / weights.sum())
    starts = space.to_unit(strings[chosen]) + 1e-4 * random.normal(size=(walkers, d))
    sampler = emcee.EnsembleSampler(walkers, d, log_density, vectorize=True)
    sampler.run_mcmc(np.clip(starts, 1e-6, 1.0 - 1e-6), CHAIN_STEPS)
    drawn = sampler.get_chain(discard=CHAIN_STEPS // 3, flat=True)
    time = float(np.max(sampler.get_autocorr_time(quiet=True, tol=0)))
    size, equal = len(drawn) / time, np.full(len(drawn), 1.0 / len(drawn))
    found = space.from_unit(drawn)
    return Posterior(emulated, measured, error, found, equal, size, "chain", walkers)
