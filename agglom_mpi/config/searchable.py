"""Checks whether a campaign can be searched: ranges, constraints, given strings, and library."""

import logging
from typing import TYPE_CHECKING, Final

import numpy as np
import numpy.typing as npt

from agglom_mpi.config.allowed_share import LEAST_SHARE, SMALL_SHARE, allowed_share
from agglom_mpi.config.yaml_source import CampaignError, MissingSearchLibraryError, Problem, parse
from agglom_mpi.errors import MissingLibraryError, require_library

if TYPE_CHECKING:
    from agglom_mpi.config.campaign import Campaign

LOG: Final = logging.getLogger(__name__)


def check_start(campaign: "Campaign", strings: npt.NDArray[np.float64]) -> None:
    """Raise a CampaignError if strings that `search.start` lists, (n, k), break a constraint."""
    table, problems = campaign.variables, []
    for i, string in enumerate(strings):
        columns = table.columns_by_name(string[None])
        for broken in campaign.relations.broken(campaign.scenes, columns):
            message = f"does not satisfy the constraint '{broken}'"
            problems.append((("search", "start", i), message))
    if problems:
        source = parse(campaign.text, campaign.name)
        raise CampaignError(*(source.problem(*found) for found in problems))


def check_searchable(campaign: "Campaign") -> list[Problem]:
    """Return warnings about constraints that allow little of the box.

    Raises
    ------
    CampaignError
        Unless a variable is a range, and constraints leave something.
    """
    if campaign.plan is None or not campaign.variables.searched:
        raise campaign.search_error()
    return check_constraints(campaign)


def log_narrow(campaign: "Campaign") -> None:
    """Log the warnings of `check_searchable`, for what has no other place for them."""
    for problem in check_searchable(campaign):
        LOG.warning("warning: %s", problem)


def check_constraints(campaign: "Campaign") -> list[Problem]:
    """Return warnings about constraints that allow little of the box.

    Raises
    ------
    CampaignError
        If they allow so little that nothing can be searched.
    """
    if not campaign.relations.constraints:
        return []
    share = allowed_share(campaign)
    if share.value >= SMALL_SHARE:
        return []
    source, path = parse(campaign.text, campaign.name), ("constraints",)
    if share.value < LEAST_SHARE:
        message = f"allow {share} of the box; must allow at least {LEAST_SHARE:.2%} of it"
        raise CampaignError(source.problem(path, message))
    message = f"allow {share} of the box; a narrower box is searched better"
    return [source.problem(path, message)]


def check_search_library(campaign: "Campaign") -> None:
    """Raise a MissingSearchLibraryError unless the search's library is installed."""
    search = campaign.search
    if search.library is None:
        return
    try:
        require_library(search.library, "search", f"{search.name} searches")
    except MissingLibraryError as error:
        message = f"is {search.name!r}; {error}"
        problem = parse(campaign.text, campaign.name).problem(("search", "method"), message)
        raise MissingSearchLibraryError(problem) from None
