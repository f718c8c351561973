"""Posterior of the variables of a campaign, given all of its measured data."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np

from agglom_mpi.emulation.blas_threads import single_threaded
from agglom_mpi.emulation.gaussian_process import Floats
from agglom_mpi.inference.data_calibration import DataCalibration, calibrate_posterior
from agglom_mpi.inference.data_emulator import (
    PREDICTIVE_STREAM,
    EmulatedData,
    chi_squares,
)
from agglom_mpi.inference.draw_groups import Observed, Predicted
from agglom_mpi.inference.posterior import REPORTED_QUANTILES, Posterior, PosteriorError
from agglom_mpi.inference.posterior_sampling import (
    MAX_LOGARITHM_AWAY,
    PRIOR_POINTS,
    sample_posterior,
)
from agglom_mpi.inference.searched_box import SearchedBox
from agglom_mpi.inference.stored_samples import (
    MIN_STRINGS,
    stored_samples,
    why_not_emulated,
)
from agglom_mpi.inference.string_values import string_values
from agglom_mpi.measurements.datum import Datum
from agglom_mpi.measurements.misfit import UNLIKELY
from agglom_mpi.storage.recorded_campaign import recorded_campaign

if TYPE_CHECKING:
    import pandas as pd

    from agglom_mpi.inference.next_measurement import NextMeasurements
    from agglom_mpi.storage.reader import CampaignData

COARSE_POINTS: Final = 1 << 11
"""Number of even points of the box that show how near to the data strings come."""
MIN_POINTS: Final = 50
"""Minimum number of points with weight of a posterior."""
PREDICTIVE_DRAWS: Final = 2000
"""Number of strings whose predictions are drawn."""
IMPOSSIBLE: Final = 1e-3
"""Predictive p-value of all data below which no string of the box fits them."""


class PredictedDatum(NamedTuple):
    """Predictions of the posterior for a datum.

    Attributes
    ----------
    datum
        The datum: its name, quantity, weight, edges, time and unit, values and covariance.
    draws
        Predictions without errors of a measurement, in SI units, shape (draws, q).
    p_value
        Posterior predictive p-value: probability that a further measurement would differ more from
        what the string gives, averaged over the posterior. It is near 0 where the datum disagrees.
    outside
        Whether the median of a value is beyond what any string of the campaign gave.
    """

    datum: Datum
    draws: Floats
    p_value: float
    outside: bool = False

    @property
    def median(self) -> Floats:
        """Median prediction of each value, shape (q,)."""
        return np.median(self.draws, axis=0)

    def quantiles(self, shares: Sequence[float] = REPORTED_QUANTILES) -> Floats:
        """Return quantiles of the prediction of each value, shape (shares, q)."""
        return np.asarray(np.quantile(self.draws, shares, axis=0))

    @property
    def disagrees(self) -> bool:
        """Whether the datum disagrees with what all data together allow."""
        return self.p_value < UNLIKELY

    @property
    def verdict(self) -> str:
        """Faults of the prediction in a few words; empty if there are none."""
        faults = {"disagrees": self.disagrees, "outside of what strings gave": self.outside}
        return ", ".join(text for text, is_so in faults.items() if is_so)

    def as_dict(self) -> dict[str, Any]:
        """Return the prediction as plain values, in SI units."""
        datum = self.datum
        edges = None if datum.edges is None else datum.edges.tolist()
        return {
            "name": datum.name,
            "quantity": datum.quantity,
            "weight": datum.own_weight,
            "time": datum.time,
            "edges": edges,
            "unit": datum.kind.unit,
            "measured": datum.values.tolist(),
            "error": np.sqrt(np.diag(datum.covariance)).tolist(),
            "quantiles": self.quantiles().tolist(),
            "p_value": self.p_value,
            "disagrees": self.disagrees,
            "outside": self.outside,
        }


@dataclass(frozen=True, eq=False, repr=False)
class DataPosterior(Posterior[EmulatedData]):
    """Weighted strings that stand for the posterior, given all data of a campaign.

    `open_campaign(path).posterior()` returns it.

    Attributes
    ----------
    calibration
        Whether such posteriors contain the truth as often as they claim, by made-up data.
    file
        The campaign file with the samples; None of a posterior that was put together without one.
    """

    calibration: DataCalibration
    file: "CampaignData | None" = None

    def __repr__(self) -> str:
        ranges = []
        for each in self.of.box.own:
            low, high = self.quantiles(each.name, (0.05, 0.95))
            ranges.append(f"{each.name} {low:.4g} to {high:.4g} {each.unit}")
        doubt = f"; {self.warning}" if self.warning else ""
        return f"<DataPosterior of {self._name!r}, 90 %: {', '.join(ranges)}{doubt}>"

    @property
    def given(self) -> str:
        """The measurement, in a few words."""
        count = len(self.of.data)
        return f"all {count} measured data" if count > 1 else "the measured datum"

    def _warnings(self) -> list[str]:
        found = [] if self.calibration.passed else [self.calibration.text]
        if self.p_value < UNLIKELY:
            found.append(
                f"{self.misfit_text}: the ranges are those of the best compromise, which may miss "
                "the truth, and too narrow"
            )
        return found + super()._warnings()

    @property
    def misfit_text(self) -> str:
        """How badly the data fit the strings of the box, without a full stop."""
        names = [each.datum.name for each in self.predictions if each.disagrees]
        which = f"; {', '.join(names)} of {len(self.of.data)} disagree" if names else ""
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

    def next_measurements(self, errors: Mapping[str, Any] | None = None) -> "NextMeasurements":
        """Return the same as `what_to_measure_next` for a report."""
        from agglom_mpi.inference.next_measurement import next_measurements

        if self.file is None:
            raise PosteriorError("further measurements need the samples of a campaign file")
        if self.p_value < IMPOSSIBLE:
            raise PosteriorError(
                f"{self._name}: {self.misfit_text}; what a further measurement would give is not "
                "known before the data, their errors, the box or the laws of the scene are mended"
            )
        return next_measurements(self.file, self.of, self.drawn, errors)

    def predicted(self, random: np.random.Generator) -> Predicted:
        """Return the measured quantities, and what predicts measurements of them."""
        observed, slices = [], self.of.frame.rows
        for i, datum in enumerate(self.of.data):
            meaning: dict[str, Any] = {
                "long_name": datum.name,
                "units": datum.kind.unit,
            }
            if datum.edges is not None:
                meaning["edges"] = datum.edges
            errors = np.sqrt(np.diag(datum.covariance))
            name = f"datum_{i}_{datum.quantity}"
            observed.append(Observed(name, f"value_of_{i}", datum.values, errors, meaning))

        def measurements(strings: Floats, given: bool) -> list[Floats]:
            components, left_out = self._drawn_components(strings, random, given)
            components = components + random.normal(size=components.shape)
            left_out = left_out + random.normal(size=left_out.shape)
            values = self.of.values_of(components, left_out)
            return [values[:, rows] for rows in slices]

        return Predicted(observed, measurements)

    def attributes(self) -> dict[str, Any]:
        """Return the attributes of an ArviZ file as a whole."""
        names = ", ".join(datum.name for datum in self.of.data)
        return self._root_attributes(f"data: {names}") | {"calibration": self.calibration.text}

    def as_dict(self) -> dict[str, Any]:
        """Return the posterior without its draws as plain values; see `Posterior.as_dict`.

        `data` has what is predicted for each datum, with `p_value`; that of all data together is
        at the top. `calibration` has the `verdict` on the posterior.
        """
        return super().as_dict() | {
            "p_value": self.p_value,
            "data": [each.as_dict() for each in self.predictions],
            "components": int(self.of.components.shape[1]),
            "calibration": self.calibration.as_dict(),
        }

    @property
    def _name(self) -> str:
        return str(self.of.box.campaign.name)

    @cached_property
    def _predictions(self) -> tuple[list[PredictedDatum], float]:
        return predict_data(self)

    def _drawn_components(
        self, strings: Floats, random: np.random.Generator, given: bool
    ) -> tuple[Floats, Floats]:
        """Return components drawn at strings: emulated ones, (n, k), and those left out.

        The error of the emulator at a string is the same for every measurement. Where the measured
        data are `given`, they narrow it down, too.
        """
        of = self.of
        known = of.at(strings)
        mean = known.means @ of.emulator.mixing.T
        own = of.covariances(known.deviations)
        rest, spread = np.zeros(len(of.left_out_variance)), of.left_out_variance
        if given:
            one = np.eye(own.shape[1])
            gain = np.linalg.solve(own + one, own).transpose(0, 2, 1)
            mean = mean + np.einsum("nkl,nl->nk", gain, of.measured - mean)
            # V − V (V + 1)⁻¹ V = V (V + 1)⁻¹, as the measurement's covariance is 1.
            own = np.asarray(gain, np.float64)
            rest, spread = spread / (1.0 + spread) * of.left_out_measured, spread / (1.0 + spread)
        variances, directions = np.linalg.eigh(own)
        scaled = np.sqrt(np.maximum(variances, 0.0)) * random.normal(size=variances.shape)
        left_out = rest + np.sqrt(spread) * random.normal(size=(len(strings), len(spread)))
        return mean + np.einsum("nkl,nl->nk", directions, scaled), left_out


class MeasuredData:
    """Density of all data given the string, as `posterior.sample_posterior` needs it.

    Parameters
    ----------
    emulated
        The emulator.
    best
        χ² of the best string that is known.
    deviation
        Largest standard deviation of each mixed component, shape (k,).
    """

    def __init__(self, emulated: EmulatedData, best: float, deviation: Floats) -> None:
        self._emulated, self._best, self._deviation = emulated, best, deviation

    def log_density(self, strings: Floats) -> Floats:
        """Return the logarithm of the density given strings, (n, k), but for a constant, (n,)."""
        return self._emulated.log_density(strings)

    def near(self, strings: Floats) -> Floats:
        """Return those of strings, (n, k), that no component alone rules out."""
        reach = 2.0 * MAX_LOGARITHM_AWAY
        return self._emulated.near(strings, self._best, reach, self._deviation)


def predict_data(posterior: DataPosterior) -> tuple[list[PredictedDatum], float]:
    """Return predictions of all data, and the posterior predictive p-value of all together.

    χ² of a further measurement, by the errors of measurement and emulator at a string, has the
    distribution of χ² of its rank. So its p-values need no draws.
    """
    from scipy.special import chdtrc

    of = posterior.of
    random = of.stream(PREDICTIVE_STREAM)
    chosen = random.choice(len(posterior.weights), PREDICTIVE_DRAWS, p=posterior.weights)
    strings = posterior.strings[chosen]
    components, left_out = posterior._drawn_components(strings, random, given=True)
    values = of.values_of(components, left_out)
    away, covariances = of.framed_residuals(strings)
    p_values = []
    for rows in [slice(None), *of.frame.columns]:
        own = of.frame.roots[rows]
        factors = np.asarray(np.linalg.cholesky(own @ covariances @ own.T), np.float64)
        chi = chi_squares((away @ own.T)[None], factors)[0]
        p_values.append(float(np.mean(chdtrc(factors.shape[1], chi))))
    middle = np.median(values, axis=0)
    outside = (middle < of.reached[0]) | (middle > of.reached[1])
    found = []
    for datum, rows, p in zip(of.data, of.frame.rows, p_values[1:], strict=True):
        draws = datum.kind.within_limits(values[:, rows], of.lengths)
        found.append(PredictedDatum(datum, draws, p, bool(outside[rows].any())))
    return found, p_values[0]


@single_threaded
def data_posterior(file: "CampaignData") -> DataPosterior:
    """Return the posterior of the variables, given all data of a campaign.

    Raises
    ------
    PosteriorError
        If the campaign has no data, or its strings cannot be emulated, with the reason.
    """
    campaign = recorded_campaign(file)
    if not campaign.data or file.sizes.census is None:
        raise PosteriorError(
            f"{file.path}: the campaign has no section data; for the posterior of one measured "
            "mean, use feasible_set(tolerance).posterior(measured, error), or agglom report "
            "--feasible-set with --measured and --error"
        )
    if reason := why_not_emulated(campaign):
        raise PosteriorError(f"{file.path}: {reason}")
    stored = stored_samples(file)
    values = string_values(file, campaign.data, stored)
    count = len(np.unique(np.nan_to_num(values.strings), axis=0))
    if count < MIN_STRINGS:
        raise PosteriorError(
            f"{file.path}: predictions of {count} different strings; at least {MIN_STRINGS} are "
            "needed for a posterior"
        )
    emulated = EmulatedData(SearchedBox(campaign), campaign.data, values, stored)
    return replace(posterior_of(emulated), file=file)


def posterior_of(emulated: EmulatedData) -> DataPosterior:
    """Return the posterior of the data of an emulator, with its calibration."""
    box, mixing = emulated.box, emulated.emulator.mixing
    known = emulated.at(box.even_strings(COARSE_POINTS))
    away = emulated.measured - known.means @ mixing.T
    best = float(chi_squares(away[None], emulated.factors(known.deviations)).min())
    likelihood = MeasuredData(emulated, best, known.deviations.max(axis=0))
    prior = box.even_strings(PRIOR_POINTS)
    strings = likelihood.near(prior)
    first = likelihood.log_density(strings)
    drawn = sample_posterior(likelihood, box, strings, first, len(prior))
    if len(drawn.weights) < MIN_POINTS:
        raise PosteriorError(
            f"{box.campaign.name}: the data leave so little of the box that {len(drawn.weights)} "
            "points of it have any weight; pip install emcee for a Markov chain, or search a "
            "narrower box"
        )
    return DataPosterior(emulated, drawn, calibrate_posterior(emulated, drawn))
