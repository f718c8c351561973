"""The order of the best strings of a campaign file."""

from collections.abc import Iterable
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np

from agglom_mpi.analysis.derived import may_have_key, recorded_inversion
from agglom_mpi.analysis.estimates import Estimate, estimates_of, kept, rounding_of
from agglom_mpi.storage.recorded_campaign import recorded_search

if TYPE_CHECKING:
    from agglom_mpi.storage.reader import CampaignData

LISTED: Final = 6
"""Number of strings in a table, unless the campaign sets how many are estimated again."""


class RankedStrings(NamedTuple):
    """The strings with a result, ranked.

    Attributes
    ----------
    results
        Rows of `/results` with a finite objective, by string; objectives and errors that are
        rounding are 0.
    estimates
        Estimates of those that have fresh samples, the best first.
    order
        All strings of `results`, the best first.
    """

    results: dict[int, np.void]
    estimates: list[Estimate]
    order: list[int]

    @property
    def again(self) -> dict[int, Estimate]:
        """Estimates with a finite objective and error, by string."""
        return {each.string: each for each in self.estimates if each.known}


@kept
def rank_strings(data: "CampaignData") -> RankedStrings:
    """Rank the judged strings of a campaign; those with a damaged row are left out."""
    results = data.result_rows()
    known = np.isin(results["string"], data.string_rows()["string"])
    finite = results[known & np.isfinite(results["objective"])]
    order = search_order(data, finite)
    for name in ("objective", "standard_error"):
        finite[name][np.abs(finite[name]) <= rounding_of(data)] = 0.0
    rows = {int(row["string"]): row for row in finite}
    estimates = [estimate for estimate in estimates_of(data) if estimate.string in rows]
    return RankedStrings(rows, estimates, order_by_estimates(order, estimates))


def judged_string(data: "CampaignData", string: int | None) -> int | None:
    """Return `string` if it has a result, or the best one for None; None if none has.

    Raises
    ------
    ValueError
        If it has no result.
    """
    ranked = rank_strings(data)
    if string is None:
        return ranked.order[0] if ranked.order else None
    if string not in ranked.results:
        raise ValueError(f"string is {string}, which is not judged in {data.path}")
    return string


def ranks_itself(data: "CampaignData") -> bool:
    """Return whether a search ranks strings otherwise than by their own objectives.

    It does by a model of all samples, or where parents got more samples under other numbers.
    """
    search = recorded_search(data)
    return search is not None and search.ranks_itself


def search_order(data: "CampaignData", results: np.ndarray) -> list[int]:
    """Return strings in the order of the search, the best first.

    That is by their objectives; of a search that `ranks_itself`, its last population comes first.

    Parameters
    ----------
    data
        The campaign.
    results : (n,) structured array
        Rows of `/results` of the strings.
    """
    order = results["string"][np.lexsort((results["string"], results["objective"]))].tolist()
    last, judged = _last_population(data), set(order)
    first, named = [string for string in last if string in judged], set(last)
    return first + [string for string in order if string not in named]


def _last_population(data: "CampaignData") -> list[int]:
    """Return the last population of a search that `ranks_itself`, the best first; else nothing."""
    generations = data.generation_rows()
    return generations["population"][-1].tolist() if len(generations) and ranks_itself(data) else []


def order_by_estimates(own: list[int], estimates: Iterable[Estimate]) -> list[int]:
    """Return strings in the order of their estimates on fresh samples, the best first.

    Objectives as searched are of the samples that strings were chosen by, and are not compared with
    estimates: strings that have estimates come first, in the order of these, and all others after
    them in the order of the search. But where the search has gone on and its best string has no
    estimate yet, the order is that of the search.

    Parameters
    ----------
    own
        The strings in the order of the search.
    estimates
        Of some of them.
    """
    known = {estimate.string: estimate.objective for estimate in estimates}
    if not own or own[0] not in known:
        return own
    first = sorted((string for string in own if string in known), key=lambda i: (known[i], i))
    return [*first, *(string for string in own if string not in known)]


def places_by(data: "CampaignData") -> list[str]:
    """Return by what each string of `rank_strings` has its place, in their order.

    That is its re-estimate, the search that `ranks_itself`, or the objective of its own samples.
    """
    ranked = rank_strings(data)
    by = dict.fromkeys(_last_population(data), "search")
    again = {estimate.string: "re-estimate" for estimate in ranked.estimates}
    if again.keys() & ranked.order[:1]:  # else the search has gone on
        by |= again
    return [by.get(string, "samples") for string in ranked.order]


def listed_strings(data: "CampaignData") -> int:
    """Return the number of strings in tables: `final.strings` of the campaign, else `LISTED`."""
    if not (may_have_key(data, "final") and may_have_key(data, "strings")):
        return LISTED
    campaign = recorded_inversion(data)
    return LISTED if campaign is None or campaign.final is None else campaign.final.strings
