"""The decisions of a campaign, which depend on outcomes alone, never on when they arrive."""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Final, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.outcome import SampleSummary
from agglom_mpi.search.ensemble import Ensemble, EnsembleResult
from agglom_mpi.search.proposals import AGAIN, Evaluations, Proposals, SearchMethod
from agglom_mpi.search.stopping import Race, RaceEntry

TARGET_REACHED: Final = "target"
GENERATIONS_DONE: Final = "generations"


class Target(NamedTuple):
    """Stop when the mean objective of the best strings is small enough [A 26]."""

    top: int
    objective: float


class Progress(NamedTuple):
    """How far the ensemble of a string is."""

    next_sample: int
    """Samples judged so far, hence the number of the one that is needed next."""
    max_samples: int


class GenerationSummary(NamedTuple):
    """A generation whose strings have all been judged."""

    generation: int
    best: int
    """Number of the best string of the population."""
    objective: float
    standard_error: float
    """Of the best string: as its ensemble gives them, or a search that makes its own estimate."""
    mean_of_top: float
    """Mean objective of the best `Target.top` strings, or of the parents without a target."""
    population: NDArray[np.int64]
    """Numbers of the strings, the best first, shape (S,)."""
    evaluations: int
    """Strings judged so far."""
    samples_used: int
    """Samples judged so far."""


class Observer(Protocol):
    """Told of every decision; it must not call the inversion back."""

    def announced(self, batch: Proposals, ids: NDArray[np.int64]) -> None:
        """Store strings of a coming generation; called before `Inversion.announce` returns."""

    def proposed(self, batch: Proposals, ids: NDArray[np.int64]) -> None:
        """Store new strings, of which some may be announced; called before they are live."""

    def judged(self, string: int, result: EnsembleResult) -> None:
        """Take the result of a string."""

    def generation_done(self, summary: GenerationSummary) -> None:
        """Take the summary of a generation."""


class Inversion:
    """Drive a search with samples that arrive in any order.

    Strings are numbered 0, 1, 2, … in the order of proposal. Samples of a string are judged in
    order 0, 1, 2, …; early ones wait, and those after the ensemble's end are ignored, as is any
    but the first copy. Outcomes of strings yet to be proposed wait too, so that a resume may
    hand over all it has at once, before `start`, and samples of announced strings may be
    simulated before their generation comes.

    Parameters
    ----------
    search
        The method, with nothing told yet.
    make_ensemble
        Makes an empty ensemble.
    generations
        Most generations.
    target
        When to stop before; None never does.
    restore
        Replaces a batch, given the number of its first string, by what an earlier leg of the
        campaign has stored of it.
    observer
        Told of everything that is decided.
    racing
        When to give up strings that will not be kept; None never does.
    more_samples
        Samples that a string gets which is proposed again.
    signed
        The signed mean whose magnitude is the objective of a result; the objective by default.
    """

    def __init__(
        self,
        search: SearchMethod,
        make_ensemble: Callable[[], Ensemble],
        generations: int,
        target: Target | None,
        restore: Callable[[Proposals, int], Proposals] | None,
        observer: Observer,
        signed: Callable[[EnsembleResult], float] = lambda result: result.objective,
        racing: Race | None = None,
        more_samples: int = 1,
    ) -> None:
        self.results: dict[int, EnsembleResult] = {}
        self.stop_reason: str | None = None
        self._search = search
        self._make_ensemble = make_ensemble
        self._generations = generations
        self._target = target
        self._restore = restore
        self._observer = observer
        self._signed = signed
        self._racing = racing
        self._parents: list[int] = []
        self._more_samples = more_samples
        self._ended: dict[int, Ensemble] = {}
        self._race = 0
        self._top = search.parents if target is None else target.top
        self._strings: list[NDArray[np.float64]] = []
        self._coming: dict[int, NDArray[np.float64]] = {}
        self._last_announced = 0
        self.generation = 0
        self._ids = np.empty(0, np.int64)
        self._origins = np.empty(0, np.int8)
        self._open: dict[int, Ensemble] = {}
        self._early: dict[int, Ensemble] = {}
        self._waiting: dict[int, dict[int, SampleSummary]] = {}
        self._samples_used = 0

    @property
    def finished(self) -> bool:
        """Whether there is nothing left to decide."""
        return self.stop_reason is not None

    @property
    def live(self) -> Mapping[int, Progress]:
        """The strings of this generation that are not judged yet, in order of number."""
        return {
            string: Progress(ensemble.samples_used, ensemble.max_samples)
            for string, ensemble in self._open.items()
        }

    @property
    def unjudged(self) -> int:
        """Number of strings of this generation that are not judged yet."""
        return len(self._open)

    def progress(self, string: int) -> Progress | None:
        """How far a live or announced string is; None once it needs no more samples."""
        ensemble = self._open.get(string) or self._early.get(string)
        if ensemble is None or ensemble.finished:
            return None
        return Progress(ensemble.samples_used, ensemble.max_samples)

    def used(self, string: int) -> int:
        """Return the number of samples that a string needed which needs no more."""
        early = self._early.get(string)
        return self.results[string].samples_used if early is None else early.samples_used

    def ranked(self) -> list[int]:
        """Return the strings that the search ranks, the best first."""
        return [ranked.string for ranked in self._search.best(len(self.results))]

    def parameters(self, string: int) -> NDArray[np.float64]:
        """Return a proposed or announced string, shape (10,)."""
        if string < len(self._strings):
            return self._strings[string]
        return self._coming[string]

    def start(self) -> None:
        """Propose the first generation."""
        self._propose()
        self._settle()

    def announce(self, generations: int) -> Sequence[int]:
        """Propose strings of one more coming generation, at most so many ahead of this one.

        Returns
        -------
        sequence of int
            Numbers of those that no further result changes; none if there are none, or no such
            generation.
        """
        coming = max(self._last_announced, self.generation) + 1
        if self.finished or coming >= min(self._generations, self.generation + generations + 1):
            return ()
        known = self._search.known_proposals(coming)
        if known is None:
            return ()
        first, batch = known
        if self._restore is not None:
            batch = self._restore(batch, first)
        ids = np.arange(first, first + len(batch.parameters))
        self._observer.announced(batch, ids)
        self._coming.update(zip(ids.tolist(), batch.parameters, strict=True))
        self._last_announced = coming
        for string in ids.tolist():
            self._early[string] = self._make_ensemble()
            self._feed(string, self._early[string])
        return ids.tolist()

    def accept(self, string: int, first: int, outcomes: Sequence[SampleSummary]) -> None:
        """Take the outcomes of consecutive samples, those from `first` on."""
        ensemble = self._open.get(string)
        early = self._early.get(string)
        over = string < len(self._strings) if early is None else early.finished
        if self.finished or (ensemble is None and over):
            return
        waiting = self._waiting.setdefault(string, {})
        for sample, outcome in enumerate(outcomes, first):
            waiting.setdefault(sample, outcome)
        if ensemble is not None:
            self._judge(string, ensemble)
            self._settle()
        elif string in self._early:
            self._feed(string, self._early[string])

    def _propose(self) -> None:
        batch = self._search.ask()
        first = len(self._strings)
        if self._restore is not None:
            batch = self._restore(batch, first)
        self.generation = batch.generation
        self._ids = np.arange(first, first + len(batch.parameters))
        self._origins = batch.origin
        self._observer.proposed(batch, self._ids)
        self._strings.extend(batch.parameters)
        self._open = {}
        self._race = 0
        if self._racing is not None and self.generation:
            self._parents = [ranked.string for ranked in self._search.best(self._racing.kept)]
        for string in self._ids.tolist():
            self._coming.pop(string, None)
            ahead = self._early.pop(string, None)
            self._open[string] = self._begun(batch, string - first) if ahead is None else ahead
        for string, ensemble in list(self._open.items()):
            self._judge(string, ensemble)

    def _begun(self, batch: Proposals, place: int) -> Ensemble:
        """Return an empty ensemble, or one that goes on for a string that is proposed again."""
        if batch.origin[place] == AGAIN:
            return self._ended[int(batch.parents[place, 0])].again(self._more_samples)
        return self._make_ensemble()

    def _feed(self, string: int, ensemble: Ensemble) -> None:
        """Let an ensemble have the samples that it waits for."""
        waiting = self._waiting.get(string, {})
        limit = self._limit(string)
        while not ensemble.finished and ensemble.samples_used in waiting:
            if ensemble.samples_used >= limit:
                return
            ensemble.add(waiting.pop(ensemble.samples_used))
        if ensemble.finished:
            self._waiting.pop(string, None)

    def _limit(self, string: int) -> float:
        """Return how many samples a string may have before the others have caught up."""
        if self._racing is None:
            return math.inf
        return self._racing.samples(self._race if string in self._open else 0)

    def _judge(self, string: int, ensemble: Ensemble) -> None:
        self._feed(string, ensemble)
        if ensemble.finished:
            self._close(string, ensemble)

    def _close(self, string: int, ensemble: Ensemble) -> None:
        del self._open[string]
        self._waiting.pop(string, None)
        self.results[string] = ensemble.result()
        self._ended[string] = ensemble
        self._samples_used += ensemble.samples_used
        self._observer.judged(string, self.results[string])

    def _settle(self) -> None:
        self._hold_races()
        while not self._open:
            self._close_generation()
            if self.finished:
                self._waiting.clear()
                return
            self._propose()
            self._hold_races()

    def _hold_races(self) -> None:
        """Hold all rounds that every string which needs samples has enough of them for."""
        while self._racing is not None and self._open:
            held_at = self._racing.samples(self._race)
            if any(ensemble.samples_used < held_at for ensemble in self._open.values()):
                return
            running = {string: _standing(ensemble) for string, ensemble in self._open.items()}
            done = [string for string in self._ids.tolist() if string in self.results]
            kept = () if AGAIN in self._origins else self._parents
            others = [_standing(self._ended[string]) for string in [*kept, *done]]
            for string in self._racing.dropped(self._race, running, others):
                self._close(string, self._open[string])
            self._race += 1
            for string, ensemble in list(self._open.items()):
                self._judge(string, ensemble)

    def _close_generation(self) -> None:
        self._search.tell(self._judged())
        population = set(self._search.population_ids.tolist())
        self._ended = {i: ended for i, ended in self._ended.items() if i in population}
        ranked = self._search.best(self._search.population_ids.size)
        best, mean_of_top = ranked[0], self._search.mean_of_top(self._top)
        error = best.standard_error
        self._observer.generation_done(
            GenerationSummary(
                generation=self.generation,
                best=best.string,
                objective=best.objective,
                standard_error=self.results[best.string].standard_error if error is None else error,
                mean_of_top=mean_of_top,
                population=np.array([string for string, *_ in ranked]),
                evaluations=len(self.results),
                samples_used=self._samples_used,
            )
        )
        if self._target is not None and mean_of_top <= self._target.objective:
            self.stop_reason = TARGET_REACHED
        elif self.generation + 1 >= self._generations:
            self.stop_reason = GENERATIONS_DONE

    def _judged(self) -> Evaluations:
        """Collect what the strings of this generation turned out to be."""
        results = [self.results[string] for string in self._ids.tolist()]
        return Evaluations(
            self._ids,
            np.array([self._strings[string] for string in self._ids]),
            np.array([result.objective for result in results]),
            np.array([self._signed(result) for result in results]),
            np.array([self._ended[string].completed for string in self._ids.tolist()]),
        )


def _standing(ensemble: Ensemble) -> RaceEntry:
    result = ensemble.result()
    return RaceEntry(result.objective, result.standard_error, ensemble.completed)
