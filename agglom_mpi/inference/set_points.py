"""Points of the box that measure a feasible set, its members, and the string nearest to them."""

from collections.abc import Callable
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.config.searchable import allowed_share
from agglom_mpi.formatting import in_unit, value_with_error
from agglom_mpi.inference.emulated_set import BOX_POINTS, EmulatedSet
from agglom_mpi.inference.searched_box import MAX_RANDOM_POINTS, MIN_EVEN_POINTS
from agglom_mpi.statistics import Floats

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


MAX_FAILING: Final = 0.5
"""Maximum probability of failure of the nearest string."""
MIN_AWAY_OUT_OF_REACH: Final = 1.645
"""Minimum distance, in standard deviations, of a mean that is out of reach at 95 %."""
MIN_DEVIATION: Final = 1e-300
"""Divisor in place of a standard deviation of 0."""
END_WIDTH: Final = 1e-3
"""Maximum distance from the end of a range, in units of the range, of a string at the end."""
QUANTITY_NAMES: Final = {"mean_radius_ratio": "mean b/b0", "objective": "value of the function"}
"""Names of compared quantities for a person, where the name of the column is not one."""


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

    def draw(
        self,
        emulated: EmulatedSet,
        count: int,
        random: np.random.Generator,
        part: Callable[[Floats], NDArray[np.bool_]] | None = None,
    ) -> Floats:
        """Draw strings from the set, (count, k): each point is kept with its probability.

        Parameters
        ----------
        emulated
        count
        random
        part
            Returns which strings, (n, k), are kept instead.

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
            if part is None:
                kept = random.random(BOX_POINTS) < emulated.probability(strings)
            else:
                kept = part(strings)
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


class NearestString(NamedTuple):
    """The string of the box whose emulated mean is nearest to the means of members.

    Attributes
    ----------
    parameters
        Searched variables by the campaign's names, in SI units.
    units
        Their units.
    ends
        End of the range, `lower` or `upper`, of each variable that is at one.
    probability
        Probability that the string is a member.
    mean, deviation
        Emulated mean of each quantity that is compared, by name, and its standard deviation.
    away
        Largest distance of a mean from the bounds, in these deviations; 0 within the bounds.
    """

    parameters: dict[str, float]
    units: dict[str, str]
    ends: dict[str, str]
    probability: float
    mean: dict[str, float]
    deviation: dict[str, float]
    away: float

    @property
    def out_of_reach(self) -> bool:
        """Whether the string is surely no member; otherwise the emulator is too uncertain."""
        return self.away > MIN_AWAY_OUT_OF_REACH

    @property
    def reached(self) -> str:
        """The emulated means as text: `mean b/b0 4.52 ± 0.12`."""
        return ", ".join(
            f"{quantity_name(name)} {value_with_error(mean, self.deviation[name])}"
            for name, mean in self.mean.items()
        )

    def __str__(self) -> str:
        values = (
            in_unit(f"{name} {value:.4g}", self.units[name])
            for name, value in self.parameters.items()
        )
        return f"{self.reached} at {', '.join(values)}"

    def as_dict(self) -> dict[str, Any]:
        """Return it as plain values."""
        return self._asdict()


def quantity_name(name: str) -> str:
    """Return the name of a compared quantity for a person."""
    return QUANTITY_NAMES.get(name, name)


def nearest_string(emulated: EmulatedSet) -> NearestString:
    """Return the string of the box that comes nearest to the members of a set."""
    candidates = emulated.near_best()
    points = emulated.coordinates.of_strings(candidates)
    alive = emulated.failing(points) <= MAX_FAILING
    candidates = candidates[alive] if alive.any() else candidates
    distances = emulated.criterion.distance(emulated.mean_only(candidates))
    string = candidates[[int(np.argmin(distances))]]
    mean, deviation = emulated.mean(string)[0], emulated.deviation(string)[0]
    box, quantities = emulated.box, emulated.criterion.quantities
    units = box.space.to_unit(string)[0]
    ends = {"lower": units <= END_WIDTH, "upper": units >= 1.0 - END_WIDTH}
    lower, upper = np.array(emulated.criterion.bands()).T
    beyond = np.maximum(np.maximum(lower - mean, mean - upper), 0.0)
    away = beyond / np.maximum(deviation, MIN_DEVIATION)
    return NearestString(
        {each.name: float(each.values(string)[0]) for each in box.own},
        {each.name: each.unit for each in box.own},
        {n: end for i, n in enumerate(box.names) for end, at in ends.items() if at[i]},
        float(emulated.probability(string)[0]),
        dict(zip(quantities, mean.tolist(), strict=True)),
        dict(zip(quantities, deviation.tolist(), strict=True)),
        float(np.nan_to_num(away, nan=np.inf).max()),
    )
