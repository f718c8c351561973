"""The objective that a file records, and the tolerances of its feasible set."""

from typing import TYPE_CHECKING

from agglom_mpi.config.arguments import mistaken_argument
from agglom_mpi.config.plan import read_tolerance
from agglom_mpi.config.user_function import function_of_means
from agglom_mpi.search.objectives.objective import Objective
from agglom_mpi.storage.recorded_campaign import allowed_function, recorded_component

if TYPE_CHECKING:
    from agglom_mpi.storage.reader import CampaignData


def recorded_objective(data: "CampaignData") -> Objective:
    """Return the objective of a campaign file.

    Raises
    ------
    UnknownComponentError
        If its name is unknown.
    """
    objective = recorded_component(data, "objective", Objective.of_entries)
    return objective.with_code(function_of_means(allowed_function(data), objective.code_of_means))


def tolerance_of(data: "CampaignData", tolerance: float | str) -> float:
    """Return the tolerance of a file's objective; raise an ArgumentError if it is impossible."""
    objective = recorded_objective(data)
    try:
        return read_tolerance(objective, tolerance)
    except ValueError as error:
        raise mistaken_argument(data.path, "tolerance", error) from None
