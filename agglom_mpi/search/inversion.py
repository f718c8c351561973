"""The decisions of a campaign, independent of the order in which samples arrive."""

import math
from collections.abc import Callable, Iterable, Iterator, Mapping

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.judge import EnsembleMeans, Judge
from agglom_mpi.outcome import SampleSummary, summaries
from agglom_mpi.search.ending import EndingCriterion
from agglom_mpi.search.ensemble import Ensemble, EnsembleResult
from agglom_mpi.search.methods.method import RunningSearch
from agglom_mpi.search.proposals import (
    AGAIN,
    Decision,
    Evaluations,
    GenerationSummary,
    Progress,
    Proposals,
    StringEvaluated,
    StringsProposed,
)
from agglom_mpi.search.racing import Racing
from agglom_mpi.search.sample_paths import SampleBatch, SamplePart, WaitingSamples, extend
from agglom_mpi.statistics import Floats, MeanEstimate


class Inversion:
    """Drive a search with samples that arrive in any order.

    Strings are numbered 0, 1, 2, … in the order of proposal. Samples of a string are used in order
    0, 1, 2, …: early ones wait, those after the ensemble's end are ignored, and of several copies
    the first counts. Samples of strings that are not proposed yet wait too. So a resume may hand
    over all it has at once, before `start`, and strings proposed ahead may be simulated before
    their generation begins.

    `start` and `complete` are generators: a decision is made, and the next one begun, as the
    caller asks for it. Whoever calls them must exhaust them before the next call.

    Parameters
    ----------
    search
        The method, with nothing told yet.
    make_ensemble
        Makes an empty ensemble for a string, shape (k,).
    ending
        When to stop.
    restore
        Replaces proposals, given the number of their first string, by what an earlier leg of the
        campaign has stored of them; None keeps them.
    signed
        Returns the signed mean whose magnitude is the objective of a result; by default the
        objective itself.
    racing
        When to drop strings that will not be kept; None never does.
    more_samples
        Number of additional samples of a string that is proposed again.
    summarise
        Returns the summaries of rows of samples.

    Attributes
    ----------
    generation
        Number of the generation under way.
    results
        Results of the evaluated strings, by number.
    ended_by
        The criterion that holds once all is decided; None before.
    """

    def __init__(
        self,
        search: RunningSearch,
        make_ensemble: Callable[[Floats], Ensemble],
        ending: EndingCriterion,
        restore: Callable[[Proposals, int], Proposals] | None = None,
        signed: Callable[[EnsembleResult], float] = lambda result: result.objective,
        racing: Racing | None = None,
        more_samples: int = 1,
        summarise: Callable[[NDArray[np.void]], list[SampleSummary]] = summaries,
    ) -> None:
        self.generation = 0
        self.results: dict[int, EnsembleResult] = {}
        self.ended_by: EndingCriterion | None = None
        self._search = search
        self._make_ensemble = make_ensemble
        self._ending = ending
        self._restore = restore
        self._signed = signed
        self._racing = racing
        self._more_samples = more_samples
        self._summarise = summarise
        self._top = ending.best_strings or search.parents
        self._strings: list[Floats] = []  # of all generations that have begun
        self._strings_ahead: dict[int, Floats] = {}
        self._last_ahead = 0  # generation that was proposed ahead last
        self._numbers = np.empty(0, np.int64)  # of this generation
        self._origins = np.empty(0, np.int8)
        self._parents: list[int] = []
        self._round = 0  # of the race
        self._open: dict[int, Ensemble] = {}
        self._ahead: dict[int, Ensemble] = {}
        self._ended: dict[int, Ensemble] = {}
        self._waiting = WaitingSamples()
        self._samples_used = 0

    @property
    def finished(self) -> bool:
        """Whether there is nothing left to decide."""
        return self.ended_by is not None

    @property
    def open_strings(self) -> Mapping[int, Progress]:
        """Strings of this generation that need samples, in order of number."""
        return {
            string: Progress(ensemble.samples_used, ensemble.max_samples)
            for string, ensemble in self._open.items()
        }

    @property
    def open_count(self) -> int:
        """Number of strings in `open_strings`."""
        return len(self._open)

    def progress(self, string: int) -> Progress | None:
        """Return the progress of an open string or one proposed ahead; None once it is complete."""
        ensemble = self._live(string)
        if ensemble is None or ensemble.finished:
            return None
        return Progress(ensemble.samples_used, ensemble.max_samples)

    def judged_from(self, string: int) -> EnsembleMeans | None:
        """Return the running means of a live string that ranks may end; None if they may not."""
        ensemble = self._live(string)
        assert ensemble is not None
        if not (ensemble.follows_means and ensemble.has_judge):
            return None
        return ensemble.means

    def judge(self, string: int, means: EnsembleMeans, samples: int) -> Judge:
        """Return what ends a string with `judged_from`, after its next `samples` at the latest."""
        ensemble = self._live(string)
        assert ensemble is not None
        return ensemble.judge(means, samples)

    def samples_used(self, string: int) -> int:
        """Return the number of samples that a complete string has used."""
        ahead = self._ahead.get(string)
        return self.results[string].samples_used if ahead is None else ahead.samples_used

    def ranked(self) -> list[int]:
        """Return the strings that the search ranks, the best first."""
        return [ranked.string for ranked in self._search.best(len(self.results))]

    def parameters(self, string: int) -> Floats:
        """Return a string of this or an earlier generation, or one proposed ahead, shape (k,)."""
        if string < len(self._strings):
            return self._strings[string]
        return self._strings_ahead[string]

    def start(self) -> Iterator[Decision]:
        """Propose the first generation, and decide what samples that wait already decide."""
        yield from self._propose()
        yield from self._advance()

    def propose_ahead(self, generations: int) -> StringsProposed | None:
        """Propose those strings of one more coming generation that depend on no further result.

        Parameters
        ----------
        generations
            Largest number of generations between this one and the coming one.

        Returns
        -------
        StringsProposed or None
            The strings, which need samples from now on; None if all are proposed, or if the search
            does not know more of them yet.
        """
        coming = max(self._last_ahead, self.generation) + 1
        if self.finished or coming >= min(
            self._ending.max_generations, self.generation + generations + 1
        ):
            return None
        known = self._search.known_proposals(coming)
        if known is None:
            return None
        first, proposals = known
        if self._restore is not None:
            proposals = self._restore(proposals, first)
        numbers = np.arange(first, first + len(proposals.parameters))
        self._strings_ahead.update(zip(numbers.tolist(), proposals.parameters, strict=True))
        self._last_ahead = coming
        for string, parameters in zip(numbers.tolist(), proposals.parameters, strict=True):
            self._ahead[string] = self._make_ensemble(parameters)
        self._add_waiting(numbers.tolist())
        return StringsProposed(proposals, numbers, ahead=True)

    def complete(self, string: int, first: int, samples: NDArray[np.void]) -> Iterator[Decision]:
        """Take consecutive samples of a string, and yield the decisions that follow, in order.

        Parameters
        ----------
        string
            Its number.
        first
            Number of the first of the samples.
        samples
            Rows with the columns of `outcome.OUTCOME` and, where the objective needs it,
            `objective`, shape (n,).
        """
        yield from self.complete_all(samples, [(string, first, 0, len(samples))])

    def complete_all(
        self, samples: NDArray[np.void], parts: Iterable[tuple[int, int, int, int]]
    ) -> Iterator[Decision]:
        """Take samples of several strings at once.

        Parameters
        ----------
        samples
            As for `complete`, of any strings, shape (n,).
        parts
            Ranges of them that are consecutive samples of one string: its number, that of the first
            sample, and begin and end of the range in `samples`.
        """
        batch = SampleBatch(samples, self._summarise)
        strings: dict[int, None] = {}
        for string, first, begin, end in parts:
            if self._keep(string, first, SamplePart(batch, begin, end)):
                strings[string] = None
        self._add_waiting(strings)
        if any(string in self._open for string in strings):
            yield from self._close_finished(strings)
            yield from self._advance()

    def _keep(self, string: int, first: int, part: SamplePart) -> bool:
        """Let samples wait for their turn; return False if nobody needs them."""
        ensemble = self._live(string)
        if ensemble is None:
            used = 0
            if self.finished or string < len(self._strings):
                return False
        else:
            used = ensemble.samples_used
            if self.finished or ensemble.finished:
                return False
        self._waiting.add(string, first, part, used)
        return True

    def _live(self, string: int) -> Ensemble | None:
        """Return the ensemble of a string that is open or proposed ahead."""
        return self._open.get(string) or self._ahead.get(string)

    def _propose(self) -> Iterator[Decision]:
        proposals = self._search.ask()
        first = len(self._strings)
        if self._restore is not None:
            proposals = self._restore(proposals, first)
        self.generation = proposals.generation
        self._numbers = np.arange(first, first + len(proposals.parameters))
        self._origins = proposals.origin
        yield StringsProposed(proposals, self._numbers, ahead=False)
        self._strings.extend(proposals.parameters)
        self._open = {}
        self._round = 0
        if self._racing is not None and self.generation:
            self._parents = [ranked.string for ranked in self._search.best(self._search.parents)]
        for place, string in enumerate(self._numbers.tolist()):
            self._strings_ahead.pop(string, None)
            ahead = self._ahead.pop(string, None)
            self._open[string] = self._ensemble(proposals, place) if ahead is None else ahead
        self._add_waiting(self._open)
        yield from self._close_finished(self._open)

    def _ensemble(self, proposals: Proposals, place: int) -> Ensemble:
        """Return an empty ensemble, or one that goes on for a string that is proposed again."""
        if proposals.origin[place] == AGAIN:
            parent = int(proposals.parents[place, 0])
            return self._ended[parent].resample(self._more_samples)
        return self._make_ensemble(proposals.parameters[place])

    def _add_waiting(self, strings: Iterable[int]) -> None:
        """Add to ensembles the samples that are next in order, up to the next round of a race."""
        batches = []
        for string in strings:
            ensemble = self._live(string)
            if ensemble is not None and not ensemble.finished:
                parts = self._waiting.take(string, ensemble.samples_used, self._limit(string))
                if parts:
                    batches.append((ensemble, parts))
        if batches:
            extend(batches)

    def _limit(self, string: int) -> float:
        """Return how many samples a string may use before the others have caught up."""
        if self._racing is None:
            return math.inf
        return self._racing.samples(self._round if string in self._open else 0)

    def _close_finished(self, strings: Iterable[int]) -> Iterator[Decision]:
        """Close those of some strings that are open and need no more samples."""
        for string in list(strings):
            ensemble = self._open.get(string)
            if ensemble is not None and ensemble.finished:
                yield self._close(string, ensemble)

    def _close(self, string: int, ensemble: Ensemble) -> StringEvaluated:
        del self._open[string]
        self._waiting.drop(string)
        self.results[string] = ensemble.result()
        self._ended[string] = ensemble
        self._samples_used += ensemble.samples_used
        return StringEvaluated(string, self.results[string])

    def _advance(self) -> Iterator[Decision]:
        """Run races, and close generations and propose the next as long as no string is open."""
        yield from self._run_races()
        while not self._open:
            yield self._close_generation()
            self.ended_by = self._ending.met(self.generation + 1, self._search)
            if self.finished:
                self._waiting.clear()
                return
            yield from self._propose()
            yield from self._run_races()

    def _run_races(self) -> Iterator[Decision]:
        """Run all rounds for which every open string has enough samples."""
        while self._racing is not None and self._open:
            needed = self._racing.samples(self._round)
            if any(ensemble.samples_used < needed for ensemble in self._open.values()):
                return
            running = {string: _estimate(ensemble) for string, ensemble in self._open.items()}
            done = [string for string in self._numbers.tolist() if string in self.results]
            kept = () if AGAIN in self._origins else self._parents
            others = [_estimate(self._ended[string]) for string in [*kept, *done]]
            for string in self._racing.dropped(self._search.parents, self._round, running, others):
                yield self._close(string, self._open[string])
            self._round += 1
            self._add_waiting(self._open)
            yield from self._close_finished(self._open)

    def _close_generation(self) -> GenerationSummary:
        self._search.tell(self._evaluations())
        population = set(self._search.population_ids.tolist())
        self._ended = {i: ended for i, ended in self._ended.items() if i in population}
        ranked = self._search.best(self._search.population_ids.size)
        best, error = ranked[0], ranked[0].standard_error
        return GenerationSummary(
            generation=self.generation,
            best=best.string,
            objective=best.objective,
            standard_error=self.results[best.string].standard_error if error is None else error,
            mean_of_top=self._search.mean_of_top(self._top),
            population=np.array([string for string, *_ in ranked]),
            evaluations=len(self.results),
            samples_used=self._samples_used,
            estimated=error is not None,
        )

    def _evaluations(self) -> Evaluations:
        """Collect the results of this generation for the search."""
        results = [self.results[string] for string in self._numbers.tolist()]
        return Evaluations(
            self._numbers,
            np.array([self._strings[string] for string in self._numbers]),
            np.array([result.objective for result in results]),
            np.array([self._signed(result) for result in results]),
            np.array([self._ended[string].completed for string in self._numbers.tolist()]),
        )


def _estimate(ensemble: Ensemble) -> MeanEstimate:
    result = ensemble.result()
    return MeanEstimate(result.objective, result.standard_error, ensemble.completed)
