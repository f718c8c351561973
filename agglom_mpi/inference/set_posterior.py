"""Posterior of the variables of a campaign, given a measured mean."""

import math
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.config.arguments import read_error, read_number, shown
from agglom_mpi.config.yaml_source import ArgumentError
from agglom_mpi.declaration.spelling import suggestion
from agglom_mpi.errors import UserError
from agglom_mpi.inference.set_directions import weighted_quantiles

if TYPE_CHECKING:
    import pandas as pd

    from agglom_mpi.config.campaign import Campaign
    from agglom_mpi.inference.feasible_set import FeasibleSet, Prior

Floats = NDArray[np.float64]

POINTS: Final = 1 << 14
"""Points of the prior."""
MOST_POINTS: Final = 1 << 17
"""Points at most, where the effective size of fewer is too small."""
SUFFICIENT: Final = 1000.0
"""Effective size from which no more points are taken."""
TOO_SMALL: Final = 200.0
"""Effective size below which a chain is run, and there is a warning without one."""
OUT_OF_REACH: Final = 6.0
"""Standard deviations from the measured mean beyond which a string has no weight."""
FARTHEST: Final = 4.0
"""Standard deviations between the measured mean and that of the nearest string at most."""
POSITIVE: Final = frozenset({"mean_radius_ratio", "mean"})
"""Quantities that are positive, so that their error is a fraction of them."""
CREDIBLE: Final = (0.025, 0.25, 0.5, 0.75, 0.975)
"""Reported quantiles."""


class PosteriorError(UserError, ValueError):
    """A posterior that cannot be computed, with the reason."""


class Posterior(NamedTuple):
    """Weighted strings that stand for the posterior.

    Attributes
    ----------
    of
        The feasible set, whose emulator it rests on.
    measured, error
        The measured mean and its standard error.
    strings
        Shape (n, 10), in SI units.
    weights
        Shape (n,); their sum is 1.
    effective_size
        Number of independent strings that would be as informative.
    method
        `importance weights` or `chain`.
    """

    of: "FeasibleSet"
    measured: float
    error: float
    strings: Floats
    weights: Floats
    effective_size: float
    method: str

    @property
    def warning(self) -> str:
        """What is wrong with it; empty if nothing is."""
        if self.effective_size >= TOO_SMALL:
            return ""
        return (
            f"the effective size is {self.effective_size:.0f}, too small to trust the tails: the "
            "measurement leaves little of the box; pip install emcee for a Markov chain, or search "
            "a narrower box"
        )

    @property
    def draws(self) -> "pd.DataFrame":
        """The searched variables in SI units and the weight of each string, as a DataFrame."""
        return self.of.table(self.strings, weight=self.weights)

    def sample(self, n: int, seed: int = 0) -> "pd.DataFrame":
        """Draw n strings, with replacement, with equal weights; raises ValueError if n is none."""
        n, seed = self.of.count("n", n, least=1), self.of.count("seed", seed)
        chosen = np.random.default_rng(seed).choice(len(self.weights), n, p=self.weights)
        return self.of.table(self.strings[chosen])

    def quantiles(self, name: str) -> tuple[float, ...]:
        """Return the `CREDIBLE` quantiles of a searched variable, in SI units.

        Raises
        ------
        CampaignError
            If the campaign does not search a variable of that name.
        """
        if name not in self.of.names:
            hint = suggestion(name, self.of.names)
            raise self.of.mistaken(name, f"is no searched variable; {hint}")
        variable = self.of.own[self.of.names.index(name)]
        return weighted_quantiles(variable.values(self.strings), self.weights, CREDIBLE)

    @property
    def correlations(self) -> Floats:
        """Correlations of the searched variables, in the coordinates of the emulator, (d, d)."""
        covariance = self._covariance
        scale = np.sqrt(np.diag(covariance))
        return np.asarray(covariance / np.outer(scale, scale))

    @property
    def partial_correlations(self) -> Floats:
        """Correlations of two variables, the others kept, (d, d)."""
        d = len(self.of.coordinates.names)
        precision = np.linalg.inv(self._covariance + 1e-12 * np.eye(d))
        scale = np.sqrt(np.diag(precision))
        return np.asarray(2.0 * np.eye(d) - precision / np.outer(scale, scale))

    @property
    def _covariance(self) -> Floats:
        own = self.of.coordinates.own(self.strings)
        return np.atleast_2d(np.cov(own.T, aweights=self.weights))

    def as_dict(self) -> dict[str, Any]:
        """Return all but the draws as plain values."""
        names = self.of.names
        return {
            "measured": self.measured,
            "error": self.error,
            "effective_size": self.effective_size,
            "strings": len(self.weights),
            "method": self.method,
            "warning": self.warning or None,
            "quantiles": list(CREDIBLE),
            "variables": {name: list(self.quantiles(name)) for name in names},
            "correlations": self.correlations.tolist(),
            "partial_correlations": self.partial_correlations.tolist(),
        }


def posterior(of: "FeasibleSet", measured: float | str, error: float | str) -> Posterior:
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
    measured, error = measurement_of(of.campaign, of.criterion.quantities, measured, error)
    prior, count = of.prior(POINTS), POINTS
    _check_possible(prior, measured, error)
    # Where the mean is further away than this, weights are nothing to those elsewhere.
    reach = OUT_OF_REACH * math.hypot(error, float(prior.deviation.max()))
    while True:
        strings, logarithms = prior.strings, _log_weights(prior, measured, error)
        weights = np.exp(logarithms - logarithms.max())
        size = effective_size(weights)
        if size >= SUFFICIENT or count >= MOST_POINTS:
            break
        count *= 2 if size > 0.5 * SUFFICIENT else 4
        prior = of.prior_near(count, measured, reach)
    if size < TOO_SMALL:
        chain = _chain(of, strings, weights, measured, error)
        if chain is not None:
            return chain
    some = weights > 1e-12 * weights.max()
    weights = weights[some] / weights[some].sum()
    return Posterior(of, measured, error, strings[some], weights, size, "importance weights")


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
    is_radius = quantities[0] in POSITIVE
    try:
        value = read_number(measured)
        if is_radius and value <= 0.0:
            raise ValueError(f"is {shown(measured)}; must be greater than 0, a mean b/b0")
        field = "error"
        deviation = read_error(error, value, positive=is_radius)
        field = "measured"
        largest = campaign.scene.equivalent_grains ** (1.0 / 3.0)
        if is_radius and value - FARTHEST * deviation > largest:
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


def _check_possible(prior: "Prior", measured: float, error: float) -> None:
    """Raise a PosteriorError if the measured mean is that of no string."""
    mean = prior.mean
    away = np.abs(measured - mean) / np.hypot(error, prior.deviation)
    if away.min(initial=np.inf) > FARTHEST:
        raise PosteriorError(
            f"measured is {measured:g} ± {error:g}, which no string of the box can give: by the "
            f"emulator they reach {mean.min():.4g} to {mean.max():.4g}"
        )


def _log_weights(at: "Prior", measured: float, error: float) -> Floats:
    """Return the logarithms of the densities of a measured mean, (n,), but for a constant."""
    mean, variance = at.mean, error**2 + at.deviation**2
    alive = 1.0 - at.failing
    with np.errstate(divide="ignore"):
        return np.asarray(
            np.log(alive) - 0.5 * (measured - mean) ** 2 / variance - 0.5 * np.log(variance)
        )


def _chain(
    of: "FeasibleSet", strings: Floats, weights: Floats, measured: float, error: float
) -> Posterior | None:
    """Return a posterior by an ensemble of Markov chains; None without the library emcee."""
    try:
        import emcee
    except ImportError:
        return None
    from agglom_mpi.inference.feasible_set import Prior

    space, d = of.campaign.variables.space(), len(of.coordinates.names)
    walkers, steps = max(32, 4 * d), 600

    def log_density(points: Floats) -> Floats:
        inside = ((points >= 0.0) & (points <= 1.0)).all(axis=1)
        found = np.full(len(points), -np.inf)
        chosen = space.from_unit(np.clip(points[inside], 0.0, 1.0))
        known = Prior(chosen, *of.moments_of(chosen), of.failing_of(chosen))
        values = _log_weights(known, measured, error)
        found[inside] = np.where(of.campaign.allowed_strings(chosen), values, -np.inf)
        return found

    random = np.random.default_rng(of.campaign.seed)
    chosen = random.choice(len(weights), walkers, p=weights / weights.sum())
    starts = space.to_unit(strings[chosen]) + 1e-4 * random.normal(size=(walkers, d))
    sampler = emcee.EnsembleSampler(walkers, d, log_density, vectorize=True)
    sampler.run_mcmc(np.clip(starts, 1e-6, 1.0 - 1e-6), steps)
    drawn = sampler.get_chain(discard=steps // 3, flat=True)
    time = float(np.max(sampler.get_autocorr_time(quiet=True, tol=0)))
    equal = np.full(len(drawn), 1.0 / len(drawn))
    return Posterior(of, measured, error, space.from_unit(drawn), equal, len(drawn) / time, "chain")
