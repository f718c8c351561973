"""Gaussian-process search by Thompson sampling.

The signed mean whose magnitude is the objective is modelled as a Gaussian process over the unit
cube. A generation is drawn by Thompson sampling (Thompson 1933; Hernández-Lobato et al. 2017): each
string is the optimum of another function drawn from the posterior.
"""

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Final, Literal

import numpy as np
from numpy.typing import NDArray

from agglom_mpi.declaration.components import In, Whole
from agglom_mpi.declaration.declared import LATER, FieldPath, Meaning, NotEmpty
from agglom_mpi.emulation.blas_threads import single_threaded
from agglom_mpi.random_streams import SURROGATE, search_stream
from agglom_mpi.search.acquisition import (
    CANDIDATES,
    PROMISING,
    STARTS,
    SetAim,
    best_expected,
    candidates_about,
    duplicates_last,
    expected_objective,
    perturbed,
)
from agglom_mpi.search.methods.baselines import SobolStrings
from agglom_mpi.search.methods.method import SearchInputs, SearchMethod
from agglom_mpi.search.proposals import (
    MODEL,
    RANDOM,
    EvaluatedStrings,
    Evaluations,
    Proposals,
    Ranked,
    begun_with,
)
from agglom_mpi.statistics import Floats

if TYPE_CHECKING:
    from concurrent.futures import Future

    from agglom_mpi.emulation.gaussian_process import Covariance, GaussianProcess

FITTED: Final = 400
"""Largest number of strings that the covariance is fitted to; all are used once it is known."""

GROWTH: Final = 1.25
"""Factor in the number of strings after which the covariance is fitted again."""


SET_TOLERANCE: Final = 0.05
"""Default tolerance of the set that a search looks for, as of its report."""


class Surrogate(SearchMethod):
    """Gaussian-process model of all samples; batches by Thompson sampling.

    Attributes
    ----------
    initial
        Number of Sobol points, in two generations, before the model proposes.
    batch
        Number of strings of each other generation.
    aim
        Whether the best string or the set of strings that meet the target is searched for.
    tolerance
        Tolerance of the set, relative to the target.
    learn_from
        Campaign file of the same scene whose samples the model learns from; it then proposes from
        the start.
    """

    lag: ClassVar[int] = 2
    ranks_by_model: ClassVar[bool] = True
    method: Literal["surrogate"] = "surrogate"
    initial: Annotated[int, Whole(at_least=8, at_most=10**4)] = 48
    batch: Annotated[int, Whole(at_least=2, at_most=10**4)] = 24
    aim: Annotated[Literal["best", "set"], LATER] = "best"
    SUPPLIED: ClassVar[Mapping[str, str]] = {"tolerance": f"{SET_TOLERANCE:g}"}
    tolerance: Annotated[Annotated[float, In("1", above=0, below=1)] | None, LATER] = None
    learn_from: Annotated[NotEmpty | None, LATER, Meaning("a campaign file")] = None

    def build(self, inputs: SearchInputs) -> "SurrogateSearch":
        """Return the search before its first generation."""
        return SurrogateSearch(self, inputs)

    @property
    def population(self) -> int:
        """Size of a batch, at most the first generation."""
        return min(self.batch, self.first_generation)

    @property
    def first_generation(self) -> int:
        """Half of the `initial` strings, rounded up."""
        return (self.initial + 1) // 2

    def strings(self, generations: int) -> int:
        """Return the number of strings: two generations of Sobol points, then batches."""
        if generations < 2:
            return generations * self.first_generation
        return self.initial + (generations - 2) * self.batch

    @property
    def favours_low_objectives(self) -> bool:
        """Whether the search looks for the best string."""
        return not self.looks_for_a_set

    @property
    def looks_for_a_set(self) -> bool:
        """Whether the set of strings that meet a target is searched, not the best string."""
        return self.aim == "set"

    @property
    def learns_from(self) -> str | None:
        """Name of the campaign file whose samples the model learns from; None: there is none."""
        return self.learn_from

    @property
    def set_tolerance(self) -> float:
        """Tolerance of the set."""
        return self.tolerance or SET_TOLERANCE

    def problems(self) -> Iterator[tuple[FieldPath, str]]:
        """Yield a tolerance where no set is searched for."""
        yield from super().problems()
        if self.tolerance is not None and not self.looks_for_a_set:
            yield ("tolerance",), "is that of a set; give aim: set, or leave it out"

    @property
    def summary(self) -> str:
        """One line on the method."""
        batches = "by Thompson sampling"
        if self.looks_for_a_set:
            batches = (
                "half even around the target, half where it is unsure which strings are within "
                f"{self.set_tolerance:g} of it"
            )
        first = f"{self.initial} Sobol points first, then batches of {self.batch}"
        if self.learn_from is not None:
            first = f"{self.initial} strings in two generations, then batches of {self.batch},"
        return f"Gaussian process through all samples, {first} {batches}"


class SurrogateSearch(EvaluatedStrings):
    """The samples and processes of a search by `Surrogate`.

    The process is through the strings learned from another campaign, then the search's own; numbers
    of known strings count both. A generation learns from the results of all but the one before it,
    so that it is known, and may be simulated, while that one still runs: neither a slow sample nor
    a fit of the covariance makes the ranks wait.

    Parameters
    ----------
    method
        Its numbers.
    inputs
        Box, seed, given strings and what the model is of. With `background`, proposals are computed
        in a thread, and `known_proposals` does not wait for it.
    """

    parents = 1

    def __init__(self, method: Surrogate, inputs: SearchInputs) -> None:
        super().__init__(method.population)  # the same in all generations
        self.method = method
        self.space = inputs.space
        self.seed = inputs.seed
        self.given = inputs.given
        self._learned = inputs.learned
        self._learned_count = 0 if inputs.learned is None else len(inputs.learned.ids)
        self._sobol = SobolStrings(inputs.space, inputs.seed)
        self._magnitude = inputs.magnitude
        self._aim: SetAim | None = None
        if method.looks_for_a_set:
            self._aim = SetAim(method.set_tolerance, inputs.coordinates, inputs.groups)
        self._judged = 0  # strings by which the error of the set was told last
        self._error = np.inf
        # Loaded when a search begins: reports of a file import this module, too.
        from concurrent.futures import Future, ThreadPoolExecutor

        self._thread = ThreadPoolExecutor(1) if inputs.background else None
        self._pending: dict[int, Future[Proposals]] = {}
        self._covariances: dict[int, Covariance] = {}
        self._models: dict[tuple[int, int], GaussianProcess] = {}
        self._ranking: list[Ranked] | None = None

    def ask(self) -> Proposals:
        """Return the strings of the next generation."""
        proposals = self._fit_in_background(self.generation).result()
        if self._thread is not None:
            self._fit_in_background(self.generation + 1)
        return proposals

    def known_proposals(self, generation: int) -> tuple[int, Proposals] | None:
        """Return the generation after the one under way, once it is computed."""
        if generation > self.generation + 1:
            return None
        pending = self._fit_in_background(generation)
        return (self.method.strings(generation), pending.result()) if pending.done() else None

    def best(self, k: int) -> list[Ranked]:
        """Return the k strings with the best expected objective by the process.

        Strings that could not be evaluated are last, whatever the process expects.
        """
        if self._ranking is None:
            self._ranking = self._rank()
        return self._ranking[:k]

    @property
    def population_ids(self) -> NDArray[np.int64]:
        """Numbers of the strings with the best expected objectives, the best first."""
        return np.array([ranked.string for ranked in self.best(self._kept)], np.int64)

    def tell(self, evaluations: Evaluations) -> None:
        """Learn from the results of a generation."""
        super().tell(evaluations)
        self._ranking = None

    def set_error(self) -> float:
        """Return the expected error of the set that is looked for; see `SetAim.expected_error`.

        It is told again when there are `GROWTH` times as many strings.
        """
        if self._aim is not None and len(self) >= GROWTH * self._judged:
            self._judged = len(self)
            known = self._count(self.generation)
            objectives = self._known("objectives", known)
            means = np.where(np.isfinite(objectives), self._known("deviations", known), np.nan)
            data = self._known("parameters", known), means, self._known("samples", known)
            self._error = self._aim.expected_error(*data, self.space)
        return self._error

    @single_threaded
    def _rank(self) -> list[Ranked]:
        """Rank all strings, by a covariance that is fitted already."""
        model = self._model(self._count(self.generation - 1), self.generation)
        if model is None:
            return EvaluatedStrings.best(self, len(self))
        points, own = self.space.to_unit(self.parameters), slice(self._learned_count, None)
        errors = model.deviation_at_points[own]
        expected = expected_objective(model.mean_at_points[own], errors, self._magnitude)
        order = np.argsort(expected, kind="stable")
        evaluated = np.isfinite(self.objectives)
        ranked = [
            Ranked(i, float(expected[i]), float(errors[i]))
            for i in duplicates_last(points, order[evaluated[order]])
        ]
        return ranked + [Ranked(i, np.inf) for i in np.flatnonzero(~evaluated).tolist()]

    def _fit_in_background(self, generation: int) -> "Future[Proposals]":
        """Begin to compute the proposals of a generation, unless that was begun before."""
        if generation not in self._pending:
            if self._thread is None or (generation < 2 and self._learned is None):
                from concurrent.futures import Future

                pending: Future[Proposals] = Future()
                pending.set_result(self._propose(generation))
            else:
                pending = self._thread.submit(self._propose, generation)
            self._pending = {g: p for g, p in self._pending.items() if g >= self.generation}
            self._pending[generation] = pending
        return self._pending[generation]

    @single_threaded
    def _propose(self, generation: int) -> Proposals:
        first, end = map(self.method.strings, (generation, generation + 1))
        given = self.given[: end - first] if generation == 0 else self.space.no_strings
        first += len(given)
        if generation < 2 and self._learned is None:
            drawn = self._sobol.strings(first, end - first)
            return begun_with(given, drawn, generation)
        known = self._count(generation - 1)
        random = search_stream(self.seed, SURROGATE, generation)
        model = self._model(known, generation - 1)
        if model is None or first == end:
            points, origin = self.space.sample_points(random, end - first), RANDOM
        else:
            points, origin = self._proposed_by(model, known, end - first, random), MODEL
        strings = self.space.from_unit(perturbed(points, random, self.space))
        return begun_with(given, strings, generation, origin)

    def _proposed_by(
        self, model: "GaussianProcess", known: int, count: int, random: np.random.Generator
    ) -> Floats:
        """Return the point with the best expected objective, then optima of draws, (count, d).

        Where the set is looked for, they are points where membership is unsure.
        """
        if self._aim is not None:
            return self._aim.batch(model, count, random, self.space)
        points = self.space.to_unit(self._known("parameters", known))[self._learned_count :]
        mean = model.mean_at_points[self._learned_count :]
        if self._learned is not None:  # learned strings may be outside of what is allowed
            more = self.space.sample_points(random, CANDIDATES)
            points, mean = np.vstack((points, more)), np.append(mean, model.mean(more))
        order = np.argsort(abs(mean) if self._magnitude else mean, kind="stable")
        candidates = candidates_about(points[order[:PROMISING]], random, self.space)
        functions = model.draw(candidates, count - 1, random)
        objectives = abs(functions) if self._magnitude else functions
        best = best_expected(model, points[order[:STARTS]], self._magnitude, self.space)
        return np.vstack((best, candidates[np.argmin(objectives, axis=1)]))

    def _count(self, generations: int) -> int:
        """Return the number of strings that are known after a number of generations."""
        return self._learned_count + self.method.strings(max(generations, 0))

    def _model(self, fitted: int, generation: int) -> "GaussianProcess | None":
        """Return the process through all strings before a generation; None if they are too few.

        Its covariance is fitted to the first `fitted` of them. It is extended from the process of
        the generation before, so that its rounding errors depend on the generations alone and not
        on when it is asked for.
        """
        from agglom_mpi.emulation.gaussian_process import GaussianProcess

        fitted = milestone(fitted, max(self.method.first_generation, self._learned_count))
        covariance = self._covariance(fitted)
        if covariance is None:
            return None
        model = self._models.get((fitted, generation))
        if model is None:
            grows = generation > 0 and self._count(generation - 1) >= fitted
            earlier = self._model(fitted, generation - 1) if grows else None
            data = self._data(self._count(generation))
            model = GaussianProcess(covariance, *data, earlier)
            recent = {key: m for key, m in self._models.items() if key[1] >= generation - 1}
            self._models = {**recent, (fitted, generation): model}
        return model

    def _covariance(self, fitted: int) -> "Covariance | None":
        """Return the covariance fitted to the first strings; None if they are too few."""
        from agglom_mpi.emulation.likelihood_fit import fit_covariance

        objectives = self._known("objectives", fitted)
        if np.isfinite(objectives).sum() < 2:
            return None
        if fitted not in self._covariances:
            points, values, samples = self._data(fitted)
            some = best_and_spread(objectives, FITTED)
            jumps = not np.isfinite(objectives[some]).all()
            data = points[some], values[some], samples[some]
            self._covariances[fitted] = fit_covariance(*data, jumps)
        return self._covariances[fitted]

    def _known(self, name: str, count: int) -> NDArray[Any]:
        """Return an attribute of the first known strings, as in `EvaluatedStrings`."""
        own: NDArray[Any] = getattr(self, name)
        if self._learned is not None:
            learned = getattr(self._learned, name)
            own = np.concatenate((learned, own)) if len(own) else learned
        return own[:count]

    def _data(self, known: int) -> tuple[Floats, Floats, NDArray[np.int64]]:
        """Return points, (n, d), deviations and samples, (n,); a failed string gets the worst."""
        objectives, deviations = self._known("objectives", known), self._known("deviations", known)
        finite = np.isfinite(objectives)
        worst = deviations[finite][np.argmax(objectives[finite])]
        return (
            self.space.to_unit(self._known("parameters", known)),
            np.where(finite, deviations, worst),
            np.maximum(self._known("samples", known), 1),
        )


def milestone(known: int, first: int) -> int:
    """Return the largest of `first`, `GROWTH`·`first`, … that is at most `known`."""
    fitted = first
    while (after := int(np.ceil(fitted * GROWTH))) <= known:
        fitted = after
    return min(fitted, known)


def best_and_spread(objectives: Floats, limit: int) -> NDArray[np.int64]:
    """Return indices of at most `limit` strings: half the best, half evenly from the rest."""
    order = np.argsort(np.where(np.isfinite(objectives), objectives, np.inf), kind="stable")
    if len(order) <= limit:
        return np.sort(order)
    rest = order[limit // 2 :]
    others = rest[np.linspace(0, len(rest) - 1, limit - limit // 2).astype(np.int64)]
    return np.sort(np.concatenate((order[: limit // 2], others)))
