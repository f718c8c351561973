"""Which criterion each objective has, and which tolerances it takes."""

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np

from agglom_mpi.config.arguments import read_amount, read_fraction, shown
from agglom_mpi.config.yaml_source import ArgumentError
from agglom_mpi.errors import UserError
from agglom_mpi.inference.criteria import Band, Criterion, MomentBands, NearMaximum

if TYPE_CHECKING:
    from agglom_mpi.storage.reader import CampaignData

Entries = Mapping[str, Any]
"""The `objective` section of a campaign as plain values."""


class UnknownObjectiveError(UserError, ValueError):
    """An objective that has no criterion."""


def _growth_target(objective: Entries, tolerance: float) -> Criterion:
    ratio = float(objective["ratio"])
    lower, upper = ratio * (1.0 - tolerance), ratio * (1.0 + tolerance)
    text = f"mean b/b0 {_ends(lower, upper)}"
    return Band("mean_radius_ratio", lower, upper, text)


def _maximum_growth(objective: Entries, tolerance: float) -> Criterion:
    return NearMaximum(tolerance)


def _moments(objective: Entries, tolerance: float) -> Criterion:
    return MomentBands(objective["targets"], tolerance)


def _function(objective: Entries, tolerance: float) -> Criterion:
    text = f"mean value of the function at most {tolerance:.4g}"
    return Band("objective", -np.inf, tolerance, text)


def _fraction(objective: Entries, tolerance: float | str) -> float:
    return read_fraction(tolerance)


def _moment_tolerance(objective: Entries, tolerance: float | str) -> float:
    """Return a fraction, or a positive number where all targets are 0."""
    if any(objective["targets"].values()):
        return read_fraction(tolerance)
    value = read_amount(tolerance).value
    if value <= 0.0:
        raise ValueError(f"is {shown(tolerance)}; must be greater than 0")
    return value


def _largest_value(objective: Entries, tolerance: float | str) -> float:
    return read_amount(tolerance).value


class ObjectiveCriterion(NamedTuple):
    """Criterion of an objective.

    Attributes
    ----------
    read_tolerance
        Returns a tolerance, given as a number or a text; raises a ValueError if it is impossible.
    criterion
        Returns the criterion with a tolerance.
    """

    read_tolerance: Callable[[Entries, float | str], float]
    criterion: Callable[[Entries, float], Criterion]


CRITERIA: Final = {
    "growth_target": ObjectiveCriterion(_fraction, _growth_target),
    "maximum_growth": ObjectiveCriterion(_fraction, _maximum_growth),
    "moments": ObjectiveCriterion(_moment_tolerance, _moments),
    "function": ObjectiveCriterion(_largest_value, _function),
}
"""Criteria by the names of the objectives."""


def _known(objective: Entries) -> ObjectiveCriterion:
    name = objective["law"]
    if name not in CRITERIA:
        known = ", ".join(CRITERIA)
        raise UnknownObjectiveError(f"objective {name!r} has no feasible set; known: {known}")
    return CRITERIA[name]


def read_tolerance(objective: Entries, tolerance: float | str) -> float:
    """Return the tolerance of an objective, given as a number or a text such as `5%`.

    It is a fraction between 0 and 1, relative to the target or to the maximum. Of moments whose
    targets are all 0 it is a positive number, of a function any number, its largest value.

    Raises
    ------
    UnknownObjectiveError
        If the objective has no criterion.
    ValueError
        If the tolerance is something else.
    """
    return _known(objective).read_tolerance(objective, tolerance)


def criterion_of(objective: Entries, tolerance: float) -> Criterion:
    """Return the criterion of an objective with a tolerance, as `read_tolerance` returns it.

    Raises
    ------
    UnknownObjectiveError
        If the objective has none.
    """
    return _known(objective).criterion(objective, tolerance)


def tolerance_of(data: "CampaignData", tolerance: float | str) -> float:
    """Return the tolerance of a file's objective; raise an ArgumentError if it is impossible."""
    try:
        return read_tolerance(data.section("objective"), tolerance)
    except UnknownObjectiveError:
        raise
    except ValueError as error:
        raise ArgumentError.of(data.path, "tolerance", error) from None


def _ends(lower: float, upper: float) -> str:
    """Return `LOWER to UPPER` with four digits, or with as many as distinguish them."""
    texts = ((f"{lower:.{digits}g}", f"{upper:.{digits}g}") for digits in range(4, 18))
    return " to ".join(next((pair for pair in texts if pair[0] != pair[1]), (f"{lower:g}",) * 2))
