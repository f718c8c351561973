"""The search box of a campaign: its variables, allowed strings, and an emulator of its samples."""

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.config.arguments import count_argument
from agglom_mpi.config.coordinates import Coordinates, coordinates_of
from agglom_mpi.config.given_strings import Parameters, read_searched
from agglom_mpi.config.yaml_source import ArgumentError
from agglom_mpi.emulation.emulator import Emulator, merge_samples
from agglom_mpi.emulation.joint_emulator import JointEmulator
from agglom_mpi.errors import require_library
from agglom_mpi.inference.stored_samples import StoredSamples
from agglom_mpi.random_streams import search_stream
from agglom_mpi.search.space import SearchSpace
from agglom_mpi.statistics import Floats
from agglom_mpi.variables import Variable

if TYPE_CHECKING:
    import pandas as pd

    from agglom_mpi.config.campaign import Campaign

MIN_EVEN_POINTS: Final = 512
"""Minimum number of allowed even points; below it, allowed points are drawn at random."""
MAX_RANDOM_POINTS: Final = 1 << 17
"""Maximum number of points that are drawn at random."""

EMULATOR_STREAM, FAILURE_STREAM = range(2)
"""Random streams of an emulated box; those that follow from it have further ones."""


class SearchedBox:
    """The search box of a campaign, with its variables as the campaign's file names them.

    Parameters
    ----------
    campaign

    Attributes
    ----------
    campaign : Campaign
    own : tuple of Variable
        The d searched variables by the names of the file.
    names : tuple of str
        Their names.
    space : SearchSpace
        The box without its constraints.
    """

    def __init__(self, campaign: "Campaign") -> None:
        self.campaign = campaign
        self.own: tuple[Variable, ...] = campaign.variables.own
        self.names = tuple(variable.name for variable in self.own)
        self.space: SearchSpace = SearchSpace.of(campaign.variables)

    def strings(self, parameters: Parameters) -> Floats:
        """Return strings, (n, k), given as for `FeasibleSet.probability`."""
        return read_searched(self.campaign, parameters)

    def inside(self, strings: Floats) -> NDArray[np.bool_]:
        """Return which strings, (n, k), lie in the box or are outside by rounding alone, (n,)."""
        box = self.campaign.variables
        some = np.flatnonzero(box.lower < box.upper)
        near = 1e-9 * (box.upper - box.lower)[some]
        x = strings[:, some]
        inside = (x >= box.lower[some] - near) & (x <= box.upper[some] + near)
        return np.asarray(inside.all(axis=1))

    def allowed(self, strings: Floats) -> NDArray[np.bool_]:
        """Return which strings, (n, k), the constraints allow, (n,)."""
        return self.campaign.allowed_strings(strings)

    def of_units(self, points: Floats) -> tuple[NDArray[np.int64], Floats]:
        """Return which points in units of the box, (n, d), are allowed and in it, (m,), in SI."""
        inside = np.flatnonzero(((points >= 0.0) & (points <= 1.0)).all(axis=1))
        strings = self.space.from_unit(points[inside])
        allowed = self.allowed(strings)
        return inside[allowed], strings[allowed]

    def allowed_even_strings(
        self, count: int, lower: Floats | float = 0.0, upper: Floats | float = 1.0
    ) -> Floats:
        """Return the allowed ones of `count` even points, (n, k).

        The points fill the box, or a part of it in units of the box, (d,).
        """
        from scipy.stats import qmc

        points = qmc.Sobol(self.space.dimensions, seed=self.campaign.seed).random(count)
        strings = self.space.from_unit(lower + points * (upper - lower))
        return strings[self.allowed(strings)]

    def even_strings(
        self, count: int, lower: Floats | float = 0.0, upper: Floats | float = 1.0
    ) -> Floats:
        """Return the same, or random ones where the constraints leave too few of the whole box."""
        strings = self.allowed_even_strings(count, lower, upper)
        part = np.any(np.asarray(lower) > 0.0) or np.any(np.asarray(upper) < 1.0)
        if (
            part
            or len(strings) >= min(MIN_EVEN_POINTS, count)
            or not self.campaign.relations.constraints
        ):
            return strings
        space, random = self.campaign.space(), np.random.default_rng(self.campaign.seed)
        return space.from_unit(space.sample_points(random, min(count, MAX_RANDOM_POINTS)))

    def table(self, strings: Floats, **columns: Floats) -> "pd.DataFrame":
        """Tabulate the searched variables of strings, (n, k), and more columns, (n,)."""
        require_library("pandas", "report", "tables")
        import pandas as pd

        frame = pd.DataFrame({v.name: v.values(strings) for v in self.own} | columns)
        units = {variable.name: variable.unit for variable in self.own}
        frame.attrs["units"] = units | dict.fromkeys(columns, "1")
        return frame

    def mistaken(self, field: str, message: object) -> ArgumentError:
        """Return the error about an argument."""
        return ArgumentError.of(self.campaign.name, field, message)

    def count(self, field: str, value: Any, least: int = 0) -> int:
        """Return a whole number that is an argument; raise an ArgumentError for anything else."""
        return count_argument(self.campaign.name, field, value, least)


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
    of_ratios
        Whether the numbers have no dimension.

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
    failures : Emulator or None
        Emulator of the failures, if there are any.
    """

    def __init__(
        self,
        box: SearchedBox,
        strings: Floats,
        numbers: Floats,
        stored: StoredSamples,
        purpose: int,
        quantities: Callable[[Floats], Floats] = lambda numbers: numbers,
        of_ratios: bool = False,
    ) -> None:
        self.box, self.evaluated, self._purpose = box, strings, purpose
        self.coordinates: Coordinates = coordinates_of(box.campaign, of_ratios)
        self.points = self.coordinates.of_strings(strings)
        groups, random = len(self.coordinates.groups), self.stream(EMULATOR_STREAM)
        self.emulator = JointEmulator(quantities, self.points, numbers, random, groups)
        self.failing_strings = int(stored.failed.sum())
        self.failures: Emulator | None = None
        if self.failing_strings and self.emulator.processes:  # a regression of the failures
            tried = self.coordinates.of_strings(stored.tried)
            failures = merge_samples(tried, stored.failed.astype(np.float64))
            self.failures = Emulator(failures, self.stream(FAILURE_STREAM), groups, rounds=0)

    def stream(self, number: int) -> np.random.Generator:
        """Return a random stream of the campaign, such as `EMULATOR_STREAM`."""
        return search_stream(self.box.campaign.seed, self._purpose, number)

    def at(self, strings: Floats) -> EmulatedStrings:
        """Return what is known of the mixed numbers of strings, (n, k) in SI units."""
        points = self.coordinates.of_strings(strings)
        return EmulatedStrings(*self.emulator.mixed(points), self.failing(points))

    def failing(self, points: Floats) -> Floats:
        """Return the probability that samples at points, (n, c), fail, shape (n,)."""
        if self.failures is None:
            return np.zeros(len(points))
        return np.clip(self.failures.mean(points), 0.0, 1.0)
