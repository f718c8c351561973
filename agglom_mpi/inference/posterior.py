"""Posterior of the variables of a campaign: weighted strings of the box, whatever was measured.

What was measured is a `Likelihood`. Its density weighs even points of the prior, which is uniform
over what is allowed of the box; there are more points, in a smaller part of the box, until enough
of them count. If they never do, Markov chains are run.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, Final, NamedTuple, Protocol, Self

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.config.coordinates import Coordinates
from agglom_mpi.declaration.spelling import suggestion
from agglom_mpi.emulation.gaussian_process import Floats
from agglom_mpi.errors import UserError
from agglom_mpi.inference.draw_groups import (
    DEFAULT_DRAWS,
    EqualDraws,
    Groups,
    Predicted,
    arviz_data,
    posterior_groups,
    root_attributes,
)
from agglom_mpi.inference.searched_box import SearchedBox
from agglom_mpi.statistics import weighted_quantiles

if TYPE_CHECKING:
    import pandas as pd

PRIOR_POINTS: Final = 1 << 14
"""Number of points of the prior to begin with."""
MAX_PRIOR_POINTS: Final = 1 << 17
"""Number of points of the prior at which no more are added."""
SUFFICIENT_SIZE: Final = 1000.0
"""Stop adding points of the prior at this effective size."""
MIN_SIZE: Final = 200.0
"""Effective size below which a chain is run; without the library for it there is a warning."""
MAX_LOGARITHM_AWAY: Final = 18.0
"""Logarithm of the density, below the largest one, at which a point has no weight."""
PART_MARGIN: Final = 0.1
"""Relative margin added to the part of the box that has all the weight."""
MIN_PART_POINTS: Final = 100
"""Minimum number of points with weight before the box is narrowed down to where they are."""
MIN_WALKERS, WALKERS_PER_VARIABLE = 32, 4
"""Minimum number of walkers of a chain, and their number per searched variable."""
CHAIN_STEPS: Final = 600
"""Number of steps of each walker; the first third is discarded."""
REPORTED_QUANTILES: Final = (0.025, 0.25, 0.5, 0.75, 0.975)
"""Reported quantiles."""
CENTRAL: Final = (0.05, 0.95)
"""Quantiles at the ends of the central 90 %."""
REGION_SHARE: Final = 0.9
"""Share of the posterior in the region whose volume is reported."""
REGION_POINTS: Final = 1 << 13
"""Number of even points that measure the volume of the region of a chain."""


class PosteriorError(UserError, ValueError):
    """A posterior that cannot be computed, with the reason."""


class Likelihood(Protocol):
    """What was measured, as a function of the string."""

    def log_density(self, strings: Floats) -> Floats:
        """Return the logarithm of the density of the data given strings, (n, k): (n,).

        A constant may be left out; -inf excludes a string.
        """
        ...

    def near(self, strings: Floats) -> Floats:
        """Return those of strings, (n, k), that may have any weight, found at little cost."""
        ...


class Emulated(Protocol):
    """What a posterior rests on: the box, and the coordinates of its emulator."""

    box: SearchedBox
    coordinates: Coordinates


class WeightedStrings(NamedTuple):
    """Strings that stand for a posterior.

    Attributes
    ----------
    strings
        In SI units, shape (n, k).
    weights
        Their weights, whose sum is 1, shape (n,).
    effective_size
        Number of independent strings that would be as informative.
    method
        `importance weights` or `chain`.
    walkers
        Number of walkers of the chain, which alternate in the strings; 0 without a chain.
    region
        Share of the allowed part of the box that the smallest region with 90 % of the weight has.
    """

    strings: Floats
    weights: Floats
    effective_size: float
    method: str
    walkers: int
    region: float


class BoxPart(NamedTuple):
    """A part of the search box: a box along other axes, as far as it is inside.

    Attributes
    ----------
    axes
        Orthonormal axes in units of the search box, as columns, shape (d, d).
    lower, upper
        Bounds along these, shape (d,).
    """

    axes: Floats
    lower: Floats
    upper: Floats

    @classmethod
    def around(cls, points: Floats) -> Self:
        """Return the part along the principal axes of points, (n, d), that has all of them."""
        _, axes = np.linalg.eigh(np.atleast_2d(np.cov(points.T)))
        along = points @ axes
        low, high = along.min(axis=0), along.max(axis=0)
        margin = PART_MARGIN * (high - low)
        return cls(axes, low - margin, high + margin)

    @property
    def volume(self) -> float:
        """Volume, also of what is outside of the search box, relative to the search box."""
        return float(np.prod(self.upper - self.lower))

    def even_strings(self, box: SearchedBox, count: int) -> Floats:
        """Return those of `count` even points of the part that the box allows, (n, k) in SI."""
        from scipy.stats import qmc

        even = qmc.Sobol(len(self.axes), seed=box.campaign.seed).random(count)
        points = (self.lower + even * (self.upper - self.lower)) @ self.axes.T
        inside = ((points >= 0.0) & (points <= 1.0)).all(axis=1)
        strings = box.space.from_unit(points[inside])
        return strings[box.allowed(strings)]


@dataclass(frozen=True, eq=False, repr=False)
class Posterior(ABC):
    """Weighted strings that stand for the posterior.

    Attributes
    ----------
    of
        The emulator that it rests on, with the search box.
    drawn
        The strings.
    """

    of: Any
    drawn: WeightedStrings

    @property
    def strings(self) -> Floats:
        """Strings in SI units, shape (n, k)."""
        return self.drawn.strings

    @property
    def weights(self) -> Floats:
        """Weights of the strings, whose sum is 1, shape (n,)."""
        return self.drawn.weights

    @property
    def effective_size(self) -> float:
        """Number of independent strings that would be as informative."""
        return self.drawn.effective_size

    @property
    def method(self) -> str:
        """Either `importance weights` or `chain`."""
        return self.drawn.method

    @property
    def volume(self) -> float:
        """Share of the allowed part of the box in the smallest region with 90 % of the weight."""
        return self.drawn.region

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
        return arviz_data(self.groups(draws, seed), self.attributes())

    def groups(self, draws: int = DEFAULT_DRAWS, seed: int = 0) -> Groups:
        """Return the groups of an ArviZ file as xarray Datasets by name.

        Weighted strings are drawn anew, with replacement, to `draws` of equal weight, of one chain;
        `sample_stats` has the `weight` that the string of each draw had. The steps of a Markov
        chain are of equal weight already, and all are kept: each walker is a chain. The effective
        size, which no number of draws can raise, is an attribute of `posterior`.
        """
        seed = self.of.box.count("seed", seed)
        if self.drawn.walkers:
            chosen = np.arange(len(self.weights)).reshape(-1, self.drawn.walkers).T
        else:
            chosen = self._chosen("draws", draws, seed)[None]
        meaning = "weight of the string before it was drawn; the draws need no weights"
        stats = {"weight": (self.weights[chosen], meaning)}
        attributes = {
            "draws_are": f"the posterior, given {self.given}",
            "effective_size": self.effective_size,
            "method": self.method,
            "warning": self.warning,
        }
        equal = EqualDraws(self.strings[chosen], stats)
        random = np.random.default_rng([seed, 1])
        return posterior_groups(self.of.box, equal, attributes, self.predicted(random))

    @property
    @abstractmethod
    def given(self) -> str:
        """What was measured, in a few words."""

    @abstractmethod
    def predicted(self, random: np.random.Generator) -> Predicted:
        """Return the measured quantities, and what predicts measurements of them."""

    @abstractmethod
    def attributes(self) -> dict[str, Any]:
        """Return the attributes of an ArviZ file as a whole."""

    def _chosen(self, field: str, n: int, seed: int) -> NDArray[np.int64]:
        """Return which strings are n draws of equal weight, with replacement, (n,)."""
        n, seed = self.of.box.count(field, n, least=1), self.of.box.count("seed", seed)
        return np.random.default_rng(seed).choice(len(self.weights), n, p=self.weights)

    def quantiles(
        self, name: str, shares: tuple[float, ...] = REPORTED_QUANTILES
    ) -> tuple[float, ...]:
        """Return quantiles of a searched variable, in SI units; by default `REPORTED_QUANTILES`.

        Raises
        ------
        CampaignError
            If the campaign does not search a variable of that name.
        """
        if name not in self.of.box.names:
            hint = suggestion(name, self.of.box.names)
            raise self.of.box.mistaken(name, f"is no searched variable; {hint}")
        variable = self.of.box.own[self.of.box.names.index(name)]
        return weighted_quantiles(variable.values(self.strings), self.weights, shares)

    @cached_property
    def contraction(self) -> dict[str, float]:
        """Width of the central 90 % of each variable relative to the prior's, by name.

        Both widths are measured in the coordinate in which the variable is searched.
        """
        box = self.of.box
        prior = box.space.to_unit(box.even_strings(REGION_POINTS))
        mine, equal = box.space.to_unit(self.strings), np.full(len(prior), 1.0 / len(prior))
        found = {}
        for i, name in enumerate(box.names):
            low, high = weighted_quantiles(mine[:, i], self.weights, CENTRAL)
            least, most = weighted_quantiles(prior[:, i], equal, CENTRAL)
            found[name] = (high - low) / (most - least)
        return found

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
        `contraction` is the width of the central 90 % relative to the prior's, and `volume` the
        share of the box in the smallest region with 90 % of the posterior.
        """
        names = self.of.box.names
        return {
            "effective_size": self.effective_size,
            "strings": len(self.weights),
            "method": self.method,
            "warning": self.warning or None,
            "quantiles": list(REPORTED_QUANTILES),
            "variables": {name: list(self.quantiles(name)) for name in names},
            "units": {each.name: each.unit for each in self.of.box.own},
            "contraction": self.contraction,
            "volume": self.volume,
            "correlations": self.correlations.tolist(),
            "partial_correlations": self.partial_correlations.tolist(),
        }

    def _root_attributes(self, criterion: str) -> dict[str, Any]:
        return root_attributes(self.of.box.campaign, criterion)


def sample_posterior(
    likelihood: Likelihood, box: SearchedBox, strings: Floats, logarithms: Floats, prior: int
) -> WeightedStrings:
    """Return strings that stand for the posterior.

    Parameters
    ----------
    likelihood
        What was measured.
    box
        The search box, over which the prior is uniform.
    strings, logarithms
        Those of the first points of the prior that may have weight, shape (n, k), with their
        log-densities, (n,).
    prior
        Number of all first points: the allowed ones of `PRIOR_POINTS` even points of the box.
    """
    count, total = PRIOR_POINTS, float(prior)
    part: BoxPart | None = None
    while True:
        weights = np.exp(logarithms - logarithms.max(initial=-np.inf))
        size = effective_size(weights)
        if size >= SUFFICIENT_SIZE or count >= MAX_PRIOR_POINTS:
            break
        smaller = None if box.campaign.relations.constraints else _part(box, strings, logarithms)
        if smaller is not None and smaller.volume < (1.0 if part is None else part.volume):
            # As many points as before are denser in it.
            part = smaller
        else:
            count *= 2 if size > 0.5 * SUFFICIENT_SIZE else 4
        some = box.even_strings(count) if part is None else part.even_strings(box, count)
        total = len(some) if part is None else count / part.volume
        strings = likelihood.near(some)
        logarithms = likelihood.log_density(strings)
    if size < MIN_SIZE:
        chain = _chain(likelihood, box, strings, weights)
        if chain is not None:
            return chain
    region = _points_in_region(weights) / total
    some = weights > 1e-12 * weights.max()
    weights = weights[some] / weights[some].sum()
    return WeightedStrings(strings[some], weights, size, "importance weights", 0, region)


def _part(box: SearchedBox, strings: Floats, logarithms: Floats) -> BoxPart | None:
    """Return the part of the box around all points with weight; None where these are few.

    Others may then lie outside of what is around them.
    """
    some = logarithms > logarithms.max(initial=-np.inf) - MAX_LOGARITHM_AWAY
    if some.sum() < MIN_PART_POINTS:
        return None
    return BoxPart.around(box.space.to_unit(strings[some]))


def effective_size(weights: Floats) -> float:
    """Return the effective number of weighted strings (Kish 1965); 0 if there are none."""
    squares = float(weights @ weights)
    return float(weights.sum()) ** 2 / squares if squares > 0.0 else 0.0


def _points_in_region(weights: Floats) -> float:
    """Return the least number of points, weights (n,), that have 90 % of the weight together."""
    descending = np.sort(weights)[::-1]
    reached = np.cumsum(descending)
    return float(np.interp(REGION_SHARE * reached[-1], reached, np.arange(1, len(reached) + 1)))


def _chain(
    likelihood: Likelihood, box: SearchedBox, strings: Floats, weights: Floats
) -> WeightedStrings | None:
    """Return a posterior by an ensemble of Markov chains; None without the library emcee."""
    try:
        import emcee
    except ImportError:
        return None
    space, d = box.space, len(box.names)
    walkers = max(MIN_WALKERS, WALKERS_PER_VARIABLE * d)

    def log_density(points: Floats) -> Floats:
        inside = ((points >= 0.0) & (points <= 1.0)).all(axis=1)
        found = np.full(len(points), -np.inf)
        chosen = space.from_unit(np.clip(points[inside], 0.0, 1.0))
        values = likelihood.log_density(chosen)
        found[inside] = np.where(box.allowed(chosen), values, -np.inf)
        return found

    random = np.random.default_rng(box.campaign.seed)
    chosen = random.choice(len(weights), walkers, p=weights / weights.sum())
    starts = space.to_unit(strings[chosen]) + 1e-4 * random.normal(size=(walkers, d))
    sampler = emcee.EnsembleSampler(walkers, d, log_density, vectorize=True)
    sampler.run_mcmc(np.clip(starts, 1e-6, 1.0 - 1e-6), CHAIN_STEPS)
    drawn = sampler.get_chain(discard=CHAIN_STEPS // 3, flat=True)
    densities = sampler.get_log_prob(discard=CHAIN_STEPS // 3, flat=True)
    time = float(np.max(sampler.get_autocorr_time(quiet=True, tol=0)))
    size, equal = len(drawn) / time, np.full(len(drawn), 1.0 / len(drawn))
    least = float(np.quantile(densities, 1.0 - REGION_SHARE))
    region = _chain_region(likelihood, box, drawn, least)
    return WeightedStrings(space.from_unit(drawn), equal, size, "chain", walkers, region)


def _chain_region(likelihood: Likelihood, box: SearchedBox, drawn: Floats, least: float) -> float:
    """Return the share of what is allowed of the box with a log-density of `least` or more."""
    part = BoxPart.around(drawn)
    near = likelihood.near(part.even_strings(box, REGION_POINTS))
    count = float(np.sum(likelihood.log_density(near) >= least))
    allowed = len(box.allowed_even_strings(REGION_POINTS)) / REGION_POINTS or 1.0
    return count / REGION_POINTS * part.volume / allowed
