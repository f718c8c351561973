"""Warm starts: the best strings of an earlier campaign, which a search begins with."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.analysis.ranking import rank_strings
from agglom_mpi.config.campaign import Campaign
from agglom_mpi.config.search import EarlierCampaign
from agglom_mpi.config.yaml_source import CampaignError, Problem, parse
from agglom_mpi.storage.access import NotACampaign
from agglom_mpi.storage.reader import (
    given_strings,
    parameters_of,
    read_campaign,
    read_inversion,
)
from agglom_mpi.storage.verify import row_list


def warm_start_strings(campaign: Campaign, output: Path | None = None) -> NDArray[np.float64]:
    """Return the strings that a campaign is given to begin with, in its box: shape (n, 10).

    Parameters
    ----------
    campaign
        The campaign.
    output
        Its own file. If it holds those strings already, the earlier file is not read.

    Raises
    ------
    CampaignError
        If the earlier file is no campaign, cannot be read, has too few strings, or is needed for
        a lost row and has other best strings by now.
    """
    start = campaign.search.start
    if not isinstance(start, EarlierCampaign):
        return campaign.given_strings()
    begun = None
    if output is not None and output.exists():
        begun = given_strings(read_campaign(output).string_rows())
        if len(begun) == start.strings:
            return parameters_of(begun)
    try:
        strings = _allowed(campaign, start, _in_the_box(campaign, _ranked_strings(start)))
        if begun is not None:
            _check_begun(begun, strings)
    except (NotACampaign, OSError, ValueError) as error:
        line = parse(campaign.text, campaign.name).line(("search", "start"))
        said = (isinstance(error, OSError) and error.strerror) or str(error)
        message = said if isinstance(error, NotACampaign) else f"{start.file}: {said}"
        raise CampaignError(Problem(campaign.name, line, "search.start", message)) from None
    return strings


def _ranked_strings(start: EarlierCampaign) -> NDArray[np.float64]:
    """Return the judged strings of another campaign, ranked as in a report, shape (n, 10)."""
    data = read_inversion(start.file)
    strings, order = data.string_rows(), rank_strings(data).order
    if len(order) < start.strings:
        raise ValueError(f"has {len(order)} judged strings; {start.strings} are asked for")
    return parameters_of(strings[np.searchsorted(strings["string"], order)])


def _allowed(
    campaign: Campaign, start: EarlierCampaign, strings: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return the first ranked strings that satisfy the constraints, as many as are asked for."""
    allowed = strings[campaign.allowed_strings(strings)]
    if len(allowed) < start.strings:
        raise ValueError(
            f"has {len(allowed)} judged strings that satisfy the constraints; "
            f"{start.strings} are asked for"
        )
    return allowed[: start.strings]


def _in_the_box(campaign: Campaign, best: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return strings, (n, 10), clipped to the box, whose variables outside the search are fixed."""
    strings = np.tile(campaign.parameters(), (len(best), 1))
    searched = campaign.variables.lower < campaign.variables.upper
    known = searched & np.isfinite(best)
    strings[known] = best[known]
    return np.clip(strings, campaign.variables.lower, campaign.variables.upper)


def _check_begun(begun: NDArray[np.void], strings: NDArray[np.float64]) -> None:
    """Raise ValueError if the strings that a campaign began with are not those it would get now.

    The earlier campaign may have gone on since, or have new estimates of its best.
    """
    if not np.array_equal(parameters_of(begun), strings[begun["slot"]], equal_nan=True):
        lost = row_list(set(range(len(strings))) - set(begun["slot"].tolist()))
        raise ValueError(
            f"has other best strings now than this campaign began with, of which {lost} is lost"
        )
