"""Selection bias of a search, and which of the best strings differ by their fresh samples.

Strings are compared by paired or Welch tests with Holm's correction.
"""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import reduce
from itertools import combinations
from typing import Final, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.analysis.estimates import Estimate, objective_at
from agglom_mpi.formatting import value_with_error
from agglom_mpi.outcome import COMPLETED
from agglom_mpi.search.objectives.objective import Objective
from agglom_mpi.statistics import Floats, MeanEstimate, mean_of, t_tails, without_rounding
from agglom_mpi.storage.reader import CampaignData

SampleValues = tuple[NDArray[np.int64], Floats]
"""Numbers of the completed samples of a string, ascending, and what each adds to the objective,
which is their mean (delta method); shape (n,)."""
SIGNIFICANCE: Final = 0.05
"""Familywise error rate: probability that any of several equal means is reported to differ."""
CLAIMED_ERRORS: Final = 2.0
"""Standard errors beyond which a difference from the re-estimates is called a bias."""


class PairedSamples:
    """Samples of several strings; those with the same number start from the same configuration.

    Parameters
    ----------
    samples
        By string.
    """

    def __init__(self, samples: Mapping[int, SampleValues]) -> None:
        self._samples = samples

    @classmethod
    def behind(cls, estimates: Iterable[Estimate], data: CampaignData) -> Self | None:
        """Return the fresh samples behind estimates; None if strings do not share configurations.

        They do if the campaign has `common_configurations`.
        """
        if not data.identity.get("ensemble.common_configurations", False):
            return None
        fresh = data.fresh_samples
        fresh = fresh[fresh["state"] == COMPLETED]
        strings = [estimate.string for estimate in estimates if estimate.known]
        return cls(
            {i: sample_values(objective_at(data, i), fresh[fresh["string"] == i]) for i in strings}
        )

    def difference(self, one: int, other: int) -> MeanEstimate:
        """Return the objective of `one` minus that of `other`, over the samples that both have."""
        numbers = self._shared([one, other])
        return mean_of(self._values(one, numbers) - self._values(other, numbers))

    def average(self) -> MeanEstimate:
        """Return the mean objective of all strings, over the samples that all have."""
        strings = list(self._samples)
        numbers = self._shared(strings)
        return mean_of(np.mean([self._values(string, numbers) for string in strings], axis=0))

    def _shared(self, strings: list[int]) -> NDArray[np.int64]:
        return reduce(np.intersect1d, (self._samples[string][0] for string in strings))

    def _values(self, string: int, numbers: NDArray[np.int64]) -> Floats:
        own, values = self._samples[string]
        return values[np.searchsorted(own, numbers)]


def sample_values(law: Objective, rows: NDArray[np.void]) -> SampleValues:
    """Return what the completed samples of one string, rows of `/samples`, add to an objective.

    An objective that is the magnitude of a mean has the sign of that mean put on the values, so
    that their mean is the objective.
    """
    values = law.influence_values(law.summaries(rows))
    return rows["sample"].astype(np.int64), math.copysign(1.0, values.mean()) * values


def significant_differences(
    means: Sequence[MeanEstimate],
    differences: Mapping[tuple[int, int], MeanEstimate] | None = None,
    rounding: float = 0.0,
) -> set[tuple[int, int]]:
    """Return the pairs of indices (i, j), i < j, of means that differ at 95 %.

    The correction (Holm 1979) counts all pairs, so that it holds for comparisons with the best one,
    too, though the data decide which one that is.

    Parameters
    ----------
    means
        Their samples are independent of each other, unless there are `differences`.
    differences
        Of each pair of means, if their samples are paired.
    rounding
        Largest difference that is rounding: such means are equal.
    """
    pairs = list(combinations(range(len(means)), 2))
    if differences is None:
        chances = {(i, j): p_value(means[i], means[j], rounding) for i, j in pairs}
    else:
        chances = {pair: paired_p_value(differences[pair], rounding) for pair in pairs}
    tested = sorted((chance, pair) for pair, chance in chances.items())
    found: set[tuple[int, int]] = set()
    for left, (chance, pair) in zip(range(len(tested), 0, -1), tested, strict=True):
        if chance > SIGNIFICANCE / left:
            break
        found.add(pair)
    return found


def p_value(one: MeanEstimate, other: MeanEstimate, rounding: float = 0.0) -> float:
    """Return the two-sided p-value of the hypothesis that two means are equal (Welch 1947).

    It is 1 where they differ by no more than `rounding`.
    """
    variances = one.error**2, other.error**2
    total, freedom = sum(variances), math.nan
    if total > 0.0:
        shares = (variances[0] / total) ** 2, (variances[1] / total) ** 2
        freedom = 1.0 / (shares[0] / (one.samples - 1) + shares[1] / (other.samples - 1))
    return _tails(abs(one.value - other.value), math.sqrt(total), freedom, rounding)


def paired_p_value(difference: MeanEstimate, rounding: float = 0.0) -> float:
    """Return the two-sided p-value of the hypothesis that a mean of paired differences is 0.

    It holds however the samples of a pair depend on each other; it is 1 below two pairs, and where
    the difference is no larger than `rounding`.
    """
    value, error, samples = difference
    return 1.0 if samples < 2 else _tails(value, error, samples - 1.0, rounding)


def _tails(difference: float, error: float, freedom: float, rounding: float) -> float:
    if abs(difference) <= rounding:
        return 1.0
    return t_tails(difference / error, freedom) if error != 0.0 else 0.0


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
