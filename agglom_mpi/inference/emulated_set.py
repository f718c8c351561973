"""Probability that a string is a member of the set, by an emulator of the campaign's samples."""

from collections.abc import Callable, Mapping
from functools import cached_property
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from agglom_mpi.config.arguments import mistaken_argument
from agglom_mpi.config.plan import read_tolerance
from agglom_mpi.formatting import ROUNDING
from agglom_mpi.inference.posterior_sampling import PRIOR_POINTS
from agglom_mpi.inference.searched_box import EmulatedBox, EmulatedStrings, SearchedBox
from agglom_mpi.inference.stored_samples import StoredSamples
from agglom_mpi.random_streams import FEASIBLE_SET
from agglom_mpi.search.criteria import Criterion
from agglom_mpi.search.membership import extreme_numbers
from agglom_mpi.statistics import Floats
from agglom_mpi.storage.recorded_campaign import recorded_objective

if TYPE_CHECKING:
    from agglom_mpi.storage.reader import CampaignData

DEVIATIONS: Final = 16
"""Number of deviations of a string that its probability is averaged over."""
BOX_POINTS: Final = 1 << 13
"""Number of even points of the box."""
SEARCH_STARTS: Final = 8
"""Number of strings at which the search for the best emulated mean starts."""
BEST_CANDIDATES: Final = 256
"""Number of strings of the campaign and of the box that are candidates, too."""
MAX_DISTANCE: Final = 1e30
"""Distance in place of one that is infinite or unknown."""
MAXIMUM_STREAM, VOLUME_STREAM = 2, 3
"""Further random streams of a set."""


def even_places(count: int) -> Floats:
    """Return deviations of `count` variables, (`DEVIATIONS`, count), evenly from -1 to 1."""
    from scipy.stats import qmc

    points = qmc.Sobol(count, scramble=False).random(DEVIATIONS)
    return np.asarray(2.0 * points + 1.0 / DEVIATIONS - 1.0)  # in the middle of their intervals


def mean_over_deviations(function: Callable[[Floats], Any], count: int) -> Any:
    """Return the mean of a function of deviations, (count,), over `DEVIATIONS` even ones."""
    return np.mean([function(place) for place in even_places(count)], axis=0)


class Wobble:
    """Values of the variables of strings that deviate evenly by up to a share of themselves.

    The emulator is known in the box alone, so a deviation that would leave the box ends at its
    edge, both in probabilities and in strings that are judged. Near an edge, that edge therefore
    counts more often than any one value inside. Deviations may break the constraints; they are then
    no members.

    Parameters
    ----------
    box
    robust
        By name, the largest relative deviation of a variable; none where nothing deviates.
    """

    def __init__(self, box: SearchedBox, robust: Mapping[str, float]) -> None:
        self._space = box.space
        named = {variable.name: variable for variable in box.own}
        self._wobbling = [(named[name], share) for name, share in robust.items()]

    def __bool__(self) -> bool:
        return bool(self._wobbling)

    def wobbled(self, strings: Floats, places: Floats) -> Floats:
        """Return strings, (n, k), with values at places from -1 to 1, (n, w) or (w,).

        A value that would leave the box is at its edge.
        """
        found = strings.copy()
        for i, (variable, share) in enumerate(self._wobbling):
            factors = 1.0 + share * np.asarray(places)[..., i]
            found[:, variable.column] *= factors ** (1.0 / variable.power)
        return np.asarray(self._space.clip(found))

    def drawn(self, strings: Floats, random: np.random.Generator) -> Floats:
        """Return strings, (n, k), each with drawn values."""
        shape = len(strings), len(self._wobbling)
        return self.wobbled(strings, random.uniform(-1.0, 1.0, shape)) if shape[1] else strings

    def mean(self, function: Callable[[Floats], Any], strings: Floats) -> Any:
        """Return the mean of a function of strings, (n, k), over their deviations."""
        if not self._wobbling:
            return function(strings)
        count = len(self._wobbling)
        return mean_over_deviations(lambda place: function(self.wobbled(strings, place)), count)


class EmulatedSet(EmulatedBox):
    """The search box of a campaign with an emulator of what its objective compares.

    Parameters
    ----------
    box
        The search box.
    criterion
        What makes a string a member of the set.
    stored
        The samples.
    robust
        By name, the largest relative deviation of a variable that probabilities are averaged over.

    Attributes
    ----------
    wobble : Wobble
        The deviations.
    criterion : Criterion
        The criterion, with what it takes from the emulator.
    extremes : ndarray, shape (m, k)
        Numbers of the samples that are extreme among all.
    """

    def __init__(
        self,
        box: SearchedBox,
        criterion: Criterion,
        stored: StoredSamples,
        robust: Mapping[str, float],
    ) -> None:
        self.wobble = Wobble(box, robust)
        numbers = settled_numbers(criterion.numbers(stored.rows, box.campaign.scene.particles))
        given = box, stored.strings, numbers, stored, FEASIBLE_SET
        super().__init__(*given, criterion.compared, criterion.of_ratios)
        self.extremes = extreme_numbers(numbers)
        self.criterion = criterion
        self.criterion = criterion.with_emulator(
            self.emulator,
            lambda: self.coordinates.of_strings(self.near_best()),
            self.stream(MAXIMUM_STREAM),
        )

    @property
    def spans(self) -> Floats:
        """Change of the logarithm of each searched variable along its coordinate, (d,)."""
        return self.coordinates.spans * [variable.power for variable in self.box.own]

    def mean(self, strings: Floats) -> Floats:
        """Return the expected quantities at strings, (n, k), shape (n, q)."""
        return self.emulator.mean(self.coordinates.of_strings(strings))

    def deviation(self, strings: Floats) -> Floats:
        """Return the standard deviations of the quantities at strings, (n, k), shape (n, q)."""
        return self.emulator.deviation(self.coordinates.of_strings(strings))

    def mean_only(self, strings: Floats) -> Floats:
        """Return the quantities of the expected numbers at strings, (n, k), shape (n, q)."""
        return self.emulator.mean_only(self.coordinates.of_strings(strings))

    def at(self, strings: Floats) -> EmulatedStrings:
        """Return what is known of the quantities of strings, (n, k) in SI units."""
        failing = self.failing(self.coordinates.of_strings(strings))
        return EmulatedStrings(self.mean(strings), self.deviation(strings), failing)

    @cached_property
    def prior(self) -> tuple[Floats, EmulatedStrings]:
        """Allowed even points of the box, with what is known there: the prior of any mean."""
        strings = self.box.even_strings(PRIOR_POINTS)
        return strings, self.at(strings)

    def probability(self, strings: Floats) -> Floats:
        """Return the probability that strings, (n, k), are members, (n,); nan outside the box.

        It is the mean over their deviations; a string that the constraints forbid is no member.
        """
        found, inside = np.full(len(strings), np.nan), self.box.inside(strings)
        if inside.any():
            members = self.wobble.mean(self._members, strings[inside])
            if self.wobble:
                members = np.where(self.box.allowed(strings[inside]), members, 0.0)
            found[inside] = members
        return found

    def _members(self, strings: Floats) -> Floats:
        """Return the probability of strings as they are."""
        points = self.coordinates.of_strings(strings)
        members = self.criterion.probability(self.emulator, points)
        members = members * (1.0 - self.failing(points))
        if self.box.campaign.relations.constraints:
            members = np.where(self.box.allowed(strings), members, 0.0)
        return members

    def near_best(self) -> Floats:
        """Return allowed strings, (n, k), at which the emulated mean may be nearest to members.

        For the criterion of a maximum, these are strings where the mean may be largest.
        """
        from scipy.optimize import minimize

        space, coordinates = self.box.space, self.coordinates
        known = np.unique(np.nan_to_num(self.evaluated), axis=0)
        pool = np.vstack((space.from_unit(space.to_unit(known)), self.box.even_strings(BOX_POINTS)))
        best = pool[np.argsort(self._distances(pool))[:BEST_CANDIDATES]]

        def distance(point: Floats) -> float:
            string = coordinates.strings(np.clip(point, 0.0, 1.0)[None])
            return float(self._distances(string)[0])

        starts = coordinates.own(best[:SEARCH_STARTS])
        bounds = [(0.0, 1.0)] * starts.shape[1]
        options = {"maxiter": 30}
        ends = [
            minimize(distance, at, bounds=bounds, method="L-BFGS-B", options=options)
            for at in starts
        ]
        optima = coordinates.strings(np.array([np.clip(end.x, 0.0, 1.0) for end in ends]))
        found = np.vstack((best, optima))
        return found[self.box.allowed(found)]

    def _distances(self, strings: Floats) -> Floats:
        """Return the finite distances of strings, (n, k), from members, shape (n,)."""
        found = self.criterion.distance(self.mean_only(strings))
        return np.nan_to_num(found, nan=MAX_DISTANCE, posinf=MAX_DISTANCE)


def settled_numbers(numbers: Floats) -> Floats:
    """Return the numbers of samples, (n, k); one that differs by rounding alone is the same in all.

    To an emulator, which scales by the spread of its data, rounding would be all there is.
    """
    spread, size = np.ptp(numbers, axis=0), np.abs(numbers).max(axis=0)
    return np.where(spread <= ROUNDING * size, numbers[0], numbers)


def tolerance_of(data: "CampaignData", tolerance: float | str) -> float:
    """Return the tolerance of a file's objective; raise an ArgumentError if it is impossible."""
    objective = recorded_objective(data)
    try:
        return read_tolerance(objective, tolerance)
    except ValueError as error:
        raise mistaken_argument(data.path, "tolerance", error) from None
