"""The set of strings that are compatible with a campaign's question, and how sure that is."""

from collections.abc import Callable, Mapping
from functools import cached_property
from typing import TYPE_CHECKING, Final

import numpy as np

from agglom_mpi.config.given_strings import Parameters
from agglom_mpi.config.plan import DEFAULT_TOLERANCE, deviations_text, read_robust
from agglom_mpi.emulation.blas_threads import single_threaded
from agglom_mpi.errors import UserError, require_library
from agglom_mpi.formatting import printable
from agglom_mpi.inference.calibration import Calibration, calibrate
from agglom_mpi.inference.certificate import Certificate, certificate_of
from agglom_mpi.inference.data_posterior import mean_posterior
from agglom_mpi.inference.emulated_set import VOLUME_STREAM, EmulatedSet, tolerance_of
from agglom_mpi.inference.posterior import Posterior
from agglom_mpi.inference.searched_box import SearchedBox
from agglom_mpi.inference.set_directions import SetVariable, set_directions, set_variables
from agglom_mpi.inference.set_points import (
    INNER_PROBABILITY,
    OUTER_PROBABILITY,
    NearestString,
    SetPoints,
    nearest_string,
    spread_points,
)
from agglom_mpi.inference.stored_samples import (
    favours_low_objectives,
    require_emulated,
    require_strings,
    stored_samples,
)
from agglom_mpi.public_face import PublicFace
from agglom_mpi.statistics import Floats
from agglom_mpi.storage.recorded_campaign import recorded_campaign, recorded_objective
from agglom_mpi.storage.schema import LEARNED_FROM

if TYPE_CHECKING:
    import pandas as pd

    from agglom_mpi.storage.reader import CampaignData

UNCERTAIN_PROBABILITY: Final = 0.002
"""Probability above which, and below one minus which, a string may or may not be a member."""

SET_INTERNALS: Final = ("emulated", "points")
"""Names of a set for the modules that are built on it."""


class NoFeasibleSetError(UserError, ValueError):
    """A campaign without a feasible set, with the reason."""


class FeasibleSet(metaclass=PublicFace, internal=SET_INTERNALS):
    """The strings of the search box that are compatible with the objective, by an emulator.

    The emulator rests on completed samples that are used or fresh. Shares and volumes are measured
    in the coordinates in which the campaign searches, uniform in each.

    `open_campaign(path).feasible_set(tolerance)` returns it.

    Attributes
    ----------
    tolerance
        Relative to the target or to the maximum, between 0 and 1; of a user's function, its largest
        value.
    robust
        By name, the largest relative deviation of a variable. Probabilities, and what follows from
        them, are means over even deviations up to these.
    criterion
        What makes a string a member.
    calibration
        How well the emulator predicts held-out strings.
    allowed
        Share of the box that the constraints allow.
    samples, strings
        Numbers that the emulator rests on.
    learned, learned_from
        Number of samples of another campaign that the search has learned, failed ones included, and
        the name of its file.
    favours_low_objectives
        Whether a search for the best proposed some of these strings, by the results of others.
    """

    def __init__(
        self,
        data: "CampaignData",
        tolerance: float | str = DEFAULT_TOLERANCE,
        robust: Mapping[str, float | str] | None = None,
    ) -> None:
        campaign = recorded_campaign(data)
        box = SearchedBox(campaign)
        self.robust = read_robust(data.path, robust or {}, box.names)
        self.tolerance = tolerance_of(data, tolerance)
        criterion = recorded_objective(data).criterion(self.tolerance)
        require_emulated(data, NoFeasibleSetError)
        stored = stored_samples(data)
        self.samples = len(stored.rows)
        self.learned = data.sizes.learned
        self.learned_from = printable(data.attributes.get(LEARNED_FROM, ""))
        self.favours_low_objectives = favours_low_objectives(data)
        self.strings = require_strings(data, stored.strings, "a feasible set", NoFeasibleSetError)
        if self.robust:
            criterion.text += f"; P averaged over deviations: {deviations_text(self.robust)}"
        self.emulated = EmulatedSet(box, criterion, stored, self.robust)
        self.criterion = self.emulated.criterion
        self.points: SetPoints = spread_points(self.emulated)
        self.allowed = self.points.allowed
        self.calibration: Calibration = calibrate(self.emulated, self.points)
        self._data = data

    def __repr__(self) -> str:
        if not self.calibration.passed:
            known = "the emulator is not calibrated"
        elif self.empty:
            known = f"empty; nearest {self.nearest}"
        else:
            known = f"{100.0 * self.volume:.3g} % of the box"
        return f"<FeasibleSet of {self._name!r}: {self.criterion.text}; {known}>"

    # At strings of the user's

    def probability(self, parameters: Parameters) -> Floats:
        """Return the probability that strings are members, shape (n,); nan outside the box.

        Parameters
        ----------
        parameters
            Values by name, as for `campaign.simulate`: SI numbers or texts with units, in a mapping
            or a DataFrame, each (n,) or one for all. Or all variables of the campaign in SI units,
            shape (k,) or (n, k).
            Variables that the campaign fixed may be left out, those that it searched may not.

        Raises
        ------
        CampaignError
            If a name is unknown, a value impossible, or another than the campaign fixed.
        """
        return self._at(parameters, self.emulated.probability)

    def mean(self, parameters: Parameters) -> Floats:
        """Return the emulated mean of b/b0, or of what the objective compares, (n,) or (n, q).

        Several moments, q of them, are in the order of `criterion.quantities`; parameters as for
        `probability`.
        """
        return self._at(parameters, lambda strings: _flat(self.emulated.mean(strings)))

    def deviation(self, parameters: Parameters) -> Floats:
        """Return the standard deviation of `mean`, (n,) or (n, q): how unsure the emulator is."""
        return self._at(parameters, lambda strings: _flat(self.emulated.deviation(strings)))

    def noise(self, parameters: Parameters) -> Floats:
        """Return the standard deviation of one sample, (n,), of b/b0 or the function's value.

        For moments, (n, k), that of the k numbers of a sample that are emulated.
        """
        noise, at = self.emulated.emulator.noise, self.emulated.coordinates.of_strings
        return self._at(parameters, lambda strings: _flat(noise(at(strings))))

    # The set

    @property
    def empty(self) -> bool:
        """Whether neither a point of the box nor the nearest string is a member with P ≥ 0.05."""
        return self.outer == 0.0 and self.nearest.probability < OUTER_PROBABILITY

    @cached_property
    def nearest(self) -> NearestString:
        """The string whose emulated mean comes nearest to what is asked for, and that mean."""
        return nearest_string(self.emulated)

    @property
    def certificate(self) -> Certificate | None:
        """Certificate of the set, by `agglom certify`; None without such a file.

        Nor is there one of another tolerance.

        Raises
        ------
        CertificateError
            If the file beside the campaign's is that of other samples.
        """
        found = None if self._data.pooled else certificate_of(self._data)
        return found if found is not None and found.plan.tolerance == self.tolerance else None

    @property
    def failing(self) -> int:
        """Number of strings whose samples fail, which are no members."""
        return self.emulated.failing_strings

    @property
    def bounds(self) -> tuple[float, float]:
        """Bounds of what is compared in the set, of the first moment if there are several."""
        return self.criterion.bounds()

    @property
    def maximum(self) -> tuple[float, float]:
        """Mean and standard deviation of the maximum of the emulated mean over the box.

        Raises
        ------
        NoFeasibleSetError
            If the objective is another than `maximum_growth`.
        """
        if self.criterion.maximum is None:
            objective = self.emulated.box.campaign.objective
            raise NoFeasibleSetError(
                f"{self._name}: maximum: the objective is {objective.name}; "
                "only a set of maximum_growth is relative to a maximum"
            )
        return self.criterion.maximum

    @property
    def volume(self) -> float:
        """Expected share of what is allowed of the box that is in the set."""
        return self.points.volume

    @property
    def inner(self) -> float:
        """Share that is in the set with a probability of at least 0.95."""
        return self.points.share(INNER_PROBABILITY)

    @property
    def outer(self) -> float:
        """Share that is in the set with a probability of at least 0.05."""
        return self.points.share(OUTER_PROBABILITY)

    @property
    def expected_error(self) -> float:
        """Expected volume that is wrongly in or out of {P ≥ 0.5}, over the set's; inf if empty.

        Where variables deviate, it is nan: P is then between 0 and 1 for other reasons, too.
        """
        if self.robust:
            return np.nan
        unsure = np.minimum(self.points.probability, 1.0 - self.points.probability)
        volume = self.volume
        return float(unsure @ self.points.weights) / volume if volume > 0.0 else np.inf

    @cached_property
    def volume_error(self) -> float:
        """Standard error of `volume`: of the emulator, by joint draws, and of the points."""
        points = self.points
        unsure = (points.probability > UNCERTAIN_PROBABILITY) & (
            points.probability < 1.0 - UNCERTAIN_PROBABILITY
        )
        members = self.emulated.wobble.mean(self._drawn_members, points.strings[unsure])
        own = float((members @ points.weights[unsure]).std()) if unsure.any() else 0.0
        squares = float(points.probability**2 @ points.weights**2)
        spread = squares - self.volume**2 / len(points.weights)
        return float(np.hypot(own, np.sqrt(max(spread, 0.0))))

    def _drawn_members(self, strings: Floats) -> Floats:
        """Return where drawn functions, the same in each call, have members, (functions, n)."""
        at, stream = self.emulated.coordinates.of_strings(strings), self.emulated.stream
        members = self.criterion.drawn_members(self.emulated.emulator, at, stream(VOLUME_STREAM))
        return members.astype(np.float64)

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
        box = self.emulated.box
        n, seed = box.count("n", n, least=1), box.count("seed", seed)
        if self.empty:
            raise NoFeasibleSetError(
                f"{self._name}: the set is empty, so nothing can be drawn from it; nearest "
                f"{self.nearest}"
            )
        try:
            strings = self.points.draw(self.emulated, n, np.random.default_rng(seed))
        except RuntimeError as error:
            raise NoFeasibleSetError(f"{self._name}: {error}") from None
        return box.table(strings, probability=self.emulated.probability(strings))

    @cached_property
    def directions(self) -> "pd.DataFrame":
        """Directions in which what is compared changes over the set, the most active first.

        Column `eigenvalue` is the mean squared change per box length along the direction, `share`
        its share of all; then the exponent of each variable in the product of powers that it is,
        scaled so that the most important one is 1 or -1; `group` is a dimensionless group that it
        is near, with their `cosine`. A direction of a single variable has the exponent 1.
        """
        require_library("pandas", "report", "tables")
        return set_directions(self.emulated, self._members)

    @cached_property
    def variables(self) -> list[SetVariable]:
        """Each searched variable: its range in the set, and whether it is free or decided."""
        return set_variables(self.emulated, self._members)

    def posterior(self, measured: float | str, error: float | str) -> Posterior:
        """Return the posterior of the variables, given a measured mean and its standard error.

        An error in percent, such as `"2%"`, is relative to the measured mean. The prior is uniform
        over what is allowed of the box, in the coordinates of the search.
        """
        return mean_posterior(self.emulated, measured, error)

    @property
    def _members(self) -> SetPoints:
        """The points; of an empty set none is a member."""
        if not self.empty:
            return self.points
        return self.points._replace(probability=np.zeros_like(self.points.probability))

    @property
    def _name(self) -> str:
        return self.emulated.box.campaign.name

    def _at(self, parameters: Parameters, function: Callable[[Floats], Floats]) -> Floats:
        """Return the values of a function of strings in the box; nan for others."""
        box = self.emulated.box
        strings = box.strings(parameters)
        inside = box.inside(strings)
        values = np.asarray(function(strings[inside]))
        found = np.full((len(strings), *values.shape[1:]), np.nan)
        found[inside] = values
        return found


def _flat(values: Floats) -> Floats:
    """Return values, (n, q), as (n,) where q is 1."""
    return values[:, 0] if values.shape[1] == 1 else values


@single_threaded
def feasible_set(
    data: "CampaignData",
    tolerance: float | str = DEFAULT_TOLERANCE,
    robust: Mapping[str, float | str] | None = None,
) -> FeasibleSet:
    """Return the feasible set of a campaign file.

    Raises
    ------
    NoFeasibleSetError
        If there is none, or the emulator is not calibrated, with the reason.
    CampaignError
        If the tolerance or a deviation is impossible.
    """
    found = FeasibleSet(data, tolerance, robust)
    if not found.calibration.passed:
        raise NoFeasibleSetError(f"{data.path}: {found.calibration.text}; no set is given")
    return found
