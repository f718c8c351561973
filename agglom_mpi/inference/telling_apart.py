"""Next measurements that tell two laws apart: the expected probability of the right one after it.

Each law predicts a further measurement from the posterior of the data that there are: a mixture of
normal densities, with the doubt of its emulator and the error of the measurement. Measurements are
simulated by either law and have a density by both, whose ratio is the Bayes factor (Box and Hill,
Technometrics 9, 1967, 57). They need no new samples, and are those of `next_measurement`.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np
from scipy.special import expit, logsumexp

from agglom_mpi.emulation.blas_threads import single_threaded
from agglom_mpi.inference.data_emulator import EmulatedData
from agglom_mpi.inference.expected_volume import (
    Candidate,
    WeightedPoints,
    logarithms_after,
    simulated_measurements,
)
from agglom_mpi.inference.next_measurement import Measurable, dense_points, measurables
from agglom_mpi.random_streams import NEXT_MEASUREMENT, search_stream
from agglom_mpi.statistics import Floats

if TYPE_CHECKING:
    from agglom_mpi.inference.posterior import Posterior

TELLING_POINTS: Final = 1 << 12
"""Number of points that are drawn from each posterior."""
SIMULATED_BY_EACH: Final = 1000
"""Number of measurements that are simulated by each law."""
MIN_GAIN: Final = 0.05
"""Minimum rise of the expected probability of the right law that makes a measurement worth it."""
POINTS_STREAM, TELLING_STREAM = 2, 3
"""Random streams beside those of `next_measurement`; that of the second law is one higher."""


class Prediction(NamedTuple):
    """Prediction of a law for a measurement, at points of its posterior."""

    points: WeightedPoints
    candidate: Candidate

    def with_error(self, error: float) -> "Prediction":
        """Return the prediction for a measurement of one number with another standard error."""
        return self._replace(candidate=self.candidate._replace(error=np.array([[error**2]])))

    def log_density(self, measured: Floats) -> Floats:
        """Return the logarithms of the densities of measurements, (r, q), but for a constant."""
        parts = logarithms_after(self.points, self.candidate, measured)
        return np.concatenate([logsumexp(part, axis=1) for part in parts])


class ToldApart(NamedTuple):
    """How well a measurement is expected to tell two laws apart.

    Attributes
    ----------
    doubt
        Expected probability of the wrong law after it.
    doubt_error
        Monte-Carlo error of that.
    log_bayes_factor
        Expected natural logarithm of the Bayes factor for the right law.
    gain
        Expected rise of the probability of the right law.
    """

    doubt: float
    doubt_error: float
    log_bayes_factor: float
    gain: float

    @property
    def is_worth_it(self) -> bool:
        """Whether the laws are told apart better than by the data that there are."""
        return self.gain > max(MIN_GAIN, 2.0 * self.doubt_error)


@dataclass(frozen=True)
class TellingMeasurement(Measurable):
    """A measurement that could be made, and how well it would tell two laws apart.

    Attributes
    ----------
    predicted, other_predicted
        Medians by both laws in SI units; nan of shares of sizes. `standard_error` is the larger one
        of what their errors would be.
    apart
    """

    other_predicted: float
    apart: ToldApart

    def record(self) -> dict[str, Any]:
        """Return the measurement as plain values."""
        return super().record() | {
            "predicted_by_other": self.other_predicted,
            "expected_probability": 1.0 - self.apart.doubt,
            "expected_gain": self.apart.gain,
            "monte_carlo_error": self.apart.doubt_error,
            "expected_log_bayes_factor": self.apart.log_bayes_factor,
        }


@single_threaded
def telling_measurements(
    posteriors: "Sequence[Posterior]", log_odds: float
) -> tuple[TellingMeasurement, ...]:
    """Return the measurements that both laws predict, the one that tells them apart best first.

    Parameters
    ----------
    posteriors
        Two of them, of the same data by two laws.
    log_odds
        Natural logarithm of the probability of the first law over that of the other.
    """
    seed = posteriors[0].of.box.campaign.seed
    by_first, by_other = map(_predicted, posteriors)
    found = []
    for key in by_first.keys() & by_other.keys():
        (each, first), (other, second) = by_first[key], by_other[key]
        if not each.repeats:
            error = max(each.standard_error, other.standard_error)
            if error == 0.0:
                continue
            each = replace(each, standard_error=error)
            first, second = first.with_error(error), second.with_error(error)
        apart = told_apart(first, second, log_odds, seed)
        found.append(TellingMeasurement(**vars(each), other_predicted=other.predicted, apart=apart))
    return tuple(sorted(found, key=lambda each: (each.apart.doubt, each.name)))


def told_apart(first: Prediction, other: Prediction, log_odds: float, seed: int) -> ToldApart:
    """Return how well a measurement would tell two laws apart that predict it.

    `log_odds` is that of the first law, and `seed` of the simulated measurements.
    """
    doubt = variance = factor = 0.0
    for k, sign, law in ((0, 1.0, first), (1, -1.0, other)):
        random = search_stream(seed, NEXT_MEASUREMENT, TELLING_STREAM + k)
        measured = simulated_measurements(law.points, law.candidate, random, SIMULATED_BY_EACH)
        factors = first.log_density(measured) - other.log_density(measured)
        odds = log_odds + factors
        wrong = 2.0 * expit(odds) * expit(-odds)  # either law is right, and the other believed
        share = float(expit(sign * log_odds))
        doubt += share * float(wrong.mean())
        variance += share**2 * float(wrong.var(ddof=1)) / SIMULATED_BY_EACH
        factor += share * sign * float(factors.mean())
    now = 2.0 * float(expit(log_odds) * expit(-log_odds))
    return ToldApart(doubt, math.sqrt(variance), factor, now - doubt)


def _predicted(posterior: "Posterior") -> dict[int | str, tuple[Measurable, Prediction]]:
    """Return what a law predicts, by the place of the datum that is repeated, or by name."""
    of, file = posterior.emulated_data, posterior.file
    assert file is not None
    strings, dense = dense_points(of, posterior)
    random = search_stream(of.box.campaign.seed, NEXT_MEASUREMENT, POINTS_STREAM)
    drawn = random.choice(len(strings), TELLING_POINTS, p=dense.weights)
    points = WeightedPoints(np.full(TELLING_POINTS, 1.0 / TELLING_POINTS), dense.share)
    found = dict[int | str, tuple[Measurable, Prediction]]()
    for i, (each, candidate) in enumerate(measurables(file, of, strings[drawn], points, {})):
        if each.repeats:
            candidate = _whole(of, candidate, of.frame.columns[i])
        found[i if each.repeats else each.name] = each, Prediction(points, candidate)
    return found


def _whole(of: EmulatedData, candidate: Candidate, columns: slice) -> Candidate:
    """Return a repetition with what all strings have in common and what is not emulated.

    What is not emulated is known from the data as far as it varies between strings.
    """
    own = of.frame.roots[columns]
    rest, known = own @ of.left_out, of.left_out_variance / (1.0 + of.left_out_variance)
    common = own @ of.centre + rest @ (known * of.left_out_measured)
    return candidate._replace(
        means=candidate.means + common,
        covariances=candidate.covariances + (rest * known) @ rest.T,
    )
