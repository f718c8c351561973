"""A search by a regression of all samples so far: where may the optimum be, given the noise?

The signed mean whose magnitude is the objective is modelled as a Gaussian process over the unit
cube. A batch is drawn by Thompson sampling (Thompson 1933; Hernández-Lobato et al. 2017): each
string is the best one of another function that the samples allow, so that a batch explores what is
uncertain without being told how much.
"""

from concurrent.futures import Future, ThreadPoolExecutor
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.random_streams import SURROGATE, search_stream
from agglom_mpi.search.acquisition import (
    POLISHED,
    PROMISING,
    best_expected,
    candidates_about,
    duplicates_last,
    expected_objective,
    nudged,
)
from agglom_mpi.search.baselines import NO_STRINGS, sobol_strings
from agglom_mpi.search.gaussian_process import single_threaded
from agglom_mpi.search.proposals import (
    MODEL,
    RANDOM,
    EvaluatedStrings,
    Evaluations,
    Proposals,
    Ranked,
    as_proposals,
    begun_with,
)
from agglom_mpi.search.space import SearchSpace

if TYPE_CHECKING:
    from agglom_mpi.search.gaussian_process import Covariance, GaussianProcess

FITTED: Final = 400
"""Strings that the covariance is fitted to at most; all are used once it is known."""

GROWTH: Final = 1.25
"""The covariance is fitted again when there are so many times as many strings."""


class SurrogateSearch(EvaluatedStrings):
    """Propose by a Gaussian process.

    A batch learns from the results of all generations but the one before it, so that it is known,
    and may be simulated, while that one still runs: neither a slow sample nor a fit of the
    covariance makes the ranks wait.

    Parameters
    ----------
    space
        The box to search.
    seed
        Seed of the campaign.
    initial
        Strings before the first that a model proposes, Sobol points, in two generations.
    batch
        Strings of each other generation.
    given
        Strings that the first generation begins with, shape (n, 10), n at most half of `initial`.
    magnitude
        Whether the objective is the magnitude of what is modelled, the signed mean.
    background
        Whether to think in a thread; `known_proposals` then does not wait for it.
    """

    parents = 1

    def __init__(
        self,
        space: SearchSpace,
        seed: int,
        initial: int,
        batch: int,
        given: NDArray[np.float64] = NO_STRINGS,
        magnitude: bool = False,
        background: bool = False,
    ) -> None:
        self._first = (initial + 1) // 2
        super().__init__(min(batch, self._first))  # the same in all generations
        self.space = space
        self.seed = seed
        self.initial = initial
        self.batch = batch
        self.given = given
        self._magnitude = magnitude
        self._thread = ThreadPoolExecutor(1) if background else None
        self._thoughts: dict[int, Future[Proposals]] = {}
        self._covariances: dict[int, Covariance] = {}
        self._models: dict[tuple[int, int], GaussianProcess] = {}
        self._expected: list[Ranked] | None = None

    def ask(self) -> Proposals:
        """Propose the strings of the next generation."""
        batch = self._thought(self.generation).result()
        if self._thread is not None:
            self._thought(self.generation + 1)
        return batch

    def known_proposals(self, generation: int) -> tuple[int, Proposals] | None:
        """Propose the generation after the one that is being judged."""
        if generation > self.generation + 1:
            return None
        thought = self._thought(generation)
        return (self._told_before(generation), thought.result()) if thought.done() else None

    def best(self, k: int) -> list[Ranked]:
        """Return the k strings with the best expected objective, whatever luck they had.

        What could not be judged is last, though it may be expected to be good.
        """
        if self._expected is None:
            self._expected = self._expect()
        return self._expected[:k]

    @property
    def population_ids(self) -> NDArray[np.int64]:
        """Numbers of the strings with the best expected objectives, the best first."""
        return np.array([ranked.string for ranked in self.best(self._kept)], np.int64)

    def tell(self, judged: Evaluations) -> None:
        """Take a generation."""
        super().tell(judged)
        self._expected = None

    @single_threaded
    def _expect(self) -> list[Ranked]:
        """Rank all strings, by a covariance that no waiting is needed for."""
        model = self._model(self._told_before(self.generation - 1), self.generation)
        if model is None:
            return EvaluatedStrings.best(self, len(self))
        points = self.space.to_unit(self.parameters)
        errors = model.deviation_at_points
        expected = expected_objective(model.mean_at_points, errors, self._magnitude)
        order = np.argsort(expected, kind="stable")
        judged = np.isfinite(self.objectives)
        ranked = [
            Ranked(i, float(expected[i]), float(errors[i]))
            for i in duplicates_last(points, order[judged[order]])
        ]
        return ranked + [Ranked(i, np.inf) for i in np.flatnonzero(~judged).tolist()]

    def _told_before(self, generation: int) -> int:
        """Return the number of strings of all generations before this one."""
        sizes = 0, self._first, self.initial
        return sizes[generation] if generation < 3 else self.initial + (generation - 2) * self.batch

    def _thought(self, generation: int) -> Future[Proposals]:
        """Begin to think of a generation whose results are there, unless that was begun before."""
        if generation not in self._thoughts:
            if self._thread is None or generation < 2:
                thought: Future[Proposals] = Future()
                thought.set_result(self._propose(generation))
            else:
                thought = self._thread.submit(self._propose, generation)
            self._thoughts = {g: t for g, t in self._thoughts.items() if g >= self.generation}
            self._thoughts[generation] = thought
        return self._thoughts[generation]

    @single_threaded
    def _propose(self, generation: int) -> Proposals:
        first, end = map(self._told_before, (generation, generation + 1))
        if generation < 2:
            some = self.given[: end - first] if generation == 0 else NO_STRINGS
            drawn = sobol_strings(self.space, self.seed, first + len(some), end - first - len(some))
            return begun_with(some, drawn, generation)
        known = self._told_before(generation - 1)
        random = search_stream(self.seed, SURROGATE, generation)
        model = self._model(known, generation - 1)
        if model is None:
            points, origin = random.random((end - first, self.space.dimensions)), RANDOM
        else:
            points, origin = self._proposed_by(model, known, end - first, random), MODEL
        strings = self.space.from_unit(nudged(points, random))
        return as_proposals(generation, strings, origin)

    def _proposed_by(
        self, model: "GaussianProcess", known: int, count: int, random: np.random.Generator
    ) -> NDArray[np.float64]:
        """Where the objective is expected to be best, then where it may be: shape (count, d)."""
        points = self.space.to_unit(self.parameters[:known])
        mean = model.mean_at_points
        order = np.argsort(abs(mean) if self._magnitude else mean, kind="stable")
        candidates = candidates_about(points[order[:PROMISING]], random)
        functions = model.draw(candidates, count - 1, random)
        objectives = abs(functions) if self._magnitude else functions
        best = best_expected(model, points[order[:POLISHED]], self._magnitude)
        return np.vstack((best, candidates[np.argmin(objectives, axis=1)]))

    def _model(self, fitted: int, generation: int) -> "GaussianProcess | None":
        """Process through all strings before a generation, by a covariance of the first of them.

        It grows from that of the generation before, so that its numbers, which depend on the order
        of the operations, are those of the generations and not of when somebody asked.
        """
        from agglom_mpi.search.gaussian_process import GaussianProcess

        fitted = milestone(fitted, self._first)
        covariance = self._covariance(fitted)
        if covariance is None:
            return None
        model = self._models.get((fitted, generation))
        if model is None:
            grows = self._told_before(generation - 1) >= fitted
            earlier = self._model(fitted, generation - 1) if grows else None
            data = self._data(self._told_before(generation))
            model = GaussianProcess(covariance, *data, earlier)
            recent = {key: m for key, m in self._models.items() if key[1] >= generation - 1}
            self._models = {**recent, (fitted, generation): model}
        return model

    def _covariance(self, fitted: int) -> "Covariance | None":
        """Covariance fitted to so many strings; None if they are too few."""
        from agglom_mpi.search.gaussian_process import fit_covariance

        if np.isfinite(self.objectives[:fitted]).sum() < 2:
            return None
        if fitted not in self._covariances:
            points, values, samples = self._data(fitted)
            some = spread(self.objectives[:fitted], FITTED)
            self._covariances[fitted] = fit_covariance(points[some], values[some], samples[some])
        return self._covariances[fitted]

    def _data(
        self, known: int
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.int64]]:
        """Points, deviations and samples of the first strings; what failed is as bad as any."""
        deviations, finite = self.deviations[:known], np.isfinite(self.objectives[:known])
        worst = deviations[finite][np.argmax(self.objectives[:known][finite])]
        return (
            self.space.to_unit(self.parameters[:known]),
            np.where(finite, deviations, worst),
            np.maximum(self.samples[:known], 1),
        )


def milestone(known: int, first: int) -> int:
    """Return the largest of `first`, `GROWTH` times that and so on that is at most `known`."""
    fitted = first
    while (after := int(np.ceil(fitted * GROWTH))) <= known:
        fitted = after
    return min(fitted, known)


def spread(objectives: NDArray[np.float64], most: int) -> NDArray[np.int64]:
    """Places of at most so many: one half the best, the other evenly from the rest."""
    order = np.argsort(np.where(np.isfinite(objectives), objectives, np.inf), kind="stable")
    if len(order) <= most:
        return np.sort(order)
    rest = order[most // 2 :]
    others = rest[np.linspace(0, len(rest) - 1, most - most // 2).astype(np.int64)]
    return np.sort(np.concatenate((order[: most // 2], others)))
