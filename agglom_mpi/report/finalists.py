"""The best strings estimated again, in words: how biased the search was, and who is really best."""

from collections.abc import Iterator, Sequence
from itertools import combinations
from typing import NamedTuple

import numpy as np

from agglom_mpi.database.estimates import Estimate
from agglom_mpi.report.numbers import with_error
from agglom_mpi.report.pairing import Paired
from agglom_mpi.report.significance import differ
from agglom_mpi.search.mean import Mean


class Verdict(NamedTuple):
    """What the estimates of several strings say together.

    Attributes
    ----------
    first
        The string with the lowest estimate.
    same
        Strings that cannot be told from it at 95 %, in order of rank.
    pairs
        Comparisons that this is corrected for.
    test
        How two are compared: by Welch's t, or by the paired t on common configurations.
    optimism, standard_error
        Mean of estimate minus the search's own objective, and its error by the fresh samples;
        above 0 the search believed its luck.
    """

    first: int
    same: list[int]
    pairs: int
    test: str
    optimism: float
    standard_error: float


def verdict(estimates: Sequence[Estimate], paired: Paired | None = None) -> Verdict | None:
    """Compare estimates, in order of rank; None if there is none with an error.

    Parameters
    ----------
    estimates
        Of strings.
    paired
        The samples behind them if these start from the same random configurations.
    """
    known = [estimate for estimate in estimates if estimate.known]
    if not known:
        return None
    places = range(len(known))
    means = [Mean(e.objective, e.standard_error, e.samples - e.failed) for e in known]
    if paired is None:
        different, test = differ(means), "Welch's t"
        error = float(np.linalg.norm([mean.error for mean in means])) / len(known)
    else:
        strings = [estimate.string for estimate in known]
        differences = {
            (i, j): paired.difference(strings[i], strings[j]) for i, j in combinations(places, 2)
        }
        different, test = differ(means, differences), "paired t on common configurations"
        error = paired.average().error
    same = [known[place].string for place in places[1:] if (0, place) not in different]
    optimism = float(np.mean([e.objective - e.searched_objective for e in known]))
    count = len(known) * (len(known) - 1) // 2
    return Verdict(known[0].string, same, count, test, optimism, error)


def in_words(verdict: Verdict | None, shown: Sequence[int], estimated: int) -> Iterator[str]:
    """Lines on a verdict.

    Parameters
    ----------
    verdict
        None if there are no estimates.
    shown
        Strings of the columns of a table, #1 first.
    estimated
        How many of them were estimated again.
    """
    if verdict is None:
        yield "objectives are the search's own; the lucky survive, so they are biased low"
        return
    by = with_error(abs(verdict.optimism), verdict.standard_error)
    yield (
        "re-estimates are on fresh samples that no decision has seen; the search's own objectives "
        f"are too {'low' if verdict.optimism > 0 else 'high'}, by {by} on average"
    )
    if estimated < len(shown):
        yield "objectives of strings without re-estimate are the search's own, biased low"
    if verdict.pairs:
        yield _comparison(verdict, shown)


def _comparison(verdict: Verdict, shown: Sequence[int]) -> str:
    test = f"at 95 % ({verdict.test}, {verdict.pairs} pair{'s' * (verdict.pairs > 1)}, Holm)"
    places = {string: f"#{place}" for place, string in enumerate(shown, 1)}
    first = places.get(verdict.first, f"string {verdict.first}")
    if not verdict.same:
        return f"{first} is the best of those estimated again, {test}"
    names = [places.get(string, f"string {string}") for string in verdict.same]
    listed = names[-1] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"
    return f"{listed} cannot be told from {first} {test}"
