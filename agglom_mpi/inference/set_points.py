"""Points of the box that measure a feasible set, and strings drawn from the set."""

from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.config.allowed_share import allowed_share

if TYPE_CHECKING:
    from agglom_mpi.inference.feasible_set import FeasibleSet

Floats = NDArray[np.float64]

POINTS: Final = 1 << 13
"""Points of the box."""
SUFFICIENT: Final = 300.0
"""Expected members among the points above which the box is not narrowed further."""
NARROWER: Final = 6
"""Maximum number of times that the box is narrowed."""
POSSIBLE: Final = 1e-3
"""Minimum probability of a point that the narrower box must contain."""
MARGIN: Final = 0.1
"""Relative margin added to the narrower box."""
STARTS: Final = 8
"""Strings from which the best emulated mean is searched."""
CANDIDATES: Final = 256
"""Strings of the campaign at which it may be, too."""
FARTHEST: Final = 1e30
"""Distance that stands for one that is infinite or unknown."""
MOST_DRAWS: Final = 1 << 22
"""Maximum number of points that are drawn to find members."""
FEWEST_EVEN: Final = 512
"""Minimum number of allowed even points; below it, allowed points are drawn at random."""
MOST_RANDOM: Final = 1 << 17
"""Maximum number of points that are drawn at random."""


class SetPoints(NamedTuple):
    """Points that fill the box, or the narrower box around a small set.

    Attributes
    ----------
    strings
        Shape (n, 10).
    probability
        That of each to be a member, shape (n,).
    weights
        Share of what is allowed of the box that each stands for, shape (n,).
    allowed
        Share of the box that the constraints allow.
    lower, upper
        The box that they fill, in units of the search box, shape (d,).
    """

    strings: Floats
    probability: Floats
    weights: Floats
    allowed: float
    lower: Floats
    upper: Floats

    def draw(self, of: "FeasibleSet", count: int, random: np.random.Generator) -> Floats:
        """Draw strings from the set, (count, 10): each point is kept with its probability."""
        found, drawn = np.empty((0, self.strings.shape[1])), 0
        space = of.campaign.space()
        whole = bool(np.all(self.lower == 0.0) and np.all(self.upper == 1.0))
        rare = whole and self.allowed * POINTS < FEWEST_EVEN
        while len(found) < count and drawn < (MOST_RANDOM if rare else MOST_DRAWS):
            if rare:
                points = space.sample_points(random, POINTS)
            else:
                within_box = random.random((POINTS, len(self.lower)))
                points = self.lower + within_box * (self.upper - self.lower)
            strings = space.from_unit(points)
            kept = random.random(POINTS) < of.probability_of(strings)
            found = np.vstack((found, strings[kept]))
            drawn += POINTS
        if len(found) < count:
            raise RuntimeError(f"{len(found)} of {drawn:,} points are in the set; {count} wanted")
        return found[:count]


def spread_points(of: "FeasibleSet", evaluated: Floats) -> SetPoints:
    """Return points over the box, narrowed down around the set where that is small.

    Parameters
    ----------
    of
        The set.
    evaluated
        Strings of the campaign, (n, 10), which may be members that no point is near.
    """
    space = of.campaign.variables.space()
    lower, upper = np.zeros(space.dimensions), np.ones(space.dimensions)
    units = space.to_unit(np.unique(np.nan_to_num(evaluated), axis=0))
    strings = _even(of, POINTS, lower, upper)
    allowed = len(strings) / POINTS
    if len(strings) < FEWEST_EVEN:
        strings, allowed = within(of, POINTS), allowed_share(of.campaign).value
    probability = of.probability_of(strings)
    weights = np.full(len(strings), 1.0 / max(len(strings), 1))
    own = of.probability_of(space.from_unit(units))
    for _ in range(NARROWER):
        if probability.sum() >= SUFFICIENT:
            break
        possible = np.vstack(
            (space.to_unit(strings)[probability > POSSIBLE], units[own > 10 * POSSIBLE])
        )
        if not len(possible):
            break
        margin = MARGIN * (possible.max(axis=0) - possible.min(axis=0)) + 1e-3
        low = np.maximum(lower, possible.min(axis=0) - margin)
        high = np.minimum(upper, possible.max(axis=0) + margin)
        if np.prod((high - low) / (upper - lower)) > 0.7:
            break
        even = _even(of, POINTS, low, high)
        if len(even) < FEWEST_EVEN:
            break
        lower, upper, strings = low, high, even
        probability = of.probability_of(strings)
        weights = np.full(len(strings), np.prod(upper - lower) / POINTS / allowed)
    return SetPoints(strings, probability, weights, allowed, lower, upper)


def within(
    of: "FeasibleSet", count: int = POINTS, lower: Floats | float = 0.0, upper: Floats | float = 1.0
) -> Floats:
    """Return the allowed strings of even points of the box, or of a part of it, (n, 10).

    Where the constraints leave too few of the whole box, they are random and allowed strings.
    """
    strings = _even(of, count, lower, upper)
    part = np.any(np.asarray(lower) > 0.0) or np.any(np.asarray(upper) < 1.0)
    if part or len(strings) >= min(FEWEST_EVEN, count) or not of.campaign.relations.constraints:
        return strings
    space, random = of.campaign.space(), np.random.default_rng(of.campaign.seed)
    return space.from_unit(space.sample_points(random, min(count, MOST_RANDOM)))


def _even(of: "FeasibleSet", count: int, lower: Floats | float, upper: Floats | float) -> Floats:
    """Return the allowed ones of `count` even points, arguments as for `within`."""
    from scipy.stats import qmc

    space = of.campaign.variables.space()
    points = qmc.Sobol(space.dimensions, seed=of.campaign.seed).random(count)
    strings = space.from_unit(lower + points * (upper - lower))
    return strings[of.campaign.allowed_strings(strings)]


def near_best(of: "FeasibleSet", evaluated: Floats) -> Floats:
    """Return allowed strings, (n, 10), at which the emulated mean may be nearest to members.

    Those of a maximum are where the mean may be largest.
    """
    from scipy.optimize import minimize

    space, coordinates = of.campaign.variables.space(), of.coordinates
    known = np.unique(np.nan_to_num(evaluated), axis=0)
    known = space.from_unit(space.to_unit(known))
    pool = np.vstack((known, within(of)))

    def distances(strings: Floats) -> Floats:
        compared = of.emulator.mean_only(coordinates.of_strings(strings))
        return np.nan_to_num(of.criterion.distance(compared), nan=FARTHEST, posinf=FARTHEST)

    best = pool[np.argsort(distances(pool))[:CANDIDATES]]

    def distance(point: Floats) -> float:
        return float(distances(coordinates.strings(np.clip(point, 0.0, 1.0)[None]))[0])

    starts = coordinates.own(best[:STARTS])
    bounds = [(0.0, 1.0)] * starts.shape[1]
    options = {"maxiter": 30}
    ends = [
        minimize(distance, at, bounds=bounds, method="L-BFGS-B", options=options) for at in starts
    ]
    found = np.vstack((best, coordinates.strings(np.array([np.clip(e.x, 0, 1) for e in ends]))))
    return found[of.campaign.allowed_strings(found)]
