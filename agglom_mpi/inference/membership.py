"""Probability that a string is a member of the set, by an emulator of the campaign's samples."""

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.config.coordinates import coordinates_of
from agglom_mpi.emulation.emulator import Emulator, merge_samples
from agglom_mpi.emulation.gaussian_process import Floats
from agglom_mpi.emulation.joint_emulator import JointEmulator
from agglom_mpi.formatting import ROUNDING
from agglom_mpi.inference.searched_box import SearchedBox
from agglom_mpi.inference.stored_samples import StoredSamples
from agglom_mpi.random_streams import FEASIBLE_SET, search_stream
from agglom_mpi.search.criteria import Criterion

BOX_POINTS: Final = 1 << 13
"""Number of even points of the box."""
SEARCH_STARTS: Final = 8
"""Number of strings at which the search for the best emulated mean starts."""
BEST_CANDIDATES: Final = 256
"""Number of strings of the campaign and of the box that are candidates, too."""
MAX_DISTANCE: Final = 1e30
"""Distance in place of one that is infinite or unknown."""

EMULATOR_STREAM, FAILURE_STREAM, MAXIMUM_STREAM, VOLUME_STREAM = range(4)
"""Random streams of a set."""


class KnownStrings(NamedTuple):
    """Strings with the one quantity that is compared.

    Attributes
    ----------
    strings
        Shape (n, k).
    mean, deviation
        Emulated mean and its standard deviation, shape (n,).
    failing
        Probability that samples fail, shape (n,).
    """

    strings: Floats
    mean: Floats
    deviation: Floats
    failing: Floats


class FailingShare:
    """Probability of failure, by a regression of which strings failed.

    Parameters
    ----------
    points
        Coordinates of all strings, shape (n, p).
    failed
        Which of them failed, shape (n,).
    random
        Stream of the subsets that covariances are fitted to.
    groups
        Number of coordinates, the last ones, that are groups of variables.

    Attributes
    ----------
    count : int
        Number of strings that failed.
    """

    def __init__(
        self,
        points: Floats,
        failed: NDArray[np.bool_],
        random: np.random.Generator,
        groups: int = 0,
    ) -> None:
        self.count = int(failed.sum())
        self._process = (
            Emulator(merge_samples(points, failed.astype(np.float64)), random, groups, rounds=0)
            if self.count
            else None
        )

    def at(self, points: Floats) -> Floats:
        """Return the probability at points, (m, p), shape (m,)."""
        if self._process is None:
            return np.zeros(len(points))
        return np.clip(self._process.mean(points), 0.0, 1.0)


class EmulatedBox:
    """The search box of a campaign with an emulator of all its samples.

    Parameters
    ----------
    box
        The search box.
    criterion
        What makes a string a member of the set.
    stored
        The samples.

    Attributes
    ----------
    box : SearchedBox
    coordinates : Coordinates
        Coordinates of the emulator.
    evaluated : ndarray
        Parameters of each completed sample, shape (n, k).
    emulator : JointEmulator
        Emulator of the numbers of the criterion.
    criterion : Criterion
        The criterion, with what it takes from the emulator.
    failing : FailingShare
    """

    def __init__(self, box: SearchedBox, criterion: Criterion, stored: StoredSamples) -> None:
        self.box = box
        self.coordinates = coordinates_of(box.campaign)
        self.evaluated = stored.strings
        groups = len(self.coordinates.groups)
        self.emulator = JointEmulator(
            criterion.compared,
            self.coordinates.of_strings(stored.strings),
            settled_numbers(criterion.numbers(stored.rows, box.campaign.scene.particles)),
            self.stream(EMULATOR_STREAM),
            groups,
        )
        tried = self.coordinates.of_strings(stored.tried)
        self.failing = FailingShare(tried, stored.failed, self.stream(FAILURE_STREAM), groups)
        self.criterion = criterion
        self.criterion = criterion.with_emulator(
            self.emulator,
            lambda: self.coordinates.of_strings(self.near_best()),
            self.stream(MAXIMUM_STREAM),
        )
        self._known: dict[int, KnownStrings] = {}

    def stream(self, purpose: int) -> np.random.Generator:
        """Return a random stream of the campaign for one of the purposes above."""
        return search_stream(self.box.campaign.seed, FEASIBLE_SET, purpose)

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

    def noise(self, strings: Floats) -> Floats:
        """Return the standard deviations of the numbers of one sample at strings, shape (n, k)."""
        return self.emulator.noise(self.coordinates.of_strings(strings))

    def known(self, strings: Floats) -> KnownStrings:
        """Return strings, (n, k), with the one quantity that is compared."""
        points = self.coordinates.of_strings(strings)
        mean, deviation = self.emulator.mean(points)[:, 0], self.emulator.deviation(points)[:, 0]
        return KnownStrings(strings, mean, deviation, self.failing.at(points))

    def known_box(self, count: int) -> KnownStrings:
        """Return the allowed ones of `count` even points of the box, with what is known there."""
        if count not in self._known:
            self._known[count] = self.known(self.box.even_strings(count))
        return self._known[count]

    def probability(self, strings: Floats) -> Floats:
        """Return the probability that strings, (n, k), are members, (n,); nan outside the box."""
        found = np.full(len(strings), np.nan)
        inside = self.box.inside(strings)
        found[inside] = self._probability_inside(strings[inside])
        return found

    def _probability_inside(self, strings: Floats) -> Floats:
        if not len(strings):
            return np.empty(0)
        points = self.coordinates.of_strings(strings)
        found = self.criterion.probability(self.emulator, points)
        found = found * (1.0 - self.failing.at(points))
        if self.box.campaign.relations.constraints:
            found = np.where(self.box.allowed(strings), found, 0.0)
        return np.asarray(found)

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
