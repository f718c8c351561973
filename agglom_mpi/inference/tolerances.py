"""The objective that a file records, and the tolerances of its feasible set."""

from typing import TYPE_CHECKING, Final

from agglom_mpi.config.arguments import mistaken_argument, read_amount, read_fraction, shown
from agglom_mpi.config.user_function import function_of_means
from agglom_mpi.search.objectives.objective import Objective
from agglom_mpi.storage.recorded_campaign import allowed_function, recorded_component

if TYPE_CHECKING:
    from agglom_mpi.storage.reader import CampaignData

DEFAULT_TOLERANCE: Final = 0.05
"""Tolerance of a set that none is given for."""


def recorded_objective(data: "CampaignData") -> Objective:
    """Return the objective of a campaign file.

    Raises
    ------
    UnknownComponentError
        If its name is unknown.
    """
    objective = recorded_component(data, "objective", Objective.of_entries)
    return objective.with_code(function_of_means(allowed_function(data), objective.code_of_means))


def read_tolerance(objective: Objective, tolerance: float | str) -> float:
    """Return the tolerance of an objective, given as a number or a text such as `5%`.

    It is a fraction between 0 and 1, relative to the target or to the maximum, unless the limits of
    the objective are others.

    Raises
    ------
    ValueError
        If it is something else.
    """
    lower, upper = objective.tolerance_limits
    if upper == 1.0:
        return read_fraction(tolerance)
    value = read_amount(tolerance).value
    if value <= lower:
        raise ValueError(f"is {shown(tolerance)}; must be greater than {lower:g}")
    return value


def tolerance_of(data: "CampaignData", tolerance: float | str) -> float:
    """Return the tolerance of a file's objective; raise an ArgumentError if it is impossible."""
    objective = recorded_objective(data)
    try:
        return read_tolerance(objective, tolerance)
    except ValueError as error:
        raise mistaken_argument(data.path, "tolerance", error) from None
