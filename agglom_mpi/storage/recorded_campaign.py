"""The campaign that a file records."""

from typing import TYPE_CHECKING

from agglom_mpi.config import loading
from agglom_mpi.config.campaign import Campaign
from agglom_mpi.storage.recorded_code import allowed_function, recorded_reading

if TYPE_CHECKING:
    from agglom_mpi.storage.reader import CampaignData


def recorded_campaign(data: "CampaignData") -> Campaign:
    """Return the campaign of a file; a user's function is called only if the file's is `allowed`.

    Raises
    ------
    CampaignError
        If the text in the file is damaged.
    """
    return data.derived(_campaign)


def _campaign(data: "CampaignData") -> Campaign:
    return loading.campaign_of_record(
        data.campaign_text,
        str(data.path),
        data.identity,
        recorded_reading(data).own,
        allowed_function(data),
    )
