"""The campaign file: typed, unit-aware, every error with file, line and field."""

from agglom_mpi.campaign.load import Campaign, check_campaign, load_campaign
from agglom_mpi.campaign.source import CampaignError

__all__ = ["Campaign", "CampaignError", "check_campaign", "load_campaign"]
