"""Estimates of the best strings on fresh samples, which no decision has seen."""

import math
import re
from collections.abc import Callable
from functools import wraps
from typing import TYPE_CHECKING, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.formatting import pluralise
from agglom_mpi.outcome import COMPLETED
from agglom_mpi.search.proposals import AGAIN
from agglom_mpi.statistics import t_95, too_many_failed, without_rounding

if TYPE_CHECKING:
    from agglom_mpi.search.objectives.objective import Objective
    from agglom_mpi.storage.reader import CampaignData


Kept = TypeVar("Kept")


def kept(compute: "Callable[[CampaignData], Kept]") -> "Callable[[CampaignData], Kept]":
    """Return a function of a campaign file that computes once for the rows as they are."""

    @wraps(compute)
    def found(data: "CampaignData") -> Kept:
        return data.derived(compute)

    return found


class Estimate(NamedTuple):
    """Estimate of a string on fresh samples; lower objectives are better.

    Attributes
    ----------
    string
    objective, standard_error
        Of the completed fresh samples; inf if there is none or more than 10 % failed, as in an
        ensemble. Their signed mean is unbiased; its magnitude, where that is no
        larger than its error, is too high by up to 0.8 of it.
    lower, upper
        95 % interval of the objective, Student's t; nan below two samples.
    samples, failed
        Fresh samples, failed ones included, and those that failed: they are left out of the mean.
    mean_radius_ratio
        Mean b/b⁰ of the fresh samples that were completed.
    searched_objective, searched_standard_error
        As searched, of the samples that it was chosen by: lucky strings survive.
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
        """Whether the objective and its error are finite."""
        return math.isfinite(self.objective) and math.isfinite(self.standard_error)


def interval(value: float, error: float, count: int, least: float = 0.0) -> tuple[float, float]:
    """Return the 95 % interval of an objective of `count` samples, which is not below `least`.

    That of the magnitude of a mean is the image of the t interval of the signed mean: where that
    has 0 in it, the lower end is 0. So it covers at least as often, and near 0 up to 97.5 % of the
    time.
    """
    if count < 2 or not math.isfinite(value):
        return math.nan, math.nan
    half = t_95(count - 1) * error
    return max(least, value - half), value + half


def half_width(errors: np.ndarray, samples: np.ndarray) -> np.ndarray:
    """Return half of the 95 % intervals by Student's t, (n,); nan below two samples.

    Parameters
    ----------
    errors : (n,) float64
        Standard errors.
    samples : (n,) int
        Number of samples that each rests on.
    """
    known = [t_95(int(n) - 1) if n > 1 else np.nan for n in np.asarray(samples).tolist()]
    return np.asarray(errors, float) * np.array(known, float)


def estimates_of(data: "CampaignData") -> list[Estimate]:
    """Estimate all strings that have fresh samples; in order of the estimated objective."""
    if data.fresh_from == data.max_samples:
        return []
    rows = data.fresh_samples
    timed_out = [string for string, _ in data.fresh_timed_out]
    results = {int(row["string"]): row for row in data.result_rows()}
    strings = sorted({*rows["string"].tolist(), *timed_out} & results.keys())
    if not strings:
        return []
    rounding = rounding_of(data)
    own = {string: rows[rows["string"] == string] for string in strings}
    found = [
        estimate(
            *(results[string], own[string], timed_out.count(string)),
            *(objective_at(data, string), rounding),
        )
        for string in strings
    ]
    return sorted(found, key=lambda estimate: (estimate.objective, estimate.string))


def estimate(
    result: np.void, rows: np.ndarray, timed_out: int, law: "Objective", rounding: float = 0.0
) -> Estimate:
    """Estimate the objective of a string on fresh samples.

    Parameters
    ----------
    result
        The string's row of `/results`.
    rows : (n,) structured array
        Its fresh rows of `/samples`.
    timed_out
        Number of its fresh samples without a row, because they took too long.
    law
        The objective.
    rounding
        Largest objective, and error, that is rounding and taken for 0.
    """
    completed = rows[rows["state"] == COMPLETED]
    value, error = (without_rounding(number, rounding) for number in law.of_rows(completed))
    samples = len(rows) + timed_out
    failed = samples - len(completed)
    if too_many_failed(failed, samples):
        value = math.inf
    own = [
        without_rounding(float(result[name]), rounding) for name in ("objective", "standard_error")
    ]
    ends = interval(value, error, len(completed), law.least)
    grown = float(completed["mean_radius_ratio"].mean()) if len(completed) else math.nan
    return Estimate(int(result["string"]), value, error, *ends, samples, failed, grown, *own)


def completed_rows(data: "CampaignData", string: int, fresh: bool) -> NDArray[np.void]:
    """Return completed samples of a string: fresh ones, or those that its result rests on.

    The result of a parent that got more samples rests on the earlier ones, too; see
    `search.proposals.AGAIN`.
    """
    rows = data.sample_rows(string)
    completed = rows["state"] == COMPLETED
    if fresh:
        return np.asarray(rows[completed & (rows["sample"] >= data.fresh_from)])
    used = rows[completed & (rows["sample"] < data.samples_used.get(string, 0))]
    strings = data.string_rows()
    [row] = strings[strings["string"] == string]
    if row["origin"] != AGAIN:
        return np.asarray(used)
    return np.concatenate([used, completed_rows(data, int(row["parents"][0]), fresh)])


@kept
def rounding_of(data: "CampaignData") -> float:
    """Return the largest difference of a campaign's objectives that is rounding and no result.

    It is 0 for the file of a study, which has no objective.
    """
    if "objective.law" not in data.identity:
        return 0.0
    return objective_of(data).rounding(data.result_rows()["objective"])


def not_converged(data: "CampaignData") -> list[str]:
    """Return a line on the strings of `unconverged`, if there are any."""
    count = unconverged(data)
    return [f"{pluralise(count, 'string')} ended at max_samples, not converged"] if count else []


def unconverged(data: "CampaignData") -> int:
    """Return how many strings ended at the largest number of samples with results that differ.

    A rule that compares an objective with itself is not satisfied by the rounding of equal samples.
    """
    results = data.result_rows()
    differ = ~(results["standard_error"] <= rounding_of(data))
    return int(((results["hit_maximum"] == 1) & differ).sum())


@kept
def objective_of(data: "CampaignData") -> "Objective":
    """Return the objective that a campaign searched by."""
    from agglom_mpi.storage.recorded_campaign import recorded_objective

    grains: float = int(data.identity["scene.particles"])
    if "scene.sizes.law" in data.identity:
        from agglom_mpi.storage.recorded_campaign import recorded_campaign

        grains = recorded_campaign(data).scene.equivalent_grains
    return recorded_objective(data).of_grains(grains)


def is_free_of_noise(data: "CampaignData") -> bool:
    """Return whether the objective is a misfit of data that laws predict without samples."""
    if not objective_of(data).needs_data:
        return False
    from agglom_mpi.measurements.quantities import QUANTITIES

    is_name = re.compile(r"data\.\d+\.quantity").fullmatch
    exact = {name for name, kind in QUANTITIES.items() if kind.is_exact}
    return all(name in exact for key, name in data.identity.items() if is_name(key))


def objective_at(data: "CampaignData", string: int) -> "Objective":
    """Return the same for the samples of a string, which start with its own grains."""
    law = objective_of(data)
    known = string in data.parameters  # or its row is damaged
    if not known or not (law.needs_data or data.variables.has_numbers_of("sizes")):
        return law
    from agglom_mpi.storage.recorded_campaign import recorded_campaign

    return recorded_campaign(data).objective_at(data.parameters[string])
