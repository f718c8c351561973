"""Strings that stand for a posterior, whatever was measured.

The density of what was measured weighs even points of the prior, which is uniform over
what is allowed of the box. Where too few of them count there are more, in a smaller part of the
box along the principal axes of what has weight. If they still do not suffice, Markov chains are
run.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from typing import Any, Final, NamedTuple, Protocol, Self

import numpy as np

from agglom_mpi.config.coordinates import Coordinates
from agglom_mpi.inference.expected_volume import REGION_WEIGHT, region_volumes
from agglom_mpi.inference.searched_box import SearchedBox
from agglom_mpi.statistics import Floats, weighted_quantiles

REPORTED_QUANTILES: Final = (0.025, 0.25, 0.5, 0.75, 0.975)
"""Reported quantiles."""
CENTRAL: Final = (0.05, 0.95)
"""Quantiles at the ends of the central 90 %."""
PRIOR_WIDTH_POINTS: Final = 1 << 13
"""Number of even points of the box that show how wide the prior of each variable is."""
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
REGION_POINTS: Final = 1 << 13
"""Number of even points that measure the volume of the region of a chain."""


class Observed(NamedTuple):
    """A measured quantity.

    Attributes
    ----------
    name
        Name of its variable.
    dimension
        Name of the dimension of its q values.
    values, errors
        Measured values and their standard errors, shape (q,).
    attributes
        Attributes of the variable, such as its units.
    """

    name: str
    dimension: str
    values: Floats
    errors: Floats
    attributes: dict[str, Any]


class Sampled(Protocol):
    """Density of strings of a search box; `box` is that box."""

    box: SearchedBox

    def log_density(self, strings: Floats) -> Floats:
        """Return the logarithm of the density of the data given strings, (n, k): (n,).

        A constant may be left out; -inf excludes a string.
        """

    def near(self, strings: Floats) -> Floats:
        """Return those of strings, (n, k), that may have any weight, found at little cost."""


class Measurement(Sampled, Protocol):
    """What was measured, data or a mean, and what strings predict for it.

    Attributes
    ----------
    coordinates
        Those of the emulator.
    given
        The measurement, in a few words.
    criterion_text
        Measured or wanted values that draws are compatible with.
    """

    coordinates: Coordinates
    given: str
    criterion_text: str

    def entries(self) -> dict[str, Any]:
        """Return what was measured as plain values, unless it stands with the predictions."""

    def observed(self) -> Iterator[Observed]:
        """Yield each measured quantity for an ArviZ file."""

    def measurements(
        self, strings: Floats, random: np.random.Generator, given: bool
    ) -> list[Floats]:
        """Return one further measurement of each quantity for strings, (n, k): a list of (n, q).

        The error of the emulator at a string is the same for every measurement. Where the measured
        values are `given`, they narrow it down, too.
        """


@dataclass(frozen=True, eq=False, repr=False)
class WeightedStrings:
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
    volume
        Share of the allowed part of the box in the smallest region with 90 % of the weight.
    """

    strings: Floats
    weights: Floats
    effective_size: float
    method: str
    walkers: int
    volume: float


def contraction_of(box: SearchedBox, drawn: WeightedStrings) -> dict[str, float]:
    """Return the width of the central 90 % of each variable relative to the prior's, by name.

    Both are measured in the coordinate in which the variable is searched.
    """
    prior = box.space.to_unit(box.even_strings(PRIOR_WIDTH_POINTS))
    mine, equal = box.space.to_unit(drawn.strings), np.full(len(prior), 1.0 / len(prior))
    found = {}
    for i, name in enumerate(box.names):
        low, high = weighted_quantiles(mine[:, i], drawn.weights, CENTRAL)
        least, most = weighted_quantiles(prior[:, i], equal, CENTRAL)
        found[name] = (high - low) / (most - least)
    return found


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
    def around(
        cls,
        points: Floats,
        weights: Floats | None = None,
        relative: float = PART_MARGIN,
        least: float = 0.0,
    ) -> Self:
        """Return the part along the principal axes of points that has all of them.

        Parameters
        ----------
        points
            In units of the search box, shape (n, d).
        weights
            Weights of the points in these axes, shape (n,); by default all are equal.
        relative, least
            Margin relative to the edges of the part, and what is added to it.
        """
        _, axes = np.linalg.eigh(np.atleast_2d(np.cov(points.T, aweights=weights)))
        along = points @ axes
        low, high = along.min(axis=0), along.max(axis=0)
        margin = relative * (high - low) + least
        return cls(axes, low - margin, high + margin)

    @property
    def volume(self) -> float:
        """Volume, also of what is outside of the search box, relative to the search box."""
        return float(np.prod(self.upper - self.lower))

    def even_strings(self, box: SearchedBox, count: int) -> Floats:
        """Return those of `count` even points of the part that the box allows, (n, k) in SI."""
        from scipy.stats import qmc

        even = qmc.Sobol(len(self.axes), seed=box.campaign.seed).random(count)
        _, strings = box.of_units((self.lower + even * (self.upper - self.lower)) @ self.axes.T)
        return strings


def sample_posterior(
    of: Sampled, strings: Floats, logarithms: Floats, prior: int
) -> WeightedStrings:
    """Return strings that stand for the posterior.

    Parameters
    ----------
    of
        What was measured; the prior is uniform over its box.
    strings, logarithms
        Those of the first points of the prior that may have weight, shape (n, k), with their
        log-densities, (n,).
    prior
        Number of all first points: the allowed ones of `PRIOR_POINTS` even points of the box.
    """
    box, count, total = of.box, PRIOR_POINTS, float(prior)
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
        strings = of.near(some)
        logarithms = of.log_density(strings)
    if size < MIN_SIZE and (chain := _chain(of, strings, weights)) is not None:
        return chain
    region = float(region_volumes(weights[None], 1.0 / total)[0])
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


def log_density_within(of: Sampled, points: Floats) -> Floats:
    """Return the log-density at points in units of the box, (n, d); −inf where it allows none."""
    found = np.full(len(points), -np.inf)
    places, strings = of.box.of_units(points)
    found[places] = of.log_density(strings)
    return found


def _chain(of: Sampled, strings: Floats, weights: Floats) -> WeightedStrings | None:
    """Return a posterior by an ensemble of Markov chains; None without the library emcee."""
    try:
        import emcee
    except ImportError:
        return None
    box, space, d = of.box, of.box.space, len(of.box.names)
    walkers = max(MIN_WALKERS, WALKERS_PER_VARIABLE * d)
    random = np.random.default_rng(box.campaign.seed)
    chosen = random.choice(len(weights), walkers, p=weights / weights.sum())
    starts = space.to_unit(strings[chosen]) + 1e-4 * random.normal(size=(walkers, d))
    log_density = partial(log_density_within, of)
    sampler = emcee.EnsembleSampler(walkers, d, log_density, vectorize=True)
    sampler.run_mcmc(np.clip(starts, 1e-6, 1.0 - 1e-6), CHAIN_STEPS)
    drawn = sampler.get_chain(discard=CHAIN_STEPS // 3, flat=True)
    densities = sampler.get_log_prob(discard=CHAIN_STEPS // 3, flat=True)
    time = float(np.max(sampler.get_autocorr_time(quiet=True, tol=0)))
    size, equal = len(drawn) / time, np.full(len(drawn), 1.0 / len(drawn))
    least = float(np.quantile(densities, 1.0 - REGION_WEIGHT))
    # The share of what is allowed of the box with a log-density of `least` or more.
    part = BoxPart.around(drawn)
    near = of.near(part.even_strings(box, REGION_POINTS))
    count = float(np.sum(of.log_density(near) >= least))
    allowed = len(box.allowed_even_strings(REGION_POINTS)) / REGION_POINTS or 1.0
    region = count / REGION_POINTS * part.volume / allowed
    return WeightedStrings(space.from_unit(drawn), equal, size, "chain", walkers, region)
