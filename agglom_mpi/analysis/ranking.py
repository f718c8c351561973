"""The order of the best strings of a campaign file."""

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from agglom_mpi.analysis.estimates import Estimate, estimates_of

if TYPE_CHECKING:
    from agglom_mpi.storage.reader import CampaignData


class RankedStrings(NamedTuple):
    """Strings that are judged.

    Attributes
    ----------
    results
        By string, rows of `/results` with a finite objective, if the string itself is there.
    estimates
        Those of them that were estimated again, in order of that.
    order
        All of them, the best first.
    """

    results: dict[int, np.void]
    estimates: list[Estimate]
    order: list[int]


def rank_strings(data: "CampaignData") -> RankedStrings:
    """Rank the judged strings of a campaign; those with a damaged row are left out."""
    return data.derived(_rank)


def _rank(data: "CampaignData") -> RankedStrings:
    results = data.result_rows()
    known = np.isin(results["string"], data.string_rows()["string"])
    finite = results[known & np.isfinite(results["objective"])]
    rows = {int(row["string"]): row for row in finite}
    estimates = [estimate for estimate in estimates_of(data) if estimate.string in rows]
    return RankedStrings(rows, estimates, ranking(own_order(data, finite), estimates))


def judged_string(data: "CampaignData", string: int | None) -> int | None:
    """Return a string that is judged, the best one for None; None if none is.

    Raises
    ------
    ValueError
        If it is not judged.
    """
    ranked = rank_strings(data)
    if string is None:
        return ranked.order[0] if ranked.order else None
    if string not in ranked.results:
        raise ValueError(f"string is {string}, which is not judged in {data.path}")
    return string


def ranks_itself(identity: Mapping[str, object]) -> bool:
    """Tell whether a search knows better than the objectives of all strings which are the best.

    That is by a model of all samples, or as parents got more samples under other numbers.
    """
    return identity.get("search.method") == "surrogate" or "search.more_samples" in identity


def own_order(data: "CampaignData", results: np.ndarray) -> list[int]:
    """Order judged strings, rows of `/results`, as the search has them, the best first.

    That is by their objectives, but the last ranks of a search come first that knows better.
    """
    order = results["string"][np.lexsort((results["string"], results["objective"]))].tolist()
    if not ranks_itself(data.identity):
        return order
    generations, judged = data.generation_rows(), set(order)
    last = generations["population"][-1].tolist() if len(generations) else []
    first, named = [string for string in last if string in judged], set(last)
    return first + [string for string in order if string not in named]


def ranking(own: list[int], estimates: Iterable[Estimate]) -> list[int]:
    """Order judged strings, the best first; those without a finite objective come last.

    Own objectives are too low for those that were lucky, so they are not compared with estimates:
    strings that were estimated again come in the order of that, and all others after them as the
    search has them. But where the search has gone on and the string that it likes best was not
    estimated yet, the order is the search's own.

    Parameters
    ----------
    own
        All of them, in the search's own order.
    estimates
        Of some of them.
    """
    again = {estimate.string: estimate.objective for estimate in estimates}
    if not own or own[0] not in again:
        return own
    first = sorted((string for string in own if string in again), key=lambda i: (again[i], i))
    return [*first, *(string for string in own if string not in again)]
