"""Unbiased estimates of strings that other campaigns have found, in the scene of one question."""

from collections.abc import Iterable, Iterator
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.accuracy.study import Rows, Setup, Study, closed, completed
from agglom_mpi.config.answer_study import AnswerStudy
from agglom_mpi.config.campaign import Campaign
from agglom_mpi.config.identity import STUDY_SEPARATORS, digest
from agglom_mpi.runtime.experiment import SampleSetup
from agglom_mpi.search.objectives.objective import Objective
from agglom_mpi.statistics import MeanEstimate
from agglom_mpi.storage.room import table_sizes

Floats = NDArray[np.float64]

UNLIMITED: Final = 1e300
"""Budget of estimates in particle-steps: all samples are simulated."""
MAX_FAILED_SHARE: Final = 0.1
"""Maximum share of failed samples of an answer, as in an ensemble."""
BOUND_ERRORS: Final = 1.6449
"""Standard errors from an estimate to its one-sided 95 % bound."""


class FreshEstimates(Study):
    """Strings of a question, each on as many samples as its set-up says.

    There may be thousands of them, so that the identity has one digest of all.
    """

    def __init__(self, question: Campaign, setups: dict[str, Setup]) -> None:
        super().__init__(question, setups, UNLIMITED)

    def identity(self) -> dict[str, object]:
        """Return that of the question, and the digest of all set-ups."""
        decides = [dict(setup.identity()) for setup in self.setups.values()]
        each = [digest(entries, STUDY_SEPARATORS) for entries in decides]
        return self.campaign.identity() | {
            "strings": len(each),
            "setups": digest({"all": each}, STUDY_SEPARATORS),
        }

    def kernel_cases(self) -> Iterator[tuple[SampleSetup, NDArray[np.float64]]]:
        """Yield the first set-up: all are of one scene, which needs the same kernels."""
        for setup in list(self.setups.values())[:1]:
            yield self.setup(0), setup.parameters


def first_fresh_sample(study: AnswerStudy) -> int:
    """Return the number of the first sample that no run of a study can have used."""
    sizes = [table_sizes(setting.campaign) for setting in study.settings]
    return max(size.max_samples + size.fresh for size in sizes)


def fresh_setups(study: AnswerStudy, strings: Iterable[Floats]) -> dict[str, Setup]:
    """Return a set-up of each string, (k,), in the scene of the question, by number."""
    first = first_fresh_sample(study)
    return {
        str(number): Setup(*closed(study.question, string), study.samples, first_sample=first)
        for number, string in enumerate(strings)
    }


def estimate_of(objective: Objective, rows: Rows) -> MeanEstimate:
    """Return the objective of samples; inf, like an ensemble's, if too many of them failed."""
    good = completed(rows)
    if len(rows) - len(good) > MAX_FAILED_SHARE * len(rows):
        return MeanEstimate(np.inf, np.nan, len(good))
    return MeanEstimate(*objective.of_rows(good), len(good))


class Floor(NamedTuple):
    """The lowest objective that answers are compared with, and its standard error."""

    value: float
    error: float


def floor_of(objective: Objective, samples: Iterable[Rows]) -> Floor:
    """Return the lowest objective: that of the target, or of the best of strings that are known.

    Where there is no target, the string is chosen by every other sample and estimated by the rest:
    the lowest of many estimates is too low.

    Parameters
    ----------
    objective
    samples
        Of each string.
    """
    if objective.has_target:
        return Floor(objective.least, 0.0)
    halves = [(rows[::2], rows[1::2]) for rows in samples]
    chosen = min(halves, key=lambda pair: estimate_of(objective, pair[0]).value)
    found = estimate_of(objective, chosen[1])
    return Floor(found.value, found.error)


def upper_bound(estimate: MeanEstimate, floor: Floor) -> float:
    """Return the one-sided 95 % bound of an objective above the floor; inf without an estimate.

    An answer that is within a target by this bound is not so by the luck of its re-estimate.
    """
    error = 0.0 if estimate.error == 0.0 else estimate.error
    bound = estimate.value + BOUND_ERRORS * error - floor.value
    return float(bound) if np.isfinite(bound) else np.inf
