"""Points of the box that measure a feasible set, and members drawn from it."""

from typing import Final, NamedTuple

import numpy as np

from agglom_mpi.config.allowed_share import allowed_share
from agglom_mpi.emulation.gaussian_process import Floats
from agglom_mpi.inference.emulated_set import BOX_POINTS, EmulatedSet
from agglom_mpi.inference.searched_box import MAX_RANDOM_POINTS, MIN_EVEN_POINTS

INNER_PROBABILITY, OUTER_PROBABILITY = 0.95, 0.05
"""Minimum probability of the members of the inner and of the outer set."""
SUFFICIENT_MEMBERS: Final = 300.0
"""Stop shrinking the sampling box once this many members are expected in it."""
MAX_SHRINKINGS: Final = 6
"""Maximum number of times that the sampling box is shrunk."""
MIN_POINT_PROBABILITY: Final = 1e-3
"""Minimum probability of a point that the shrunken box must contain."""
MIN_SAMPLE_PROBABILITY: Final = 10 * MIN_POINT_PROBABILITY
"""Minimum probability of a string of the campaign that the shrunken box must contain."""
BOX_MARGIN: Final = 0.1
"""Relative margin added to the shrunken box."""
SUFFICIENT_SHRINKING: Final = 0.7
"""Maximum volume of a shrunken box relative to the one before it, for it to be used."""
MAX_DRAWS: Final = 1 << 22
"""Maximum number of points that are drawn to find members."""


class SetPoints(NamedTuple):
    """Points that fill the box, or the smaller box around a small set.

    Attributes
    ----------
    strings
        Shape (n, k).
    probability
        Probability of each to be a member, shape (n,).
    weights
        Share of the allowed part of the box that each stands for, shape (n,).
    allowed
        Share of the box that the constraints allow.
    lower, upper
        Bounds of the box that they fill, in units of the search box, shape (d,).
    """

    strings: Floats
    probability: Floats
    weights: Floats
    allowed: float
    lower: Floats
    upper: Floats

    @property
    def mass(self) -> Floats:
        """Expected share of the allowed part of the box that is in the set, of each, (n,)."""
        return self.probability * self.weights

    @property
    def volume(self) -> float:
        """Expected share of the allowed part of the box that is in the set."""
        return float(self.probability @ self.weights)

    def share(self, least: float) -> float:
        """Return the share of the allowed part whose probability is at least this."""
        return float((self.probability >= least) @ self.weights)

    def draw(self, emulated: EmulatedSet, count: int, random: np.random.Generator) -> Floats:
        """Draw strings from the set, (count, k): each point is kept with its probability.

        Raises
        ------
        RuntimeError
            If too few points are members.
        """
        found, drawn = np.empty((0, self.strings.shape[1])), 0
        space = emulated.box.campaign.space()
        whole = bool(np.all(self.lower == 0.0) and np.all(self.upper == 1.0))
        rare = whole and self.allowed * BOX_POINTS < MIN_EVEN_POINTS
        while len(found) < count and drawn < (MAX_RANDOM_POINTS if rare else MAX_DRAWS):
            if rare:
                points = space.sample_points(random, BOX_POINTS)
            else:
                within_box = random.random((BOX_POINTS, len(self.lower)))
                points = self.lower + within_box * (self.upper - self.lower)
            strings = space.from_unit(points)
            kept = random.random(BOX_POINTS) < emulated.probability(strings)
            found = np.vstack((found, strings[kept]))
            drawn += BOX_POINTS
        if len(found) < count:
            raise RuntimeError(f"{len(found)} of {drawn:,} points are in the set; {count} wanted")
        return found[:count]

    def even_members(self, count: int) -> Floats:
        """Return strings of the points, (count, k), evenly over their mass."""
        places = (np.arange(count) + 0.5) / count
        chosen = np.searchsorted(np.cumsum(self.mass) / self.mass.sum(), places)
        return self.strings[np.minimum(chosen, len(self.strings) - 1)]


def spread_points(emulated: EmulatedSet) -> SetPoints:
    """Return points over the box, or over a smaller box around the set where the set is small."""
    box, space = emulated.box, emulated.box.space
    lower, upper = np.zeros(space.dimensions), np.ones(space.dimensions)
    strings = box.allowed_even_strings(BOX_POINTS)
    allowed = len(strings) / BOX_POINTS
    if len(strings) < MIN_EVEN_POINTS:
        strings, allowed = box.even_strings(BOX_POINTS), allowed_share(box.campaign).value
    probability = emulated.probability(strings)
    weights = np.full(len(strings), 1.0 / max(len(strings), 1))
    # Strings of the campaign may be members that no point is near.
    units = space.to_unit(np.unique(np.nan_to_num(emulated.evaluated), axis=0))
    own = emulated.probability(space.from_unit(units))
    for _ in range(MAX_SHRINKINGS):
        if probability.sum() >= SUFFICIENT_MEMBERS:
            break
        possible = np.vstack(
            (
                space.to_unit(strings)[probability > MIN_POINT_PROBABILITY],
                units[own > MIN_SAMPLE_PROBABILITY],
            )
        )
        if not len(possible):
            break
        margin = BOX_MARGIN * (possible.max(axis=0) - possible.min(axis=0)) + 1e-3
        low = np.maximum(lower, possible.min(axis=0) - margin)
        high = np.minimum(upper, possible.max(axis=0) + margin)
        if np.prod((high - low) / (upper - lower)) > SUFFICIENT_SHRINKING:
            break
        even = box.allowed_even_strings(BOX_POINTS, low, high)
        if len(even) < MIN_EVEN_POINTS:
            break
        lower, upper, strings = low, high, even
        probability = emulated.probability(strings)
        weights = np.full(len(strings), np.prod(upper - lower) / BOX_POINTS / allowed)
    return SetPoints(strings, probability, weights, allowed, lower, upper)
