"""What strings are worth on fresh samples, which no decision has seen."""

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from agglom_mpi.outcome import COMPLETED
from agglom_mpi.storage.timeouts import timed_out

if TYPE_CHECKING:
    from agglom_mpi.search.objectives import Objective
    from agglom_mpi.storage.reader import CampaignData


class Estimate(NamedTuple):
    """A string estimated again; lower objectives are better.

    Attributes
    ----------
    string
    objective, standard_error
        Of the fresh samples that were completed; inf where there is none or more than 10 %
        failed, as in an ensemble. Their signed mean is unbiased; its magnitude, where that is no
        larger than its error, is too high by up to 0.8 of it.
    lower, upper
        95 % interval of the objective, Student's t; nan below two samples.
    samples, failed
        Fresh samples, failed ones included, and those that failed: they are left out of the mean.
    mean_radius_ratio
        Mean b/b⁰ of the fresh samples that were completed.
    searched_objective, searched_standard_error
        The search's own, of the samples that it was chosen by, hence biased low.
    """

    string: int
    objective: float
    standard_error: float
    lower: float
    upper: float
    samples: int
    failed: int
    mean_radius_ratio: float
    searched_objective: float
    searched_standard_error: float

    @property
    def known(self) -> bool:
        """Whether there is a value with an error."""
        return math.isfinite(self.objective) and math.isfinite(self.standard_error)


def interval(value: float, error: float, count: int, least: float = 0.0) -> tuple[float, float]:
    """95 % interval of an objective of so many samples that cannot be less than `least`.

    That of the magnitude of a mean is the image of the t interval of the signed mean: where that
    has 0 in it, the lower end is 0. So it covers at least as often, and near 0 up to 97.5 % of the
    time.
    """
    from agglom_mpi.statistics import t_95

    if count < 2 or not math.isfinite(value):
        return math.nan, math.nan
    half = t_95(count - 1) * error
    return max(least, value - half), value + half


def estimates_in(file: "CampaignData", rows: np.ndarray) -> list[Estimate]:
    """Estimate all strings that have fresh samples among all `rows` of a file's; in order of rank.

    The rows are those of `CampaignData.all_sample_rows`.
    """
    if file.fresh_from == file.max_samples:
        return []
    late = timed_out(file.failures(), rows)
    rows = rows[rows["sample"] >= file.fresh_from]
    lost = [string for string, sample in late if sample >= file.fresh_from]
    results = {int(row["string"]): row for row in file.result_rows()}
    strings = sorted({*rows["string"].tolist(), *lost} & results.keys())
    if not strings:
        return []
    law = objective_of(file)
    found = [
        estimate(results[string], rows[rows["string"] == string], lost.count(string), law)
        for string in strings
    ]
    return sorted(found, key=lambda estimate: (estimate.objective, estimate.string))


def estimate(result: np.void, rows: np.ndarray, late: int, law: "Objective") -> Estimate:
    """Estimate a string from its fresh rows of `/samples`; `late` more samples took too long."""
    completed = rows[rows["state"] == COMPLETED]
    value, error = law.of_rows(completed)
    samples = len(rows) + late
    failed = samples - len(completed)
    if 10 * failed > samples:
        value = math.inf
    own = float(result["objective"]), float(result["standard_error"])
    ends = interval(value, error, len(completed), law.least)
    grown = float(completed["mean_radius_ratio"].mean()) if len(completed) else math.nan
    return Estimate(int(result["string"]), value, error, *ends, samples, failed, grown, *own)


def objective_of(file: "CampaignData") -> "Objective":
    """Return the objective that a campaign searched by."""
    from agglom_mpi.search import objectives

    return objectives.objective_of(file.section("objective"), int(file.identity["scene.particles"]))
