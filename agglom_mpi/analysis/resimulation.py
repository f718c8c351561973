"""A recorded campaign, its strings and samples, to be simulated again and compared."""

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from agglom_mpi.config.campaign import Campaign
from agglom_mpi.config.user_function import recorded_function
from agglom_mpi.config.yaml_source import CampaignError, Problem
from agglom_mpi.outcome import COLUMNS
from agglom_mpi.variables import NAMES

if TYPE_CHECKING:
    from agglom_mpi.storage.reader import CampaignData


def recorded_campaign(data: "CampaignData") -> Campaign:
    """Return the campaign that a file is of; a user's objective function cannot be called.

    Raises
    ------
    CampaignError
        If the text in the file is damaged.
    """
    return data.derived(_campaign)


def _campaign(data: "CampaignData") -> Campaign:
    return Campaign.from_text(data.campaign_text, str(data.path), recorded_function(data.identity))


def recorded_parameters(file: "CampaignData", string: int | None) -> npt.NDArray[np.float64]:
    """Read the parameters of a string, shape (10,); a CampaignError if it is none of the file's."""
    rows = file.string_rows()
    for row in rows:
        if row["string"] == string:
            return np.array([row[name] for name in NAMES])
    said = "is missing" if string is None else f"is {string}"
    raise mistaken(file.path, "--string", f"{said}; allowed: 0 to {len(rows) - 1}")


def recorded_sample(file: "CampaignData", string: int, sample: int) -> np.void:
    """Read a row of `/samples`; a CampaignError if there is none."""
    rows = file.sample_rows(string)
    for row in rows:
        if row["sample"] == sample:
            return row
    last = int(rows["sample"].max()) if len(rows) else -1
    message = f"is {sample}, which string {string} does not have; recorded: 0 to {last}"
    raise mistaken(file.path, "--sample", message)


def is_same(stored: np.void, computed: np.void) -> bool:
    """Whether two rows agree, bit for bit, in all that physics determines."""
    return all(
        stored[column.name].tobytes() == computed[column.name].tobytes() for column in COLUMNS
    )


def mistaken(source: object, field: str, message: str) -> CampaignError:
    """Return the error that says what is wrong with an option of a command."""
    return CampaignError(Problem(str(source), None, field, message))
