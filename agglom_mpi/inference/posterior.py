"""Posterior of the variables of a campaign, given a measured mean or all of its data."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from agglom_mpi.declaration.spelling import suggestion
from agglom_mpi.errors import UserError
from agglom_mpi.inference.contributions import (
    Contribution,
    PredictedDatum,
    conditional_densities,
    contributions,
    datum_points,
    predict_data,
)
from agglom_mpi.inference.data_calibration import DataCalibration
from agglom_mpi.inference.data_emulator import EmulatedData
from agglom_mpi.inference.draw_groups import (
    DEFAULT_DRAWS,
    Groups,
    arviz_data,
    density_group,
    in_chains,
    independent_draws,
    posterior_groups,
    root_attributes,
)
from agglom_mpi.inference.next_measurement import NextMeasurements, next_measurements
from agglom_mpi.inference.posterior_sampling import (
    CENTRAL,
    MIN_SIZE,
    REPORTED_QUANTILES,
    Measurement,
    WeightedStrings,
    contraction_of,
)
from agglom_mpi.inference.set_directions import MIN_FREE_SHARE, name_ends, touched_ends
from agglom_mpi.measurements.misfit import UNLIKELY
from agglom_mpi.statistics import Floats, weighted_quantiles

if TYPE_CHECKING:
    import pandas as pd

    from agglom_mpi.storage.reader import CampaignData

IMPOSSIBLE: Final = 1e-3
"""Predictive p-value of all data below which no string of the box fits them."""


class PosteriorError(UserError, ValueError):
    """A posterior that cannot be computed, with the reason."""


@dataclass(frozen=True, eq=False, repr=False)
class Posterior(WeightedStrings):
    """Weighted strings that stand for the posterior; see `WeightedStrings` for their attributes.

    `open_campaign(path).posterior()` returns that of all data of a campaign, with its check and its
    predictions; `feasible_set(tolerance).posterior(measured, error)` that of a measured mean.

    Attributes
    ----------
    of
        What was measured, with the emulator and the search box.
    calibration
        Whether such posteriors contain the truth as often as they claim, by made-up data; None of a
        measured mean, whose set is calibrated.
    file
        The campaign file with the samples; None of a posterior that was put together without one.
    """

    of: Measurement
    calibration: DataCalibration | None = None
    file: "CampaignData | None" = None

    def __repr__(self) -> str:
        ranges = []
        for each in self.of.box.own:
            low, high = self.quantiles(each.name, CENTRAL)
            ranges.append(f"{each.name} {low:.4g} to {high:.4g} {each.unit}")
        doubt = f"; {self.warning}" if self.warning else ""
        return f"<Posterior of {self._name!r}, 90 %: {', '.join(ranges)}{doubt}>"

    @property
    def _name(self) -> str:
        return str(self.of.box.campaign.name)

    @property
    def warning(self) -> str:
        """Reasons for which the ranges may be wrong; empty if there are none."""
        found = []
        if self.calibration is not None:
            found += [] if self.calibration.passed else [self.calibration.text]
            if self.p_value < UNLIKELY:
                found.append(
                    f"{self.misfit_text}: the ranges are those of the best compromise, which may "
                    "miss the truth, and too narrow"
                )
        own = ((each, self.touches[each.name]) for each in self.of.box.own)
        touched = ", ".join(name_ends(each, ends) for each, ends in own if ends)
        if touched:
            found.append(f"the posterior touches {touched}, where its ranges end with the box")
        if self.effective_size < MIN_SIZE:
            found.append(
                f"the effective size is {self.effective_size:.0f}, too small to trust the tails: "
                "the measurement leaves little of the box; pip install emcee for a Markov chain, "
                "or search a narrower box"
            )
        return "; ".join(found)

    @cached_property
    def touches(self) -> dict[str, tuple[str, ...]]:
        """Ends of the box, `lower` and `upper`, that the posterior touches, by variable.

        Those of a variable of which the measurement says next to nothing are left out.
        """
        places, found = self.of.box.space.to_unit(self.strings), {}
        for name, mine in zip(self.of.box.names, places.T, strict=True):
            ends = touched_ends(mine, self.weights)
            free = len(ends) > 1 and self.contraction[name] >= MIN_FREE_SHARE
            found[name] = () if free else ends
        return found

    @property
    def draws(self) -> "pd.DataFrame":
        """The searched variables in SI units and the weight of each string, as a DataFrame."""
        return self.of.box.table(self.strings, weight=self.weights)

    def sample(self, n: int, seed: int = 0) -> "pd.DataFrame":
        """Draw n strings of equal weight, with replacement; raises ValueError for a wrong n."""
        n, seed = self.of.box.count("n", n, least=1), self.of.box.count("seed", seed)
        chosen = np.random.default_rng(seed).choice(len(self.weights), n, p=self.weights)
        return self.of.box.table(self.strings[chosen])

    def to_pandas(self) -> "pd.DataFrame":
        """Return the same as `draws`: units are in `.attrs["units"]`, and weights add up to 1."""
        return self.draws

    def to_arviz(self, draws: int = DEFAULT_DRAWS, seed: int = 0) -> Any:
        """Return the posterior as an `arviz.InferenceData`; as a DataTree from ArviZ 1 on.

        Groups, number of draws and seed are those of `groups`; raises MissingLibraryError without
        ArviZ.
        """
        return arviz_data(self.groups(draws, seed), self.attributes())

    def groups(self, draws: int = DEFAULT_DRAWS, seed: int = 0) -> Groups:
        """Return the groups of an ArviZ file as xarray Datasets by name.

        Of weighted strings at most `draws` of equal weight are drawn, none twice, in chains of
        independent draws; `sample_stats` has the `weight` that each string had. The steps of a
        Markov chain are of equal weight already, and all are kept: each walker is a chain. The
        effective size, which no number of draws can raise, is an attribute of `posterior`.
        `log_likelihood` has the density of each datum given the others.
        """
        draws, seed = self.of.box.count("draws", draws, least=1), self.of.box.count("seed", seed)
        if self.walkers:
            chosen = np.arange(len(self.weights)).reshape(-1, self.walkers).T
        else:
            chosen = in_chains(independent_draws(self.weights, draws, seed))
        meaning = "weight of the string before it was drawn; the draws need no weights"
        attributes = {
            "draws_are": f"the posterior, given {self.given}",
            "effective_size": self.effective_size,
            "method": self.method,
            "warning": self.warning,
        }
        stats = {"weight": (self.weights[chosen], meaning)}
        random = np.random.default_rng([seed, 1])
        found = posterior_groups(self.of, self.strings[chosen], stats, attributes, random)
        if isinstance(self.of, EmulatedData):
            flat = self.strings[chosen.ravel()]
            names = [name for name, *_ in datum_points(self.of)[0]]
            densities = conditional_densities(self.of, flat).reshape(*chosen.shape, -1)
            found["log_likelihood"] = density_group(names, densities)
        return found

    @property
    def given(self) -> str:
        """The measurement, in a few words."""
        return self.of.given

    def attributes(self) -> dict[str, Any]:
        """Return the attributes of an ArviZ file as a whole."""
        found = root_attributes(self.of.box.campaign, self.of.criterion_text)
        return found if self.calibration is None else found | {"calibration": self.calibration.text}

    # How well data and predictions agree

    @property
    def misfit_text(self) -> str:
        """How badly the data fit the strings of the box, without a full stop."""
        names = [each.datum.name for each in self.predictions if each.disagrees]
        which = f"; {', '.join(names)} of {len(self.predictions)} disagree" if names else ""
        strings = "no string" if self.p_value < IMPOSSIBLE else "hardly any string"
        return f"{strings} of the box fits the data, p = {self.p_value:.2g}{which}"

    @property
    def p_value(self) -> float:
        """Posterior predictive p-value of all data together; near 0 where no string fits them."""
        return self._predictions[1]

    @property
    def predictions(self) -> list[PredictedDatum]:
        """Predictions of the posterior for each datum, in the order of the data."""
        return list(self._predictions[0])

    @cached_property
    def _predictions(self) -> tuple[list[PredictedDatum], float]:
        return predict_data(self.emulated_data, self)

    @property
    def emulated_data(self) -> EmulatedData:
        """The emulated data.

        Raises
        ------
        PosteriorError
            If a mean was measured, which has no censuses.
        """
        if not isinstance(self.of, EmulatedData):
            raise PosteriorError(f"{self._name}: {self.given} has no predictions for data")
        return self.of

    def what_to_measure_next(self, errors: Mapping[str, Any] | None = None) -> "pd.DataFrame":
        """Return what each further measurement would leave of the box; takes a minute.

        Further measurements are all quantities of one number at all times of the data that are not
        measured yet, and each datum once more with half of its error. Their values are simulated
        by the emulator: no new samples are needed.

        Parameters
        ----------
        errors
            Standard errors by quantity: relative to the value as `"3%"`, or absolute in SI units or
            with a unit, as `{"d90": "3%", "temperature": "2 K"}`. By default a quantity has the
            relative error of the data of its kind, or else 5 %; a temperature has the absolute
            error of the measured one, or else 1 K.

        Returns
        -------
        pandas.DataFrame
            One row for each measurement, the most informative one first. `volume` is the share of
            the box in the smallest region with 90 % of the posterior as it is, `expected_volume`
            that after the measurement, and `standard_error` the Monte-Carlo error of the latter.

        Raises
        ------
        ArgumentError
            If there is no such quantity, or an error is impossible.
        PosteriorError
            If no string fits the data.
        """
        return self.next_measurements(errors).table

    def next_measurements(self, errors: Mapping[str, Any] | None = None) -> NextMeasurements:
        """Return the same as `what_to_measure_next` for a report."""
        if self.file is None:
            raise PosteriorError("further measurements need the samples of a campaign file")
        if self.p_value < IMPOSSIBLE:
            raise PosteriorError(
                f"{self._name}: {self.misfit_text}; what a further measurement would give is not "
                "known before the data, their errors, the box or the laws of the scene are mended"
            )
        return next_measurements(self.file, self.emulated_data, self, errors)

    # The variables

    def quantiles(
        self, name: str, shares: tuple[float, ...] = REPORTED_QUANTILES
    ) -> tuple[float, ...]:
        """Return quantiles of a searched variable, in SI units; by default `REPORTED_QUANTILES`.

        Raises
        ------
        CampaignError
            If the campaign does not search a variable of that name.
        """
        if name not in self.of.box.names:
            hint = suggestion(name, self.of.box.names)
            raise self.of.box.mistaken(name, f"is no searched variable; {hint}")
        variable = self.of.box.own[self.of.box.names.index(name)]
        return weighted_quantiles(variable.values(self.strings), self.weights, shares)

    @cached_property
    def contraction(self) -> dict[str, float]:
        """Width of the central 90 % of each variable relative to the prior's, by name.

        Both widths are measured in the coordinate in which the variable is searched.
        """
        return contraction_of(self.of.box, self)

    @cached_property
    def contributions(self) -> list[Contribution]:
        """Contribution of each experiment: posteriors without it, and of it alone.

        It is empty where the data are of one experiment, and takes some seconds for each.
        """
        return contributions(self.of, self) if isinstance(self.of, EmulatedData) else []

    @property
    def correlations(self) -> Floats:
        """Correlations of the searched variables, in the coordinates of the emulator, (d, d)."""
        covariance = self._covariance
        scale = np.sqrt(np.diag(covariance))
        return np.asarray(covariance / np.outer(scale, scale))

    @property
    def partial_correlations(self) -> Floats:
        """Correlations of two searched variables, the others kept, (d, d)."""
        d = len(self.of.box.names)
        precision = np.linalg.inv(self._covariance + 1e-12 * np.eye(d))
        scale = np.sqrt(np.diag(precision))
        return np.asarray(2.0 * np.eye(d) - precision / np.outer(scale, scale))

    @property
    def _covariance(self) -> Floats:
        own = self.of.coordinates.own(self.strings)
        return np.atleast_2d(np.cov(own.T, aweights=self.weights))

    def as_dict(self) -> dict[str, Any]:
        """Return the posterior without its draws as plain values.

        `variables` has the `quantiles` of each variable in SI units, whose names are in `units`.
        Rows and columns of both matrices of correlations are in the order of `variables`.
        `contraction` is the width of the central 90 % relative to the prior's, `touches` the ends
        of the box at which ranges end with it, and `volume` the share of the box in the smallest
        region with 90 % of the posterior. Beside these are the `measured` mean and its `error`, or
        of data `p_value`, what is predicted for each in `data`, the `calibration`, and the
        `contributions` of several experiments.
        """
        names = self.of.box.names
        found = self.of.entries() | {
            "effective_size": self.effective_size,
            "strings": len(self.weights),
            "method": self.method,
            "warning": self.warning or None,
            "quantiles": list(REPORTED_QUANTILES),
            "variables": {name: list(self.quantiles(name)) for name in names},
            "units": {each.name: each.unit for each in self.of.box.own},
            "contraction": self.contraction,
            "touches": {name: list(ends) for name, ends in self.touches.items()},
            "volume": self.volume,
            "correlations": self.correlations.tolist(),
            "partial_correlations": self.partial_correlations.tolist(),
        }
        if self.calibration is None:
            return found
        if self.contributions:
            found["contributions"] = [each.as_dict() for each in self.contributions]
        return found | {
            "p_value": self.p_value,
            "data": [each.as_dict() for each in self.predictions],
            "components": int(self.emulated_data.components.shape[1]),
            "calibration": self.calibration.as_dict(),
        }
