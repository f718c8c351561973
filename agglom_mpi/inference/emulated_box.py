"""The search box of a campaign with an emulator of numbers of its samples."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from agglom_mpi.config.coordinates import Coordinates, coordinates_of
from agglom_mpi.emulation.emulator import Emulator, merge_samples
from agglom_mpi.emulation.gaussian_process import Floats
from agglom_mpi.emulation.joint_emulator import JointEmulator
from agglom_mpi.inference.searched_box import SearchedBox
from agglom_mpi.inference.stored_samples import StoredSamples
from agglom_mpi.random_streams import search_stream

EMULATOR_STREAM, FAILURE_STREAM = range(2)
"""Random streams of an emulated box; those that follow from it have further ones."""


class EmulatedStrings(NamedTuple):
    """An emulator with its strings: means, failures and coordinates.

    Attributes
    ----------
    means, deviations
        Of k numbers whose errors are independent, shape (n, k) each.
    failing
        Probability that samples fail, shape (n,).
    """

    means: Floats
    deviations: Floats
    failing: Floats


class EmulatedBox:
    """The search box of a campaign with an emulator of numbers of its samples.

    Parameters
    ----------
    box
        The search box.
    strings
        Parameters of each sample, shape (n, k).
    numbers
        Its numbers, shape (n, q).
    stored
        The samples, for the strings that failed.
    purpose
        Key of its random streams, such as `random_streams.FEASIBLE_SET`.
    quantities
        Returns what is compared, of the means of the numbers; by default the numbers.

    Attributes
    ----------
    box : SearchedBox
    coordinates : Coordinates
        Coordinates of the emulator.
    evaluated : ndarray
        Parameters of each sample, shape (n, k).
    points : ndarray
        Coordinates of each sample, shape (n, c).
    emulator : JointEmulator
        Emulator of the numbers.
    failing_strings : int
        Number of strings that failed.
    """

    def __init__(
        self,
        box: SearchedBox,
        strings: Floats,
        numbers: Floats,
        stored: StoredSamples,
        purpose: int,
        quantities: Callable[[Floats], Floats] = lambda numbers: numbers,
    ) -> None:
        self.box, self.evaluated, self._purpose = box, strings, purpose
        self.coordinates: Coordinates = coordinates_of(box.campaign)
        self.points = self.coordinates.of_strings(strings)
        groups, random = len(self.coordinates.groups), self.stream(EMULATOR_STREAM)
        self.emulator = JointEmulator(quantities, self.points, numbers, random, groups)
        self.failing_strings = int(stored.failed.sum())
        self._failing: Emulator | None = None
        if self.failing_strings:  # a regression of the failures
            tried = self.coordinates.of_strings(stored.tried)
            failures = merge_samples(tried, stored.failed.astype(np.float64))
            self._failing = Emulator(failures, self.stream(FAILURE_STREAM), groups, rounds=0)

    def stream(self, number: int) -> np.random.Generator:
        """Return a random stream of the campaign, such as `EMULATOR_STREAM`."""
        return search_stream(self.box.campaign.seed, self._purpose, number)

    def at(self, strings: Floats) -> EmulatedStrings:
        """Return what is known of the mixed numbers of strings, (n, k) in SI units."""
        points = self.coordinates.of_strings(strings)
        return EmulatedStrings(*self.emulator.mixed(points), self.failing(points))

    def failing(self, points: Floats) -> Floats:
        """Return the probability that samples at points, (n, c), fail, shape (n,)."""
        if self._failing is None:
            return np.zeros(len(points))
        return np.clip(self._failing.mean(points), 0.0, 1.0)
