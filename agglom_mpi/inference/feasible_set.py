"""The set of strings that are compatible with a campaign's question, and how sure that is."""

from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.config.arguments import read_count
from agglom_mpi.config.coordinates import coordinates_of
from agglom_mpi.config.own_variables import (
    OwnVariable,
    Parameters,
    own_variables,
    read_searched,
)
from agglom_mpi.config.yaml_source import ArgumentError
from agglom_mpi.emulation.blas_threads import single_threaded
from agglom_mpi.emulation.joint_emulator import JointEmulator
from agglom_mpi.errors import UserError, require_library
from agglom_mpi.formatting import ROUNDING
from agglom_mpi.inference.criteria import Band, NearMaximum, criterion_of, read_tolerance
from agglom_mpi.inference.failing import FailingShare
from agglom_mpi.inference.set_calibration import Calibration, calibrate
from agglom_mpi.inference.set_points import SetPoints, spread_points, within
from agglom_mpi.inference.set_samples import favour_low_objectives, stored_samples
from agglom_mpi.public_face import PublicFace
from agglom_mpi.random_streams import FEASIBLE_SET, search_stream
from agglom_mpi.storage.recorded_campaign import recorded_campaign

if TYPE_CHECKING:
    import pandas as pd

    from agglom_mpi.config.campaign import Campaign
    from agglom_mpi.inference.set_directions import SetVariable
    from agglom_mpi.inference.set_nearest import NearestString
    from agglom_mpi.inference.set_posterior import Posterior
    from agglom_mpi.storage.reader import CampaignData

Floats = NDArray[np.float64]

FEWEST: Final = 50
"""Strings of a campaign that has a set, at least."""
FUNCTIONS: Final = 256
"""Functions drawn jointly for the error of the volume and for the maximum."""
INNER, OUTER = 0.95, 0.05
"""Probabilities of the inner and the outer set, at least."""
UNCERTAIN: Final = 0.002
"""Probability from which, and below one minus which, a string may or may not be a member."""


class Prior(NamedTuple):
    """Even points of the box: strings, (n, 10); mean, deviation, probability of failure, (n,)."""

    strings: Floats
    mean: Floats
    deviation: Floats
    failing: Floats


class NoFeasibleSetError(UserError, ValueError):
    """A campaign without a feasible set, with the reason."""


SET_INTERNALS: Final = (
    *("campaign", "coordinates", "emulator", "points", "even_strings", "prior", "prior_near"),
    *("moments_of", "failing_of", "probability_of", "table", "own", "names", "spans"),
    *("evaluated", "near_maximum", "count", "mistaken"),
)
"""Names of a set for the modules that are built on it."""


class FeasibleSet(metaclass=PublicFace, internal=SET_INTERNALS):
    """The strings of the search box that are compatible with the objective, by an emulator.

    The emulator rests on all completed samples of the file. Shares and volumes are measured in
    the coordinates in which the campaign searches, uniform in each.

    `open_campaign(path).feasible_set(tolerance)` returns it.

    Attributes
    ----------
    tolerance
        Relative to the target or to the maximum, between 0 and 1; of a user's function, its largest
        value.
    criterion
        What makes a string a member.
    calibration
        How well the emulator predicts held-out strings.
    allowed
        Share of the box that the constraints allow.
    samples, strings
        Numbers that the emulator rests on.
    favours_low_objectives
        Whether a search for the best proposed some of these strings, by the results of others.
    """

    def __init__(self, data: "CampaignData", tolerance: float | str = 0.05) -> None:
        self.campaign: Campaign = recorded_campaign(data)
        self.tolerance = tolerance_of(data, tolerance)
        self.criterion = criterion_of(data.section("objective"), self.tolerance)
        _check_possible(self, data)
        stored = stored_samples(data)
        self.samples = len(stored.rows)
        self.strings = len(np.unique(np.nan_to_num(stored.strings), axis=0))
        self.favours_low_objectives = favour_low_objectives(data)
        if self.strings < FEWEST:
            raise NoFeasibleSetError(
                f"{data.path}: completed samples of {self.strings} different strings; at least "
                f"{FEWEST} are needed for a feasible set"
            )
        self._kept: dict[Any, Any] = {}
        self.evaluated = stored.strings
        self.coordinates = coordinates_of(self.campaign)
        self.own: tuple[OwnVariable, ...] = own_variables(self.campaign.variables)
        numbers = _settled(self.criterion.numbers(stored.rows, self.campaign.scene.particles))
        points = self.coordinates.of_strings(stored.strings)
        groups = len(self.coordinates.groups)
        self.emulator = JointEmulator(
            self.criterion.compared, points, numbers, self._stream(0), groups
        )
        self._failing = FailingShare(
            self.coordinates.of_strings(stored.tried), stored.failed, self._stream(1), groups
        )
        if isinstance(self.criterion, NearMaximum):
            self._find_maximum(stored.strings)
        self.points: SetPoints = spread_points(self, stored.strings)
        self.allowed = self.points.allowed
        self.calibration: Calibration = calibrate(self)

    def __repr__(self) -> str:
        if not self.calibration.passed:
            known = "the emulator is not calibrated"
        elif self.empty:
            known = f"empty; nearest {self.nearest}"
        else:
            known = f"{100.0 * self.volume:.3g} % of the box"
        return f"<FeasibleSet of {self.campaign.name!r}: {self.criterion.text}; {known}>"

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the searched variables, as the campaign gives them."""
        return tuple(variable.name for variable in self.own)

    @property
    def spans(self) -> Floats:
        """Change of the logarithm of each searched variable along its coordinate, (d,)."""
        return self.coordinates.spans * [variable.power for variable in self.own]

    # At strings of the user's

    def probability(self, parameters: Parameters) -> Floats:
        """Return the probability that strings are members, shape (n,); nan outside the box.

        Parameters
        ----------
        parameters
            Values by name, as for `campaign.simulate`: SI numbers or texts with units, in a mapping
            or a DataFrame, each (n,) or one for all; or all ten in SI units, (10,) or (n, 10).
            Variables that the campaign fixed may be left out, those that it searched may not.

        Raises
        ------
        CampaignError
            If a name is unknown, a value impossible, or another than the campaign fixed.
        """
        return self._at(parameters, self.probability_of)

    def mean(self, parameters: Parameters) -> Floats:
        """Return the emulated mean of b/b0, or of what the objective compares, (n,) or (n, q).

        Several moments, q of them, are in the order of `criterion.quantities`; parameters as for
        `probability`.
        """
        return self._at(parameters, lambda s: _flat(self.emulator.mean(self._coordinates(s))))

    def deviation(self, parameters: Parameters) -> Floats:
        """Return the standard deviation of `mean`, (n,) or (n, q): how unsure the emulator is."""
        return self._at(parameters, lambda s: _flat(self.emulator.deviation(self._coordinates(s))))

    def noise(self, parameters: Parameters) -> Floats:
        """Return the standard deviation of one sample, (n,), of b/b0 or the function's value.

        For moments, (n, k), that of the k numbers of a sample that are emulated.
        """
        return self._at(parameters, lambda s: _flat(self.emulator.noise(self._coordinates(s))))

    # The set

    @property
    def empty(self) -> bool:
        """Whether no string of the box, nor the nearest one, is a member with P ≥ `OUTER`."""
        return self.outer == 0.0 and self.nearest.probability < OUTER

    @property
    def nearest(self) -> "NearestString":
        """The string whose emulated mean comes nearest to what is asked for, and that mean."""
        from agglom_mpi.inference.set_nearest import nearest

        if "nearest" not in self._kept:
            self._kept["nearest"] = nearest(self)
        found: NearestString = self._kept["nearest"]
        return found

    @property
    def failing(self) -> int:
        """Number of strings whose samples fail, which are no members."""
        return self._failing.count

    @property
    def volume(self) -> float:
        """Expected share of what is allowed of the box that is in the set."""
        return float(self.points.probability @ self.points.weights)

    @property
    def inner(self) -> float:
        """Share that is in the set with a probability of at least 0.95."""
        return float((self.points.probability >= INNER) @ self.points.weights)

    @property
    def outer(self) -> float:
        """Share that is in the set with a probability of at least 0.05."""
        return float((self.points.probability >= OUTER) @ self.points.weights)

    @property
    def expected_error(self) -> float:
        """Expected volume that is wrongly in or out of {P ≥ 0.5}, over the set's; inf if empty."""
        unsure = np.minimum(self.points.probability, 1.0 - self.points.probability)
        volume = self.volume
        return float(unsure @ self.points.weights) / volume if volume > 0.0 else np.inf

    @property
    def volume_error(self) -> float:
        """Standard error of `volume`: of the emulator, by joint draws, and of the points."""
        if "volume_error" not in self._kept:
            self._kept["volume_error"] = self._volume_error()
        return float(self._kept["volume_error"])

    def sample(self, n: int, seed: int = 0) -> "pd.DataFrame":
        """Draw n members: strings uniform in the box, each kept with its probability.

        Returns
        -------
        pandas.DataFrame
            The searched variables, by the names and in the SI units of the campaign, and
            `probability`; units in `.attrs["units"]`.

        Raises
        ------
        ValueError
            If n or seed is no whole number, or the set is empty.
        """
        n, seed = self.count("n", n, least=1), self.count("seed", seed)
        if self.empty:
            raise NoFeasibleSetError(
                f"{self.campaign.name}: the set is empty, so nothing can be drawn from it; nearest "
                f"{self.nearest}"
            )
        try:
            strings = self.points.draw(self, n, np.random.default_rng(seed))
        except RuntimeError as error:
            raise NoFeasibleSetError(f"{self.campaign.name}: {error}") from None
        return self.table(strings, probability=self.probability_of(strings))

    @property
    def directions(self) -> "pd.DataFrame":
        """Directions in which what is compared changes over the set, the most active first.

        Column `eigenvalue` is the mean squared change per box length along the direction, `share`
        its share of all; then the exponent of each variable in the product of powers that it is,
        scaled so that the most important one is 1 or -1; `group` is a dimensionless group that it
        is near, with their `cosine`. A direction of a single variable has the exponent 1.
        """
        from agglom_mpi.inference.set_directions import directions

        require_library("pandas", "report", "tables")
        if "directions" not in self._kept:
            self._kept["directions"] = directions(self)
        return self._kept["directions"].copy()

    @property
    def variables(self) -> "list[SetVariable]":
        """Each searched variable: its range in the set, and whether it is free or decided."""
        from agglom_mpi.inference.set_directions import variables

        if "variables" not in self._kept:
            self._kept["variables"] = variables(self)
        return list(self._kept["variables"])

    def posterior(self, measured: float | str, error: float | str) -> "Posterior":
        """Return the posterior of the variables, given a measured mean and its standard error.

        An error in percent, such as `"2%"`, is relative to the measured mean. The prior is uniform
        over what is allowed of the box, in the coordinates of the search.
        """
        from agglom_mpi.inference.set_posterior import posterior

        return posterior(self, measured, error)

    # For what is built on it

    def even_strings(
        self, count: int, lower: Floats | float = 0.0, upper: Floats | float = 1.0
    ) -> Floats:
        """Return the allowed strings of `count` even points, (n, 10).

        They fill the box, or a part of it in units of the box, (d,).
        """
        return within(self, count, lower, upper)

    def prior(self, count: int) -> "Prior":
        """Return the allowed ones of `count` even points of the box, with what is known there."""
        if ("prior", count) not in self._kept:
            strings = self.even_strings(count)
            values = (*self.moments_of(strings), self.failing_of(strings))
            self._kept["prior", count] = Prior(strings, *values)
        known: Prior = self._kept["prior", count]
        return known

    def prior_near(self, count: int, value: float, reach: float) -> "Prior":
        """Return those of `count` points whose emulated mean is within reach of a value."""
        strings = self.even_strings(count)
        mean = self.emulator.mean_only(self._coordinates(strings))[:, 0]
        strings = strings[np.abs(mean - value) <= reach]
        return Prior(strings, *self.moments_of(strings), self.failing_of(strings))

    def moments_of(self, strings: Floats) -> tuple[Floats, Floats]:
        """Return mean and standard deviation of the one number that is compared, each (n,)."""
        points = self._coordinates(strings)
        return self.emulator.mean(points)[:, 0], self.emulator.deviation(points)[:, 0]

    def failing_of(self, strings: Floats) -> Floats:
        """Return the probability that samples of strings, (n, 10), fail, (n,)."""
        return self._failing.at(self._coordinates(strings))

    def probability_of(self, strings: Floats) -> Floats:
        """Return the probability that strings, (n, 10), are members, (n,); nan outside the box."""
        found = np.full(len(strings), np.nan)
        inside = self._inside(strings)
        found[inside] = self._probability_inside(strings[inside])
        return found

    def table(self, strings: Floats, **columns: Floats) -> "pd.DataFrame":
        """Tabulate the searched variables of strings, (n, 10), and more columns, (n,)."""
        require_library("pandas", "report", "tables")
        import pandas as pd

        frame = pd.DataFrame({v.name: v.values(strings) for v in self.own} | columns)
        units = {variable.name: variable.unit for variable in self.own}
        frame.attrs["units"] = units | dict.fromkeys(columns, "1")
        return frame

    def _at(self, parameters: Parameters, function: Any) -> Floats:
        strings = read_searched(self.campaign, parameters)
        inside = self._inside(strings)
        values = np.asarray(function(strings[inside]))
        found = np.full((len(strings), *values.shape[1:]), np.nan)
        found[inside] = values
        return found

    def mistaken(self, field: str, message: object) -> ArgumentError:
        """Return the error about an argument."""
        return ArgumentError.of(self.campaign.name, field, message)

    def count(self, field: str, value: int, least: int = 0) -> int:
        """Return a whole number that is an argument; raise an ArgumentError for anything else."""
        try:
            return read_count(value, least)
        except ValueError as error:
            raise self.mistaken(field, error) from None

    def _inside(self, strings: Floats) -> NDArray[np.bool_]:
        some, box = self.coordinates.searched, self.campaign.variables
        near = 1e-9 * (box.upper - box.lower)[some]
        x = strings[:, some]
        inside = (x >= box.lower[some] - near) & (x <= box.upper[some] + near)
        return np.asarray(inside.all(axis=1))

    def _coordinates(self, strings: Floats) -> Floats:
        return self.coordinates.of_strings(strings)

    def _probability_inside(self, strings: Floats) -> Floats:
        if not len(strings):
            return np.empty(0)
        points = self._coordinates(strings)
        if isinstance(self.criterion, NearMaximum):
            bounds = self.criterion.share * self._maxima
            found = (self._paths(points)[..., 0] >= bounds[:, None]).mean(axis=0)
        elif isinstance(self.criterion, Band):
            mean, deviation = self.emulator.mean(points), self.emulator.deviation(points)
            found = self.criterion.probability(mean[:, 0], deviation[:, 0])
        else:
            found = self.emulator.probability(points, self.criterion.holds)
        found = found * (1.0 - self._failing.at(points))
        if self.campaign.relations.constraints:
            found = np.where(self.campaign.allowed_strings(strings), found, 0.0)
        return np.asarray(found)

    def _find_maximum(self, strings: Floats) -> None:
        """Draw functions, and find the maximum of each near where the expected mean is largest."""
        from agglom_mpi.inference.set_points import near_best

        self._paths = self.emulator.draw(FUNCTIONS, self._stream(2))
        candidates = near_best(self, strings)
        self._maxima = self._paths(self._coordinates(candidates))[..., 0].max(axis=1)

    @property
    def bounds(self) -> tuple[float, float]:
        """Bounds of what is compared in the set, of the first moment if there are several."""
        return self.criterion.bounds(self.maximum[0] if self.near_maximum else np.nan)

    @property
    def near_maximum(self) -> bool:
        """Whether members are those near the maximum of the emulated mean."""
        return isinstance(self.criterion, NearMaximum)

    @property
    def maximum(self) -> tuple[float, float]:
        """Mean and standard deviation of the maximum of the emulated mean over the box.

        Raises
        ------
        NoFeasibleSetError
            If the objective is another than `maximum_growth`.
        """
        if not self.near_maximum:
            raise NoFeasibleSetError(
                f"{self.campaign.name}: maximum: the objective is {self.campaign.objective.law}; "
                "only a set of maximum_growth is relative to a maximum"
            )
        return float(self._maxima.mean()), float(self._maxima.std())

    def _volume_error(self) -> float:
        points = self.points
        unsure = (points.probability > UNCERTAIN) & (points.probability < 1.0 - UNCERTAIN)
        coordinates, weights = self._coordinates(points.strings[unsure]), points.weights[unsure]
        if isinstance(self.criterion, NearMaximum):
            drawn = self._paths(coordinates)[..., 0]
            members = drawn >= (self.criterion.share * self._maxima)[:, None]
        else:
            functions = self.emulator.draw(FUNCTIONS, self._stream(3))(coordinates)
            members = self.criterion.holds(functions)
        own = float((members @ weights).std()) if unsure.any() else 0.0
        spread = float(points.probability**2 @ points.weights**2) - self.volume**2 / len(
            points.weights
        )
        return float(np.hypot(own, np.sqrt(max(spread, 0.0))))

    def _stream(self, purpose: int) -> np.random.Generator:
        return search_stream(self.campaign.seed, FEASIBLE_SET, purpose)


def tolerance_of(data: "CampaignData", tolerance: float | str) -> float:
    """Return the tolerance of a file's objective; raise an ArgumentError if it is impossible."""
    try:
        return read_tolerance(data.section("objective"), tolerance)
    except ValueError as error:
        raise ArgumentError.of(data.path, "tolerance", error) from None


def _flat(values: Floats) -> Floats:
    """Return values, (n, q), as (n,) where q is 1."""
    return values[:, 0] if values.shape[1] == 1 else values


def _settled(numbers: Floats) -> Floats:
    """Return the numbers of samples, (n, k); one that differs by rounding alone is the same in all.

    To an emulator, which scales by the spread of its data, rounding would be all there is.
    """
    spread, size = np.ptp(numbers, axis=0), np.abs(numbers).max(axis=0)
    return np.where(spread <= ROUNDING * size, numbers[0], numbers)


def _check_possible(of: FeasibleSet, data: "CampaignData") -> None:
    """Raise a NoFeasibleSetError where strings have no set, with the reason."""
    if of.campaign.plan is None or not of.campaign.variables.searched:
        raise NoFeasibleSetError(f"{data.path}: no variable is searched, so there is no set")
    if of.campaign.common_configurations:
        raise NoFeasibleSetError(
            f"{data.path}: ensemble.common_configurations is true; the noise of its strings is "
            "correlated, which the emulator does not model, so its set would look surer than it "
            "is; run the campaign without them"
        )


@single_threaded
def feasible_set(data: "CampaignData", tolerance: float | str = 0.05) -> FeasibleSet:
    """Return the feasible set of a campaign file.

    Raises
    ------
    NoFeasibleSetError
        If there is none, or the emulator is not calibrated, with the reason.
    CampaignError
        If the tolerance is impossible.
    """
    found = FeasibleSet(data, tolerance)
    if not found.calibration.passed:
        raise NoFeasibleSetError(f"{data.path}: {found.calibration.text}; no set is given")
    return found
