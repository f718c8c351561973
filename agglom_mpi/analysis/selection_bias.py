"""Selection bias of a search: what re-estimates say of its own objectives, and of the order."""

import math
from collections.abc import Iterator, Sequence
from itertools import combinations
from typing import Final, NamedTuple

import numpy as np

from agglom_mpi.analysis.comparison import PairedSamples, significant_differences
from agglom_mpi.analysis.estimates import Estimate
from agglom_mpi.formatting import value_with_error
from agglom_mpi.statistics import MeanEstimate, without_rounding

CLAIMED_ERRORS: Final = 2.0
"""Standard errors beyond which a difference from the re-estimates is called a bias."""


class SelectionBias(NamedTuple):
    """Selection bias of the search, and which of the best strings differ significantly.

    Attributes
    ----------
    first
        String with the lowest estimate.
    same
        Strings that do not differ from it at 95 %, in order of rank.
    pairs
        Number of comparisons that the test is corrected for.
    test
        The test: Welch's t, or the paired t on common configurations.
    optimism
        Mean of estimate minus the search's own objective, positive if that is too low.
    standard_error
        Of the optimism, by the samples of both; nan where a string was searched by one sample.
    """

    first: int
    same: list[int]
    pairs: int
    test: str
    optimism: float
    standard_error: float

    @property
    def is_bias(self) -> bool:
        """Whether the optimism is larger than two of its standard errors."""
        return abs(self.optimism) > CLAIMED_ERRORS * self.standard_error  # never of nan


def selection_bias(
    estimates: Sequence[Estimate], paired: PairedSamples | None = None, rounding: float = 0.0
) -> SelectionBias | None:
    """Return the selection bias by estimates, in order of rank; None if none has an error.

    Parameters
    ----------
    estimates
        On fresh samples.
    paired
        Their samples, if strings share configurations.
    rounding
        Largest difference of objectives that is rounding: they are equal.
    """
    known = [estimate for estimate in estimates if estimate.known]
    if not known:
        return None
    places = range(len(known))
    means = [MeanEstimate(e.objective, e.standard_error, e.samples - e.failed) for e in known]
    searched = [estimate.searched_standard_error for estimate in known]
    if paired is None:
        different, test = significant_differences(means, rounding=rounding), "Welch's t"
        errors = (_independent([mean.error for mean in means]), _independent(searched))
    else:
        strings = [estimate.string for estimate in known]
        differences = {
            (i, j): paired.difference(strings[i], strings[j]) for i, j in combinations(places, 2)
        }
        different, test = (
            significant_differences(means, differences, rounding),
            "paired t on common configurations",
        )
        # Strings that share configurations share their luck: at worst, errors do not average out.
        errors = (paired.average().error, float(np.mean(searched)))
    same = [known[place].string for place in places[1:] if (0, place) not in different]
    difference = float(np.mean([e.objective - e.searched_objective for e in known]))
    optimism = without_rounding(difference, rounding)
    count = len(known) * (len(known) - 1) // 2
    return SelectionBias(known[0].string, same, count, test, optimism, math.hypot(*errors))


def _independent(errors: Sequence[float]) -> float:
    """Return the standard error of the mean of independent numbers with these errors."""
    return float(np.linalg.norm(errors)) / len(errors)


def describe_bias(
    verdict: SelectionBias | None, shown: Sequence[int], estimated: int
) -> Iterator[str]:
    """Yield notes on the selection bias, as lines of text.

    Parameters
    ----------
    verdict
        None if there are no estimates.
    shown
        Strings of the columns of a table, #1 first.
    estimated
        Number of them that have estimates.
    """
    if verdict is None:
        yield (
            "objectives are as searched, and too low on average because lucky strings survive; "
            "`final` in the campaign adds re-estimates on fresh samples"
        )
        return
    yield f"re-estimates use fresh samples only; {_optimism(verdict)}"
    if estimated < len(shown):
        yield (
            f"{estimated} of {len(shown)} strings were estimated again; the others follow in the "
            "order of the search, whose objectives are too low on average"
        )
    if verdict.pairs:
        yield _comparison(verdict, shown)


def _optimism(verdict: SelectionBias) -> str:
    """Return what the re-estimates say of the search's own objectives."""
    size = abs(verdict.optimism)
    by = value_with_error(size, verdict.standard_error)
    if verdict.is_bias:
        direction = "low" if verdict.optimism > 0 else "high"
        return f"the search's own objectives are too {direction}, by {by} on average"
    if size == 0.0:
        return "they equal the search's own objectives"
    found = f"they are {'higher' if verdict.optimism > 0 else 'lower'} by {by} on average"
    if math.isnan(verdict.standard_error):
        reason = "strings searched by a single sample have no standard error"
        return f"{found}, and no bias can be claimed: {reason}"
    return f"{found}, within two standard errors, so no bias is shown"


def _comparison(verdict: SelectionBias, shown: Sequence[int]) -> str:
    test = f"at 95 % ({verdict.test}, {verdict.pairs} pair{'s' * (verdict.pairs > 1)}, Holm)"
    places = {string: f"#{place}" for place, string in enumerate(shown, 1)}
    first = places.get(verdict.first, f"string {verdict.first}")
    if not verdict.same:
        return f"{first} is the best of those estimated again, {test}"
    names = [places[string] for string in verdict.same if string in places]
    others = [f"string {string}" for string in verdict.same if string not in places]
    names += others if len(others) < 2 else [f"{len(others)} strings that are not listed"]
    listed = names[-1] if len(names) == 1 else f"{', '.join(names[:-1])} and {names[-1]}"
    do = "does" if len(verdict.same) == 1 else "do"
    return f"{listed} {do} not differ significantly from {first} {test}"
