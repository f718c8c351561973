"""The strings that a search begins with, where they are the best of an earlier campaign."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.campaign import Campaign, CampaignError
from agglom_mpi.campaign.search import EarlierCampaign
from agglom_mpi.campaign.source import Problem, parse
from agglom_mpi.database.access import NotACampaign
from agglom_mpi.database.contents import given_rows, strings_of
from agglom_mpi.database.reader import open_campaign, open_inversion


def strings_to_begin_with(campaign: Campaign, output: Path | None = None) -> NDArray[np.float64]:
    """Return the strings that a campaign is given to begin with, in its box: shape (n, 10).

    Parameters
    ----------
    campaign
        The campaign.
    output
        Its own file; if it has begun, what it began with counts, whatever became of the other.

    Raises
    ------
    CampaignError
        If the earlier campaign's file is none, cannot be read, or has too few strings.
    """
    start = campaign.search.start
    if not isinstance(start, EarlierCampaign):
        return campaign.given_strings()
    if output is not None and output.exists():
        begun = strings_of(given_rows(open_campaign(output).string_rows()))
        if len(begun) == start.strings:
            return begun
    try:
        best = _best_strings(start)
    except (NotACampaign, OSError, ValueError) as error:
        line = parse(campaign.text, campaign.name).line(("search", "start"))
        said = (isinstance(error, OSError) and error.strerror) or str(error)
        message = said if isinstance(error, NotACampaign) else f"{start.file}: {said}"
        raise CampaignError(Problem(campaign.name, line, "search.start", message)) from None
    strings = np.tile(campaign.parameters(), (start.strings, 1))
    searched = campaign.variables.lower < campaign.variables.upper
    known = searched & np.isfinite(best)
    strings[known] = best[known]
    return np.clip(strings, campaign.variables.lower, campaign.variables.upper)


def _best_strings(start: EarlierCampaign) -> NDArray[np.float64]:
    """Return the best strings of the last generation of another campaign, shape (n, 10)."""
    file = open_inversion(start.file)
    generations, strings = file.generation_rows(), file.string_rows()
    ranked = generations["population"][-1] if len(generations) else []
    if len(ranked) < start.strings:
        raise ValueError(f"has {len(ranked)} ranked strings; {start.strings} are asked for")
    rows = strings[np.searchsorted(strings["string"], ranked[: start.strings])]
    return strings_of(rows)
